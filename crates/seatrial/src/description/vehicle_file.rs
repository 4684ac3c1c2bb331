//! The vehicle file: TOML, owned by these structs; unknown keys are refused with the nearest known
//! name.
//!
//! A number that a human types carries its unit in the key (`length_m`, `T_1_s`); coefficients have
//! the field's names and SI units; a motor's limits are in the unit of its command. Motors and
//! characteristics are named tables, shared by the thrusters that refer to them. A quoted key such as
//! `"SbU.gain"` under `[coefficients]` overrides one actuator's value.
//!
//! Tests: `tests/files.rs`.

mod cross_flow_table;
mod fin_table;
mod model_error_table;
mod tether_table;

use crate::description::geometry::Geometry;
use crate::error::Error;
use crate::ranges;
use crate::toml_file::{exactly, exactly_if_given, parsed};
pub use cross_flow_table::CrossFlowTable;
pub use fin_table::FinTable;
pub use model_error_table::ModelErrorTable;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
pub use tether_table::TetherTable;

/// A vehicle as written in its file.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct VehicleFile {
    /// Version of the format: 1.
    pub format: u32,
    /// Name of the vehicle.
    pub name: String,
    /// What it is, in a sentence.
    #[serde(default)]
    pub description: String,
    /// Rows of the wrench that the vehicle can command, among X Y Z K M N.
    #[serde(default = "all_rows")]
    pub controllable: Vec<String>,
    /// Water and gravity for which the coefficients hold.
    #[serde(default)]
    pub environment: Environment,
    /// Measures of the hull.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
    /// How it lies in the water.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trim: Option<Trim>,
    /// Measures of the hull along its length, for the cross-flow drag by strips.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cross_flow: Option<CrossFlowTable>,
    /// A tether: where it is made fast, and where it leads to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tether: Option<TetherTable>,
    /// Battery and hotel load.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power: Option<Power>,
    /// What the model left unexplained where it was identified.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_error: Option<ModelErrorTable>,
    /// Coefficients by their field names, SI; the missing ones are filled from the geometry.
    #[serde(default)]
    pub coefficients: BTreeMap<String, f64>,
    /// Motors by name.
    #[serde(default)]
    pub motors: BTreeMap<String, MotorTable>,
    /// Thruster characteristics by name.
    #[serde(default)]
    pub characteristics: BTreeMap<String, CharacteristicTable>,
    /// The thrusters, in the order of the command vector.
    #[serde(default)]
    pub thrusters: Vec<Thruster>,
    /// The movable fins; they follow the thrusters in the command vector.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fins: Vec<FinTable>,
}

/// Water and gravity.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Density of the water, kg/m³.
    pub rho_kg_m3: f64,
    /// Gravity, m/s².
    #[serde(default = "standard_gravity")]
    pub g_m_s2: f64,
}

impl Default for Environment {
    fn default() -> Self {
        Self { rho_kg_m3: 1025.0, g_m_s2: standard_gravity() }
    }
}

impl Environment {
    /// The same with another density (kg/m³) or gravity (m/s²), where they are given.
    ///
    /// # Errors
    /// A number that is none of water or gravity.
    pub fn with(self, rho: Option<f64>, g: Option<f64>) -> Result<Self, Error> {
        let gravity = ranges::row(ranges::VEHICLE, "environment.g_m_s2");
        for (name, row, given) in [("rho", Some(&ranges::WATER), rho), ("g", gravity, g)] {
            if let Some(complaint) = given.and_then(|x| row?.complaint(x)) {
                return Err(Error::simulation(format!("{name}: {complaint}")));
            }
        }
        Ok(Self { rho_kg_m3: rho.unwrap_or(self.rho_kg_m3), g_m_s2: g.unwrap_or(self.g_m_s2) })
    }
}

/// How it lies in the water, measured in a tub: what gives `B` and `z_b` where the file does not.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Trim {
    /// Reading of a hanging scale with the vehicle under water, kg; negative where it floats: the weight in water of
    /// the lead that just sinks it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weight_in_water_kg: Option<f64>,
    /// Height of the centre of buoyancy over that of gravity, m: lead of weight w hung at the arm a heels it by φ,
    /// w a/(m tan φ).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub righting_arm_m: Option<f64>,
}

/// Battery and hotel load: what endurance needs.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Power {
    /// Load without propulsion, W.
    pub hotel_w: f64,
    /// Usable energy of the battery, W h.
    pub battery_wh: f64,
}

/// A motor and its controller; limits in the unit of the command, as positive magnitudes.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct MotorTable {
    /// Largest command ahead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maximum_ahead: Option<f64>,
    /// Largest command astern; as ahead when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maximum_astern: Option<f64>,
    /// Smallest command that the controller holds ahead.
    #[serde(default)]
    pub minimum_ahead: f64,
    /// Smallest command that the controller holds astern; as ahead when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minimum_astern: Option<f64>,
    /// Between zero and the minimum: lift to the minimum, or drop to zero.
    #[serde(default)]
    pub below_minimum: BelowMinimum,
    /// Rate limit while the magnitude grows, unit/s; none when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_acc_per_s: Option<f64>,
    /// Rate limit while the magnitude shrinks, unit/s; as `n_acc_per_s` when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_dec_per_s: Option<f64>,
    /// Static gain of the lag.
    #[serde(rename = "K_V", default = "one")]
    pub k_v: f64,
    /// Time constant of the lag, s.
    #[serde(rename = "T_1_s", default)]
    pub t_1_s: f64,
    /// Dead time, s.
    #[serde(rename = "T_t_s", default)]
    pub t_t_s: f64,
}

