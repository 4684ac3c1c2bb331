/* What sensors show of a mean, and the rows of their Jacobians; 0 where they show nothing. */

//if place
/* The place of a sensor along a direction. */
static real place(const FILTER_mean *at, const real along[3], const real arm[3], struct row *row)
{
    real r[3][3];
    real lever[3];
    real seen[3];
    real turned[3];
    int i;
    rotation(at->attitude, r);
    turn(r, arm, lever);
    for (i = 0; i < 3; i++)
    {
        lever[i] += at->position[i];
    }
    turn_back(r, along, seen);
    cross(arm, seen, turned);
    set(row, POSITION, along);
    set(row, ATTITUDE, turned);
    return dot(along, lever);
}

//end
/* The velocity through the water of a sensor along an axis of it. */
static real velocity(const FILTER_mean *at, const real along[3], const real arm[3], struct row *row)
{
    real turning[3];
    real lever[3];
    int i;
    cross(&at->nu[3], arm, turning);
    cross(arm, along, lever);
    for (i = 0; i < 3; i++)
    {
        turning[i] += at->nu[i];
    }
    set(row, VELOCITY, along);
    set(row, RATES, lever);
    return dot(along, turning);
}

/* What the current adds over ground. */
static real flow(const FILTER_mean *at, const real along[3], struct row *row)
{
    real r[3][3];
    real seen[3];
    real turned[3];
    real ned[3];
    rotation(at->attitude, r);
    turn_back(r, at->current, seen);
    cross(along, seen, turned);
    turn(r, along, ned);
    set(row, ATTITUDE, turned);
    set(row, CURRENT, ned);
    return dot(along, seen);
}

/* Roll, pitch or yaw of a sensor. */
static int angle(const FILTER_mean *at, const FILTER_constants *k, int axis, real *expected, struct row *row)
{
    real q[4];
    real seen[3][3];
    real cp;
    real sp;
    real sr = R(0.0);
    real cr = R(1.0);
    real rates[3];
    real turned[3];
    int i;
    quaternion_product(at->attitude, k->facing, q);
    rotation(q, seen);
    cp = cosine_of_pitch(seen);
    sp = -seen[2][0];
    if ((axis != 1) && (cp < R(0.05)))
    {
        return 0;
    }
    if (cp > R(0.0))
    {
        sr = seen[2][1] / cp;
        cr = seen[2][2] / cp;
    }
    rates[0] = (axis == 0) ? R(1.0) : R(0.0);
    rates[1] = (axis == 0) ? ((sr * sp) / cp) : ((axis == 1) ? cr : (sr / cp));
    rates[2] = (axis == 0) ? ((cr * sp) / cp) : ((axis == 1) ? -sr : (cr / cp));
    for (i = 0; i < 3; i++)
    {
        turned[i] = dot(k->mount[MOUNT_attitude][i], rates);
    }
    set(row, ATTITUDE, turned);
    *expected = euler_angle(seen, axis);
    return 1;
}

/* The turn rate about an axis of the gyro. */
static real rate(const FILTER_mean *at, const real about[3], struct row *row)
{
    real shown[3];
    int i;
    for (i = 0; i < 3; i++)
    {
        shown[i] = at->nu[3 + i] + at->gyro_bias[i];
    }
    set(row, RATES, about);
    set(row, GYRO, about);
    return dot(about, shown);
}

//if beacon
/* The distance of a sensor from a beacon. */
static int range(const FILTER_mean *at, const real beacon[3], const real arm[3], real *expected, struct row *row)
{
    real r[3][3];
    real away[3];
    int i;
    rotation(at->attitude, r);
    turn(r, arm, away);
    for (i = 0; i < 3; i++)
    {
        away[i] = (at->position[i] + away[i]) - beacon[i];
    }
    *expected = SQRT(dot(away, away));
    if (!(*expected > R(1e-3)))
    {
        return 0;
    }
    for (i = 0; i < 3; i++)
    {
        away[i] /= *expected;
    }
    (void)place(at, away, arm, row);
    return 1;
}

/* The bearing of a beacon about the body's down axis. */
static int bearing(const FILTER_mean *at, const real beacon[3], const real arm[3], real *expected, struct row *row)
{
    real r[3][3];
    real to[3];
    real seen[3];
    real across[3];
    real turned[3];
    real ned[3];
    real x;
    real y;
    real far;
    int i;
    rotation(at->attitude, r);
    for (i = 0; i < 3; i++)
    {
        to[i] = beacon[i] - at->position[i];
    }
    turn_back(r, to, seen);
    x = seen[0] - arm[0];
    y = seen[1] - arm[1];
    far = (x * x) + (y * y);
    if (!(far > R(1e-6)))
    {
        return 0;
    }
    across[0] = -y / far;
    across[1] = x / far;
    across[2] = R(0.0);
    turn(r, across, ned);
    cross(across, seen, turned);
    for (i = 0; i < 3; i++)
    {
        ned[i] = -ned[i];
    }
    set(row, POSITION, ned);
    set(row, ATTITUDE, turned);
    *expected = ATAN2(y, x);
    return 1;
}

