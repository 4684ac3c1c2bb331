//! What the integral keeps over a turn, and what it does not learn.

use crate::guidance::vessel::{DT, Kind, Point, Vessel, fly, go_on, guidance, largest, pass, start, table};
use seatrial::control::guidance::{Fix, GuidanceTable, Method};

/// Two lanes to the north and south, 25 m apart.
const LANES: [[f64; 3]; 4] = [[200.0, 0.0, 10.0], [200.0, 25.0, 10.0], [0.0, 25.0, 10.0], [0.0, 50.0, 10.0]];

/// Mean cross-track error of a leg, without the 30 s of its turn.
fn mean_error(points: &[Point], leg: f64) -> f64 {
    let on = points.iter().filter(|p| p.desired.leg == leg).skip(300);
    let on: Vec<f64> = on.map(|p| p.desired.cross_track.abs()).collect();
    on.iter().sum::<f64>() / on.len() as f64
}

/// The lawnmower in a current to the east, with the integrals kept or forgotten at each waypoint.
fn mow(east: f64, forget: bool) -> Vec<Point> {
    let waypoints = LANES.map(pass);
    let guidance = guidance(&table(Method::Integral), Kind::Torpedo);
    let mut vessel = Vessel::new(Kind::Torpedo, 0.0, 1.5).in_current([0.0, east, 0.0]);
    let mut progress = guidance.begin(&start(vessel.position), &waypoints);
    let mut flight: Vec<Point> = Vec::new();
    while progress.leg() < 3.0 {
        let leg = progress.leg();
        flight.extend(go_on(&guidance, &waypoints, &mut progress, &mut vessel, 1.5 * DT));
        if forget && progress.leg() != leg {
            progress.restart_integrals();
        }
    }
    flight
}

#[test]
fn law_integral_is_kept_over_the_turns_of_a_lawnmower() {
    // Either way of the current: the swing out of the turn alone favours one of them.
    let both = |forget| mean_error(&mow(0.3, forget), 2.0) + mean_error(&mow(-0.3, forget), 2.0);
    let (kept, forgotten) = (both(false), both(true));
    // The way back meets the current from the other side: a restart learns the whole crab angle anew.
    assert!(kept < 0.6 * forgotten, "{kept} against {forgotten}");
}

#[test]
fn law_integral_changes_its_side_when_the_course_is_reversed() {
    let waypoints = [[300.0, 0.0, 10.0], [0.0, 0.1, 10.0]].map(pass);
    let guidance = guidance(&table(Method::Integral), Kind::Torpedo);
    let vessel = Vessel::new(Kind::Torpedo, 0.0, 1.5).in_current([0.0, 0.3, 0.0]);
    let (flight, progress) = fly(&guidance, &waypoints, vessel, 340.0);
    let turn = flight.iter().position(|p| p.desired.leg == 1.0).unwrap();
    // From 50 s after the turn on (the turn itself is 10 m wide) the error stays below what lookahead alone has.
    let after = largest(flight[turn + 500..].iter().map(|p| p.desired.cross_track.abs()));
    assert!(after < 0.5 * 10.0 * (0.2_f64).asin().tan(), "{after}");
    // κ I/Δ is the tangent of the crab angle, to the east on either course.
    let crab = 0.25 * progress.drift()[1] / 10.0;
    assert!((crab - 0.2_f64.asin().tan()).abs() < 0.02, "{crab}");
}

#[test]
fn law_integral_learns_nothing_while_the_heading_is_far_off_or_a_limit_binds() {
    let guidance = guidance(&table(Method::Integral), Kind::Torpedo);
    let waypoints = [pass([500.0, 0.0, 10.0])];
    let fix = |yaw| Fix {
        position: [100.0, 5.0, 10.0],
        altitude: f64::NAN,
        attitude: [0.0, 0.0, yaw],
        velocity: [1.5, 0.0, 0.0],
    };
    let learnt = |yaw: f64, steps: usize| {
        let mut progress = guidance.begin(&start([0.0, 0.0, 10.0]), &waypoints);
        for _ in 0..steps {
            guidance.step(&waypoints, &mut progress, &fix(yaw), DT);
        }
        progress.drift()[1]
    };
    // The desired heading is −27°. Measured headings that are 57° and 63° off it:
    assert!(learnt(0.5, 100) > 0.1);
    assert_eq!(learnt(0.65, 100), 0.0);
    // At 15°/s from 0.5 rad to −0.46 rad the limit binds for 3.5 s.
    assert_eq!(learnt(0.5, 30), 0.0);
}

#[test]
fn law_integral_stays_within_its_bounds() {
    let table = GuidanceTable { integral_gain_m_s: 0.5, ..table(Method::Integral) };
    let guidance = guidance(&table, Kind::Torpedo);
    let waypoints = [pass([1e6, 0.0, 10.0])];
    let mut progress = guidance.begin(&start([0.0, 0.0, 10.0]), &waypoints);
    // Nailed 4 m beside and 5 m below the path, with the heading that is asked for.
    let mut yaw = 0.0;
    for _ in 0..20_000 {
        let fix = Fix {
            position: [100.0, 4.0, 15.0],
            altitude: f64::NAN,
            attitude: [0.0, 0.0, yaw],
            velocity: [1.5, 0.0, 0.0],
        };
        let desired = guidance.step(&waypoints, &mut progress, &fix, DT);
        yaw = desired.heading;
        assert!(desired.pitch <= 20_f64.to_radians() + 1e-12);
    }
    // Δ/κ: 45°.
    assert!((progress.drift()[1] - 20.0).abs() < 1e-9, "{:?}", progress.drift());
}
