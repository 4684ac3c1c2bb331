//! Prediction errors of a linear model along a recorded motion, their likelihood and its slopes by the noises.
//!
//! ```text
//! x[k+1] = A[k] x[k] + d[k] + T[k] θ + w[k],   w ~ N(0, diag q)
//! y[k]   = H[k] x[k] + v[k],                   v ~ N(0, diag r),   x[0] ~ N(x0, diag p)
//! ```
//!
//! The first rows of A are those of the vehicle's states and full; the others, of what drives it (slow forces, waves,
//! current), are sparse. They may change along the motion: a vehicle that turns meets the waves at another frequency. Samples of the channels of y are taken one after the other, which
//! is the same as together because their noises are independent, and needs no inverse.
//!
//! The slopes of the likelihood by q and r come from the backward recursion of the disturbance smoother, with the
//! adjoint state λ and its spread Λ: `∂L/∂q_i = ½ Σ (λ_i² − Λ_ii)` and `∂L/∂r = ½ Σ (u² − D)`. It needs no inverse
//! either, so that a noise may be as good as nothing.
//!
//! An innovation beyond [`CLIP`] of its standard deviations counts as if it were there: a bad ping does not throw the
//! estimate off.
//!
//! Source: Kalman (1960); Bryson & Frazier (1963), the smoother; Koopman, *Biometrika* 80 (1993) 117, the slopes;
//! Maine & Iliff, NASA RP-1168 (1986), derivatives by θ with the gains held.
//! Tests: `tests/estimation/test_kalman.py` (slopes against differences, states against one large Gaussian).

use crate::error::Error;
use crate::number::lanes::{level, wide};
use fearless_simd::Level;

/// Standard deviations from which an innovation counts as an outlier.
pub const CLIP: f64 = 4.0;

/// The model along a motion of n samples: N states, the first S of the vehicle, Y channels, M unknowns.
#[derive(Clone, Debug)]
pub struct Model {
    /// S, N, Y and M.
    pub sizes: Sizes,
    /// The first S rows of A, (n - 1, S, N).
    pub transition: Vec<f64>,
    /// The columns of the other rows' entries that are not zero, (N - S).
    pub places: Vec<Vec<usize>>,
    /// These entries, row after row, (n - 1, all of them).
    pub driven: Vec<f64>,
    /// H, (n, Y, N).
    pub shown: Vec<f64>,
    /// y, (n, Y).
    pub measured: Vec<f64>,
    /// Whether a sample counts, (n, Y).
    pub valid: Vec<bool>,
    /// d, (n - 1, N).
    pub drift: Vec<f64>,
    /// The first S rows of T, the others are zero, (n - 1, S, M).
    pub slopes: Vec<f64>,
    /// x0, (N,).
    pub start: Vec<f64>,
}

/// Sizes of a [`Model`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Samples.
    pub samples: usize,
    /// States of the vehicle.
    pub states: usize,
    /// All states.
    pub width: usize,
    /// Measured channels.
    pub channels: usize,
    /// Unknowns.
    pub unknowns: usize,
}

/// Variances of a [`Model`].
#[derive(Clone, Debug)]
pub struct Noise {
    /// q, per sample, (N,).
    pub process: Vec<f64>,
    /// r, (Y,), larger than zero.
    pub sensors: Vec<f64>,
    /// p, (N,).
    pub start: Vec<f64>,
}

/// How likely a noise is, and the motion with it.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Logarithm of the likelihood without its constant.
    pub likelihood: f64,
    /// Its slopes by q, (N,).
    pub process: Vec<f64>,
    /// Its slopes by r, (Y,).
    pub sensors: Vec<f64>,
    /// The smoothed states that were asked for, (n, kept).
    pub smoothed: Vec<f64>,
    /// The same after the measurements of each sample, (n, kept).
    pub known: Vec<f64>,
}

/// A measurement that was taken.
struct Update {
    sample: usize,
    channel: usize,
    /// The innovation over its variance, and one over that variance.
    error: f64,
    sharpness: f64,
    /// The gain, (N,).
    gain: Vec<f64>,
}

