//! The recursions of a filter along a linear model: from sample to sample, and back.
//!
//! Model, source and tests: [`super`].

use super::{CLIP, Judged, Parts, Row, Run, Sizes, Work};
use crate::number::lanes::LANES;
use crate::number::plain;
use fearless_simd::{Simd, SimdFrom, f64x8};

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
            *likelihood -= 0.5 * (error * error * sharpness - plain::ln(sharpness));
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

/// [`super::Model::judge`], and what each sample adds to the likelihood: that alone without the way `back`.
pub(super) struct Judge<'a> {
    pub kept: &'a [usize],
    pub back: bool,
}

impl Work for Judge<'_> {
    type Result = (Judged, Vec<f64>);

    #[inline(always)]
    fn done<S: Simd, const B: usize>(&self, run: Run<'_, S>) -> (Judged, Vec<f64>) {
        let Sizes { samples, width, channels, .. } = run.model.parts.sizes;
        let (mut state, mut spread, mut work) = run.begin::<B>();
        let mut added = Vec::with_capacity(samples);
        let mut updates: Vec<Update<B>> = Vec::with_capacity(if self.back { samples * channels } else { 0 });
        let kept = self.kept;
        let room = samples * kept.len();
        let (mut smoothed, mut known) = (Vec::with_capacity(room), Vec::with_capacity(room));
        let mut spreads: Square<B> = Vec::with_capacity(room);
        for k in 0..samples {
            for &place in kept {
                smoothed.push(state.as_flattened()[place]);
                spreads.push(spread[place]);
            }
            let mut likelihood = 0.0;
            run.update(k, (&mut state, &mut spread, &mut likelihood), |one| {
                if self.back {
                    updates.push(one);
                }
            });
            added.push(likelihood);
            known.extend(kept.iter().map(|&place| state.as_flattened()[place]));
            if k + 1 < samples {
                state = run.moved(k, &state);
                run.widen(k, &mut spread, &mut work);
            }
        }
        let (mut process, mut sensors) = (vec![0.0; width], vec![0.0; channels]);
        let likelihood = added.iter().sum();
        if !self.back {
            return (Judged { likelihood, process, sensors, smoothed, known }, added);
        }
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
        (Judged { likelihood, process, sensors, smoothed, known }, added)
    }
}

/// [`super::Model::predict`].
pub(super) struct Predict {
    pub ahead: usize,
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
