//! The operations of a dual number: values those of `f64`, partials those of finite differences.

use fearless_simd::{Simd, SimdFrom, dispatch, f64x8};
use proptest::array::{uniform3, uniform8};
use proptest::prelude::*;
use seatrial::number::dual::{Dual, Valued};
use seatrial::number::lanes::{LANES, Lanes, available_levels};
use seatrial::number::real::Real;
use std::f64::consts::{FRAC_PI_2, PI};

pub(super) const OPERATIONS: usize = 31;

/// Every operation of a number at a point.
#[inline(always)]
pub(super) fn all_operations<T: Real>([x, y, z]: [T; 3]) -> [T; OPERATIONS] {
    let (sine, cosine) = x.sin_cos();
    let (mut sum, mut difference, mut product) = (x, x, x);
    sum += y;
    difference -= y;
    product *= y;
    [
        -x,
        x + y,
        x - y,
        x * y,
        x / y,
        x + 2.5,
        x - 2.5,
        x * 2.5,
        x / 2.5,
        sum,
        difference,
        product,
        x.mul_add(y, z),
        x.mul_sub(y, z),
        x.neg_mul_add(y, z),
        x.abs(),
        x.abs().sqrt(),
        x.min(y),
        x.max(y),
        x.floor(),
        sine,
        cosine,
        x.atan2(y),
        x.exp(),
        T::select(x.lt(y), x * z, y * z),
        x.tabulated(|s| (s * s * s, 3.0 * s * s)),
        (x * 4.0).wrap(),
        x.flush(),
        x.splat(7.0),
        x.zero(),
        x * x.abs(),
    ]
}

/// A point with a derivative.
fn seeded<const N: usize>(point: [f64; N], direction: [f64; N]) -> [Dual<f64>; N] {
    std::array::from_fn(|i| Dual { value: point[i], partials: direction[i] })
}

/// The derivative of every operation at a point along a direction, by the five-point difference quotient.
fn quotient(point: [f64; 3], direction: [f64; 3]) -> [f64; OPERATIONS] {
    let step = 2e-4;
    let at = |k: f64| all_operations(std::array::from_fn(|i| point[i] + k * step * direction[i]));
    let [far_back, back, ahead, far_ahead] = [-2.0, -1.0, 1.0, 2.0].map(at);
    std::array::from_fn(|f| (far_back[f] - far_ahead[f] + 8.0 * (ahead[f] - back[f])) / (12.0 * step))
}

/// Numbers of either sign and a magnitude of 0.3 to 2.9: away from the points without derivative.
fn moderate() -> impl Strategy<Value = f64> {
    (0.3..2.9, any::<bool>()).prop_map(|(x, negative): (f64, bool)| if negative { -x } else { x })
}

/// Whether x − y, x's distance to integers and that of 4x to odd multiples of π let the step pass.
fn smooth([x, y, _]: [f64; 3]) -> bool {
    (x - y).abs() > 2e-3 && (x - x.round()).abs() > 1e-3 && (PI - (4.0 * x).wrap().abs()) > 1e-2
}

/// Any number: of any sign and magnitude, also denormal ones and both zeros.
fn any_number() -> impl Strategy<Value = f64> {
    use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    prop_oneof![-3.0..3.0, POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO]
}

/// The derivative of every operation in lanes, each with its own direction.
#[inline(always)]
fn lanes<S: Simd>(simd: S, point: [f64; 3], directions: &[[f64; LANES]; 3]) -> [[f64; LANES]; OPERATIONS] {
    let numbers: [Dual<Lanes<S>>; 3] =
        std::array::from_fn(|i| Dual { value: point[i], partials: f64x8::simd_from(simd, directions[i]) });
    all_operations(numbers).map(|result| result.partials.into())
}

