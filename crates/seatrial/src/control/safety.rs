//! What the autopilot watches, and what it does then: go on, hold, surface or abort.
//!
//! | watch | true when |
//! |---|---|
//! | `stale_position` … `stale_altitude` | no good sample for so many seconds of one of the group's channels in use |
//! | `depth`, `altitude`, `fence`, `time` | a limit of the mission is passed |
//! | `battery` | less than the share is left |
//! | `actuator` | an actuator does not follow its command |
//! | `progress` | the active waypoint has come no nearer for so many seconds |
//! | `contradicted_position` … `contradicted_velocity` | the sensors tell of two motions ([`crate::control::contradiction`]) |
//! | `speed` | the measured forward speed has stayed away from the desired one |
//! | `unread` | a channel that nothing reads, or the battery, has fallen silent |
//! | `ascent` | the reaction *surface* has brought the vehicle no higher |
//!
//! The reactions are ordered, hold < surface < abort. The strongest that was called for stays: a vehicle that turns
//! back at a limit must not take up its mission again. What a contradiction called for is left when that is over
//! ([`Thresholds::over_after_s`]), unless the vehicle has surfaced, and the operator's reset leaves everything
//! ([`Alert::reset`]): the mission goes on where it was interrupted. *Hold* keeps the station, or circles where the vehicle cannot;
//! *surface* comes up under control; *abort* stops all actuators and lets buoyancy bring the vehicle up.
//!
//! A watch that calls for nothing, or does not yet, is told all the same: as a cause without a reaction, for as long as it
//! is true. Stale channels are told after [`TOLD_S`] at the latest, contradictions at once. The reaction to a contradiction is that of the stale
//! group: a depth that cannot be right is no depth. Depth and fence are held against both that contradict each other, and
//! the worse counts. Who surfaces by a depth that is contradicted goes up whatever it shows. Where *surface* does not work,
//! the vehicle aborts, if that is what its file lets it do without a depth: one that is heavier than water would sink.
//!
//! Every channel grows old by itself: yaw that is lost while roll and pitch arrive is stale attitude. Which channels are
//! in use says [`crate::control::autopilot::channels`]. Samples that jump and
//! sensors that repeat one value grow old too ([`crate::control::screen`]). A limit must be passed for a second, since one
//! sample may be wrong.
//!
//! Where a navigation filter tells the depth, the limit is held against the depth sensor's own sample as well, and the
//! deeper of the two counts: to a filter that knows of a sea the waves are noise, and the vehicle still goes that deep.
//! The altitude is the sensor's own in any case.
//!
//! Tests: `tests/closed_loop/safety.rs` (each watch, each reaction).

use crate::control::autopilot::channels::{Use, Uses};
use crate::control::contradiction::{Contradiction, Thresholds};
use crate::control::navigation::{ALTITUDE, CHANNELS, DEPTH, GROUP, GROUP_NAMES, Measurement};
use crate::mission::{Limits, outside};
use crate::number::real::Real;
use serde::{Deserialize, Serialize};

/// What is done when a watch is true, in rising order.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq, PartialOrd, Ord)]
#[serde(rename_all = "lowercase")]
pub enum Reaction {
    /// The mission goes on.
    #[default]
    Continue,
    /// Station-keeping, or a circle.
    Hold,
    /// Up to the surface under control.
    Surface,
    /// All actuators stop.
    Abort,
}

/// The names of the reactions by their level.
pub const REACTIONS: [&str; 4] = ["continue", "hold", "surface", "abort"];

/// The number of watches.
pub const WATCHES: usize = 20;

/// The number of watches over the age of a group's channels, which are the first.
const STALE: usize = 6;

/// The names of the watches; cause `i + 1` is watch `i`, cause 0 is none.
pub const WATCH_NAMES: [&str; WATCHES] = [
    "stale_position",
    "stale_depth",
    "stale_attitude",
    "stale_velocity",
    "stale_rates",
    "stale_altitude",
    "depth",
    "altitude",
    "fence",
    "time",
    "battery",
    "actuator",
    "progress",
    "contradicted_position",
    "contradicted_depth",
    "contradicted_attitude",
    "contradicted_velocity",
    "speed",
    "unread",
    "ascent",
];

/// The first watch over contradictions, and the channels of each of the four.
const CONTRADICTED: usize = 13;
const OF_CONTRADICTED: [std::ops::Range<usize>; 4] = [0..2, 2..3, 3..6, 6..9];

/// The watches behind them.
const SPEED: usize = 17;
const UNREAD: usize = 18;
const ASCENT: usize = 19;

/// The number that stands for a contradicted depth as the cause of an alert.
pub const CONTRADICTED_DEPTH: f64 = (CONTRADICTED + 2) as f64;

/// The longest time for which a stale channel in use is not told, s; its reaction may come later.
pub const TOLD_S: f64 = 10.0;

/// After so long without its readings the battery is told, s: they come once a minute on slow buses.
const BATTERY_TOLD_S: f64 = 120.0;

