//! A current that varies in time: a Gauss–Markov process about its mean, smoothed once more.
//!
//! `x_1' = −x_1/τ + w`, `x_2' = (x_1 − x_2)/τ_2`, per axis, x_2 being the velocity of the water: uniform in space, with the
//! given standard deviation. The second lag keeps its rate finite; eddies that pass the hull within τ_2 average
//! out along it. Both are solved exactly over a control period, x_1 linear in it; within a period the
//! current runs straight from value to value. It begins in its stationary distribution.
//!
//! Every number is a function of seed, period and axis alone ([`crate::number::random`]).
//!
//! Source: Fossen (2011), section 8.3 (first-order Gauss–Markov current). Tests: `tests/closed_loop/turbulence.rs`.

use crate::model::current::Current;
use crate::number::algebra::Vec3;
use crate::number::plain;
use crate::number::random::{Noise, ONCE, gaussians};
use crate::number::real::Real;

/// The places of the random numbers, beyond those of the sensors.
const PLACE: usize = 64;

/// Whether any component is other than zero, in any lane.
#[inline(always)]
pub(super) fn is_any<T: Real>(x: &Vec3<T>) -> bool {
    x.iter().any(|c| !c.equals(c.zero()))
}

/// A turbulent current under way.
pub struct Turbulence<T: Real> {
    mean: Vec3<T>,
    sigma: Vec3<T>,
    noise: Noise<T, 3>,
    zero: T,
    slow: Vec3<T>,
    now: Vec3<T>,
    next: Vec3<T>,
    moves: bool,
    varies: bool,
    dt: f64,
    /// Decay of the slow part and deviation of its innovation, in units of sigma.
    process: [f64; 2],
    /// Of the second lag over a period: decay, share of the slow part, share of its change.
    lag: [f64; 3],
}

impl<T: Real> Turbulence<T> {
    /// A current of a mean and standard deviations per axis (NED, m/s), with time constants τ and τ_2 in s.
    #[inline(always)]
    pub fn new((mean, sigma): (Vec3<T>, Vec3<T>), [tau, tau_2]: [f64; 2], seed: T, dt: f64) -> Self {
        let varies = is_any(&sigma);
        let (decay, decay_2) = (plain::exp(-dt / tau), plain::exp(-dt / tau_2));
        // Variance of the slow part per variance of the velocity.
        let variance = (tau + tau_2) / tau;
        let mut current = Self {
            moves: varies || is_any(&mean),
            varies,
            process: [decay, (variance * (1.0 - decay * decay)).sqrt()],
            lag: [decay_2, 1.0 - decay_2, 1.0 - tau_2 / dt * (1.0 - decay_2)],
            slow: [seed.zero(); 3],
            now: mean,
            next: mean,
            mean,
            sigma,
            noise: Noise::new(seed, PLACE),
            zero: seed.zero(),
            dt,
        };
        if varies {
            for axis in 0..3 {
                let (slow, rest) = gaussians(seed, ONCE, PLACE + axis);
                current.slow[axis] = slow * variance.sqrt();
                let own = slow * (1.0 / variance).sqrt() + rest * (1.0 - 1.0 / variance).sqrt();
                current.next[axis] = own.mul_add(sigma[axis], mean[axis]);
            }
        }
        current
    }

    /// The current at the beginning of control period `k`, which follows the last one; nothing in still water.
    #[inline(always)]
    pub fn begin(&mut self, k: usize) -> Option<Current<T>> {
        self.now = self.next;
        if self.varies {
            for axis in 0..3 {
                let drawn = self.noise.next(axis, k);
                let before = self.slow[axis];
                let after = before * self.process[0] + drawn * self.process[1];
                let sigma = self.sigma[axis];
                let fast = self.now[axis] - self.mean[axis];
                let driven = before * self.lag[1] + (after - before) * self.lag[2];
                self.next[axis] = self.mean[axis] + fast * self.lag[0] + driven * sigma;
                self.slow[axis] = after;
            }
        }
        self.at(0.0)
    }

    /// The current `time` seconds into the period.
    #[inline(always)]
    pub fn at(&self, time: f64) -> Option<Current<T>> {
        self.moves.then(|| self.moving(time))
    }

    #[inline(always)]
    fn moving(&self, time: f64) -> Current<T> {
        let mut current = Current { velocity: self.now, rate: [self.zero; 3], pressed: None };
        if self.varies {
            for axis in 0..3 {
                let rate = (self.next[axis] - self.now[axis]) * (1.0 / self.dt);
                current.rate[axis] = rate;
                current.velocity[axis] += rate * time;
            }
        }
        current
    }

    /// Whether it differs within a period.
    pub fn varies(&self) -> bool {
        self.varies
    }
}
