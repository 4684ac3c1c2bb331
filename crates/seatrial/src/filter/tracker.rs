//! The filter at work: predicted step by step, corrected by samples, in fixed memory.
//!
//! The noise of the process: the unmodelled force is a Gauss–Markov process of given deviation and time constant; white
//! noise on the accelerations stands for what is faster, and a random walk of the force for the push of waves; the gyro's bias is a
//! random walk. The current is a Gauss–Markov process. Gusts accelerate the water and leave the hull behind: written in the velocity through
//! the water, `−m a` at the centre of gravity. Where the filter is told of them that is part of the unmodelled force, and the
//! current follows that part. Constant offsets of attitude and Doppler log carry the position off, at a rate that looks constant for
//! as long as nothing turns: white noise of the position over a second stands for it.
//!
//! Source: Farrell (2008), sections 4.6 and 7.2; Fossen (2021), section 13.4 (bias of force and current).
//! Tests: `tests/filter/tracker.rs`, `tests/fixed_memory.rs`.

use super::error_state::ErrorState;
use super::estimate::{
    ATTITUDE, CURRENT, Components, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY,
};
use super::innovation::{Gate, Verdict, Watch};
use super::observation::{Expected, Observation};
use super::past::Past;
use super::process::Process;
use super::row::Row;
use super::transition::{Return, Transition};
use crate::model::vehicle::Instant;
use crate::number::algebra::{Vec6, each, splat};
use crate::number::plain;
use crate::number::real::Real;

/// What the model does not know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of the unmodelled force, body frame, N and N m.
    pub force: Vec6<f64>,
    /// Its time constants, s.
    pub force_time: Vec6<f64>,
    /// Acceleration of the water per newton of it along the body's axes, 1/kg; none without gusts.
    pub water: [f64; 3],
    /// Standard deviation by which the force walks in a second, N and N m.
    pub force_walk: Vec6<f64>,
    /// Standard deviation of the velocity that white noise of acceleration makes in a second, m/s and rad/s.
    pub acceleration: Vec6<f64>,
    /// Standard deviation of the current, each of north, east and down, m/s.
    pub current: [f64; 3],
    /// Its time constants, s.
    pub current_time: [f64; 3],
    /// Standard deviation by which the gyro's bias moves in a second, rad/s.
    pub gyro_walk: f64,
    /// Standard deviation of the constant offset of the attitude, rad, and of the velocity over ground, m/s.
    pub offsets: [f64; 2],
}

/// One scalar that was measured.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a, T = f64> {
    /// What is observed.
    pub observation: &'a Observation<T>,
    /// The measured value.
    pub measured: T,
    /// The variance of its error.
    pub variance: T,
    /// How long ago it was true, s.
    pub age: f64,
}

/// Estimate and covariance, step by step, of one vehicle or of several abreast.
pub struct Tracker<T = f64> {
    process: Process<T>,
    noise: Noise,
    /// The random walk of the force, which changes under way.
    walk: Vec6<T>,
    gate: Gate,
    estimate: Estimate<T>,
    state: Box<ErrorState<T>>,
    step: Box<Transition<T>>,
    /// The step's way back, where samples may come late.
    back: Box<Return<T>>,
    past: Past<T>,
    time: f64,
}

impl Tracker {
    /// A tracker that keeps `steps` steps for samples that come late.
    pub fn new(process: Process, noise: Noise, gate: Gate, steps: usize) -> Self {
        Self::new_in((process, noise, gate), steps, 0.0)
    }

    /// Begins at an estimate whose components have these deviations.
    pub fn begin(&mut self, estimate: &Estimate, deviations: &Components<f64>) {
        self.begin_where(true, estimate, deviations);
    }

    /// Takes or refuses a sample; nothing where its sensor shows nothing at the estimate.
    pub fn observe(&mut self, sample: &Sample<'_>, watch: &mut Watch) -> Option<Verdict<f64>> {
        let verdict = self.observe_where(true, sample, watch);
        (verdict.taken || verdict.refused || verdict.recovered).then_some(verdict)
    }
}

