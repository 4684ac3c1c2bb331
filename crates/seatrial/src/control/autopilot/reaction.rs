//! Guidance while all is well, and what stands in for it when safety calls: hold, surface.
//!
//! Tests: `tests/closed_loop/safety.rs`.

use super::file::DepthBy;
use super::rates::Rates;
use super::set_point::SetPoint;
use super::state::{Autopilot, AutopilotState};
use crate::control::guidance::limits::towards;
use crate::control::guidance::{Desired, Fix};
use crate::control::navigation::Measurement;
use crate::control::safety::{CONTRADICTED_DEPTH, Reaction};
use crate::mission::Vertical;
use crate::number::real::Real;

/// Who comes up by a depth that is contradicted aims so far above what it shows, m: no reading then ends the way up.
const BLIND_M: f64 = 10.0;

impl<T: Real> Autopilot<T> {
    /// 1 where the mission follows the bottom or keeps off it.
    #[inline(always)]
    pub(super) fn needs_altitude(&self, state: &AutopilotState<T>) -> T {
        let waypoints = &self.mission.waypoints;
        if self.mission.limits.altitude > 0.0 {
            return self.unit.splat(1.0);
        }
        if waypoints.iter().all(|w| w.vertical == Vertical::Depth) {
            return self.unit;
        }
        let follows = |leg: f64| {
            let waypoint = &waypoints[(leg.max(0.0) as usize).min(waypoints.len() - 1)];
            (f64::from(u8::from(waypoint.vertical == Vertical::Altitude)), 0.0)
        };
        state.progress.leg().listed(waypoints.len(), follows)
    }

    /// Guidance, stopped at the present place where a reaction begins, with the set points that stand in for it while
    /// all is well.
    #[inline(always)]
    pub(super) fn guide(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        before: T,
        set_point: Option<&SetPoint<T>>,
    ) -> Desired<T> {
        let half = before.splat(0.5);
        let calm = state.alert.level.lt(half);
        let begins = T::both(before.lt(half), half.lt(state.alert.level));
        let mut fresh = measured.velocity();
        for (i, x) in fresh.iter_mut().enumerate() {
            *x = T::select(Rates::blind(measured, i), x.zero(), *x);
        }
        let mut position = measured.position();
        let set_point = set_point.map(|set_point| set_point.moved_only(calm));
        if let Some(set_point) = &set_point {
            for i in 0..3 {
                position[i] -= set_point.shift[i];
            }
        }
        let fix =
            Fix { position, altitude: measured.altitude(), attitude: measured.attitude(), velocity: fresh };
        state.progress.resume(calm);
        if T::any(begins) {
            self.guidance.stop_here(&mut state.progress, &fix, begins);
            state.heading = T::select(begins, fix.attitude[2], state.heading);
        }
        // Guidance makes the pitch towards a depth: one that is set has to be told to it, in the moved plan's frame.
        let depth = set_point.as_ref().and_then(|set| Some((set.depth()? - set.shift[2], calm)));
        let waypoints = &self.mission.waypoints;
        let mut desired =
            self.guidance.step_at_depth(waypoints, &mut state.progress, &fix, (state.dt, depth));
        if let Some(set_point) = set_point {
            set_point.over(&mut desired, calm);
        }
        desired
    }

    /// Puts what the reaction asks for over the desired values, within the limits of guidance; where the vehicle has
    /// surfaced.
    #[inline(always)]
    pub(super) fn react(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        desired: &mut Desired<T>,
    ) -> T::Mask {
        let (zero, level) = (self.unit, state.alert.level);
        let (file, guidance) = (&self.settings.file, &self.guidance);
        let depth = measured.channels[2];
        let surface = zero.splat(f64::from(Reaction::Surface as u8) - 0.5).lt(level);
        let first = state.count.lt(zero.splat(0.5));
        state.speed = T::select(first, measured.velocity()[0], state.speed);
        state.depth = T::select(first, depth, state.depth);
        if T::any(surface) {
            let still = self.settings.modes[0].depth_by == DepthBy::Heave;
            let speed = zero.splat(if still { 0.0 } else { file.safety.surface_speed_m_s });
            let dt = state.dt;
            let pick = |to: &mut T, from: T| *to = T::select(surface, from, *to);
            pick(&mut desired.speed, towards(state.speed, speed, guidance.acceleration_max * dt));
            pick(&mut desired.lateral, zero);
            pick(&mut desired.heading, state.heading);
            let blind = (state.alert.cause - CONTRADICTED_DEPTH).abs().lt(zero.splat(0.5));
            let seen = T::select(blind, depth.max(zero.splat(BLIND_M)), depth);
            pick(&mut desired.pitch, guidance.pitch_towards(seen));
            let up = towards(state.depth, zero, guidance.depth_rate_max * dt);
            pick(&mut desired.depth, T::select(blind, depth - BLIND_M, up));
            pick(&mut desired.holding, zero.splat(f64::from(u8::from(still))));
        }
        (state.speed, state.depth) = (desired.speed, desired.depth);
        // Who was up stays stopped: without buoyancy it would start again and again.
        let shown = T::both(surface, depth.lt(zero.splat(file.safety.surfaced_above_m)));
        // A wrong speed or pitch contradicts the depth too: who surfaces for another cause is up where it shows so.
        let trusted = zero.splat(0.5).lt((state.alert.cause - CONTRADICTED_DEPTH).abs());
        let up = T::both(shown, trusted);
        state.surfaced = T::select(up, zero.splat(1.0), state.surfaced);
        zero.lt(state.surfaced)
    }
}
