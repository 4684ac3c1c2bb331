//! What follows from what the watches see: the strongest reaction that was called for stays, until it is left.
//!
//! Tests: `tests/closed_loop/safety.rs`, `tests/core/test_helm_contradictions.py`.

use super::table::SafetyTable;
use super::watches::{Circumstances, NEARER_M, Seen};
use super::{CONTRADICTED, SPEED, WATCHES};
use crate::number::real::Real;

/// The watches that compare a measurement with a limit: depth, altitude, fence and battery.
const MEASURED_LIMITS: [usize; 4] = [6, 7, 8, 10];

/// So far below the highest point of its way up a vehicle sinks, m, and the time counts so many times then.
const SINKS_M: f64 = 2.0;
const SINKING_COUNTS: f64 = 10.0;

/// What has been called for so far.
#[derive(Clone, Copy, Debug)]
pub struct Alert<T> {
    /// Level of the strongest reaction, see [`REACTIONS`].
    pub level: T,
    /// The watch that called for it, counted from 1; 0 for none.
    pub cause: T,
    /// The channel that was stale, counted from 1; 0 where something else called for it.
    pub channel: T,
    /// When, s.
    pub since: T,
    /// Level, cause, channel and time of what stays until the operator's reset: all but contradictions.
    firm: [T; 4],
    /// For how long no sensors have contradicted each other, s.
    calm_for: T,
    /// For how long each watch has been true, s.
    lasting: [T; WATCHES],
    /// The smallest depth since the vehicle surfaces, m, and for how long it has come no higher, s.
    highest: T,
    pub(super) no_higher: T,
    /// The smallest error of the speed since it is off, m/s.
    pub(super) off_speed: T,
}

/// A limit counts as passed after so long, s: one sample is an echo of a fish.
const PERSISTENCE_S: f64 = 1.0;

crate::memory!(Alert: level, cause, channel, since, firm, calm_for, lasting, highest, no_higher, off_speed;);

impl<T: Real> Alert<T> {
    /// Nothing yet.
    pub fn none(unit: T) -> Self {
        let zero = unit.zero();
        let lasting = [zero; WATCHES];
        let (highest, no_higher, off_speed) = (zero, zero, zero);
        let (firm, calm_for) = ([zero; 4], zero);
        let (level, cause, channel, since) = (zero, zero, zero, zero);
        Self { level, cause, channel, since, firm, calm_for, lasting, highest, no_higher, off_speed }
    }

    /// Forgets where `at` holds whatever was called for: what is still true calls again after its time.
    #[inline(always)]
    pub fn reset(&mut self, at: T::Mask) {
        let none = Self::none(self.level.zero());
        let pick = |to: &mut T, from: T| *to = T::select(at, from, *to);
        for (to, from) in [
            (&mut self.level, none.level),
            (&mut self.cause, none.cause),
            (&mut self.channel, none.channel),
            (&mut self.since, none.since),
            (&mut self.calm_for, none.calm_for),
            (&mut self.highest, none.highest),
            (&mut self.no_higher, none.no_higher),
            (&mut self.off_speed, none.off_speed),
        ] {
            pick(to, from);
        }
        for to in self.firm.iter_mut().chain(&mut self.lasting) {
            pick(to, none.level);
        }
    }

    /// Leaves the reaction to a contradiction, where that is over for `after` seconds, for what else was called for. Who
    /// has surfaced stays there.
    #[inline(always)]
    fn leave(&mut self, surfaced: T, after: f64) {
        let zero = self.level.zero();
        let off = (self.cause - (CONTRADICTED as f64 + 2.5)).abs();
        let contradicted = T::both(off.lt(zero.splat(2.0)), surfaced.lt(zero.splat(0.5)));
        let over = T::both(contradicted, zero.splat(after).lt(self.calm_for));
        let [level, cause, channel, since] = self.firm;
        for (to, from) in [
            (&mut self.level, level),
            (&mut self.cause, cause),
            (&mut self.channel, channel),
            (&mut self.since, since),
        ] {
            *to = T::select(over, from, *to);
        }
    }

