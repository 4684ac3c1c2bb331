//! The motor chain against its analytic answers.

use crate::vehicles::{fly_from, load, moving, times, with};
use proptest::prelude::*;
use seatrial::actuator::motor::{Limits, Motor, MotorState};
use seatrial::actuator::response::{Dynamics, Response};
use seatrial::description::Description;
use seatrial::fit::inputs::Inputs;
use seatrial::fit::record::MotorStart;

const STOPPED: MotorState<f64> = MotorState { ramp: 0.0, signal: 0.0 };

/// A motor without dead time.
fn motor(k_v: f64, t_1: f64, rate: Option<[f64; 2]>) -> Motor<f64> {
    Motor { k_v, t_1, t_t: 0.0, rate, ideal: false }
}

/// The states after every step of `h` under a constant command.
fn advance(
    motor: &Motor<f64>,
    from: MotorState<f64>,
    command: f64,
    h: f64,
    count: usize,
) -> Vec<MotorState<f64>> {
    let step = motor.step(h);
    let next = |state: &mut MotorState<f64>| {
        *state = step.advance(state, command);
        Some(*state)
    };
    let mut state = from;
    std::iter::from_fn(|| next(&mut state)).take(count).collect()
}

/// The rate-limited command `t` seconds after a step from `from` to `to`: braking first.
fn ramp(from: f64, to: f64, [growth, shrink]: [f64; 2], t: f64) -> f64 {
    if to * from < 0.0 {
        let braking = from.abs() / shrink;
        return if t < braking {
            from - from.signum() * shrink * t
        } else {
            to.signum() * (growth * (t - braking)).min(to.abs())
        };
    }
    let side = if from == 0.0 { to.signum() } else { from.signum() };
    let (a, b) = (from.abs(), to.abs());
    side * if b > a { (a + growth * t).min(b) } else { (a - shrink * t).max(b) }
}

properties! {
    #![cases(128)]

    #[test]
    fn law_motor_step_response_is_exponential(
        k_v in 0.5..1.5,
        t_1 in 0.01..1.0,
        command in -2000.0..2000.0,
        h in 0.005..0.2,
    ) {
        for (k, state) in advance(&motor(k_v, t_1, None), STOPPED, command, h, 50).iter().enumerate() {
            let t = h * (k + 1) as f64;
            let expected = k_v * command * (1.0 - (-t / t_1).exp());
            // Fifty roundings of up to 3000 rpm.
            prop_assert!((state.signal - expected).abs() < 1e-10, "{} {expected}", state.signal);
        }
    }

    #[test]
    fn law_motor_without_lag_follows_at_once(k_v in 0.5..1.5, command in -2000.0..2000.0, limited in any::<bool>()) {
        let rate = limited.then_some([1500.0, 3000.0]);
        for (k, state) in advance(&motor(k_v, 0.0, rate), STOPPED, command, 0.05, 50).iter().enumerate() {
            let t = 0.05 * (k + 1) as f64;
            let reached = rate.map_or(command, |rate| ramp(0.0, command, rate, t));
            // Rounding of up to 3000 rpm.
            prop_assert!((state.signal - k_v * reached).abs() < 1e-9, "{} {}", state.signal, k_v * reached);
        }
    }

    #[test]
    fn law_motor_rate_limit_brakes_before_it_reverses(
        from in -2000.0..2000.0,
        to in -2000.0..2000.0,
        rate in proptest::array::uniform2(500.0..8000.0),
        h in 0.005..0.3,
    ) {
        let start = MotorState { ramp: from, signal: from };
        for (k, state) in advance(&motor(1.0, 0.1, Some(rate)), start, to, h, 60).iter().enumerate() {
            let expected = ramp(from, to, rate, h * (k + 1) as f64);
            // Sixty roundings of 2000 rpm; exact also where a step holds both braking and growth.
            prop_assert!((state.ramp - expected).abs() < 1e-9, "{} {expected}", state.ramp);
        }
    }

    #[test]
    fn law_motor_lag_is_exact_for_a_ramp(
        rate in 500.0..4000.0,
        t_1 in 0.02..0.5,
        h in 0.01..0.2,
        astern in any::<bool>(),
    ) {
        // A ramp that does not end within the test.
        let command = if astern { -1e6 } else { 1e6 };
        let states = advance(&motor(1.0, t_1, Some([rate, rate])), STOPPED, command, h, 20);
        for (k, state) in states.iter().enumerate() {
            let t = h * (k + 1) as f64;
            let expected = f64::signum(command) * rate * (t - t_1 * (1.0 - (-t / t_1).exp()));
            // First-order hold: rounding of up to 16000 rpm.
            prop_assert!((state.signal - expected).abs() < 1e-8, "{} {expected}", state.signal);
        }
    }

    #[test]
    fn law_motor_half_steps_make_a_step(from in -2000.0..2000.0, to in -2000.0..2000.0, t_1 in 0.0..0.5) {
        let motor = motor(0.9, t_1, None);
        let start = MotorState { ramp: from, signal: from };
        let whole = advance(&motor, start, to, 0.1, 1)[0];
        let halves = advance(&motor, start, to, 0.05, 2)[1];
        // Rounding of 2000 rpm.
        prop_assert!((whole.signal - halves.signal).abs() < 1e-11);
    }

    #[test]
    fn law_limits_clip_lift_and_drop(
        maximum in proptest::array::uniform2(500.0..2000.0),
        minimum in proptest::array::uniform2(0.0..300.0),
        dead_band in any::<bool>(),
        command in -2500.0..2500.0,
    ) {
        let limits = Limits { maximum, minimum, dead_band };
        let (most, least) = if command < 0.0 { (maximum[1], minimum[1]) } else { (maximum[0], minimum[0]) };
        let expected = if command == 0.0 {
            0.0
        } else if f64::abs(command) > most {
            f64::signum(command) * most
        } else if f64::abs(command) >= least {
            command
        } else if dead_band {
            0.0
        } else {
            f64::signum(command) * least
        };
        // Exact: limits only choose.
        prop_assert_eq!(limits.apply(command), expected);
        prop_assert_eq!(limits.apply(limits.apply(command)), limits.apply(command));
        prop_assert_eq!(limits.apply(0.0), 0.0);
    }
}

