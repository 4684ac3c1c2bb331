//! The bounded quadratic programme of a single vehicle:
//!
//! `min ½ |H g − t|² + ½ λ |g|²` with `lowest ≤ g ≤ highest`,
//!
//! in the scaled coordinates of [`super::pseudo_inverse`]: H has the columns h_k, t is the scaled wrench with its
//! priorities, g the forces over their efforts. λ is so small that effort only chooses among equal answers.
//!
//! A primal active-set method. With the shares at their bounds held, the free ones solve
//! `g_F = H_Fᵀ y, y = (H_F H_Fᵀ + λ)⁻¹ (t − H_A g_A)`, six equations however many actuators; the residual is `−λ y`
//! and the multiplier of a held share `λ (g_k − h_k·y)`. A step stops at the first bound, which joins the set; the
//! share with the most wrong multiplier leaves it. The last active set is tried first: while the same
//! actuators are saturated, one solution does. Otherwise the search starts at the clipped pseudo-inverse and never gets
//! worse, so that after [`ITERATIONS`] per actuator the point at hand is feasible and no worse than clipping.
//!
//! Fixed memory, [`CAPACITY`] actuators. Source: Härkegård (2002); Johansen and Fossen (2013), section 3.3.
//! Tests: `tests/allocation.rs::law_quadratic_…`.

use super::pseudo_inverse::{LAMBDA, PseudoInverse};
use super::redistribution::Shares;
use crate::number::algebra::{Vec6, dot, product};

/// The largest number of actuators.
pub const CAPACITY: usize = 16;
/// Bound on the iterations, per actuator.
pub const ITERATIONS: usize = 4;

/// At which bound a share is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Held {
    #[default]
    Free,
    Lowest,
    Highest,
}

/// The solver with its last active set.
#[derive(Clone, Debug, Default)]
pub struct QuadraticProgramme {
    held: [Held; CAPACITY],
    iterations: usize,
}

impl QuadraticProgramme {
    /// How many sets of equations the last call solved.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// The least value for a scaled wrench; the shares at hand are the pseudo-inverse's.
    pub fn solve(&mut self, p: &PseudoInverse<f64>, target: &Vec6<f64>, shares: &mut Shares<f64>) {
        let count = shares.share.len().min(CAPACITY);
        self.iterations = 0;
        if shares.outside(0.0) == 0.0 {
            // No bound is active: the pseudo-inverse is the answer.
            self.held = [Held::Free; CAPACITY];
            return;
        }
        let (trial, y) = self.subproblem(p, target, shares);
        let feasible = |k: usize| shares.lowest[k] <= trial[k] && trial[k] <= shares.highest[k];
        if (0..count).all(feasible) && self.most_wrong(p, &trial, &y, shares).is_none() {
            shares.share[..count].copy_from_slice(&trial[..count]);
            return;
        }
        for k in 0..count {
            self.held[k] = match shares.share[k] {
                g if g < shares.lowest[k] => Held::Lowest,
                g if g > shares.highest[k] => Held::Highest,
                _ => Held::Free,
            };
        }
        shares.clip();
        for _ in 0..ITERATIONS * count {
            let (trial, y) = self.subproblem(p, target, shares);
            let mut stop = (1.0, None);
            for k in (0..count).filter(|&k| self.held[k] == Held::Free) {
                let (from, step) = (shares.share[k], trial[k] - shares.share[k]);
                let (bound, side) = if step > 0.0 {
                    (shares.highest[k], Held::Highest)
                } else {
                    (shares.lowest[k], Held::Lowest)
                };
                if step != 0.0 && (bound - from) / step < stop.0 {
                    stop = (((bound - from) / step).max(0.0), Some((k, side)));
                }
            }
            for k in (0..count).filter(|&k| self.held[k] == Held::Free) {
                shares.share[k] += stop.0 * (trial[k] - shares.share[k]);
            }
            match stop.1 {
                Some((k, side)) => {
                    self.held[k] = side;
                    shares.share[k] = if side == Held::Lowest { shares.lowest[k] } else { shares.highest[k] };
                }
                None => match self.most_wrong(p, &trial, &y, shares) {
                    Some(k) => self.held[k] = Held::Free,
                    None => break,
                },
            }
        }
        shares.clip();
    }

    /// The best shares with the held ones at their bounds, and y.
    fn subproblem(
        &mut self,
        p: &PseudoInverse<f64>,
        target: &Vec6<f64>,
        shares: &Shares<f64>,
    ) -> ([f64; CAPACITY], Vec6<f64>) {
        self.iterations += 1;
        let count = shares.share.len().min(CAPACITY);
        let mut share = [0.0; CAPACITY];
        let mut left = *target;
        for k in 0..count {
            share[k] = match self.held[k] {
                Held::Free => continue,
                Held::Lowest => shares.lowest[k],
                Held::Highest => shares.highest[k],
            };
            for i in 0..6 {
                left[i] -= p.columns[k][i] * share[k];
            }
        }
        let inverse = p.inverse_of(|k| if self.held[k] == Held::Free { 1.0 } else { 0.0 });
        let y = product(&inverse, &left);
        for k in (0..count).filter(|&k| self.held[k] == Held::Free) {
            share[k] = p.share(k, &y);
        }
        (share, y)
    }

    /// The held share whose bound holds it back most from a better value.
    fn most_wrong(
        &self,
        p: &PseudoInverse<f64>,
        share: &[f64; CAPACITY],
        y: &Vec6<f64>,
        shares: &Shares<f64>,
    ) -> Option<usize> {
        let mut worst = (0.0, None);
        for k in 0..shares.share.len().min(CAPACITY) {
            let wrong = match self.held[k] {
                Held::Lowest => dot(&p.columns[k], y) - share[k],
                Held::Highest => share[k] - dot(&p.columns[k], y),
                Held::Free => continue,
            };
            // y is known to the condition of its equations, 1/λ at worst.
            let size: f64 = (0..6).map(|i| (p.columns[k][i] * y[i]).abs()).sum();
            if shares.lowest[k] < shares.highest[k]
                && wrong > worst.0
                && wrong > 1e-9 * (1.0 + share[k].abs()) + 1e-16 / LAMBDA * size
            {
                worst = (wrong, Some(k));
            }
        }
        worst.1
    }
}
