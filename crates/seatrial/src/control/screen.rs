//! Whether samples can be believed: what jumps, and what repeats one value while the vehicle moves.
//!
//! A **jump** is a change beyond `margin + rate · time since the last sample`, faster than any vehicle: the rate is its
//! largest velocity, turn rate or acceleration. A velocity or turn rate has a largest change as well, from full ahead to
//! full astern: however long a sensor was silent, its first sample is believed at once or it is wild. What jumps is not
//! believed until it has stayed for a second, as a reset of a sensor does and an outlier does not: until then the last
//! good value holds and grows old. The altitude may jump: the bottom has steps.
//!
//! A sensor is **frozen** when it repeats exactly one value for longer than `frozen_after_s` while the others say that it
//! must have changed. Each angle and coordinate is held against its rate, from the moment when one of the two repeats:
//!
//! ```text
//! d' = rate(ν, Θ) − (measured change)/dt − d/τ,     τ = 20 s
//! ```
//!
//! A constant value alone says nothing: at rest, on a straight line and in coarse digits it is right. With |d| beyond its
//! threshold one of the two is wrong, and the one that repeats is it; the memory τ keeps small offsets of a rate from
//! adding up. A frozen channel is as old as its value; the first other value ends it. Altitude is held against the
//! depth. Without a fresh velocity the depth is held against the desired speed along the pitch. The velocity through the
//! water has a substitute and is not held against anything.
//!
//! Kinematics: Fossen (2011), equations 2.40 and 2.41. Thresholds: this project, sized to the sensors of
//! `typical.toml` times ten and more.
//!
//! Tests: `tests/control/samples.rs`, `tests/core/test_helm_screen.py`.

use crate::control::contradiction::{Contradiction, Thresholds};
use crate::control::navigation::{ALTITUDE, CHANNELS, DEPTH, Measurement, RATES, VELOCITY, WATER, YAW};
use crate::model::kinematics::euler_rate;
use crate::number::algebra::{Vec3, Vec6};
use crate::number::real::Real;

/// What a channel may change by without being a jump: at once, and per second.
const LEAST_JUMP: [(f64, f64); CHANNELS] = [
    (20.0, 10.0),
    (20.0, 10.0),
    (2.0, 5.0),
    (0.5, 0.6),
    (0.5, 0.6),
    (0.5, 0.6),
    (1.5, 5.0),
    (1.5, 5.0),
    (1.5, 5.0),
    (1.0, 10.0),
    (1.0, 10.0),
    (1.0, 10.0),
    (f64::INFINITY, 0.0),
    (1.5, 5.0),
    (1.5, 5.0),
    (1.5, 5.0),
];

/// What a velocity, m/s, and a turn rate, rad/s, may change by after any time: the fastest vehicle from ahead to astern.
const MOST_JUMP: [f64; CHANNELS] = {
    let (mut most, mut c) = ([f64::INFINITY; CHANNELS], 0);
    while c < 3 {
        (most[VELOCITY + c], most[RATES + c], most[WATER + c]) = (15.0, 10.0, 15.0);
        c += 1;
    }
    most
};

/// A jump that stays for so long, s, is the truth.
const STAYS_S: f64 = 1.0;

/// The angles and coordinates that have a rate, which is the channel six places further.
const KINEMATIC: usize = 6;

/// What a coordinate (m), an angle (rad) and at last the altitude (m) must have changed by, when it is called frozen.
const UNMOVED: [f64; KINEMATIC + 1] = [3.0, 3.0, 1.0, 0.175, 0.175, 0.175, 2.0];

/// The same for a velocity (m) and a turn rate (rad) that repeats: positions are noisier than what they are held against.
const MOVED: [f64; KINEMATIC] = [10.0, 10.0, 3.0, 0.175, 0.175, 0.175];

/// Memory of the comparison, s.
const MEMORY_S: f64 = 20.0;

/// Beyond this age a rate says nothing, s.
const RATE_IS_OLD_S: f64 = 2.0;

/// The steepest pitch at which Euler angles are compared, rad.
const STEEPEST: f64 = 1.4;

