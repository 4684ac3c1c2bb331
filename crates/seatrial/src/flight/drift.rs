//! A current that changes slowly: a steady trend and a random walk (a Wiener process), per axis, NED.
//!
//! `v(t) = a t + σ W(t)`, with `a` in m/s² and σ in m/s per √s; uniform in space. The walk is drawn at nodes ten seconds
//! apart and straight in between, so that the rate of the water stays small beside that of waves and turbulence.
//!
//! Every number is a function of seed, node and axis alone ([`crate::number::random`]).
//!
//! Source: Fossen (2021), section 10.3 (current speed and direction as Wiener processes, the limit of the Gauss–Markov
//! process for an infinite time constant). Tests: `tests/closed_loop/drift.rs`.

use super::turbulence::is_any;
use crate::model::current::Current;
use crate::number::algebra::Vec3;
use crate::number::random::Noise;
use crate::number::real::Real;

/// The places of the random numbers, beyond those of the turbulence.
const PLACE: usize = 96;

/// Between two nodes of the walk, s.
const NODE_S: f64 = 10.0;

/// A slow current under way.
pub struct Drift<T: Real> {
    trend: Vec3<T>,
    walk: Vec3<T>,
    noise: Noise<T, 3>,
    /// The last node and the walk's rate from it on.
    node: Vec3<T>,
    rate: Vec3<T>,
    walks: bool,
    moves: bool,
    /// Control periods between two nodes.
    every: usize,
    dt: f64,
    k: usize,
}

impl<T: Real> Drift<T> {
    /// A current with a trend (m/s²) and a random walk (m/s per √s), per axis, NED; zero at the beginning.
    #[inline(always)]
    pub fn new(trend: Vec3<T>, walk: Vec3<T>, seed: T, dt: f64) -> Self {
        let zero = [seed.zero(); 3];
        let walks = is_any(&walk);
        Self {
            moves: walks || is_any(&trend),
            walks,
            trend,
            walk,
            noise: Noise::new(seed, PLACE),
            node: zero,
            rate: zero,
            every: ((NODE_S / dt).round() as usize).max(1),
            dt,
            k: 0,
        }
    }

    /// Begins control period `k`, which follows the last one.
    #[inline(always)]
    pub fn begin(&mut self, k: usize) {
        self.k = k;
        if self.walks && k.is_multiple_of(self.every) {
            let span = self.every as f64 * self.dt;
            for axis in 0..3 {
                if k > 0 {
                    self.node[axis] += self.rate[axis] * span;
                }
                let drawn = self.noise.next(axis, k / self.every);
                self.rate[axis] = drawn * self.walk[axis] * (1.0 / span.sqrt());
            }
        }
    }

    /// Adds the slow current `time` seconds into the period.
    #[inline(always)]
    pub fn add(&self, time: f64, current: &mut Current<T>) {
        if !self.moves {
            return;
        }
        let since = (self.k % self.every) as f64 * self.dt + time;
        let all = self.k as f64 * self.dt + time;
        for axis in 0..3 {
            let walked = self.rate[axis] * since + self.node[axis];
            current.velocity[axis] += self.trend[axis] * all + walked;
            current.rate[axis] += self.rate[axis] + self.trend[axis];
        }
    }

    /// Whether there is any.
    pub fn moves(&self) -> bool {
        self.moves
    }
}
