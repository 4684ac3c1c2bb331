//! Waves as noise: how much the orbital motion of the water moves a vehicle that the filter follows without it.
//!
//! A vehicle that is as heavy as the water that it displaces goes along with the orbital motion: its velocity through the
//! water hardly changes, its velocity over ground and its place do. The filter estimates the motion without the waves
//! (wave filtering), and what a sensor shows of the waves is noise of that sensor. At depth d, per component of elevation
//! variance s, frequency ω and wave number k, the variance of displacement, velocity and acceleration down and along the
//! waves is `s e^(−2kd) [1, ω², ω⁴]`. Directions spread by σ about the mean put `(1 − e^(−2σ²))/2` of the horizontal
//! variance across it.
//!
//! Source: Fossen (2021), sections 10.2.1 (orbital motion) and 13.2 (wave filtering). Tests: `tests/flight/test_navigation.py`.

use crate::number::algebra::Vec3;

/// The waves that a filter is told of.
#[derive(Clone, Debug)]
pub struct Swell {
    /// Of each component frequency in rad/s, wave number in rad/m and variance of the elevation in m².
    pub components: Vec<[f64; 3]>,
    /// North and east of where the waves go, a unit vector.
    pub toward: [f64; 2],
    /// Standard deviation of the directions about it, rad.
    pub spreading: f64,
}

/// Variances of the water's motion at one depth, down and along the waves.
#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    /// Of the displacement, m².
    pub displacement: f64,
    /// Of the velocity, m²/s².
    pub velocity: f64,
    /// Of the acceleration, m²/s⁴.
    pub acceleration: f64,
}

impl Swell {
    /// The motion at a depth, m.
    pub fn at(&self, depth: f64) -> Motion {
        let mut motion = Motion::default();
        for [omega, number, variance] in &self.components {
            let (left, square) = (variance * (-2.0 * number * depth.max(0.0)).exp(), omega * omega);
            motion.displacement += left;
            motion.velocity += left * square;
            motion.acceleration += left * square * square;
        }
        motion
    }

    /// The share of these variances along a unit vector (NED).
    pub fn share(&self, direction: &Vec3<f64>) -> f64 {
        let ([north, east], [x, y, z]) = (self.toward, *direction);
        let (along, across) = (north * x + east * y, north * y - east * x);
        let spread = 0.5 * (1.0 - (-2.0 * self.spreading * self.spreading).exp());
        z * z + (1.0 - spread) * along * along + spread * across * across
    }
}
