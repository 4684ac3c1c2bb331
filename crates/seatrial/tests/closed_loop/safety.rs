//! Each watch calls for its reaction, and each reaction does what it says.

use crate::flights::{DIVE, Trip, case, column, fault};
use seatrial::closed_loop::batch::Outcome;
use seatrial::mission::Limits;
use seatrial::navigation::Outage;
use seatrial::safety::{Reaction, WATCH_NAMES};

/// The dive with limits that are set when the mission has been checked against its own.
fn limited(set: impl Fn(&mut Limits)) -> Trip {
    let mut trip = Trip::cwolf(DIVE);
    set(&mut std::sync::Arc::get_mut(&mut trip.mission).expect("the only owner").limits);
    trip
}

/// The level of the alert at the end, the name of its cause and when it began, s.
fn alert(outcome: &Outcome) -> (f64, &'static str, f64) {
    let [level, cause, since] = outcome.summary.alert;
    (level, if cause > 0.0 { WATCH_NAMES[cause as usize - 1] } else { "" }, since)
}

#[test]
fn law_safety_each_stale_group_calls_its_reaction() {
    for (group, watch, level, after) in [
        (0, "stale_position", Reaction::Surface, 60.0),
        (1, "stale_depth", Reaction::Abort, 5.0),
        (2, "stale_attitude", Reaction::Abort, 2.0),
        (3, "stale_velocity", Reaction::Surface, 10.0),
        (4, "stale_rates", Reaction::Abort, 2.0),
    ] {
        let mut trip = Trip::cwolf(DIVE);
        trip.sensors.outages = vec![Outage { group, from: 20.0, until: f64::INFINITY }];
        let (found, cause, since) = alert(&trip.one(case([0.0; 3])));
        assert_eq!((found, cause), (f64::from(level as u8), watch));
        assert!((since - 20.0 - after).abs() < 0.25, "{watch}: {since} s"); // a period of sampling, one of looking
    }
}

#[test]
fn law_safety_surface_brings_the_vehicle_up_under_control() {
    let mut trip = Trip::cwolf(DIVE);
    trip.sensors.outages = vec![Outage { group: 3, from: 40.0, until: f64::INFINITY }];
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!(outcome.summary.ending, 2.0, "{:?}", outcome.summary);
    let z = column(&trip, &outcome, "z");
    assert!(z[500] > 3.0 && z[z.len() - 1] < 0.6, "from {} to {} m", z[500], z[z.len() - 1]);
}

#[test]
fn law_safety_abort_stops_all_actuators_and_floats_up() {
    let mut trip = Trip::cwolf(DIVE);
    trip.sensors.outages = vec![Outage { group: 2, from: 40.0, until: f64::INFINITY }];
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!(outcome.summary.ending, 3.0);
    for actuator in &trip.description.actuators {
        let command = column(&trip, &outcome, &format!("cmd.{}", actuator.name));
        assert!(command[425..].iter().all(|n| *n == 0.0), "{}", actuator.name);
    }
    let z = column(&trip, &outcome, "z");
    assert!(z[z.len() - 1] < z[600], "5 N of buoyancy bring it up: {} m, {} m", z[600], z[z.len() - 1]);
}

#[test]
fn law_safety_fence_holds_where_it_is_passed() {
    let fence = vec![[-20.0, -40.0], [60.0, -40.0], [60.0, 140.0], [-20.0, 140.0]];
    let trip = limited(|limits| limits.fence.clone_from(&fence));
    let outcome = trip.one(case([0.0; 3]));
    let (level, cause, since) = alert(&outcome);
    assert_eq!((level, cause), (1.0, "fence"));
    let (x, y) = (column(&trip, &outcome, "x"), column(&trip, &outcome, "y"));
    let (at, end) = ((since / 0.1) as usize, x.len() - 1);
    let away = (x[end] - x[at]).hypot(y[end] - y[at]);
    assert!(away < 3.0, "holds within 3 m of where it passed the fence, found {away:.1} m");
}

#[test]
fn law_safety_time_and_battery_bring_it_up() {
    let outcome = limited(|limits| limits.time = 50.0).one(case([0.0; 3]));
    let (level, cause, since) = alert(&outcome);
    assert_eq!((level, cause), (2.0, "time"));
    assert!((since - 50.1).abs() < 0.11, "{since}");
    let mut trip = Trip::cwolf(DIVE);
    let power = trip.description.file.power.as_mut().expect("CWolf has a battery");
    power.battery_wh = 5.0;
    let (level, cause, _) = alert(&trip.one(case([0.0; 3])));
    assert_eq!((level, cause), (2.0, "battery"));
}

#[test]
fn law_safety_depth_limit_brings_it_up() {
    let trip = limited(|limits| limits.depth = 4.0);
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!((alert(&outcome).0, alert(&outcome).1), (2.0, "depth"));
    assert_eq!(outcome.summary.ending, 2.0);
    assert!(outcome.summary.depth < 6.0, "{}", outcome.summary.depth); // it turns round within 2 m
}

/// A dead stern propeller is found by its revolutions, left out, and the mission goes on.
#[test]
fn law_safety_survives_a_dead_stern_propeller() {
    let trip = Trip::cwolf(DIVE);
    let mut broken = case([0.0, 0.3, 0.0]);
    broken.faults = vec![fault(&trip, "SbU", 30.0, Some(0.0))];
    let outcome = trip.one(broken);
    assert_eq!(outcome.summary.ending, 1.0, "{:?}", outcome.summary);
    assert!(outcome.summary.missed_by <= 5.0);
    let command = column(&trip, &outcome, "cmd.SbU");
    let given_up = column(&trip, &outcome, "given_up");
    assert_eq!((given_up[310], given_up[330]), (0.0, 1.0), "the first actuator, from then on");
    // Found after 2 s of deviation, then no longer commanded.
    assert!(command[330..].iter().all(|n| *n == 0.0) && command[310] > 0.0);
}

/// A current that it cannot overcome: the waypoint comes no nearer, and the vehicle comes up.
#[test]
fn law_safety_no_progress_brings_it_up() {
    let trip = Trip::cwolf(DIVE);
    // CWolf makes 3.1 m/s through the water.
    let outcome = trip.one(case([-3.5, 0.0, 0.0]));
    let (level, cause, since) = alert(&outcome);
    assert_eq!((level, cause), (2.0, "progress"), "{:?}", outcome.summary);
    assert!((120.0..140.0).contains(&since), "{since} s: 120 s after it was nearest, at the start");
}
