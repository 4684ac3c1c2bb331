//! Limits of what is desired.

use crate::guidance::vessel::{DT, Kind, Vessel, fly, guidance, pass, table, waypoint};
use proptest::prelude::*;
use seatrial::control::guidance::{Fix, GuidanceTable, Method};
use seatrial::mission::{Start, Task};
use seatrial::number::real::Real;
use std::f64::consts::PI;

fn method() -> impl Strategy<Value = Method> {
    prop_oneof![Just(Method::Pursuit), Just(Method::Lookahead), Just(Method::Integral)]
}

properties! {
    #![cases(128)]

    // Fixes that jump about, which no vehicle does: the limits do not rest on a well-behaved one.
    #[test]
    fn law_limits_hold_at_every_step(
        method in method(),
        kind in prop_oneof![Just(Kind::Torpedo), Just(Kind::Hover), Just(Kind::Sway)],
        fixes in proptest::collection::vec((-60.0..60.0_f64, -60.0..60.0_f64, 0.0..30.0_f64, -PI..PI, -1.0..1.0_f64), 60),
    ) {
        let table = GuidanceTable { speed_max_m_s: 1.2, turn_speed_share: 0.3, ..table(method) };
        let guidance = guidance(&table, kind);
        let waypoints = [
            pass([20.0, 0.0, 10.0]),
            waypoint([0.0, 0.0, 5.0], Task::Hold { seconds: 0.5, heading: Some(1.0) }),
            waypoint([10.0, 20.0, 15.0], Task::Circle { radius: 10.0, clockwise: false, turns: 0.3 }),
            pass([10.0, 20.0, 35.0]),
        ];
        let mut progress = guidance.begin(&Start { position: [0.0; 3], heading: None }, &waypoints);
        let mut last: Option<seatrial::control::guidance::Desired<f64>> = None;
        for (north, east, down, yaw, slip) in fixes {
            let fix = Fix {
                position: [north, east, down],
                altitude: f64::NAN,
                attitude: [0.0, slip * 0.2, yaw],
                velocity: [slip, 0.2 * slip, 0.0],
            };
            let desired = guidance.step(&waypoints, &mut progress, &fix, DT);
            // Rounding.
            let slack = 1e-12;
            let before = last.unwrap_or(seatrial::control::guidance::Desired {
                // The first call starts from what is measured.
                speed: slip, heading: yaw, pitch: slip * 0.2, depth: down, ..desired
            });
            prop_assert!((desired.speed - before.speed).abs() <= 0.2 * DT + slack);
            prop_assert!(desired.speed.abs() <= 1.2 + slack);
            prop_assert!(Real::wrap(desired.heading - before.heading).abs() <= 15_f64.to_radians() * DT + slack);
            prop_assert!(desired.heading.abs() <= PI + slack);
            prop_assert!((desired.pitch - before.pitch).abs() <= 5_f64.to_radians() * DT + slack);
            prop_assert!(desired.pitch.abs() <= 20_f64.to_radians() + slack);
            prop_assert!((desired.depth - before.depth).abs() <= 0.4 * DT + slack);
            prop_assert!(kind == Kind::Sway && desired.holding == 1.0 || desired.lateral == 0.0);
            prop_assert!(desired.leg >= before.leg && desired.leg <= 3.0);
            prop_assert!(desired.distance.is_finite() && desired.cross_track.is_finite());
            last = Some(desired);
        }
    }
}

#[test]
fn law_limits_reach_what_is_asked() {
    // Hard about: 15°/s for 180° are 12 s, and the lag of 1.5 s behind them.
    let waypoints = [pass([-200.0, 0.1, 10.0])];
    let (flight, _) = fly(
        &guidance(&table(Method::Pursuit), Kind::Torpedo),
        &waypoints,
        Vessel::new(Kind::Torpedo, 0.0, 1.5),
        60.0,
    );
    let turned = flight.iter().find(|p| p.desired.heading.abs() > 3.0).unwrap().t;
    assert!((11.0..16.0).contains(&turned), "{turned}");
}

#[test]
fn law_limits_slow_down_in_turns_to_the_stated_share() {
    let waypoints = [pass([-200.0, 0.1, 10.0])];
    for share in [1.0, 0.4] {
        let table = GuidanceTable {
            turn_speed_share: share,
            acceleration_max_m_s2: 10.0,
            turn_rate_max_deg_s: 5.0,
            ..table(Method::Pursuit)
        };
        let vessel = Vessel::new(Kind::Torpedo, 0.0, 1.5);
        let (flight, _) = fly(&guidance(&table, Kind::Torpedo), &waypoints, vessel, 90.0);
        let slowest = flight.iter().map(|p| p.desired.speed).fold(f64::INFINITY, f64::min);
        assert!((slowest - 1.5 * share).abs() < 1e-9, "{slowest}");
        // On course again: the whole speed.
        assert!((flight.last().unwrap().desired.speed - 1.5).abs() < 1e-3);
    }
}
