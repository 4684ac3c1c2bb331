//! Lawnmower and spiral.

use crate::mission::{mission, places};
use proptest::prelude::*;
use seatrial::mission::patterns::{Coil, Rectangle};
use seatrial::mission::plane::{cross, difference, distance, distance_to_stretch, towards};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Rounding of coordinates of up to a kilometre.
const ROUNDING: f64 = 1e-9;

prop_compose! {
    fn rectangle()(
        corner in [-300.0..300.0_f64, -300.0..300.0], bearing in -PI..PI, length in 5.0..300.0_f64,
        width in 2.0..200.0_f64, spacing in 1.0..60.0_f64, starboard: bool, overshoot in 0.0..20.0_f64,
    ) -> Rectangle {
        Rectangle { corner, bearing, length, width, spacing, side: if starboard { 1.0 } else { -1.0 }, overshoot }
    }
}

prop_compose! {
    fn coil()(
        centre in [-300.0..300.0_f64, -300.0..300.0], inner in 0.0..20.0_f64, growth in 1.0..50.0_f64,
        outward: bool, spacing in 0.5..20.0_f64, bearing in -PI..PI, starboard: bool, tolerance in 0.01..1.0_f64,
    ) -> Coil {
        let radii = if outward { [inner, inner + growth] } else { [inner + growth, inner] };
        let side = if starboard { 1.0 } else { -1.0 };
        Coil { centre, radii, turns: growth / spacing, bearing, side, tolerance }
    }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_lawnmower_leaves_no_place_farther_than_half_the_spacing(
        field in rectangle(), along in 0.0..1.0_f64, across in 0.0..1.0_f64,
    ) {
        let foot = towards(field.corner, field.bearing, along * field.length);
        let place = towards(foot, field.bearing + FRAC_PI_2, field.side * across * field.width);
        let near = field.lines().iter().map(|[a, b]| distance_to_stretch(place, *a, *b)).fold(f64::INFINITY, f64::min);
        prop_assert!(near <= 0.5 * field.spacing + ROUNDING, "{near} from the nearest line");
    }

    #[test]
    fn law_lawnmower_lines_are_parallel_in_order_and_flown_to_and_fro(field in rectangle()) {
        let lines = field.lines();
        let gap = field.width / (lines.len() - 1) as f64;
        // As many as the spacing asks for, and not one more.
        prop_assert!(gap <= field.spacing * (1.0 + 1e-8));
        prop_assert!(lines.len() == 2 || field.width / (lines.len() - 2) as f64 > field.spacing * (1.0 - 1e-8));
        let ahead = towards([0.0; 2], field.bearing, 1.0);
        for (i, [begin, end]) in lines.iter().enumerate() {
            let d = difference(*begin, *end);
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            prop_assert!((ahead[0] * d[0] + ahead[1] * d[1] - sign * (field.length + 2.0 * field.overshoot)).abs() < ROUNDING);
            // To starboard of the first line is clockwise of its direction.
            let aside = cross(ahead, difference(field.corner, *begin));
            prop_assert!((aside - field.side * gap * i as f64).abs() < ROUNDING);
        }
        let first = towards(field.corner, field.bearing, -field.overshoot);
        prop_assert!(distance(lines[0][0], first) < ROUNDING);
    }

    #[test]
    fn law_spiral_chords_stay_within_the_tolerance(coil in coil()) {
        let points = coil.points(40_000).expect("few enough points");
        let at = |share: f64| {
            let radius = coil.radii[0] + share * (coil.radii[1] - coil.radii[0]);
            towards(coil.centre, coil.bearing + coil.side * share * coil.turns * TAU, radius)
        };
        for pair in points.windows(2) {
            for i in 0..=8 {
                let share = pair[0].0 + f64::from(i) / 8.0 * (pair[1].0 - pair[0].0);
                let off = distance_to_stretch(at(share), pair[0].1, pair[1].1);
                prop_assert!(off <= coil.tolerance + ROUNDING, "{off} of {}", coil.tolerance);
            }
        }
    }

    #[test]
    fn law_spiral_points_lie_on_it_from_end_to_end(coil in coil()) {
        let points = coil.points(40_000).expect("few enough points");
        prop_assert_eq!((points[0].0, points[points.len() - 1].0), (0.0, 1.0));
        for pair in points.windows(2) {
            let (share, place) = pair[1];
            prop_assert!(share > pair[0].0);
            // Archimedes: the radius grows by the spacing per turn.
            let radius = distance(coil.centre, place);
            let wanted = coil.radii[0] + share * (coil.radii[1] - coil.radii[0]);
            prop_assert!((radius - wanted).abs() < ROUNDING);
            // It goes round to its side wherever the centre is not an end of the chord.
            let area = cross(difference(coil.centre, pair[0].1), difference(coil.centre, place));
            prop_assert!(coil.side * area >= -ROUNDING);
        }
    }

    #[test]
    fn law_spiral_and_its_reverse_have_the_same_chords(coil in coil()) {
        let end = coil.bearing + coil.side * coil.turns * TAU;
        let back = Coil { radii: [coil.radii[1], coil.radii[0]], bearing: end, side: -coil.side, ..coil };
        let (there, back) = (coil.points(40_000).expect("few"), back.points(10_000).expect("few"));
        prop_assert_eq!(there.len(), back.len());
        for (a, b) in there.iter().zip(back.iter().rev()) {
            // Rounding of up to a hundred turns at 70 m.
            prop_assert!(distance(a.1, b.1) < 1e-8);
        }
    }
}

