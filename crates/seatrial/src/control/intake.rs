//! Samples of a vehicle at sea as they arrive: ages by the real time, and what cannot be true.
//!
//! What is not a number was not measured. A number beyond what any marine vehicle can measure ([`Quantity::range`]) was
//! not measured either: the channel grows older, and the watch over its age reacts. It is counted, never an error:
//! garbage must not stop a vehicle under way. Roll and yaw may be unwrapped: beyond one turn they must have come there without a jump.
//!
//! What is possible and still wrong, a jump or a sensor that repeats one value, is found by [`crate::control::screen`].
//!
//! Tests: `tests/control/samples.rs`, `tests/core/test_helm_samples.py`.

use crate::control::navigation::{ALTITUDE, CHANNELS, Measurement, YAW};
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
            Self::Voltage => (f64::MIN_POSITIVE, 1e4, "V"),
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

/// Samples that were refused because they cannot be true.
#[derive(Clone, Copy, Debug)]
pub struct Impossible {
    /// How many.
    pub count: u64,
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

/// What has arrived so far.
#[derive(Clone, Debug)]
pub struct Intake {
    measured: Measurement<f64>,
    refused: [Impossible; CHANNELS + 2],
}

impl Default for Intake {
    fn default() -> Self {
        let quantities = (0..CHANNELS).map(Quantity::Channel).chain([Quantity::Battery, Quantity::Voltage]);
        let mut refused = [Impossible { count: 0, last: f64::NAN, of: Quantity::Battery }; CHANNELS + 2];
        refused.iter_mut().zip(quantities).for_each(|(place, of)| place.of = of);
        Self { measured: Measurement::nothing(0.0), refused }
    }
}

impl Intake {
    /// The last possible samples with their ages.
    pub fn measured(&self) -> &Measurement<f64> {
        &self.measured
    }

    /// Lets `seconds` pass: everything grows older.
    pub fn elapse(&mut self, seconds: f64) {
        for age in &mut self.measured.age {
            *age += seconds;
        }
    }

    /// Takes a sample of now, or refuses and counts it; what is not a number is no sample.
    pub fn take(&mut self, of: Quantity, value: f64) {
        if value.is_nan() {
            return;
        }
        if !self.possible(of, value) {
            let refused = &mut self.refused[of.place()];
            (refused.count, refused.last) = (refused.count + 1, value);
            return;
        }
        match of {
            Quantity::Channel(c) => (self.measured.channels[c], self.measured.age[c]) = (value, 0.0),
            Quantity::Battery => self.measured.battery = value,
            Quantity::Voltage => self.measured.voltage = value,
        }
    }

    /// Whether a sample of now can be true.
    pub fn possible(&self, of: Quantity, value: f64) -> bool {
        let (low, high, _) = of.range();
        let unwrapped = |c: usize| {
            let (last, age) = (self.measured.channels[c], self.measured.age[c]);
            // Half a turn, and another for each second in between.
            age.is_finite() && (value - last).abs() < PI * (1.0 + age) && value.abs() < 1e4
        };
        match of {
            // No bottom within reach is a measurement.
            Quantity::Channel(ALTITUDE) if value == f64::INFINITY => true,
            Quantity::Channel(c @ (3 | YAW)) => (low..=high).contains(&value) || unwrapped(c),
            _ => (low..=high).contains(&value),
        }
    }

    /// What was refused, if anything.
    pub fn refused(&self) -> impl Iterator<Item = &Impossible> {
        self.refused.iter().filter(|refused| refused.count > 0)
    }
}
