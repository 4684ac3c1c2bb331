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
//! Tests: `tests/estimation/test_kalman.py` (slopes against differences, states against one large Gaussian).

use crate::error::Error;
use crate::number::lanes::{LANES, level};
use fearless_simd::{Fallback, Simd, SimdFrom, f64x8};

/// Standard deviations from which an innovation counts as an outlier.
pub const CLIP: f64 = 4.0;

/// The most blocks of a row.
const MOST: usize = 8;

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

/// A measurement that was taken.
struct Update<const B: usize> {
    sample: usize,
    channel: usize,
    /// The innovation over its variance, and one over that variance.
    error: f64,
    sharpness: f64,
    gain: Row<B>,
}

/// Rows of a symmetric matrix.
type Square<const B: usize> = Vec<Row<B>>;

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
        let blocks = w.div_ceil(LANES);
        if blocks > MOST {
            return Err(Error::simulation(format!("expected at most {} states, found {w}", MOST * LANES)));
        }
        // Six and seven blocks are rare: they take eight.
        let blocks = if blocks > 5 { MOST } else { blocks };
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
        self.run(noise, &Judge { kept })
    }

    /// Logarithm of the likelihood of a noise without its constant, alone: what each sample adds to it, (n,).
    ///
    /// # Errors
    /// As [`Model::judge`].
    pub fn likelihood(&self, noise: &Noise) -> Result<Vec<f64>, Error> {
        self.run(noise, &Likelihood)
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
            1 => work.done::<S, 1>(run),
            2 => work.done::<S, 2>(run),
            3 => work.done::<S, 3>(run),
            4 => work.done::<S, 4>(run),
            5 => work.done::<S, 5>(run),
            _ => work.done::<S, MOST>(run),
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

impl<S: Simd> Run<'_, S> {
    /// Sum of rows, each times a factor, from a row on.
    #[inline(always)]
    fn sum<'r, const B: usize>(
        self,
        from: &Row<B>,
        terms: impl Iterator<Item = (f64, &'r Row<B>)>,
    ) -> Row<B> {
        let mut sum = [self.simd.splat_f64x8(0.0); B];
        for b in 0..B {
            sum[b] = f64x8::simd_from(self.simd, from[b]);
        }
        for (factor, row) in terms {
            let factor = self.simd.splat_f64x8(factor);
            for b in 0..B {
                sum[b] += factor * f64x8::simd_from(self.simd, row[b]);
            }
        }
        let mut to = [[0.0; LANES]; B];
        for b in 0..B {
            to[b] = sum[b].into();
        }
        to
    }

    /// Sum of products.
    #[inline(always)]
    fn dot<const B: usize>(self, x: &Row<B>, y: &Row<B>) -> f64 {
        let mut sum = self.simd.splat_f64x8(0.0);
        for b in 0..B {
            sum += f64x8::simd_from(self.simd, x[b]) * f64x8::simd_from(self.simd, y[b]);
        }
        let [a, b, c, d, e, f, g, h]: [f64; LANES] = sum.into();
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }

    /// The state a sample on.
    #[inline(always)]
    fn moved<const B: usize>(self, k: usize, x: &Row<B>) -> Row<B> {
        let Sizes { states, width, .. } = self.model.parts.sizes;
        let mut into = [[0.0; LANES]; B];
        let (to, from) = (into.as_flattened_mut(), x.as_flattened());
        for (to, row) in to.iter_mut().zip(self.model.rows(k)) {
            *to = self.dot(row, x);
        }
        for (row, column, value) in self.model.drives(k) {
            to[states + row] += value * from[column];
        }
        for (to, drift) in to.iter_mut().zip(&self.model.parts.drift[k * width..][..width]) {
            *to += drift;
        }
        into
    }

    /// One measurement: `P hᵀ`, and one over the variance of what is expected.
    #[inline(always)]
    fn cross<const B: usize>(self, (k, c): (usize, usize), spread: &Square<B>) -> (Row<B>, f64) {
        let (places, values) = self.model.shows(k, c);
        let shown = places.iter().zip(values);
        let cross = self.sum(&[[0.0; LANES]; B], shown.clone().map(|(&l, &h)| (h, &spread[l])));
        let mut variance = self.noise.sensors[c];
        for (&l, &h) in shown {
            variance += h * cross.as_flattened()[l];
        }
        (cross, 1.0 / variance)
    }

    /// The spread after a measurement, and the gain.
    #[inline(always)]
    fn narrow<const B: usize>(self, spread: &mut Square<B>, cross: &Row<B>, sharpness: f64) -> Row<B> {
        let gain = cross.map(|block| block.map(|x| x * sharpness));
        for (row, &factor) in spread.iter_mut().zip(gain.as_flattened()) {
            *row = self.sum(row, [(-factor, cross)].into_iter());
        }
        gain
    }

    /// A P Aᵀ + Q.
    #[inline(always)]
    fn widen<const B: usize>(self, k: usize, spread: &mut Square<B>, work: &mut Square<B>) {
        let Sizes { states, width, .. } = self.model.parts.sizes;
        let (own, none) = (self.model.rows::<B>(k), [[0.0; LANES]; B]);
        for (to, row) in work.iter_mut().zip(own) {
            *to = self.sum(&none, row.as_flattened().iter().copied().zip(spread.iter()));
        }
        work[states..].fill(none);
        for (row, column, value) in self.model.drives(k) {
            let to = &mut work[states + row];
            *to = self.sum(to, [(value, &spread[column])].into_iter());
        }
        // Of what is symmetric one half: what drives the vehicle by itself, then by the vehicle's rows.
        for ((half, to), [reach, _]) in work.iter().zip(spread.iter_mut()).zip(&self.model.reach) {
            *to = none;
            let (half, to) = (half.as_flattened(), to.as_flattened_mut());
            for (row, column, value) in self.model.drives(k).take(*reach) {
                to[states + row] += half[column] * value;
            }
        }
        for (i, half) in work.iter().enumerate().take(states) {
            for (j, row) in own.iter().enumerate().take(i + 1) {
                spread[i].as_flattened_mut()[j] = self.dot(half, row);
            }
            for j in states..width {
                spread[j].as_flattened_mut()[i] = spread[i].as_flattened()[j];
            }
        }
        for (i, q) in self.noise.process.iter().enumerate() {
            spread[i].as_flattened_mut()[i] += q;
        }
        mirror(spread);
    }

    /// Aᵀ Λ A.
    #[inline(always)]
    fn pull_back<const B: usize>(self, k: usize, spread: &mut Square<B>, work: &mut Square<B>) {
        let states = self.model.parts.sizes.states;
        let (own, none) = (self.model.rows::<B>(k), [[0.0; LANES]; B]);
        for (j, to) in work.iter_mut().enumerate() {
            *to = self.sum(&none, own.iter().map(|row| row.as_flattened()[j]).zip(spread.iter()));
        }
        for (row, column, value) in self.model.drives(k) {
            let to = &mut work[column];
            *to = self.sum(to, [(value, &spread[states + row])].into_iter());
        }
        for ((half, to), [_, reach]) in work.iter().zip(spread.iter_mut()).zip(&self.model.reach) {
            let half = half.as_flattened();
            *to = self.sum(&none, half.iter().copied().zip(own));
            let to = to.as_flattened_mut();
            for (row, column, value) in self.model.drives(k).take(*reach) {
                to[column] += half[states + row] * value;
            }
        }
        // What rounding leaves unequal would grow: the measurements take rows for columns.
        mirror(spread);
    }

    /// Aᵀ λ.
    #[inline(always)]
    fn turn_back<const B: usize>(self, k: usize, adjoint: &Row<B>) -> Row<B> {
        let states = self.model.parts.sizes.states;
        let from = adjoint.as_flattened();
        let mut back = self.sum(&[[0.0; LANES]; B], from.iter().copied().zip(self.model.rows(k)));
        for (row, column, value) in self.model.drives(k) {
            back.as_flattened_mut()[column] += from[states + row] * value;
        }
        back
    }

    /// The measurements of sample `k`: state, spread and likelihood with them; each is handed to `keep`.
    #[inline(always)]
    fn update<const B: usize>(
        self,
        k: usize,
        (state, spread, likelihood): (&mut Row<B>, &mut Square<B>, &mut f64),
        mut keep: impl FnMut(Update<B>),
    ) {
        let channels = self.model.parts.sizes.channels;
        for c in self.model.counted(k) {
            let (cross, sharpness) = self.cross((k, c), spread);
            let (places, values) = self.model.shows(k, c);
            let mut error = self.model.parts.measured[k * channels + c];
            for (&l, &h) in places.iter().zip(values) {
                error -= h * state.as_flattened()[l];
            }
            let error = clipped(error, sharpness);
            *state = self.sum(state, [(error * sharpness, &cross)].into_iter());
            let gain = self.narrow(spread, &cross, sharpness);
            *likelihood -= 0.5 * (error * error * sharpness - sharpness.ln());
            keep(Update { sample: k, channel: c, error: error * sharpness, sharpness, gain });
        }
    }

    /// State and spread before the first sample, and room for another spread.
    #[inline(always)]
    fn begin<const B: usize>(self) -> (Row<B>, Square<B>, Square<B>) {
        let mut state = [[0.0; LANES]; B];
        let start = &self.model.parts.start;
        state.as_flattened_mut()[..start.len()].copy_from_slice(start);
        let mut spread = vec![[[0.0; LANES]; B]; start.len()];
        for (i, (row, &x)) in spread.iter_mut().zip(&self.noise.start).enumerate() {
            row.as_flattened_mut()[i] = x;
        }
        let work = spread.clone();
        (state, spread, work)
    }

    /// State and derivatives, side by side in `columns`, one sample on.
    #[inline(always)]
    fn step<const B: usize>(self, k: usize, columns: usize, state: &mut Vec<f64>, moved: &mut Vec<f64>) {
        let Parts { sizes: Sizes { states, width, unknowns, .. }, drift, slopes, .. } = &self.model.parts;
        moved.fill(0.0);
        for (to, row) in moved.chunks_exact_mut(columns).zip(self.model.rows::<B>(k)) {
            for (from, &a) in state.chunks_exact(columns).zip(row.as_flattened()) {
                add(to, a, from);
            }
        }
        for (row, column, value) in self.model.drives(k) {
            let to = &mut moved[(states + row) * columns..][..columns];
            add(to, value, &state[column * columns..][..columns]);
        }
        for (i, row) in moved.chunks_exact_mut(columns).enumerate() {
            row[0] += drift[k * width + i];
            if i < *states {
                add(&mut row[1..], 1.0, &slopes[(k * states + i) * unknowns..][..*unknowns]);
            }
        }
        std::mem::swap(state, moved);
    }
}

