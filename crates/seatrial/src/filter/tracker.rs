//! The filter at work: predicted step by step, corrected by samples, in fixed memory.
//!
//! The noise of the process: the unmodelled force is a Gauss–Markov process of given deviation and time constant; white
//! noise on the accelerations stands for what is faster, and a random walk of the force for the push of waves; the current is a slow Gauss–Markov process, the gyro's bias a
//! random walk. Constant offsets of attitude and Doppler log carry the position off, at a rate that looks constant for
//! as long as nothing turns: white noise of the position over a second stands for it.
//!
//! Source: Farrell (2008), sections 4.6 and 7.2; Fossen (2021), section 13.4 (bias of force and current).
//! Tests: `tests/filter/tracker.rs`, `tests/fixed_memory.rs`.

use super::error_state::{ErrorState, Return, Transition};
use super::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use super::innovation::{Gate, Verdict, Watch};
use super::observation::Observation;
use super::past::Past;
use super::process::Process;
use crate::model::vehicle::Instant;
use crate::number::algebra::Vec6;

/// What the model does not know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of the unmodelled force, body frame, N and N m.
    pub force: Vec6<f64>,
    /// Its time constant, s.
    pub force_time: f64,
    /// Standard deviation by which the force walks in a second, N and N m.
    pub force_walk: Vec6<f64>,
    /// Standard deviation of the velocity that white noise of acceleration makes in a second, m/s and rad/s.
    pub acceleration: Vec6<f64>,
    /// Standard deviation of the current, each of north, east and down, m/s.
    pub current: [f64; 3],
    /// Its time constant, s.
    pub current_time: f64,
    /// Standard deviation by which the gyro's bias moves in a second, rad/s.
    pub gyro_walk: f64,
    /// Standard deviation of the constant offset of the attitude, rad, and of the velocity over ground, m/s.
    pub offsets: [f64; 2],
}

/// One scalar that was measured.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// What is observed.
    pub observation: &'a Observation,
    /// The measured value.
    pub measured: f64,
    /// The variance of its error.
    pub variance: f64,
    /// How long ago it was true, s.
    pub age: f64,
}

/// Estimate and covariance, step by step.
pub struct Tracker {
    process: Process,
    noise: Noise,
    gate: Gate,
    estimate: Estimate,
    /// On the heap, because it asks for an alignment that not every owner of a tracker gives.
    state: Box<ErrorState<STATES>>,
    step: Transition<STATES>,
    /// The step's way back, where samples may come late.
    back: Return,
    past: Past,
    time: f64,
}

impl Tracker {
    /// A tracker that keeps `steps` steps for samples that come late.
    pub fn new(process: Process, noise: Noise, gate: Gate, steps: usize) -> Self {
        Self {
            process,
            noise,
            gate,
            estimate: Estimate::at_rest(),
            state: Box::new(ErrorState::new(&[0.0; STATES])),
            step: Transition::identity(),
            back: Return::identity(),
            past: Past::new(if steps > 0 { steps + 2 } else { 0 }),
            time: 0.0,
        }
    }

    /// Begins at an estimate whose components have these deviations.
    pub fn begin(&mut self, estimate: &Estimate, deviations: &[f64; STATES]) {
        self.estimate = *estimate;
        *self.state = ErrorState::new(deviations);
        self.step = Transition::identity();
        self.back = Return::identity();
        self.past.clear();
        self.past.keep(self.time, estimate, &self.back, &[0.0; STATES]);
    }

    /// The estimate.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The covariance of its error.
    pub fn state(&self) -> &ErrorState<STATES> {
        &self.state
    }

    /// What the model does not know, for who knows better from now on.
    pub fn noise_mut(&mut self) -> &mut Noise {
        &mut self.noise
    }

