//! ArduSub's controllers: what their structure promises, whatever the gains.

use crate::processor::wide;
use fearless_simd::{Simd, SimdFrom, f64x8};
use proptest::array::uniform8;
use proptest::prelude::*;
use seatrial::control::ardusub::attitude::{AngleGains, attitude_error, rates_wanted};
use seatrial::control::ardusub::mixer::{FRAMES, MOTORS, Mixer};
use seatrial::control::ardusub::pid::{Gains, State, follows, square_root};
use seatrial::control::ardusub::position::{forward_and_lateral, throttle};
use seatrial::model::kinematics::{from_euler, normalised, quaternion_product};
use seatrial::number::algebra::each;
use seatrial::number::lanes::{LANES, Lanes};
use seatrial::number::real::Real;

const DT: f64 = 0.005;

fn gains(p: f64, i: f64, d: f64) -> Gains<f64> {
    Gains { p, i, d, ff: 0.0, d_ff: 0.0, i_max: 0.4, target_hz: 0.0, error_hz: 0.0, derivative_hz: 30.0 }
}

#[test]
fn a_filter_follows_by_63_percent_after_its_time_constant() {
    let cut_off = 2.0;
    let steps = (1.0 / (std::f64::consts::TAU * cut_off) / 1e-4).round() as usize;
    let reached = (0..steps).fold(0.0, |x, _| x + (1.0 - x) * follows(cut_off, 1e-4));
    assert!((reached - (1.0 - (-1.0f64).exp())).abs() < 1e-3, "{reached}");
    assert_eq!(follows(0.0, DT), 1.0);
}

#[test]
fn the_integrator_stops_at_its_limit_and_goes_back_while_the_actuators_are_at_theirs() {
    let (gains, mut state) = (gains(0.1, 1.0, 0.0), State::at_rest(0.0));
    for _ in 0..1000 {
        state.step(&gains, 1.0, 0.0, DT, false);
    }
    assert_eq!(state.integrator, 0.4);
    let mut held = State::at_rest(0.0).with_integrator(0.1);
    held.step(&gains, 1.0, 0.0, DT, true);
    assert_eq!(held.integrator, 0.1);
    held.step(&gains, -1.0, 0.0, DT, true);
    assert!(held.integrator < 0.1);
}

#[test]
fn a_lean_angles_share_is_forward_and_lateral() {
    let limit = 45f64.to_radians();
    let [forward, lateral] = forward_and_lateral(&[0.0, 9.80665], 90f64.to_radians(), limit);
    assert!((forward - 1.0).abs() < 1e-12 && lateral.abs() < 1e-12, "{forward} {lateral}");
    let [forward, lateral] = forward_and_lateral(&[0.0, 1.0], 0.0, limit);
    assert!(forward.abs() < 1e-12 && (lateral - (1.0f64 / 9.80665).atan() / limit).abs() < 1e-12);
    assert_eq!(throttle(2.0, 0.5), 0.0);
}

#[test]
fn every_frame_pushes_where_it_is_told() {
    for (name, motors) in FRAMES {
        let mixer = Mixer { motors, direction: [1.0; MOTORS], pulse: [1100.0, 1900.0] };
        for axis in 0..6 {
            let mut demands = [0.0; 6];
            demands[axis] = 0.5;
            let thrusts = mixer.thrusts(&demands);
            let given: f64 = motors.iter().zip(thrusts).map(|(shares, thrust)| shares[axis] * thrust).sum();
            let can = motors.iter().any(|shares| shares[axis] != 0.0);
            assert_eq!(given > 0.0, can, "{name} {axis}");
            assert!(thrusts.iter().all(|thrust| thrust.abs() <= 0.5), "{name} {axis}");
        }
        assert_eq!(mixer.pulse(0.0), 1500.0);
        assert_eq!((mixer.pulse(1.0), mixer.pulse(-1.0)), (1900.0, 1100.0));
    }
}