#[test]
fn law_lawnmower_of_a_file_labels_lines_and_ways_between_them() {
    let m = mission(
        "[[legs]]\nkind = 'lawnmower'\nnorth_m = 10\neast_m = 20\nheading_deg = 90\nlength_m = 40\nwidth_m = 35\nspacing_m = 5\ndepth_m = 3\nside = 'port'",
    );
    assert_eq!(m.waypoints.len(), 16);
    let labels: Vec<&str> = m.waypoints.iter().map(|w| w.label.as_str()).collect();
    assert_eq!(labels[..4], ["to lawnmower 1/8", "lawnmower 1/8", "to lawnmower 2/8", "lawnmower 2/8"]);
    let wanted = [[10.0, 20.0], [10.0, 60.0], [15.0, 60.0], [15.0, 20.0], [20.0, 20.0]];
    for (found, wanted) in places(&m.waypoints).iter().zip(wanted) {
        assert!(distance(*found, wanted) < ROUNDING, "{found:?} instead of {wanted:?}");
    }
    assert!(m.waypoints.iter().all(|w| w.position[2] == 3.0));
}

#[test]
fn law_spiral_of_equal_radii_is_a_helix() {
    let m = mission(
        "[[legs]]\nkind = 'spiral'\nnorth_m = 30\neast_m = 0\nstart_radius_m = 8\nend_radius_m = 8\nturns = 2.5\ndepth_m = 2\nend_depth_m = 12\ndirection = 'port'",
    );
    let (first, last) = (&m.waypoints[0], &m.waypoints[m.waypoints.len() - 1]);
    assert_eq!((first.position[2], last.position[2]), (2.0, 12.0));
    // Two and a half turns from north of the centre end south of it.
    assert!(distance([first.position[0], first.position[1]], [38.0, 0.0]) < ROUNDING);
    assert!(distance([last.position[0], last.position[1]], [22.0, 0.0]) < ROUNDING);
    assert!(m.waypoints[1].position[1] < 0.0, "to port of north is west");
    // It sinks in proportion to what it has turned: 10 m in two and a half turns.
    let mut turned = 0.0;
    for pair in m.waypoints.windows(2) {
        let [a, b] = [&pair[0], &pair[1]].map(|w| difference([30.0, 0.0], [w.position[0], w.position[1]]));
        turned -= cross(a, b).atan2(a[0] * b[0] + a[1] * b[1]);
        assert!((pair[1].position[2] - (2.0 + 10.0 * turned / (2.5 * TAU))).abs() < ROUNDING);
    }
}