/// The longest step of the comparison, s.
const LONGEST_S: f64 = 1.0;

/// Rounding of sums of periods, s.
const TICK_S: f64 = 1e-9;

/// How far depth, pitch and yaw moved when a jump of them was believed: m, rad.
pub type Leap<T> = Vec3<T>;

/// What is remembered of the samples.
#[derive(Clone, Debug)]
pub struct Screen<T> {
    /// What is believed, with its ages.
    believed: Measurement<T>,
    /// The last samples, and how old they were.
    told: [T; CHANNELS],
    told_age: [T; CHANNELS],
    /// For how long each channel has shown one value, s.
    same_for: [T; CHANNELS],
    /// 1 for what is frozen.
    frozen: [T; CHANNELS],
    /// How far rates and changes are apart: m, rad.
    apart: [T; KINEMATIC + 1],
    comparing: bool,
    /// What a channel jumped to, and for how long it has stayed there, s; negative where nothing jumped.
    jumped_to: [T; CHANNELS],
    stays_for: [T; CHANNELS],
    doubting: bool,
    /// Samples that were not believed.
    refused: [T; CHANNELS],
    /// Whether what is believed is of one motion.
    contradiction: Contradiction<T>,
}

crate::memory!(Screen:
    believed, told, told_age, same_for, frozen, apart, jumped_to, stays_for, refused, contradiction;
    comparing, doubting);