impl<T: Real> Tracker<T> {
    /// [`Tracker::new`] in the kind of `unit`.
    pub fn new_in((process, noise, gate): (Process<T>, Noise, Gate), steps: usize, unit: T) -> Self {
        Self {
            process,
            walk: splat(unit, &noise.force_walk),
            noise,
            gate,
            estimate: Estimate::at_rest_in(unit),
            state: Box::new(ErrorState::new(&[unit.zero(); STATES])),
            step: Box::new(Transition::identity(unit)),
            back: Box::new(Return::identity(unit)),
            past: Past::new(if steps > 0 { steps + 2 } else { 0 }, unit),
            time: 0.0,
        }
    }

    /// Begins where the mask holds.
    #[inline(always)]
    pub fn begin_where(&mut self, mask: T::Mask, estimate: &Estimate<T>, deviations: &Components<T>) {
        self.estimate = Estimate::select(mask, estimate, &self.estimate);
        self.state.renew(mask, deviations);
        self.past.begin(mask, self.time, &self.estimate);
    }

    /// Takes what a sensor showed before the filter had begun where the mask holds: with no gate, and in no watch.
    #[inline(always)]
    pub fn begin_with(&mut self, mask: T::Mask, sample: &Sample<'_, T>) {
        let (zero, one) = (sample.measured.zero(), sample.measured.splat(1.0));
        let Expected { value, mut row, seen } = sample.observation.expected(&self.estimate);
        let here = T::both(mask, seen);
        row.only(here);
        let residual = T::select(here, sample.observation.residual(sample.measured, value), zero);
        let innovation = self.state.innovation(&row, residual, T::select(here, sample.variance, one));
        self.state.update(&innovation, here);
    }

    /// Moves the estimate where the mask holds by what [`Tracker::begin_with`] has found.
    #[inline(always)]
    pub fn begun_with(&mut self, mask: T::Mask) {
        let moved = self.state.take();
        self.estimate.inject(&moved);
        self.past.begin(mask, self.time, &self.estimate);
    }

    /// The estimate.
    #[inline(always)]
    pub fn estimate(&self) -> &Estimate<T> {
        &self.estimate
    }

    /// The covariance of its error.
    #[inline(always)]
    pub fn state(&self) -> &ErrorState<T> {
        &self.state
    }

    /// Standard deviation by which the force walks in a second, from now on.
    #[inline(always)]
    pub fn walk_mut(&mut self) -> &mut Vec6<T> {
        &mut self.walk
    }

    /// Time since the tracker was made, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Moves on by steps of `h` seconds under what the actuators do, see [`Process::advance`].
    #[inline(always)]
    pub fn predict(&mut self, nodes: &[Instant<T>], h: f64) {
        let dt = h * (nodes.len() / 2) as f64;
        self.time += dt;
        let (step, noise) = (&mut *self.step, &self.noise);
        let (unit, process, estimate) = (self.walk[0], &mut self.process, &mut self.estimate);
        unit.apart(
            #[inline(always)]
            || process.advance(estimate, nodes, h, &mut step.block),
        );
        step.drift = dt;
        let [turned, shifted] = noise.offsets;
        let [u, v, w] = self.estimate.over_ground();
        let carried = (u * u + v * v + w * w) * (turned * turned) + shifted * shifted;
        let [.., p, q, r] = each(&self.estimate.motion.nu, |rate| (rate * turned) * (rate * turned));
        for (i, square) in [q + r, r + p, p + q].into_iter().enumerate() {
            step.noise[POSITION + i] = carried * dt;
            step.noise[ATTITUDE + i] = square * dt;
        }
        for i in 0..6 {
            let kept = plain::exp(-dt / noise.force_time[i]);
            step.noise[VELOCITY + i] = u.splat(plain::powi(noise.acceleration[i], 2) * dt);
            step.decay[FORCE + i] = kept;
            step.noise[FORCE + i] =
                self.walk[i] * self.walk[i] * dt + plain::powi(noise.force[i], 2) * (1.0 - kept * kept);
            self.estimate.force[i] = self.estimate.force[i] * kept;
        }
        let turned = self.estimate.rotation();
        for i in 0..3 {
            let slow = plain::exp(-dt / noise.current_time[i]);
            step.decay[CURRENT + i] = slow;
            step.noise[CURRENT + i] = u.splat(plain::powi(noise.current[i], 2) * (1.0 - slow * slow));
            self.estimate.current[i] = self.estimate.current[i] * slow;
            step.noise[GYRO_BIAS + i] = u.splat(plain::powi(noise.gyro_walk, 2) * dt);
        }
        step.gusts = noise.water != [0.0; 3];
        if step.gusts {
            for k in 0..3 {
                for j in 0..3 {
                    step.water[k][j] = turned[k][j] * (noise.water[j] * dt);
                    self.estimate.current[k] += step.water[k][j] * self.estimate.force[j];
                }
            }
        }
        let (state, back) = (&mut *self.state, &mut *self.back);
        unit.apart(
            #[inline(always)]
            || state.predict(step),
        );
        if self.past.kept() {
            unit.apart(
                #[inline(always)]
                || step.reverse(back),
            );
        }
    }

