//! The operations of a number, lane by lane on every instruction set, against those of `f64`.

use fearless_simd::{Level, Simd, SimdFrom, dispatch, f64x8};
use proptest::array::uniform8;
use proptest::prelude::*;
use seatrial::number::lanes::{LANES, Lanes, available_levels};
use seatrial::number::real::Real;
use std::f64::consts::{FRAC_PI_2, PI};

/// Units in the last place between two numbers; zero also for two that are not numbers.
fn ulp(a: f64, b: f64) -> u64 {
    if a.is_nan() && b.is_nan() || a == b {
        return 0;
    }
    let ordered = |x: f64| {
        let bits = x.to_bits().cast_signed();
        if bits < 0 { i64::MIN - bits } else { bits }
    };
    if a.is_nan() != b.is_nan() { u64::MAX } else { ordered(a).abs_diff(ordered(b)) }
}

/// Every function of a number at `x` (and `y` where it takes two).
#[inline(always)]
fn all_functions<T: Real>(x: T, y: T) -> [T; 14] {
    let (sine, cosine) = x.sin_cos();
    [
        sine,
        cosine,
        x.atan2(y),
        x.exp(),
        x.ln(),
        x.abs(),
        x.sqrt(),
        x.floor(),
        x.min(y),
        x.max(y),
        x.flush(),
        T::select(x.lt(y), x, y.zero()),
        -x,
        x.tabulated(|x| (3.0 * x, 3.0)),
    ]
}

/// The functions in eight lanes.
#[inline(always)]
fn lanes<S: Simd>(simd: S, x: &[f64; LANES], y: &[f64; LANES]) -> [[f64; LANES]; 14] {
    all_functions::<Lanes<S>>(f64x8::simd_from(simd, *x), f64x8::simd_from(simd, *y)).map(Into::into)
}

/// Sine, then cosine.
const SINE: usize = 0;
const ARCTANGENT: usize = 2;
const EXPONENTIAL: usize = 3;
const LOGARITHM: usize = 4;
/// The functions from here on are exact.
const EXACT: usize = 5;

/// The functions in lanes of an instruction set. One copy for all who compare: there are five sets.
#[inline(never)]
fn results(level: Level, x: &[f64; LANES], y: &[f64; LANES]) -> [[f64; LANES]; 14] {
    dispatch!(level, simd => lanes(simd, x, y))
}

/// Calls `check(level, x, y, lanes' result, f64's result)` per instruction set, lane and function.
fn compare(
    functions: std::ops::Range<usize>,
    x: &[f64; LANES],
    y: &[f64; LANES],
    mut check: impl FnMut(&str, usize, [f64; 4]),
) {
    for (name, level) in available_levels() {
        let results = results(level, x, y);
        for function in functions.clone() {
            for lane in 0..LANES {
                let expected = all_functions(x[lane], y[lane])[function];
                check(name, function, [x[lane], y[lane], results[function][lane], expected]);
            }
        }
    }
}

/// Asserts agreement within 2 units in the last place.
fn within_two_ulp(functions: std::ops::Range<usize>, x: &[f64; LANES], y: &[f64; LANES]) {
    compare(functions, x, y, |level, function, [x, y, found, expected]| {
        assert!(
            ulp(found, expected) <= 2,
            "{level}, function {function} at ({x:e}, {y:e}): {found:e} against {expected:e}"
        );
    });
}

/// A number of any sign and of a magnitude of 10 to the power `exponents`.
fn wide(exponents: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    (exponents, any::<bool>()).prop_map(|(e, negative)| 10_f64.powf(e) * if negative { -1.0 } else { 1.0 })
}

properties! {
    #![cases(2000)]

    // The specified accuracy: 2 units in the last place.
    #[test]
    fn scalar_elementary_functions_within_two_ulp(
        angle in uniform8(-1e5..1e5),
        small in uniform8(wide(-300.0..1.0)),
        power in uniform8(-708.0..709.0),
        x in uniform8(wide(-100.0..100.0)),
        y in uniform8(-2.0..2.0),
    ) {
        within_two_ulp(SINE..ARCTANGENT, &angle, &y);
        within_two_ulp(SINE..ARCTANGENT, &small, &y);
        within_two_ulp(ARCTANGENT..EXPONENTIAL, &angle, &y);
        within_two_ulp(ARCTANGENT..EXPONENTIAL, &y, &angle);
        within_two_ulp(ARCTANGENT..EXPONENTIAL, &x, &y);
        within_two_ulp(ARCTANGENT..EXPONENTIAL, &y, &small);
        let mut other = y;
        other.reverse();
        within_two_ulp(ARCTANGENT..EXPONENTIAL, &y, &other);
        within_two_ulp(EXPONENTIAL..LOGARITHM, &power, &y);
        within_two_ulp(EXPONENTIAL..LOGARITHM, &small, &y);
        within_two_ulp(EXPONENTIAL..LOGARITHM, &y, &y);
        within_two_ulp(LOGARITHM..EXACT, &small.map(f64::abs), &y);
        within_two_ulp(LOGARITHM..EXACT, &x.map(f64::abs), &y);
        within_two_ulp(LOGARITHM..EXACT, &y.map(|y| 1.0 + 0.4 * y), &y);
    }

    #[test]
    fn scalar_simple_operations_are_exact(x in uniform8(wide(-40.0..40.0)), y in uniform8(-1e3..1e3)) {
        for (a, b) in [(&x, &y), (&y, &x)] {
            // One rounding each, prescribed by IEEE 754.
            compare(EXACT..14, a, b, |level, function, [x, y, found, expected]| {
                assert!(ulp(found, expected) == 0, "{level}, function {function} at ({x:e}, {y:e}): {found:e}");
            });
        }
    }
}