impl Model {
    /// Checks the sizes.
    ///
    /// # Errors
    /// A part has another size than the rest, or an entry points beyond the states.
    pub fn checked(self) -> Result<Self, Error> {
        let Sizes { samples: n, states: s, width: w, channels: y, unknowns: m } = self.sizes;
        let steps = n.saturating_sub(1);
        let parts = [
            ("transition", self.transition.len(), steps * s * w),
            ("places", self.places.len(), w.saturating_sub(s)),
            ("driven", self.driven.len(), steps * self.entries()),
            ("shown", self.shown.len(), n * y * w),
            ("measured", self.measured.len(), n * y),
            ("valid", self.valid.len(), n * y),
            ("drift", self.drift.len(), steps * w),
            ("slopes", self.slopes.len(), steps * s * m),
            ("start", self.start.len(), w),
        ];
        if n == 0 || s > w {
            return Err(Error::simulation(format!(
                "expected samples and at least {s} states, found {n} and {w}"
            )));
        }
        for (name, found, expected) in parts {
            if found != expected {
                return Err(Error::simulation(format!("{name}: expected {expected} numbers, found {found}")));
            }
        }
        if self.places.iter().flatten().any(|&column| column >= w) {
            return Err(Error::simulation(format!("places: expected columns below {w}")));
        }
        Ok(self)
    }

    /// Likelihood of a noise, its slopes, and the states at the places `kept` that go with it.
    ///
    /// # Errors
    /// The noise has other sizes than the model, or the instruction set that the environment names is not there.
    pub fn judge(&self, noise: &Noise, kept: &[usize]) -> Result<Judged, Error> {
        let level = self.level_for(noise)?;
        if let Some(place) = kept.iter().find(|&&place| place >= self.sizes.width) {
            return Err(Error::simulation(format!(
                "kept: expected places below {}, found {place}",
                self.sizes.width
            )));
        }
        Ok(wide(
            level,
            #[inline(always)]
            || self.judged(noise, kept),
        ))
    }

    /// What is predicted `ahead` samples after each measurement, and its derivatives by the unknowns with the gains
    /// held: (n - ahead, Y, 1 + M).
    ///
    /// # Errors
    /// As [`Model::judge`], or fewer samples than that.
    pub fn predict(&self, noise: &Noise, ahead: usize) -> Result<Vec<f64>, Error> {
        let level = self.level_for(noise)?;
        if ahead >= self.sizes.samples {
            return Err(Error::simulation(format!(
                "expected more than {ahead} samples, found {}",
                self.sizes.samples
            )));
        }
        Ok(wide(
            level,
            #[inline(always)]
            || self.predicted(noise, ahead),
        ))
    }

    fn level_for(&self, noise: &Noise) -> Result<Level, Error> {
        let Sizes { width, channels, .. } = self.sizes;
        let found = [noise.process.len(), noise.sensors.len(), noise.start.len()];
        if found != [width, channels, width] {
            return Err(Error::simulation(format!(
                "noise: expected {width}, {channels}, {width}, found {found:?}"
            )));
        }
        Ok(level()?.1)
    }

    /// Row `i` of the first rows of A at step `k`.
    #[inline(always)]
    fn row(&self, k: usize, i: usize) -> &[f64] {
        let Sizes { states, width, .. } = self.sizes;
        &self.transition[(k * states + i) * width..][..width]
    }

    /// Entries of the other rows of A that are not zero.
    fn entries(&self) -> usize {
        self.places.iter().map(Vec::len).sum()
    }

    /// The other rows of A at step `k`: of each its number, and columns and values of what is not zero.
    #[inline(always)]
    fn drives(&self, k: usize) -> impl Iterator<Item = (usize, impl Iterator<Item = (usize, f64)>)> {
        let entries = self.driven.len() / self.sizes.samples.saturating_sub(1).max(1);
        let mut rest = &self.driven[k * entries..][..entries];
        self.places.iter().enumerate().map(move |(row, columns)| {
            let (here, after) = rest.split_at(columns.len());
            rest = after;
            (row, columns.iter().copied().zip(here.iter().copied()))
        })
    }

