//! Which waypoint is active.

use crate::guidance::vessel::{DT, Kind, Vessel, fly, guidance, largest, pass, range, start, table};
use proptest::prelude::*;
use seatrial::control::guidance::{Fix, Method, TUNABLE};
use std::f64::consts::PI;

fn at(position: [f64; 3]) -> Fix<f64> {
    Fix { position, altitude: f64::NAN, attitude: [0.0; 3], velocity: [1.5, 0.0, 0.0] }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_switching_at_the_sphere(
        (course, azimuth, elevation) in (-PI..PI, -PI..PI, -1.5..1.5_f64),
        distance in 0.1..10.0_f64,
    ) {
        let end = [50.0 * course.cos(), 50.0 * course.sin(), 20.0];
        let waypoints = [pass(end), pass([1000.0, 0.0, 20.0])];
        let guidance = guidance(&table(Method::Lookahead), Kind::Torpedo);
        let mut progress = guidance.begin(&start([0.0, 0.0, 20.0]), &waypoints);
        let position = [
            end[0] + distance * elevation.cos() * azimuth.cos(),
            end[1] + distance * elevation.cos() * azimuth.sin(),
            end[2] + distance * elevation.sin(),
        ];
        prop_assume!((distance - 3.0).abs() > 1e-9);
        let leg = guidance.step(&waypoints, &mut progress, &at(position), DT).leg;
        // From the first step on it has not been before the plane, so that only the sphere counts.
        prop_assert_eq!(leg, if distance < 3.0 { 1.0 } else { 0.0 });
    }
}

#[test]
fn law_switching_at_the_plane_at_any_distance() {
    let waypoints = [pass([50.0, 0.0, 20.0]), pass([100.0, 0.0, 20.0])];
    let guidance = guidance(&table(Method::Lookahead), Kind::Torpedo);
    let mut progress = guidance.begin(&start([0.0, 0.0, 20.0]), &waypoints);
    for (north, leg) in [(48.0, 0.0), (49.9, 0.0), (50.1, 1.0), (60.0, 1.0)] {
        assert_eq!(
            guidance.step(&waypoints, &mut progress, &at([north, 12.0, 20.0]), DT).leg,
            leg,
            "{north}"
        );
    }
    // 12 m beside and 0.1 m past, or as much before.
    assert!((progress.farthest_miss() - 12.0).abs() < 0.01);
}

#[test]
fn law_switching_not_for_a_vehicle_that_begins_beyond_the_plane() {
    // 40 m past the first waypoint, going away: it turns back to it.
    for method in [Method::Pursuit, Method::Lookahead, Method::Integral] {
        let waypoints = [pass([50.0, 0.0, 10.0]), pass([50.0, 100.0, 10.0])];
        let guidance = guidance(&table(method), Kind::Torpedo);
        let mut vessel = Vessel::new(Kind::Torpedo, 0.0, 1.5).at([90.0, 5.0, 10.0]);
        let mut progress = guidance.begin(&start([0.0, 0.0, 10.0]), &waypoints);
        let flight = crate::guidance::vessel::go_on(&guidance, &waypoints, &mut progress, &mut vessel, 300.0);
        assert!(flight.last().unwrap().desired.done == 1.0);
        assert!(progress.farthest_miss() <= 3.0, "{method:?}: {}", progress.farthest_miss());
    }
}

#[test]
fn law_switching_visits_every_corner_of_a_mission_in_depth() {
    let corners =
        [[80.0, 0.0, 10.0], [80.0, 60.0, 20.0], [0.0, 60.0, 20.0], [0.0, 0.0, 12.0], [100.0, 100.0, 30.0]];
    for kind in [Kind::Torpedo, Kind::Hover, Kind::Sway] {
        for method in [Method::Pursuit, Method::Lookahead, Method::Integral] {
            let vessel = Vessel::new(kind, 0.0, 1.0).in_current([0.1, -0.2, 0.0]);
            let (flight, progress) = fly(&guidance(&table(method), kind), &corners.map(pass), vessel, 500.0);
            assert!(flight.last().unwrap().desired.done == 1.0);
            assert!(progress.farthest_miss() <= 3.0, "{method:?}: {}", progress.farthest_miss());
            let order: Vec<f64> = flight.windows(2).map(|w| w[1].desired.leg - w[0].desired.leg).collect();
            assert!(order.iter().all(|step| *step == 0.0 || *step == 1.0), "one after the other");
        }
    }
}