/// One signal of a vehicle's thruster SbU, in rpm, under its commands at 0.1 s.
fn signals(description: &Description, commands: Vec<f64>, start: MotorStart, substeps: usize) -> Vec<f64> {
    let inputs = Inputs {
        t: times(commands.len(), 0.1),
        commands: [("SbU".to_owned(), commands)].into(),
        ..Inputs::default()
    };
    let run = fly_from(description, &inputs, (moving([0.0; 6]), start), ("", ""), substeps);
    run.signals.iter().map(|row| row[0]).collect()
}

fn stopped() -> MotorStart {
    MotorStart::Held(vec![0.0; 6])
}

/// CWolf with an SbU of this dead time, gain and lag, without a rate limit.
fn delayed(t_t: f64, k_v: f64, t_1: f64) -> Description {
    let mut file = load("cwolf").file;
    for motor in file.motors.values_mut() {
        (motor.n_acc_per_s, motor.n_dec_per_s) = (None, None);
    }
    let unlimited = Description::new(file, "cwolf").expect("a valid file");
    with(&unlimited, &[("SbU.T_t", t_t), ("SbU.K_V", k_v), ("SbU.T_1", t_1)])
}

#[test]
fn law_dead_time_of_whole_steps_shifts_the_signal() {
    let commands: Vec<f64> = (0..60).map(|k| 150.0 + 97.0 * f64::from(k * k % 17)).collect();
    let prompt = signals(&delayed(0.0, 1.0, 0.15), commands.clone(), stopped(), 2);
    let late = signals(&delayed(0.3, 1.0, 0.15), commands, stopped(), 2);
    for k in 0..60 {
        let expected = if k < 3 { 0.0 } else { prompt[k - 3] };
        // The delay in steps, 0.3/0.05, is off six by one rounding: 1e-15 of 2000 rpm.
        assert!((late[k] - expected).abs() < 1e-9, "sample {k}: {} {expected}", late[k]);
    }
}

#[test]
fn law_dead_time_between_steps_gives_the_mean_of_the_command() {
    let commands: Vec<f64> = (0..40).map(|k| 150.0 + 97.0 * f64::from(k * k % 17)).collect();
    let late = signals(&delayed(0.13, 1.0, 0.0), commands.clone(), stopped(), 1);
    for k in 3..40 {
        // Over the step that begins at sample k the motor hears commands k-2 (30 %) and k-1 (70 %), at once.
        let expected = 0.3 * commands[k - 2] + 0.7 * commands[k - 1];
        // Rounding of 1700 rpm.
        assert!((late[k] - expected).abs() < 1e-8, "sample {k}: {} {expected}", late[k]);
    }
}

#[test]
fn law_a_motor_that_is_held_stays_where_it_is() {
    let description = delayed(0.25, 0.9, 0.15);
    let mut held = vec![0.0; 6];
    held[0] = 900.0;
    for signal in signals(&description, vec![1000.0; 40], MotorStart::Held(held), 3) {
        // Rounding: 1000 rpm times K_V = 0.9 is what it runs at, before and after the dead time.
        assert!((signal - 900.0).abs() < 1e-9, "{signal}");
    }
}

