//! The autopilot file: TOML, owned by these structs; unknown keys are refused with the nearest known name.
//!
//! Gains are physical, so that another control period does not retune: `K_P` in N or N m per unit of the loop's error
//! (m/s, m or rad), `K_I_per_s` and `K_D_s` in that unit per s and times s. A gain is one number or six, one for each
//! supporting point of the schedule.
//!
//! Tests: `tests/closed_loop/modes.rs`.

use crate::control::allocation::AllocationTable;
use crate::control::control_law::AntiWindup;
use crate::control::guidance::GuidanceTable;
use crate::control::lqr::LqrTable;
use crate::control::safety::SafetyTable;
use crate::control::schedule::POINTS;
use crate::error::Error;
use crate::ranges;
use crate::toml_file::{exactly, parsed};
use serde::{Deserialize, Serialize};

/// An autopilot as written in its file.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct AutopilotFile {
    /// Version of the format: 1.
    pub format: u32,
    /// Name of the autopilot.
    pub name: String,
    /// What it is for, in a sentence.
    #[serde(default)]
    pub description: String,
    /// Control period, s.
    pub period_s: f64,
    /// The control law.
    #[serde(default)]
    pub control: Control,
    /// The supporting points of the gains.
    pub schedule: ScheduleTable,
    /// Which loops and actuators work at which speed.
    pub modes: Vec<ModeTable>,
    /// The loops.
    #[serde(default)]
    pub loops: LoopTables,
    /// What is known of the vehicle and used ahead of any error.
    #[serde(default)]
    pub feed_forward: FeedForwardTable,
    /// From waypoints to desired values.
    #[serde(default)]
    pub guidance: GuidanceTable,
    /// From the wrench to commands.
    #[serde(default)]
    pub allocation: AllocationTable,
    /// What is watched and what follows.
    #[serde(default)]
    pub safety: SafetyTable,
    /// Gains of the linear-quadratic regulator, per mode.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lqr: Vec<LqrTable>,
}

/// The control law.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Control {
    /// Decoupled adaptive PID controllers.
    #[default]
    Pid,
    /// Gain-scheduled linear-quadratic regulator with integral action.
    Lqr,
}

/// The supporting points.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ScheduleTable {
    /// Desired speeds, m/s, strictly increasing.
    #[serde(deserialize_with = "exactly")]
    pub speeds_m_s: [f64; POINTS],
}

/// A row of the mode table.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ModeTable {
    /// Name: "hover", "cruise" …
    pub name: String,
    /// Names of the loops at work.
    pub loops: Vec<String>,
    /// The loop that controls the depth.
    pub depth_by: DepthBy,
    /// Forward speed from which the mode takes over, m/s; the first mode has none.
    #[serde(default)]
    pub from_speed_m_s: f64,
    /// How far below it the speed must fall before the mode is left, m/s.
    #[serde(default = "hysteresis")]
    pub hysteresis_m_s: f64,
    /// Actuators or groups at work; all when missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuators: Option<Vec<String>>,
}

/// How the depth is controlled.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum DepthBy {
    /// By a vertical force.
    Heave,
    /// By the pitch angle under way.
    Pitch,
}

/// The loops by name; a missing one does not exist.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct LoopTables {
    /// Forward speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surge: Option<LoopTable>,
    /// Sideways speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sway: Option<LoopTable>,
    /// Depth by a vertical force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heave: Option<LoopTable>,
    /// Roll.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll: Option<LoopTable>,
    /// Pitch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<LoopTable>,
    /// Heading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading: Option<LoopTable>,
}

impl LoopTables {
    /// The loops in the order of the wrench.
    pub fn in_order(&self) -> [Option<&LoopTable>; 6] {
        [&self.surge, &self.sway, &self.heave, &self.roll, &self.pitch, &self.heading].map(Option::as_ref)
    }
}

/// One loop.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct LoopTable {
    /// Proportional gain, N or N m per m/s, m or rad.
    #[serde(rename = "K_P")]
    pub k_p: Gain,
    /// Integral gain, the same per s.
    #[serde(rename = "K_I_per_s", default)]
    pub k_i_per_s: Gain,
    /// Derivative gain, the same times s.
    #[serde(rename = "K_D_s", default)]
    pub k_d_s: Gain,
    /// Largest demand, N or N m.
    pub tau_max: f64,
    /// Against wind-up of the integral.
    #[serde(default)]
    pub anti_windup: AntiWindup,
    /// Natural frequency of the reference filter, rad/s; no filter when missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_rad_s: Option<f64>,
}

/// One number for all supporting points, or one for each.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(untagged, expecting = "expected one number, or six: one per supporting point")]
pub enum Gain {
    /// The same everywhere.
    Constant(f64),
    /// Per supporting point.
    Points(#[serde(deserialize_with = "exactly")] [f64; POINTS]),
}

impl Default for Gain {
    fn default() -> Self {
        Self::Constant(0.0)
    }
}

impl Gain {
    /// The gain at every supporting point.
    pub fn points(self) -> [f64; POINTS] {
        match self {
            Self::Constant(gain) => [gain; POINTS],
            Self::Points(gains) => gains,
        }
    }

    /// Of six numbers, one where they are equal.
    pub fn of(points: [f64; POINTS]) -> Self {
        if points.iter().all(|x| *x == points[0]) { Self::Constant(points[0]) } else { Self::Points(points) }
    }
}

/// What the autopilot's model of the vehicle adds to the control laws.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(deny_unknown_fields, default)]
pub struct FeedForwardTable {
    /// Weight, buoyancy and their moment at the measured attitude.
    pub restoring: bool,
    /// Drag at the desired speeds.
    pub drag: bool,
    /// Inertia times the acceleration of the filtered references.
    pub acceleration: bool,
}

impl Default for FeedForwardTable {
    fn default() -> Self {
        Self { restoring: true, drag: true, acceleration: true }
    }
}

fn hysteresis() -> f64 {
    0.1
}

impl AutopilotFile {
    /// Reads an autopilot file; `source_name` stands in messages.
    ///
    /// # Errors
    /// When the text is not TOML, a key is unknown or missing, or a value has the wrong type.
    pub fn parse(text: &str, source_name: &str) -> Result<Self, Error> {
        parsed("an autopilot", text, source_name, ranges::AUTOPILOT)
    }

    /// The file as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("an autopilot file holds plain numbers, text and tables")
    }
}
