//! From forces to commands: the inverse characteristics, the loss by the other groups' wash, hysteresis and limits.
//!
//! Wash takes the share `ℓ_i Σ |F_j|` of a thrust ([`crate::actuator::interact`]), F_j of the other groups without inflow. Its
//! inverse is a fixed point: signals for what the others' last signals leave. Each of the [`WASH_ROUNDS`] multiplies the
//! error by about `ℓ Σ |F_j|`: a loss of a tenth is inverted to 1e-4 of the thrust, one of 1 % to 1e-8. What is
//! missed stands in the wrench that is returned as reached.
//!
//! Tests: `tests/allocation.rs`.

use super::reach::thrust;
use super::state::Allocator;
use crate::model::vehicle::Vehicle;
use crate::number::real::Real;

/// Rounds of the inverse of the loss.
const WASH_ROUNDS: usize = 4;

impl<T: Real> Allocator<T> {
    /// The signals that give the forces, held and limited.
    #[inline(always)]
    pub(super) fn command(&mut self, vehicle: &Vehicle<T>, voltage: f64, signals: &mut [T]) {
        let (zero, one) = (self.force[0].zero(), self.force[0].splat(1.0));
        let washed = vehicle.actuators.iter().any(|actuator| actuator.loss.is_some());
        self.left.iter_mut().for_each(|left| *left = one);
        let rounds = if washed { WASH_ROUNDS } else { 1 };
        for round in 1..=rounds {
            for k in 0..self.force.len() {
                // A tenth at least: what the wash takes nearly all of is out of reach.
                let force = (self.force[k], self.left[k].max(one.splat(0.1)));
                signals[k] = self.reach[k].command(vehicle, k, force, (self.turning[k], voltage));
                if round == rounds {
                    let held = self.settings.holds[k].hold(signals[k], &mut self.turning[k]);
                    let works = zero.lt(self.usable[k]);
                    self.turning[k] = T::select(works, self.turning[k], zero);
                    let stands = self.stuck_signal[k] / vehicle.motor(k).k_v;
                    signals[k] = T::select(works, held, stands);
                }
            }
            if washed {
                self.wash(vehicle, voltage, signals);
            }
        }
    }

    /// What the wash of the other groups leaves of each thrust, as [`crate::actuator::interact`] takes it. Out of line: it
    /// is rare.
    #[inline(never)]
    fn wash(&mut self, vehicle: &Vehicle<T>, voltage: f64, signals: &[T]) {
        for (k, actuator) in vehicle.actuators.iter().enumerate() {
            self.strength[k] = thrust(actuator, signals[k], voltage).force.abs();
        }
        for (k, actuator) in vehicle.actuators.iter().enumerate() {
            let Some(loss) = actuator.loss else { continue };
            let mut others = loss.zero();
            for (other, strength) in vehicle.actuators.iter().zip(&self.strength) {
                if other.group != actuator.group {
                    others += *strength;
                }
            }
            self.left[k] = loss.neg_mul_add(others, loss.splat(1.0)).max(loss.zero());
        }
    }
}
