//! Sine, cosine, arctangent, exponential and logarithm in lanes, to 2 units in the last place.
//!
//! The lane crate has none of them. Method: reduction of the argument to a short interval in two
//! steps (Cody & Waite 1980, *Software Manual for the Elementary Functions*) and a polynomial
//! there. The polynomials of sine, cosine and exponential are the Taylor coefficients 1/k!, long
//! enough for the interval; arctangent splits the angle into three intervals of known
//! tangents and uses its alternating series; the logarithm splits off the power of two and sums the series of
//! artanh (Muller 2016, *Elementary Functions*, section 11.2).
//!
//! Tests: `tests/scalars.rs::scalar_elementary_functions_within_two_ulp`.

use super::real::Real;
use fearless_simd::{Simd, f64x8, prelude::*, u64x8};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, LOG2_E, PI};

/// 1.5 · 2⁵²: adding it leaves the nearest integer in the low bits of the mantissa.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// π/2 in three parts; the first two have trailing zeros, so that an integer times them is exact.
const HALF_PI: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];

/// ln 2 in two parts, the first with trailing zeros.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];

/// Taylor coefficients of (sin x − x)/x³ in x², highest first.
const SINE: [f64; 8] = [
    1.0 / 355_687_428_096_000.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    -1.0 / 5_040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];

/// Taylor coefficients of (cos x − 1 + x²/2)/x⁴ in x², highest first.
const COSINE: [f64; 8] = [
    -1.0 / 6_402_373_705_728_000.0,
    1.0 / 20_922_789_888_000.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 479_001_600.0,
    -1.0 / 3_628_800.0,
    1.0 / 40_320.0,
    -1.0 / 720.0,
    1.0 / 24.0,
];

/// The bits of a number. (The crate's own `to_bits` and `from_bits` are calls, whose arguments pass through memory.)
#[inline(always)]
pub fn bits<S: Simd>(x: f64x8<S>) -> u64x8<S> {
    x.bitcast()
}

/// The number of given bits.
#[inline(always)]
pub fn number<S: Simd>(bits: u64x8<S>) -> f64x8<S> {
    bits.bitcast()
}

#[inline(always)]
fn polynomial<S: Simd, const N: usize>(x: f64x8<S>, coefficients: &[f64; N]) -> f64x8<S> {
    let mut sum = x.splat(coefficients[0]);
    for &c in &coefficients[1..] {
        sum = sum.simd.mul_add_f64x8(sum, x, x.splat(c));
    }
    sum
}

/// Sine and cosine, |x| < 1e5.
#[inline(always)]
pub fn sin_cos<S: Simd>(x: f64x8<S>) -> (f64x8<S>, f64x8<S>) {
    let simd = x.simd;
    let shifted = Real::mul_add(x, x.splat(FRAC_2_PI), x.splat(ROUND));
    let quadrant = bits(shifted);
    let n = shifted - ROUND;
    let mut r = x;
    for part in HALF_PI {
        r = Real::mul_add(n, x.splat(-part), r);
    }
    let z = r * r;
    let sine = Real::mul_add(polynomial(z, &SINE) * z, r, r);
    let cosine = Real::mul_add(polynomial(z, &COSINE) * z, z, Real::mul_add(z, x.splat(-0.5), x.splat(1.0)));

    let one = u64x8::splat(simd, 1);
    let two = u64x8::splat(simd, 2);
    let odd = (quadrant & one).simd_eq(one);
    let s: f64x8<S> = odd.select(cosine, sine);
    let c: f64x8<S> = odd.select(sine, cosine);
    let sign_s = (quadrant & two) << 62;
    let sign_c = ((quadrant + one) & two) << 62;
    (number(bits(s) ^ sign_s), number(bits(c) ^ sign_c))
}

