//! Whether a sample is believed: the normalised innovation squared against χ², and what happens when it never is.
//!
//! A sample is refused where `ν²/s` exceeds [`Gate::threshold`]: a wild point must not move the estimate. A sensor that
//! is refused without a break for longer than [`Gate::patience`], and at least [`FEWEST`] times, may be right and the filter wrong, after a jump of the
//! vehicle or a bad start. Then the filter forgets what that sensor shows, as far as the sample asks for, and takes it.
//! A sensor that falls silent in between is not refused meanwhile: of the time between two samples no more counts than
//! [`PAUSE`] times the time between the two before.
//!
//! Consistency: over n samples the mean of `ν²/s` lies within `1 ± 1.96 √(2/n)` in 95 % of runs of a consistent filter.
//!
//! Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), sections 5.4
//! and 3.7.4. Tests: `tests/filter/innovation.rs`.

use super::error_state::ErrorState;
use super::row::Row;
use crate::number::real::Real;

/// Refusals without a break before a sensor is believed again: two wild points of a slow sensor are not enough.
pub const FEWEST: u32 = 4;

/// A time between samples that is longer than so many of the one before is silence.
pub const PAUSE: f64 = 2.0;

/// The recent mean of `ν²/s` forgets by this share with every sample: a window of some twenty.
pub const FORGETS: f64 = 0.05;

/// The largest `ν²/s` that counts in the recent mean: a single wild point does not make it large.
pub const COUNTS: f64 = 25.0;

/// A recent mean of `ν²/s` beyond this is no chance: of white innovations it comes once in 10¹⁰ samples (Chernoff's bound
/// for a sum of χ² with weights 0.05 · 0.95ⁱ). Colour of waves or of a model that is wrong stays below it.
pub const LOST: f64 = 4.0;

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

/// What became of a sample, vehicle by vehicle; nothing where there was none.
#[derive(Clone, Copy)]
pub struct Verdict<T: Real> {
    /// It was taken.
    pub taken: T::Mask,
    /// It was refused.
    pub refused: T::Mask,
    /// It was taken after the filter had forgotten what the sensor shows.
    pub recovered: T::Mask,
}

/// The record of one scalar of one sensor.
#[derive(Clone, Copy, Debug)]
pub struct Watch<T = f64> {
    /// Samples that were taken.
    pub taken: T,
    /// Samples that were refused.
    pub refused: T,
    /// Times that the filter had to forget.
    pub recovered: T,
    /// Sum of the normalised innovations squared of the samples that were taken in the ordinary way.
    pub sum: T,
    /// Recent mean of the normalised innovation squared of all samples, taken or not.
    pub recent: T,
    /// Time of the first refusal since the last sample that was taken, s, later by the silence since; infinite without one.
    since: T,
    /// Time of the last sample, and between it and the one before, s.
    last: T,
    gap: T,
    /// Refusals since then.
    in_a_row: T,
}

impl Default for Watch {
    fn default() -> Self {
        Self::new(0.0)
    }
}

impl Watch {
    /// The mean normalised innovation squared of what was taken; not a number without a sample.
    pub fn consistency(&self) -> f64 {
        self.sum / self.taken
    }

    /// The 95 % band of [`Self::consistency`] where the filter is consistent and samples are independent.
    pub fn band(&self) -> [f64; 2] {
        let half = 1.96 * (2.0 / self.taken.max(1.0)).sqrt();
        [(1.0 - half).max(0.0), 1.0 + half]
    }
}

impl<T: Real> Watch<T> {
    /// Before the first sample, in the kind of `unit`.
    #[inline(always)]
    pub fn new(unit: T) -> Self {
        let (zero, never) = (unit.zero(), unit.splat(f64::INFINITY));
        let (since, last, gap) = (never, -never, never);
        Self {
            taken: zero,
            refused: zero,
            recovered: zero,
            sum: zero,
            recent: never.splat(1.0),
            since,
            last,
            gap,
            in_a_row: zero,
        }
    }

    /// Takes or refuses a scalar at a time, s, where the mask holds; elsewhere the row is to be none.
    #[inline(always)]
    pub fn judge(
        &mut self,
        state: &mut ErrorState<T>,
        gate: &Gate,
        (row, residual, variance): (&Row<T>, T, T),
        (time, here): (f64, T::Mask),
    ) -> Verdict<T> {
        let innovation = state.innovation(row, residual, variance);
        let normalised = innovation.normalised_squared();
        let (zero, one) = (variance.zero(), variance.splat(1.0));
        let (never, none) = (zero.splat(f64::INFINITY), zero.lt(zero));
        let taken = T::both(here, normalised.lt(zero.splat(gate.threshold)));
        state.update(&innovation, taken);
        self.taken += T::select(taken, one, zero);
        self.sum += T::select(taken, normalised, zero);
        let counted = (normalised.min(zero.splat(COUNTS)) - self.recent) * FORGETS;
        self.recent += T::select(here, counted, zero);
        let (gap, usual) = (zero.splat(time) - self.last, self.gap * PAUSE);
        let silent = T::both(here, usual.lt(gap));
        self.since += T::select(silent, gap - usual, zero);
        self.last = T::select(here, zero.splat(time), self.last);
        self.gap = T::select(here, gap, self.gap);
        self.since = T::select(taken, never, self.since);
        self.in_a_row = T::select(taken, zero, self.in_a_row);
        let wild = T::select(taken, zero, T::select(here, one, zero));
        if !T::any(zero.lt(wild)) {
            return Verdict { taken, refused: none, recovered: none };
        }
        self.since = T::select(zero.lt(wild), self.since.min(zero.splat(time)), self.since);
        // Wild for long enough, often enough, and a number.
        let waited = zero.splat(time) - self.since;
        let mut ripe = T::select(waited.lt(zero.splat(gate.patience)), zero, wild);
        ripe = T::select(self.in_a_row.lt(zero.splat(f64::from(FEWEST))), zero, ripe);
        let recovered = T::both(zero.lt(ripe), normalised.lt(never));
        let refused = zero.lt(T::select(recovered, zero, wild));
        self.refused += T::select(refused, one, zero);
        self.in_a_row += T::select(refused, one, zero);
        if T::any(recovered) {
            let missed = T::select(recovered, innovation.value, zero);
            state.forget(row, missed * missed);
            let innovation = state.innovation(row, residual, variance);
            state.update(&innovation, recovered);
            self.recovered += T::select(recovered, one, zero);
            self.since = T::select(recovered, never, self.since);
            self.in_a_row = T::select(recovered, zero, self.in_a_row);
        }
        Verdict { taken, refused, recovered }
    }
}
