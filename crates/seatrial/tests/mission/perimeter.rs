//! Rounds about a fish farm.

use crate::mission::{mission, places, read};
use proptest::collection::vec;
use proptest::prelude::*;
use seatrial::mission::farm::{Farm, Round};
use seatrial::mission::plane::{Place, cross, difference, distance, towards};
use seatrial::mission::{Task, Waypoint};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Rounding of coordinates of up to a kilometre.
const ROUNDING: f64 = 1e-9;

/// Corners on an ellipse about `centre`, with these gaps between their angles: convex, clockwise.
fn on_ellipse(centre: Place, [a, b]: [f64; 2], gaps: &[f64]) -> Vec<Place> {
    let whole: f64 = gaps.iter().sum();
    let angles = (0..gaps.len()).map(|i| TAU * gaps[..i].iter().sum::<f64>() / whole);
    angles.map(|x| [centre[0] + a * x.cos(), centre[1] + b * x.sin()]).collect()
}

prop_compose! {
    fn farm()(
        circle: bool, centre in [-300.0..300.0_f64, -300.0..300.0], axes in [5.0..60.0_f64, 5.0..60.0],
        gaps in vec(0.3..1.0_f64, 3..9), reversed: bool,
    ) -> Farm {
        if circle {
            return Farm::Circle { centre, radius: axes[0] };
        }
        let mut corners = on_ellipse(centre, axes, &gaps);
        if reversed {
            corners.reverse();
        }
        Farm::polygon(&corners).expect("corners on an ellipse are convex")
    }
}

prop_compose! {
    fn round()(
        distance in 0.5..20.0_f64, tolerance in 0.05..1.0_f64, bearing in -PI..PI, starboard: bool, stops in 0..9_u32,
    ) -> Round {
        Round { distance, tolerance, bearing, side: if starboard { 1.0 } else { -1.0 }, stops }
    }
}

/// The chords of a round.
fn chords(points: &[Place]) -> Vec<[Place; 2]> {
    (0..points.len()).map(|i| [points[i], points[(i + 1) % points.len()]]).collect()
}

/// Distance of a place from a convex farm, apart from the code under test: the largest distance from its tangents, those
/// of the sides and 720 others.
fn distance_by_tangents(farm: &Farm, place: Place) -> f64 {
    let mut bearings: Vec<f64> = (0..720).map(|i| TAU * f64::from(i) / 720.0).collect();
    let along = |normal: Place, p: Place| normal[0] * p[0] + normal[1] * p[1];
    if let Farm::Polygon(corners) = farm {
        let sides = chords(corners).into_iter().map(|[a, b]| difference(a, b));
        bearings.extend(sides.map(|d| d[1].atan2(d[0]) - FRAC_PI_2));
    }
    let behind = |normal: Place| match farm {
        Farm::Circle { centre, radius } => along(normal, *centre) + radius,
        Farm::Polygon(corners) => corners.iter().map(|c| along(normal, *c)).fold(f64::NEG_INFINITY, f64::max),
    };
    let normals = bearings.iter().map(|bearing| towards([0.0; 2], *bearing, 1.0));
    normals.map(|normal| along(normal, place) - behind(normal)).fold(f64::NEG_INFINITY, f64::max)
}

