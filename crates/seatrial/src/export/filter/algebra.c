enum
{
    STATES = 24,
    MOTION = 12,
    COLUMNS = 15,
    POSITION = 0,
    ATTITUDE = 3,
    VELOCITY = 6,
    RATES = 9,
    FORCE = 12,
    CURRENT = 18,
    GYRO = 21
};

/* A row of the Jacobian of an observation, and which three of its components are not zero. */
struct row
{
    real h[STATES];
    unsigned parts;
};

static int is_number(real x)
{
    return (x - x) == R(0.0);
}

static real dot(const real a[3], const real b[3])
{
    return ((a[0] * b[0]) + (a[1] * b[1])) + (a[2] * b[2]);
}

static void cross(const real a[3], const real b[3], real c[3])
{
    c[0] = (a[1] * b[2]) - (a[2] * b[1]);
    c[1] = (a[2] * b[0]) - (a[0] * b[2]);
    c[2] = (a[0] * b[1]) - (a[1] * b[0]);
}

/* The rotation body to north-east-down of a quaternion. */
static void rotation(const real q[4], real r[3][3])
{
    const real w = q[0];
    const real x = q[1];
    const real y = q[2];
    const real z = q[3];
    const real x2 = x + x;
    const real y2 = y + y;
    const real z2 = z + z;
    r[0][0] = (R(1.0) - (y2 * y)) - (z2 * z);
    r[0][1] = (x * y2) - (w * z2);
    r[0][2] = (x * z2) + (w * y2);
    r[1][0] = (x * y2) + (w * z2);
    r[1][1] = (R(1.0) - (x2 * x)) - (z2 * z);
    r[1][2] = (y * z2) - (w * x2);
    r[2][0] = (x * z2) - (w * y2);
    r[2][1] = (y * z2) + (w * x2);
    r[2][2] = (R(1.0) - (x2 * x)) - (y2 * y);
}

static void turn(real r[3][3], const real x[3], real y[3])
{
    int i;
    for (i = 0; i < 3; i++)
    {
        y[i] = dot(r[i], x);
    }
}

static void turn_back(real r[3][3], const real x[3], real y[3])
{
    int i;
    for (i = 0; i < 3; i++)
    {
        y[i] = ((r[0][i] * x[0]) + (r[1][i] * x[1])) + (r[2][i] * x[2]);
    }
}

static void quaternion_product(const real a[4], const real b[4], real c[4])
{
    c[0] = (a[0] * b[0]) - ((a[1] * b[1]) + ((a[2] * b[2]) + (a[3] * b[3])));
    c[1] = (a[0] * b[1]) + ((a[1] * b[0]) + ((a[2] * b[3]) - (a[3] * b[2])));
    c[2] = (a[0] * b[2]) + ((a[2] * b[0]) + ((a[3] * b[1]) - (a[1] * b[3])));
    c[3] = (a[0] * b[3]) + ((a[3] * b[0]) + ((a[1] * b[2]) - (a[2] * b[1])));
}

static void from_euler(const real euler[3], real q[4])
{
    const real sr = SIN(R(0.5) * euler[0]);
    const real cr = COS(R(0.5) * euler[0]);
    const real sp = SIN(R(0.5) * euler[1]);
    const real cp = COS(R(0.5) * euler[1]);
    const real sy = SIN(R(0.5) * euler[2]);
    const real cy = COS(R(0.5) * euler[2]);
    q[0] = ((cr * cp) * cy) + ((sr * sp) * sy);
    q[1] = ((sr * cp) * cy) - ((cr * sp) * sy);
    q[2] = ((cr * sp) * cy) + ((sr * cp) * sy);
    q[3] = ((cr * cp) * sy) - ((sr * sp) * cy);
}

/* The cosine of the pitch of a rotation. */
static real cosine_of_pitch(real r[3][3])
{
    return SQRT((r[2][1] * r[2][1]) + (r[2][2] * r[2][2]));
}

/* Roll (0), pitch (1) or yaw (2) of a rotation, rad. */
static real euler_angle(real r[3][3], int axis)
{
    if (axis == 0)
    {
        return ATAN2(r[2][1], r[2][2]);
    }
    return (axis == 1) ? ATAN2(-r[2][0], cosine_of_pitch(r)) : ATAN2(r[1][0], r[0][0]);
}

static real wrapped(real angle)
{
    const real turns = FLOOR((angle * R(0.15915494309189535)) + R(0.5));
    return angle - (turns * R(6.283185307179586));
}

/* Moves a mean by an error; returns whether all of the error is a number. */
static int inject(FILTER_mean *at, const real error[STATES])
{
    const real *delta = &error[ATTITUDE];
    const real angle = SQRT(dot(delta, delta));
    const real scale = (angle < R(1e-9)) ? R(0.5) : (SIN(R(0.5) * angle) / angle);
    real turned[4];
    real q[4];
    int sound = 1;
    int i;
    turned[0] = COS(R(0.5) * angle);
    for (i = 0; i < 3; i++)
    {
        turned[1 + i] = delta[i] * scale;
        at->position[i] += error[POSITION + i];
        at->current[i] += error[CURRENT + i];
        at->gyro_bias[i] += error[GYRO + i];
    }
    quaternion_product(at->attitude, turned, q);
    {
        const real length = R(1.0) / SQRT((dot(q, q)) + (q[3] * q[3]));
        for (i = 0; i < 4; i++)
        {
            at->attitude[i] = q[i] * length;
        }
    }
    for (i = 0; i < 6; i++)
    {
        at->nu[i] += error[VELOCITY + i];
        at->force[i] += error[FORCE + i];
    }
    for (i = 0; i < STATES; i++)
    {
        sound = sound && is_number(error[i]);
    }
    return sound;
}

/* h x */
static real times(const struct row *row, const real x[STATES])
{
    real sum = R(0.0);
    int i;
    for (i = 0; i < STATES; i += 3)
    {
        if (((row->parts >> (i / 3)) & 1u) != 0u)
        {
            sum += dot(&row->h[i], &x[i]);
        }
    }
    return sum;
}

static void set(struct row *row, int first, const real h[3])
{
    int i;
    for (i = 0; i < 3; i++)
    {
        row->h[first + i] = h[i];
    }
    row->parts |= 1u << (first / 3);
}
