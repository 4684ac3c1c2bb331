//! Actuators that fail in a simulated flight.
//!
//! *Dead*: no signal any more, the propeller stands or the fin is gone amidships. *Stuck*: the signal stays where it is at
//! that moment, or at a given value. Failures of sensors are outages ([`crate::control::navigation::Outage`]).
//!
//! Tests: `tests/closed_loop.rs`.

use crate::number::real::Real;

/// The failure of one actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorFault {
    /// Index of the actuator.
    pub actuator: usize,
    /// From this time on, s.
    pub from: f64,
    /// The signal from then on; nothing: where it is.
    pub signal: Option<f64>,
}

/// The failures of one case, per actuator.
#[derive(Clone, Debug)]
pub struct Faults<T> {
    /// Time of the failure, infinite for none.
    pub from: Vec<T>,
    /// Signal from then on; not a number: where it is.
    pub signal: Vec<T>,
    any: bool,
}

impl<T: Real> Faults<T> {
    /// From per-actuator times and signals.
    pub fn new(from: Vec<T>, signal: Vec<T>, any: bool) -> Self {
        Self { from, signal, any }
    }

    /// What actuator `i` does at a `time`, s, when its motor says `signal` and it did `before`.
    #[inline(always)]
    pub fn signal(&self, i: usize, signal: T, before: T, time: f64) -> T {
        if !self.any {
            return signal;
        }
        let failed = self.from[i].lt(signal.splat(time + 1e-9));
        // Not a number is not below any: the actuator stays where it is.
        let given = self.signal[i].lt(signal.splat(f64::INFINITY));
        T::select(failed, T::select(given, self.signal[i], before), signal)
    }
}

/// Per actuator the time of its failure and the signal from then on; of two failures the first one lasts.
pub fn table(faults: &[ActuatorFault], actuators: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut from, mut signal) = (vec![f64::INFINITY; actuators], vec![f64::NAN; actuators]);
    for fault in faults.iter().filter(|fault| fault.from.is_finite()) {
        if from[fault.actuator] <= fault.from {
            continue;
        }
        from[fault.actuator] = fault.from;
        signal[fault.actuator] = fault.signal.unwrap_or(f64::NAN);
    }
    (from, signal)
}