#[test]
fn law_steep_leg_is_dived_on_the_spot_or_in_a_spiral() {
    // Straight down, and at 70°.
    for north in [0.0, 15.0] {
        let point = [north, 0.0, 50.0];
        let waypoints = [pass(point), pass([north, 100.0, 50.0])];
        for (kind, nearest, farthest) in
            [(Kind::Hover, 0.0, 5.0), (Kind::Sway, 0.0, 3.0), (Kind::Torpedo, 10.0, 30.0)]
        {
            let speed = if kind == Kind::Torpedo { 1.5 } else { 0.0 };
            let vessel = Vessel::new(kind, 0.2, speed).in_current([0.05, 0.1, 0.0]);
            let (flight, progress) =
                fly(&guidance(&table(Method::Integral), kind), &waypoints, vessel, 400.0);
            assert!(progress.farthest_miss() <= 5.0 && flight.last().unwrap().desired.done == 1.0);
            let dive: Vec<f64> = flight
                .iter()
                .filter(|p| p.desired.leg == 0.0 && p.vessel.position[2] > 30.0)
                .map(|p| range(p.vessel.position, point))
                .collect();
            assert!(dive.len() > 100, "it takes its time");
            assert!(largest(dive.iter().copied()) < farthest, "{}", largest(dive));
            assert!(dive.iter().all(|d| *d >= nearest));
            let end = flight.iter().rposition(|p| p.desired.leg == 0.0).unwrap();
            // The depth is reached to R_0 before it goes on.
            assert!((flight[end].vessel.position[2] - 50.0).abs() < 3.1);
        }
    }
}

#[test]
fn law_stop_here_ends_the_mission_at_the_present_place() {
    let waypoints = [[200.0, 0.0, 10.0], [200.0, 100.0, 10.0]].map(pass);
    for (kind, most) in [(Kind::Sway, 0.01), (Kind::Hover, 0.51), (Kind::Torpedo, 21.0)] {
        let guidance = guidance(&table(Method::Integral), kind);
        let mut vessel = Vessel::new(kind, 0.0, 1.5).in_current([0.0, 0.2, 0.0]);
        let mut progress = guidance.begin(&start(vessel.position), &waypoints);
        crate::guidance::vessel::go_on(&guidance, &waypoints, &mut progress, &mut vessel, 40.0);
        let place = vessel.position;
        guidance.stop_here(&mut progress, &vessel.fix(), true);
        let flight = crate::guidance::vessel::go_on(&guidance, &waypoints, &mut progress, &mut vessel, 600.0);
        for p in &flight[5000..] {
            assert!(p.desired.done == 1.0 && range(p.vessel.position, place) < most);
            assert!((p.vessel.position[2] - place[2]).abs() < 0.1);
        }
    }
}

#[test]
fn law_no_waypoints_are_a_complete_mission() {
    let guidance = guidance(&table(Method::Integral), Kind::Sway);
    let (flight, _) = fly(&guidance, &[], Vessel::new(Kind::Sway, 1.0, 0.0), 30.0);
    let last = flight.last().unwrap();
    assert!(last.desired.done == 1.0 && range(last.vessel.position, [0.0; 3]) < 1e-9);
}

#[test]
fn law_pitch_towards_the_surface_is_up_and_limited() {
    let guidance = guidance(&table(Method::Integral), Kind::Torpedo);
    assert_eq!(TUNABLE[4], "pitch_max_deg");
    assert!((guidance.pitch_towards(100.0) - 20_f64.to_radians()).abs() < 1e-12);
    assert!((guidance.pitch_towards(1.0) - (1.0_f64 / 8.0).atan()).abs() < 1e-12);
    assert!(guidance.pitch_towards(-1.0) < 0.0);
}
