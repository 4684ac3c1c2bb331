//! Nuisance parameters and initial conditions do what their definition says.

use crate::scalars::flights::{Flights, NAMES, noise};
use seatrial::description::coefficients;
use seatrial::fit::criterion::{CHANNEL_NAMES, CHANNELS, channels};
use seatrial::fit::observation::{INITIAL_NAMES, INITIALS, NUISANCES, nuisance_names};
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{from_euler, normalised, quaternion_product, rotation, to_euler};
use seatrial::number::algebra::{cross, product};
use seatrial::number::real::Real;
use std::f64::consts::FRAC_PI_2;
use std::sync::atomic::AtomicBool;

type Rows = Vec<[f64; CHANNELS]>;

const TILT: usize = 3;
const LEVER: usize = 5;
const LATENCY: usize = 8;
const BIAS: usize = 20;
const FORCE: usize = 32;

/// What the segments of some flights show.
fn shown(flights: &Flights) -> Vec<Rows> {
    flights.batch().predictions(flights.point(&[]), &AtomicBool::new(false)).expect("nobody interrupts")
}

/// The states behind flights that nothing disturbs, read back from what is shown.
fn states(flights: &Flights) -> Vec<Vec<State<f64>>> {
    let state = |row: &[f64; CHANNELS]| State {
        position: [row[6], row[7], row[8]],
        attitude: from_euler(&[row[9], row[10], row[11]]),
        nu: std::array::from_fn(|i| row[i]),
    };
    shown(flights).iter().map(|rows| rows.iter().map(state).collect()).collect()
}

/// Asserts equal channels; rounding of a start that is computed instead of given, over 60 steps.
fn close(found: &[Rows], expected: &[Rows]) {
    for (k, (found, expected)) in found.concat().iter().zip(expected.concat()).enumerate() {
        for c in 0..CHANNELS {
            let apart = found[c] - expected[c];
            let apart = if c < 9 { apart } else { apart.wrap() };
            assert!(apart.abs() < 1e-11, "sample {k}, {}: {apart:e}", CHANNEL_NAMES[c]);
        }
    }
}

/// Asserts that flights whose instruments `distort` the true state show it distorted when they are told by
/// how much (`set`): the recorded start is distorted too.
fn undone(name: &str, distort: impl Fn(&State<f64>) -> State<f64>, set: impl Fn(&mut Flights)) {
    let truth = Flights::new(name);
    let distorted = |states: &Vec<State<f64>>| states.iter().map(|s| channels(&distort(s))).collect();
    let expected: Vec<Rows> = states(&truth).iter().map(distorted).collect();
    let mut flights = Flights::new(name);
    for segment in &mut flights.segments {
        segment.state = distort(&segment.state);
    }
    set(&mut flights);
    close(&shown(&flights), &expected);
}

#[test]
fn law_a_current_as_nuisance_is_a_recorded_current() {
    let added = [0.3, -0.2, 0.1];
    for name in NAMES {
        for recorded in [true, false] {
            let (mut nuisance, mut record) = (Flights::new(name), Flights::new(name));
            nuisance.nuisance[0][..3].copy_from_slice(&added);
            if recorded {
                for row in &mut record.records[0].current {
                    *row = std::array::from_fn(|i| row[i] + added[i]);
                }
            } else {
                nuisance.records[0].current.clear();
                record.records[0].current = vec![added];
            }
            close(&shown(&nuisance), &shown(&record));
        }
    }
}

#[test]
fn law_a_force_as_nuisance_is_a_bias_of_the_vehicle() {
    let force: [f64; 6] = std::array::from_fn(|i| 3.0 * noise(80 + i));
    for name in NAMES {
        let (mut nuisance, mut biased) = (Flights::new(name), Flights::new(name));
        nuisance.nuisance[0][FORCE..].copy_from_slice(&force);
        for (i, push) in force.iter().enumerate() {
            let index = biased.sought.iter().position(|&sought| sought == coefficients::BIAS + i);
            biased.values[index.expect("a bias is a coefficient of every vehicle")] += push;
        }
        close(&shown(&nuisance), &shown(&biased));
    }
}

#[test]
fn law_a_bias_is_added_to_its_channel() {
    let bias: [f64; CHANNELS] = std::array::from_fn(|c| 0.1 * noise(40 + c));
    let distort = |state: &State<f64>| {
        let row = channels(state);
        State {
            position: std::array::from_fn(|i| row[6 + i] + bias[6 + i]),
            attitude: from_euler(&std::array::from_fn(|i| row[9 + i] + bias[9 + i])),
            nu: std::array::from_fn(|i| row[i] + bias[i]),
        }
    };
    for name in NAMES {
        undone(name, distort, |flights| flights.nuisance[0][BIAS..FORCE].copy_from_slice(&bias));
    }
}

#[test]
fn law_a_tilt_turns_the_recording_about_its_earth_frame() {
    let [north, east] = [0.06, -0.04];
    let tilt = normalised(&[1.0, 0.5 * north, 0.5 * east, 0.0]);
    let distort = |state: &State<f64>| State {
        position: product(&rotation(&tilt), &state.position),
        attitude: quaternion_product(&tilt, &state.attitude),
        nu: state.nu,
    };
    for name in NAMES {
        undone(name, distort, |flights| flights.nuisance[0][TILT..LEVER].copy_from_slice(&[north, east]));
    }
    // A small positive tilt about north shows what is east of the origin deeper.
    let [_, _, depth] = product(&rotation(&tilt), &[0.0, 1.0, 0.0]);
    assert!((depth - north).abs() < 1e-3);
}

