//! ArduSub's controllers: what their structure promises, whatever the gains.

use crate::processor::wide;
use fearless_simd::{Simd, SimdFrom, f64x8};
use proptest::array::uniform8;
use proptest::prelude::*;
use seatrial::control::ardusub::attitude::{AngleGains, attitude_error, rates_wanted};
use seatrial::control::ardusub::cascade::Wanted;
use seatrial::control::ardusub::mixer::{FRAMES, MOTORS, Mixer};
use seatrial::control::ardusub::parameters::index;
use seatrial::control::ardusub::pid::{Gains, State, follows, square_root};
use seatrial::control::ardusub::position::{forward_and_lateral, throttle};
use seatrial::description::Description;
use seatrial::flight::ardusub::{COLUMNS, Case, Course};
use seatrial::model::integrate::State as State3;
use seatrial::model::kinematics::{from_euler, normalised, quaternion_product};
use seatrial::number::algebra::each;
use seatrial::number::lanes::{LANES, Lanes};
use seatrial::number::real::Real;
use std::sync::atomic::AtomicBool;

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

/// A course of 20 s: level at 5 m, then half a turn of a right angle, half a metre deeper, a metre to the north.
fn course_targets() -> Vec<Wanted> {
    (0..4000)
        .map(|k| {
            let after = f64::from(u8::from(k > 400));
            Wanted {
                attitude: [0.0, 0.0, 0.8 * after],
                turning: 0.0,
                position: [after, 0.0, 5.0 + 0.5 * after],
                velocity: [0.0; 3],
                acceleration: [0.0; 3],
                pilot: [0.5, 0.0, 0.0],
                controlled: [true, true],
                voltage: 16.0,
            }
        })
        .collect()
}

fn cases(count: u64) -> Vec<Case> {
    let state = State3 { position: [0.0, 0.0, 5.0], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] };
    (0..count)
        .map(|i| Case {
            coefficients: vec![-0.2 - 0.1 * i as f64],
            parameters: vec![0.15 + 0.01 * i as f64],
            state,
            integrals: [0.0; 7],
            current: [0.1, -0.05, 0.0],
            wander: [1.0, 1.0, 1.0, 0.05, 0.05, 0.05],
            tether: [-2.0, 0.0, -1.0],
            supply: [0.9, 1e-3, 0.05],
            seed: i,
        })
        .collect()
}

#[test]
fn a_vehicle_under_the_cascade_goes_where_it_is_told_and_cases_do_not_see_each_other() {
    let vehicle = seatrial::description::built_in::built_in("bluerov2-heavy").unwrap();
    let description = Description::from_toml(vehicle, "bluerov2-heavy").unwrap();
    // With these directions the built-in vehicle pushes where its frame is told.
    let mixer = Mixer { motors: FRAMES[2].1, direction: [-1.0; MOTORS], pulse: [1100.0, 1900.0] };
    let wanted = course_targets();
    let (yaw_inertia, yaw_p) =
        ([description.layout.find("N_rdot").unwrap()], [index("ATC_RAT_YAW_P").unwrap()]);
    let course = Course {
        description: &description,
        mixer: &mixer,
        wanted: &wanted,
        period: DT,
        every: 20,
        noise: [0.002, 0.005],
        wander_s: 1.0,
        tether_at: [-0.2, 0.0, -0.1],
        coefficients: &yaw_inertia,
        parameters: &yaw_p,
    };
    let (cases, stop) = (cases(9), AtomicBool::new(false));
    let together = course.fly(&cases, &stop).unwrap();
    let length = course.rows() * COLUMNS;
    for (case, rows) in cases.iter().zip(together.chunks_exact(length)) {
        let last = &rows[length - COLUMNS..];
        assert!((last[5] - 0.8).abs() < 0.1, "yaw {}", last[5]);
        assert!((last[2] - 5.5).abs() < 0.3, "depth {}", last[2]);
        assert!((last[0] - 1.0).abs() < 0.5 && last[1].abs() < 0.5, "{} {}", last[0], last[1]);
        let alone = course.fly(std::slice::from_ref(case), &stop).unwrap();
        // Lanes round otherwise: a pulse may be a whole microsecond apart now and then, the motion hardly.
        for (row, own) in rows.chunks_exact(COLUMNS).zip(alone.chunks_exact(COLUMNS)) {
            for (a, b) in row[..6].iter().zip(&own[..6]) {
                assert!((a - b).abs() < 5e-3, "{a} against {b}");
            }
        }
    }
    let halves = [course.fly(&cases[..4], &stop).unwrap(), course.fly(&cases[4..8], &stop).unwrap()].concat();
    assert_eq!(&together[..8 * length], &halves[..]);
    assert!(matches!(course.fly(&cases, &AtomicBool::new(true)), Err(seatrial::Error::Interrupted)));
}

#[test]
fn parameters_have_the_names_that_their_places_say() {
    use seatrial::control::ardusub::parameters as own;
    let name = |k: usize| own::PARAMETERS[k].0;
    assert_eq!(name(own::ANGLE), "ATC_ANG_RLL_P");
    assert_eq!(name(own::ACCELERATION + 2), "ATC_ACC_Y_MAX");
    assert_eq!(name(own::RATE), "ATC_RATE_R_MAX");
    for (axis, of) in ["RLL", "PIT", "YAW"].iter().enumerate() {
        for (k, ending) in ["P", "I", "D", "FF", "IMAX", "FLTT", "FLTE", "FLTD"].iter().enumerate() {
            assert_eq!(name(own::RATES + 8 * axis + k), format!("ATC_RAT_{of}_{ending}"));
        }
    }
    assert_eq!((name(own::DEPTH), name(own::LIFT)), ("PSC_D_POS_P", "PSC_D_ACC_P"));
    assert_eq!((name(own::PLANE), name(own::PLANE + 1)), ("PSC_NE_POS_P", "PSC_NE_VEL_P"));
    assert_eq!((name(own::LEAN), name(own::HOVER)), ("ATC_ANGLE_MAX", "MOT_THST_HOVER"));
    assert!(own::index("ATC_RAT_YAW_Q").unwrap_err().contains("ATC_RAT_YAW_"));
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