#[test]
fn law_a_segment_meets_the_motors_as_the_record_left_them() {
    let description = load("cwolf");
    let commands: Vec<f64> = (0..80).map(|k| if k % 40 < 20 { 1800.0 } else { -900.0 }).collect();
    let inputs =
        Inputs { t: times(80, 0.1), commands: [("SbU".to_owned(), commands)].into(), ..Inputs::default() };
    let record = inputs.record(&description, false, 1).unwrap();
    let run = |start: usize| {
        let segment = seatrial::fit::record::Segment {
            record: 0,
            start,
            stop: 80,
            state: moving([0.0; 6]),
            current: [0.0; 3],
            motors: MotorStart::Recorded,
        };
        let batch = seatrial::fit::batch::Batch {
            description: &description,
            records: std::slice::from_ref(&record),
            segments: &[segment],
            modes: seatrial::fit::inputs::modes("X", "").unwrap(),
            substeps: 2,
        };
        batch.track(0, &std::sync::atomic::AtomicBool::new(false)).unwrap()
    };
    let (whole, part) = (run(0), run(50));
    for k in 50..80 {
        let (a, b) = (whole.signals[k][0], part.signals[k - 50][0]);
        // Three seconds of memory: e^(-3/0.15) of 2700 rpm.
        assert!((a - b).abs() < 1e-4, "sample {k}: {a} {b}");
    }
}

#[test]
fn law_a_measured_signal_replaces_the_motor() {
    // A thrust of as many newtons as measured, on a mass that nothing else moves.
    let text = r#"
        format = 1
        name = "mass"
        [coefficients]
        m = 10.0
        I_x = 1.0
        I_y = 1.0
        I_z = 1.0
        [motors.slow]
        T_1_s = 5.0
        T_t_s = 1.0
        maximum_ahead = 1.0
        [characteristics.newtons]
        kind = "direct"
        [[thrusters]]
        name = "SbU"
        command = "N"
        wrench_per_newton = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        motor = "slow"
        characteristic = "newtons"
    "#;
    let mass = Description::from_toml(text, "mass").unwrap();
    let measured: Vec<f64> = (0..40).map(|k| 3.0 * f64::from(k * k % 17) - 20.0).collect();
    let inputs = Inputs {
        t: times(40, 0.1),
        commands: [("SbU".to_owned(), vec![100.0; 40])].into(),
        actuators: [("SbU".to_owned(), measured.clone())].into(),
        ..Inputs::default()
    };
    for substeps in [1, 3] {
        let run = fly_from(
            &mass,
            &inputs,
            (moving([0.0; 6]), MotorStart::Held(vec![0.0])),
            ("XYZKMN", ""),
            substeps,
        );
        let mut impulse = 0.0;
        for k in 0..40 {
            assert_eq!(run.signals[k][0], measured[k]);
            // Linear between samples: the trapezoid is its integral, and RK4's too, to rounding.
            assert!((10.0 * run.states[k].nu[0] - impulse).abs() < 1e-11, "sample {k}");
            impulse += if k < 39 { 0.05 * (measured[k] + measured[k + 1]) } else { 0.0 };
        }
    }
}

#[test]
fn law_dead_time_behind_a_rate_limit_shifts_the_ramp() {
    let commands: Vec<f64> = (0..60).map(|k| if k % 20 < 10 { 1500.0 } else { -700.0 }).collect();
    let limits = load("cwolf").actuators[0].limits;
    for t_t in [0.0, 0.04, 0.13, 0.1777] {
        let description = with(&load("cwolf"), &[("SbU.T_t", t_t)]);
        let values: Vec<f64> = ["K_V", "T_1", "n_acc", "n_dec"]
            .iter()
            .map(|name| {
                description.coefficients[description.layout.index(&format!("SbU.{name}")).expect("a name")]
            })
            .collect();
        let dynamics =
            Dynamics { k_v: values[0], t_1: values[1], t_t, growth: [values[2]; 2], shrink: [values[3]; 2] };
        let exact = Response::new(&times(60, 0.1), &commands, &limits, dynamics);
        let mut held = vec![0.0; 6];
        held[0] = commands[0];
        let found = signals(&description, commands.clone(), MotorStart::Held(held), 2);
        for (k, signal) in found.iter().enumerate() {
            let expected = exact.at(0.1 * k as f64);
            // Half steps of 25 ms: the kinks of the ramp, up to rate × 25 ms² / (8 T_1) each, 2 rpm; a delay in whole steps
            // would be off by up to 4000 rpm/s × 25 ms = 100 rpm.
            assert!((signal - expected).abs() < 6.0, "T_t {t_t}, sample {k}: {signal} {expected}");
        }
    }
}