    /// Row `c` of H at sample `k`: columns and values that are not zero.
    #[inline(always)]
    fn shows(&self, k: usize, c: usize) -> impl Iterator<Item = (usize, f64)> {
        let Sizes { width, channels, .. } = self.sizes;
        let row = &self.shown[(k * channels + c) * width..][..width];
        row.iter().copied().enumerate().filter(|&(_, value)| value != 0.0)
    }

    /// The channels that count at a sample.
    #[inline(always)]
    fn counted(&self, k: usize) -> impl DoubleEndedIterator<Item = usize> {
        let channels = self.sizes.channels;
        let valid = &self.valid[k * channels..][..channels];
        (0..channels).filter(|&c| valid[c])
    }

    /// A x, for `columns` vectors x side by side.
    #[inline(always)]
    fn moved(&self, k: usize, x: &[f64], columns: usize, into: &mut [f64]) {
        let Sizes { states, width, .. } = self.sizes;
        into.fill(0.0);
        let (own, driven) = into.split_at_mut(states * columns);
        for (i, row) in own.chunks_exact_mut(columns).enumerate() {
            (0..width).for_each(|l| axpy(row, self.row(k, i)[l], &x[l * columns..][..columns]));
        }
        for (row, (_, entries)) in driven.chunks_exact_mut(columns).zip(self.drives(k)) {
            entries.for_each(|(l, a)| axpy(row, a, &x[l * columns..][..columns]));
        }
    }

    /// One measurement: gain (N,), what the channel is expected to show, and one over its variance.
    #[inline(always)]
    fn gain(&self, (k, c): (usize, usize), noise: &Noise, spread: &[f64], gain: &mut [f64]) -> f64 {
        let width = self.sizes.width;
        gain.fill(0.0);
        for (l, h) in self.shows(k, c) {
            axpy(gain, h, &spread[l * width..][..width]);
        }
        let variance: f64 = self.shows(k, c).map(|(l, h)| h * gain[l]).sum::<f64>() + noise.sensors[c];
        1.0 / variance
    }

    /// The spread after a measurement; `cross` is `P hᵀ` and becomes the gain.
    #[inline(always)]
    fn narrow(spread: &mut [f64], cross: &mut [f64], sharpness: f64) {
        let width = cross.len();
        for (row, i) in spread.chunks_exact_mut(width).zip(0..) {
            let factor = -cross[i] * sharpness;
            axpy(row, factor, cross);
        }
        cross.iter_mut().for_each(|x| *x *= sharpness);
    }

    /// A P Aᵀ + Q.
    #[inline(always)]
    fn widen(&self, k: usize, noise: &Noise, spread: &mut [f64], work: &mut [f64]) {
        let Sizes { states, width, .. } = self.sizes;
        self.moved(k, spread, width, work);
        // The columns of the vehicle's states, then those of what drives it: the rest is symmetric.
        for i in 0..width {
            let half = &work[i * width..][..width];
            for j in 0..states.min(i + 1) {
                spread[i * width + j] = dot(half, self.row(k, j));
            }
            for (j, entries) in self.drives(k).take((i + 1).saturating_sub(states)) {
                spread[i * width + states + j] = entries.map(|(l, a)| half[l] * a).sum();
            }
        }
        for i in 0..width {
            spread[i * width + i] += noise.process[i];
            for j in 0..i {
                spread[j * width + i] = spread[i * width + j];
            }
        }
    }

