//! Station-keeping.

use crate::guidance::vessel::{
    DT, Kind, Point, Vessel, fly, guidance, largest, pass, range, table, waypoint,
};
use proptest::prelude::*;
use seatrial::control::guidance::Method;
use seatrial::mission::Task;
use seatrial::number::real::Real;
use std::f64::consts::PI;

const POINT: [f64; 3] = [60.0, 0.0, 12.0];

fn hold(seconds: f64, heading: Option<f64>) -> Task {
    Task::Hold { seconds, heading }
}

fn keep(vessel: Vessel, task: Task, seconds: f64) -> Vec<Point> {
    fly(&guidance(&table(Method::Integral), vessel.kind), &[waypoint(POINT, task)], vessel, seconds).0
}

/// The last 100 s.
fn settled(flight: &[Point]) -> &[Point] {
    &flight[flight.len() - 1000..]
}

fn off(points: &[Point]) -> f64 {
    largest(points.iter().map(|p| range(p.vessel.position, POINT)))
}

/// How far the heading turns in all, rad.
fn turned(points: &[Point]) -> f64 {
    points.windows(2).map(|w| Real::wrap(w[1].vessel.yaw - w[0].vessel.yaw).abs()).sum()
}

properties! {
    #![cases(32)]

    #[test]
    fn law_hold_with_sway_settles_at_the_heading_asked_for(
        set in -PI..PI, drift in 0.0..0.4_f64, heading in -PI..PI,
    ) {
        let vessel = Vessel::new(Kind::Sway, 0.4, 1.0).in_current([drift * set.cos(), drift * set.sin(), 0.0]);
        let flight = keep(vessel, hold(1e9, Some(heading)), 400.0);
        // Exponential decay at 0.2/s; nothing disturbs.
        prop_assert!(off(settled(&flight)) < 1e-3);
        let yaw = flight[flight.len() - 1].vessel.yaw;
        prop_assert!(Real::wrap(yaw - heading).abs() < 1e-3);
        let last = flight[flight.len() - 1].desired;
        prop_assert!(last.holding == 1.0 && last.done == 0.0 && last.cross_track == 0.0);
    }

    #[test]
    fn law_hold_without_sway_settles_with_the_bow_in_the_current(
        set in -PI..PI, drift in 0.1..0.45_f64, yaw in -PI..PI,
    ) {
        let vessel = Vessel::new(Kind::Hover, yaw, 0.5).in_current([drift * set.cos(), drift * set.sin(), 0.0]);
        let flight = keep(vessel, hold(1e9, None), 700.0);
        let last = settled(&flight);
        // A quarter of the hold radius is the dead zone; the slowest case, 0.1 m/s, has a time constant of
        // 2/(V k_w) = 20 s.
        prop_assert!(off(last) < 0.51, "{}", off(last));
        prop_assert!(turned(last) < 0.1, "{}", turned(last));
        let into = Real::wrap(last[last.len() - 1].vessel.yaw - set - PI);
        prop_assert!(into.abs() < 0.02, "{into}");
    }

    #[test]
    fn law_hold_without_sway_comes_to_rest_in_still_water(yaw in -PI..PI, heading in proptest::option::of(-PI..PI)) {
        let flight = keep(Vessel::new(Kind::Hover, yaw, 0.5), hold(1e9, heading), 600.0);
        let last = settled(&flight);
        // The dead zone of 0.5 m, and 0.05/(1.0 · 0.2) = 0.25 m per radian for the sake of the heading.
        prop_assert!(off(last) < 0.51 + 0.25 * PI, "{}", off(last));
        // What a heading does not reach is paid for by that distance.
        let missed = heading.map_or(0.0, |wish| Real::wrap(last[last.len() - 1].vessel.yaw - wish).abs());
        prop_assert!(0.25 * missed < (off(last) - 0.5).max(0.0) + 0.05, "{missed} at {}", off(last));
        // It creeps to the edge of the dead zone; a spin would turn by 2π and more.
        prop_assert!(turned(last) < 0.5, "{}", turned(last));
    }
}

#[test]
fn law_hold_keeps_the_heading_of_the_arrival() {
    let flight = keep(Vessel::new(Kind::Sway, 0.0, 1.0).in_current([0.0, 0.2, 0.0]), hold(1e9, None), 300.0);
    let arrival = flight.iter().position(|p| p.desired.holding == 1.0).unwrap();
    let heading = flight[arrival].desired.heading;
    for p in &flight[arrival..] {
        assert_eq!(p.desired.heading, heading);
    }
}

