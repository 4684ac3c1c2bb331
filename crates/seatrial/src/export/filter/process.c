/* What the actuators do at an instant: wrench that no inflow changes with the force that the model does not know, the other
   thrusts (force and torque, each with its slope over the inflow), sines and cosines of the fins. */
struct acting
{
    real wrench[6];
//if inflow
    real thrust[@THRUSTS@][4];
//end
//if fins
    real deflection[@FINS@][2];
//end
};

struct moving
{
    const struct acting *on;
    real nu[6];
    real r[3][3];
};

struct moved
{
    real rate[6];
    real by_nu[6][6];
};

@RECORDED@/* x h + y */
static void ahead(const real *x, real h, const real *y, real *z, int count)
{
    int i;
    for (i = 0; i < count; i++)
    {
        z[i] = (x[i] * h) + y[i];
    }
}

static real flushed(real x)
{
    return (ABS(x) < R(1e-30)) ? R(0.0) : x;
}

/* q' = q [0, w] / 2 */
static void quaternion_rate(const real q[4], const real omega[3], real rate[4])
{
    rate[0] = R(-0.5) * ((q[1] * omega[0]) + ((q[2] * omega[1]) + (q[3] * omega[2])));
    rate[1] = R(0.5) * ((q[0] * omega[0]) + ((q[2] * omega[2]) - (q[3] * omega[1])));
    rate[2] = R(0.5) * ((q[0] * omega[1]) + ((q[3] * omega[0]) - (q[1] * omega[2])));
    rate[3] = R(0.5) * ((q[0] * omega[2]) + ((q[1] * omega[1]) - (q[2] * omega[0])));
}

/* The derivatives of R v and of the vertical in the body frame by the quaternion. */
static void by_attitude(const real q[4], const real v[3], real track[3][4], real vertical[3][4])
{
    const real w = R(2.0) * q[0];
    const real x = R(2.0) * q[1];
    const real y = R(2.0) * q[2];
    const real z = R(2.0) * q[3];
    const real a = v[0];
    const real b = v[1];
    const real c = v[2];
    track[0][0] = (y * c) - (z * b);
    track[0][1] = (y * b) + (z * c);
    track[0][2] = ((x * b) + (w * c)) - ((R(2.0) * y) * a);
    track[0][3] = ((x * c) - (w * b)) - ((R(2.0) * z) * a);
    track[1][0] = (z * a) - (x * c);
    track[1][1] = ((y * a) - (w * c)) - ((R(2.0) * x) * b);
    track[1][2] = (x * a) + (z * c);
    track[1][3] = ((w * a) + (y * c)) - ((R(2.0) * z) * b);
    track[2][0] = (x * b) - (y * a);
    track[2][1] = ((z * a) + (w * b)) - ((R(2.0) * x) * c);
    track[2][2] = ((z * b) - (w * a)) - ((R(2.0) * y) * c);
    track[2][3] = (x * a) + (y * b);
    vertical[0][0] = -y;
    vertical[0][1] = z;
    vertical[0][2] = -w;
    vertical[0][3] = x;
    vertical[1][0] = x;
    vertical[1][1] = w;
    vertical[1][2] = z;
    vertical[1][3] = y;
    vertical[2][0] = R(0.0);
    vertical[2][1] = R(-2.0) * x;
    vertical[2][2] = R(-2.0) * y;
    vertical[2][3] = R(0.0);
}

/* One stage of Runge and Kutta: the slope of the motion (position, attitude, velocity) and of each column of its
   derivatives, at what the last slopes lead to. */
