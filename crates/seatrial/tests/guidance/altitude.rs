//! Legs that follow the bottom.

use crate::guidance::vessel::{DT, Kind, Vessel, fly, guidance, pass, start, table};
use seatrial::control::guidance::{Fix, Method};
use seatrial::mission::{Vertical, Waypoint};

fn terrain(position: [f64; 3]) -> Waypoint {
    Waypoint { vertical: Vertical::Altitude, ..pass(position) }
}

/// A bottom that falls 8 m per 100 m to the north.
fn slope(north: f64) -> f64 {
    40.0 + 0.08 * north
}

#[test]
fn law_altitude_is_kept_over_a_slope() {
    for (kind, most) in [
        // By heave, first-order lag of 1 s at 0.12 m/s of fall.
        (Kind::Hover, 0.15),
        // By pitch, the integral makes up for the slope.
        (Kind::Torpedo, 0.1),
    ] {
        let vessel = Vessel { bottom: slope, ..Vessel::new(kind, 0.0, 1.5).at([0.0, 0.0, 30.0]) };
        let waypoints = [terrain([500.0, 0.0, 6.0])];
        let (flight, progress) = fly(&guidance(&table(Method::Integral), kind), &waypoints, vessel, 340.0);
        let end = flight.iter().rposition(|p| p.desired.done == 0.0).unwrap();
        assert!(end < flight.len() - 1, "the waypoint is reached");
        for point in &flight[end - 100..=end] {
            let altitude = point.vessel.fix().altitude;
            assert!((altitude - 6.0).abs() < most, "{altitude}");
            assert!((point.desired.vertical_error - (6.0 - altitude)).abs() < 1e-9);
        }
        // The sphere about the point 6 m above the bottom, not about a depth of 6 m.
        assert!(progress.farthest_miss() <= 3.0);
    }
}

#[test]
fn law_altitude_that_is_lost_holds_the_last_depth() {
    let guidance = guidance(&table(Method::Integral), Kind::Hover);
    let waypoints = [terrain([500.0, 0.0, 6.0])];
    let mut progress = guidance.begin(&start([0.0, 0.0, 30.0]), &waypoints);
    let mut fix =
        Fix { position: [10.0, 0.0, 30.0], altitude: 7.0, attitude: [0.0; 3], velocity: [1.5, 0.0, 0.0] };
    let mut last = 0.0;
    for _ in 0..100 {
        last = guidance.step(&waypoints, &mut progress, &fix, DT).depth;
    }
    assert!((last - 31.0).abs() < 1e-12, "6 m above a bottom at 37 m");
    for lost in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -5.0] {
        fix.altitude = lost;
        for _ in 0..20 {
            let desired = guidance.step(&waypoints, &mut progress, &fix, DT);
            assert_eq!(desired.depth, last);
            assert!(desired.pitch.is_finite() && desired.vertical_error.is_finite());
            // A vehicle above the held depth is above its path.
            assert!((desired.vertical_error + 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn law_altitude_leg_before_a_depth_leg_begins_it_at_the_last_depth() {
    let vessel = Vessel { bottom: slope, ..Vessel::new(Kind::Hover, 0.0, 1.5).at([0.0, 0.0, 34.0]) };
    let waypoints = [terrain([100.0, 0.0, 6.0]), pass([200.0, 0.0, 20.0])];
    let (flight, _) = fly(&guidance(&table(Method::Lookahead), Kind::Hover), &waypoints, vessel, 200.0);
    for pair in flight.windows(2) {
        // The desired depth moves on without a jump: on the path 0.25 m/s, at the limit 0.4.
        assert!((pair[1].desired.depth - pair[0].desired.depth).abs() <= 0.4 * DT + 1e-12);
    }
    let middle = flight.iter().find(|p| p.desired.leg == 1.0 && p.vessel.position[0] > 150.0).unwrap();
    // Half way from 42 m (6 m above a bottom at 48 m) to 20 m.
    assert!((middle.desired.depth - 31.0).abs() < 0.3, "{}", middle.desired.depth);
}
