//! Bounds after the pseudo-inverse: clipping, and the redistribution of what saturated actuators leave.
//!
//! Clipping alone turns the wrench: what one propeller cannot give is missing in every row of its column. So the
//! saturated ones are fixed at their bounds and the others solve the remainder, a few times. Where that should not be
//! nearer to the demand (in the scaled rows) than clipping, clipping stays.
//!
//! Source: Johansen and Fossen (2013), section 3.2 (redistributed pseudo-inverse). Tests: `tests/allocation.rs`.

use super::pseudo_inverse::{PseudoInverse, refined};
use crate::number::algebra::{Vec6, dot};
use crate::number::real::Real;

/// Forces beyond the preferred ones, each over its effort c_k, with their bounds.
#[derive(Clone, Debug)]
pub struct Shares<T> {
    /// `(f_k − f_idle,k)/c_k`.
    pub share: Vec<T>,
    /// Lower bounds.
    pub lowest: Vec<T>,
    /// Upper bounds.
    pub highest: Vec<T>,
    trial: Vec<T>,
    fixed: Vec<T>,
}

impl<T: Real> Shares<T> {
    /// Room for `count` actuators.
    pub fn new(count: usize, zero: T) -> Self {
        let none = vec![zero; count];
        Self {
            share: none.clone(),
            lowest: none.clone(),
            highest: none.clone(),
            trial: none.clone(),
            fixed: none,
        }
    }

    /// Whether share k is outside of its bounds.
    #[inline(always)]
    fn is_outside(&self, k: usize, share: T) -> T::Mask {
        T::either(share.lt(self.lowest[k]), self.highest[k].lt(share))
    }

    /// 1 where any share is outside of its bounds.
    #[inline(always)]
    pub fn outside(&self, zero: T) -> T {
        let mut outside = zero;
        for (k, share) in self.share.iter().enumerate() {
            outside = T::select(self.is_outside(k, *share), zero.splat(1.0), outside);
        }
        outside
    }

    /// Every share within its bounds.
    #[inline(always)]
    pub fn clip(&mut self) {
        for k in 0..self.share.len() {
            self.share[k] = self.share[k].clamped(self.lowest[k], self.highest[k]);
        }
    }

    /// What is left of a scaled wrench after the shares.
    #[inline(always)]
    fn rest(columns: &[Vec6<T>], target: &Vec6<T>, share: impl Fn(usize) -> T) -> Vec6<T> {
        let mut rest = *target;
        for (k, column) in columns.iter().enumerate() {
            let share = share(k);
            for i in 0..6 {
                rest[i] = column[i].neg_mul_add(share, rest[i]);
            }
        }
        rest
    }

    /// Gives the scaled wrench that the saturated shares leave to the others, `passes` times, and clips.
    #[inline(always)]
    pub fn redistribute(&mut self, p: &PseudoInverse<T>, target: &Vec6<T>, passes: u32) {
        let (zero, one) = (target[0].zero(), target[0].splat(1.0));
        let saturated = self.outside(zero);
        for k in 0..self.share.len() {
            self.trial[k] = self.share[k];
            self.fixed[k] = zero;
        }
        for _ in 0..passes {
            let mut more = zero;
            for k in 0..self.trial.len() {
                let outside = T::select(self.is_outside(k, self.trial[k]), one, zero);
                more += outside;
                self.fixed[k] = self.fixed[k].max(outside);
                self.trial[k] = self.trial[k].clamped(self.lowest[k], self.highest[k]);
            }
            if !T::any(zero.lt(more)) {
                break;
            }
            let left = Self::rest(&p.columns, target, |k| self.fixed[k] * self.trial[k]);
            let solution = refined(&p.inverse_of(|k| one - self.fixed[k]), &left);
            for k in 0..self.trial.len() {
                let moved = p.share(k, &solution);
                self.trial[k] = T::select(zero.lt(self.fixed[k]), self.trial[k], moved);
            }
        }
        for k in 0..self.trial.len() {
            self.trial[k] = self.trial[k].clamped(self.lowest[k], self.highest[k]);
        }
        self.clip();
        let miss = |shares: &[T]| {
            let rest = Self::rest(&p.columns, target, |k| shares[k]);
            dot(&rest, &rest)
        };
        let better = T::both(zero.lt(saturated), miss(&self.trial).lt(miss(&self.share)));
        for k in 0..self.share.len() {
            self.share[k] = T::select(better, self.trial[k], self.share[k]);
        }
    }
}
