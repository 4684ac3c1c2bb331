//! How a navigation filter begins, and begins anew where it was lost.
//!
//! Attitude and fixes are taken as they are, with the deviations of their sensors. Velocities and rates begin wide, and what
//! Doppler logs and gyro have shown is taken as samples at once: where both logs are aboard, the first estimate knows
//! velocity and current as well as they do. From a wide start the first steps would be linearised far from the truth.
//!
//! A filter has lost its lock where the recent innovations of two instruments are beyond all chance
//! ([`crate::filter::innovation::LOST`]) for [`DOUBTED`] seconds: one alone may be at fault, two that contradict the estimate
//! are right. It begins anew from the samples of now; of the position, where no sensor shows it, it keeps the estimate.
//!
//! Tests: `tests/flight/test_navigation.py`.

use super::fitting::{ATTITUDE_SENSOR, DEPTH, DVL_WATER, GPS, GYRO, POSITION_FIX, USBL, instrument_of};
use super::{Instrument, KINDS, NavigationFilter, finite};
use crate::control::navigation::{VELOCITY as GROUND, WATER};
use crate::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use crate::filter::innovation::LOST;
use crate::filter::tracker::Sample;
use crate::model::kinematics::{from_euler, quaternion_product};
use crate::number::algebra::{product, splat};
use crate::number::plain;
use crate::number::real::Real;

/// Deviations at the start of what was not measured: velocity m/s, rates rad/s; and by which a measured one moves in a
/// second.
pub(crate) const AT_START: [f64; 2] = [0.5, 0.1];

/// After a start a filter does not take itself for lost for so long, twice as long after each time, s: where its model is
/// wrong, to begin anew does not help.
pub(crate) const PATIENCE: [f64; 2] = [5.0, 600.0];

/// So long two instruments contradict the estimate before the lock is lost, s: longer than a burst of wild points, shorter
/// than the patience of a gate, which would believe one sensor and not the next.
pub(crate) const DOUBTED: f64 = 3.0;

/// The estimate has been wrong for so long by then, s: the motion of meanwhile is not known.
pub(crate) const UNNOTICED: f64 = 4.0;

/// The instrument that a kind of sensor belongs to: one box, or one principle, fails as one. Fixes of the position,
/// pressure, attitude and gyro, Doppler logs, echo sounder, ranges and bearings.
pub(crate) const BOXES: [usize; KINDS.len()] = [0, 0, 0, 1, 2, 3, 2, 3, 4, 5, 5];

/// An attitude at most so old is that of now, s.
pub(crate) const RECENT: f64 = 1.0;

impl<T: Real> NavigationFilter<T> {
    /// What is lost begins anew from the next samples, after so many seconds of which nothing is known.
    #[inline(always)]
    pub(super) fn lose(&mut self, mask: T::Mask, unknown: f64) {
        let (zero, one) = (self.begun.zero(), self.begun.splat(1.0));
        self.restarts += T::select(mask, one, zero);
        self.stay(mask, unknown);
        self.begun = T::select(mask, zero, self.begun);
        for first in &mut self.first {
            *first = T::select(mask, zero.splat(f64::NAN), *first);
        }
    }

    /// The estimated position is where the filter will begin.
    #[inline(always)]
    fn stay(&mut self, mask: T::Mask, unknown: f64) {
        let position = self.tracker.estimate().motion.position;
        for i in 0..3 {
            let drifted = AT_START[0] * unknown;
            let variance = self.tracker.state().covariance(POSITION + i, POSITION + i) + drifted * drifted;
            let known = T::both(mask, T::both(finite(position[i]), finite(variance)));
            self.place[i] = T::select(known, position[i], self.place[i]);
            self.far[i] = T::select(known, variance.max(variance.zero()).sqrt(), self.far[i]);
        }
    }

    /// Begins anew where the lock is lost and the attitude is that of now.
    #[inline(always)]
    pub(super) fn regain(&mut self, elapsed: f64) {
        let (zero, one) = (self.begun.zero(), self.begun.splat(1.0));
        let mut worst = [zero; KINDS.len()];
        for (channel, watch) in self.watches.iter().enumerate() {
            let own = &mut worst[BOXES[instrument_of(channel)]];
            *own = own.max(watch.recent);
        }
        let mut wild = zero;
        for recent in worst {
            wild += T::select(zero.splat(LOST).lt(recent), one, zero);
        }
        let many = T::both(one.lt(wild), self.begun());
        self.doubted = T::select(many, self.doubted + elapsed, zero);
        let oldest = self.silent[3].max(self.silent[4]).max(self.silent[5]);
        // Sums of periods reach a limit half a period early: their last digit, of another number type another one, would
        // otherwise decide whether it is this period or the next.
        let half = 0.5 * self.fitting.period;
        let seen = T::both((self.patience - half).lt(self.age), oldest.lt(zero.splat(RECENT + half)));
        let lost = T::both(zero.splat(DOUBTED - half).lt(self.doubted), seen);
        if !T::any(lost) {
            return;
        }
        self.restarts += T::select(lost, one, zero);
        self.patience = T::select(lost, (self.patience * 2.0).min(zero.splat(PATIENCE[1])), self.patience);
        self.stay(lost, UNNOTICED);
        for channel in 0..self.first.len() {
            // A fix of long ago is that of another place; the start keeps the estimate.
            let old = T::both(lost, zero.splat(RECENT + half).lt(self.silent[channel]));
            self.first[channel] = T::select(old, zero.splat(f64::NAN), self.first[channel]);
        }
        self.try_to_begin(lost);
    }