    /// Time since the tracker was made, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Moves on by steps of `h` seconds under what the actuators do, see [`Process::advance`].
    pub fn predict(&mut self, nodes: &[Instant<f64>], h: f64) {
        let dt = h * (nodes.len() / 2) as f64;
        self.time += dt;
        self.step.block = self.process.advance(&mut self.estimate, nodes, h);
        self.step.drift = dt;
        let noise = &self.noise;
        let kept = (-dt / noise.force_time).exp();
        let slow = (-dt / noise.current_time).exp();
        let [turned, shifted] = noise.offsets;
        let [u, v, w] = self.estimate.over_ground();
        let carried = turned * turned * (u * u + v * v + w * w) + shifted * shifted;
        self.step.noise[POSITION..POSITION + 3].fill(carried * dt);
        let [p, q, r] = [3, 4, 5].map(|i| (self.estimate.motion.nu[i] * turned).powi(2));
        for (i, square) in [q + r, r + p, p + q].into_iter().enumerate() {
            self.step.noise[ATTITUDE + i] = square * dt;
        }
        for i in 0..6 {
            self.step.noise[VELOCITY + i] = noise.acceleration[i].powi(2) * dt;
            self.step.decay[FORCE + i] = kept;
            self.step.noise[FORCE + i] =
                noise.force[i].powi(2) * (1.0 - kept * kept) + noise.force_walk[i].powi(2) * dt;
            self.estimate.force[i] *= kept;
        }
        for i in 0..3 {
            self.step.decay[CURRENT + i] = slow;
            self.step.noise[CURRENT + i] = noise.current[i].powi(2) * (1.0 - slow * slow);
            self.estimate.current[i] *= slow;
            self.step.noise[GYRO_BIAS + i] = noise.gyro_walk.powi(2) * dt;
        }
        self.process.spread(&mut self.state, &self.step);
        if self.past.kept() {
            self.back = self.process.reversed(&self.step);
        }
    }

    /// Takes or refuses a sample; nothing where its sensor shows nothing at the estimate.
    pub fn observe(&mut self, sample: &Sample<'_>, watch: &mut Watch) -> Option<Verdict> {
        let Self { process, state, back, past, estimate, gate, time, .. } = self;
        process.wide(
            #[inline(always)]
            || {
                let (row, residual) = if sample.age < 1e-9 {
                    let (expected, row) = sample.observation.expect(estimate)?;
                    (row, sample.observation.residual(sample.measured, expected))
                } else {
                    let measured = (sample.observation, sample.measured, *time - sample.age);
                    past.expect(measured, (*time, estimate), back)?
                };
                Some(watch.judge(state, gate, (&row, residual, sample.variance), *time))
            },
        )
    }

    /// Moves the estimate by what the samples of this step have found; returns whether it is sound.
    pub fn settle(&mut self) -> bool {
        let moved = self.state.take();
        let sound = self.estimate.inject(&moved);
        self.past.keep(self.time, &self.estimate, &self.back, &moved);
        let motion = &self.estimate.motion;
        let numbers = motion.position.iter().chain(&motion.attitude).chain(&motion.nu);
        sound
            && numbers.chain(&self.estimate.force).all(|x| x.is_finite())
            && (0..STATES).all(|i| self.state.covariance[i][i] >= 0.0)
    }

    /// Standard deviations of the error: position, attitude, velocity, force, current, gyro bias.
    pub fn deviations(&self) -> [f64; STATES] {
        std::array::from_fn(|i| self.state.deviation(i))
    }

    /// Standard deviation of the horizontal position along its longest axis, m.
    pub fn position_deviation(&self) -> f64 {
        let p = &self.state.covariance;
        let (a, b, d) = (p[POSITION][POSITION], p[POSITION][POSITION + 1], p[POSITION + 1][POSITION + 1]);
        let spread = (0.25 * (a - d) * (a - d) + b * b).sqrt();
        (0.5 * (a + d) + spread).max(0.0).sqrt()
    }

    /// Largest standard deviation of an attitude angle, rad.
    pub fn attitude_deviation(&self) -> f64 {
        (0..3).map(|i| self.state.deviation(ATTITUDE + i)).fold(0.0, f64::max)
    }
}
