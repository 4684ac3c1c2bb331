//! Set points in place of guidance, and the constraint criteria of their responses.

use crate::closed_loop::flights::{Trip, case, column};
use proptest::prelude::*;
use seatrial::control::autopilot::set_point::SET_POINTS;
use seatrial::flight::batch::Case;
use seatrial::flight::trial::{Corridor, Dither, Trial, channel_index};
use seatrial::model::kinematics::from_euler;

/// A leg that nobody reaches.
const FAR: &str = "format = 1\nname = \"far\"\nspeed_m_s = 1.5\nacceptance_radius_m = 5.0\n\
    [[legs]]\nnorth_m = 9000.0\neast_m = 0.0\ndepth_m = 5.0\n";

const STEP_AT_S: f64 = 20.0;
const DT_S: f64 = 0.1;

fn named(names: &[&str]) -> Vec<usize> {
    let index = |name: &&str| SET_POINTS.iter().position(|known| known == name).expect("a set point");
    names.iter().map(index).collect()
}

/// Straight ahead at 1.5 m/s and 5 m, then a heading step.
fn heading_step(corridor: Option<Corridor>) -> Trip {
    let mut trip = Trip::cwolf(FAR);
    trip.seconds = 60.0;
    trip.trial = Trial {
        times: vec![0.0, STEP_AT_S],
        named: named(&["speed", "heading", "pitch", "depth"]),
        corridors: corridor.into_iter().collect(),
        ..Trial::default()
    };
    trip
}

fn turning(heading: f64) -> Case {
    let mut one = case([0.0; 3]);
    one.state.position[2] = 5.0;
    one.state.nu[0] = 1.5;
    one.set_points = vec![1.5, 1.5, 0.0, heading, 0.0, 0.0, 5.0, 5.0];
    one.scales = vec![[0.0, heading]];
    one
}

/// Bounds that are the same from the step on, and none before.
fn corridor(channel: &str, lower: f64, upper: f64) -> Corridor {
    let periods = 601;
    let after = |value: f64, before: f64| {
        (0..periods).map(|k| if k as f64 * 0.1 < STEP_AT_S { before } else { value }).collect::<Vec<_>>()
    };
    Corridor {
        channel: channel_index(channel).expect("a channel"),
        lower: after(lower, f64::NEG_INFINITY),
        upper: after(upper, f64::INFINITY),
        target: after(1.0, 0.0),
        clock: (0..periods).map(|k| (k as f64 * 0.1 - STEP_AT_S).max(0.0)).collect(),
    }
}

#[test]
fn a_set_point_stands_in_for_guidance() {
    let trip = heading_step(None);
    let outcome = trip.one(turning(0.4));
    let heading = column(&trip, &outcome, "yaw");
    assert!(heading[190].abs() < 0.01, "before the step guidance's course is kept: {}", heading[190]);
    assert!((heading[600] - 0.4).abs() < 0.02, "the step is followed: {}", heading[600]);
    assert_eq!(column(&trip, &outcome, "desired_heading")[250], 0.4);
}

#[test]
fn a_moved_plan_is_a_step_of_the_path() {
    let mut trip = Trip::cwolf(FAR);
    trip.seconds = 120.0;
    trip.trial = Trial { times: vec![0.0, STEP_AT_S], named: named(&["east"]), ..Trial::default() };
    let mut one = case([0.0; 3]);
    one.state.position[2] = 5.0;
    one.set_points = vec![0.0, 6.0];
    let outcome = trip.one(one);
    let east = column(&trip, &outcome, "y");
    assert!(east[195].abs() < 0.1, "on the path before: {}", east[195]);
    assert!((east[1200] - 6.0).abs() < 0.3, "on the moved path: {}", east[1200]);
    // Guidance sees the error of the moved path.
    let error = column(&trip, &outcome, "cross_track");
    assert!((error[201] + 6.0).abs() < 0.2, "{}", error[201]);
}

