//! All motors and servos of a vehicle at work, half a step at a time, and what their signals do.
//!
//! Open loop ([`crate::fit::motors`]) and closed loop ([`crate::flight`]) move the same motors; they
//! differ in where the targets come from, a record or an autopilot.
//!
//! Tests: `tests/laws/motor.rs`, `tests/closed_loop.rs`.

use crate::actuator::interact;
use crate::actuator::motor::{DeadTime, MotorState, MotorStep};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::real::Real;

/// Where the dead time of a motor without rate limit is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnlimitedDelay {
    /// By the caller, who reads a record earlier.
    InTheRecord,
    /// Here: the past of the command, linear between half steps.
    InTheDrive,
}

/// The motors of a vehicle.
#[derive(Clone)]
pub struct Drive<T> {
    half_steps: Vec<MotorStep<T>>,
    dead_times: Vec<Option<DeadTime<T>>>,
    /// Where each motor is.
    pub states: Vec<MotorState<T>>,
}

crate::memory!(Drive: states, dead_times; half_steps);

impl<T: Real> Drive<T> {
    /// The motors for steps of `h` seconds, standing as `start` says.
    #[inline(always)]
    pub fn new(
        vehicle: &Vehicle<T>,
        h: f64,
        delay: UnlimitedDelay,
        start: impl Fn(usize) -> MotorState<T>,
    ) -> Self {
        let count = vehicle.actuators.len() + vehicle.fins.len();
        let mut drive = Self {
            half_steps: Vec::with_capacity(count),
            dead_times: Vec::with_capacity(count),
            states: Vec::with_capacity(count),
        };
        for i in 0..count {
            let (motor, state) = (vehicle.motor(i), start(i));
            let kept = motor.rate.is_some() || delay == UnlimitedDelay::InTheDrive;
            let late = kept && !motor.t_t.equals(motor.t_t.zero());
            drive.half_steps.push(motor.step(0.5 * h));
            drive.dead_times.push(late.then(|| DeadTime::new(motor.t_t * (2.0 / h), state.ramp)));
            drive.states.push(state);
        }
        drive
    }

    /// Sets motor `i` to the steady state of `target`; behind a dead time `past` gives the ramp so many half steps
    /// ago.
    #[inline(always)]
    pub fn settle(&mut self, vehicle: &Vehicle<T>, i: usize, target: T, past: impl Fn(usize) -> T) {
        self.states[i] = vehicle.motor(i).steady(target);
        if let Some(dead_time) = &mut self.dead_times[i] {
            self.states[i].signal = vehicle.motor(i).k_v * dead_time.settle(past);
        }
    }

    /// Gives motor `i` a past: behind a dead time `past` is the ramp so many half steps ago.
    #[inline(always)]
    pub fn remember(&mut self, i: usize, past: impl Fn(usize) -> T) {
        if let Some(dead_time) = &mut self.dead_times[i] {
            dead_time.settle(past);
        }
    }

    /// The past of motor `i` as its dead time keeps it, half a step apart, newest first; empty without one.
    pub fn past(&self, i: usize) -> Vec<T> {
        self.dead_times[i].as_ref().map_or(Vec::new(), DeadTime::past)
    }

    /// Moves every motor by half a step towards its target.
    #[inline(always)]
    pub fn advance(&mut self, targets: &[T]) {
        for i in 0..self.states.len() {
            let (step, state, target) = (&self.half_steps[i], &self.states[i], targets[i]);
            self.states[i] = match &mut self.dead_times[i] {
                None => step.advance(state, target),
                Some(dead_time) => {
                    let (before, ramp) = step.course(state.ramp, target);
                    let (from, to) = dead_time.pass(ramp);
                    // Where there is no dead time the input jumps with the command, whatever other lanes wait for.
                    let from = T::select(dead_time.is_late(), from, before);
                    MotorState { ramp, signal: step.lag(state.signal, from, to) }
                }
            };
        }
    }
}

/// The thrusts and deflections of all actuators at their signals and a supply voltage, V; `table` is what a measured
/// table says, N, where that is known already.
#[inline(always)]
pub fn act<T: Real>(
    vehicle: &Vehicle<T>,
    signals: &[T],
    voltage: f64,
    table: impl Fn(usize) -> Option<T>,
    instant: &mut Instant<T>,
) {
    let unit = vehicle.mass_matrix[0][0];
    instant.thrusts.clear();
    for (i, actuator) in vehicle.actuators.iter().enumerate() {
        let thrust = match table(i) {
            Some(force) => actuator.characteristic.scaled(force),
            None => actuator.characteristic.thrust(signals[i], voltage),
        };
        instant.thrusts.push(actuator.directed(thrust));
    }
    interact(&vehicle.actuators, &mut instant.thrusts);
    instant.deflections.clear();
    for (fin, signal) in vehicle.fins.iter().zip(&signals[vehicle.actuators.len()..]) {
        instant.deflections.push(fin.turned(*signal).sin_cos());
    }
    vehicle.sum_inflow_free(instant, unit.zero());
}
