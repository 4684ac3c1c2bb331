//! From a depth or place wanted to an acceleration wanted, and from there to throttle, forward and lateral.
//!
//! ```text
//! v = square_root(x_d − x, PSC_*_POS_P, a_max) + v_d,     a = PID(v − v̇_measured) + a_d
//! throttle = hover − PID(a_down)        forward, lateral = a along the hull, in shares of the lean angle's limit
//! ```
//!
//! Source: ArduPilot, "Position controllers", ArduSub's use of lean angles as forward and lateral (structure as
//! facts). Tests: `tests/ardusub.rs`.

use super::pid::square_root;
use crate::number::algebra::Vec3;
use crate::number::real::Real;

/// Acceleration of gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// The velocity wanted for an error of position, m/s.
///
/// `error` in m, `velocity` the one that moves the target, m/s, `p` per s, `acceleration` in m/s² (0: proportional).
#[inline(always)]
pub fn velocity_wanted<T: Real>(error: T, velocity: T, p: T, acceleration: T, dt: f64) -> T {
    square_root(error, p, acceleration, dt) + velocity
}

/// Forward and lateral, −1 to 1, of an acceleration wanted.
///
/// `acceleration` north and east in m/s², `heading` in rad, `limit` the largest lean angle (`ANGLE_MAX`,
/// `ATC_ANGLE_MAX`) in rad. A vehicle that leans would reach the acceleration by the tangent of its angles; ArduSub pushes in
/// proportion to these.
#[inline(always)]
pub fn forward_and_lateral<T: Real>(acceleration: &[T; 2], heading: T, limit: f64) -> [T; 2] {
    let (sine, cosine) = heading.sin_cos();
    let [north, east] = *acceleration;
    let ahead = north.mul_add(cosine, east * sine);
    let starboard = east.mul_sub(cosine, north * sine);
    let one = ahead.splat(1.0);
    let pitch = -(ahead * (1.0 / GRAVITY)).atan2(one);
    let (_, level) = pitch.sin_cos();
    let roll = (starboard * level * (1.0 / GRAVITY)).atan2(one);
    let share = |angle: T| angle.clamped(angle.splat(-limit), angle.splat(limit)) * (1.0 / limit);
    [-share(pitch), share(roll)]
}

/// Throttle, 0 to 1, of the vertical controller's output (down) about what hovers.
#[inline(always)]
pub fn throttle<T: Real>(output: T, hover: T) -> T {
    (hover - output).clamped(output.zero(), output.splat(1.0))
}

/// Demands of roll, pitch, yaw with throttle, forward and lateral as [`super::mixer::Mixer`] takes them.
#[inline(always)]
pub fn demands<T: Real>(turning: &Vec3<T>, throttle: T, forward: T, lateral: T) -> [T; 6] {
    [turning[0], turning[1], turning[2], (throttle - 0.5) * 2.0, forward, lateral]
}
