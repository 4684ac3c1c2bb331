//! What is kept of a flight, one row per control period.
//!
//! Tests: `tests/closed_loop.rs`, `tests/flight/test_fly.py`.

use crate::control::autopilot::Thought;
use crate::control::navigation::{ALTITUDE, CHANNEL_NAMES, CHANNELS, Measurement};
use crate::description::ActuatorDescription;
use crate::number::real::Real;

/// The columns of a flight besides its channels, true and measured, and its actuators.
const THOUGHTS: [&str; 29] = [
    "desired_speed",
    "desired_lateral",
    "desired_heading",
    "desired_pitch",
    "desired_depth",
    "holding",
    "cross_track",
    "vertical_error",
    "distance",
    "leg",
    "done",
    "mode",
    "alert",
    "cause",
    "given_up",
    "demanded_X",
    "demanded_Y",
    "demanded_Z",
    "demanded_K",
    "demanded_M",
    "demanded_N",
    "achieved_X",
    "achieved_Y",
    "achieved_Z",
    "achieved_K",
    "achieved_M",
    "achieved_N",
    "power",
    "battery",
];

/// The names of the columns before those of the actuators: true and measured channels, then the autopilot's own.
/// Angles in rad; commands and signals of every actuator follow, in its order.
pub fn columns() -> Vec<String> {
    let truth = CHANNEL_NAMES.iter().map(|name| (*name).to_owned());
    let measured = CHANNEL_NAMES.iter().map(|name| format!("measured_{name}"));
    truth.chain(measured).chain(THOUGHTS.iter().map(|name| (*name).to_owned())).collect()
}

/// The names of all columns: those of [`columns`], then commands and signals of these actuators.
pub fn columns_with(actuators: &[ActuatorDescription]) -> Vec<String> {
    let of = |kind: &'static str| actuators.iter().map(move |a| format!("{kind}.{}", a.name));
    columns().into_iter().chain(of("cmd")).chain(of("act")).collect()
}

/// One moment of a flight.
pub struct Row<'a, T> {
    /// True channels.
    pub truth: &'a [T; CHANNELS],
    /// What the autopilot was told.
    pub measured: &'a Measurement<T>,
    /// What it made of it.
    pub thought: &'a Thought<T>,
    /// Electrical power, W.
    pub power: T,
}

/// The rows of a flight.
#[derive(Clone, Default)]
pub struct Log<T> {
    /// `[row][column]`.
    pub values: Vec<T>,
    /// Number of rows.
    pub rows: usize,
}

impl<T: Real> Log<T> {
    /// Appends a row with the commands and the signals of the actuators.
    #[inline(always)]
    pub fn add(&mut self, row: &Row<'_, T>, commands: &[T], signals: &[T]) {
        self.values.extend_from_slice(row.truth);
        self.values.extend_from_slice(&row.measured.channels);
        let (t, d) = (row.thought, &row.thought.desired);
        self.values.extend_from_slice(&[
            d.speed,
            d.lateral,
            d.heading,
            d.pitch,
            d.depth,
            d.holding,
            d.cross_track,
            d.vertical_error,
            d.distance,
            d.leg,
            d.done,
            t.mode,
            t.alert.level,
            t.alert.cause,
            t.given_up,
        ]);
        self.values.extend_from_slice(&t.demanded);
        self.values.extend_from_slice(&t.achieved);
        self.values.extend_from_slice(&[row.power, row.measured.battery]);
        self.values.extend_from_slice(commands);
        self.values.extend_from_slice(signals);
        self.rows += 1;
    }
}

impl Log<f64> {
    /// The log with commands and signals in the unit of each actuator's command.
    pub fn in_commands(mut self, actuators: &[ActuatorDescription]) -> Self {
        let width = self.values.len() / self.rows.max(1);
        for row in self.values.chunks_exact_mut(width.max(1)) {
            for (i, value) in row[width - 2 * actuators.len()..].iter_mut().enumerate() {
                *value = actuators[i % actuators.len()].command(*value);
            }
        }
        self
    }

    /// At most so many first rows, all of them sound: what diverged ends with its last sound row.
    pub fn first(mut self, most: usize) -> Self {
        if self.rows == 0 {
            return self;
        }
        let width = self.values.len() / self.rows;
        let sound = |row: &&[f64]| row[..ALTITUDE].iter().all(|x| x.is_finite());
        self.rows = self.values.chunks_exact(width).take(most).take_while(sound).count();
        self.values.truncate(self.rows * width);
        self
    }
}
