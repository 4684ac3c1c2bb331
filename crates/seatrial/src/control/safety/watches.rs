//! The watches: which of them are true, and which are to be told.
//!
//! Tests: `tests/closed_loop/safety.rs`.

use super::reactions::Alert;
use super::table::SafetyTable;
use super::{ASCENT, CONTRADICTED, OF_CONTRADICTED, SPEED, STALE, UNREAD, WATCHES};
use crate::control::autopilot::channels::{Use, Uses};
use crate::control::contradiction::Contradiction;
use crate::control::navigation::{ALTITUDE, CHANNELS, DEPTH, GROUP, Measurement};
use crate::mission::{Limits, outside};
use crate::number::real::Real;

/// The longest time for which a stale channel in use is not told, s; its reaction may come later.
pub const TOLD_S: f64 = 10.0;

/// After so long without its readings the battery is told, s: they come once a minute on slow buses.
const BATTERY_TOLD_S: f64 = 120.0;

/// After so long without a possible one a battery whose last reading was impossible is told, s: one is a glitch.
const BATTERY_WRONG_S: f64 = 5.0;

/// A speed is off by this share of the desired one: turns and dives cost less.
pub(super) const OFF_SPEED: f64 = 0.4;

/// A speed that is held for longer through a drop-out does not follow anything, s.
const SPEED_IS_OLD_S: f64 = 2.0;

/// Who gathers or loses way comes nearer to the desired speed by this much within the time of the watch, m/s.
const CLOSER_M_S: f64 = 0.05;

/// What is watched besides the measurement.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances<'a, T> {
    /// Limits of the mission.
    pub limits: &'a Limits,
    /// How the channels are used.
    pub uses: &'a Uses,
    /// Time since the start, s.
    pub time: T,
    /// Time since the last look, s.
    pub dt: f64,
    /// 1 on a leg that follows the bottom, and on missions that keep off it.
    pub needs_altitude: T,
    /// 1 when an actuator has been declared failed.
    pub failed: T,
    /// Above zero when an actuator is given up, or suspected by the motion.
    pub distrusted: T,
    /// For how long the active waypoint has come no nearer, s.
    pub stalled: T,
    /// The depth sensor's own sample, where the measured depth is an estimate.
    pub sounded: Option<Sounded<T>>,
    /// Whether the sensors tell of one motion; nothing where none has been compared.
    pub contradiction: Option<&'a Contradiction<T>>,
    /// Desired forward speed of the last step, m/s.
    pub speed: T,
    /// For how long the battery has shown nothing, s.
    pub battery_age: T,
    /// For how long the last reading of the battery has been one that cannot be true, s.
    pub battery_wrong: T,
    /// 1 once the vehicle is up.
    pub surfaced: T,
}

/// What the depth sensor itself shows.
#[derive(Clone, Copy, Debug)]
pub struct Sounded<T> {
    /// Its last sample, m.
    pub depth: T,
    /// How old that is, s.
    pub age: T,
}

impl<T: Real> Sounded<T> {
    /// The deeper of a depth and the sample, where that is younger than `after` seconds.
    #[inline(always)]
    fn or_deeper(&self, depth: T, after: f64) -> T {
        T::select(self.age.lt(depth.splat(after)), depth.max(self.depth), depth)
    }
}

/// How the active waypoint comes nearer.
#[derive(Clone, Copy, Debug)]
pub struct Approach<T> {
    leg: T,
    nearest: T,
    /// For how long it has come no nearer, s.
    pub stalled: T,
}

/// A waypoint counts as nearer by this much, m: more than the noise of a position.
pub(super) const NEARER_M: f64 = 0.5;

crate::memory!(Approach: leg, nearest, stalled;);

impl<T: Real> Approach<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        Self { leg: unit.splat(-1.0), nearest: unit.zero(), stalled: unit.zero() }
    }

    /// Counts anew where `at` holds.
    #[inline(always)]
    pub fn restart(&mut self, at: T::Mask) {
        self.stalled = T::select(at, self.stalled.zero(), self.stalled);
    }

    /// After `dt` more seconds at a distance from the waypoint `leg`; no time runs while the vehicle is `busy` there.
    #[inline(always)]
    pub fn see(&mut self, (leg, distance): (T, T), busy: T, dt: f64) {
        let zero = distance.zero();
        let other = zero.splat(0.5).lt((leg - self.leg).abs().max(busy));
        let nearer = distance.lt(self.nearest - NEARER_M);
        let fresh = T::either(other, nearer);
        self.nearest = T::select(fresh, distance, self.nearest);
        self.stalled = T::select(fresh, zero, self.stalled + dt);
        self.leg = leg;
    }
}

/// What the watches see at one look.
pub(super) struct Seen<T> {
    /// 1 for each watch that is true.
    pub called: [T; WATCHES],
    /// 1 for each watch that is to be told, whatever it calls for.
    pub told: [T; WATCHES],
    /// The channel of each watch, counted from 1; 0 where it is of none.
    pub channel: [T; WATCHES],
    /// The deepest of the depths that may be right, m.
    pub deepest: T,
    /// The error of the speed, m/s, where it is off, else zero.
    pub off_by: T,
    /// 1 where that error has become smaller.
    pub nearer: T,
}

