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
use crate::number::plain;
use crate::number::real::Real;

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
#[derive(Clone, Copy, Debug)]
pub struct Motion<T> {
    /// Of the displacement, m².
    pub displacement: T,
    /// Of the velocity, m²/s².
    pub velocity: T,
    /// Of the acceleration, m²/s⁴.
    pub acceleration: T,
}

impl<T: Real> Motion<T> {
    /// No motion, in the kind of `unit`.
    pub fn none(unit: T) -> Self {
        let zero = unit.zero();
        Self { displacement: zero, velocity: zero, acceleration: zero }
    }
}

impl Swell {
    /// The motion at a depth, m.
    #[inline(always)]
    pub fn at<T: Real>(&self, depth: T) -> Motion<T> {
        let (mut motion, below) = (Motion::none(depth), depth.max(depth.zero()));
        for [omega, number, variance] in &self.components {
            let (left, square) = ((below * (-2.0 * number)).exp() * *variance, omega * omega);
            motion.displacement += left;
            motion.velocity += left * square;
            motion.acceleration += left * (square * square);
        }
        motion
    }

    /// The share of these variances along a unit vector (NED).
    #[inline(always)]
    pub fn share<T: Real>(&self, direction: &Vec3<T>) -> T {
        let ([north, east], [x, y, z]) = (self.toward, *direction);
        let (along, across) = (x * north + y * east, y * north - x * east);
        let spread = 0.5 * (1.0 - plain::exp(-2.0 * self.spreading * self.spreading));
        z * z + along * along * (1.0 - spread) + across * across * spread
    }
}