/// What the controller makes of a command below the minimum.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum BelowMinimum {
    /// The minimum, in the direction of the command.
    #[default]
    Lift,
    /// Zero: a true dead band.
    Zero,
}

/// From signal to thrust.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum CharacteristicTable {
    /// `F = p1 |n| n + p2 |n| V_a`, n in rev/s; `p1 = α1 ρ d⁴` and `p2 = α2 ρ d³` when α and d are given.
    Quadratic(Quadratic),
    /// `F = a0 + a1 s + a11 s² + p2 |n| V_a` of the signal's magnitude s in the command's unit, N.
    Polynomial(Polynomial),
    /// Measured thrust over signal and supply voltage.
    Table {
        /// Signals, in the command's unit, from `neutral`, strictly increasing.
        signal: Vec<f64>,
        /// Supply voltages, V; missing when the thrust was measured at one.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        voltage_v: Vec<f64>,
        /// Thrust, N, one row per voltage.
        force_n: Vec<Vec<f64>>,
    },
    /// The command is the thrust.
    Direct,
}

/// The quadratic characteristic: either p1, p2 or α1, α2 and the diameter.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
#[serde(default)]
pub struct Quadratic {
    /// Thrust per |n| n ahead, N s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub p1_ahead: Option<f64>,
    /// Thrust per |n| n astern, N s²; as ahead when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub p1_astern: Option<f64>,
    /// Thrust per |n| V_a, N s²/m (negative).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub p2: Option<f64>,
    /// α1 ahead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha1_ahead: Option<f64>,
    /// α1 astern; as ahead when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha1_astern: Option<f64>,
    /// α2 (negative).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha2: Option<f64>,
    /// Diameter of the propeller, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diameter_m: Option<f64>,
    /// Wake fraction w.
    pub wake: f64,
    /// Thrust deduction fraction t.
    pub thrust_deduction: f64,
    /// Reaction torque per |n| n, N m s².
    pub q1: f64,
    /// Reaction torque per |n| V_a, N s².
    pub q2: f64,
    /// Electrical power per |n|³, W/(rev/s)³.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power_w_s3: Option<f64>,
}

/// The second-order regression of a bollard test, and what it cannot measure; all but the regression only
/// where the command is in rpm.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Polynomial {
    /// a0, a1, a11 ahead.
    #[serde(deserialize_with = "exactly")]
    pub ahead: [f64; 3],
    /// a0, a1, a11 astern (magnitudes).
    #[serde(deserialize_with = "exactly")]
    pub astern: [f64; 3],
    /// Thrust per |n| V_a, N s²/m (negative), n in rev/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p2: Option<f64>,
    /// α2 (negative), instead of p2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha2: Option<f64>,
    /// Diameter of the propeller, m, for α2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_m: Option<f64>,
    /// Wake fraction w.
    #[serde(default)]
    pub wake: f64,
    /// Thrust deduction fraction t.
    #[serde(default)]
    pub thrust_deduction: f64,
    /// Reaction torque per |n| n, N m s².
    #[serde(default)]
    pub q1: f64,
    /// Reaction torque per |n| V_a, N s².
    #[serde(default)]
    pub q2: f64,
    /// Electrical power per |n|³, W/(rev/s)³.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_w_s3: Option<f64>,
}

/// A thruster: where it is and what drives it.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Thruster {
    /// Name, unique.
    pub name: String,
    /// Group for tied coefficients and reports.
    #[serde(default)]
    pub group: String,
    /// Unit of the command.
    pub command: CommandUnit,
    /// Command without thrust, in the command's unit.
    #[serde(default)]
    pub neutral: f64,
    /// Whether a command above neutral pushes against `direction`.
    #[serde(default)]
    pub reversed: bool,
    /// Place, m: forward, starboard, down of O.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exactly_if_given")]
    pub position_m: Option<[f64; 3]>,
    /// Direction of positive thrust, body frame.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exactly_if_given")]
    pub direction: Option<[f64; 3]>,
    /// Wrench about O per newton, where only a configuration matrix is known.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exactly_if_given")]
    pub wrench_per_newton: Option<[f64; 6]>,
    /// Name of its motor under `[motors]`; an ideal one when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motor: Option<String>,
    /// Name of its characteristic under `[characteristics]`.
    pub characteristic: String,
}

/// Unit of a command.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
pub enum CommandUnit {
    /// Revolutions per minute.
    #[serde(rename = "rpm")]
    Rpm,
    /// Pulse width, microseconds.
    #[serde(rename = "us")]
    Us,
    /// Newtons.
    #[serde(rename = "N")]
    Newton,
    /// Radians, of a fin.
    #[serde(rename = "rad")]
    Radian,
}

impl CommandUnit {
    /// The unit as written.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Rpm => "rpm",
            Self::Us => "us",
            Self::Newton => "N",
            Self::Radian => "rad",
        }
    }
}

fn all_rows() -> Vec<String> {
    crate::description::coefficients::FORCES.map(str::to_owned).to_vec()
}

fn standard_gravity() -> f64 {
    9.81
}

fn one() -> f64 {
    1.0
}

impl VehicleFile {
    /// Reads a vehicle file; `source_name` stands in messages.
    ///
    /// # Errors
    /// When the text is not TOML, a key is unknown or missing, or a value has the wrong type.
    pub fn parse(text: &str, source_name: &str) -> Result<Self, Error> {
        parsed("a vehicle", text, source_name, ranges::VEHICLE)
    }

    /// The file as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a vehicle file holds plain numbers, text and tables")
    }
}
