//! What the model knows to be needed, ahead of any error.
//!
//! Weight, buoyancy and their moment at the measured attitude (`+ g(η)`; while heave is at work its force carries the
//! vertical part); drag at the desired speeds and the rate of the filtered depth; inertia times the acceleration of the
//! filtered references. What the model does not know is left to the integrals of the loops.
//!
//! Source: Fossen (2011), section 12.2; Taubert et al. (2014), equation 49 and figure 18 (PID controller).
//! Tests: `tests/closed_loop/flights.rs`.

use super::state::Autopilot;
use crate::control::control_law::{HEAVE, SURGE, SWAY, Situation};
use crate::control::guidance::Desired;
use crate::model::kinematics::{from_euler, rotation};
use crate::number::algebra::{Vec6, dot};
use crate::number::real::Real;

impl<T: Real> Autopilot<T> {
    /// What the model knows to be needed: against weight and buoyancy, against drag, for acceleration.
    #[inline(always)]
    pub(super) fn known(&self, s: &Situation<T>, desired: &Desired<T>, acceleration: &Vec6<T>) -> Vec6<T> {
        let table = &self.settings.file.feed_forward;
        let zero = self.unit;
        let mut known = [zero; 6];
        if table.restoring {
            let r = rotation(&from_euler(&s.attitude));
            let [x, y, z, k, m, n] = self.model.restoring.add(&r, &[zero; 6]);
            let heave = zero.splat(0.5).lt(s.active[HEAVE]);
            let sink = dot(&r[2], &[x, y, z]);
            known = [T::select(heave, zero, -x), T::select(heave, zero, -y), -sink, -k, -m, -n];
        }
        if table.drag {
            let sink = T::select(zero.splat(0.5).lt(s.active[HEAVE]), s.reference_rate[HEAVE], zero);
            let wanted = [desired.speed, desired.lateral, sink, zero, zero, zero];
            let drag = self.model.damping.add(&wanted, &[zero; 6]);
            for i in [SURGE, SWAY, HEAVE] {
                known[i] -= drag[i];
            }
        }
        if table.acceleration {
            for i in 0..6 {
                known[i] = self.model.mass_matrix[i][i].mul_add(acceleration[i], known[i]);
            }
        }
        known
    }
}