/// What should come, samples or the waypoint, and does not.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Stale {
    /// Without it for so long, s.
    pub after_s: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// The watches that compare a measurement with a limit: depth, altitude, fence and battery.
const MEASURED_LIMITS: [usize; 4] = [6, 7, 8, 10];

/// The battery.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// Share of the charge below which it is low.
    pub below: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// Actuators whose measured signal does not follow.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ActuatorWatch {
    /// Deviation from the expected signal, as a share of the largest one.
    pub deviation: f64,
    /// For so long, s.
    pub after_s: f64,
    /// What is done besides allocating anew without it.
    pub reaction: Reaction,
}

/// A forward speed that stays away from the desired one.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct SpeedWatch {
    /// By so much at least, m/s, and by [`OFF_SPEED`] of the desired speed.
    pub off_m_s: f64,
    /// For so long, s.
    pub after_s: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// A speed is off by this share of the desired one: turns and dives cost less.
const OFF_SPEED: f64 = 0.4;

/// A speed that is held for longer through a drop-out does not follow anything, s.
const SPEED_IS_OLD_S: f64 = 2.0;

/// Who gathers or loses way comes nearer to the desired speed by this much within the time of the watch, m/s.
const CLOSER_M_S: f64 = 0.05;

/// The table `[safety]` of the autopilot file.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct SafetyTable {
    /// Forward speed while surfacing, m/s.
    pub surface_speed_m_s: f64,
    /// Depth at which the vehicle counts as surfaced, m.
    pub surfaced_above_m: f64,
    /// A channel that repeats one value for so long, s, while the others say that it must have changed, is frozen: it
    /// is as old as that value.
    pub frozen_after_s: f64,
    /// Horizontal position.
    pub stale_position: Stale,
    /// Depth.
    pub stale_depth: Stale,
    /// Roll, pitch and heading.
    pub stale_attitude: Stale,
    /// Velocity over ground.
    pub stale_velocity: Stale,
    /// Turn rates.
    pub stale_rates: Stale,
    /// Altitude, on legs that follow the bottom and on missions with a least altitude.
    pub stale_altitude: Stale,
    /// The mission's largest depth is passed.
    pub depth: Reaction,
    /// The altitude is below the mission's smallest one.
    pub altitude: Reaction,
    /// The vehicle is outside the mission's fence.
    pub fence: Reaction,
    /// The mission takes longer than its limit.
    pub time: Reaction,
    /// The battery is low.
    pub battery: Battery,
    /// An actuator does not follow.
    pub actuator: ActuatorWatch,
    /// The waypoint comes no nearer.
    pub progress: Stale,
    /// From where on sensors contradict each other.
    pub contradiction: Thresholds,
    /// The speed does not follow.
    pub speed: SpeedWatch,
    /// While surfacing the vehicle must come half a metre higher within so long, s.
    pub ascent_after_s: f64,
}

impl Default for SafetyTable {
    fn default() -> Self {
        let stale = |after_s, reaction| Stale { after_s, reaction };
        Self {
            surface_speed_m_s: 0.5,
            surfaced_above_m: 0.5,
            frozen_after_s: 2.0,
            // It is told after ten seconds, and the fence is held against dead reckoning meanwhile, which a log that is
            // off by 0.05 m/s and a heading by 6° lead 12 m astray in this time at 1.5 m/s.
            stale_position: stale(60.0, Reaction::Surface),
            stale_depth: stale(5.0, Reaction::Abort),
            stale_attitude: stale(2.0, Reaction::Abort),
            stale_velocity: stale(20.0, Reaction::Surface),
            stale_rates: stale(2.0, Reaction::Abort),
            stale_altitude: stale(20.0, Reaction::Surface),
            depth: Reaction::Surface,
            altitude: Reaction::Surface,
            fence: Reaction::Hold,
            time: Reaction::Surface,
            battery: Battery { below: 0.1, reaction: Reaction::Surface },
            actuator: ActuatorWatch { deviation: 0.2, after_s: 2.0, reaction: Reaction::Continue },
            progress: stale(120.0, Reaction::Surface),
            contradiction: Thresholds::default(),
            speed: SpeedWatch { off_m_s: 0.3, after_s: 8.0, reaction: Reaction::Continue },
            ascent_after_s: 30.0,
        }
    }
}

