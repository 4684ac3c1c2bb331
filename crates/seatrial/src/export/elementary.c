/* The core's sine, cosine, angle of a point and exponential: the crate libm, which is FreeBSD's msun, to the bit.
   Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.
   Developed at SunPro, a Sun Microsystems, Inc. business.
   Permission to use, copy, modify, and distribute this software is freely granted, provided that this notice is
   preserved. */

/* part: SINE */
/* x less the nearest multiple of pi/2, as a sum of two; the multiple. */
static int core_reduced(double x, double *high, double *low)
{
    static const double part[3] = { 1.57079632673412561417e+00, 6.07710050630396597660e-11, 2.02226624871116645580e-21 };
    static const double rest[3] = { 6.07710050650619224932e-11, 2.02226624879595063154e-21, 8.47842766036889956997e-32 };
    const double a = fabs(x);
    /* Where the first word of a double is that of pi/2, pi, 3 pi/2 or 2 pi the difference loses digits. */
    const _Bool near = ((a >= 0x1.921fbp0) && (a < 0x1.921fcp0)) || ((a >= 0x1.921fbp1) && (a < 0x1.921fcp1))
        || ((a >= 0x1.2d97cp2) && (a < 0x1.2d97dp2)) || ((a >= 0x1.921fbp2) && (a < 0x1.921fcp2));
    const _Bool few = (a < 0x1.c463cp2) && !near;
    double n = 1.0;
    double r;
    double w;
    int e;
    int round;
    if (few)
    {
        n += (a >= 0x1.2d97dp1) ? 1.0 : 0.0;
        n += (a >= 0x1.f6a7bp1) ? 1.0 : 0.0;
        n += (a >= 0x1.5fdbdp2) ? 1.0 : 0.0;
        n = (x < 0.0) ? -n : n;
    }
    else
    {
        n = x * 6.36619772367581382433e-01;
        n = (n + 0x1.8p52) - 0x1.8p52;
    }
    r = x - (n * part[0]);
    w = n * rest[0];
    *high = r - w;
    (void)frexp(a, &e);
    for (round = 1; (round < 3) && !few && (fabs(*high) < ldexp(0.5, e - ((round == 1) ? 16 : 49))); round++)
    {
        const double t = r;
        w = n * part[round];
        r = t - w;
        w = (n * rest[round]) - ((t - r) - w);
        *high = r - w;
    }
    *low = (r - *high) - w;
    return (int)n;
}

static double core_near_sine(double x, double y, int whole)
{
    const double z = x * x;
    const double w = z * z;
    const double v = z * x;
    const double r = (8.33333333332248946124e-03 + (z * (-1.98412698298579493134e-04 + (z * 2.75573137070700676789e-06))))
        + ((z * w) * (-2.50507602534068634195e-08 + (z * 1.58969099521155010221e-10)));
    const double first = -1.66666666666666324348e-01;
    return (whole != 0) ? (x + (v * (first + (z * r)))) : (x - (((z * ((0.5 * y) - (v * r))) - y) - (v * first)));
}

static double core_near_cosine(double x, double y)
{
    const double z = x * x;
    const double w = z * z;
    const double half = 0.5 * z;
    const double one = 1.0 - half;
    const double r = (z * (4.16666666666666019037e-02 + (z * (-1.38888888888741095749e-03 + (z * 2.48015872894767294178e-05)))))
        + ((w * w) * (-2.75573143513906633035e-07 + (z * (2.08757232129817482790e-09 + (z * -1.13596475577881948265e-11)))));
    return one + (((1.0 - one) - half) + ((z * r) - (x * y)));
}

/* Sine of x and a number of right angles; beyond 1.6e6 rad that of the platform. */
static double core_turned(double x, int more)
{
    const double a = fabs(x);
    double high = x;
    double low = 0.0;
    double value;
    int n = more;
    if (!(a < 0x1.921fbp20))
    {
        value = (more == 0) ? sin(x) : cos(x);
    }
    else if (a < 0x1.6a09ep-27)
    {
        value = (more == 0) ? x : 1.0;
    }
    else
    {
        if (a >= 0x1.921fcp-1)
        {
            n += core_reduced(x, &high, &low);
        }
        value = ((n % 2) != 0) ? core_near_cosine(high, low) : core_near_sine(high, low, (a < 0x1.921fcp-1) ? 1 : 0);
        n = ((n % 4) + 4) % 4;
        value = (n >= 2) ? -value : value;
    }
    return value;
}

