//! The motors of the vehicle that flies, with their faults, and one step of both.
//!
//! Tests: `tests/closed_loop.rs`.

use super::faults::Faults;
use crate::actuator::motor::{Limits, MotorState};
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::integrate::{State, step};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::real::Real;

/// The motors of the vehicle that flies, with their faults.
pub struct Motors<T> {
    drive: Drive<T>,
    targets: Vec<T>,
    /// What the actuators really do.
    pub signals: Vec<T>,
    /// Whether any of them obeys its command at once.
    pub any_ideal: bool,
}

crate::memory!(Motors: drive; targets, signals, any_ideal);

impl<T: Real> Motors<T> {
    /// All at rest, for steps of `h` seconds.
    #[inline(always)]
    pub fn new(vehicle: &Vehicle<T>, limits: &[Limits], h: f64, unit: T) -> Self {
        let at_rest = |i: usize| vehicle.motor(i).steady(unit);
        Self {
            drive: Drive::new(vehicle, h, UnlimitedDelay::InTheDrive, at_rest),
            targets: vec![unit; limits.len()],
            signals: vec![unit; limits.len()],
            any_ideal: (0..limits.len()).any(|i| vehicle.motor(i).ideal),
        }
    }

    /// Takes the commands of a period through the static limits; ideal motors obey at once.
    #[inline(always)]
    pub fn command(&mut self, vehicle: &Vehicle<T>, signals: &[T], limits: &[Limits]) {
        for i in 0..signals.len() {
            self.targets[i] = limits[i].apply(signals[i]);
            let motor = vehicle.motor(i);
            if motor.ideal {
                let (state, obeyed) = (self.drive.states[i], motor.steady(self.targets[i]));
                let late = motor.t_t.zero().lt(motor.t_t);
                self.drive.states[i] = MotorState {
                    ramp: T::select(late, state.ramp, obeyed.ramp),
                    signal: T::select(late, state.signal, obeyed.signal),
                };
            }
        }
    }

    /// The signals at a time, faults included.
    #[inline(always)]
    pub fn show(&mut self, faults: &Faults<T>, time: f64) {
        for i in 0..self.signals.len() {
            self.signals[i] = faults.signal(i, self.drive.states[i].signal, self.signals[i], time);
        }
    }

    /// Moves the motors by half a step towards what is commanded.
    #[inline(always)]
    pub fn advance(&mut self) {
        self.drive.advance(&self.targets);
    }

    /// Moves motors and vehicle by a step of `h` seconds from a `time`, s, on; `instants` hold the water at its start,
    /// middle and end, and what the actuators do there: at the start `anew`, or as it was left.
    #[inline(always)]
    pub fn substep(
        &mut self,
        vehicle: &Vehicle<T>,
        state: &State<T>,
        instants: &mut [Instant<T>; 3],
        (anew, time, h): (bool, f64, f64),
        (faults, voltage): (&Faults<T>, f64),
    ) -> State<T> {
        if anew {
            self.show(faults, time);
            act(vehicle, &self.signals, voltage, |_| None, &mut instants[0]);
        }
        for half in 1..3 {
            self.advance();
            self.show(faults, time + 0.5 * half as f64 * h);
            act(vehicle, &self.signals, voltage, |_| None, &mut instants[half]);
        }
        step(vehicle, state, h, instants)
    }
}
