//! From six demands to pulse widths.
//!
//! A frame is a table: by how much each motor takes part in roll, pitch, yaw, throttle (up), forward and lateral. What
//! happens when a motor is asked for more than all it has differs between frames:
//!
//! ```text
//! Vectored_6DOF:  thrust_i = direction_i · limited(rpt_i / max(1, |rpt|) + yfl_i / max(1, |yfl|))
//! Vectored:       thrust_i = direction_i · limited(sum of all shares), with less forward of the two motors at the rear
//! the others:     thrust_i = direction_i · limited(sum of all shares)
//! pulse_i = 1500 µs + thrust_i · (MOT_PWM_MAX − 1500 or 1500 − MOT_PWM_MIN), whole µs
//! ```
//!
//! The first scales roll, pitch and throttle (rpt), and yaw, forward and lateral (yfl), down for all motors alike. The second
//! bounds the forward demand of the motors that are at the rear in the direction of travel by
//! 1 − `MOT_FV_CPLNG_K` |throttle|, because their wash meets that of the vertical motors.
//!
//! Source: ArduPilot, "Sub frame configurations", `FRAME_CONFIG`, `MOT_n_DIRECTION`, `AP_Motors6DOF` (numbers and
//! structure as facts). Tests: `tests/ardusub.rs`.

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

/// What happens when a motor is asked for more than all it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mixing {
    /// Each motor is limited by itself.
    Alone,
    /// The same, with less forward of the two motors at the rear.
    Coupled,
    /// Roll, pitch and throttle are scaled down together, and yaw, forward and lateral.
    Scaled,
}

/// The rule of a frame by its name.
fn mixing(frame: &str) -> Mixing {
    match frame {
        "Vectored_6DOF" => Mixing::Scaled,
        "Vectored" => Mixing::Coupled,
        _ => Mixing::Alone,
    }
}

/// In which direction of forward each motor of the Vectored frame is at the rear.
const REAR: [f64; MOTORS] = [-1.0, -1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0];

/// `MOT_FV_CPLNG_K` unless it is set.
pub const COUPLING: f64 = 1.0;

/// The motors of a vehicle.
#[derive(Clone, Debug)]
pub struct Mixer {
    /// Shares of every motor.
    pub motors: &'static [Shares],
    mixing: Mixing,
    /// `MOT_n_DIRECTION`, 1 or −1, of every motor.
    pub direction: [f64; MOTORS],
    /// `MOT_PWM_MIN` and `MOT_PWM_MAX`, µs.
    pub pulse: [f64; 2],
    /// `MOT_FV_CPLNG_K`, which counts for the Vectored frame.
    pub coupling: f64,
}

/// The pulse of no thrust, µs.
pub const NEUTRAL: f64 = 1500.0;

impl Mixer {
    /// The mixer of a frame by its name, or the names that there are.
    ///
    /// # Errors
    /// The known names.
    pub fn of(frame: &str, direction: [f64; MOTORS], pulse: [f64; 2], coupling: f64) -> Result<Self, String> {
        let Some((name, motors)) = FRAMES.iter().find(|(name, _)| *name == frame) else {
            let known: Vec<_> = FRAMES.iter().map(|(name, _)| *name).collect();
            return Err(format!("frame: expected one of {}, found {frame}", known.join(", ")));
        };
        Ok(Self { motors, mixing: mixing(name), direction, pulse, coupling })
    }

    /// Thrusts, −1 to 1 of each motor, for demands of roll, pitch, yaw, throttle (−1 to 1, up), forward and lateral.
    #[inline(always)]
    pub fn thrusts<T: Real>(&self, demands: &[T; 6]) -> [T; MOTORS] {
        self.loaded_thrusts(demands).0
    }

    /// The thrusts, and how much of all it has the most loaded motor is asked for: of roll, pitch and throttle, and of
    /// yaw, forward and lateral. Nothing reads the loads but who looks at a flight: ArduSub's mixer reports no limit of
    /// roll, pitch, yaw, forward or lateral to the controllers.
    #[inline(always)]
    pub fn loaded_thrusts<T: Real>(&self, demands: &[T; 6]) -> ([T; MOTORS], [T; 2]) {
        let (zero, one) = (demands[0].zero(), demands[0].splat(1.0));
        let (mut tilting, mut planar) = ([zero; MOTORS], [zero; MOTORS]);
        let (mut most_tilting, mut most_planar) = (zero, zero);
        let [roll, pitch, yaw, up, forward, lateral] = *demands;
        let up = up.clamped(-one, one);
        let left = (one - up.abs() * self.coupling).max(zero);
        for (i, shares) in self.motors.iter().enumerate() {
            let share = |k: usize| one * shares[k];
            let behind = self.mixing == Mixing::Coupled && REAR[i] != 0.0;
            let own = match (behind, REAR[i] > 0.0) {
                (false, _) => forward,
                (true, true) => forward.min(left),
                (true, false) => forward.max(-left),
            };
            tilting[i] = dot(&[share(0), share(1), share(3)], &[roll, pitch, up]);
            planar[i] = dot(&[share(2), share(4), share(5)], &[yaw, own, lateral]);
            most_tilting = most_tilting.max(tilting[i].abs());
            most_planar = most_planar.max(planar[i].abs());
        }
        let scales = match self.mixing {
            Mixing::Scaled => [most_tilting.max(one), most_planar.max(one)],
            Mixing::Alone | Mixing::Coupled => [one; 2],
        };
        let mut thrusts = [zero; MOTORS];
        for i in 0..self.motors.len() {
            let sum = tilting[i] / scales[0] + planar[i] / scales[1];
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