    /// Takes or refuses a sample where the mask holds and its sensor shows anything at the estimate.
    #[inline(always)]
    pub fn observe_where(
        &mut self,
        mask: T::Mask,
        sample: &Sample<'_, T>,
        watch: &mut Watch<T>,
    ) -> Verdict<T> {
        let (observation, measured) = (sample.observation, sample.measured);
        let (zero, one) = (measured.zero(), measured.splat(1.0));
        let (mut row, residual, seen) = if sample.age < 1e-9 {
            let Expected { value, row, seen } = observation.expected(&self.estimate);
            (row, observation.residual(measured, value), seen)
        } else {
            let late = (observation, measured, self.time - sample.age);
            let never = (Row::of([(POSITION, [zero; 3])]), zero, zero.lt(zero));
            self.past.expect(late, (self.time, &self.estimate), &self.back).unwrap_or(never)
        };
        // What is no number where there is no sample takes part in nothing.
        let here = T::both(mask, seen);
        row.only(here);
        let residual = T::select(here, residual, zero);
        let variance = T::select(here, sample.variance, one);
        let (state, gate, time) = (&mut *self.state, &self.gate, self.time);
        zero.apart(
            #[inline(always)]
            || watch.judge(state, gate, (&row, residual, variance), (time, here)),
        )
    }

    /// Moves the estimate by what the samples of this step have found; returns where it is sound.
    #[inline(always)]
    pub fn settle(&mut self) -> T::Mask {
        let moved = self.state.take();
        self.estimate.inject(&moved);
        self.past.keep(self.time, &self.estimate, Some(&mut self.back), &moved);
        let mut least = self.state.covariance(0, 0);
        for i in 1..STATES {
            // A sum that is no number shows what the smaller of two numbers may hide.
            let variance = self.state.covariance(i, i);
            least = least.min(variance) + variance * 0.0;
        }
        T::both(self.estimate.is_finite(), (-least).lt(least.splat(f64::MIN_POSITIVE)))
    }

    /// Standard deviations of the error: position, attitude, velocity, force, current, gyro bias.
    #[inline(always)]
    pub fn deviations(&self) -> Components<T> {
        let mut deviations = self.state.error;
        for i in 0..STATES {
            deviations[i] = self.state.deviation(i);
        }
        deviations
    }

    /// Standard deviation of the horizontal position along its longest axis, m.
    #[inline(always)]
    pub fn position_deviation(&self) -> T {
        let p = |i: usize, j: usize| self.state.covariance(POSITION + i, POSITION + j);
        let (a, b, d) = (p(0, 0), p(0, 1), p(1, 1));
        let spread = ((a - d) * (a - d) * 0.25 + b * b).sqrt();
        ((a + d) * 0.5 + spread).max(a.zero()).sqrt()
    }

    /// Largest standard deviation of an attitude angle, rad.
    #[inline(always)]
    pub fn attitude_deviation(&self) -> T {
        let deviation = |i: usize| self.state.deviation(ATTITUDE + i);
        deviation(0).max(deviation(1)).max(deviation(2))
    }
}
