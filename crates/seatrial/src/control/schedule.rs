//! The supporting points of adaptive gains: six desired speeds, linear in between, held beyond the ends.
//!
//! The *desired* speed schedules, not the measured one, which fluctuates: the gains do not feed back.
//!
//! Source: Taubert et al. (2014), text at equation 54 (six points over −5 … 5 m/s).
//! Tests: `tests/control.rs::law_schedule_…`.

use crate::number::real::Real;

/// The number of supporting points.
pub const POINTS: usize = 6;

/// Desired speeds of the supporting points, m/s, strictly increasing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    speeds: [f64; POINTS],
}

impl Schedule {
    /// A schedule over the given speeds.
    ///
    /// # Errors
    /// What is expected, when they are not finite or do not increase.
    pub fn new(speeds: [f64; POINTS]) -> Result<Self, String> {
        if speeds.iter().any(|u| !u.is_finite()) || speeds.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(format!("expected {POINTS} strictly increasing speeds in m/s, found {speeds:?}"));
        }
        Ok(Self { speeds })
    }

    /// The speeds, m/s.
    pub fn speeds(&self) -> [f64; POINTS] {
        self.speeds
    }

    /// The share of each supporting point at the speed `u`; they add up to one.
    #[inline(always)]
    pub fn weights<T: Real>(&self, u: T) -> [T; POINTS] {
        let s = &self.speeds;
        let (zero, one) = (u.zero(), u.splat(1.0));
        let mut weights = [one; POINTS];
        for i in 0..POINTS {
            if i > 0 {
                weights[i] = weights[i].min((u - s[i - 1]) * (1.0 / (s[i] - s[i - 1])));
            }
            if i + 1 < POINTS {
                weights[i] = weights[i].min((-u + s[i + 1]) * (1.0 / (s[i + 1] - s[i])));
            }
            weights[i] = weights[i].max(zero);
        }
        weights
    }
}

/// A gain at the weights of the supporting points.
#[inline(always)]
pub fn interpolated<T: Real>(gain: &[T; POINTS], weights: &[T; POINTS]) -> T {
    crate::number::algebra::dot(gain, weights)
}
