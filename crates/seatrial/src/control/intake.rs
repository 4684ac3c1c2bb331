//! Samples of a vehicle at sea as they arrive: ages by the real time, and what cannot be true.
//!
//! What is not a number was not measured. A number beyond what any marine vehicle can measure ([`Quantity::range`]) was
//! not measured either: the channel grows older, and the watch over its age reacts. It is counted, never an error:
//! garbage must not stop a vehicle under way. Roll and yaw may be unwrapped: beyond one turn they must have come there without a jump.
//! An age that is not a number, or infinite, brings no sample; the channel then ages by the time that passes.
//!
//! The intake is the first part of the autopilot's step, and so of every program that is exported: nothing behind it ever
//! computes with a value that is not a number, infinite (the altitude apart) or out of range.
//!
//! What is possible and still wrong, a jump or a sensor that repeats one value, is found by [`crate::control::screen`].
//!
//! Tests: `tests/control/samples.rs`, `tests/export.rs`, `tests/core/test_helm_samples.py`.

use crate::control::navigation::{ALTITUDE, CHANNELS, Measurement, YAW};
use crate::number::real::Real;
use std::f64::consts::PI;
use std::fmt;

/// What a helm is told, one number each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A channel of the motion, in the order of [`crate::control::navigation::CHANNEL_NAMES`].
    Channel(usize),
    /// Share of the battery that is left.
    Battery,
    /// Supply voltage, V.
    Voltage,
}

/// What is possible: lowest and highest value per channel, and its unit. Local plans may use map coordinates; 12 km is
/// deeper than any sea; 50 m/s and 20 rad/s are faster than any marine vehicle.
const RANGES: [(f64, f64, &str); CHANNELS] = [
    (-2e7, 2e7, "m"),
    (-2e7, 2e7, "m"),
    (-100.0, 12e3, "m"),
    (-6.3, 6.3, "rad"),
    (-3.2, 3.2, "rad"),
    (-6.3, 6.3, "rad"),
    (-50.0, 50.0, "m/s"),
    (-50.0, 50.0, "m/s"),
    (-50.0, 50.0, "m/s"),
    (-20.0, 20.0, "rad/s"),
    (-20.0, 20.0, "rad/s"),
    (-20.0, 20.0, "rad/s"),
    (-1.0, 12e3, "m"),
    (-50.0, 50.0, "m/s"),
    (-50.0, 50.0, "m/s"),
    (-50.0, 50.0, "m/s"),
];

impl Quantity {
    /// Lowest and highest possible value, and the unit.
    pub fn range(self) -> (f64, f64, &'static str) {
        match self {
            Self::Channel(c) => RANGES[c],
            Self::Battery => (0.0, 1.0, ""),
            Self::Voltage => (1e-3, 1e4, "V"),
        }
    }

    fn place(self) -> usize {
        match self {
            Self::Channel(c) => c,
            Self::Battery => CHANNELS,
            Self::Voltage => CHANNELS + 1,
        }
    }
}

/// How far a value may lie outside its range by rounding alone.
const ROUNDING: f64 = 1e-9;

/// The largest angle that an unwrapped roll or yaw may reach, rad: a thousand turns and more.
const MOST_TURNED: f64 = 1e4;

/// Samples that were refused because they cannot be true.
#[derive(Clone, Copy, Debug)]
pub struct Impossible {
    /// How many.
    pub count: f64,
    /// The last of them.
    pub last: f64,
    /// Of what.
    pub of: Quantity,
}

impl fmt::Display for Impossible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high, unit) = self.of.range();
        match self.of {
            Quantity::Battery => write!(f, "expected the share left, from 0 to 1, found {}", self.last),
            Quantity::Voltage => write!(f, "expected a positive supply in {unit}, found {}", self.last),
            Quantity::Channel(_) => write!(f, "expected {low} to {high} {unit}, found {}", self.last),
        }
    }
}

/// Channels, battery and voltage.
const QUANTITIES: usize = CHANNELS + 2;

/// What has arrived so far.
#[derive(Clone, Debug)]
pub struct Intake<T> {
    measured: Measurement<T>,
    /// For how long no possible reading of the battery has come, s; zero before the first.
    battery_age: T,
    battery_known: T,
    /// 1 where its last reading was impossible, and for how long no possible one has come since the first of them, s.
    battery_refused: T,
    battery_wrong: T,
    /// How many samples were refused, and the last of them, by [`Quantity::place`].
    count: [T; QUANTITIES],
    last: [T; QUANTITIES],
}

crate::memory!(Intake: measured, battery_age, battery_known, battery_refused, battery_wrong, count, last;);

impl<T: Real> Intake<T> {
    /// Nothing has arrived.
    pub fn new(unit: T) -> Self {
        Self {
            measured: Measurement::nothing(unit),
            battery_age: unit.zero(),
            battery_known: unit.zero(),
            battery_refused: unit.zero(),
            battery_wrong: unit.zero(),
            count: [unit.zero(); QUANTITIES],
            last: [unit.zero(); QUANTITIES],
        }
    }