#[test]
fn law_violations_are_the_sums_of_the_log() {
    let trip = heading_step(Some(corridor("yaw", 0.9, 1.02)));
    let outcome = trip.one(turning(0.4));
    let heading = column(&trip, &outcome, "yaw");
    let mut sums = [0.0; 3];
    for (k, yaw) in heading.iter().enumerate() {
        let t = k as f64 * 0.1;
        if t >= STEP_AT_S {
            sums[0] += (0.9 - yaw / 0.4).max(0.0) * 0.1;
            sums[1] += (yaw / 0.4 - 1.02).max(0.0) * 0.1;
        }
        sums[2] += (yaw / 0.4 - 1.0).abs() * (t - STEP_AT_S).max(0.0) * 0.1;
    }
    let found = outcome.summary.violations.sums[0];
    assert!(sums[0] > 0.5, "the rise violates the lower bound");
    for (a, b) in found.iter().zip(sums) {
        // The same sums, in another order of rounding.
        assert!((a - b).abs() < 1e-9 * (1.0 + b), "{found:?} {sums:?}");
    }
}

#[test]
fn a_diverged_response_violates_everything() {
    let trip = heading_step(Some(corridor("yaw", 0.9, 1.1)));
    let mass = trip.description.layout.find("m").expect("known");
    let mut one = turning(0.4);
    one.coefficients = vec![f64::NAN];
    let outcome = trip.fly_with(&[one], &[mass], &[]).remove(0);
    assert_eq!(outcome.summary.violations.sums[0], [f64::INFINITY; 3]);
}

#[test]
fn a_trial_is_judged_to_its_end() {
    // The depth limit ends the flight long before the trial does.
    let shallow = FAR.replace("[[legs]]", "[limits]\nmax_depth_m = 6.0\n[[legs]]");
    let mut trip = heading_step(Some(corridor("yaw", 0.9, 1.1)));
    trip.mission =
        std::sync::Arc::new(seatrial::mission::Mission::from_toml(&shallow, "test").expect("valid"));
    let mut one = turning(0.4);
    one.set_points[7] = 20.0;
    one.state.position[2] = 12.0;
    let outcome = trip.one(one);
    let below = outcome.summary.violations.sums[0][0];
    assert!(below > 20.0, "it never turned, for all of the forty seconds: {below}");
}

/// The log of a trial goes to its end, too, abreast and alone.
#[test]
fn a_trial_is_logged_to_its_end() {
    let mut trip = heading_step(Some(corridor("yaw", 0.9, 1.1)));
    std::sync::Arc::get_mut(&mut trip.mission).expect("the only owner").limits.depth = 2.0;
    trip.seconds = 100.0;
    let mut one = turning(0.4);
    one.state.position[2] = 3.0;
    let abreast = trip.fly(&[one.clone(), one.clone()]).remove(0);
    let alone = trip.one(one);
    for outcome in [abreast, alone] {
        assert_eq!(outcome.summary.ending, 2.0, "{:?}", outcome.summary);
        assert!(outcome.summary.duration < 90.0, "it surfaces before: {}", outcome.summary.duration);
        assert_eq!(outcome.log.rows, 1001);
    }
}

/// A step across north by south: the corridor sees 0.4 rad, and a heading a turn further is the same heading.
#[test]
fn a_heading_step_across_180_degrees_is_one_of_its_size() {
    let from = 3.0;
    let trip = heading_step(Some(corridor("yaw", 0.9, 1.02)));
    let south = |turns: f64| {
        let mut one = turning(0.4);
        one.state.attitude = from_euler(&[0.0, 0.0, from]);
        one.set_points[2] = from;
        one.set_points[3] = from + 0.4 + turns * std::f64::consts::TAU;
        one.scales = vec![[from, 0.4]];
        one
    };
    let [here, turned] = [0.0, 1.0].map(|turns| trip.one(south(turns)));
    let north = trip.one(turning(0.4)).summary.violations.sums[0];
    for outcome in [&here, &turned] {
        let yaw = column(&trip, outcome, "yaw");
        assert!((yaw[600] - (from + 0.4 - std::f64::consts::TAU)).abs() < 0.02, "{}", yaw[600]);
        let desired = column(&trip, outcome, "desired_heading");
        assert!(desired.iter().all(|x| x.abs() <= std::f64::consts::PI), "{}", desired[600]);
        // Still water has no direction; guidance holds the first 20 s to the same speed and depth.
        for (a, b) in outcome.summary.violations.sums[0].iter().zip(north) {
            assert!((a - b).abs() < 1e-3 * (1.0 + b), "{:?} {north:?}", outcome.summary.violations);
        }
    }
}

