//! Each watch calls for its reaction, and each reaction does what it says.

use crate::closed_loop::flights::{DIVE, Trip, case, column, fault};
use seatrial::control::autopilot::channels::Use;
use seatrial::control::navigation::{CHANNELS, Measurement, Outage};
use seatrial::control::safety::{Alert, Circumstances, Reaction, SafetyTable, Sounded, WATCH_NAMES, watch};
use seatrial::flight::batch::Outcome;
use seatrial::mission::Limits;

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
        (3, "stale_velocity", Reaction::Surface, 20.0),
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

/// A mission at 5 m above a bottom at 20 m.
fn above_the_bottom() -> Trip {
    let mut trip = Trip::cwolf(&DIVE.replace("depth_m = 10.0", "altitude_m = 5.0"));
    trip.seabed = Some([20.0, 0.0, 0.0]);
    trip
}

/// Without bottom lock the last desired depth stays, whatever the last altitude was.
#[test]
fn law_safety_an_altimeter_that_fails_does_not_lead_into_the_bottom() {
    let usual = above_the_bottom().one(case([0.0; 3])).summary.altitude;
    let mut trip = above_the_bottom();
    trip.sensors.outages = vec![Outage { group: 5, from: 60.0, until: f64::INFINITY }];
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!((alert(&outcome).0, alert(&outcome).1), (2.0, "stale_altitude"));
    assert!(outcome.summary.altitude > usual - 0.1, "{} after {usual}", outcome.summary.altitude);
    let mut without = above_the_bottom();
    without.sensors.timing[5].present = false;
    std::sync::Arc::get_mut(&mut without.mission).expect("the only owner").limits.altitude = 2.0;
    let outcome = without.one(case([0.0; 3]));
    let (level, cause, since) = alert(&outcome);
    assert_eq!((level, cause), (2.0, "stale_altitude"), "no altimeter is not the same as no water");
    assert!((since - 20.0).abs() < 0.25, "{since}");
}

/// What a reaction leaves undone is not counted.
#[test]
fn law_safety_waypoints_behind_an_abort_are_not_counted() {
    let mut trip = Trip::cwolf(DIVE);
    trip.sensors.outages = vec![Outage { group: 1, from: 20.0, until: f64::INFINITY }];
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!((outcome.summary.ending, outcome.summary.waypoints), (3.0, 0.0));
}

/// An actuator that is given up gets no command, also where it would obey and where it does something.
#[test]
fn law_safety_who_is_given_up_gets_no_command() {
    let trip = Trip::cwolf(DIVE);
    let mut broken = case([0.0; 3]);
    broken.faults = vec![fault(&trip, "PL", 30.0, Some(1800.0))];
    let outcome = trip.one(broken);
    let (command, signal) = (column(&trip, &outcome, "cmd.PL"), column(&trip, &outcome, "act.PL"));
    assert!(command[330..].iter().all(|n| *n == 0.0), "{:?}", &command[325..335]);
    assert!(signal[330..].iter().all(|n| *n == 1800.0));
    assert_eq!(outcome.summary.ending, 1.0, "the others take over: {:?}", outcome.summary);
}

/// On the way up the desired depth keeps to its rate, and the vehicle does not turn back.
#[test]
fn law_safety_surfacing_keeps_the_limits_of_guidance() {
    let mut trip = limited(|limits| limits.time = 110.0);
    trip.seconds = 400.0;
    let outcome = trip.one(case([0.0; 3]));
    assert_eq!(outcome.summary.ending, 2.0);
    let (z, desired) = (column(&trip, &outcome, "z"), column(&trip, &outcome, "desired_depth"));
    let level = column(&trip, &outcome, "alert");
    let at = level.iter().position(|l| *l > 0.0).expect("an alert");
    let most = trip.settings.file.guidance.depth_rate_max_m_s * 0.1;
    for k in at..z.len() {
        assert!((desired[k] - desired[k - 1]).abs() <= most + 1e-12, "step {k}");
    }
    let mut highest = f64::INFINITY;
    for depth in &z[at + 50..] {
        highest = highest.min(*depth);
        assert!(depth - highest < 0.2, "it dives again by {:.2} m", depth - highest);
    }
}

/// A Doppler log that falls silent under way leaves no constant error in any loop.
#[test]
fn law_safety_a_silent_doppler_log_does_not_push() {
    let mut trip = Trip::cwolf(DIVE);
    trip.sensors.outages = vec![Outage { group: 3, from: 60.0, until: 69.0 }];
    let (silent, usual) = (trip.one(case([0.0; 3])), Trip::cwolf(DIVE).one(case([0.0; 3])));
    assert_eq!(silent.summary.ending, 1.0);
    for name in ["u", "z"] {
        let (a, b) = (column(&trip, &silent, name), column(&trip, &usual, name));
        let apart = (600..690).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
        assert!(apart < 0.1, "{name} goes {apart:.2} off in nine seconds");
    }
}

/// One wild sample does not end a mission.
#[test]
fn law_safety_limits_need_more_than_a_sample() {
    let table = SafetyTable::default();
    let limits = Limits { depth: 10.0, altitude: 0.0, time: f64::INFINITY, fence: Vec::new() };
    let mut measured = Measurement::nothing(0.0);
    measured.age = [0.0; CHANNELS];
    let uses = [Use::Needed; CHANNELS];
    let mut alert = Alert::none(0.0);
    for k in 0..40 {
        let deep = k == 5 || k >= 20;
        measured.channels[2] = if deep { 12.0 } else { 9.0 };
        let time = f64::from(k) * 0.1;
        let around = Circumstances {
            limits: &limits,
            uses: &uses,
            time,
            dt: 0.1,
            needs_altitude: 0.0,
            failed: 0.0,
            distrusted: 0.0,
            stalled: 0.0,
            sounded: None,
            contradiction: None,
            speed: 0.0,
            battery_age: 0.0,
            battery_wrong: 0.0,
            surfaced: 0.0,
        };
        alert = watch(&table, &alert, &measured, &around);
        assert_eq!(alert.level > 0.0, k >= 30, "step {k}");
    }
}

/// An estimate without waves does not hide from the watch how deep the depth sensor shows the vehicle; an old sample
/// says nothing.
#[test]
fn law_safety_the_depth_watch_believes_the_deeper_of_sensor_and_estimate() {
    let table = SafetyTable::default();
    let limits = Limits { depth: 10.0, altitude: 0.0, time: f64::INFINITY, fence: Vec::new() };
    let mut measured = Measurement::nothing(0.0);
    measured.age = [0.0; CHANNELS];
    let uses = [Use::Needed; CHANNELS];
    for (estimate, depth, age, called) in
        [(9.0, 10.5, 0.0, true), (10.5, 9.0, 0.0, true), (9.0, 9.5, 0.0, false), (9.0, 10.5, 6.0, false)]
    {
        measured.channels[2] = estimate;
        let mut alert = Alert::none(0.0);
        for k in 0..20 {
            let around = Circumstances {
                limits: &limits,
                uses: &uses,
                time: f64::from(k) * 0.1,
                dt: 0.1,
                needs_altitude: 0.0,
                failed: 0.0,
                distrusted: 0.0,
                stalled: 0.0,
                sounded: Some(Sounded { depth, age }),
                contradiction: None,
                speed: 0.0,
                battery_age: 0.0,
                battery_wrong: 0.0,
                surfaced: 0.0,
            };
            alert = watch(&table, &alert, &measured, &around);
        }
        assert_eq!(alert.level > 0.0, called, "estimate {estimate} m, sensor {depth} m, {age} s old");
    }
}