    /// Follows the way up by the deeper of two depths, `dt` seconds after the last look.
    #[inline(always)]
    fn rise(&mut self, depth: T, surfaced: T, dt: f64) {
        let zero = depth.zero();
        let surfacing = T::both(zero.splat(1.5).lt(self.level), self.level.lt(zero.splat(2.5)));
        let below = T::both(surfacing, surfaced.lt(zero.splat(0.5)));
        let begins = self.no_higher.lt(zero.splat(0.5 * dt));
        let higher = T::either(begins, depth.lt(self.highest - NEARER_M));
        self.highest = T::select(higher, depth, self.highest);
        // Who sinks does not wait as long.
        let sinks = (self.highest + SINKS_M).lt(depth);
        let counted = self.no_higher + T::select(sinks, zero.splat(SINKING_COUNTS * dt), zero.splat(dt));
        let restarted = T::select(higher, zero.splat(dt), counted);
        self.no_higher = T::select(below, restarted, zero);
    }

    /// The alert after one more look.
    #[inline(always)]
    pub(super) fn after(&self, table: &SafetyTable, seen: Seen<T>, around: &Circumstances<'_, T>) -> Self {
        let zero = self.level.zero();
        let half = zero.splat(0.5);
        let flag = |mask: T::Mask| T::select(mask, zero.splat(1.0), zero);
        let Seen { mut called, mut told, channel, deepest, off_by, nearer } = seen;
        let mut next = *self;
        let any = called[CONTRADICTED..SPEED].iter().fold(zero, |any, &x| any.max(x));
        next.calm_for = T::select(half.lt(any), zero, next.calm_for + around.dt);
        next.leave(around.surfaced, table.contradiction.over_after_s);
        next.rise(deepest, around.surfaced, around.dt);
        let begins = T::either(half.lt(nearer), self.lasting[SPEED].lt(half * around.dt));
        next.off_speed = T::select(zero.lt(off_by), T::select(begins, off_by, self.off_speed), zero);
        for (i, reaction) in table.reactions().into_iter().enumerate() {
            next.lasting[i] = T::select(half.lt(called[i]), next.lasting[i] + around.dt, zero);
            // The others have a time of their own.
            if MEASURED_LIMITS.contains(&i) {
                called[i] = flag(zero.splat(PERSISTENCE_S).lt(next.lasting[i]));
            }
            if (CONTRADICTED..=SPEED).contains(&i) {
                let after = if i == SPEED { table.speed.after_s } else { table.contradiction.after_s };
                called[i] = flag(zero.splat(after).lt(next.lasting[i]));
            }
            told[i] = told[i].max(called[i]);
            let level = zero.splat(f64::from(reaction as u8));
            let stronger = T::both(half.lt(called[i]), next.level.lt(level));
            next.level = T::select(stronger, level, next.level);
            next.cause = T::select(stronger, zero.splat(i as f64 + 1.0), next.cause);
            next.channel = T::select(stronger, channel[i], next.channel);
            next.since = T::select(stronger, around.time, next.since);
            if !(CONTRADICTED..SPEED).contains(&i) {
                let firmer = T::both(half.lt(called[i]), next.firm[0].lt(level));
                let now = [level, zero.splat(i as f64 + 1.0), channel[i], around.time];
                for (to, from) in next.firm.iter_mut().zip(now) {
                    *to = T::select(firmer, from, *to);
                }
            }
        }
        // Without a reaction, what is told is the first that is true.
        let calm = next.level.lt(half);
        let (mut cause, mut of) = (zero, zero);
        for i in (0..WATCHES).rev() {
            let this = half.lt(told[i]);
            (cause, of) =
                (T::select(this, zero.splat(i as f64 + 1.0), cause), T::select(this, channel[i], of));
        }
        next.cause = T::select(calm, cause, next.cause);
        next.channel = T::select(calm, of, next.channel);
        next
    }
}
