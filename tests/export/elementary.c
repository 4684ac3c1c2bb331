/* Sine, cosine, angle of a point and exponential as the core has them: the crate libm, which is FreeBSD's msun.
   Linked before the library of the platform, they leave no difference between the exported program and the core.
   Angles beyond 2^20 pi/2 are none here.

   Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.

   Developed at SunPro, a Sun Microsystems, Inc. business.
   Permission to use, copy, modify, and distribute this
   software is freely granted, provided that this notice
   is preserved. */
#include <math.h>
#include <stdint.h>
#include <string.h>

static const double PIO2[3] = { 1.57079632673412561417e+00, 6.07710050630396597660e-11, 2.02226624871116645580e-21 };
static const double REST[3] = { 6.07710050650619224932e-11, 2.02226624879595063154e-21, 8.47842766036889956997e-32 };
static const double PI = 3.1415926535897931160, PI_LOW = 1.2246467991473531772e-16;

static uint32_t high(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (uint32_t)(bits >> 32);
}

static int exponent(double x)
{
    return (int)(high(x) >> 20) & 0x7ff;
}

/* x less a multiple of pi/2, as a sum of two; the multiple. */
static int reduced(double x, double *y0, double *y1)
{
    const uint32_t ix = high(x) & 0x7fffffff;
    const int near = ((ix <= 0x400f6a7a) && ((ix & 0xfffff) == 0x921fb)) || (ix == 0x4012d97c) || (ix == 0x401921fb);
    const int few = (ix <= 0x401c463b) && !near;
    double n, r, w, t;
    int round;
    if (few)
    {
        n = (double)(1 + (ix > 0x4002d97c) + (ix > 0x400f6a7a) + (ix > 0x4015fdbc));
        n = (x < 0.0) ? -n : n;
    }
    else
    {
        n = ((x * 6.36619772367581382433e-01) + 0x1.8p52) - 0x1.8p52;
    }
    r = x - (n * PIO2[0]);
    w = n * REST[0];
    *y0 = r - w;
    for (round = 1; !few && (round < 3) && (((int)(ix >> 20) - exponent(*y0)) > ((round == 1) ? 16 : 49)); round++)
    {
        t = r;
        w = n * PIO2[round];
        r = t - w;
        w = (n * REST[round]) - ((t - r) - w);
        *y0 = r - w;
    }
    *y1 = (r - *y0) - w;
    return (int)n;
}

static double near_sine(double x, double y, int whole)
{
    const double z = x * x, w = z * z, v = z * x;
    const double r = (8.33333333332248946124e-03 + (z * (-1.98412698298579493134e-04 + (z * 2.75573137070700676789e-06))))
        + ((z * w) * (-2.50507602534068634195e-08 + (z * 1.58969099521155010221e-10)));
    const double first = -1.66666666666666324348e-01;
    return whole ? (x + (v * (first + (z * r)))) : (x - (((z * ((0.5 * y) - (v * r))) - y) - (v * first)));
}

static double near_cosine(double x, double y)
{
    const double z = x * x, w = z * z, half = 0.5 * z, one = 1.0 - half;
    const double r = (z * (4.16666666666666019037e-02 + (z * (-1.38888888888741095749e-03 + (z * 2.48015872894767294178e-05)))))
        + ((w * w) * (-2.75573143513906633035e-07 + (z * (2.08757232129817482790e-09 + (z * -1.13596475577881948265e-11)))));
    return one + (((1.0 - one) - half) + ((z * r) - (x * y)));
}

/* Sine of x and a number of right angles. */
static double turned(double x, int more)
{
    const uint32_t ix = high(x) & 0x7fffffff;
    double y0 = x, y1 = 0.0, value;
    int n = more;
    if (ix >= 0x413921fb)
    {
        return x - x + NAN;
    }
    if (ix < 0x3e46a09e)
    {
        return more ? 1.0 : x;
    }
    if (ix > 0x3fe921fb)
    {
        n += reduced(x, &y0, &y1);
    }
    value = (n & 1) ? near_cosine(y0, y1) : near_sine(y0, y1, ix <= 0x3fe921fb);
    return (n & 2) ? -value : value;
}

