//! From an attitude wanted to turn rates wanted.
//!
//! The error is split in two: what tilts the down axis onto the one wanted, and what is left about it. So a large error
//! of yaw does not tilt the vehicle on the way.
//!
//! ```text
//! c = tilt of R e_d onto R_d e_d, seen in the body frame:  e_roll, e_pitch = its rotation vector
//! e_yaw = rotation vector of c⁻¹ ⊗ q⁻¹ ⊗ q_d about e_d
//! ω_wanted = square_root(e, ATC_ANG_*_P, ½ ATC_ACC_*_MAX within its bounds) + R(q⁻¹ ⊗ q_d) ω_d
//! ```
//!
//! Source: ArduPilot, "Attitude control" (structure as facts). Tests: `tests/ardusub.rs`.

use super::pid::square_root;
use crate::model::kinematics::{Quaternion, quaternion_product, rotation};
use crate::number::algebra::{Vec3, cross, dot, product};
use crate::number::real::Real;

/// Bounds of the acceleration that the square-root controller counts on, rad/s²: roll and pitch, yaw.
const ACCELERATION: [[f64; 2]; 2] = [[40.0 * RAD, 720.0 * RAD], [10.0 * RAD, 120.0 * RAD]];

const RAD: f64 = std::f64::consts::PI / 180.0;

/// Tilt error from which the feed-forward fades out, and at whose double it is gone, rad.
const FADES: f64 = 30.0 * RAD;

/// Gains of the angle controllers.
#[derive(Clone, Copy, Debug)]
pub struct AngleGains<T> {
    /// `ATC_ANG_RLL_P`, `ATC_ANG_PIT_P`, `ATC_ANG_YAW_P`, per s.
    pub p: Vec3<T>,
    /// `ATC_ACC_R_MAX`, `ATC_ACC_P_MAX`, `ATC_ACC_Y_MAX` in rad/s²; 0: proportional.
    pub acceleration: Vec3<T>,
    /// `ATC_RATE_R_MAX`, `ATC_RATE_P_MAX`, `ATC_RATE_Y_MAX` in rad/s; 0: none.
    pub rate: Vec3<T>,
}

/// The rotation vector of a unit quaternion, rad, the short way.
#[inline(always)]
fn rotation_vector<T: Real>(q: &Quaternion<T>) -> Vec3<T> {
    let [w, x, y, z] = *q;
    let length = dot(&[x, y, z], &[x, y, z]).sqrt();
    let angle = length.atan2(w.abs()) * 2.0;
    let tiny = length.lt(length.splat(1e-12));
    let safe = T::select(tiny, length.splat(1.0), length);
    let scale = T::select(tiny, length.splat(2.0), angle / safe);
    let scale = T::select(w.lt(w.zero()), -scale, scale);
    [x * scale, y * scale, z * scale]
}

/// Errors about the body's axes (rad) and of the tilt alone (rad).
#[inline(always)]
pub fn attitude_error<T: Real>(wanted: &Quaternion<T>, attitude: &Quaternion<T>) -> (Vec3<T>, T) {
    let [w, x, y, z] = *attitude;
    let back = [w, -x, -y, -z];
    let between = quaternion_product(&back, wanted);
    let r = rotation(&between);
    // The down axis that is wanted, seen in the body frame, and the shortest way there.
    let (zero, one) = (w.zero(), w.splat(1.0));
    let down = [r[0][2], r[1][2], r[2][2]];
    let axis = cross(&[zero, zero, one], &down);
    let sine = dot(&axis, &axis).sqrt();
    let tilt = sine.atan2(down[2]);
    let tiny = sine.lt(sine.splat(1e-12));
    let safe = T::select(tiny, one, sine);
    let scale = T::select(tiny, one, tilt / safe);
    let (half_sine, half_cosine) = (tilt * 0.5).sin_cos();
    let share = T::select(tiny, one * 0.5, half_sine / safe);
    let correction = [half_cosine, axis[0] * share, axis[1] * share, axis[2] * share];
    let undo = [correction[0], -correction[1], -correction[2], -correction[3]];
    let about_down = rotation_vector(&quaternion_product(&undo, &between));
    ([axis[0] * scale, axis[1] * scale, about_down[2]], tilt)
}

/// Turn rates wanted about the body's axes, rad/s.
///
/// `turning` is the turn rate of the attitude wanted in its own frame, rad/s, and `gyro` the measured one.
#[inline(always)]
pub fn rates_wanted<T: Real>(
    gains: &AngleGains<T>,
    wanted: &Quaternion<T>,
    turning: &Vec3<T>,
    attitude: &Quaternion<T>,
    gyro: &Vec3<T>,
    dt: f64,
) -> Vec3<T> {
    let (error, tilt) = attitude_error(wanted, attitude);
    let zero = tilt.zero();
    let mut rates = [zero; 3];
    for axis in 0..3 {
        let [least, most] = ACCELERATION[usize::from(axis == 2)];
        let given = gains.acceleration[axis];
        let counted = (given * 0.5).clamped(given.splat(least), given.splat(most));
        let limit = T::select(zero.lt(given), counted, zero);
        let rate = square_root(error[axis], gains.p[axis], limit, dt);
        let most = gains.rate[axis];
        rates[axis] = T::select(zero.lt(most), rate.clamped(-most, most), rate);
    }
    let [w, x, y, z] = *attitude;
    let ahead = product(&rotation(&quaternion_product(&[w, -x, -y, -z], wanted)), turning);
    let share = (tilt.splat(2.0) - tilt * (1.0 / FADES)).clamped(zero, tilt.splat(1.0));
    let yaw = rates[2] + ahead[2];
    [rates[0] + ahead[0] * share, rates[1] + ahead[1] * share, share.mul_add(yaw - gyro[2], gyro[2])]
}