impl<T: Real> Screen<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        let (zeros, never) = ([unit.zero(); CHANNELS], [unit.splat(f64::INFINITY); CHANNELS]);
        Self {
            believed: Measurement::nothing(unit),
            told: zeros,
            told_age: never,
            same_for: zeros,
            frozen: zeros,
            apart: [unit.zero(); KINEMATIC + 1],
            comparing: false,
            jumped_to: zeros,
            stays_for: [unit.splat(-1.0); CHANNELS],
            doubting: false,
            refused: zeros,
            contradiction: Contradiction::new(unit),
        }
    }

    /// What is believed, with the time since it was last good.
    pub fn believed(&self) -> &Measurement<T> {
        &self.believed
    }

    /// Whether what is believed is of one motion.
    pub fn contradiction(&self) -> &Contradiction<T> {
        &self.contradiction
    }

    /// Forgets where `at` holds what contradicted each other.
    #[inline(always)]
    pub fn forget(&mut self, at: T::Mask) {
        self.contradiction.forget(at);
    }

    /// How many samples of a channel were not believed.
    pub fn refused(&self, channel: usize) -> T {
        self.refused[channel]
    }

    /// For how long, s, a channel has repeated one value, where it is frozen; else zero.
    pub fn frozen_for(&self, channel: usize) -> T {
        self.frozen[channel] * self.same_for[channel]
    }

    /// Takes what is told `dt` seconds after the last look; the desired `speed` stands in for a lost one. What moved
    /// where a jump was believed.
    #[inline(always)]
    pub fn look(
        &mut self,
        measured: &Measurement<T>,
        (frozen_after, speed): (f64, T),
        thresholds: &Thresholds,
        dt: f64,
    ) -> Option<Leap<T>> {
        let (zero, mut before) = (speed.zero(), self.believed.channels);
        let (mut jumps, mut repeats) = (zero.lt(zero), zero.lt(zero));
        let half = zero.splat(0.5 * frozen_after);
        for c in 0..ALTITUDE {
            let step = difference(measured.channels[c], before[c], c);
            jumps = T::either(
                jumps,
                T::both(self.fresh(measured, c, dt), self.allowed(measured, c, dt).lt(step.abs())),
            );
            repeats = T::either(repeats, self.repeats(measured, (c, dt), half));
        }
        repeats = T::either(repeats, self.repeats(measured, (ALTITUDE, dt), half));
        for c in WATER..CHANNELS {
            let step = measured.channels[c] - before[c];
            jumps = T::either(
                jumps,
                T::both(self.fresh(measured, c, dt), self.allowed(measured, c, dt).lt(step.abs())),
            );
        }
        let compared = self.comparing || T::any(repeats);
        let fresh = |screen: &Self| std::array::from_fn(|c| screen.fresh(measured, c, dt));
        let fresh = (self.doubting || compared || T::any(jumps)).then(|| fresh(self));
        let (mut leap, mut moved) = (None, [zero; CHANNELS]);
        match &fresh {
            Some(fresh) if self.doubting || T::any(jumps) => {
                moved = self.doubt(measured, fresh, dt);
                // A jump is no motion that a rate could tell.
                for c in 0..CHANNELS {
                    before[c] += moved[c];
                }
                leap = Some([moved[DEPTH], moved[YAW - 1], moved[YAW]]);
            }
            _ => (self.believed.channels, self.believed.age) = (measured.channels, measured.age),
        }
        (self.believed.battery, self.believed.voltage) = (measured.battery, measured.voltage);
        (self.told, self.told_age) = (measured.channels, measured.age);
        if let Some(fresh) = fresh.filter(|_| compared) {
            self.compare(&before, &fresh, (frozen_after, speed), dt.min(LONGEST_S));
            self.comparing = T::any(repeats);
        }
        self.contradiction.see(&self.believed, (&moved, &self.stays_for), thresholds, dt);
        leap
    }

    /// Where a channel has a sample that it had not at the last look.
    #[inline(always)]
    fn fresh(&self, measured: &Measurement<T>, c: usize, dt: f64) -> T::Mask {
        let younger = (measured.age[c] + TICK_S).lt(self.told_age[c] + dt);
        T::either(self.other(measured, c), younger)
    }

    /// Where a channel shows another value than at the last look.
    #[inline(always)]
    fn other(&self, measured: &Measurement<T>, c: usize) -> T::Mask {
        let (value, told) = (measured.channels[c], self.told[c]);
        T::either(value.lt(told), told.lt(value))
    }

    /// What a channel may have changed by since its last sample, believed or not: what goes on jumping stays refused.
    #[inline(always)]
    fn allowed(&self, measured: &Measurement<T>, c: usize, dt: f64) -> T {
        let (margin, rate) = LEAST_JUMP[c];
        let between = self.told_age[c] + dt - measured.age[c];
        between.mul_add(between.splat(rate), between.splat(margin)).min(between.splat(MOST_JUMP[c]))
    }

    /// Counts for how long a channel has shown one value, and where that is `long`.
    #[inline(always)]
    fn repeats(&mut self, measured: &Measurement<T>, (c, dt): (usize, f64), long: T) -> T::Mask {
        let zero = long.zero();
        let longer = T::select(self.other(measured, c), zero, self.same_for[c] + dt);
        // What was never measured, or is out of reach, repeats nothing.
        let seen = measured.age[c].max(measured.channels[c]).lt(zero.splat(f64::INFINITY));
        self.same_for[c] = T::select(seen, longer, zero);
        long.lt(self.same_for[c])
    }

    /// Keeps what jumps from being believed until it has stayed; what moved where a jump was believed.
    #[inline(always)]
    fn doubt(&mut self, measured: &Measurement<T>, fresh: &[T::Mask; CHANNELS], dt: f64) -> [T; CHANNELS] {
        let zero = measured.battery.zero();
        let one = zero.splat(1.0);
        let mut doubts = zero.lt(zero);
        let mut moved = [zero; CHANNELS];
        for c in 0..CHANNELS {
            let (value, was) = (measured.channels[c], self.believed.channels[c]);
            let allowed = self.allowed(measured, c, dt);
            let jumps = T::both(fresh[c], allowed.lt(difference(value, was, c).abs()));
            let near = difference(value, self.jumped_to[c], c).abs().lt(allowed);
            let pending = zero.splat(-0.5).lt(self.stays_for[c]);
            let longer = self.stays_for[c] + dt;
            let again = T::both(pending, near);
            let stayed = T::both(jumps, T::both(again, zero.splat(STAYS_S - TICK_S).lt(longer)));
            let waits = T::select(again, longer, zero);
            let waits = T::select(fresh[c], T::select(jumps, waits, -one), T::select(pending, longer, -one));
            self.stays_for[c] = T::select(stayed, -one, waits);
            self.jumped_to[c] = T::select(jumps, value, self.jumped_to[c]);
            moved[c] = T::select(stayed, difference(value, was, c), zero);
            self.refused[c] += T::select(jumps, T::select(stayed, zero, one), zero);
            let pick =
                |new: T, old: T| T::select(jumps, T::select(stayed, new, old), T::select(fresh[c], new, old));
            self.believed.channels[c] = pick(value, was);
            self.believed.age[c] = pick(measured.age[c], self.believed.age[c] + dt);
            doubts = T::either(doubts, zero.splat(-0.5).lt(self.stays_for[c]));
        }
        self.doubting = T::any(doubts);
        moved
    }

    /// Holds what repeats against its rate, and finds what is frozen.
    #[inline(always)]
    fn compare(
        &mut self,
        before: &[T; CHANNELS],
        fresh: &[T::Mask; CHANNELS],
        (frozen_after, speed): (f64, T),
        dt: f64,
    ) {
        let zero = speed.zero();
        let expected = self.expected(speed);
        let now = self.believed.channels;
        let share = MEMORY_S / (MEMORY_S + dt);
        let half = zero.splat(0.5 * frozen_after);
        for k in 0..=KINEMATIC {
            let (change, longest) = if k == KINEMATIC {
                (before[DEPTH] - now[DEPTH], self.same_for[ALTITUDE])
            } else {
                let change = difference(now[k], before[k], k);
                (expected[k] * dt - change, self.same_for[k].max(self.same_for[k + KINEMATIC]))
            };
            self.apart[k] = T::select(half.lt(longest), (self.apart[k] + change) * share, zero);
        }
        let (sine, cosine) = now[YAW].sin_cos();
        let [north, east, ..] = self.apart;
        let along = [cosine * north + sine * east, cosine * east - sine * north];
        for c in 0..=ALTITUDE {
            let (apart, least) = match c {
                ALTITUDE => (self.apart[KINEMATIC], UNMOVED[KINEMATIC]),
                VELOCITY | 7 => (along[c - VELOCITY], MOVED[c - VELOCITY]),
                8.. => (self.apart[c - KINEMATIC], MOVED[c - KINEMATIC]),
                _ => (self.apart[c], UNMOVED[c]),
            };
            let long = T::both(fresh[c], zero.splat(frozen_after).lt(self.same_for[c]));
            let found = T::both(long, zero.splat(least).lt(apart.abs()));
            let still = T::select(half.lt(self.same_for[c]), self.frozen[c], zero);
            self.frozen[c] = T::select(found, zero.splat(1.0), still);
            let frozen = zero.lt(self.frozen[c]);
            let refused = T::select(fresh[c], self.frozen[c], zero);
            self.refused[c] += refused;
            self.believed.age[c] =
                T::select(frozen, self.believed.age[c].max(self.same_for[c]), self.believed.age[c]);
        }
    }

    /// The rates of position (m/s) and attitude (rad/s) by the velocities and turn rates that are fresh.
    #[inline(always)]
    fn expected(&self, speed: T) -> Vec6<T> {
        let (known, zero) = (&self.believed, speed.zero());
        let young = |c: usize| known.age[c].lt(zero.splat(RATE_IS_OLD_S));
        let mut nu = [zero; 6];
        for i in 0..6 {
            nu[i] = T::select(young(VELOCITY + i), known.channels[VELOCITY + i], zero);
        }
        let [roll, pitch, yaw] = known.attitude();
        // Nearer to the vertical, roll and yaw mean nothing.
        let pitch = pitch.clamped(zero.splat(-STEEPEST), zero.splat(STEEPEST));
        let mut rates = euler_rate(&[roll, pitch, yaw], &nu);
        let (sine, _) = pitch.sin_cos();
        rates[DEPTH] -= sine * T::select(young(VELOCITY), zero, speed);
        rates
    }
}

/// From one value of a channel to another, angles the shorter way.
#[inline(always)]
fn difference<T: Real>(to: T, from: T, channel: usize) -> T {
    let difference = to - from;
    if channel == 3 || channel == YAW { difference.wrap() } else { difference }
}