double sin(double x)
{
    return turned(x, 0);
}

double cos(double x)
{
    return turned(x, 1);
}

static double angle(double x)
{
    static const double at[4] = { 4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01,
        1.57079632679489655800e+00 };
    static const double low[4] = { 2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
        6.12323399573676603587e-17 };
    static const double c[11] = { 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
        -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02, 6.66107313738753120669e-02,
        -5.83357013379057348645e-02, 4.97687799461593236017e-02, -3.65315727442169155270e-02, 1.62858201153657823623e-02 };
    const uint32_t ix = high(x);
    double z, w, odd, even, t;
    int id;
    if (ix >= 0x44100000)
    {
        return at[3];
    }
    if (ix < 0x3e400000)
    {
        return x;
    }
    id = (ix < 0x3fdc0000) ? -1 : (ix < 0x3fe60000) ? 0 : (ix < 0x3ff30000) ? 1 : (ix < 0x40038000) ? 2 : 3;
    t = (id < 0)  ? x
        : (id == 0) ? (((2.0 * x) - 1.0) / (2.0 + x))
        : (id == 1) ? ((x - 1.0) / (x + 1.0))
        : (id == 2) ? ((x - 1.5) / (1.0 + (1.5 * x)))
                    : (-1.0 / x);
    z = t * t;
    w = z * z;
    odd = z * (c[0] + (w * (c[2] + (w * (c[4] + (w * (c[6] + (w * (c[8] + (w * c[10]))))))))));
    even = w * (c[1] + (w * (c[3] + (w * (c[5] + (w * (c[7] + (w * c[9]))))))));
    return (id < 0) ? (t - (t * (odd + even))) : (at[id] - (((t * (odd + even)) - low[id]) - t));
}

double atan2(double y, double x)
{
    double z;
    if (isnan(x) || isnan(y))
    {
        return x + y;
    }
    if (y == 0.0)
    {
        return signbit(x) ? copysign(PI, y) : y;
    }
    if ((x == 0.0) || isinf(y) || isinf(x))
    {
        return copysign((x == 0.0 || !isinf(x)) ? (PI / 2.0) : !isinf(y) ? ((x < 0.0) ? PI : 0.0) : NAN, y);
    }
    if ((high(fabs(x)) + (64u << 20)) < high(fabs(y)))
    {
        return copysign(PI / 2.0, y);
    }
    z = ((x < 0.0) && ((high(fabs(y)) + (64u << 20)) < high(fabs(x)))) ? 0.0 : angle(fabs(y / x));
    return copysign((x < 0.0) ? (PI - (z - PI_LOW)) : z, y);
}

double exp(double x)
{
    const uint32_t hx = high(x) & 0x7fffffff;
    double hi = x, lo = 0.0, z, c;
    int k = 0;
    if (isnan(x) || (hx <= 0x3e300000))
    {
        return 1.0 + x;
    }
    if (hx >= 0x4086232b)
    {
        return (x > 0.0) ? INFINITY : 0.0;
    }
    if (hx > 0x3fd62e42)
    {
        k = (x < 0.0) ? -1 : 1;
        k = (hx >= 0x3ff0a2b2) ? (int)((1.44269504088896338700 * x) + ((x < 0.0) ? -0.5 : 0.5)) : k;
        hi = x - (k * 6.93147180369123816490e-01);
        lo = k * 1.90821492927058770002e-10;
    }
    x = hi - lo;
    z = x * x;
    c = x - (z * (1.66666666666666019037e-01 + (z * (-2.77777777770155933842e-03 + (z * (6.61375632143793436117e-05
        + (z * (-1.65339022054652515390e-06 + (z * 4.13813679705723846039e-08)))))))));
    return ldexp(1.0 + ((((x * c) / (2.0 - c)) - lo) + hi), k);
}
