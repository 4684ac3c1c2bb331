//! The parameters of the cascade by ArduSub's names, in ArduSub's units, with ArduSub's defaults.
//!
//! Names and units are those of 4.7 and later: metres, degrees, throttle as a share. A value that a vehicle does not
//! have set is the default.
//!
//! Source: ArduPilot's list of parameters for Sub (names, units and values as facts). Tests: `tests/ardusub.rs`.

use crate::error::nearest;

const RAD: f64 = std::f64::consts::PI / 180.0;

/// Name, default, and factor from its unit to SI and radians.
pub type Parameter = (&'static str, f64, f64);

/// All parameters of the cascade, in the order of its values.
pub const PARAMETERS: [Parameter; 62] = [
    ("ATC_ANG_RLL_P", 6.0, 1.0),
    ("ATC_ANG_PIT_P", 6.0, 1.0),
    ("ATC_ANG_YAW_P", 6.0, 1.0),
    ("ATC_ACC_R_MAX", 1100.0, RAD),
    ("ATC_ACC_P_MAX", 1100.0, RAD),
    ("ATC_ACC_Y_MAX", 1100.0, RAD),
    ("ATC_RATE_R_MAX", 0.0, RAD),
    ("ATC_RATE_P_MAX", 0.0, RAD),
    ("ATC_RATE_Y_MAX", 0.0, RAD),
    ("ATC_RAT_RLL_P", 0.135, 1.0),
    ("ATC_RAT_RLL_I", 0.09, 1.0),
    ("ATC_RAT_RLL_D", 0.0036, 1.0),
    ("ATC_RAT_RLL_FF", 0.0, 1.0),
    ("ATC_RAT_RLL_IMAX", 0.444, 1.0),
    ("ATC_RAT_RLL_FLTT", 30.0, 1.0),
    ("ATC_RAT_RLL_FLTE", 0.0, 1.0),
    ("ATC_RAT_RLL_FLTD", 30.0, 1.0),
    ("ATC_RAT_PIT_P", 0.135, 1.0),
    ("ATC_RAT_PIT_I", 0.09, 1.0),
    ("ATC_RAT_PIT_D", 0.0036, 1.0),
    ("ATC_RAT_PIT_FF", 0.0, 1.0),
    ("ATC_RAT_PIT_IMAX", 0.444, 1.0),
    ("ATC_RAT_PIT_FLTT", 30.0, 1.0),
    ("ATC_RAT_PIT_FLTE", 0.0, 1.0),
    ("ATC_RAT_PIT_FLTD", 30.0, 1.0),
    ("ATC_RAT_YAW_P", 0.18, 1.0),
    ("ATC_RAT_YAW_I", 0.018, 1.0),
    ("ATC_RAT_YAW_D", 0.0, 1.0),
    ("ATC_RAT_YAW_FF", 0.0, 1.0),
    ("ATC_RAT_YAW_IMAX", 0.222, 1.0),
    ("ATC_RAT_YAW_FLTT", 5.0, 1.0),
    ("ATC_RAT_YAW_FLTE", 0.0, 1.0),
    ("ATC_RAT_YAW_FLTD", 5.0, 1.0),
    ("PSC_D_POS_P", 3.0, 1.0),
    ("PSC_D_VEL_P", 8.0, 1.0),
    ("PSC_D_VEL_I", 0.0, 1.0),
    ("PSC_D_VEL_D", 0.0, 1.0),
    ("PSC_D_VEL_FF", 0.0, 1.0),
    ("PSC_D_VEL_IMAX", 10.0, 1.0),
    ("PSC_D_VEL_FLTE", 5.0, 1.0),
    ("PSC_D_VEL_FLTD", 5.0, 1.0),
    ("PSC_D_ACC_P", 0.05, 1.0),
    ("PSC_D_ACC_I", 0.01, 1.0),
    ("PSC_D_ACC_D", 0.0, 1.0),
    ("PSC_D_ACC_FF", 0.0, 1.0),
    ("PSC_D_ACC_IMAX", 0.1, 1.0),
    ("PSC_D_ACC_FLTT", 0.0, 1.0),
    ("PSC_D_ACC_FLTE", 20.0, 1.0),
    ("PSC_D_ACC_FLTD", 0.0, 1.0),
    ("PSC_NE_POS_P", 1.0, 1.0),
    ("PSC_NE_VEL_P", 1.0, 1.0),
    ("PSC_NE_VEL_I", 0.5, 1.0),
    ("PSC_NE_VEL_D", 0.0, 1.0),
    ("PSC_NE_VEL_FF", 0.0, 1.0),
    ("PSC_NE_VEL_IMAX", 10.0, 1.0),
    ("PSC_NE_VEL_FLTE", 5.0, 1.0),
    ("PSC_NE_VEL_FLTD", 5.0, 1.0),
    ("ATC_ANGLE_MAX", 45.0, RAD),
    ("MOT_THST_HOVER", 0.5, 1.0),
    ("ATC_INPUT_TC", 0.15, 1.0),
    ("ATC_RATE_WPY_MAX", 60.0, RAD),
    ("ATC_RATE_FF_ENAB", 1.0, 1.0),
];

/// Index of the angle controllers' gains.
pub const ANGLE: usize = 0;
/// Index of their accelerations.
pub const ACCELERATION: usize = 3;
/// Index of their rates.
pub const RATE: usize = 6;
/// Index of the first rate controller; eight parameters each.
pub const RATES: usize = 9;
/// Index of the depth controller's gain, velocity and acceleration controllers after it.
pub const DEPTH: usize = 33;
/// Index of the vertical acceleration controller.
pub const LIFT: usize = 41;
/// Index of the position controller's gain, the velocity controller after it.
pub const PLANE: usize = 49;
/// Index of the largest lean angle.
pub const LEAN: usize = 57;
/// Index of the throttle that hovers.
pub const HOVER: usize = 58;
/// Index of the time constant of the input; the largest rate of a yaw target that steps, and whether targets are
/// shaped, after it.
pub const INPUT: usize = 59;

/// The index of a parameter.
///
/// # Errors
/// The nearest known name.
pub fn index(name: &str) -> Result<usize, String> {
    PARAMETERS.iter().position(|(known, ..)| *known == name).ok_or_else(|| {
        let near = nearest(name, PARAMETERS.iter().map(|(known, ..)| *known));
        format!("{name}: expected a parameter of ArduSub's controllers{near}")
    })
}

/// The defaults, in ArduSub's units.
pub fn defaults() -> [f64; PARAMETERS.len()] {
    PARAMETERS.map(|(_, value, _)| value)
}