    /// Begins where the mask holds and the attitude is known.
    #[inline(always)]
    pub(super) fn try_to_begin(&mut self, mask: T::Mask) {
        let of = |kind: usize| self.fitting.instruments[kind].unwrap_or(Instrument::of(0.0));
        let first = |channel: usize| self.first[channel];
        let zero = self.begun.zero();
        // The last of several that is known.
        let known = |or: T, channel: usize| T::select(finite(first(channel)), first(channel), or);
        let angles = [first(3), first(4), first(5)];
        let ready = T::both(T::both(finite(angles[0]), finite(angles[1])), T::both(finite(angles[2]), mask));
        if !T::any(ready) {
            return;
        }
        let (mut at, mut deviations) = (Estimate::at_rest_in(zero), [zero; STATES]);
        let [w, x, y, z] = splat(zero, &of(ATTITUDE_SENSOR).mount);
        at.motion.attitude = quaternion_product(&from_euler(&angles), &[w, -x, -y, -z]);
        let spread = |kind: usize| plain::hypot(of(kind).noise, of(kind).bias).max(1e-6);
        let turned = at.rotation();
        for i in 0..3 {
            deviations[ATTITUDE + i] = zero.splat(spread(ATTITUDE_SENSOR));
            // The place of the launch, as whoever launches tells it, or where the filter was lost.
            let mut place = known(self.place[i], i);
            let mut deviation = self.far[i];
            let fixes: &[(usize, usize)] = match i {
                2 => &[(20, USBL), (2, DEPTH)],
                _ => &[(18, USBL), (16, GPS), (0, POSITION_FIX)],
            };
            for &(channel, kind) in fixes {
                if self.fitting.instruments[kind].is_some() {
                    let fix = first(channel + if i < 2 { i } else { 0 });
                    let arm = product(&turned, &splat(zero, &of(kind).arm));
                    place = T::select(finite(fix), fix - arm[i], place);
                    deviation = T::select(finite(fix), zero.splat(spread(kind)), deviation);
                }
            }
            (at.motion.position[i], deviations[POSITION + i]) = (place, deviation);
            deviations[VELOCITY + i] = zero.splat(AT_START[0]);
            deviations[VELOCITY + 3 + i] = zero.splat(AT_START[1]);
            let through = self.fitting.instruments[DVL_WATER].is_some();
            at.motion.nu[i] = known(zero, if through { WATER + i } else { GROUND + i });
            at.motion.nu[3 + i] = known(zero, 9 + i);
            deviations[CURRENT + i] = zero.splat(self.fitting.noise.current[i]);
            deviations[GYRO_BIAS + i] = zero.splat(of(GYRO).bias);
        }
        // An offset of the attitude turns weight against buoyancy: a lasting moment that the vehicle does not feel.
        let leaning = of(ATTITUDE_SENSOR).bias * self.righting;
        for i in 0..6 {
            let force = self.fitting.noise.force[i];
            let leaned = if i == 3 || i == 4 { plain::hypot(force, leaning) } else { force };
            deviations[FORCE + i] = zero.splat(leaned);
        }
        self.tracker.begin_where(ready, &at, &deviations);
        self.begun = T::select(ready, zero.splat(1.0), self.begun);
        self.age = T::select(ready, zero, self.age);
        self.doubted = T::select(ready, zero, self.doubted);
        for watch in &mut self.watches {
            watch.recent = T::select(ready, zero.splat(1.0), watch.recent);
        }
        for channel in (GROUND..GROUND + 6).chain(WATER..WATER + 3) {
            let (Some(instrument), Some(observation)) =
                (self.fitting.instruments[instrument_of(channel)], &self.observed[channel])
            else {
                continue;
            };
            let measured = self.first[channel];
            let moves = AT_START[usize::from((9..12).contains(&channel))];
            let old = (self.silent[channel] + instrument.latency).min(zero.splat(1.0)) * moves;
            let variance =
                old * old + (instrument.noise * instrument.noise).max(1e-12) + self.shaken(observation);
            let sample = Sample { observation, measured, variance, age: 0.0 };
            self.tracker.begin_with(T::both(ready, finite(measured)), &sample);
        }
        self.tracker.begun_with(ready);
    }
}
