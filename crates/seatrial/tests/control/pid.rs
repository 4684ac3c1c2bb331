//! The PID controller of one loop: what the adaptive controller promises.

use proptest::prelude::*;
use seatrial::control::control_law::{AntiWindup, HEADING, Situation};
use seatrial::control::pid::{Pid, PidState};
use seatrial::control::schedule::{POINTS, Schedule};

const DT: f64 = 0.1;

fn situation(error: f64, rate: f64) -> Situation<f64> {
    let mut situation = Situation {
        dt: DT,
        speed: 1.0,
        error: [0.0; 6],
        rate: [0.0; 6],
        reference_rate: [0.0; 6],
        velocity: [0.0; 6],
        attitude: [0.0; 3],
        feed_forward: [0.0; 6],
        achieved: [0.0; 6],
        active: [1.0; 6],
        entered: [0.0; 6],
    };
    situation.error[HEADING] = error;
    situation.rate[HEADING] = rate;
    situation
}

fn pid(k_p: f64, k_i: f64, k_d: f64, tau_max: f64, anti_windup: AntiWindup) -> Pid<f64> {
    Pid { k_p: [k_p; POINTS], k_i: [k_i; POINTS], k_d: [k_d; POINTS], tau_max, anti_windup }
}

fn schedule() -> Schedule {
    Schedule::new([-5.0, -3.0, -1.0, 1.0, 3.0, 5.0]).expect("increasing")
}

/// A double integrator of inertia 100 kg m² behind a limit, under a constant load; the course of the angle.
fn turn(pid: &Pid<f64>, reference: f64, load: f64, limit: f64, seconds: f64) -> Vec<f64> {
    let (mut state, mut angle, mut rate, mut achieved) = (PidState::at_rest(0.0), 0.0, 0.0, 0.0);
    let weights = schedule().weights(1.0);
    let mut course = Vec::new();
    for _step in 0..(seconds / DT) as usize {
        let mut s = situation(reference - angle, rate);
        s.achieved[HEADING] = achieved;
        let demand = pid.step(&mut state, &s, &weights, HEADING);
        achieved = demand.clamp(-limit, limit);
        rate += DT * (achieved + load) / 100.0;
        angle += DT * rate;
        course.push(angle);
    }
    course
}

properties! {
    #![cases(256)]

    /// Whatever was reached before a loop enters, its first demand continues from there.
    #[test]
    fn law_pid_enters_without_a_bump(
        error in -1.0..1.0f64, rate in -0.2..0.2f64, known in -5.0..5.0f64, reached in -40.0..40.0f64,
    ) {
        // The preset must fit into ±τ_max: |reached| + |K_P e| + |K_D y'| + |known| <= 40 + 30 + 40 + 5.
        let pid = pid(30.0, 1.0, 200.0, 200.0, AntiWindup::BackCalculation);
        let mut s = situation(error, rate);
        s.feed_forward[HEADING] = known;
        s.achieved[HEADING] = reached;
        s.entered[HEADING] = 1.0;
        let demand = pid.step(&mut PidState::at_rest(0.0), &s, &schedule().weights(1.0), HEADING);
        prop_assert!((demand - reached).abs() < 1e-12 * 200.0); // rounding
    }

    /// A change of K_I does not move the demand, and a settled loop does not feel any change of gain: with the
    /// gain over a raw sum of errors it would jump by the ratio of the gains (the paper's equation 54).
    #[test]
    fn law_pid_does_not_jump_with_its_gain(error in 0.05..1.0f64, steps in 1usize..50, ratio in 0.2..5.0f64) {
        let mut pid = pid(30.0, 1.0, 0.0, 1e6, AntiWindup::None);
        for i in 0..POINTS {
            pid.k_i[i] = if i < 3 { 1.0 } else { ratio };
        }
        let mut state = PidState::at_rest(0.0);
        let s = situation(error, 0.0);
        let mut last = 0.0;
        for _step in 0..steps {
            last = pid.step(&mut state, &s, &schedule().weights(-1.0), HEADING);
        }
        let next = pid.step(&mut state, &s, &schedule().weights(1.0), HEADING);
        // One step of integration with the old gain, no more.
        prop_assert!((next - last - DT * 1.0 * error).abs() < 1e-9);
    }

    /// An inactive loop demands nothing and remembers nothing.
    #[test]
    fn law_pid_rests_when_it_is_not_at_work(error in -1.0..1.0f64) {
        let pid = pid(30.0, 1.0, 200.0, 60.0, AntiWindup::BackCalculation);
        let mut state = PidState::at_rest(0.0);
        state.integral = 7.0;
        let mut s = situation(error, 0.1);
        s.active[HEADING] = 0.0;
        prop_assert_eq!(pid.step(&mut state, &s, &schedule().weights(1.0), HEADING), 0.0);
        prop_assert_eq!(state.integral, 0.0);
    }
}

/// A constant load is taken over by the integral.
#[test]
fn law_pid_removes_a_constant_load() {
    let pid = pid(30.0, 3.0, 90.0, 60.0, AntiWindup::BackCalculation);
    let course = turn(&pid, 0.5, 10.0, 60.0, 300.0);
    let last = course.last().expect("a course");
    assert!((last - 0.5).abs() < 1e-6, "{last}"); // 300 s are 30 integral times
}

/// Behind a tight limit both kinds of anti-windup overshoot far less than none.
#[test]
fn law_pid_does_not_wind_up() {
    let overshoot = |kind: AntiWindup| {
        let course = turn(&pid(30.0, 3.0, 120.0, 60.0, kind), 2.0, 0.0, 3.0, 200.0);
        (course.iter().fold(0.0, |a: f64, b| a.max(*b)) - 2.0) / 2.0
    };
    let without = overshoot(AntiWindup::None);
    for kind in [AntiWindup::BackCalculation, AntiWindup::Conditional] {
        let with = overshoot(kind);
        assert!(with < 0.5 * without, "{kind:?}: {with:.3} against {without:.3}");
    }
    assert!(without > 0.2, "the case must wind up without protection, found {without:.3}");
}

/// Where the actuators reach nothing of a small demand (the dead band of a propeller), the error that is left is the
/// missing force over K_P, and the integral rests: no limit cycle.
#[test]
fn law_pid_rests_inside_a_dead_band() {
    let pid = pid(30.0, 3.0, 90.0, 60.0, AntiWindup::BackCalculation);
    let (mut state, weights) = (PidState::at_rest(0.0), schedule().weights(1.0));
    let mut demand = 0.0;
    for _step in 0..2000 {
        // A constant error of 10 mrad, and nothing is reached.
        demand = pid.step(&mut state, &situation(0.01, 0.0), &weights, HEADING);
    }
    // I' = K_I e − K_I/K_P τ = 0 at τ = K_P e: the demand stays at the proportional one.
    assert!((demand - 0.3).abs() < 1e-6, "{demand}");
}