#[test]
fn law_hold_slows_down_to_its_point_and_begins_without_a_jump() {
    for kind in [Kind::Hover, Kind::Sway] {
        let flight = keep(Vessel::new(kind, 0.0, 1.5), hold(1e9, None), 200.0);
        let arrival = flight.iter().position(|p| p.desired.holding == 1.0).unwrap();
        // The radius of 2 m at 0.2/s, with a speed limited to fall by 0.2 m/s².
        assert!((0.2..0.8).contains(&flight[arrival].vessel.speed), "{}", flight[arrival].vessel.speed);
        for w in flight.windows(2) {
            // The limit of acceleration.
            assert!((w[1].desired.speed - w[0].desired.speed).abs() <= 0.2 * DT + 1e-12);
            assert!((w[1].desired.lateral - w[0].desired.lateral).abs() <= 0.2 * DT + 1e-12);
        }
        // It does not shoot past the point by more than the lag of 2 s at 0.4 m/s.
        assert!(largest(flight.iter().map(|p| p.vessel.position[0])) < 60.8);
    }
}

#[test]
fn law_hold_ends_by_its_clock_which_starts_at_the_arrival() {
    let waypoints = [waypoint(POINT, hold(40.0, None)), pass([60.0, 60.0, 12.0])];
    for kind in [Kind::Hover, Kind::Sway] {
        let (flight, progress) =
            fly(&guidance(&table(Method::Integral), kind), &waypoints, Vessel::new(kind, 0.0, 1.5), 250.0);
        let near = flight.iter().find(|p| p.desired.distance <= 3.0).unwrap().t;
        let holding = flight.iter().find(|p| p.desired.holding == 1.0).unwrap().t;
        let left = flight.iter().find(|p| p.desired.leg == 1.0).unwrap().t;
        assert!(near < holding, "it slows down first");
        assert!((left - holding - 40.0).abs() < 0.3, "{holding} to {left}");
        assert!(flight.last().unwrap().desired.done == 1.0 && progress.farthest_miss() <= 3.0);
    }
}

#[test]
fn law_hold_without_hover_circles_the_point_for_the_time() {
    let waypoints = [waypoint(POINT, hold(150.0, None)), pass([60.0, 150.0, 12.0])];
    let guidance = guidance(&table(Method::Integral), Kind::Torpedo);
    let (flight, _) = fly(&guidance, &waypoints, Vessel::new(Kind::Torpedo, 0.0, 1.5), 450.0);
    let on: Vec<&Point> = flight.iter().filter(|p| p.desired.leg == 0.0).collect();
    let first = on.iter().position(|p| (range(p.vessel.position, POINT) - 20.0).abs() < 5.0).unwrap();
    // Counted from within a quarter of the radius on, to a step.
    assert!((on[on.len() - 1].t - on[first].t - 150.0).abs() < 0.3);
    for p in &on[first..] {
        assert!((range(p.vessel.position, POINT) - 20.0).abs() < 5.1 && p.desired.holding == 0.0);
        assert!(p.desired.speed > 1.4);
    }
    assert!(flight.last().unwrap().desired.done == 1.0);
}

#[test]
fn law_hold_of_the_last_waypoint_when_the_mission_is_complete() {
    for (kind, nearest, farthest) in
        [(Kind::Hover, 0.0, 0.51), (Kind::Sway, 0.0, 0.01), (Kind::Torpedo, 19.0, 21.0)]
    {
        let vessel = Vessel::new(kind, 0.0, 1.5).in_current([0.1, 0.2, 0.0]);
        let (flight, progress) = fly(
            &guidance(&table(Method::Integral), kind),
            &[pass([40.0, 0.0, 12.0]), pass(POINT)],
            vessel,
            900.0,
        );
        for p in settled(&flight) {
            let distance = range(p.vessel.position, POINT);
            assert!((nearest..farthest).contains(&distance), "{distance}");
            assert!(p.desired.done == 1.0 && p.desired.leg == 1.0);
            assert_eq!(p.desired.holding, if kind == Kind::Torpedo { 0.0 } else { 1.0 });
        }
        assert!(progress.farthest_miss() <= 3.0, "what comes after the end does not count");
    }
}
