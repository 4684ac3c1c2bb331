//! The criterion of the identification, accumulated while the model runs: no trajectory is stored.
//!
//! Per channel `Q = Σ_k loss(weight_k |y_k − ŷ_k|)`; the least absolute error is Taubert et al. (2014),
//! equation 48. Angles are compared along the shorter way round. A weight of zero masks a sample.
//!
//! Tests: `tests/scalars.rs`, `tests/core/test_scalar_textbook.py`.

use crate::model::integrate::State;
use crate::model::kinematics::to_euler;
use crate::number::real::Real;
use std::ops::Range;

/// The number of channels.
pub const CHANNELS: usize = 12;
/// Their names and order: velocities (m/s, rad/s), position (m), Euler angles (rad).
pub const CHANNEL_NAMES: [&str; CHANNELS] =
    ["u", "v", "w", "p", "q", "r", "x", "y", "z", "roll", "pitch", "yaw"];
/// The first of the three angles.
pub(crate) const ROLL: usize = 9;

/// How a weighted error counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// `|e|`.
    Absolute,
    /// `e²`.
    Squared,
    /// `e²/(2 k)` up to the knee k, `|e| − k/2` beyond.
    Huber(f64),
}

impl Loss {
    #[inline(always)]
    fn of<T: Real>(self, error: T) -> T {
        let size = error.abs();
        match self {
            Self::Absolute => size,
            Self::Squared => size * size,
            Self::Huber(knee) => {
                let bent = size * size * (0.5 / knee);
                T::select(size.lt(size.splat(knee)), bent, size - 0.5 * knee)
            }
        }
    }
}

/// The channels of a state.
#[inline(always)]
pub fn channels<T: Real>(state: &State<T>) -> [T; CHANNELS] {
    let [x, y, z] = state.position;
    let [u, v, w, p, q, r] = state.nu;
    let [roll, pitch, yaw] = to_euler(&state.attitude);
    [u, v, w, p, q, r, x, y, z, roll, pitch, yaw]
}

/// Sums of the loss over the samples of a segment.
pub struct Criterion<'a, T> {
    observed: &'a [[f64; CHANNELS]],
    weight: &'a [[f64; CHANNELS]],
    used: [bool; CHANNELS],
    loss: Loss,
    /// The sum per channel.
    pub sums: [T; CHANNELS],
}

impl<'a, T: Real> Criterion<'a, T> {
    /// A criterion at zero over some samples of a record's measurements.
    #[inline(always)]
    pub fn new(
        observed: &'a [[f64; CHANNELS]],
        weight: &'a [[f64; CHANNELS]],
        samples: Range<usize>,
        loss: Loss,
        zero: T,
    ) -> Self {
        let used = std::array::from_fn(|c| weight[samples.clone()].iter().any(|row| row[c] != 0.0));
        Self { observed, weight, used, loss, sums: [zero; CHANNELS] }
    }

    /// Adds the errors at sample `k` of the record.
    #[inline(always)]
    pub fn add(&mut self, k: usize, state: &State<T>) {
        let zero = state.nu[0].zero();
        let mut simulated = [zero; CHANNELS];
        simulated[..6].copy_from_slice(&state.nu);
        simulated[6..ROLL].copy_from_slice(&state.position);
        if self.used[ROLL] || self.used[ROLL + 1] || self.used[ROLL + 2] {
            simulated[ROLL..].copy_from_slice(&to_euler(&state.attitude));
        }
        self.compare(k, &simulated);
    }

    /// Adds the errors of the channels `simulated` at sample `k` of the record.
    #[inline(always)]
    pub fn compare(&mut self, k: usize, simulated: &[T; CHANNELS]) {
        for c in 0..CHANNELS {
            if self.used[c] {
                let error = simulated[c].splat(self.observed[k][c]) - simulated[c];
                let error = if c < ROLL { error } else { error.wrap() };
                self.sums[c] += self.loss.of(error * self.weight[k][c]);
            }
        }
    }
}
