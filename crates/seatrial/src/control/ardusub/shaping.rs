//! From an attitude that is asked for to a target that moves there.
//!
//! A step of the attitude asked for is no step of the target: this turns towards it with limited rate and acceleration,
//! and feeds its turn rate forward to the controllers, so that target and vehicle stay close.
//!
//! ```text
//! q_d ← q_d ⊗ exp(ω_d Δt)
//! φ̇ ← square_root(φ_asked − φ_d, 1 / ATC_INPUT_TC, φ̈_max) within ±φ̈_max Δt of φ̇        the same for θ and ψ
//! |ψ̇| ≤ ATC_RATE_WPY_MAX (and ATC_RATE_Y_MAX),     ω_d = T(φ_d, θ_d) [φ̇ θ̇ ψ̇]ᵀ within ATC_RATE_*_MAX
//! φ̈_max, θ̈_max, ψ̈_max: what ATC_ACC_*_MAX of the body's axes leave of the Euler angles
//! ```
//!
//! With `ATC_RATE_FF_ENAB` = 0 the target is what is asked for, with the slewed yaw, and nothing is fed forward.
//!
//! Source: ArduPilot, `AC_AttitudeControl`: `input_euler_angle_roll_pitch_yaw`, `input_shaping_angle`,
//! `euler_accel_limit`, `get_slew_yaw_max_rads` (structure as facts). Tests: `tests/ardusub.rs`.

use super::attitude::limited_rates;
use super::pid::square_root;
use crate::model::kinematics::{Quaternion, from_euler, normalised, quaternion_product, to_euler};
use crate::number::algebra::{Vec3, dot};
use crate::number::real::Real;

/// Least sine and cosine with which limits of the body's axes are turned into limits of the Euler angles.
const LEAST_SHARE: f64 = 0.1;

/// Least time constant of the input, s.
const LEAST_TIME_S: f64 = 0.01;

/// How targets are shaped.
#[derive(Clone, Copy, Debug)]
pub struct Shaping<T> {
    /// `ATC_INPUT_TC`, s.
    pub time: T,
    /// `ATC_RATE_WPY_MAX` (`ATC_SLEW_YAW` until 4.6), rad/s.
    pub slew: T,
    /// `ATC_ACC_R_MAX`, `ATC_ACC_P_MAX`, `ATC_ACC_Y_MAX` in rad/s²; 0: none.
    pub acceleration: Vec3<T>,
    /// `ATC_RATE_R_MAX`, `ATC_RATE_P_MAX`, `ATC_RATE_Y_MAX` in rad/s; 0: none.
    pub rate: Vec3<T>,
    /// `ATC_RATE_FF_ENAB`.
    pub fed_forward: bool,
}

/// A target that moves.
#[derive(Clone, Copy, Debug)]
pub struct Target<T> {
    /// Body of the target to NED.
    pub attitude: Quaternion<T>,
    /// Turn rate of the target in its own frame, rad/s.
    pub turning: Vec3<T>,
    /// The same as rates of roll, pitch and yaw, rad/s.
    euler_rate: Vec3<T>,
}

impl<T: Real> Target<T> {
    /// A target that rests where the vehicle is.
    #[inline(always)]
    pub fn at(attitude: &Quaternion<T>) -> Self {
        let zero = attitude[0].zero();
        Self { attitude: *attitude, turning: [zero; 3], euler_rate: [zero; 3] }
    }
}

