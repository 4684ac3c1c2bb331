//! From the demands of the loops to commands, and back to what of them is reached.
//!
//! Rows that the vehicle can command and no loop does are kept at zero where the others allow it: a dead thruster
//! must not push the vehicle sideways. The heave loop's force is vertical in the earth frame; `τ = Jᵀ f` turns it
//! into the body frame, and what the allocation misses is turned back for the anti-windup.
//!
//! Source: Fossen (2011), sections 7.5 and 12.2. Tests: `tests/closed_loop/modes.rs`, `tests/closed_loop/safety.rs`.

use super::state::{Autopilot, AutopilotState};
use crate::control::control_law::{HEAVE, PITCH, ROLL, Situation};
use crate::control::navigation::Measurement;
use crate::number::algebra::{Vec6, dot};
use crate::number::real::Real;

impl<T: Real> Autopilot<T> {
    /// Distributes the demands of the loops, and sees what of them is reached.
    #[inline(always)]
    pub(super) fn allocate(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        situation: &Situation<T>,
        (demanded, mode, stopped): (&Vec6<T>, T, T::Mask),
    ) {
        let (zero, half) = (self.unit, self.unit.splat(0.5));
        let ((s_roll, c_roll), (s_pitch, c_pitch)) =
            (situation.attitude[ROLL - 3].sin_cos(), situation.attitude[PITCH - 3].sin_cos());
        // The earth's vertical in the body frame.
        let vertical = [-s_pitch, c_pitch * s_roll, c_pitch * c_roll];
        let mut tau = *demanded;
        tau[HEAVE] = zero;
        for i in 0..3 {
            tau[i] = vertical[i].mul_add(demanded[HEAVE], tau[i]);
        }
        self.actuators_at_work(mode, &mut state.usable);
        state.monitor.exclude(&mut state.usable, &mut state.allocator);
        let [u, _, _] = measured.water();
        let rows = situation.active;
        let mut weights = rows;
        for i in 0..6 {
            weights[i] = T::select(half.lt(rows[i]), rows[i], zero.splat(self.idle_rows[i]));
        }
        state.allocator.prepare(&self.model, &weights, &state.usable, u);
        // The water was surveyed where the step looked for failed actuators.
        let (model, voltage) = (&self.model, measured.voltage);
        let reached = state.allocator.allocate_surveyed(model, &tau, voltage, &mut state.signals);
        // The loops are not told of the dither: an integrator would work against it.
        for (signal, dither) in state.signals.iter_mut().zip(&state.dither) {
            *signal = T::select(stopped, zero, *signal + *dither);
        }
        state.monitor.silence(&mut state.signals);
        state.monitor.expect(&state.signals, &self.limits);
        let mut short = [zero; 6];
        for i in 0..6 {
            short[i] = (T::select(stopped, zero, reached[i]) - tau[i]) * rows[i];
        }
        let sink = dot(&vertical, &[short[0], short[1], short[2]]);
        for i in 0..6 {
            let missed = if i == HEAVE { sink } else { short[i] };
            // A loop that enters goes on from what its row has without it.
            let without = if i == HEAVE { reached[i] * vertical[2] } else { reached[i] };
            let without = T::select(stopped, zero, without);
            state.achieved[i] = T::select(half.lt(rows[i]), demanded[i] + missed, without);
        }
    }
}
