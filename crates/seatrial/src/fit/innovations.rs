//! Prediction errors of a linear model along a recorded motion, their likelihood and its slopes by the noises.
//!
//! ```text
//! x[k+1] = A[k] x[k] + d[k] + T[k] θ + w[k],   w ~ N(0, diag q)
//! y[k]   = H[k] x[k] + v[k],                   v ~ N(0, diag r),   x[0] ~ N(x0, diag p)
//! ```
//!
//! The first rows of A are those of the vehicle's states and full; the others, of what drives it (slow forces, waves,
//! current), are sparse. They may change along the motion: a vehicle that turns meets the waves at another frequency.
//! Samples of the channels of y are taken one after the other, which is the same as together because their noises are
//! independent, and needs no inverse.
//!
//! Rows are kept in blocks of eight with zeros behind the N states, and a sum of rows is taken block by block: it stays
//! in registers. Products are not fused, so that all instruction sets give the same bits.
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
//! The recursions themselves: [`recursion`].
//! Tests: `tests/estimation/test_kalman.py` (slopes against differences, states against one large Gaussian).

mod recursion;

use crate::error::Error;
use crate::number::lanes::{LANES, level};
use fearless_simd::{Fallback, Simd};
use recursion::{Judge, Predict};

/// Standard deviations from which an innovation counts as an outlier.
pub const CLIP: f64 = 4.0;

/// Blocks of a row: one length would be slower for few states, more would be compiled for little.
const BLOCKS: [usize; 2] = [4, 5];

/// A row of a matrix, in blocks.
type Row<const B: usize> = [[f64; LANES]; B];

/// The model along a motion of n samples as it is given: N states, the first S of the vehicle, Y channels, M unknowns.
#[derive(Clone, Debug)]
pub struct Parts {
    /// S, N, Y and M.
    pub sizes: Sizes,
    /// The first S rows of A, (n - 1, S, N).
    pub transition: Vec<f64>,
    /// Row and column of the other rows' entries that are not zero, row after row; row 0 is that of state S.
    pub places: Vec<(usize, usize)>,
    /// These entries, (n - 1, all of them).
    pub driven: Vec<f64>,
    /// Channel and state of what is not zero in H at some sample, channel after channel.
    pub seen: Vec<(usize, usize)>,
    /// These entries, (n, all of them).
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

/// [`Parts`] that fit together, packed.
#[derive(Clone, Debug)]
pub struct Model {
    parts: Parts,
    /// The first S rows of A, (n - 1, S), each in that many blocks: `transition` of the parts.
    blocks: usize,
    /// The states that each channel shows, and before how many entries of `shown`.
    seen: Vec<(usize, Vec<usize>)>,
    /// Per state, how many of `places` have a row no later than it, and after how many no column is.
    reach: Vec<[usize; 2]>,
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

/// The instruction set, and what a run needs to know.
#[derive(Clone, Copy)]
struct Run<'a, S> {
    simd: S,
    model: &'a Model,
    noise: &'a Noise,
}

/// What is asked of a run.
trait Work {
    type Result;
    fn done<S: Simd, const B: usize>(&self, run: Run<'_, S>) -> Self::Result;
}

impl Model {
    /// Checks the sizes and packs.
    ///
    /// # Errors
    /// A part has another size than the rest, an entry points beyond the states, or these are too many.
    pub fn new(mut parts: Parts) -> Result<Self, Error> {
        let Sizes { samples: n, states: s, width: w, channels: y, unknowns: m } = parts.sizes;
        let steps = n.saturating_sub(1);
        let sizes = [
            ("transition", parts.transition.len(), steps * s * w),
            ("driven", parts.driven.len(), steps * parts.places.len()),
            ("shown", parts.shown.len(), n * parts.seen.len()),
            ("measured", parts.measured.len(), n * y),
            ("valid", parts.valid.len(), n * y),
            ("drift", parts.drift.len(), steps * w),
            ("slopes", parts.slopes.len(), steps * s * m),
            ("start", parts.start.len(), w),
        ];
        if n == 0 || s > w || w == 0 {
            return Err(Error::simulation(format!(
                "expected samples and at least {} states, found {n} and {w}",
                s.max(1)
            )));
        }
        for (name, found, expected) in sizes {
            if found != expected {
                return Err(Error::simulation(format!("{name}: expected {expected} numbers, found {found}")));
            }
        }
        if !parts.places.is_sorted_by_key(|&(row, _)| row)
            || parts.places.iter().any(|&(row, column)| row >= w - s || column >= w)
        {
            return Err(Error::simulation(format!(
                "places: expected rows that ascend, below {}, and columns below {w}",
                w - s
            )));
        }
        if !parts.seen.is_sorted_by_key(|&(channel, _)| channel)
            || parts.seen.iter().any(|&(channel, state)| channel >= y || state >= w)
        {
            return Err(Error::simulation(format!(
                "seen: expected channels that ascend, below {y}, and states below {w}"
            )));
        }
        let Some(blocks) = BLOCKS.into_iter().find(|blocks| blocks * LANES >= w) else {
            let most = BLOCKS[BLOCKS.len() - 1] * LANES;
            return Err(Error::simulation(format!("expected at most {most} states, found {w}")));
        };
        let stride = blocks * LANES;
        let mut transition = vec![0.0; steps * s * stride];
        for (to, from) in transition.chunks_exact_mut(stride).zip(parts.transition.chunks_exact(w)) {
            to[..w].copy_from_slice(from);
        }
        parts.transition = transition;
        let of = |c: usize| {
            let first = parts.seen.partition_point(|&(channel, _)| channel < c);
            (first, parts.seen[first..].iter().take_while(|one| one.0 == c).map(|one| one.1).collect())
        };
        let seen = (0..y).map(of).collect();
        let count = |i: usize| {
            let rows = parts.places.partition_point(|&(row, _)| s + row <= i);
            let columns = parts.places.iter().rposition(|&(_, column)| column <= i);
            [if i < s { parts.places.len() } else { rows }, columns.map_or(0, |last| last + 1)]
        };
        let reach = (0..w).map(count).collect();
        Ok(Self { parts, blocks, seen, reach })
    }