#[test]
fn law_a_lever_shows_the_velocity_of_its_place() {
    let lever = [0.4, -0.1, 0.2];
    let distort = |state: &State<f64>| {
        let [u, v, w, p, q, r] = state.nu;
        let swept = cross(&[p, q, r], &lever);
        State { nu: [u + swept[0], v + swept[1], w + swept[2], p, q, r], ..*state }
    };
    for name in NAMES {
        undone(name, distort, |flights| flights.nuisance[0][LEVER..LATENCY].copy_from_slice(&lever));
    }
}

#[test]
fn law_a_latency_shows_the_past() {
    let dt = 0.1;
    for name in NAMES {
        let mut flights = Flights::new(name);
        let prompt = shown(&flights);
        let latency: [f64; CHANNELS] =
            std::array::from_fn(|c| dt * [0.37, 1.0, 2.5, -0.5, 40.0][c % 5] * (1.0 + c as f64 / 100.0));
        flights.nuisance[0][LATENCY..BIAS].copy_from_slice(&latency);
        let late = |rows: &Rows| -> Rows {
            let at = |k: usize, c: usize| {
                let x = k as f64 - latency[c] / dt;
                // Linear between samples, and beyond the first and the last.
                let j = x.floor().clamp(0.0, (rows.len() - 2) as f64);
                let (from, to) = (rows[j as usize][c], rows[j as usize + 1][c]);
                let rise = if c < 9 { to - from } else { (to - from).wrap() };
                from + (x - j) * rise
            };
            (0..rows.len()).map(|k| std::array::from_fn(|c| at(k, c))).collect()
        };
        let expected: Vec<Rows> = prompt.iter().map(late).collect();
        close(&shown(&flights), &expected);
        // A latency of whole samples is a shift.
        flights.nuisance[0] = [0.0; NUISANCES];
        flights.nuisance[0][LATENCY..BIAS].fill(2.0 * dt);
        for (found, prompt) in shown(&flights).iter().zip(&prompt) {
            close(&[found[2..].to_vec()], &[prompt[..prompt.len() - 2].to_vec()]);
        }
    }
}

#[test]
fn law_an_initial_condition_is_another_start() {
    let initial: [f64; INITIALS] = std::array::from_fn(|i| 0.2 * noise(70 + i));
    for name in NAMES {
        let (mut flights, mut moved) = (Flights::new(name), Flights::new(name));
        flights.initial.fill(initial);
        for segment in &mut moved.segments {
            let state = &mut segment.state;
            for i in 0..3 {
                state.position[i] += initial[i];
            }
            // About the body axes.
            let turn = normalised(&[1.0, 0.5 * initial[3], 0.5 * initial[4], 0.5 * initial[5]]);
            state.attitude = quaternion_product(&state.attitude, &turn);
            for i in 0..6 {
                state.nu[i] += initial[6 + i];
            }
        }
        close(&shown(&flights), &shown(&moved));
    }
}

#[test]
fn law_a_start_at_the_singularity_of_euler_angles_is_kept() {
    for pitch in [FRAC_PI_2, -FRAC_PI_2] {
        let (mut flights, mut moved) = (Flights::new("cwolf"), Flights::new("cwolf"));
        for segment in flights.segments.iter_mut().chain(&mut moved.segments) {
            segment.state.attitude = from_euler(&[0.7, pitch, -1.1]);
        }
        flights.initial.iter_mut().for_each(|initial| initial[0] = 0.1);
        moved.segments.iter_mut().for_each(|segment| segment.state.position[0] += 0.1);
        // Roll and yaw by themselves mean nothing there: velocities and places tell the attitude.
        let straight = |rows: Vec<Rows>| -> Vec<Rows> {
            rows.into_iter().map(|rows| rows.into_iter().map(without_angles).collect()).collect()
        };
        close(&straight(shown(&flights)), &straight(shown(&moved)));
        let unknowns = flights.unknowns();
        for segment in flights.sensitivities(&unknowns, &[0, 5, 9, 10, 11]) {
            assert!(segment.jacobian.iter().all(|x| x.is_finite()));
        }
    }
}

fn without_angles(mut row: [f64; CHANNELS]) -> [f64; CHANNELS] {
    row[9..].fill(0.0);
    row
}

#[test]
fn scalar_names_stand_in_the_order_of_the_numbers() {
    let names = nuisance_names();
    assert_eq!(names.len(), NUISANCES);
    for (first, name) in [
        (0, "current_north"),
        (TILT, "tilt_north"),
        (LEVER, "lever_x"),
        (LATENCY, "latency_u"),
        (BIAS, "bias_u"),
        (FORCE - 1, "bias_yaw"),
        (FORCE, "force_X"),
        (NUISANCES - 1, "force_N"),
    ] {
        assert_eq!(names[first], name);
    }
    for (c, channel) in CHANNEL_NAMES.iter().enumerate() {
        assert_eq!(names[LATENCY + c], format!("latency_{channel}"));
        assert_eq!(names[BIAS + c], format!("bias_{channel}"));
        assert_eq!(INITIAL_NAMES[(c + 6) % 12], format!("initial_{channel}"));
    }
}

#[test]
fn law_euler_angles_of_a_flight_come_back() {
    // What the tests above rest on: the shown angles are those of the state.
    let flights = Flights::new("beluga");
    for (rows, segment) in shown(&flights).iter().zip(&flights.segments) {
        let expected = to_euler(&segment.state.attitude);
        assert_eq!(rows[0][9..], expected);
    }
}