    /// The last possible samples with their ages.
    pub fn measured(&self) -> &Measurement<T> {
        &self.measured
    }

    /// For how long, s, the battery has shown nothing possible although it once did.
    pub fn battery_age(&self) -> T {
        self.battery_age
    }

    /// For how long, s, the battery has shown nothing but what is impossible; silence is none of it.
    pub fn battery_wrong(&self) -> T {
        self.battery_wrong
    }

    /// Lets `seconds` pass: everything grows older.
    #[inline(always)]
    pub fn elapse(&mut self, seconds: f64) {
        for age in &mut self.measured.age {
            *age = *age + seconds;
        }
        self.battery_age += self.battery_known * seconds;
        self.battery_wrong += self.battery_refused * seconds;
    }

    /// Takes a whole measurement, `seconds` after the last one: every sample with the age that comes with it.
    #[inline(always)]
    pub fn take_all(&mut self, told: &Measurement<T>, seconds: f64) {
        self.elapse(seconds);
        for c in 0..CHANNELS {
            self.take_aged(c, told.channels[c], told.age[c]);
        }
        self.take(Quantity::Battery, told.battery);
        self.measured.voltage = told.voltage;
    }

    /// Takes a sample of now, or refuses and counts it; what is not a number is no sample.
    #[inline(always)]
    pub fn take(&mut self, of: Quantity, value: T) {
        match of {
            Quantity::Channel(c) => self.take_aged(c, value, value.zero()),
            Quantity::Battery => {
                let possible = self.possible(of, value);
                self.measured.battery = T::select(possible, value, self.measured.battery);
                self.battery_age = T::select(possible, value.zero(), self.battery_age);
                self.battery_known = T::select(possible, value.splat(1.0), self.battery_known);
                let refused = self.refuse(of, value, (value.zero().lt(value.splat(1.0)), possible));
                self.battery_refused = T::select(possible, value.zero(), self.battery_refused.max(refused));
                self.battery_wrong *= self.battery_refused;
            }
            Quantity::Voltage => {
                let possible = self.possible(of, value);
                if T::any(possible) {
                    self.measured.voltage = value.largest();
                }
                self.refuse(of, value, (value.zero().lt(value.splat(1.0)), possible));
            }
        }
    }

    /// Takes a sample of a channel that is `age` seconds old.
    #[inline(always)]
    fn take_aged(&mut self, c: usize, value: T, age: T) {
        let of = Quantity::Channel(c);
        let possible = self.possible(of, value);
        let comes = age.lt(age.splat(f64::INFINITY));
        let taken = T::both(comes, possible);
        self.measured.channels[c] = T::select(taken, value, self.measured.channels[c]);
        self.measured.age[c] = T::select(taken, age.max(age.zero()), self.measured.age[c]);
        self.refuse(of, value, (comes, possible));
    }

    /// Counts a sample that `comes`, is a number and is not `possible`; 1 where it is one.
    #[inline(always)]
    fn refuse(&mut self, of: Quantity, value: T, (comes, possible): (T::Mask, T::Mask)) -> T {
        let place = of.place();
        let number = T::either(value.lt(value.splat(f64::INFINITY)), value.zero().lt(value));
        let (one, zero) = (value.splat(1.0), value.zero());
        let refused = T::select(possible, zero, T::select(T::both(comes, number), one, zero));
        self.count[place] += refused;
        self.last[place] = T::select(zero.lt(refused), value, self.last[place]);
        refused
    }

    /// Where a sample of now can be true.
    #[inline(always)]
    pub fn possible(&self, of: Quantity, value: T) -> T::Mask {
        let (low, high, _) = of.range();
        // Not a number and an infinite one are no rounding away from a bound.
        let beyond = value - value.clamped(value.splat(low), value.splat(high));
        let within = beyond.abs().lt(value.splat(ROUNDING));
        match of {
            // No bottom within reach is a measurement.
            Quantity::Channel(ALTITUDE) => {
                let finite = T::select(value.lt(value.splat(f64::INFINITY)), value.splat(1.0), value.zero());
                let unbounded = T::both(value.zero().lt(value), finite.lt(value.splat(0.5)));
                T::either(within, unbounded)
            }
            Quantity::Channel(c @ (3 | YAW)) => {
                let (last, age) = (self.measured.channels[c], self.measured.age[c]);
                // Half a turn, and another for each second in between.
                let reach = (age + 1.0) * PI;
                let near = T::both(age.lt(age.splat(f64::INFINITY)), (value - last).abs().lt(reach));
                T::either(within, T::both(near, value.abs().lt(value.splat(MOST_TURNED))))
            }
            _ => within,
        }
    }
}

impl Intake<f64> {
    /// What was refused, if anything.
    pub fn refused(&self) -> impl Iterator<Item = Impossible> {
        let quantities = (0..CHANNELS).map(Quantity::Channel).chain([Quantity::Battery, Quantity::Voltage]);
        let of = |of: Quantity| {
            let (count, last) = (self.count[of.place()], self.last[of.place()]);
            Impossible { count, last, of }
        };
        quantities.map(of).filter(|refused| refused.count > 0.0)
    }
}