/// The likelihood alone.
struct Likelihood;

impl Work for Likelihood {
    type Result = Vec<f64>;

    #[inline(always)]
    fn done<S: Simd, const B: usize>(&self, run: Run<'_, S>) -> Vec<f64> {
        let samples = run.model.parts.sizes.samples;
        let (mut state, mut spread, mut work) = run.begin::<B>();
        let mut added = Vec::with_capacity(samples);
        for k in 0..samples {
            let mut likelihood = 0.0;
            run.update(k, (&mut state, &mut spread, &mut likelihood), |_| ());
            added.push(likelihood);
            if k + 1 < samples {
                state = run.moved(k, &state);
                run.widen(k, &mut spread, &mut work);
            }
        }
        added
    }
}

/// [`Model::judge`].
struct Judge<'a> {
    kept: &'a [usize],
}

impl Work for Judge<'_> {
    type Result = Judged;

    #[inline(always)]
    fn done<S: Simd, const B: usize>(&self, run: Run<'_, S>) -> Judged {
        let Sizes { samples, width, channels, .. } = run.model.parts.sizes;
        let (mut state, mut spread, mut work) = run.begin::<B>();
        let mut likelihood = 0.0;
        let mut updates: Vec<Update<B>> = Vec::with_capacity(samples * channels);
        let kept = self.kept;
        let room = samples * kept.len();
        let (mut smoothed, mut known) = (Vec::with_capacity(room), Vec::with_capacity(room));
        let mut spreads: Square<B> = Vec::with_capacity(room);
        for k in 0..samples {
            for &place in kept {
                smoothed.push(state.as_flattened()[place]);
                spreads.push(spread[place]);
            }
            run.update(k, (&mut state, &mut spread, &mut likelihood), |one| updates.push(one));
            known.extend(kept.iter().map(|&place| state.as_flattened()[place]));
            if k + 1 < samples {
                state = run.moved(k, &state);
                run.widen(k, &mut spread, &mut work);
            }
        }
        let (mut process, mut sensors) = (vec![0.0; width], vec![0.0; channels]);
        let none = [[0.0; LANES]; B];
        let (mut adjoint, mut back) = (none, vec![none; width]);
        for k in (0..samples).rev() {
            while updates.last().is_some_and(|update| update.sample == k) {
                let Some(update) = updates.pop() else { break };
                let Update { channel, error, sharpness, gain, .. } = update;
                let row = run.sum(&none, gain.as_flattened().iter().copied().zip(&back));
                let told = sharpness + run.dot(&gain, &row);
                let jump = error + run.dot(&gain, &adjoint);
                sensors[channel] += 0.5 * (jump * jump - told);
                let (places, values) = run.model.shows(k, channel);
                for (&l, &h) in places.iter().zip(values) {
                    adjoint.as_flattened_mut()[l] -= h * jump;
                    back[l] = run.sum(&back[l], [(-h, &row)].into_iter());
                    for (to, x) in back.iter_mut().zip(row.as_flattened()) {
                        to.as_flattened_mut()[l] -= h * x;
                    }
                }
                for (&l, &h) in places.iter().zip(values) {
                    for (&j, &g) in places.iter().zip(values) {
                        back[l].as_flattened_mut()[j] += h * g * told;
                    }
                }
            }
            let here = k * kept.len()..(k + 1) * kept.len();
            for (x, row) in smoothed[here.clone()].iter_mut().zip(&spreads[here]) {
                *x -= run.dot(row, &adjoint);
            }
            if k > 0 {
                let own = adjoint.as_flattened();
                for (i, slope) in process.iter_mut().enumerate() {
                    *slope += 0.5 * (own[i] * own[i] - back[i].as_flattened()[i]);
                }
                adjoint = run.turn_back(k - 1, &adjoint);
                run.pull_back(k - 1, &mut back, &mut work);
            }
        }
        Judged { likelihood, process, sensors, smoothed, known }
    }
}

