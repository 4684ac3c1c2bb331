//! Straight paths in all quadrants.

use crate::guidance::vessel::{Kind, Vessel, fly, guidance, largest, pass, start, table};
use proptest::prelude::*;
use seatrial::control::guidance::{Desired, Fix, Guidance, GuidanceTable, Method};
use seatrial::number::real::Real;
use std::f64::consts::PI;

/// A table whose limits do not bind within one step.
fn unlimited(method: Method) -> GuidanceTable {
    GuidanceTable {
        pitch_max_deg: 85.0,
        turn_rate_max_deg_s: 1e6,
        pitch_rate_max_deg_s: 1e6,
        depth_rate_max_m_s: 1e6,
        ..table(method)
    }
}

fn at(position: [f64; 3]) -> Fix<f64> {
    Fix { position, altitude: f64::NAN, attitude: [0.0; 3], velocity: [0.0; 3] }
}

/// A leg by its course, slope and horizontal length from a point, and its end.
fn end(from: [f64; 3], course: f64, slope: f64, length: f64) -> [f64; 3] {
    [from[0] + length * course.cos(), from[1] + length * course.sin(), from[2] - length * slope.tan()]
}

fn first(guidance: &Guidance<f64>, from: [f64; 3], to: [f64; 3], position: [f64; 3]) -> Desired<f64> {
    let waypoints = [pass(to)];
    let mut progress = guidance.begin(&start(from), &waypoints);
    guidance.step(&waypoints, &mut progress, &at(position), 0.1)
}

properties! {
    #![cases(512)]

    #[test]
    fn law_errors_are_those_of_a_point_put_beside_the_path(
        course in -PI..PI,
        slope in -1.2..1.2_f64,
        (y, z) in (-30.0..30.0_f64, -10.0..10.0_f64),
        (north, east) in (-500.0..500.0_f64, -500.0..500.0_f64),
    ) {
        let from = [north, east, 50.0];
        let to = end(from, course, slope, 100.0);
        let middle = end(from, course, slope, 50.0);
        let position = [
            middle[0] - y * course.sin() + z * slope.sin() * course.cos(),
            middle[1] + y * course.cos() + z * slope.sin() * course.sin(),
            middle[2] + z * slope.cos(),
        ];
        let table = unlimited(Method::Lookahead);
        let desired = first(&guidance(&table, Kind::Torpedo), from, to, position);
        // Rounding of positions of 600 m, in steep legs times their tangent of 2.6.
        prop_assert!((desired.cross_track - y).abs() < 1e-10);
        prop_assert!((desired.vertical_error - z).abs() < 1e-10);
        let heading = course - (y / table.lookahead_m).atan();
        prop_assert!(Real::wrap(desired.heading - heading).abs() < 1e-11);
        let pitch = (slope + (z / table.lookahead_vertical_m).atan()).clamp(-85_f64.to_radians(), 85_f64.to_radians());
        prop_assert!((desired.pitch - pitch).abs() < 1e-10);
        // A point to starboard asks for port, a point below for up.
        prop_assert!(y * Real::wrap(desired.heading - course) <= 0.0);
        let depth = to[2] + (50.0 - z * slope.sin()) * slope.tan();
        prop_assert!((desired.depth - depth).abs() < 1e-9);
    }

    #[test]
    fn law_pursuit_points_at_the_waypoint_from_everywhere(
        (north, east, down) in (-100.0..100.0_f64, -100.0..100.0_f64, -40.0..40.0_f64),
    ) {
        let distance = (north * north + east * east + down * down).sqrt();
        prop_assume!(distance > 3.1 && down.abs() < 0.99 * distance);
        let (from, to) = ([300.0, -200.0, 50.0], [300.0 + north, east - 200.0, 50.0 + down]);
        let desired = first(&guidance(&unlimited(Method::Pursuit), Kind::Torpedo), from, to, from);
        let (theta, psi) = (desired.pitch, desired.heading);
        let line = [theta.cos() * psi.cos(), theta.cos() * psi.sin(), -theta.sin()];
        // Rounding of positions of 400 m.
        prop_assert!((line[0] * distance - north).abs() < 1e-10);
        prop_assert!((line[1] * distance - east).abs() < 1e-10);
        prop_assert!((line[2] * distance - down).abs() < 1e-10);
    }

    #[test]
    fn law_depth_of_the_path_stays_between_its_ends(course in -PI..PI, along in -200.0..300.0_f64, dive in -8.0..8.0_f64) {
        let from = [0.0, 0.0, 20.0];
        let to = end(from, course, -(dive / 100.0).atan(), 100.0);
        let position = end([0.0, 0.0, 20.0], course, 0.0, along);
        let desired = first(&guidance(&unlimited(Method::Lookahead), Kind::Hover), from, to, position);
        let expected = 20.0 + dive * (along / 100.0).clamp(0.0, 1.0);
        // Within the sphere the leg is over.
        prop_assume!((along - 100.0).abs() > 3.1);
        // Rounding of 300 m.
        prop_assert!((desired.depth - expected).abs() < 1e-10);
    }
}

