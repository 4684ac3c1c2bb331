//! From an attitude wanted to turn rates wanted.
//!
//! The error is split in two: what tilts the down axis onto the one wanted, and what is left about it. So a large error
//! of yaw does not tilt the vehicle on the way.
//!
//! ```text
//! c = tilt of R e_d onto R_d e_d, seen in the body frame:  e_roll, e_pitch = its rotation vector
//! e_yaw = rotation vector of c⁻¹ ⊗ q⁻¹ ⊗ q_d about e_d
//! |e_yaw| ≤ min(45°, inverse_square_root(1 / ATC_RAT_YAW_P, ATC_ANG_YAW_P, ½ ATC_ACC_Y_MAX within its bounds))
//! ω_wanted = square_root(e, ATC_ANG_*_P, ½ ATC_ACC_*_MAX within its bounds) + R(q⁻¹ ⊗ q_d) ω_d
//! ```
//!
//! The bound of the yaw error is what would saturate the output of a vehicle that does not turn. Where it bounds, the
//! target moves along with the vehicle: q_d = q ⊗ c ⊗ (e_yaw about e_d).
//!
//! Source: ArduPilot, "Attitude control", `AC_AttitudeControl`: `thrust_heading_rotation_angles`,
//! `update_ang_vel_target_from_att_error`, `ang_vel_limit` (structure as facts). Tests: `tests/ardusub.rs`.

use super::pid::{inverse_square_root, square_root};
use crate::model::kinematics::{Quaternion, quaternion_product, rotation};
use crate::number::algebra::{Vec3, cross, dot, product};
use crate::number::real::Real;

/// Bounds of the acceleration that the square-root controller counts on, rad/s²: roll and pitch, yaw.
const ACCELERATION: [[f64; 2]; 2] = [[40.0 * RAD, 720.0 * RAD], [10.0 * RAD, 120.0 * RAD]];

const RAD: f64 = std::f64::consts::PI / 180.0;

/// Tilt error from which the feed-forward fades out, and at whose double it is gone, rad.
const FADES: f64 = 30.0 * RAD;

/// The largest error of yaw that turns the vehicle, rad.
const LARGEST_YAW: f64 = 45.0 * RAD;

/// Gains of the angle controllers.
#[derive(Clone, Copy, Debug)]
pub struct AngleGains<T> {
    /// `ATC_ANG_RLL_P`, `ATC_ANG_PIT_P`, `ATC_ANG_YAW_P`, per s.
    pub p: Vec3<T>,
    /// `ATC_ACC_R_MAX`, `ATC_ACC_P_MAX`, `ATC_ACC_Y_MAX` in rad/s²; 0: proportional.
    pub acceleration: Vec3<T>,
    /// `ATC_RATE_R_MAX`, `ATC_RATE_P_MAX`, `ATC_RATE_Y_MAX` in rad/s; 0: none.
    pub rate: Vec3<T>,
    /// `ATC_RAT_YAW_P`, s, which bounds the error of yaw; 0: no bound.
    pub yaw_rate_p: T,
}

impl<T: Real> AngleGains<T> {
    /// The acceleration that the square-root controller of an axis counts on, rad/s²; 0: proportional.
    #[inline(always)]
    fn counted(&self, axis: usize) -> T {
        let [least, most] = ACCELERATION[usize::from(axis == 2)];
        let given = self.acceleration[axis];
        let counted = (given * 0.5).clamped(given.splat(least), given.splat(most));
        T::select(given.zero().lt(given), counted, given.zero())
    }

    /// The largest error of yaw, rad, and where there is a bound.
    #[inline(always)]
    fn largest_yaw(&self) -> (T, T::Mask) {
        let (p, rate_p) = (self.p[2], self.yaw_rate_p);
        let (zero, one) = (p.zero(), p.splat(1.0));
        let bounded = T::both(zero.lt(p), zero.lt(rate_p));
        let saturates = one / T::select(bounded, rate_p, one);
        // Without a limit of the acceleration ArduPilot counts on its lower bound here.
        let [least, most] = ACCELERATION[1];
        let limit = (self.acceleration[2] * 0.5).clamped(p.splat(least), p.splat(most));
        let error = inverse_square_root(saturates, T::select(bounded, p, one), limit);
        (error.min(p.splat(LARGEST_YAW)), bounded)
    }
}

/// Rates within their bounds, rad/s: roll and pitch together, in an ellipse where both are bounded; 0: none.
#[inline(always)]
pub fn limited_rates<T: Real>(rates: &Vec3<T>, most: &Vec3<T>) -> Vec3<T> {
    let (zero, one) = (most[0].zero(), most[0].splat(1.0));
    let has = most.map(|x| zero.lt(x));
    let safe = |axis: usize| T::select(has[axis], most[axis], one);
    let alone = |axis: usize| T::select(has[axis], rates[axis].clamped(-safe(axis), safe(axis)), rates[axis]);
    let [x, y] = [rates[0] / safe(0), rates[1] / safe(1)];
    let shrink = x.mul_add(x, y * y).sqrt().max(one);
    let together = T::both(has[0], has[1]);
    let tilting = |axis: usize| T::select(together, rates[axis] / shrink, alone(axis));
    [tilting(0), tilting(1), alone(2)]
}

/// What turns an attitude into the one wanted.
#[derive(Clone, Copy, Debug)]
pub struct Error<T> {
    /// About the body's axes, rad.
    pub about: Vec3<T>,
    /// Of the tilt alone, rad.
    pub tilt: T,
    /// The rotation that removes the tilt, seen in the body frame.
    correction: Quaternion<T>,
}

/// What the angle controllers want.
#[derive(Clone, Copy, Debug)]
pub struct Turn<T> {
    /// Turn rates about the body's axes, rad/s.
    pub rates: Vec3<T>,
    /// The attitude wanted: what it was, or where the bound of the yaw error has moved it.
    pub target: Quaternion<T>,
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

/// The error between two attitudes, without a bound of the yaw.
#[inline(always)]
pub fn attitude_error<T: Real>(wanted: &Quaternion<T>, attitude: &Quaternion<T>) -> Error<T> {
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
    Error { about: [axis[0] * scale, axis[1] * scale, about_down[2]], tilt, correction }
}

/// Turn rates wanted about the body's axes, and the target that they follow.
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
) -> Turn<T> {
    let Error { about: mut error, tilt, correction } = attitude_error(wanted, attitude);
    let zero = tilt.zero();
    let (most, bounded) = gains.largest_yaw();
    let moved = T::both(bounded, most.lt(error[2].abs()));
    error[2] = T::select(moved, error[2].clamped(-most, most), error[2]);
    let (half_sine, half_cosine) = (error[2] * 0.5).sin_cos();
    let along =
        quaternion_product(&quaternion_product(attitude, &correction), &[half_cosine, zero, zero, half_sine]);
    let target = std::array::from_fn(|i| T::select(moved, along[i], wanted[i]));
    let mut rates = [zero; 3];
    for axis in 0..3 {
        rates[axis] = square_root(error[axis], gains.p[axis], gains.counted(axis), dt);
    }
    let rates = limited_rates(&rates, &gains.rate);
    let [w, x, y, z] = *attitude;
    let ahead = product(&rotation(&quaternion_product(&[w, -x, -y, -z], &target)), turning);
    let share = (tilt.splat(2.0) - tilt * (1.0 / FADES)).clamped(zero, tilt.splat(1.0));
    let yaw = rates[2] + ahead[2];
    let rates =
        [rates[0] + ahead[0] * share, rates[1] + ahead[1] * share, share.mul_add(yaw - gyro[2], gyro[2])];
    Turn { rates, target }
}