/* part: ANGLE */
/* Arctangent of x from zero on. */
static double core_arctangent(double x)
{
    static const double at[4] = { 4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01,
        1.57079632679489655800e+00 };
    static const double rest[4] = { 2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
        6.12323399573676603587e-17 };
    static const double c[11] = { 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
        -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02, 6.66107313738753120669e-02,
        -5.83357013379057348645e-02, 4.97687799461593236017e-02, -3.65315727442169155270e-02, 1.62858201153657823623e-02 };
    double t = x;
    double value = x;
    int id = -1;
    if (x >= 0x1p66)
    {
        value = at[3];
    }
    else if (x >= 0x1p-27)
    {
        if (x >= 0x1.38p1)
        {
            id = 3;
            t = -1.0 / x;
        }
        else if (x >= 0x1.3p0)
        {
            id = 2;
            t = (x - 1.5) / (1.0 + (1.5 * x));
        }
        else if (x >= 0x1.6p-1)
        {
            id = 1;
            t = (x - 1.0) / (x + 1.0);
        }
        else if (x >= 0x1.cp-2)
        {
            id = 0;
            t = ((2.0 * x) - 1.0) / (2.0 + x);
        }
        else
        {
            /* small enough as it is */
        }
        const double z = t * t;
        const double w = z * z;
        const double odd = z * (c[0] + (w * (c[2] + (w * (c[4] + (w * (c[6] + (w * (c[8] + (w * c[10]))))))))));
        const double even = w * (c[1] + (w * (c[3] + (w * (c[5] + (w * (c[7] + (w * c[9]))))))));
        value = (id < 0) ? (t - (t * (odd + even))) : (at[id] - (((t * (odd + even)) - rest[id]) - t));
    }
    else
    {
        /* its own tangent */
    }
    return value;
}

static double core_angle(double y, double x)
{
    const double turn = 3.1415926535897931160;
    const double rest = 1.2246467991473531772e-16;
    const double a = fabs(y);
    const double b = fabs(x);
    double value;
    if (!(a < (double)INFINITY) || !(b < (double)INFINITY) || (a <= 0.0))
    {
        value = atan2(y, x);
    }
    else if (((b * 0x1p64) < a) || (b <= 0.0))
    {
        value = copysign(turn / 2.0, y);
    }
    else
    {
        value = ((x < 0.0) && ((a * 0x1p64) < b)) ? 0.0 : core_arctangent(a / b);
        value = copysign((x < 0.0) ? (turn - (value - rest)) : value, y);
    }
    return value;
}

/* part: EXPONENTIAL */
static double core_exponential(double x)
{
    const double a = fabs(x);
    double high = x;
    double low = 0.0;
    double value;
    int k = 0;
    if (!(a < 0x1.6232bp9))
    {
        value = exp(x);
    }
    else if (a < 0x1.00001p-28)
    {
        value = 1.0 + x;
    }
    else
    {
        if (a >= 0x1.62e43p-2)
        {
            double times = (x < 0.0) ? -1.0 : 1.0;
            if (a >= 0x1.0a2b2p0)
            {
                times = (1.44269504088896338700 * x) + (0.5 * times);
            }
            k = (int)times;
            times = (double)k;
            high = x - (times * 6.93147180369123816490e-01);
            low = times * 1.90821492927058770002e-10;
        }
        const double r = high - low;
        const double z = r * r;
        const double c = r - (z * (1.66666666666666019037e-01 + (z * (-2.77777777770155933842e-03 + (z * (6.61375632143793436117e-05
            + (z * (-1.65339022054652515390e-06 + (z * 4.13813679705723846039e-08)))))))));
        value = ldexp(1.0 + ((((r * c) / (2.0 - c)) - low) + high), k);
    }
    return value;
}