impl<T: Real> Shaping<T> {
    /// Moves a target `dt` seconds on its way to roll, pitch and yaw, rad.
    #[inline(always)]
    pub fn step(&self, target: &mut Target<T>, asked: &Vec3<T>, dt: f64) {
        target.attitude = normalised(&turned(&target.attitude, &target.turning.map(|x| x * dt)));
        let euler = to_euler(&target.attitude);
        let (zero, one) = (self.time.zero(), self.time.splat(1.0));
        let own = self.rate[2];
        let slew = T::select(zero.lt(own), own.min(self.slew), self.slew);
        if !self.fed_forward {
            let left = (asked[2] - euler[2]).wrap().clamped(-slew * dt, slew * dt);
            *target = Target::at(&from_euler(&[asked[0], asked[1], euler[2] + left]));
            return;
        }
        let gain = one / self.time.max(one * LEAST_TIME_S);
        let limit = self.euler_acceleration(&euler);
        for axis in 0..3 {
            let rate = square_root((asked[axis] - euler[axis]).wrap(), gain, limit[axis], dt);
            let (before, change) = (target.euler_rate[axis], limit[axis] * dt);
            let near = rate.clamped(before - change, before + change);
            target.euler_rate[axis] = T::select(zero.lt(limit[axis]), near, rate);
        }
        target.euler_rate[2] = target.euler_rate[2].clamped(-slew, slew);
        target.turning = limited_rates(&body_rates(&euler, &target.euler_rate), &self.rate);
        target.euler_rate = euler_rates(&euler, &target.turning);
    }

    /// What the limits of the body's axes leave of the Euler angles, rad/s²; the limits themselves where one is missing.
    #[inline(always)]
    fn euler_acceleration(&self, euler: &Vec3<T>) -> Vec3<T> {
        let [x, y, z] = self.acceleration;
        let (zero, one) = (x.zero(), x.splat(1.0));
        let share = |part: T| part.abs().clamped(one * LEAST_SHARE, one);
        let ((sine_roll, cosine_roll), (sine_pitch, cosine_pitch)) = (euler[0].sin_cos(), euler[1].sin_cos());
        let (sr, cr, sp, cp) = (share(sine_roll), share(cosine_roll), share(sine_pitch), share(cosine_pitch));
        let all = T::both(zero.lt(x), T::both(zero.lt(y), zero.lt(z)));
        let pitch = (y / cr).min(z / sr);
        let yaw = (x / sp).min(y / (sr * cp)).min(z / (cr * cp));
        [x, T::select(all, pitch, y), T::select(all, yaw, z)]
    }
}

/// An attitude turned by a rotation vector in its own frame, rad.
#[inline(always)]
fn turned<T: Real>(attitude: &Quaternion<T>, by: &Vec3<T>) -> Quaternion<T> {
    let angle = dot(by, by).sqrt();
    let tiny = angle.lt(angle.splat(1e-12));
    let (sine, cosine) = (angle * 0.5).sin_cos();
    let share = T::select(tiny, angle.splat(0.5), sine / T::select(tiny, angle.splat(1.0), angle));
    quaternion_product(attitude, &[cosine, by[0] * share, by[1] * share, by[2] * share])
}

/// Turn rates about the body's axes of rates of roll, pitch and yaw.
#[inline(always)]
fn body_rates<T: Real>(euler: &Vec3<T>, rate: &Vec3<T>) -> Vec3<T> {
    let ((sr, cr), (sp, cp)) = (euler[0].sin_cos(), euler[1].sin_cos());
    let [roll, pitch, yaw] = *rate;
    [roll - sp * yaw, cr * pitch + sr * cp * yaw, cr * cp * yaw - sr * pitch]
}

/// Rates of roll, pitch and yaw of turn rates about the body's axes.
#[inline(always)]
fn euler_rates<T: Real>(euler: &Vec3<T>, turning: &Vec3<T>) -> Vec3<T> {
    let ((sr, cr), (sp, cp)) = (euler[0].sin_cos(), euler[1].sin_cos());
    let [x, y, z] = *turning;
    let about = sr * y + cr * z;
    // A target that points straight up or down has no rate of yaw: what is divided by is kept off zero.
    let steep = cp.abs().lt(cp.splat(1e-9));
    let yaw = about / T::select(steep, cp.splat(1e-9), cp);
    [x + sp * yaw, cr * y - sr * z, yaw]
}