properties! {
    #![cases(1000)]

    #[test]
    fn scalar_dual_partials_are_finite_differences(
        point in uniform3(moderate()),
        direction in uniform3(-1.0..1.0_f64),
    ) {
        prop_assume!(smooth(point));
        let found = all_operations(seeded(point, direction));
        let expected = quotient(point, direction);
        for f in 0..OPERATIONS {
            // Step⁴/30 = 5e-17 times a fifth derivative below 2e6 (1/y at 0.3), and rounding 1e-15/step.
            let tolerance = 2e-10 * (1.0 + expected[f].abs());
            prop_assert!(
                (found[f].partials - expected[f]).abs() < tolerance,
                "operation {f}: {} against {}", found[f].partials, expected[f]
            );
        }
    }

    #[test]
    fn scalar_dual_values_are_those_of_f64(point in uniform3(any_number())) {
        let plain = all_operations(point);
        let found = all_operations(seeded(point, [1.0, -2.0, 0.5]));
        for f in 0..OPERATIONS {
            // Bit by bit: the same operation; equal zeros may differ in sign where a number is chosen.
            let same = found[f].value() == plain[f] || found[f].value.is_nan() && plain[f].is_nan();
            prop_assert!(same, "operation {f} at {point:?}: {:e} against {:e}", found[f].value, plain[f]);
        }
    }

    #[test]
    fn scalar_dual_lanes_agree_with_single_partials(
        point in uniform3(moderate()),
        x in uniform8(-1.0..1.0_f64),
        y in uniform8(-1.0..1.0_f64),
        z in uniform8(-1.0..1.0_f64),
    ) {
        for (name, level) in available_levels() {
            let found = dispatch!(level, simd => lanes(simd, point, &[x, y, z]));
            for lane in 0..LANES {
                let alone = all_operations(seeded(point, [x[lane], y[lane], z[lane]]));
                for f in 0..OPERATIONS {
                    // A fused product less; terms up to 30 (x/y² with y = 0.3).
                    let apart = (found[f][lane] - alone[f].partials).abs();
                    prop_assert!(apart < 2e-14, "{name}, operation {f}: {apart:e}");
                }
            }
        }
    }

    #[test]
    fn scalar_dual_angles_have_finite_derivatives_everywhere(
        y in any_number(),
        x in any_number(),
        direction in uniform3(-1.0..1.0_f64),
    ) {
        // The slope of an angle is 1/distance: numbers that overflow it have no finite derivative.
        prop_assume!(x.abs().max(y.abs()) < 1e150);
        let [y, x, _] = seeded([y, x, 0.0], direction);
        prop_assert!(y.atan2(x).partials.is_finite(), "{y:?} {x:?}");
        prop_assert!(y.abs().sqrt().partials.is_finite(), "{y:?}");
        prop_assert!(y.abs().partials.is_finite(), "{y:?}");
    }
}

#[test]
fn scalar_dual_derivatives_are_zero_where_none_exists() {
    for zero in [0.0, -0.0] {
        let x = Dual { value: zero, partials: 3.0 };
        let y = Dual { value: zero, partials: -2.0 };
        for result in [x.abs(), x.sqrt(), x.atan2(y), x * x.abs(), x.floor(), x.zero()] {
            assert_eq!(result.partials, 0.0);
        }
    }
    // The angle at the origin has no derivative, on the axes it has.
    let (right, up) = (Dual { value: 2.0, partials: 0.0 }, Dual { value: 0.0, partials: 1.0 });
    let angle = up.atan2(right);
    assert_eq!((angle.value, angle.partials), (0.0, 0.5));
    let angle = right.atan2(up);
    assert_eq!((angle.value, angle.partials), (FRAC_PI_2, -0.5));
}

#[test]
fn scalar_dual_flush_treats_value_and_partials_by_themselves() {
    let kept = |value: f64, partials: f64| {
        let flushed = Dual { value, partials }.flush();
        (flushed.value, flushed.partials)
    };
    // A vehicle at rest: no value, and a derivative.
    assert_eq!(kept(0.0, 2.0), (0.0, 2.0));
    assert_eq!(kept(1e-31, 2.0), (0.0, 2.0));
    assert_eq!(kept(2.0, 1e-31), (2.0, 0.0));
    assert_eq!(kept(-1e-31, -1e-31), (0.0, 0.0));
}

#[test]
fn scalar_dual_numbers_are_equal_only_with_their_partials() {
    let number = |value, partials| Dual { value, partials };
    assert!(number(1.0, 2.0).equals(number(1.0, 2.0)));
    assert!(!number(1.0, 2.0).equals(number(1.0, 3.0)));
    assert!(!number(1.0, 2.0).equals(number(1.5, 2.0)));
    // A choice follows the values alone: the first of two equal ones.
    assert_eq!(number(1.0, 2.0).min(number(1.0, 3.0)).partials, 2.0);
    assert_eq!(number(1.0, 2.0).max(number(1.0, 3.0)).partials, 2.0);
}