static void stage(const real start[13], real begun[COLUMNS][13], const struct acting *on, real ahead_by, real slope[13],
    real slopes[COLUMNS][13])
{
    struct moving in;
    struct moved out;
    real at[13];
    real track[3][4];
    real vertical[3][4];
    int c;
    int i;
    int j;
    ahead(slope, ahead_by, start, at, 13);
    in.on = on;
    rotation(&at[3], in.r);
    for (i = 0; i < 6; i++)
    {
        in.nu[i] = at[7 + i];
    }
    model(&in, &out);
    turn(in.r, &at[7], slope);
    quaternion_rate(&at[3], &at[10], &slope[3]);
    for (i = 0; i < 6; i++)
    {
        slope[7 + i] = out.rate[i];
    }
    by_attitude(&at[3], &at[7], track, vertical);
    for (c = 0; c < COLUMNS; c++)
    {
        real near[13];
        real tilted[3];
        real spun[4];
        real *to = slopes[c];
        ahead(to, ahead_by, begun[c], near, 13);
        for (i = 0; i < 3; i++)
        {
            to[i] = dot(in.r[i], &near[7]);
            tilted[i] = R(0.0);
            for (j = 0; j < 4; j++)
            {
                to[i] += track[i][j] * near[3 + j];
                tilted[i] += vertical[i][j] * near[3 + j];
            }
        }
        quaternion_rate(&near[3], &at[10], &to[3]);
        quaternion_rate(&at[3], &near[10], spun);
        for (i = 0; i < 4; i++)
        {
            to[3 + i] += spun[i];
        }
        for (i = 0; i < 6; i++)
        {
            real sum = (c < 9) ? R(0.0) : by_force[i][c - 9];
            sum += dot(by_vertical[i], tilted);
            for (j = 0; j < 6; j++)
            {
                sum += out.by_nu[i][j] * near[7 + j];
            }
            to[7 + i] = sum;
        }
    }
}

/* A step of the motion and of its derivatives. */
static void step(real motion[13], real columns[COLUMNS][13], const struct acting nodes[3])
{
    static const real node[4] = { R(0.0), R(0.5), R(0.5), R(1.0) };
    static const real weight[4] = { R(1.0) / R(6.0), R(1.0) / R(3.0), R(1.0) / R(3.0), R(1.0) / R(6.0) };
    static const int instant[4] = { 0, 1, 1, 2 };
    real start[13];
    real begun[COLUMNS][13];
    real slope[13];
    real slopes[COLUMNS][13];
    real half;
    real first;
    real second;
    real scale;
    int c;
    int i;
    int k;
    for (i = 0; i < 13; i++)
    {
        start[i] = motion[i];
        slope[i] = R(0.0);
        for (c = 0; c < COLUMNS; c++)
        {
            begun[c][i] = columns[c][i];
            slopes[c][i] = R(0.0);
        }
    }
    for (k = 0; k < 4; k++)
    {
        stage(start, begun, &nodes[instant[k]], node[k] * STEP, slope, slopes);
        ahead(slope, weight[k] * STEP, motion, motion, 13);
        for (c = 0; c < COLUMNS; c++)
        {
            ahead(slopes[c], weight[k] * STEP, columns[c], columns[c], 13);
        }
    }
    for (i = 0; i < 13; i++)
    {
        motion[i] = flushed(motion[i]);
    }
    /* The length of the quaternion back to one by two steps of Newton, and what that does to its derivatives. */
    half = R(0.5) * (dot(&motion[3], &motion[3]) + (motion[6] * motion[6]));
    first = R(1.5) - half;
    second = R(1.5) - ((half * first) * first);
    scale = first * second;
    for (c = 0; c < COLUMNS; c++)
    {
        real *of = columns[c];
        const real grown = dot(&motion[3], &of[3]) + (motion[6] * of[6]);
        const real turned = -(((grown * first) - (half * grown)) * first) + ((half * first) * grown);
        const real scaled = (first * turned) - (grown * second);
        for (i = 0; i < 4; i++)
        {
            of[3 + i] = (of[3 + i] * scale) + (motion[3 + i] * scaled);
        }
        for (i = 0; i < 13; i++)
        {
            of[i] = flushed(of[i]);
        }
    }
    for (i = 0; i < 4; i++)
    {
        motion[3 + i] *= scale;
    }
}

/* What acts on the vehicle now. */
static void act(const FILTER_state *s, const FILTER_input *in, struct acting *on)
{
    int i;
    show(s, in, on);
    for (i = 0; i < 6; i++)
    {
        on->wrench[i] = s->mean.force[i] + on->wrench[i];
    }
    for (i = 0; i < 3; i++)
    {
        on->wrench[3 + i] += dot(lever[i], s->mean.force);
    }
}

