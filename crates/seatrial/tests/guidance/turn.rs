//! The turn from one leg to the next begins before the waypoint.

use crate::guidance::vessel::{Kind, Vessel, fly, guidance, largest, pass, table};
use proptest::prelude::*;
use seatrial::control::guidance::{GuidanceTable, Method};

/// What the vessel of these tests does: the heading follows 1.5 s late, at most at the rate of the table.
fn anticipating() -> GuidanceTable {
    GuidanceTable {
        turn_radius_m: 3.0,
        turn_delay_s: 1.5,
        turn_rate_max_deg_s: 9.0,
        ..table(Method::Integral)
    }
}

/// How far the vessel goes beyond the second leg, and by how much it misses the corner, m.
fn flown(table: &GuidanceTable, turn: f64, current: [f64; 3]) -> (f64, f64) {
    let (sine, cosine) = turn.sin_cos();
    let corner = [100.0, 0.0, 10.0];
    let waypoints = [pass(corner), pass([100.0 + 100.0 * cosine, 100.0 * sine, 10.0])];
    let vessel = Vessel::new(Kind::Torpedo, 0.0, 1.5).at([0.0, 0.0, 10.0]).in_current(current);
    let (flight, progress) = fly(&guidance(table, Kind::Torpedo), &waypoints, vessel, 160.0);
    // The way to the next waypoint alone: what follows its end is no turn.
    let places = flight.iter().filter(|p| p.desired.leg == 1.0).map(|p| {
        let [x, y] = [p.vessel.position[0] - corner[0], p.vessel.position[1] - corner[1]];
        (x * cosine + y * sine, (x * sine - y * cosine) * turn.signum())
    });
    let beyond = places.take_while(|(along, _)| *along < 70.0).map(|(_, across)| across);
    (largest(beyond), progress.farthest_miss())
}

properties! {
    #![cases(64)]

    #[test]
    fn law_turn_overshoots_less_and_still_passes_its_waypoint(
        turn in prop_oneof![-2.4..-0.3_f64, 0.3..2.4_f64],
        (north, east) in (-0.2..0.2_f64, -0.2..0.2_f64),
    ) {
        let current = [north, east, 0.0];
        let late = flown(&GuidanceTable { turn_radius_m: 0.0, ..anticipating() }, turn, current);
        let early = flown(&anticipating(), turn, current);
        // The radius of acceptance is 3 m; rounding of a period's way.
        prop_assert!(early.1 <= 3.0 + 0.15, "missed by {}", early.1);
        prop_assert!(early.0 <= late.0 + 0.15, "{} m beyond, {} without", early.0, late.0);
    }
}

#[test]
fn law_turn_of_a_right_angle_goes_half_as_far_beyond_the_next_leg() {
    let wide = |table: &GuidanceTable| flown(table, std::f64::consts::FRAC_PI_2, [0.0; 3]).0;
    let (late, early) =
        (wide(&GuidanceTable { turn_radius_m: 0.0, ..anticipating() }), wide(&anticipating()));
    assert!(late > 5.0 && early < 0.55 * late, "{late} m, then {early} m");
}

#[test]
fn law_turn_is_not_anticipated_by_pursuit() {
    let at = |radius: f64| GuidanceTable { turn_radius_m: radius, method: Method::Pursuit, ..anticipating() };
    assert_eq!(flown(&at(0.0), 1.5, [0.0; 3]), flown(&at(3.0), 1.5, [0.0; 3]));
}