properties! {
    #![cases(48)]

    #[test]
    fn law_integral_reaches_the_line_in_every_quadrant_slope_and_current(
        course in -PI..PI,
        slope in -0.2..0.2_f64,
        set in -PI..PI,
        (drift, upwelling) in (0.0..0.4_f64, -0.05..0.05_f64),
        turned in -3.0..3.0_f64,
    ) {
        let from = [0.0, 0.0, 200.0];
        let waypoints = [pass(end(from, course, slope, 700.0))];
        let vessel = Vessel::new(Kind::Torpedo, course + turned, 1.5)
            .at(from)
            .in_current([drift * set.cos(), drift * set.sin(), upwelling]);
        let (flight, _) = fly(&guidance(&table(Method::Integral), Kind::Torpedo), &waypoints, vessel, 300.0);
        // The steady state is zero; 300 s are more than ten times Δ/U = 7 s and Δ_z/√(U κ_z) = 21 s.
        for point in &flight[flight.len() - 200..] {
            prop_assert!(point.desired.cross_track.abs() < 0.1, "{}", point.desired.cross_track);
            prop_assert!(point.desired.vertical_error.abs() < 0.1, "{}", point.desired.vertical_error);
        }
    }
}

/// 1.5 m/s along a course, 0.3 m/s from port: the largest and the last cross-track error of 400 m.
fn across(method: Method, course: f64) -> (f64, f64) {
    let from = [0.0, 0.0, 10.0];
    let waypoints = [pass(end(from, course, 0.0, 400.0))];
    let current = [-0.3 * course.sin(), 0.3 * course.cos(), 0.0];
    let vessel = Vessel::new(Kind::Torpedo, course, 1.5).at(from).in_current(current);
    let (flight, _) = fly(&guidance(&table(method), Kind::Torpedo), &waypoints, vessel, 240.0);
    let before: Vec<f64> =
        flight.iter().filter(|p| p.desired.done == 0.0).map(|p| p.desired.cross_track).collect();
    (largest(before.iter().copied()), before[before.len() - 1])
}

#[test]
fn law_pursuit_leaves_the_line_in_a_current() {
    // The curve of pursuit bulges by about a third of V/U times the distance: 27 m of 400 m.
    let (off, _) = across(Method::Pursuit, 2.0);
    assert!((15.0..40.0).contains(&off), "{off}");
}

#[test]
fn law_lookahead_keeps_the_offset_of_the_crab_angle() {
    // Steady: sin(crab) = V/U through the water, and the errors' angle is the crab angle.
    let expected = 10.0 * (0.3_f64 / 1.5).asin().tan();
    for course in [0.3, 1.9, -2.9, -1.2] {
        let (_, last) = across(Method::Lookahead, course);
        // 240 s are 35 times Δ/U.
        assert!((last - expected).abs() < 1e-3, "{last} against {expected}");
    }
}

#[test]
fn law_integral_takes_the_offset_away() {
    let (off, last) = across(Method::Integral, -2.9);
    assert!(last.abs() < 0.01 && off < 2.0, "{off}, {last}");
}

#[test]
fn law_turns_go_the_shorter_way_across_south() {
    // Course 170°, heading −170°: 20° to port across the seam.
    let course = 170_f64.to_radians();
    let waypoints = [pass(end([0.0, 0.0, 10.0], course, 0.0, 200.0))];
    let vessel = Vessel::new(Kind::Torpedo, -course, 1.5);
    let (flight, _) = fly(&guidance(&table(Method::Lookahead), Kind::Torpedo), &waypoints, vessel, 60.0);
    let off = largest(flight.iter().map(|p| Real::wrap(p.vessel.yaw - PI).abs()));
    // Never farther from south than it was and than the course is, by more than the 6° of the overshoot to the path.
    assert!(off < 16_f64.to_radians(), "{off}");
    assert!(Real::wrap(flight[flight.len() - 1].vessel.yaw - course).abs() < 0.01);
}

/// On a slower leg the lookahead distance shrinks in proportion to the speed, to a half at the least.
#[test]
fn law_lookahead_shrinks_on_slow_legs() {
    for (speed, share) in [(0.2, 0.5), (1.0, 0.5), (1.5, 0.75), (2.0, 1.0), (3.0, 1.0)] {
        let table = GuidanceTable { lookahead_speed_m_s: 2.0, ..unlimited(Method::Lookahead) };
        let guidance = guidance(&table, Kind::Torpedo);
        let waypoints = [seatrial::mission::Waypoint { speed, ..pass([100.0, 0.0, 0.0]) }];
        let mut progress = guidance.begin(&start([0.0; 3]), &waypoints);
        let desired = guidance.step(&waypoints, &mut progress, &at([50.0, 4.0, 0.0]), 0.1);
        let heading = -(4.0 / (share * table.lookahead_m)).atan();
        assert!((desired.heading - heading).abs() < 1e-12, "{speed} m/s"); // rounding
    }
}