properties! {
    #![cases(256)]

    #[test]
    fn law_perimeter_keeps_the_distance_on_every_chord(farm in farm(), round in round()) {
        let points: Vec<Place> = farm.round(&round, 10_000).expect("few").iter().map(|p| p.place).collect();
        for [a, b] in chords(&points) {
            prop_assert!(farm.distance(a, b) >= round.distance - ROUNDING);
            for i in 0..=4 {
                let place = [a[0] + f64::from(i) / 4.0 * (b[0] - a[0]), a[1] + f64::from(i) / 4.0 * (b[1] - a[1])];
                // Half a degree between the tangents takes at most 1 − cos 0.25° of 81 m.
                prop_assert!(distance_by_tangents(&farm, place) >= round.distance - 81.0 * 1e-5);
            }
        }
    }

    #[test]
    fn law_perimeter_is_nowhere_farther_than_the_tolerance(farm in farm(), round in round()) {
        for point in farm.round(&round, 10_000).expect("few") {
            // Convex: the corners are the farthest places of the chords.
            prop_assert!(farm.distance(point.place, point.place) <= round.distance + round.tolerance + ROUNDING);
        }
    }

    #[test]
    fn law_perimeter_goes_round_once_to_its_side(farm in farm(), round in round()) {
        let points: Vec<Place> = farm.round(&round, 10_000).expect("few").iter().map(|p| p.place).collect();
        let centre = farm.centre();
        let mut turned = 0.0;
        for [a, b] in chords(&points) {
            let (from, to) = (difference(centre, a), difference(centre, b));
            let turn = cross(from, to).atan2(from[0] * to[0] + from[1] * to[1]);
            prop_assert!(turn * round.side > 0.0);
            turned += turn;
        }
        prop_assert!((turned - round.side * TAU).abs() < ROUNDING);
    }

    #[test]
    fn law_perimeter_begins_at_its_bearing(farm in farm(), round in round()) {
        let first = farm.round(&round, 10_000).expect("few")[0];
        let ray = towards([0.0; 2], round.bearing, 1.0);
        let d = difference(farm.centre(), first.place);
        // A corner of the way within the tolerance is taken instead.
        prop_assert!(cross(ray, d).abs() <= round.tolerance + ROUNDING);
        prop_assert!(ray[0] * d[0] + ray[1] * d[1] > 0.0);
    }

    #[test]
    fn law_perimeter_stops_are_equally_spaced_and_counted(farm in farm(), round in round()) {
        let points = farm.round(&round, 10_000).expect("few");
        let ends: Vec<Place> = points.iter().map(|p| p.place).collect();
        let length: f64 = chords(&ends).iter().map(|[a, b]| distance(*a, *b)).sum();
        prop_assume!(round.stops == 0 || length / f64::from(round.stops) > 2.0 * round.tolerance);
        let mut behind = 0.0;
        let mut stops = Vec::new();
        for (i, [a, b]) in chords(&ends).into_iter().enumerate() {
            stops.extend(points[i].stop.map(|stop| (stop, behind)));
            behind += distance(a, b);
        }
        prop_assert_eq!(stops.iter().map(|s| s.0).collect::<Vec<_>>(), (1..=round.stops as usize).collect::<Vec<_>>());
        for (stop, behind) in stops {
            let wanted = length * (stop - 1) as f64 / f64::from(round.stops);
            // On a corner of the way where one is within the tolerance; a circle has corners where its stops are.
            let slack = if matches!(farm, Farm::Circle { .. }) { 0.0 } else { round.tolerance };
            prop_assert!((behind - wanted).abs() <= slack + ROUNDING, "stop {stop} at {behind}, not {wanted}");
        }
    }

    #[test]
    fn law_farm_refuses_a_dent(
        gaps in vec(0.3..1.0_f64, 4..9), axes in [5.0..60.0_f64, 5.0..60.0], which in 0..9_usize, depth in 0.05..0.9_f64,
        reversed in any::<bool>(),
    ) {
        let mut corners = on_ellipse([0.0; 2], axes, &gaps);
        if reversed {
            corners.reverse();
        }
        let n = corners.len();
        let k = which % n;
        // A corner pushed through the line of its neighbours towards the middle of the others, which lies beyond.
        let line = [0, 1].map(|i| 0.5 * (corners[(k + n - 1) % n][i] + corners[(k + 1) % n][i]));
        let others = [0, 1].map(|i| (0..n).filter(|j| *j != k).map(|j| corners[j][i]).sum::<f64>() / (n - 1) as f64);
        corners[k] = [0, 1].map(|i| line[i] + depth * (others[i] - line[i]));
        let refused = Farm::polygon(&corners);
        prop_assert!(refused.is_err_and(|m| m.contains("turns inwards")));
    }
}

const CAGE: &str = "[start]\neast_m = -20\n[[legs]]\nkind = 'perimeter'\nnorth_m = 0\neast_m = 60\nradius_m = 25\ndistance_m = 5\n\
                    start_bearing_deg = 270\nstops = 4\nstop_s = 30\n";

fn stops(waypoints: &[Waypoint]) -> Vec<&Waypoint> {
    waypoints.iter().filter(|w| matches!(w.task, Task::Hold { .. })).collect()
}

