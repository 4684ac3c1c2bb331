//! What a control law is told at every step, and the order of the loops.
//!
//! A loop belongs to one row of the wrench: surge X, sway Y, heave Z, roll K, pitch M, heading N. Surge and sway
//! control a speed, heave the depth (a force along the earth's vertical), the others an angle. The laws behind the
//! same interface are [`crate::control::pid`] and [`crate::control::lqr`].
//!
//! Source: Taubert et al. (2014), figure 16 (control loop); Fossen (2011), section 12.2.
//! Tests: `tests/control.rs`.

use crate::number::algebra::{Vec3, Vec6};

/// The names of the loops in the order of the wrench.
pub const LOOPS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "heading"];

/// Index of the surge loop.
pub const SURGE: usize = 0;
/// Index of the sway loop.
pub const SWAY: usize = 1;
/// Index of the heave loop.
pub const HEAVE: usize = 2;
/// Index of the roll loop.
pub const ROLL: usize = 3;
/// Index of the pitch loop.
pub const PITCH: usize = 4;
/// Index of the heading loop.
pub const HEADING: usize = 5;

/// The state of all loops at one step. Arrays are in the order of [`LOOPS`].
#[derive(Clone, Copy, Debug)]
pub struct Situation<T> {
    /// Control period, s.
    pub dt: f64,
    /// Desired speed, m/s, which schedules the gains.
    pub speed: T,
    /// Reference minus measurement: surge and sway m/s, depth m (positive: go deeper), angles rad, wrapped.
    pub error: Vec6<T>,
    /// Rate of the measurement: m/s², m/s (of the depth), rad/s.
    pub rate: Vec6<T>,
    /// Rate of the reference where it is filtered and so has one, else zero.
    pub reference_rate: Vec6<T>,
    /// Measured velocity ν, body frame, m/s and rad/s.
    pub velocity: Vec6<T>,
    /// Measured roll, pitch and yaw, rad.
    pub attitude: Vec3<T>,
    /// What is known to be needed, N and N m.
    pub feed_forward: Vec6<T>,
    /// What the allocation reached of the demand of the last step; of a loop that was not at work, what its row had.
    pub achieved: Vec6<T>,
    /// 1 for the loops at work.
    pub active: Vec6<T>,
    /// 1 for the loops at work that were not at the last step.
    pub entered: Vec6<T>,
}

/// What keeps an integrator from winding up while the actuators cannot follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AntiWindup {
    /// The integral follows what the actuators reach, within the integral time K_P/K_I.
    #[default]
    BackCalculation,
    /// The integral rests while it would push further into the limit.
    Conditional,
    /// Nothing.
    None,
}