    /// Aᵀ Λ A.
    #[inline(always)]
    fn pull_back(&self, k: usize, spread: &mut [f64], work: &mut [f64]) {
        let Sizes { states, width, .. } = self.sizes;
        work.fill(0.0);
        for i in 0..width {
            let row = &mut work[i * width..][..width];
            for l in 0..states {
                axpy(row, spread[i * width + l], self.row(k, l));
            }
            for (l, entries) in self.drives(k) {
                let factor = spread[i * width + states + l];
                entries.for_each(|(j, a)| row[j] += factor * a);
            }
        }
        spread.fill(0.0);
        for l in 0..states {
            for (row, &a) in spread.chunks_exact_mut(width).zip(self.row(k, l)) {
                if a != 0.0 {
                    axpy(row, a, &work[l * width..][..width]);
                }
            }
        }
        for (l, entries) in self.drives(k) {
            for (j, a) in entries {
                axpy(&mut spread[j * width..][..width], a, &work[(states + l) * width..][..width]);
            }
        }
        // What rounding leaves unequal would grow: the measurements take rows for columns.
        for i in 0..width {
            for j in 0..i {
                spread[j * width + i] = spread[i * width + j];
            }
        }
    }

    /// Aᵀ λ.
    #[inline(always)]
    fn turn_back(&self, k: usize, adjoint: &mut [f64], work: &mut [f64]) {
        let states = self.sizes.states;
        work.fill(0.0);
        for l in 0..states {
            axpy(work, adjoint[l], self.row(k, l));
        }
        for (l, entries) in self.drives(k) {
            entries.for_each(|(j, a)| work[j] += adjoint[states + l] * a);
        }
        adjoint.copy_from_slice(work);
    }

    #[inline(always)]
    fn judged(&self, noise: &Noise, kept: &[usize]) -> Judged {
        let Sizes { samples, width, channels, .. } = self.sizes;
        let square = width * width;
        let (mut state, mut moved) = (self.start.clone(), vec![0.0; width]);
        let (mut spread, mut work) = (diagonal(&noise.start), vec![0.0; square]);
        let mut likelihood = 0.0;
        let mut updates: Vec<Update> = Vec::with_capacity(samples * channels);
        let room = samples * kept.len();
        let (mut smoothed, mut known) = (Vec::with_capacity(room), Vec::with_capacity(room));
        let mut spreads: Vec<f64> = Vec::with_capacity(room * width);
        for k in 0..samples {
            for &place in kept {
                smoothed.push(state[place]);
                spreads.extend_from_slice(&spread[place * width..][..width]);
            }
            for c in self.counted(k) {
                let mut gain = vec![0.0; width];
                let sharpness = self.gain((k, c), noise, &spread, &mut gain);
                let expected: f64 = self.shows(k, c).map(|(l, h)| h * state[l]).sum();
                let error = clipped(self.measured[k * channels + c] - expected, sharpness);
                axpy(&mut state, error * sharpness, &gain);
                Self::narrow(&mut spread, &mut gain, sharpness);
                likelihood -= 0.5 * (error * error * sharpness - sharpness.ln());
                updates.push(Update { sample: k, channel: c, error: error * sharpness, sharpness, gain });
            }
            known.extend(kept.iter().map(|&place| state[place]));
            if k + 1 < samples {
                self.moved(k, &state, 1, &mut moved);
                axpy(&mut moved, 1.0, &self.drift[k * width..][..width]);
                std::mem::swap(&mut state, &mut moved);
                self.widen(k, noise, &mut spread, &mut work);
            }
        }
        let (mut process, mut sensors) = (vec![0.0; width], vec![0.0; channels]);
        let (mut adjoint, mut back, mut row) = (vec![0.0; width], vec![0.0; square], vec![0.0; width]);
        for k in (0..samples).rev() {
            while updates.last().is_some_and(|update| update.sample == k) {
                let Some(update) = updates.pop() else { break };
                let Update { channel, error, sharpness, gain, .. } = update;
                row.fill(0.0);
                for (i, &g) in gain.iter().enumerate() {
                    axpy(&mut row, g, &back[i * width..][..width]);
                }
                let told = sharpness + dot(&gain, &row);
                let jump = error + dot(&gain, &adjoint);
                sensors[channel] += 0.5 * (jump * jump - told);
                for (l, h) in self.shows(k, channel) {
                    adjoint[l] -= h * jump;
                    axpy(&mut back[l * width..][..width], -h, &row);
                    for (i, &x) in row.iter().enumerate() {
                        back[i * width + l] -= h * x;
                    }
                }
                for (l, h) in self.shows(k, channel) {
                    for (j, g) in self.shows(k, channel) {
                        back[l * width + j] += h * g * told;
                    }
                }
            }
            let here = k * kept.len()..(k + 1) * kept.len();
            for (x, row) in
                smoothed[here.clone()].iter_mut().zip(spreads[here.start * width..].chunks_exact(width))
            {
                *x -= dot(row, &adjoint);
            }
            if k > 0 {
                for i in 0..width {
                    process[i] += 0.5 * (adjoint[i] * adjoint[i] - back[i * width + i]);
                }
                self.turn_back(k - 1, &mut adjoint, &mut row);
                self.pull_back(k - 1, &mut back, &mut work);
            }
        }
        Judged { likelihood, process, sensors, smoothed, known }
    }

