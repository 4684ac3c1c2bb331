//! How often an error exceeds each of many thresholds: its distribution without a log.
//!
//! Thresholds are ten to the decade, 26 % apart; a quantile read between two of them is good to a few per cent.
//!
//! Tests: `tests/flight/test_flight.py` (quantiles of the log).

use crate::number::plain;
use crate::number::real::Real;

/// The number of thresholds.
pub const EDGES: usize = 41;

/// The smallest threshold, m.
const SMALLEST_M: f64 = 0.01;

/// The thresholds, m: 1 cm to 100 m.
pub fn edges() -> [f64; EDGES] {
    std::array::from_fn(|i| SMALLEST_M * plain::powf(10.0, 0.1 * i as f64))
}

/// How many samples were above each threshold.
#[derive(Clone, Copy, Debug)]
pub struct Exceedance<T> {
    /// Per threshold.
    pub counts: [T; EDGES],
}

impl<T: Real> Exceedance<T> {
    /// No sample yet.
    #[inline(always)]
    pub fn new(unit: T) -> Self {
        Self { counts: [unit; EDGES] }
    }

    /// Takes a sample where the mask holds.
    #[inline(always)]
    pub fn add(&mut self, error: T, counts: T::Mask, edges: &[f64; EDGES]) {
        let (zero, one) = (error.zero(), error.splat(1.0));
        let size = T::select(counts, error.abs(), zero);
        for (count, edge) in self.counts.iter_mut().zip(edges) {
            *count += T::select(zero.splat(*edge).lt(size), one, zero);
        }
    }

    /// The same in another number type: one lane of eight.
    pub fn read(&self, lane: impl Fn(&T) -> f64) -> Exceedance<f64> {
        Exceedance { counts: std::array::from_fn(|i| lane(&self.counts[i])) }
    }
}
