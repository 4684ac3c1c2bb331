//! A flight: what all its cases share, and what is one case's own.

use super::acoustics::Acoustics;
use super::faults::Faults;
use super::trial::Trial;
use super::waves::Harmonic;
use crate::control::autopilot::settings::Settings;
use crate::control::navigation::{CHANNELS, GroupOutage, Seabed, Sensors};
use crate::control::navigation_filter::Fitting;
use crate::description::Description;
use crate::description::vehicle_file::Environment;
use crate::mission::{Mission, Obstacle};
use crate::model::integrate::State;
use crate::number::algebra::Vec3;
use std::sync::Arc;

/// The surface in the frame of a mission, whose depths count from there.
pub const SURFACE: Option<f64> = Some(0.0);

/// What all cases of a flight share.
pub struct Flight<'a> {
    /// The vehicle that flies.
    pub description: &'a Description,
    /// The autopilot's model of it.
    pub model: &'a Description,
    /// The autopilot.
    pub settings: &'a Arc<Settings>,
    /// The mission.
    pub mission: &'a Arc<Mission>,
    /// The sensors.
    pub sensors: &'a Sensors,
    /// The navigation filter, where the autopilot goes by its estimate.
    pub navigation: Option<&'a Fitting>,
    /// What only that filter reads.
    pub acoustics: &'a Acoustics,
    /// Whether the actuators' signals are measured.
    pub feedback: bool,
    /// The bottom, where there is one.
    pub seabed: Option<Seabed>,
    /// What stands in the water: the mission's obstacles, and others.
    pub obstacles: &'a [Obstacle],
    /// Set points in place of guidance, and what their responses are held against.
    pub trial: &'a Trial,
    /// Time constants of the turbulence, s.
    pub turbulence_times: [f64; 2],
    /// Water and gravity.
    pub environment: Environment,
    /// Where the sea ends, m down of the origin: [`SURFACE`] in the frame of a mission; all is under water without one.
    pub surface: Option<f64>,
    /// Supply voltage, V; not a number where it does not matter.
    pub voltage: f64,
    /// Steps of the equation of motion per control period.
    pub substeps: usize,
    /// The flight ends after so many control periods at the latest.
    pub periods: usize,
}

impl Flight<'_> {
    /// Whether responses are held against corridors: these are of the whole time, whatever the mission says of an end.
    pub fn is_trial(&self) -> bool {
        !self.trial.corridors.is_empty()
    }
}

/// The smallest whole number, at least 1, that is not below a ratio of times but for rounding: 2.1 s are 7 periods of 0.3 s.
pub fn whole_steps(ratio: f64) -> usize {
    (ratio - ratio.max(1.0) * 1e-9).ceil().max(1.0) as usize
}

/// One case of a flight, in the number type of the run.
#[derive(Clone)]
pub struct Setting<T> {
    /// Where the flight begins.
    pub state: State<T>,
    /// Current, NED, m/s: its mean.
    pub current: Vec3<T>,
    /// Standard deviation of the current about it, NED, m/s.
    pub turbulence: Vec3<T>,
    /// Steady change of the mean, NED, m/s².
    pub current_trend: Vec3<T>,
    /// Random walk of the mean, NED, m/s per √s.
    pub current_walk: Vec3<T>,
    /// The waves; empty for none.
    pub waves: Vec<Harmonic<T>>,
    /// Seed of the sensors' noise and of the water's motion.
    pub seed: T,
    /// What fails, and when.
    pub faults: Faults<T>,
    /// A time without samples per group of sensors; empty for none.
    pub outages: Vec<GroupOutage<T>>,
    /// Offset of each channel in its standard deviations; `None`: drawn from the seed.
    pub offsets: Option<[T; CHANNELS]>,
    /// Set points of the trial, `[named][time]`.
    pub set_points: Vec<T>,
    /// Base and scale of each corridor.
    pub scales: Vec<[T; 2]>,
}
