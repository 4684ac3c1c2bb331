//! What a navigation filter is made of: kinds of sensors and their channels, landmarks, noise.
//!
//! Tests: `tests/flight/test_navigation.py`, `tests/fixed_memory.rs`.

use crate::control::navigation::{ALTITUDE, CHANNEL_NAMES, CHANNELS};
use crate::description::Description;
use crate::filter::innovation::Gate;
use crate::filter::observation::{Observation, Surface};
use crate::filter::swell::Swell;
use crate::filter::tracker::Noise;
use crate::model::kinematics::{Quaternion, rotation};
use crate::model::vehicle::Vehicle;
use crate::number::algebra::{Vec3, product, splat};
use crate::number::plain;
use crate::number::real::Real;

/// The kinds of sensors.
pub const KINDS: [&str; 11] = [
    "position",
    "gps",
    "usbl",
    "depth",
    "attitude",
    "dvl",
    "gyro",
    "dvl_water",
    "altitude",
    "range",
    "bearing",
];

pub(crate) const POSITION_FIX: usize = 0;
/// The kind of a GPS among [`KINDS`].
pub const GPS: usize = 1;
/// The kind of an acoustic positioning system.
pub const USBL: usize = 2;
pub(crate) const DEPTH: usize = 3;
pub(crate) const ATTITUDE_SENSOR: usize = 4;
pub(crate) const DVL: usize = 5;
pub(crate) const GYRO: usize = 6;
pub(crate) const DVL_WATER: usize = 7;
pub(crate) const ECHO_SOUNDER: usize = 8;
/// The kind of what measures ranges.
pub const RANGE: usize = 9;
/// The kind of what measures bearings.
pub const BEARING: usize = 10;

/// Deviation of the acceleration that an identified model does not explain, m/s² and rad/s².
const MODEL_ERROR: f64 = 0.03;

/// The velocity that white acceleration makes in a second where the model is an identified one, m/s and rad/s.
const FASTER: f64 = 0.005;

/// Deviation of the acceleration where the vehicle is simulated by the model itself, m/s² and rad/s²; a slim hull has the
/// least inertia in roll, where what an offset of the attitude does lasts.
const ROUNDED: [f64; 6] = [0.005, 0.005, 0.005, 0.004, 0.001, 0.001];

/// Share of [`ROUNDED`] along the axes that is left in gusts, which are then the force: from 0.05 m/s on much more.
const QUIET: f64 = 0.1;

/// Velocity that white acceleration makes in a second there, in deviations of the noise of what measures it.
const UNSEEN: f64 = 0.05;

/// Moment per small angle that turns a vehicle upright, N m/rad.
pub(crate) fn righting(vehicle: &Vehicle<f64>) -> f64 {
    vehicle.restoring.moment[2].abs()
}

/// The channels besides those of [`CHANNEL_NAMES`]: fixes of a GPS and of an acoustic positioning system, m.
pub const FIXES: [&str; 5] = ["gps_x", "gps_y", "usbl_x", "usbl_y", "usbl_z"];

/// The first channel of the landmarks: range and bearing of each follow.
pub const LANDMARKS: usize = CHANNELS + FIXES.len();

/// A sensor of one kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// Standard deviation of a sample's noise, SI.
    pub noise: f64,
    /// Standard deviation of its constant offset; for the gyro a state of the filter.
    pub bias: f64,
    /// Age of a sample when it arrives, s.
    pub latency: f64,
    /// Lever arm from O, body frame, m.
    pub arm: Vec3<f64>,
    /// Attitude of the sensor in the body frame.
    pub mount: Quaternion<f64>,
}