#[test]
fn scalar_elementary_functions_near_multiples_of_half_pi() {
    for k in (-63_000..63_000).step_by(8) {
        let near = |k: i32, offset: f64| f64::from(k) * FRAC_PI_2 + offset;
        // Where sine or cosine all but vanishes, the reduction of the argument decides.
        for offset in [0.0, 1e-9, -1e-5, 0.1] {
            let x: [f64; LANES] = std::array::from_fn(|lane| near(k + lane as i32, offset));
            within_two_ulp(SINE..ARCTANGENT, &x, &[0.0; LANES]);
        }
    }
}

#[test]
fn scalar_elementary_functions_at_special_points() {
    let x = [0.0, -0.0, 1.0, -1.0, f64::MIN_POSITIVE, 0.5, PI, f64::NAN];
    let y = [1.0, 1.0, 0.0, 0.0, 1.0, -0.5, -1.0, 1.0];
    within_two_ulp(SINE..LOGARITHM, &x, &y);
    // The logarithm is that of positive normal numbers.
    let positive =
        [1.0, f64::MIN_POSITIVE, f64::MAX, 0.5, PI, 2.0, 1.0 + f64::EPSILON, 1.0 - 0.5 * f64::EPSILON];
    within_two_ulp(LOGARITHM..EXACT, &positive, &y);
    within_two_ulp(
        ARCTANGENT..EXPONENTIAL,
        &[0.0, -0.0, 3.0, -3.0, 0.0, -0.0, 1.0, f64::NAN],
        &[-1.0, -1.0, 3.0, -3.0, 0.0, 0.0, f64::NAN, f64::NAN],
    );
}

#[test]
fn scalar_elementary_functions_of_infinity() {
    let infinite = [f64::INFINITY, f64::NEG_INFINITY];
    let x: [f64; LANES] = std::array::from_fn(|lane| infinite[lane % 2]);
    for y in [[1.0; LANES], x, [f64::NAN; LANES]] {
        for (a, b) in [(&x, &y), (&y, &x)] {
            compare(SINE..EXPONENTIAL, a, b, |level, function, [x, y, found, expected]| {
                // No finite number stands for an infinite argument, unless it is the right one.
                let sound = found.is_nan() || ulp(found, expected) <= 2;
                assert!(sound, "{level}, function {function} at ({x}, {y}): {found}");
            });
        }
    }
    within_two_ulp(EXPONENTIAL..LOGARITHM, &x, &x);
}

#[test]
fn scalar_exponential_ends_where_it_says() {
    let x = [-708.5, -745.0, -1e300, 709.5, 1e300, -708.0, 709.0, 0.0];
    let expected = [0.0, 0.0, 0.0, f64::INFINITY, f64::INFINITY, f64::exp(-708.0), f64::exp(709.0), 1.0];
    compare(EXPONENTIAL..LOGARITHM, &x, &x, |level, _, [at, _, found, _]| {
        let lane = x.iter().position(|x| *x == at).unwrap();
        assert!(ulp(found, expected[lane]) <= 2, "{level} at {at}: {found:e}");
    });
}

properties! {
    #![cases(500)]

    #[test]
    fn scalar_wrapped_angles_agree(angle in uniform8(-1e3..1e3)) {
        for (name, level) in available_levels() {
            let wrapped: [f64; LANES] =
                dispatch!(level, simd => Real::wrap(f64x8::simd_from(simd, angle)).into());
            for lane in 0..LANES {
                let difference: f64 = wrapped[lane] - Real::wrap(angle[lane]);
                // A fused product less: rounding of 1e3 rad; at ±π either side is right.
                let turns = (difference / (2.0 * PI)).round();
                prop_assert!((difference - turns * 2.0 * PI).abs() < 1e-12, "{name} at {}", angle[lane]);
                prop_assert!(wrapped[lane].abs() <= PI + 1e-12);
            }
        }
    }
}