/* Moves the mean by a period and finds the derivatives of its motion by attitude, velocity and force before it. */
static void pass(FILTER_state *s, const FILTER_input *in, real block[MOTION][COLUMNS])
{
    struct acting nodes[3];
    real motion[13];
    real columns[COLUMNS][13];
    FILTER_mean *at = &s->mean;
    int c;
    int i;
    int k;
    for (i = 0; i < 6; i++)
    {
        motion[7 + i] = at->nu[i];
    }
    for (i = 0; i < 4; i++)
    {
        motion[3 + i] = at->attitude[i];
    }
    for (i = 0; i < 3; i++)
    {
        motion[i] = at->position[i];
    }
    for (c = 0; c < COLUMNS; c++)
    {
        for (i = 0; i < 13; i++)
        {
            columns[c][i] = ((c >= 3) && (c < 9) && (i == (c + 4))) ? R(1.0) : R(0.0);
        }
        if (c < 3)
        {
            const real unit[3] = { (c == 0) ? R(1.0) : R(0.0), (c == 1) ? R(1.0) : R(0.0), (c == 2) ? R(1.0) : R(0.0) };
            quaternion_rate(at->attitude, unit, &columns[c][3]);
        }
    }
    act(s, in, &nodes[2]);
    for (k = 0; k < STEPS; k++)
    {
        nodes[0] = nodes[2];
        drive(s, in);
        act(s, in, &nodes[1]);
        drive(s, in);
        act(s, in, &nodes[2]);
        if (s->begun != 0)
        {
            step(motion, columns, nodes);
        }
    }
    if (s->begun == 0)
    {
        return;
    }
    for (i = 0; i < 6; i++)
    {
        at->nu[i] = motion[7 + i];
    }
    for (i = 0; i < 4; i++)
    {
        at->attitude[i] = motion[3 + i];
    }
    for (i = 0; i < 3; i++)
    {
        at->position[i] = motion[i] + (at->current[i] * PERIOD);
    }
    for (c = 0; c < COLUMNS; c++)
    {
        const real back[4] = { motion[3], -motion[4], -motion[5], -motion[6] };
        real turned[4];
        quaternion_product(back, &columns[c][3], turned);
        for (i = 0; i < 3; i++)
        {
            block[i][c] = columns[c][i];
            block[3 + i][c] = R(2.0) * turned[1 + i];
        }
        for (i = 0; i < 6; i++)
        {
            block[6 + i][c] = columns[c][7 + i];
        }
    }
}

/* P <- F P F' + Q: rows of motion depend on attitude, velocity and force, the position on the current; below them F is a
   diagonal. */
static void spread(real p[STATES][STATES], real block[MOTION][COLUMNS], const real decay[STATES], const real noise[STATES],
    real swept[3][3])
{
    real rows[MOTION][STATES];
    real pushed[3][STATES];
    int i;
    int j;
    int k;
    for (i = 0; i < MOTION; i++)
    {
        for (j = 0; j < STATES; j++)
        {
            real sum = (i < 3) ? (p[i][j] + (p[CURRENT + i][j] * PERIOD)) : R(0.0);
            for (k = 0; k < COLUMNS; k++)
            {
                sum += p[ATTITUDE + k][j] * block[i][k];
            }
            rows[i][j] = sum;
        }
    }
    for (i = 0; i < MOTION; i++)
    {
        for (j = i; j < MOTION; j++)
        {
            real sum = R(0.0);
            for (k = 0; k < COLUMNS; k++)
            {
                sum += block[j][k] * rows[i][ATTITUDE + k];
            }
            if (j < 3)
            {
                sum += rows[i][j] + (PERIOD * rows[i][CURRENT + j]);
            }
            p[i][j] = sum;
            p[j][i] = sum;
        }
        for (j = MOTION; j < STATES; j++)
        {
            p[i][j] = rows[i][j] * decay[j];
            p[j][i] = p[i][j];
        }
    }
    for (i = MOTION; i < STATES; i++)
    {
        for (j = MOTION; j < STATES; j++)
        {
            p[i][j] *= decay[i] * decay[j];
        }
    }
    /* The current follows the force. */
    for (k = 0; k < 3; k++)
    {
        for (j = 0; j < STATES; j++)
        {
            pushed[k][j] = dot(swept[k], &p[j][FORCE]);
        }
    }
    for (k = 0; k < 3; k++)
    {
        for (j = 0; j < STATES; j++)
        {
            p[CURRENT + k][j] += pushed[k][j];
            if ((j < CURRENT) || (j >= GYRO))
            {
                p[j][CURRENT + k] = p[CURRENT + k][j];
            }
        }
    }
    for (k = 0; k < 3; k++)
    {
        for (j = 0; j < 3; j++)
        {
            p[CURRENT + k][CURRENT + j] += pushed[j][CURRENT + k] + dot(swept[j], &pushed[k][FORCE]);
        }
    }
    for (i = 0; i < STATES; i++)
    {
        p[i][i] += noise[i];
    }
}