/// Reactions are those of a mission: who passes the fence by hand is held there, and a plan that is moved later does not
/// move what holds.
#[test]
fn a_reaction_takes_the_place_of_set_points() {
    let mut trip = heading_step(None);
    let fence = vec![[-50.0, -50.0], [40.0, -50.0], [40.0, 50.0], [-50.0, 50.0]];
    std::sync::Arc::get_mut(&mut trip.mission).expect("the only owner").limits.fence = fence;
    trip.seconds = 120.0;
    let held = |trip: &Trip, one: Case| {
        for outcome in trip.fly(&[one.clone(), one.clone()]).into_iter().take(1).chain([trip.one(one)]) {
            let [level, _, since] = outcome.summary.alert;
            assert_eq!(level, 1.0, "{:?}", outcome.summary);
            let (x, y, z) =
                (column(trip, &outcome, "x"), column(trip, &outcome, "y"), column(trip, &outcome, "z"));
            let (at, end) = ((since / DT_S) as usize, x.len() - 1);
            let away = (x[end] - x[at]).hypot(y[end] - y[at]);
            assert!(away < 3.0, "holds within 3 m of where it passed the fence, found {away:.1} m");
            assert!((z[end] - z[at]).abs() < 0.5, "and at its depth: {} {}", z[at], z[end]);
        }
    };
    let mut steered = turning(0.0);
    steered.set_points = vec![1.5, 1.5, 0.0, 0.0, 0.0, 0.0, 5.0, 12.0];
    held(&trip, steered);
    trip.trial = Trial { times: vec![0.0, 60.0], named: named(&["east", "down"]), ..Trial::default() };
    let mut moved = turning(0.0);
    moved.set_points = vec![0.0, 20.0, 0.0, 6.0];
    held(&trip, moved);
}

properties! {
    #![cases(6)]
    /// A corridor that is moved with the response is violated alike, whatever the size and sign of the step, as long as
    /// the loop is linear: small steps.
    #[test]
    fn law_small_steps_scale(size in 0.01f64..0.03, starboard in any::<bool>()) {
        let trip = heading_step(Some(corridor("yaw", 0.95, 1.05)));
        let size = if starboard { size } else { -size };
        let both = trip.fly(&[turning(size), turning(0.5 * size)]);
        let [a, b] = [0, 1].map(|i: usize| both[i].summary.violations.sums[0]);
        // Quadratic damping and least revolutions bend the response a little.
        prop_assert!((a[0] - b[0]).abs() < 0.15 * (a[0] + b[0]) + 0.05, "{a:?} {b:?}");
    }
}

#[test]
fn a_dither_is_on_top_of_the_commands_while_it_lasts() {
    let mut trip = heading_step(None);
    let plain = trip.one(turning(0.0));
    trip.trial.dither = Dither { times: vec![10.0, 12.0], signals: vec![(0, vec![50.0, 0.0])] };
    let moved = trip.one(turning(0.0));
    let name = format!("cmd.{}", trip.description.actuators[0].name);
    let (before, with) = (column(&trip, &plain, &name), column(&trip, &moved, &name));
    assert_eq!(before[..100], with[..100], "nothing before its first time");
    assert!((with[100] - before[100] - 50.0).abs() < 1e-9, "added as it is: {} {}", with[100], before[100]);
    assert!((with[600] - before[600]).abs() < 10.0, "nothing is left of it: {} {}", with[600], before[600]);
    assert!((with[119] - with[121]).abs() > 20.0, "and taken away: {} {}", with[119], with[121]);
}
