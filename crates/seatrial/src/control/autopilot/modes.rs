//! The mode table at work: which loops and actuators, at which forward speed, with hysteresis.
//!
//! Source: Taubert et al. (2014), section "Adaptive PID-Controller" (switch structure).
//! Tests: `tests/closed_loop/modes.rs`.

use super::file::DepthBy;
use super::state::{Autopilot, AutopilotState};
use crate::control::navigation::Measurement;
use crate::number::algebra::Vec6;
use crate::number::real::Real;

impl<T: Real> Autopilot<T> {
    /// Index of the mode at the measured forward speed through the water.
    #[inline(always)]
    pub(super) fn mode(&self, state: &mut AutopilotState<T>, measured: &Measurement<T>, holding: T) -> T {
        let (zero, one) = (self.unit, self.unit.splat(1.0));
        let speed = measured.water()[0];
        let mut index = zero;
        for (reached, mode) in state.reached.iter_mut().zip(&self.settings.modes[1..]) {
            let above = T::select(speed.lt(zero.splat(mode.from_speed)), *reached, one);
            *reached = T::select(speed.lt(zero.splat(mode.from_speed - mode.hysteresis)), zero, above);
            index += *reached;
        }
        T::select(zero.splat(0.5).lt(holding), zero, index)
    }

    /// The loops at work in a mode, and 1 where the depth is by pitch.
    #[inline(always)]
    pub(super) fn at_work(&self, mode: T) -> (Vec6<T>, T) {
        let zero = self.unit;
        let (mut active, mut by_pitch) = ([zero; 6], zero);
        for (m, row) in self.settings.modes.iter().enumerate() {
            let this = (mode - zero.splat(m as f64)).abs().lt(zero.splat(0.5));
            for i in 0..6 {
                active[i] = T::select(this, zero.splat(f64::from(u8::from(row.active[i]))), active[i]);
            }
            let pitch = zero.splat(f64::from(u8::from(row.depth_by == DepthBy::Pitch)));
            by_pitch = T::select(this, pitch, by_pitch);
        }
        (active, by_pitch)
    }

    /// 1 for the actuators at work in a mode.
    #[inline(always)]
    pub(super) fn actuators_at_work(&self, mode: T, usable: &mut [T]) {
        let zero = self.unit;
        for (i, usable) in usable.iter_mut().enumerate() {
            *usable = zero;
            for (m, at_work) in self.at_work.iter().enumerate() {
                let this = (mode - zero.splat(m as f64)).abs().lt(zero.splat(0.5));
                *usable = T::select(this, zero.splat(at_work[i]), *usable);
            }
        }
    }
}
