//! From desired and measured values to what the control laws are told: filtered references, errors, rates.
//!
//! A loop that enters starts its reference filter from what is measured, so that its demand does not jump. Without a
//! fresh velocity of its own, surge or sway has no error: the feed-forward alone drives.
//!
//! Tests: `tests/closed_loop/modes.rs`, `tests/control/reference_filter.rs`.

use super::rates::Rates;
use super::state::{Autopilot, AutopilotState};
use crate::control::control_law::{HEAVE, ROLL, SURGE, SWAY, Situation};
use crate::control::guidance::Desired;
use crate::control::navigation::Measurement;
use crate::control::reference_filter::Reference;
use crate::number::algebra::Vec6;
use crate::number::real::Real;

impl<T: Real> Autopilot<T> {
    /// The situation without its feed-forward, and the acceleration of the references: m/s², rad/s².
    #[inline(always)]
    pub(super) fn situation(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        desired: &Desired<T>,
        (active, by_pitch): (Vec6<T>, T),
    ) -> (Situation<T>, Vec6<T>) {
        let (zero, half) = (self.unit, self.unit.splat(0.5));
        let dt = state.dt;
        let [roll, pitch, yaw] = measured.attitude();
        // Hover wants no pitch; what guidance has in mind meanwhile is reached at its own rate.
        let pitch_wanted = T::select(half.lt(by_pitch), desired.pitch, zero);
        let most = self.guidance.pitch_rate_max * dt;
        let begun = zero.lt(state.count);
        let from = T::select(begun, state.pitch, pitch);
        state.pitch = from + (pitch_wanted - from).clamped(-most, most);
        let wanted = [desired.speed, desired.lateral, desired.depth, zero, state.pitch, desired.heading];
        let ([u, v, w], [p, q, r]) = (measured.velocity(), measured.rates());
        // What is too old is no velocity: a law must not push against it.
        let blind = [Rates::blind(measured, 0), Rates::blind(measured, 1), Rates::blind(measured, 2)];
        let known = |x: T, i: usize| T::select(blind[i], zero, x);
        let shown = [u, v, measured.channels[2], roll, pitch, yaw];
        let mut situation = Situation {
            dt,
            speed: desired.speed,
            error: [zero; 6],
            rate: state.rates.see(measured, dt),
            reference_rate: [zero; 6],
            velocity: [known(u, 0), known(v, 1), known(w, 2), p, q, r],
            attitude: [roll, pitch, yaw],
            feed_forward: [zero; 6],
            achieved: state.achieved,
            active,
            entered: [zero; 6],
        };
        let mut acceleration = [zero; 6];
        let first = state.count.lt(half);
        for i in 0..6 {
            let was_active = half.lt(state.active[i]);
            situation.entered[i] = T::select(T::either(was_active, first), zero, active[i]);
            let (angle, position) = (i >= ROLL, i >= HEAVE);
            let mut followed = wanted[i];
            if let Some(omega) = self.loops[i].as_ref().and_then(|l| l.reference) {
                let before = &state.references[i];
                let moving = if position { situation.rate[i] } else { zero };
                let from = Reference {
                    value: T::select(was_active, before.value, shown[i]),
                    rate: T::select(was_active, before.rate, moving),
                    acceleration: T::select(was_active, before.acceleration, zero),
                };
                let after = from.follow(wanted[i], omega, dt, angle);
                followed = after.value;
                situation.reference_rate[i] = after.rate;
                acceleration[i] = if position { after.acceleration } else { after.rate };
                state.references[i] = after;
            }
            let error = followed - shown[i];
            situation.error[i] = if angle { error.wrap() } else { error };
        }
        for i in [SURGE, SWAY] {
            situation.error[i] = known(situation.error[i], i);
        }
        (situation, acceleration)
    }
}
