//! Whether a sample is believed: the normalised innovation squared against χ², and what happens when it never is.
//!
//! A sample is refused where `ν²/s` exceeds [`Gate::threshold`]: a wild point must not move the estimate. A sensor that
//! is refused without a break for longer than [`Gate::patience`], and at least [`FEWEST`] times, may be right and the filter wrong, after a jump of the
//! vehicle or a bad start. Then the filter forgets what that sensor shows, as far as the sample asks for, and takes it.
//!
//! Consistency: over n samples the mean of `ν²/s` lies within `1 ± 1.96 √(2/n)` in 95 % of runs of a consistent filter.
//!
//! Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), sections 5.4
//! and 3.7.4. Tests: `tests/filter/innovation.rs`.

use super::error_state::{ErrorState, Row};

/// Refusals without a break before a sensor is believed again: two wild points of a slow sensor are not enough.
pub const FEWEST: u32 = 4;

/// When a sample is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Largest normalised innovation squared.
    pub threshold: f64,
    /// Longest time of refusals without a break, s.
    pub patience: f64,
}

impl Default for Gate {
    /// Five deviations, five seconds.
    fn default() -> Self {
        Self { threshold: 25.0, patience: 5.0 }
    }
}

/// What became of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It was taken.
    Taken,
    /// It was refused.
    Refused,
    /// It was taken after the filter had forgotten what the sensor shows.
    Recovered,
}

/// The record of one scalar of one sensor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    /// Samples that were taken.
    pub taken: u64,
    /// Samples that were refused.
    pub refused: u64,
    /// Times that the filter had to forget.
    pub recovered: u64,
    /// Sum of the normalised innovations squared of the samples that were taken in the ordinary way.
    pub sum: f64,
    /// Time of the first refusal since the last sample that was taken, s.
    since: Option<f64>,
    /// Refusals since then.
    in_a_row: u32,
}

impl Watch {
    /// The mean normalised innovation squared of what was taken; not a number without a sample.
    pub fn consistency(&self) -> f64 {
        self.sum / self.taken as f64
    }

    /// The 95 % band of [`Self::consistency`] where the filter is consistent and samples are independent.
    pub fn band(&self) -> [f64; 2] {
        let half = 1.96 * (2.0 / self.taken.max(1) as f64).sqrt();
        [(1.0 - half).max(0.0), 1.0 + half]
    }

    /// Takes or refuses a scalar at a time, s.
    #[inline(always)]
    pub fn judge<const N: usize>(
        &mut self,
        state: &mut ErrorState<N>,
        gate: &Gate,
        (row, residual, variance): (&Row, f64, f64),
        time: f64,
    ) -> Verdict {
        let innovation = state.innovation(row, residual, variance);
        let normalised = innovation.normalised_squared();
        if normalised <= gate.threshold {
            state.update(row, &innovation, variance);
            self.taken += 1;
            self.sum += normalised;
            (self.since, self.in_a_row) = (None, 0);
            return Verdict::Taken;
        }
        let waited = time - *self.since.get_or_insert(time);
        if !normalised.is_finite() || waited < gate.patience || self.in_a_row < FEWEST {
            self.refused += 1;
            self.in_a_row += 1;
            return Verdict::Refused;
        }
        state.forget(row, innovation.value * innovation.value);
        let innovation = state.innovation(row, residual, variance);
        state.update(row, &innovation, variance);
        self.recovered += 1;
        (self.since, self.in_a_row) = (None, 0);
        Verdict::Recovered
    }
}