/// `e^x`: 0 below −708, infinite above 709.
#[inline(always)]
pub fn exp<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let bounded = Real::min(Real::max(x, x.splat(-708.0)), x.splat(709.0));
    let n = (Real::mul_add(bounded, x.splat(LOG2_E), x.splat(ROUND))) - ROUND;
    let r = Real::mul_add(n, x.splat(-LN_2[1]), Real::mul_add(n, x.splat(-LN_2[0]), bounded));
    let mut sum = x.splat(1.0 / 6_227_020_800.0);
    for factorial in
        [479_001_600.0, 39_916_800.0, 3_628_800.0, 362_880.0, 40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0]
    {
        sum = Real::mul_add(sum, r, x.splat(1.0 / factorial));
    }
    let fraction = Real::mul_add(sum * r, r, r) + 1.0;
    let exponent = bits(n + (ROUND + 1023.0)) << 52;
    let value = fraction * number(exponent);
    let value = Real::select(x.lt(x.splat(-708.0)), x.zero(), value);
    let value = Real::select(x.splat(709.0).lt(x), x.splat(f64::INFINITY), value);
    Real::select(x.simd_eq(x), value, x)
}

/// √½, by its bits: mantissas are taken from [√½, √2).
const ROOT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;

/// The bits of 1, and of 2⁵².
const ONE: u64 = 0x3ff0_0000_0000_0000;
const TWO_52: u64 = 0x4330_0000_0000_0000;

/// `ln x` of a positive normal number.
#[inline(always)]
pub fn ln<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let simd = x.simd;
    let constant = |word: u64| u64x8::splat(simd, word);
    // x = 2^n (1 + f), f in [√½ − 1, √2 − 1).
    let shifted = bits(x) + constant(ONE - ROOT_HALF);
    let exponent = (shifted >> 52) | constant(TWO_52);
    let n = number(exponent) - (f64::from_bits(TWO_52) + 1023.0);
    let mantissa = (shifted & constant(0x000f_ffff_ffff_ffff)) + constant(ROOT_HALF);
    let f: f64x8<S> = number(mantissa) - 1.0;
    // ln(1 + f) = f − f²/2 + s (f²/2 + r), s = f/(2 + f), r = 2 (s²/3 + s⁴/5 + …).
    let s = f / (f + 2.0);
    let z = s * s;
    let mut sum = x.splat(2.0 / 23.0);
    for odd in [21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        sum = Real::mul_add(sum, z, x.splat(2.0 / odd));
    }
    let half = f * f * 0.5;
    let low = Real::mul_add(n, x.splat(LN_2[1]), s * Real::mul_add(sum, z, half));
    Real::mul_add(n, x.splat(LN_2[0]), f - (half - low))
}

/// tan(1/4) and tan(3π/16): limits of the intervals whose centres are 0, π/8 and π/4. Below 1/4 a unit in
/// the last place halves, and a difference without fused product would cost more than two of them.
const TAN_1_4: f64 = 0.255_341_921_221_036_3;
const TAN_3_PI_16: f64 = 0.668_178_637_919_298_9;
const TAN_PI_8: f64 = 0.414_213_562_373_095_05;

/// Angle of the point (`x`, `y`) in (−π, π]; 0 at the origin.
#[inline(always)]
pub fn atan2<S: Simd>(y: f64x8<S>, x: f64x8<S>) -> f64x8<S> {
    let (ax, ay) = (Real::abs(x), Real::abs(y));
    let steep = ax.lt(ay);
    let small = Real::min(ax, ay);
    let large = Real::max(ax, ay);
    let origin = large.simd_eq(x.zero());
    let large = Real::select(origin, x.splat(1.0), large);
    let t = small / large;

    // t in [0, 1]: subtract 0, π/8 or π/4, which leaves |t| <= tan(1/4).
    let middle = x.splat(TAN_1_4).lt(t);
    let upper = x.splat(TAN_3_PI_16).lt(t);
    let centre = Real::select(upper, x.splat(1.0), Real::select(middle, x.splat(TAN_PI_8), x.zero()));
    let offset = Real::select(upper, x.splat(PI / 4.0), Real::select(middle, x.splat(PI / 8.0), x.zero()));
    let r = Real::neg_mul_add(centre, large, small) / Real::mul_add(centre, small, large);
    let z = r * r;
    let mut sum = x.splat(1.0 / 25.0);
    for odd in [23.0, 21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        sum = Real::neg_mul_add(sum, z, x.splat(1.0 / odd));
    }
    let angle = offset + Real::neg_mul_add(sum * z, r, r);

    let angle = Real::select(steep, x.splat(FRAC_PI_2) - angle, angle);
    let angle = Real::select(x.lt(x.zero()), x.splat(PI) - angle, angle);
    let mut result = y.simd.copysign_f64x8(angle, y);
    result = Real::select((x + y).simd_eq(x + y), result, x.splat(f64::NAN));
    result
}
