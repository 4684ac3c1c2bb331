//! Inside and outside.

use fearless_simd::{Simd, SimdFrom, dispatch, f64x8};
use proptest::collection::vec;
use proptest::prelude::*;
use seatrial::mission::plane::{cross, difference, distance_to_stretch, towards};
use seatrial::mission::{inside, outside};
use seatrial::number::lanes::{LANES, available_levels};
use std::f64::consts::TAU;

/// A star-shaped fence about the origin of the given radii.
fn star(radii: &[f64]) -> Vec<[f64; 2]> {
    let n = radii.len() as f64;
    radii.iter().enumerate().map(|(i, r)| towards([0.0; 2], TAU * i as f64 / n, *r)).collect()
}

/// Turns of the bearing to a point that goes round the fence: the winding number, by angles.
fn winding(fence: &[[f64; 2]], place: [f64; 2]) -> f64 {
    let seen = |i: usize| difference(place, fence[i % fence.len()]);
    let turn = |i: usize| {
        let (a, b) = (seen(i), seen(i + 1));
        cross(a, b).atan2(a[0] * b[0] + a[1] * b[1])
    };
    (0..fence.len()).map(turn).sum::<f64>() / TAU
}

/// Distance of the nearest edge.
fn margin(fence: &[[f64; 2]], place: [f64; 2]) -> f64 {
    let edge = |i: usize| distance_to_stretch(place, fence[i], fence[(i + 1) % fence.len()]);
    (0..fence.len()).map(edge).fold(f64::INFINITY, f64::min)
}

#[inline(always)]
fn lanes<S: Simd>(simd: S, fence: &[[f64; 2]], north: &[f64; LANES], east: &[f64; LANES]) -> [f64; LANES] {
    outside(fence, f64x8::simd_from(simd, *north), f64x8::simd_from(simd, *east)).into()
}

properties! {
    #![cases(256)]

    #[test]
    fn law_fence_agrees_with_the_winding_of_the_bearing(
        radii in vec(1.0..100.0_f64, 3..12), north in -120.0..120.0_f64, east in -120.0..120.0_f64,
    ) {
        let fence = star(&radii);
        // A place on the fence belongs to neither side.
        prop_assume!(margin(&fence, [north, east]) > 1e-9);
        prop_assert_eq!(inside(&fence, [north, east]), winding(&fence, [north, east]).abs() > 0.5);
    }

    #[test]
    fn law_fence_does_not_depend_on_direction_nor_on_the_first_corner(
        radii in vec(1.0..100.0_f64, 3..12), place in [-120.0..120.0_f64, -120.0..120.0], first in 0..12_usize,
    ) {
        let mut fence = star(&radii);
        prop_assume!(margin(&fence, place) > 1e-9);
        let found = inside(&fence, place);
        let count = fence.len();
        fence.rotate_left(first % count);
        prop_assert_eq!(inside(&fence, place), found);
        fence.reverse();
        prop_assert_eq!(inside(&fence, place), found);
    }

    #[test]
    fn scalar_fence_in_lanes_agrees_with_f64(
        radii in vec(1.0..100.0_f64, 3..12),
        north in proptest::array::uniform8(-120.0..120.0_f64), east in proptest::array::uniform8(-120.0..120.0_f64),
    ) {
        let fence = star(&radii);
        for (name, level) in available_levels() {
            let found = dispatch!(level, simd => lanes(simd, &fence, &north, &east));
            for i in 0..LANES {
                // Fused multiply-add moves an edge by rounding.
                if margin(&fence, [north[i], east[i]]) > 1e-9 {
                    prop_assert_eq!(found[i], outside(&fence, north[i], east[i]), "{} lane {}", name, i);
                }
            }
        }
    }
}

#[test]
fn law_fence_corners_level_with_the_place_count_once() {
    // The ray to the east of the middle runs through two corners, or along an edge.
    let diamond = [[0.0, -2.0], [2.0, 0.0], [0.0, 2.0], [-2.0, 0.0]];
    assert!(inside(&diamond, [0.0, 0.0]));
    assert!(!inside(&diamond, [0.0, -3.0]));
    assert!(!inside(&diamond, [2.0, -3.0]));
    assert!(!inside(&diamond, [-2.0, -3.0]));
    for tip in diamond {
        // A micrometre on either side of a corner.
        assert!(inside(&diamond, tip.map(|x| x * (1.0 - 1e-6))));
        assert!(!inside(&diamond, tip.map(|x| x * (1.0 + 1e-6))));
    }
    let notch =
        [[0.0, 0.0], [0.0, 4.0], [4.0, 4.0], [4.0, 3.0], [2.0, 3.0], [2.0, 1.0], [4.0, 1.0], [4.0, 0.0]];
    assert!(inside(&notch, [2.0, 0.5]) && inside(&notch, [2.0, 3.5]));
    assert!(!inside(&notch, [2.0, -1.0]) && !inside(&notch, [3.0, 2.0]));
}

#[test]
fn law_fence_none_is_everywhere_inside_and_no_number_is_outside() {
    assert!(inside(&[], [1e9, -1e9]));
    assert!(!inside(&star(&[10.0; 5]), [f64::NAN, 0.0]));
    assert!(!inside(&star(&[10.0; 5]), [0.0, f64::NAN]));
}