    /// Its sizes.
    pub fn sizes(&self) -> Sizes {
        self.parts.sizes
    }

    /// Likelihood of a noise, its slopes, and the states at the places `kept` that go with it.
    ///
    /// # Errors
    /// The noise has other sizes than the model, or the instruction set that the environment names is not there.
    pub fn judge(&self, noise: &Noise, kept: &[usize]) -> Result<Judged, Error> {
        let width = self.parts.sizes.width;
        if let Some(place) = kept.iter().find(|&&place| place >= width) {
            return Err(Error::simulation(format!("kept: expected places below {width}, found {place}")));
        }
        let (found, _) = self.run(noise, &Judge { kept, back: true })?;
        Ok(found)
    }

    /// Logarithm of the likelihood of a noise without its constant, alone: what each sample adds to it, (n,).
    ///
    /// # Errors
    /// As [`Model::judge`].
    pub fn likelihood(&self, noise: &Noise) -> Result<Vec<f64>, Error> {
        let (_, added) = self.run(noise, &Judge { kept: &[], back: false })?;
        Ok(added)
    }

    /// What is predicted `ahead` samples after each measurement, and its derivatives by the unknowns with the gains
    /// held: (n - ahead, Y, 1 + M).
    ///
    /// # Errors
    /// As [`Model::judge`], or fewer samples than that.
    pub fn predict(&self, noise: &Noise, ahead: usize) -> Result<Vec<f64>, Error> {
        let samples = self.parts.sizes.samples;
        if ahead >= samples {
            return Err(Error::simulation(format!("expected more than {ahead} samples, found {samples}")));
        }
        self.run(noise, &Predict { ahead })
    }

    /// Compiles the work once per instruction set and length of a row.
    fn run<W: Work>(&self, noise: &Noise, work: &W) -> Result<W::Result, Error> {
        let Sizes { width, channels, .. } = self.parts.sizes;
        let found = [noise.process.len(), noise.sensors.len(), noise.start.len()];
        if found != [width, channels, width] {
            return Err(Error::simulation(format!(
                "noise: expected {width}, {channels}, {width}, found {found:?}"
            )));
        }
        let (_, level) = level()?;
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            if let Some(simd) = level.as_avx512() {
                return Ok(simd.vectorize(
                    #[inline(always)]
                    || self.run_on(simd, noise, work),
                ));
            }
            if let Some(simd) = level.as_avx2() {
                return Ok(simd.vectorize(
                    #[inline(always)]
                    || self.run_on(simd, noise, work),
                ));
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(simd) = level.as_neon() {
            return Ok(simd.vectorize(
                #[inline(always)]
                || self.run_on(simd, noise, work),
            ));
        }
        let _ = level;
        Ok(self.run_on(Fallback::new(), noise, work))
    }

    #[inline(always)]
    fn run_on<S: Simd, W: Work>(&self, simd: S, noise: &Noise, work: &W) -> W::Result {
        let run = Run { simd, model: self, noise };
        match self.blocks {
            4 => work.done::<S, 4>(run),
            _ => work.done::<S, 5>(run),
        }
    }

    /// The first rows of A at step `k`.
    #[inline(always)]
    fn rows<const B: usize>(&self, k: usize) -> &[Row<B>] {
        let states = self.parts.sizes.states;
        &self.parts.transition.as_chunks::<LANES>().0.as_chunks::<B>().0[k * states..][..states]
    }

    /// What is not zero in the other rows of A at step `k`: row, column and value.
    #[inline(always)]
    fn drives(&self, k: usize) -> impl Iterator<Item = (usize, usize, f64)> {
        let Parts { places, driven, .. } = &self.parts;
        let values = &driven[k * places.len()..][..places.len()];
        places.iter().zip(values).map(|(&(row, column), &value)| (row, column, value))
    }

    /// Row `c` of H at sample `k`: the states that it shows, and what of them.
    #[inline(always)]
    fn shows(&self, k: usize, c: usize) -> (&[usize], &[f64]) {
        let (first, states) = &self.seen[c];
        (states, &self.parts.shown[k * self.parts.seen.len() + first..][..states.len()])
    }

    /// The channels that count at a sample.
    #[inline(always)]
    fn counted(&self, k: usize) -> impl DoubleEndedIterator<Item = usize> {
        let channels = self.parts.sizes.channels;
        let valid = &self.parts.valid[k * channels..][..channels];
        (0..channels).filter(|&c| valid[c])
    }
}