impl SafetyTable {
    /// What is wrong with the table, if anything.
    pub fn complaint(&self) -> Option<String> {
        let stale = self.stale();
        let times =
            stale.iter().zip(GROUP_NAMES).map(|(s, name)| (format!("stale_{name}.after_s"), s.after_s));
        let others = [
            ("surface_speed_m_s".to_owned(), self.surface_speed_m_s),
            ("surfaced_above_m".to_owned(), self.surfaced_above_m),
            ("frozen_after_s".to_owned(), self.frozen_after_s),
            ("actuator.after_s".to_owned(), self.actuator.after_s),
            ("actuator.deviation".to_owned(), self.actuator.deviation),
            ("progress.after_s".to_owned(), self.progress.after_s),
            ("contradiction.position_m".to_owned(), self.contradiction.position_m),
            ("contradiction.depth_m".to_owned(), self.contradiction.depth_m),
            ("contradiction.angle_deg".to_owned(), self.contradiction.angle_deg),
            ("contradiction.roughness_m_s".to_owned(), self.contradiction.roughness_m_s),
            ("contradiction.heading_off_deg".to_owned(), self.contradiction.heading_off_deg),
            ("contradiction.pitch_off_deg".to_owned(), self.contradiction.pitch_off_deg),
            ("contradiction.gyro_off_deg_s".to_owned(), self.contradiction.gyro_off_deg_s),
            ("contradiction.after_s".to_owned(), self.contradiction.after_s),
            ("contradiction.over_after_s".to_owned(), self.contradiction.over_after_s),
            ("speed.off_m_s".to_owned(), self.speed.off_m_s),
            ("speed.after_s".to_owned(), self.speed.after_s),
            ("ascent_after_s".to_owned(), self.ascent_after_s),
        ];
        let wrong = times.chain(others).find(|(_, x)| x.is_nan() || *x <= 0.0);
        if let Some((key, x)) = wrong {
            return Some(format!("safety.{key}: expected a positive number, found {x}"));
        }
        let below = self.battery.below;
        if !(0.0..1.0).contains(&below) {
            return Some(format!("safety.battery.below: expected a share from 0 to 1, found {below}"));
        }
        None
    }

    fn stale(&self) -> [Stale; STALE] {
        [
            self.stale_position,
            self.stale_depth,
            self.stale_attitude,
            self.stale_velocity,
            self.stale_rates,
            self.stale_altitude,
        ]
    }

    #[inline(always)]
    fn reactions(&self) -> [Reaction; WATCHES] {
        [
            self.stale_position.reaction,
            self.stale_depth.reaction,
            self.stale_attitude.reaction,
            self.stale_velocity.reaction,
            self.stale_rates.reaction,
            self.stale_altitude.reaction,
            self.depth,
            self.altitude,
            self.fence,
            self.time,
            self.battery.reaction,
            self.actuator.reaction,
            self.progress.reaction,
            self.stale_position.reaction,
            self.stale_depth.reaction,
            self.stale_attitude.reaction,
            Reaction::Continue,
            self.speed.reaction,
            Reaction::Continue,
            if self.stale_depth.reaction == Reaction::Abort { Reaction::Abort } else { Reaction::Continue },
        ]
    }
}

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
    no_higher: T,
    /// The smallest error of the speed since it is off, m/s.
    off_speed: T,
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
}

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

/// So far below the highest point of its way up a vehicle sinks, m, and the time counts so many times then.
const SINKS_M: f64 = 2.0;
const SINKING_COUNTS: f64 = 10.0;

/// A waypoint counts as nearer by this much, m: more than the noise of a position.
const NEARER_M: f64 = 0.5;

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

/// The alert after one more look.
#[inline(always)]
pub fn watch<T: Real>(
    table: &SafetyTable,
    alert: &Alert<T>,
    measured: &Measurement<T>,
    around: &Circumstances<'_, T>,
) -> Alert<T> {
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
    called[UNREAD] = unread.0.max(flag(zero.splat(BATTERY_TOLD_S).lt(around.battery_age)));
    called[ASCENT] = flag(zero.splat(table.ascent_after_s).lt(alert.no_higher));
    let mut next = *alert;
    let any = called[CONTRADICTED..SPEED].iter().fold(zero, |any, &x| any.max(x));
    next.calm_for = T::select(half.lt(any), zero, next.calm_for + around.dt);
    next.leave(around.surfaced, table.contradiction.over_after_s);
    next.rise(deeper, around.surfaced, around.dt);
    let begins = T::either(nearer, alert.lasting[SPEED].lt(half * around.dt));
    next.off_speed = T::select(off, T::select(begins, error, alert.off_speed), zero);
    let channel = |i: usize| match i {
        0..STALE => oldest[i].1,
        _ if (CONTRADICTED..SPEED).contains(&i) => contradicted[i - CONTRADICTED],
        UNREAD => unread.1,
        _ => zero,
    };
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
        next.channel = T::select(stronger, channel(i), next.channel);
        next.since = T::select(stronger, around.time, next.since);
        if !(CONTRADICTED..SPEED).contains(&i) {
            let firmer = T::both(half.lt(called[i]), next.firm[0].lt(level));
            let now = [level, zero.splat(i as f64 + 1.0), channel(i), around.time];
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
        (cause, of) = (T::select(this, zero.splat(i as f64 + 1.0), cause), T::select(this, channel(i), of));
    }
    next.cause = T::select(calm, cause, next.cause);
    next.channel = T::select(calm, of, next.channel);
    next
}