properties! {
    #![cases(200)]

    #[test]
    fn law_the_square_root_meets_the_line_and_never_passes_the_target(
        error in -4.0..4.0f64, gain in 0.5..10.0f64, limit in 0.05..10.0f64,
    ) {
        let rate = square_root(error, gain, limit, DT);
        prop_assert!(rate * error >= 0.0);
        prop_assert!(rate.abs() <= (gain * error.abs()).min(error.abs() / DT) + 1e-12);
        let edge = limit / (gain * gain);
        let (below, above) = (square_root(edge * (1.0 - 1e-9), gain, limit, 0.0), square_root(edge * (1.0 + 1e-9), gain, limit, 0.0));
        prop_assert!((above - below).abs() < 1e-6 * below, "{below} {above}");
        // The slope along the way back is the limit: v dv/de = a.
        let (near, far) = (edge * 2.0, edge * 2.0 + 1e-6);
        let (v, w) = (square_root(near, gain, limit, 0.0), square_root(far, gain, limit, 0.0));
        prop_assert!(((w * w - v * v) / 2e-6 / limit - 1.0).abs() < 1e-4);
    }

    #[test]
    fn law_an_error_is_the_turn_that_removes_it(
        roll in -1.0..1.0f64, pitch in -1.0..1.0f64, yaw in -3.0..3.0f64, from in -3.0..3.0f64,
    ) {
        let attitude = from_euler(&[0.3, -0.2, from]);
        let turned = |e: [f64; 3]| {
            let angle = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]).sqrt().max(1e-15);
            let (sine, cosine) = (0.5 * angle).sin_cos();
            normalised(&quaternion_product(&attitude, &[cosine, e[0] / angle * sine, e[1] / angle * sine, e[2] / angle * sine]))
        };
        // About down alone, or tilting alone, the error is the turn itself.
        let (about_down, tilt) = attitude_error(&turned([0.0, 0.0, yaw]), &attitude);
        prop_assert!((about_down[2] - yaw).abs() < 1e-9 && tilt.abs() < 1e-7, "{about_down:?}");
        let (tilting, tilt) = attitude_error(&turned([roll, pitch, 0.0]), &attitude);
        prop_assert!((tilting[0] - roll).abs() < 1e-9 && (tilting[1] - pitch).abs() < 1e-9 && tilting[2].abs() < 1e-9);
        prop_assert!((tilt - roll.hypot(pitch)).abs() < 1e-9);
    }

    #[test]
    fn law_small_errors_turn_in_proportion_and_the_target_leads(
        error in -0.02..0.02f64, axis in 0..3usize, rate in -0.5..0.5f64,
    ) {
        let gains = AngleGains { p: [6.0; 3], acceleration: [19.2; 3], rate: [0.0; 3] };
        let (mut euler, mut turning) = ([0.0; 3], [0.0; 3]);
        (euler[axis], turning[axis]) = (error, rate);
        let level = from_euler(&[0.0; 3]);
        let rates = rates_wanted(&gains, &from_euler(&euler), &turning, &level, &[0.0; 3], DT);
        prop_assert!((rates[axis] - 6.0 * error - rate).abs() < 1e-9, "{rates:?}");
    }

    #[test]
    fn law_a_mixer_never_asks_for_more_than_all(
        demands in proptest::array::uniform6(-3.0..3.0f64), frame in 0..7usize,
    ) {
        let mixer = Mixer { motors: FRAMES[frame].1, direction: [-1.0; MOTORS], pulse: [1100.0, 1900.0] };
        for thrust in mixer.thrusts(&demands) {
            prop_assert!(thrust.abs() <= 1.0);
            let pulse = mixer.pulse(thrust);
            prop_assert!((1100.0..=1900.0).contains(&pulse) && pulse.fract() == 0.0);
        }
    }

    #[test]
    fn law_lanes_are_the_plain_numbers(
        roll in uniform8(-1.2..1.2f64), yaw in uniform8(-3.0..3.0f64), target in uniform8(-2.0..2.0f64),
    ) {
        let Some(simd) = wide() else { return Ok(()) };
        let found: [[f64; LANES]; 4] = simd.vectorize(
            #[inline(always)]
            || {
                let lane = |x: [f64; LANES]| -> Lanes<_> { f64x8::simd_from(simd, x) };
                one_step(lane(roll), lane(yaw), lane(target)).map(Into::into)
            },
        );
        for lane in 0..LANES {
            let alone = one_step(roll[lane], yaw[lane], target[lane]);
            for k in 0..4 {
                let (a, b) = (found[k][lane], alone[k]);
                prop_assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{k} in lane {lane}: {a} against {b}");
            }
        }
    }
}

/// Rates wanted, and the output of a controller after three steps towards the first of them.
#[inline(always)]
fn one_step<T: Real>(roll: T, yaw: T, target: T) -> [T; 4] {
    let (zero, six) = (roll.zero(), roll.splat(6.0));
    let angles = AngleGains { p: [six; 3], acceleration: [roll.splat(19.2), zero, six], rate: [zero; 3] };
    let (wanted, level) = (from_euler(&[roll, roll * 0.5, yaw]), from_euler(&[zero, roll * 0.3, zero]));
    let rates = rates_wanted(&angles, &wanted, &[target, zero, target], &level, &[zero; 3], DT);
    let gains = gains(0.135, 0.09, 0.0036);
    let gains = Gains {
        p: zero + gains.p,
        i: zero + gains.i,
        d: zero + gains.d,
        ff: zero,
        d_ff: zero,
        i_max: zero + gains.i_max,
        target_hz: gains.target_hz,
        error_hz: gains.error_hz,
        derivative_hz: gains.derivative_hz,
    };
    let mut state = State::at_rest(roll);
    let measured = each(&[zero, target, rates[0]], |x| x * 0.5);
    let mut output = zero;
    for value in measured {
        output = state.step(&gains, rates[0], value, DT, target.lt(zero)).output();
    }
    [rates[0], rates[1], rates[2], output]
}
