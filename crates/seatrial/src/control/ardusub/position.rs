//! From a depth or place wanted to an acceleration wanted, and from there to throttle, forward and lateral.
//!
//! ```text
//! v = square_root(x_d − x, PSC_*_POS_P, a_max) + v_d,     a = PID(v − v̇_measured) + a_d
//! throttle = hover − PID(a_down)        forward, lateral = a along the hull, in shares of the lean angle's limit
//! |a_plane| ≤ g tan(ATC_ANGLE_MAX), what is across the velocity wanted first
//! ```
//!
//! Source: ArduPilot, "Position controllers", `AC_PosControl`, `AC_PID_2D`, `limit_accel_xy` in `AP_Math`, ArduSub's use
//! of lean angles as forward and lateral (structure as facts). Tests: `tests/ardusub.rs`.

use super::pid::square_root;
use crate::number::algebra::{Vec3, dot};
use crate::number::plain;
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

/// An acceleration in the plane within what the largest lean angle (`limit`, rad) gives, and where that bounds it.
///
/// `acceleration` and `velocity`, which is the one that moves the target, north and east. What is across the velocity
/// comes first: a vehicle that cannot have both stays on its line and loses speed.
#[inline(always)]
pub fn limited_acceleration<T: Real>(
    acceleration: &[T; 2],
    velocity: &[f64; 2],
    limit: f64,
) -> ([T; 2], T::Mask) {
    let most = acceleration[0].splat(GRAVITY * plain::tan(limit));
    let size = dot(acceleration, acceleration).sqrt();
    let limited = most.lt(size);
    let speed = plain::hypot(velocity[0], velocity[1]);
    let within = if speed > 0.0 {
        let [north, east] = velocity.map(|x| most.splat(x / speed));
        let (along, across) =
            (dot(acceleration, &[north, east]), north.mul_sub(acceleration[1], east * acceleration[0]));
        let across = across.clamped(-most, most);
        let left = (most * most - across * across).max(most.zero()).sqrt();
        let along = along.clamped(-left, left);
        [north.mul_sub(along, east * across), east.mul_add(along, north * across)]
    } else {
        let share = most / size.max(most);
        [acceleration[0] * share, acceleration[1] * share]
    };
    (std::array::from_fn(|i| T::select(limited, within[i], acceleration[i])), limited)
}

/// The two integral parts of the plane after a step: within `most` together, and no longer than `before` where they grew
/// towards an acceleration that could not be had (`beyond`, zero where all could).
#[inline(always)]
pub fn plane_integrals<T: Real>(before: &[T; 2], after: &[T; 2], beyond: &[T; 2], most: T) -> [T; 2] {
    let (zero, one) = (most.zero(), most.splat(1.0));
    let grown = [after[0] - before[0], after[1] - before[1]];
    let outward = zero.lt(dot(&grown, beyond));
    let bound = T::select(outward, dot(before, before).sqrt().min(most), most);
    let size = dot(after, after).sqrt();
    let share = T::select(bound.lt(size), bound / T::select(zero.lt(size), size, one), one);
    [after[0] * share, after[1] * share]
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