#[test]
fn law_perimeter_of_a_file_stops_at_every_depth_and_closes_the_last_round() {
    let m = mission(&format!("{CAGE}depths_m = [5, 7.5]"));
    let stops = stops(&m.waypoints);
    let labels: Vec<&str> = stops.iter().map(|w| w.label.as_str()).collect();
    let at = |depth: &'static str| (1..=4).map(move |i| format!("farm stop {i} at {depth} m"));
    assert_eq!(labels, at("5").chain(at("7.5")).collect::<Vec<_>>());
    // Stops keep their round's depth; from west over north, the farm to starboard.
    for (i, stop) in stops.iter().enumerate() {
        assert_eq!(stop.position[2], if i < 4 { 5.0 } else { 7.5 });
        assert_eq!(stop.task, Task::Hold { seconds: 30.0, heading: None });
    }
    let bearing = |w: &Waypoint| (w.position[1] - 60.0).atan2(w.position[0]).to_degrees();
    for (stop, wanted) in stops.iter().zip([-90.0, 0.0, 90.0, 180.0]) {
        assert!(((bearing(stop) - wanted + 180.0).rem_euclid(360.0) - 180.0).abs() < 1e-9);
    }
    let (first, last) = (&m.waypoints[0], &m.waypoints[m.waypoints.len() - 1]);
    assert_eq!(first.position[..2], last.position[..2]);
    assert_eq!((last.position[2], last.label.as_str(), last.task), (7.5, "farm round 2 closed", Task::Pass));
    // It sinks after the last stop of the first round only, and never climbs.
    let depths: Vec<f64> = m.waypoints.iter().map(|w| w.position[2]).collect();
    assert!(depths.windows(2).all(|pair| pair[1] >= pair[0]));
    let sinking = m.slopes()[1..].iter().filter(|s| **s < 0.0).count();
    let between = depths.iter().filter(|d| **d > 5.0 && **d < 7.5).count();
    assert_eq!(sinking, between + 1);
    assert!(between > 0, "the way down is shared by several chords");
}

#[test]
fn law_perimeter_without_depths_keeps_the_altitude_before() {
    let before = "[[legs]]\nnorth_m = 0\neast_m = -10\naltitude_m = 4\n";
    let legs = CAGE.replace("[[legs]]", &format!("{before}[[legs]]"));
    let m = mission(&legs);
    assert!(m.waypoints.iter().all(|w| w.position[2] == 4.0 && w.vertical == m.waypoints[0].vertical));
    assert_eq!(stops(&m.waypoints)[0].label, "farm stop 1 at 4 m above the bottom");
}

#[test]
fn law_perimeter_of_a_square_mitres_and_rounds_by_the_tolerance() {
    let legs = |tolerance: f64| {
        format!(
            "[start]\nnorth_m = -40\n[[legs]]\nkind = 'perimeter'\ncorners_m = [[0, 0], [0, 10], [10, 10], [10, 0]]\ndistance_m = 5\nstart_bearing_deg = 180\ntolerance_m = {tolerance}"
        )
    };
    // A mitre of a right angle stands 5 (√2 − 1) = 2.07 m off; a tolerance above that keeps four corners.
    let mitred = places(&mission(&legs(2.1)).waypoints);
    for corner in [[-5.0, -5.0], [15.0, -5.0], [15.0, 15.0], [-5.0, 15.0]] {
        assert!(mitred.iter().any(|p| distance(*p, corner) < ROUNDING), "{corner:?} in {mitred:?}");
    }
    // Within 0.25 m a right angle takes three corners: 5/cos(15°) − 5 = 0.18 m, two would be 0.41 m.
    let rounded = places(&mission(&legs(0.25)).waypoints);
    // Beginning, its closing, and where a change of depth may begin.
    assert_eq!((mitred.len(), rounded.len()), (4 + 3, 12 + 3));
}

#[test]
fn law_farm_keeps_other_legs_away() {
    let through = format!("{CAGE}[[legs]]\nnorth_m = 0\neast_m = 120\nlabel = 'home'");
    let message = read(&through).expect_err("the way home leads through the cage");
    assert!(
        message.contains("leg 2: \"home\": distance_m: expected to stay 5 m from the farm of leg 1"),
        "{message}"
    );
    assert!(read(&format!("{CAGE}[[legs]]\nnorth_m = 0\neast_m = -20\n")).is_ok());
}