    #[inline(always)]
    fn predicted(&self, noise: &Noise, ahead: usize) -> Vec<f64> {
        let Sizes { samples, width, channels, unknowns, .. } = self.sizes;
        let columns = 1 + unknowns;
        let mut state = vec![0.0; width * columns];
        for (row, &x) in state.chunks_exact_mut(columns).zip(&self.start) {
            row[0] = x;
        }
        let (mut moved, mut late) = (state.clone(), state.clone());
        let (mut spread, mut work) = (diagonal(&noise.start), vec![0.0; width * width]);
        let (mut gain, mut change) = (vec![0.0; width], vec![0.0; columns]);
        let mut found = Vec::with_capacity((samples - ahead) * channels * columns);
        for k in 0..samples {
            for c in self.counted(k) {
                let sharpness = self.gain((k, c), noise, &spread, &mut gain);
                change.fill(0.0);
                for (l, h) in self.shows(k, c) {
                    axpy(&mut change, -h, &state[l * columns..][..columns]);
                }
                change[0] = clipped(self.measured[k * channels + c] + change[0], sharpness);
                Self::narrow(&mut spread, &mut gain, sharpness);
                for (row, &g) in state.chunks_exact_mut(columns).zip(&gain) {
                    axpy(row, g, &change);
                }
            }
            if k + ahead < samples {
                late.copy_from_slice(&state);
                for step in k..k + ahead {
                    self.step(step, columns, &mut late, &mut moved);
                }
                for c in 0..channels {
                    change.fill(0.0);
                    for (l, h) in self.shows(k + ahead, c) {
                        axpy(&mut change, h, &late[l * columns..][..columns]);
                    }
                    found.extend_from_slice(&change);
                }
            }
            if k + 1 < samples {
                self.step(k, columns, &mut state, &mut moved);
                self.widen(k, noise, &mut spread, &mut work);
            }
        }
        found
    }

    /// State and derivatives one sample on.
    #[inline(always)]
    fn step(&self, k: usize, columns: usize, state: &mut Vec<f64>, moved: &mut Vec<f64>) {
        let Sizes { states, width, unknowns, .. } = self.sizes;
        self.moved(k, state, columns, moved);
        for (i, row) in moved.chunks_exact_mut(columns).enumerate() {
            row[0] += self.drift[k * width + i];
            if i < states {
                axpy(&mut row[1..], 1.0, &self.slopes[(k * states + i) * unknowns..][..unknowns]);
            }
        }
        std::mem::swap(state, moved);
    }
}

/// An innovation that is no outlier; not a number where its variance is none, of a model that diverged.
#[inline(always)]
fn clipped(error: f64, sharpness: f64) -> f64 {
    let bound = CLIP / sharpness.sqrt();
    if bound.is_finite() { error.clamp(-bound, bound) } else { f64::NAN }
}

/// y += a x.
#[inline(always)]
fn axpy(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Sum of products, in four running sums.
#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a, b) = (x.chunks_exact(4), y.chunks_exact(4));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a.zip(b) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    rest + sums.iter().sum::<f64>()
}

/// A diagonal matrix, row by row.
fn diagonal(entries: &[f64]) -> Vec<f64> {
    let width = entries.len();
    let mut matrix = vec![0.0; width * width];
    for (i, &x) in entries.iter().enumerate() {
        matrix[i * width + i] = x;
    }
    matrix
}
