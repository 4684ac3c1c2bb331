//! A fin as written in the vehicle file. Lift and drag: [`crate::actuator::fin`].
//!
//! Tests: `tests/files.rs`, `tests/core/test_scalar_textbook.py`.

use crate::toml_file::exactly;
use serde::{Deserialize, Serialize};

/// A movable fin: where it is, its shape and its servo. Its command is the deflection in rad.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct FinTable {
    /// Name, unique among all actuators.
    pub name: String,
    /// Group for tied coefficients and reports.
    #[serde(default)]
    pub group: String,
    /// Command without deflection, rad.
    #[serde(default)]
    pub neutral: f64,
    /// Whether a command above neutral deflects against `normal`.
    #[serde(default)]
    pub reversed: bool,
    /// Deflection towards `normal` where the servo stands at zero, degrees.
    #[serde(default)]
    pub offset_deg: f64,
    /// Place of the centre of pressure, m: forward, starboard, down of O.
    #[serde(deserialize_with = "exactly")]
    pub position_m: [f64; 3],
    /// To the leading edge at zero deflection, body frame.
    #[serde(default = "forward", deserialize_with = "exactly")]
    pub chord: [f64; 3],
    /// Where a positive deflection moves the leading edge and, under way ahead, the force.
    #[serde(deserialize_with = "exactly")]
    pub normal: [f64; 3],
    /// Planform area, m².
    pub area_m2: f64,
    /// Effective aspect ratio Λ (a hull at the root doubles the geometric one).
    pub aspect_ratio: f64,
    /// Oswald's efficiency e of the induced drag.
    #[serde(default = "oswald")]
    pub oswald: f64,
    /// Slope of the lift coefficient, per rad; from the aspect ratio when missing.
    #[serde(rename = "C_L_alpha", default, skip_serializing_if = "Option::is_none")]
    pub c_l_alpha: Option<f64>,
    /// Largest lift coefficient.
    #[serde(rename = "C_L_max", default = "stall")]
    pub c_l_max: f64,
    /// Drag coefficient in line with the flow.
    #[serde(rename = "C_D_0", default = "profile_drag")]
    pub c_d_0: f64,
    /// Further drag coefficient across the flow.
    #[serde(rename = "C_D_90", default = "plate_drag")]
    pub c_d_90: f64,
    /// Name of its servo under `[motors]`, whose limits are then in rad; an ideal one when missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<String>,
}

fn forward() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

fn oswald() -> f64 {
    0.9
}

fn stall() -> f64 {
    1.1
}

fn profile_drag() -> f64 {
    0.012
}

fn plate_drag() -> f64 {
    1.1
}
