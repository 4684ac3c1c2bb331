//! The operations of a jet: in every lane and by every unknown those of a dual number.

use super::dual::{OPERATIONS, all_operations};
use fearless_simd::{Simd, SimdFrom, dispatch, f64x8};
use seatrial::number::dual::Dual;
use seatrial::number::jet::Jet;
use seatrial::number::lanes::{LANES, available_levels};
use seatrial::number::real::Real;

/// The point of a lane, away from where a derivative does not exist, and its direction by an unknown.
fn point(lane: usize, i: usize) -> f64 {
    let x = lane as f64;
    [[0.7 + 0.3 * x, -1.1 - 0.2 * x, 0.4 + 0.1 * x], [-2.3 + 0.11 * x, 0.9 + 0.05 * x, 1.7 - 0.3 * x]]
        [lane % 2][i]
}

fn direction(lane: usize, i: usize, unknown: usize) -> f64 {
    0.3 * (lane + 1) as f64 - 0.7 * i as f64 + 0.45 * unknown as f64
}

/// Values and derivatives by two unknowns of every operation, in lanes.
#[inline(always)]
fn lanes<S: Simd>(simd: S) -> [[[f64; LANES]; 3]; OPERATIONS] {
    let of = |read: &dyn Fn(usize) -> f64| f64x8::simd_from(simd, std::array::from_fn::<f64, LANES, _>(read));
    let numbers: [_; 3] = std::array::from_fn(|i| Jet {
        value: of(&|lane| point(lane, i)),
        slopes: [0, 1].map(|unknown| of(&|lane| direction(lane, i, unknown))),
    });
    all_operations(numbers).map(|found| [found.value.into(), found.slopes[0].into(), found.slopes[1].into()])
}

#[test]
fn scalar_jets_are_dual_numbers_lane_by_lane() {
    for (name, level) in available_levels() {
        let found = dispatch!(level, simd => lanes(simd));
        for lane in 0..LANES {
            for unknown in 0..2 {
                let alone = all_operations(std::array::from_fn(|i| Dual {
                    value: point(lane, i),
                    partials: direction(lane, i, unknown),
                }));
                for f in 0..OPERATIONS {
                    // A fused product less; terms up to 30.
                    let apart =
                        [found[f][0][lane] - alone[f].value, found[f][1 + unknown][lane] - alone[f].partials];
                    let close = apart.iter().all(|x| x.abs() < 5e-14);
                    assert!(close, "{name}, lane {lane}, operation {f}: {apart:?}");
                }
            }
        }
    }
}

#[test]
fn scalar_jets_have_no_slope_where_none_exists() {
    let x = Jet { value: 0.0, slopes: [3.0, 0.5] };
    let y = Jet { value: 0.0, slopes: [-2.0, 1.0] };
    for result in [x.abs(), x.sqrt(), x.atan2(y), x * x.abs(), x.floor(), x.zero()] {
        assert_eq!(result.slopes, [0.0; 2]);
    }
    assert!(x.equals(x) && !x.equals(y));
}

#[test]
fn scalar_jets_of_the_past_are_those_of_dual_numbers() {
    let ring: Vec<[f64; 2]> = (0..8).map(|k| [f64::from(k * k), 0.3 * f64::from(k)]).collect();
    let dual: Vec<_> = ring.iter().map(|&[value, partials]| Dual { value, partials }).collect();
    let jets: Vec<_> = ring.iter().map(|&[value, slope]| Jet { value, slopes: [slope] }).collect();
    for (newest, back) in [(7, 0.0), (9, 2.25), (12, 6.5)] {
        let expected = Dual { value: back, partials: 0.7 }.before(&dual, newest);
        let found = Jet { value: back, slopes: [0.7] }.before(&jets, newest);
        assert!((found.value - expected.value).abs() < 1e-12);
        assert!((found.slopes[0] - expected.partials).abs() < 1e-12, "{newest} {back}");
    }
}
