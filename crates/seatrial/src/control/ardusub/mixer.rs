//! From six demands to pulse widths.
//!
//! A frame is a table: by how much each motor takes part in roll, pitch, yaw, throttle (up), forward and lateral. Roll,
//! pitch and throttle are summed apart from yaw, forward and lateral, since frames drive them by other motors; the sum of
//! either that asks a motor for more than all it has is scaled down for all motors alike.
//!
//! ```text
//! thrust_i = direction_i · limited(rpt_i / max(1, |rpt|) + yfl_i / max(1, |yfl|))
//! pulse_i = 1500 µs + thrust_i · (MOT_PWM_MAX − 1500 or 1500 − MOT_PWM_MIN), whole µs
//! ```
//!
//! Source: ArduPilot, "Sub frame configurations", `FRAME_CONFIG`, `MOT_n_DIRECTION` (numbers as facts). Tests:
//! `tests/ardusub.rs`.

use crate::number::algebra::dot;
use crate::number::real::Real;

/// The most motors of a frame.
pub const MOTORS: usize = 8;

/// Shares of a motor in roll, pitch, yaw, throttle, forward and lateral.
pub type Shares = [f64; 6];

/// Names of the frames, by the value of `FRAME_CONFIG`.
pub const FRAMES: [(&str, &[Shares]); 7] = [
    (
        "BlueROV1",
        &[
            [0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, 0.0],
            [-0.5, 0.5, 0.0, 0.45, 0.0, 0.0],
            [0.5, 0.5, 0.0, 0.45, 0.0, 0.0],
            [0.0, -1.0, 0.0, 1.0, 0.0, 0.0],
            [-0.25, 0.0, 0.0, 0.0, 0.0, 1.0],
        ],
    ),
    (
        "Vectored",
        &[
            [0.0, 0.0, 1.0, 0.0, -1.0, 1.0],
            [0.0, 0.0, -1.0, 0.0, -1.0, -1.0],
            [0.0, 0.0, -1.0, 0.0, 1.0, 1.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, -1.0],
            [1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        ],
    ),
    (
        "Vectored_6DOF",
        &[
            [0.0, 0.0, 1.0, 0.0, -1.0, 1.0],
            [0.0, 0.0, -1.0, 0.0, -1.0, -1.0],
            [0.0, 0.0, -1.0, 0.0, 1.0, 1.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, -1.0],
            [1.0, -1.0, 0.0, -1.0, 0.0, 0.0],
            [-1.0, -1.0, 0.0, -1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0, -1.0, 0.0, 0.0],
            [-1.0, 1.0, 0.0, -1.0, 0.0, 0.0],
        ],
    ),
    (
        "Vectored_6DOF_90",
        &[
            [1.0, 1.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, 0.0],
            [1.0, -1.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            [-1.0, 1.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
            [-1.0, -1.0, 0.0, 1.0, 0.0, 0.0],
        ],
    ),
    (
        "SimpleROV-3",
        &[[0.0, 0.0, -1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, -1.0, 0.0, 0.0]],
    ),
    (
        "SimpleROV-4",
        &[
            [0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        ],
    ),
    (
        "SimpleROV-5",
        &[
            [0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ],
    ),
];

/// The motors of a vehicle.
#[derive(Clone, Debug)]
pub struct Mixer {
    /// Shares of every motor.
    pub motors: &'static [Shares],
    /// `MOT_n_DIRECTION`, 1 or −1, of every motor.
    pub direction: [f64; MOTORS],
    /// `MOT_PWM_MIN` and `MOT_PWM_MAX`, µs.
    pub pulse: [f64; 2],
}

/// The pulse of no thrust, µs.
pub const NEUTRAL: f64 = 1500.0;

impl Mixer {
    /// Thrusts, −1 to 1 of each motor, for demands of roll, pitch, yaw, throttle (−1 to 1, up), forward and lateral.
    #[inline(always)]
    pub fn thrusts<T: Real>(&self, demands: &[T; 6]) -> [T; MOTORS] {
        self.loaded_thrusts(demands).0
    }

    /// The thrusts, and how much of all it has the most loaded motor is asked for: of roll, pitch and throttle, and of
    /// yaw, forward and lateral. From 1 on that group is at its limit.
    #[inline(always)]
    pub fn loaded_thrusts<T: Real>(&self, demands: &[T; 6]) -> ([T; MOTORS], [T; 2]) {
        let (zero, one) = (demands[0].zero(), demands[0].splat(1.0));
        let (mut tilting, mut planar) = ([zero; MOTORS], [zero; MOTORS]);
        let (mut most_tilting, mut most_planar) = (zero, zero);
        let [roll, pitch, yaw, up, forward, lateral] = *demands;
        for (i, shares) in self.motors.iter().enumerate() {
            let share = |k: usize| one * shares[k];
            tilting[i] = dot(&[share(0), share(1), share(3)], &[roll, pitch, up]);
            planar[i] = dot(&[share(2), share(4), share(5)], &[yaw, forward, lateral]);
            most_tilting = most_tilting.max(tilting[i].abs());
            most_planar = most_planar.max(planar[i].abs());
        }
        let mut thrusts = [zero; MOTORS];
        for i in 0..self.motors.len() {
            let sum = tilting[i] / most_tilting.max(one) + planar[i] / most_planar.max(one);
            thrusts[i] = sum.clamped(-one, one) * self.direction[i];
        }
        (thrusts, [most_tilting, most_planar])
    }

    /// The pulse of a thrust, µs.
    #[inline(always)]
    pub fn pulse<T: Real>(&self, thrust: T) -> T {
        let range = T::select(
            thrust.zero().lt(thrust),
            thrust.splat(self.pulse[1] - NEUTRAL),
            thrust.splat(NEUTRAL - self.pulse[0]),
        );
        (thrust.mul_add(range, thrust.splat(NEUTRAL))).floor()
    }
}