impl Instrument {
    /// A sensor at O along the body's axes.
    pub fn of(noise: f64) -> Self {
        Self { noise, bias: 0.0, latency: 0.0, arm: [0.0; 3], mount: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// What is known of the place of a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Landmark {
    /// A transponder, NED, m.
    Beacon(Vec3<f64>),
    /// A wall, a net or the bottom.
    Surface(Surface),
}

impl Landmark {
    /// What its range shows, or of a beacon its bearing; `beam`, rad, is where the sonar looks for the echo of a surface.
    #[inline(always)]
    pub fn observed<T: Real>(&self, bearing: bool, instrument: &Instrument, beam: T) -> Observation<T> {
        let arm = splat(beam, &instrument.arm);
        match *self {
            Self::Beacon(beacon) => {
                let beacon = splat(beam, &beacon);
                if bearing {
                    Observation::Bearing { beacon, arm }
                } else {
                    Observation::Range { beacon, arm }
                }
            }
            Self::Surface(surface) => {
                let (sine, cosine) = beam.sin_cos();
                let mount = splat(beam, &instrument.mount);
                let along = product(&rotation(&mount), &[cosine, sine, beam.zero()]);
                Observation::Echo { along, arm, surface }
            }
        }
    }
}

/// What a filter is made of.
#[derive(Clone, Debug)]
pub struct Fitting {
    /// One sensor per kind, in the order of [`KINDS`].
    pub instruments: [Option<Instrument>; KINDS.len()],
    /// Named landmarks.
    pub landmarks: Vec<(String, Landmark)>,
    /// The bottom, which the altitude is measured to.
    pub bottom: Option<Surface>,
    /// The waves that the filter is told of.
    pub swell: Option<Swell>,
    /// What the model does not know.
    pub noise: Noise,
    /// When a sample is refused.
    pub gate: Gate,
    /// Where the vehicle begins unless it is measured, NED, m, and the deviation of that.
    pub start: (Vec3<f64>, f64),
    /// Time of a step, s.
    pub period: f64,
    /// How much later than its sensor's latency a sample may be, s.
    pub longest_age: f64,
}

impl Fitting {
    /// The noise of the process beside these sensors.
    ///
    /// Of an identified model what its file says that it left unexplained, else a force that accelerates the vehicle by
    /// [`MODEL_ERROR`] for some ten seconds; and a current of 0.2 m/s that lasts a quarter of an hour. Where the vehicle is simulated by the model itself (`exact`) there is next to
    /// none: [`ROUNDED`] for minutes, and white acceleration that the sensors do not see, so that innovations are those of
    /// the sensors; a steady current turns in hours.
    pub fn noise_of(
        description: &Description,
        instruments: &[Option<Instrument>; KINDS.len()],
        exact: bool,
    ) -> Noise {
        let vehicle = Vehicle::nominal(description);
        let unexplained = description.file.model_error.filter(|_| !exact);
        let [good, best] = [0.005, 0.0003];
        let noise = |kind: usize, usual: f64| instruments[kind].map_or(usual, |i| i.noise);
        let (moves, turns) = (noise(DVL, good), noise(GYRO, best));
        let turned = instruments[ATTITUDE_SENSOR].map_or(0.0, |i| i.bias);
        Noise {
            force: unexplained.map_or_else(
                || {
                    let accelerated = |i: usize| if exact { ROUNDED[i] } else { MODEL_ERROR };
                    std::array::from_fn(|i| accelerated(i) * vehicle.mass_matrix[i][i])
                },
                |error| error.force,
            ),
            force_time: [unexplained.map_or(if exact { 100.0 } else { 10.0 }, |error| error.force_time_s); 6],
            water: [0.0; 3],
            force_walk: [0.0; 6],
            acceleration: unexplained.map_or_else(
                || {
                    let seen = |i: usize| if i < 3 { moves } else { turns };
                    std::array::from_fn(|i| if exact { UNSEEN * seen(i) } else { FASTER })
                },
                |error| error.acceleration,
            ),
            current: [0.2, 0.2, 0.02],
            current_time: [if exact { 3e4 } else { 1e3 }; 3],
            gyro_walk: 1e-6,
            offsets: [turned, instruments[DVL].map_or(0.0, |i| i.bias)],
        }
    }

    /// The same in gusts of these deviations (north, east, down, m/s), and time constants τ and τ_2 of the process and of its
    /// second lag (s).
    ///
    /// Water that accelerates by a leaves the hull behind with −m a, a Gauss–Markov process of the variance σ²/(τ τ_2) and the
    /// memory τ_2. Along the body's axes that is added to the force: the variances, and what both walk in a short time. The
    /// share of the sum that is water moves the current; what of the gusts that leaves is a walk of the current. An exact
    /// model leaves next to no force beside it ([`QUIET`]).
    pub fn in_gusts(
        description: &Description,
        noise: Noise,
        gusts: &([f64; 3], [f64; 2]),
        exact: bool,
    ) -> Noise {
        let (deviations, [slow, fast]) = *gusts;
        if deviations == [0.0; 3] {
            return noise;
        }
        let mass = Vehicle::nominal(description).rigid_body.mass_matrix()[0][0];
        let (mut told, [north, east, down]) = (noise, deviations.map(|sigma| sigma * sigma));
        let level = 0.5 * (north + east);
        for (i, variance) in [level, level, down].into_iter().enumerate() {
            let own = plain::powi(noise.force[i] * if exact { QUIET } else { 1.0 }, 2);
            let pushed = mass * mass * variance / (slow * fast);
            let both = own + pushed;
            let share = if both > 0.0 { pushed / both } else { 0.0 };
            told.force[i] = both.sqrt();
            told.force_time[i] = both / (own / noise.force_time[i] + pushed / fast).max(f64::MIN_POSITIVE);
            told.water[i] = -share / mass;
            let varies = if i < 2 { [north, east][i] } else { down };
            let (lasting, time) = (plain::powi(noise.current[i], 2), noise.current_time[i]);
            let walk = lasting / time + (1.0 - share) * varies / slow;
            told.current[i] = (lasting + varies).sqrt();
            told.current_time[i] = (lasting + varies) / walk.max(f64::MIN_POSITIVE);
        }
        told
    }

    /// What a channel observes, in the kind of `beam`; nothing where the vehicle has no such sensor. A sonar looks along
    /// `beam`, rad.
    #[inline(always)]
    pub fn observed<T: Real>(&self, channel: usize, beam: T) -> Option<Observation<T>> {
        let instrument = self.instruments[instrument_of(channel)]?;
        let (zero, one) = (beam.zero(), beam.splat(1.0));
        let (mut arm, mut mount, mut unit) = ([zero; 3], [zero; 4], [zero; 3]);
        for i in 0..3 {
            arm[i] = zero.splat(instrument.arm[i]);
        }
        for i in 0..4 {
            mount[i] = zero.splat(instrument.mount[i]);
        }
        let axis = match channel {
            13..16 => channel - 13,
            16 | 17 => channel - 16,
            _ => channel % 3,
        };
        unit[axis] = one;
        let tilted = product(&rotation(&mount), &unit);
        Some(match channel {
            0..3 | 16..21 => Observation::Place { along: unit, arm },
            3..6 => Observation::Angle { axis, mount },
            6..9 => Observation::Velocity { along: tilted, arm, over_ground: true },
            9..12 => Observation::Rate { about: tilted },
            ALTITUDE => {
                let down = product(&rotation(&mount), &[zero, zero, one]);
                Observation::Echo { along: down, arm, surface: self.bottom? }
            }
            13..16 => Observation::Velocity { along: tilted, arm, over_ground: false },
            _ => {
                let mark = (channel - LANDMARKS) / 2;
                let bearing = (channel - LANDMARKS) % 2 == 1;
                self.landmarks[mark].1.observed(bearing, &instrument, beam)
            }
        })
    }

    /// The names of all channels.
    pub fn channels(&self) -> Vec<String> {
        let own = CHANNEL_NAMES.iter().chain(&FIXES).map(|name| (*name).to_owned());
        let marks =
            self.landmarks.iter().flat_map(|(name, _)| [format!("range.{name}"), format!("bearing.{name}")]);
        own.chain(marks).collect()
    }
}

/// The kind of sensor, among [`KINDS`], that each channel of [`CHANNEL_NAMES`] is of.
pub const KIND_OF: [usize; CHANNELS] = {
    let mut kinds = [0; CHANNELS];
    let mut c = 0;
    while c < CHANNELS {
        kinds[c] = instrument_of(c);
        c += 1;
    }
    kinds
};

/// The kind of sensor that a channel is of.
pub const fn instrument_of(channel: usize) -> usize {
    match channel {
        0 | 1 => POSITION_FIX,
        2 => DEPTH,
        3..=5 => ATTITUDE_SENSOR,
        6..=8 => DVL,
        9..=11 => GYRO,
        ALTITUDE => ECHO_SOUNDER,
        13..=15 => DVL_WATER,
        16 | 17 => GPS,
        18..=20 => USBL,
        _ if (channel - LANDMARKS).is_multiple_of(2) => RANGE,
        _ => BEARING,
    }
}