//end
//if echo
/* The distance of a plane (unit normal and offset) along a beam. */
static int echo(const FILTER_mean *at, const real along[3], const real arm[3], const real plane[4], real *expected,
    struct row *row)
{
    real r[3][3];
    real beam[3];
    real from[3];
    real seen[3];
    real reach[3];
    real turned[3];
    real straight[3];
    real slope;
    int i;
    rotation(at->attitude, r);
    turn(r, along, beam);
    turn(r, arm, from);
    for (i = 0; i < 3; i++)
    {
        from[i] += at->position[i];
    }
    slope = dot(plane, beam);
    *expected = (plane[3] - dot(plane, from)) / slope;
    if (!((ABS(slope) > R(0.05)) && (*expected > R(0.0))))
    {
        return 0;
    }
    turn_back(r, plane, seen);
    for (i = 0; i < 3; i++)
    {
        reach[i] = arm[i] + (*expected * along[i]);
    }
    cross(reach, seen, turned);
    for (i = 0; i < 3; i++)
    {
        straight[i] = -plane[i] / slope;
        turned[i] = -turned[i] / slope;
    }
    set(row, POSITION, straight);
    set(row, ATTITUDE, turned);
    return 1;
}

//end
//if surface
/* The beam of a sonar that looks at a bearing. */
static void beam_at(const FILTER_constants *k, real towards, real along[3])
{
    const real level[3] = { COS(towards), SIN(towards), R(0.0) };
    int i;
    for (i = 0; i < 3; i++)
    {
        along[i] = dot(k->mount[MOUNT_range][i], level);
    }
}

//end
//if pen
/* The distance of a round net (north and east of its axis, radius) along a beam: that of the plane that touches it. */
static int net(const FILTER_mean *at, const real along[3], const real arm[3], const real pen[3], real *expected,
    struct row *row)
{
    real r[3][3];
    real beam[3];
    real from[3];
    real plane[4];
    real a;
    real b;
    real c;
    real root;
    real far;
    int i;
    rotation(at->attitude, r);
    turn(r, along, beam);
    turn(r, arm, from);
    for (i = 0; i < 2; i++)
    {
        from[i] = (from[i] + at->position[i]) - pen[i];
    }
    a = (beam[0] * beam[0]) + (beam[1] * beam[1]);
    b = (from[0] * beam[0]) + (from[1] * beam[1]);
    c = ((from[0] * from[0]) + (from[1] * from[1])) - (pen[2] * pen[2]);
    if (!((a > R(0.0)) && (((b * b) - (a * c)) >= R(0.0))))
    {
        return 0;
    }
    root = SQRT((b * b) - (a * c));
    far = (c < R(0.0)) ? ((root - b) / a) : ((-root - b) / a);
    if (!(is_number(far) && (far > R(0.0))))
    {
        return 0;
    }
    plane[0] = (from[0] + (far * beam[0])) / pen[2];
    plane[1] = (from[1] + (far * beam[1])) / pen[2];
    plane[2] = R(0.0);
    plane[3] = pen[2] + ((plane[0] * pen[0]) + (plane[1] * pen[1]));
    return echo(at, along, arm, plane, expected, row);
}

//end
/* An axis of a sensor in the body frame. */
static void axis_of(const FILTER_constants *k, int mount, int axis, real along[3])
{
    int i;
    for (i = 0; i < 3; i++)
    {
        along[i] = k->mount[mount][i][axis];
    }
}

/* What a channel shows of a mean; 0 where it shows nothing. */
static int expect(const FILTER_parameters *p, const FILTER_constants *k, const FILTER_state *s, int channel,
    const FILTER_mean *at, real *expected, struct row *row)
{
    static const real unit[3][3] = {
        { R(1.0), R(0.0), R(0.0) }, { R(0.0), R(1.0), R(0.0) }, { R(0.0), R(0.0), R(1.0) }
    };
    real along[3];
    int shown = 1;
    int i;
    row->parts = 0u;
    for (i = 0; i < STATES; i++)
    {
        row->h[i] = R(0.0);
    }
    for (i = 0; i < 3; i++)
    {
        along[i] = unit[0][i];
    }
    switch (channel)
    {
@EXPECTED@    default:
        shown = 0;
        break;
    }
    (void)along;
    (void)unit;
    (void)p;
    (void)k;
    (void)s;
    return shown;
}