/// Looks at what is measured and at what is around.
#[inline(always)]
pub(super) fn look<T: Real>(
    table: &SafetyTable,
    alert: &Alert<T>,
    measured: &Measurement<T>,
    around: &Circumstances<'_, T>,
) -> Seen<T> {
    let zero = alert.level.zero();
    let (one, half) = (zero.splat(1.0), zero.splat(0.5));
    let flag = |mask: T::Mask| T::select(mask, one, zero);
    let [north, east, depth] = measured.position();
    let mut called = [zero; WATCHES];
    let mut oldest = [(zero, zero); STALE];
    let (mut told, mut unread) = ([zero; WATCHES], (zero, zero));
    for c in 0..CHANNELS {
        let Some((age, channel)) = oldest.get_mut(GROUP[c]) else { continue };
        // What was never measured counts from the start; what can be done without is not missed before its first sample.
        let since_start = around.time;
        let own = match around.uses[c] {
            Use::Idle => {
                let lost = zero.splat(table.stale()[GROUP[c]].after_s.min(TOLD_S)).lt(measured.age[c]);
                let once = measured.age[c].lt(zero.splat(f64::INFINITY));
                let lost = T::both(lost, once);
                unread =
                    (T::select(lost, one, unread.0), T::select(lost, zero.splat(c as f64 + 1.0), unread.1));
                continue;
            }
            Use::Needed => measured.age[c].min(since_start),
            Use::Replaceable => {
                let known = measured.age[c].lt(zero.splat(f64::INFINITY));
                T::select(known, measured.age[c].min(since_start), zero)
            }
        };
        *channel = T::select(age.lt(own), zero.splat(c as f64 + 1.0), *channel);
        *age = age.max(own);
    }
    for (i, stale) in table.stale().iter().enumerate() {
        called[i] = flag(zero.splat(stale.after_s).lt(oldest[i].0));
        told[i] = flag(zero.splat(stale.after_s.min(TOLD_S)).lt(oldest[i].0));
    }
    // A sensor of the altitude matters where the mission asks for one.
    called[5] *= around.needs_altitude;
    told[5] *= around.needs_altitude;
    let limits = around.limits;
    let depth = match &around.sounded {
        Some(own) => own.or_deeper(depth, table.stale_depth.after_s),
        None => depth,
    };
    let deeper = around.contradiction.map_or(depth, |c| depth.max(c.other(DEPTH, depth)));
    called[6] = flag(zero.splat(limits.depth).lt(deeper));
    called[7] = flag(measured.altitude().lt(zero.splat(limits.altitude)));
    if !limits.fence.is_empty() {
        called[8] = outside(&limits.fence, north, east);
        if let Some(c) = around.contradiction {
            called[8] = called[8].max(outside(&limits.fence, c.other(0, north), c.other(1, east)));
        }
    }
    called[9] = flag(zero.splat(limits.time).lt(around.time));
    called[10] = flag(measured.battery.lt(zero.splat(table.battery.below)));
    called[11] = around.failed;
    told[11] = flag(zero.lt(around.distrusted));
    called[12] = flag(zero.splat(table.progress.after_s).lt(around.stalled));
    let mut contradicted = [zero; 4];
    if let Some(contradiction) = around.contradiction {
        for (i, channels) in OF_CONTRADICTED.into_iter().enumerate() {
            for c in channels.rev() {
                if c < ALTITUDE - 6 {
                    called[CONTRADICTED + i] = called[CONTRADICTED + i].max(contradiction.contrary(c));
                }
                let noticed = contradiction.noticed(c, &table.contradiction);
                told[CONTRADICTED + i] = told[CONTRADICTED + i].max(noticed);
                contradicted[i] = T::select(half.lt(noticed), zero.splat(c as f64 + 1.0), contradicted[i]);
            }
        }
    }
    let shown = measured.velocity()[0];
    let most = (around.speed.abs() * OFF_SPEED).max(zero.splat(table.speed.off_m_s));
    let fresh = measured.age[6].lt(zero.splat(SPEED_IS_OLD_S));
    let error = (around.speed - shown).abs();
    let off = T::both(fresh, most.lt(error));
    let nearer = error.lt(alert.off_speed - CLOSER_M_S);
    called[SPEED] = T::select(nearer, zero, flag(off));
    let silent = zero.splat(BATTERY_TOLD_S).lt(around.battery_age);
    let wrong = zero.splat(BATTERY_WRONG_S).lt(around.battery_wrong);
    called[UNREAD] = unread.0.max(flag(T::either(silent, wrong)));
    called[ASCENT] = flag(zero.splat(table.ascent_after_s).lt(alert.no_higher));
    let mut channel = [zero; WATCHES];
    for (i, (_, stale)) in oldest.into_iter().enumerate() {
        channel[i] = stale;
    }
    channel[CONTRADICTED..SPEED].copy_from_slice(&contradicted);
    channel[UNREAD] = unread.1;
    let off_by = T::select(off, error, zero);
    Seen { called, told, channel, deepest: deeper, off_by, nearer: flag(nearer) }
}