/// [`Model::predict`].
struct Predict {
    ahead: usize,
}

impl Work for Predict {
    type Result = Vec<f64>;

    #[inline(always)]
    fn done<S: Simd, const B: usize>(&self, run: Run<'_, S>) -> Vec<f64> {
        let (model, ahead) = (run.model, self.ahead);
        let Sizes { samples, width, channels, unknowns, .. } = model.parts.sizes;
        let columns = 1 + unknowns;
        let mut state = vec![0.0; width * columns];
        for (row, &x) in state.chunks_exact_mut(columns).zip(&model.parts.start) {
            row[0] = x;
        }
        let (mut moved, mut late) = (state.clone(), state.clone());
        let (_, mut spread, mut work) = run.begin::<B>();
        let mut change = vec![0.0; columns];
        let mut found = Vec::with_capacity((samples - ahead) * channels * columns);
        for k in 0..samples {
            for c in model.counted(k) {
                let (cross, sharpness) = run.cross((k, c), &spread);
                let (places, values) = model.shows(k, c);
                change.fill(0.0);
                for (&l, &h) in places.iter().zip(values) {
                    add(&mut change, -h, &state[l * columns..][..columns]);
                }
                change[0] = clipped(model.parts.measured[k * channels + c] + change[0], sharpness);
                let gain = run.narrow(&mut spread, &cross, sharpness);
                for (row, &g) in state.chunks_exact_mut(columns).zip(gain.as_flattened()) {
                    add(row, g, &change);
                }
            }
            if k + ahead < samples {
                late.copy_from_slice(&state);
                for step in k..k + ahead {
                    run.step::<B>(step, columns, &mut late, &mut moved);
                }
                for c in 0..channels {
                    let (places, values) = model.shows(k + ahead, c);
                    change.fill(0.0);
                    for (&l, &h) in places.iter().zip(values) {
                        add(&mut change, h, &late[l * columns..][..columns]);
                    }
                    found.extend_from_slice(&change);
                }
            }
            if k + 1 < samples {
                run.step::<B>(k, columns, &mut state, &mut moved);
                run.widen(k, &mut spread, &mut work);
            }
        }
        found
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
fn add(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Copies the lower half of a matrix to the upper one.
#[inline(always)]
fn mirror<const B: usize>(matrix: &mut Square<B>) {
    for i in 0..matrix.len() {
        let row = matrix[i];
        for (above, &x) in matrix.iter_mut().zip(row.as_flattened()).take(i) {
            above.as_flattened_mut()[i] = x;
        }
    }
}
