//! Circles.

use crate::guidance::vessel::{
    Kind, Point, Vessel, fly, guidance, largest, pass, range, start, table, waypoint,
};
use proptest::prelude::*;
use seatrial::control::guidance::{Fix, GuidanceTable, Method, Progress};
use seatrial::mission::Task;
use seatrial::number::real::Real;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const CENTRE: [f64; 3] = [80.0, 30.0, 12.0];

fn circle(clockwise: bool, turns: f64) -> Task {
    Task::Circle { radius: 25.0, clockwise, turns }
}

fn round(method: Method, clockwise: bool, turns: f64, drift: f64) -> (Vec<Point>, Progress<f64>) {
    let waypoints = [waypoint(CENTRE, circle(clockwise, turns)), pass([80.0, 150.0, 12.0])];
    let vessel = Vessel::new(Kind::Torpedo, 0.3, 1.5).in_current([0.0, drift, 0.0]);
    fly(&guidance(&table(method), Kind::Torpedo), &waypoints, vessel, 260.0 + 105.0 * turns)
}

#[test]
fn law_circle_is_rounded_in_its_direction_as_often_as_asked() {
    for (clockwise, sense) in [(true, 1.0), (false, -1.0)] {
        for turns in [0.5, 2.0] {
            let (flight, progress) = round(Method::Lookahead, clockwise, turns, 0.0);
            let on: Vec<&Point> = flight
                .iter()
                .filter(|p| p.desired.leg == 0.0 && (range(p.vessel.position, CENTRE) - 25.0).abs() < 6.25)
                .collect();
            let bearing =
                |p: &Point| (p.vessel.position[1] - CENTRE[1]).atan2(p.vessel.position[0] - CENTRE[0]);
            let swept: f64 = on.windows(2).map(|w| Real::wrap(bearing(w[1]) - bearing(w[0]))).sum();
            // To a step of 1.5 m/s on 25 m, counted from a quarter of the radius on: 0.006 rad each at both ends.
            assert!((swept * sense - turns * TAU).abs() < 0.015, "{swept}");
            assert!(flight.last().unwrap().desired.done == 1.0, "it leaves for the next waypoint");
            assert!(progress.farthest_miss() <= 3.0);
        }
    }
}

#[test]
fn law_circle_lookahead_keeps_the_offset_of_the_lag() {
    for clockwise in [true, false] {
        let (flight, _) = round(Method::Lookahead, clockwise, 3.0, 0.0);
        let settled = flight.iter().filter(|p| p.desired.leg == 0.0 && p.t > 200.0);
        let off = largest(settled.map(|p| (range(p.vessel.position, CENTRE) - 25.0).abs()));
        // The heading lags by 1.5 s · 1.5/25 rad/s = 0.09 rad, which costs Δ tan(0.09) = 0.9 m outwards.
        assert!((0.7..1.1).contains(&off), "{off}");
    }
}

#[test]
fn law_circle_integral_learns_lag_and_current() {
    for clockwise in [true, false] {
        for (drift, most) in [(0.0, 0.01), (0.3, 0.1)] {
            let (flight, _) = round(Method::Integral, clockwise, 6.0, drift);
            let last = flight.iter().rposition(|p| p.desired.leg == 0.0).unwrap();
            let settled = &flight[last - 1000..last];
            let off = largest(settled.iter().map(|p| (range(p.vessel.position, CENTRE) - 25.0).abs()));
            // The lag and both components of the current are learnt; what is left in a current is that its crab
            // angle is not quite a sine of the bearing (of second order, (V/U)²/2 of Δ V/U: 4 cm).
            assert!(off < most, "{off} in {drift}");
        }
    }
}

#[test]
fn law_circle_is_approached_on_the_leg() {
    let (flight, _) = round(Method::Lookahead, true, 1.0, 0.0);
    let leg = (CENTRE[1]).atan2(CENTRE[0]);
    // From the start to 45 m, two lookahead distances outside: on the line from the start to the centre.
    for p in flight
        .iter()
        .filter(|p| p.t > 20.0 && p.desired.leg == 0.0)
        .take_while(|p| range(p.vessel.position, CENTRE) > 46.0)
    {
        assert!((p.vessel.position[1] - p.vessel.position[0] * leg.tan()).abs() < 0.2);
    }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_circle_errors_are_those_of_a_point_put_beside_it(
        bearing in -PI..PI,
        distance in 0.5..44.0_f64,
        clockwise in any::<bool>(),
    ) {
        let table = GuidanceTable { turn_rate_max_deg_s: 1e6, ..table(Method::Lookahead) };
        let guidance = guidance(&table, Kind::Torpedo);
        let waypoints = [waypoint(CENTRE, circle(clockwise, 1.0))];
        let mut progress = guidance.begin(&start([-50.0, 0.0, 12.0]), &waypoints);
        let position = [CENTRE[0] + distance * bearing.cos(), CENTRE[1] + distance * bearing.sin(), 12.0];
        let fix = Fix { position, altitude: f64::NAN, attitude: [0.0; 3], velocity: [0.0; 3] };
        let desired = guidance.step(&waypoints, &mut progress, &fix, 0.1);
        let sense = if clockwise { 1.0 } else { -1.0 };
        // Rounding of 100 m; angles at 0.5 m from the centre.
        prop_assert!((desired.cross_track - sense * (25.0 - distance)).abs() < 1e-11);
        let heading = bearing + sense * FRAC_PI_2 - (desired.cross_track / 10.0).atan();
        prop_assert!(Real::wrap(desired.heading - heading).abs() < 1e-11);
        // Inside it turns outwards, outside inwards.
        let outwards = (desired.heading - bearing).cos();
        prop_assert!(outwards * (25.0 - distance) >= 0.0);
        prop_assert!((desired.distance - (25.0 - distance).abs()).abs() < 1e-11);
    }
}
