//! ArduSub's controllers: what their structure promises, whatever the gains.

use crate::processor::wide;
use fearless_simd::{Simd, SimdFrom, f64x8};
use proptest::array::uniform8;
use proptest::prelude::*;
use seatrial::control::ardusub::attitude::{AngleGains, attitude_error, limited_rates, rates_wanted};
use seatrial::control::ardusub::cascade::{Cascade, Memory, Told, Wanted};
use seatrial::control::ardusub::mixer::{FRAMES, MOTORS, Mixer};
use seatrial::control::ardusub::parameters::{defaults, index};
use seatrial::control::ardusub::pid::{
    Gains, State, follows, free, inverse_square_root, off_its_stops, square_root, towards_zero,
};
use seatrial::control::ardusub::position::{
    forward_and_lateral, limited_acceleration, plane_integrals, throttle,
};
use seatrial::control::ardusub::shaping::{Shaping, Target};
use seatrial::description::Description;
use seatrial::flight::ardusub::{COLUMNS, Case, Course};
use seatrial::model::integrate::State as State3;
use seatrial::model::kinematics::{from_euler, normalised, quaternion_product, to_euler};
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
fn the_integrator_stops_at_its_limit_and_goes_towards_zero_only_while_the_actuators_are_at_theirs() {
    let (gains, mut state) = (gains(0.1, 1.0, 0.0), State::at_rest(0.0));
    for _ in 0..1000 {
        state.step(&gains, 1.0, 0.0, DT, free);
    }
    assert_eq!(state.integrator, 0.4);
    let after = |integrator: f64, target: f64| {
        let mut state = State::at_rest(0.0).with_integrator(integrator);
        state.step(&gains, target, 0.0, DT, towards_zero(true));
        state.integrator
    };
    assert_eq!(after(0.1, 1.0), 0.1);
    assert_eq!(after(0.1, -1.0), 0.1 - DT);
    // Zero is neither above nor below: it stays.
    assert_eq!((after(0.0, 1.0), after(0.0, -1.0)), (0.0, 0.0));
    let between = |lower: bool, upper: bool, target: f64| {
        let mut state = State::at_rest(0.0);
        state.step(&gains, target, 0.0, DT, off_its_stops(lower, upper));
        state.integrator
    };
    assert_eq!((between(true, false, -1.0), between(true, false, 1.0)), (0.0, DT));
    assert_eq!((between(false, true, -1.0), between(false, true, 1.0)), (-DT, 0.0));
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
        let mixer = Mixer::of(name, [1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap();
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
                shaped: true,
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
    let mixer = Mixer::of("Vectored_6DOF", [-1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap();
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

/// A vehicle that neither turns nor moves, level at the origin.
fn still() -> Told<f64> {
    Told {
        attitude: from_euler(&[0.0; 3]),
        heading: 0.0,
        gyro: [0.0; 3],
        position: [0.0; 3],
        velocity: [0.0; 3],
        sinking: 0.0,
    }
}

/// The controllers with ArduSub's defaults, but for some.
fn cascade(own: &[(&str, f64)]) -> Cascade<f64> {
    let mut values = defaults();
    for (name, value) in own {
        values[index(name).unwrap()] = *value;
    }
    Cascade::new(&values)
}

/// Targets at rest, without control of depth and place.
fn targets() -> Wanted {
    let row: [f64; 20] = std::array::from_fn(|k| if k == 13 { 0.5 } else { 0.0 });
    Wanted::of(&row)
}

#[test]
fn law_roll_pitch_yaw_integrate_on_when_the_motors_are_asked_for_more_than_all() {
    let law = cascade(&[]);
    // Forward and lateral together ask the motors of the plane for twice of all, throttle those of the tilt for all of it.
    let mut wanted = targets();
    (wanted.pilot, wanted.attitude) = ([0.99, 1.0, 1.0], [0.01, 0.02, 0.03]);
    let mut memory = Memory::new(&[0.0; 7]);
    let first = law.step(&mut memory, &wanted, &still(), DT);
    let mixer = Mixer::of("Vectored_6DOF", [1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap();
    let (_, load) = mixer.loaded_thrusts(&first);
    assert!(load[0] > 1.0 && load[1] > 1.9, "{load:?}");
    let steps = 400;
    let last = (0..steps).fold(first, |_, _| law.step(&mut memory, &wanted, &still(), DT));
    // The rate wanted is 6 times the error of the angle and does not change: what is gained is the integral part.
    let error = attitude_error(&from_euler(&wanted.attitude), &from_euler(&[0.0; 3])).about;
    for (axis, i) in [0.09, 0.09, 0.018].into_iter().enumerate() {
        let gained = i * 6.0 * error[axis] * DT * f64::from(steps);
        assert!((last[axis] - first[axis] - gained).abs() < 1e-9, "axis {axis}: {last:?} {gained}");
    }
}

#[test]
fn law_vertical_integrals_stop_at_exactly_full_throttle_and_nowhere_before() {
    let law = cascade(&[("PSC_D_ACC_I", 0.5), ("PSC_D_VEL_I", 2.0)]);
    // The throttle demand at once, and the one that is left two seconds after an error that lasted for some steps.
    let left = |depth: f64, tilted: f64, steps: usize| {
        let (mut memory, mut wanted) = (Memory::new(&[0.0; 7]), targets());
        (wanted.controlled, wanted.position[2]) = ([true, false], depth);
        wanted.attitude[0] = tilted;
        let first = law.step(&mut memory, &wanted, &still(), DT)[3];
        for _ in 0..steps {
            law.step(&mut memory, &wanted, &still(), DT);
        }
        wanted.position[2] = 0.0;
        (first, (0..400).fold(first, |_, _| law.step(&mut memory, &wanted, &still(), DT)[3]))
    };
    // Half a metre asks for 0.5 · 3 · 8 · 0.05 = 0.6 of the throttle: full, up and down. However long, nothing is
    // integrated but in the first period, whose mixer has not seen it.
    for depth in [0.5, -0.5] {
        let ((first, short), (_, long)) = (left(depth, 0.0, 200), left(depth, 0.0, 2000));
        assert_eq!(first, -depth.signum());
        assert!((long - short).abs() < 1e-9, "{short} {long}");
    }
    // Two centimetres are far from full; the motors are not, as roll asks for more than all of them.
    let ((first, short), (_, long)) = (left(0.02, 0.9, 20), left(0.02, 0.9, 200));
    assert!(first.abs() < 0.1 && long - short < -0.1, "{first} {short} {long}");
}

#[test]
fn law_integrals_of_the_plane_stop_where_the_lean_angle_does() {
    let law = cascade(&[("PSC_NE_VEL_IMAX", 30.0)]);
    let integrated = |north: f64, steps: usize| {
        let (mut memory, mut wanted) = (Memory::new(&[0.0; 7]), targets());
        (wanted.controlled, wanted.position[0]) = ([false, true], north);
        for _ in 0..steps {
            law.step(&mut memory, &wanted, &still(), DT);
        }
        wanted.position[0] = 0.0;
        (0..400).fold(0.0, |_, _| law.step(&mut memory, &wanted, &still(), DT)[4])
    };
    // 12 m ask for 12 m/s², more than g tan 45°: however long, no more is integrated.
    let (short, long) = (integrated(12.0, 200), integrated(12.0, 2000));
    assert!((long - short).abs() < 1e-9, "{short} {long}");
    // 4 m leave 5.8 m/s², which 10 s of integration reach; what the filtered error adds while it fades is 1 % of it.
    let some = (9.80665f64 - 4.0).atan2(9.80665) / 45f64.to_radians();
    assert!((integrated(4.0, 2000) - some).abs() < 0.02, "{} {some}", integrated(4.0, 2000));
    let (within, limited) = limited_acceleration(&[30.0, 40.0], &[0.0, 0.0], 45f64.to_radians());
    assert!(limited && (within[0] - 0.6 * 9.80665).abs() < 1e-9 && (within[1] - 0.8 * 9.80665).abs() < 1e-9);
    // Under way what is across comes first.
    let (within, _) = limited_acceleration(&[30.0, 5.0], &[0.4, 0.0], 45f64.to_radians());
    assert!(
        (within[1] - 5.0).abs() < 1e-9 && (within[0].hypot(within[1]) - 9.80665).abs() < 1e-9,
        "{within:?}"
    );
    let stopped = plane_integrals(&[3.0, 4.0], &[3.3, 4.4], &[1.0, 1.0], 9.0);
    assert!((stopped[0] - 3.0).abs() < 1e-12 && (stopped[1] - 4.0).abs() < 1e-12, "{stopped:?}");
    assert_eq!(plane_integrals(&[3.0, 4.0], &[2.7, 3.6], &[1.0, 1.0], 9.0), [2.7, 3.6]);
}

#[test]
fn law_a_target_never_leads_a_vehicle_that_cannot_turn_by_more_than_the_bound() {
    // (ATC_RAT_YAW_P, bound): 45°; 1 / (6 · 3) rad, where the line saturates; the root with 10°/s².
    let root = 10f64.to_radians();
    let slow = 2.0f64.powi(2) / (2.0 * root) + root / (2.0 * 6.0 * 6.0);
    for (rate_p, most, bound) in [
        (0.18, 1100.0, 45f64.to_radians()),
        (3.0, 1100.0, 1.0 / 18.0),
        (0.5, 20.0, slow.min(45f64.to_radians())),
    ] {
        let law = cascade(&[("ATC_RAT_YAW_P", rate_p), ("ATC_ACC_Y_MAX", most)]);
        let (mut memory, mut wanted) = (Memory::new(&[0.0; 7]), targets());
        (wanted.shaped, wanted.attitude[2]) = (true, 2.5);
        for _ in 0..2000 {
            law.step(&mut memory, &wanted, &still(), DT);
        }
        let lead = to_euler(&memory.target().unwrap())[2];
        assert!((lead - bound).abs() < 1e-6, "{rate_p}: {lead} for {bound}");
        // A vehicle that was carried to where the target waits finds it there, not at 2.5 rad.
        let carried = Told { attitude: from_euler(&[0.0, 0.0, lead]), heading: lead, ..still() };
        wanted.attitude[2] = lead;
        law.step(&mut memory, &wanted, &carried, DT);
        assert!((to_euler(&memory.target().unwrap())[2] - lead).abs() < 0.02);
    }
}

#[test]
fn law_a_step_is_shaped_at_the_input() {
    let degrees = |x: f64| x.to_radians();
    let shaping = Shaping {
        time: 0.15,
        slew: degrees(60.0),
        acceleration: [degrees(200.0); 3],
        rate: [0.0; 3],
        fed_forward: true,
    };
    for (axis, size, most) in
        [(2, 90.0, 60.0), (2, -170.0, 60.0), (0, 40.0, f64::INFINITY), (1, -30.0, f64::INFINITY)]
    {
        let mut target = Target::at(&from_euler(&[0.0; 3]));
        let mut asked = [0.0; 3];
        asked[axis] = degrees(size);
        let (mut before, mut angle, mut fastest) = (0.0, 0.0, 0.0f64);
        for k in 0..1400 {
            shaping.step(&mut target, &asked, DT);
            let rate = target.turning[axis];
            assert!(
                (rate - before).abs() <= degrees(200.0) * DT + 1e-12,
                "{axis} at {k}: {before} to {rate}"
            );
            assert!(to_euler(&target.attitude)[axis].abs() <= degrees(size.abs()) * 1.01);
            (before, angle, fastest) = (rate, to_euler(&target.attitude)[axis], fastest.max(rate.abs()));
        }
        assert!((angle - asked[axis]).abs() < 1e-6, "{axis}: {angle} for {}", asked[axis]);
        assert!(fastest <= degrees(most) + 1e-12 && fastest > degrees(40.0), "{fastest}");
    }
    // Not fed forward the target jumps, but for yaw, which is slewed.
    let jumps = Shaping { fed_forward: false, ..shaping };
    let mut target = Target::at(&from_euler(&[0.0; 3]));
    jumps.step(&mut target, &[degrees(20.0), 0.0, degrees(90.0)], DT);
    let [roll, _, yaw] = to_euler(&target.attitude);
    assert!((roll - degrees(20.0)).abs() < 1e-12 && (yaw - degrees(0.3)).abs() < 1e-12, "{roll} {yaw}");
}

#[test]
fn frames_meet_their_limits_as_ardusub_does() {
    let of = |frame: &str| Mixer::of(frame, [1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap();
    // Forward and yaw together: scaled down in the frame of eight motors, cut off motor by motor in the others.
    let demands = [0.0, 0.0, 0.5, 0.0, 1.0, 0.0];
    let scaled = of("Vectored_6DOF").thrusts(&demands);
    assert_eq!(scaled[..4], [-0.5 / 1.5, -1.0, 0.5 / 1.5, 1.0]);
    let alone = of("Vectored").thrusts(&demands);
    assert_eq!(alone[..4], [-0.5, -1.0, 0.5, 1.0]);
    // Full speed ahead while the verticals push with 0.4: the two motors at the rear have 0.6 left, astern the others.
    for (forward, expected) in [(1.0, [-1.0, -1.0, 0.6, 0.6]), (-1.0, [0.6, 0.6, -1.0, -1.0])] {
        let coupled = of("Vectored").thrusts(&[0.0, 0.0, 0.0, -0.4, forward, 0.0]);
        for (thrust, wanted) in coupled.iter().zip(expected) {
            assert!((thrust - wanted).abs() < 1e-12, "{coupled:?}");
        }
    }
    let known = Mixer::of("Vectored_5", [1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap_err();
    assert!(known.contains("expected one of BlueROV1, Vectored, "), "{known}");
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
    fn law_the_inverse_gives_the_error_of_a_rate(
        rate in 0.01..6.0f64, gain in 0.5..10.0f64, limit in 0.05..10.0f64,
    ) {
        let error = inverse_square_root(rate, gain, limit);
        prop_assert!((square_root(error, gain, limit, 0.0) / rate - 1.0).abs() < 1e-9);
    }

    #[test]
    fn law_rates_stay_within_their_bounds(
        rates in proptest::array::uniform3(-5.0..5.0f64), most in proptest::array::uniform3(0.1..3.0f64),
        given in proptest::array::uniform3(any::<bool>()),
    ) {
        let bounds: [f64; 3] = std::array::from_fn(|k| if given[k] { most[k] } else { 0.0 });
        let within = limited_rates(&rates, &bounds);
        for axis in 0..3 {
            let free = !given[axis];
            prop_assert!(free && within[axis] == rates[axis] || !free && within[axis].abs() <= most[axis] + 1e-12);
        }
        if given[0] && given[1] {
            prop_assert!((within[0] / most[0]).hypot(within[1] / most[1]) <= 1.0 + 1e-12);
            prop_assert!((within[0] * rates[1] - within[1] * rates[0]).abs() < 1e-9);
        }
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
        let found = attitude_error(&turned([0.0, 0.0, yaw]), &attitude);
        prop_assert!((found.about[2] - yaw).abs() < 1e-9 && found.tilt.abs() < 1e-7, "{found:?}");
        let found = attitude_error(&turned([roll, pitch, 0.0]), &attitude);
        let (tilting, tilt) = (found.about, found.tilt);
        prop_assert!((tilting[0] - roll).abs() < 1e-9 && (tilting[1] - pitch).abs() < 1e-9 && tilting[2].abs() < 1e-9);
        prop_assert!((tilt - roll.hypot(pitch)).abs() < 1e-9);
    }

    #[test]
    fn law_small_errors_turn_in_proportion_and_the_target_leads(
        error in -0.02..0.02f64, axis in 0..3usize, rate in -0.5..0.5f64,
    ) {
        let gains = AngleGains { p: [6.0; 3], acceleration: [19.2; 3], rate: [0.0; 3], yaw_rate_p: 0.18 };
        let (mut euler, mut turning) = ([0.0; 3], [0.0; 3]);
        (euler[axis], turning[axis]) = (error, rate);
        let level = from_euler(&[0.0; 3]);
        let rates = rates_wanted(&gains, &from_euler(&euler), &turning, &level, &[0.0; 3], DT).rates;
        prop_assert!((rates[axis] - 6.0 * error - rate).abs() < 1e-9, "{rates:?}");
    }

    #[test]
    fn law_a_mixer_never_asks_for_more_than_all(
        demands in proptest::array::uniform6(-3.0..3.0f64), frame in 0..7usize,
    ) {
        let mixer = Mixer::of(FRAMES[frame].0, [-1.0; MOTORS], [1100.0, 1900.0], 1.0).unwrap();
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
    let angles = AngleGains {
        p: [six; 3],
        acceleration: [roll.splat(19.2), zero, six],
        rate: [zero; 3],
        yaw_rate_p: roll.splat(0.5),
    };
    let (wanted, level) = (from_euler(&[roll, roll * 0.5, yaw]), from_euler(&[zero, roll * 0.3, zero]));
    let mut moves = Target::at(&level);
    let shaping = Shaping {
        time: roll.splat(0.15),
        slew: roll.splat(1.0),
        acceleration: [roll.splat(4.0), six, six],
        rate: [zero, six, roll.splat(0.8)],
        fed_forward: true,
    };
    for _ in 0..3 {
        shaping.step(&mut moves, &[roll, roll * 0.5, yaw], DT);
    }
    let wanted = quaternion_product(&wanted, &moves.attitude);
    let rates =
        rates_wanted(&angles, &wanted, &[target, zero, moves.turning[2]], &level, &[zero; 3], DT).rates;
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
        output = state.step(&gains, rates[0], value, DT, towards_zero(target.lt(zero))).output();
    }
    [rates[0], rates[1], rates[2], output]
}
