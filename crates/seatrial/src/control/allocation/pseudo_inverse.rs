//! The weighted pseudo-inverse on the controlled rows.
//!
//! Least effort `Σ w_k f_k²` with `B f = τ` on the rows R that are controlled: `f = W⁻¹ Bᵀ (B W⁻¹ Bᵀ)⁺ τ`.
//! Written with `c_k = 1/√w_k` (zero for an actuator that is out of use) and the row scales s (zero for a free
//! row, else weight and priority over the reachable wrench `Σ |b_ik| F_max,k`, so that newtons and newton
//! metres compare): `h_k = c_k s∘b_k`, `A = Σ h_k h_kᵀ`, `f_k = c_k h_k · (A⁺ s∘τ)`.
//!
//! `A⁺` is Tikhonov's inverse, iterated three times: `G + λ G² + λ² G³`, `G = (A + λ)⁻¹`, λ = 1e-8. A direction with
//! the singular value σ (of the scaled rows) is answered to `1 − (λ/(σ² + λ))³`: to rounding for σ > 1e-2, and
//! not at all where the rank is lost. What cannot be reached is then met in the least squares of
//! the scaled rows: a row's priority says what gives way.
//!
//! Source: Fossen (2011), section 12.3; Johansen and Fossen (2013), section 3. The printed inverse of Taubert et al.
//! (2014), equations 49, 50, does not exist. Tests: `tests/allocation.rs`.

use crate::number::algebra::{Mat6, Vec6, dot, product, restricted_inverse};
use crate::number::real::Real;

/// Regularisation, relative to rows of unit size.
pub const LAMBDA: f64 = 1e-8;

/// The same in single precision, in which the other would be lost beside one.
const LAMBDA_SINGLE: f64 = 1e-5;

/// The scaled allocation matrix of the actuators in use, and its pseudo-inverse.
#[derive(Clone, Debug)]
pub struct PseudoInverse<T> {
    /// c_k, N.
    pub effort: Vec<T>,
    /// h_k.
    pub columns: Vec<Vec6<T>>,
    /// s, 1/N and 1/(N m).
    pub scale: Vec6<T>,
    /// Weights of the rows: 1 controlled, less where zero is only better than not, 0 free.
    rows: Vec6<T>,
    /// G of all of them.
    inverse: Mat6<T>,
}

impl<T: Real> PseudoInverse<T> {
    /// Room for `count` actuators, none in use.
    pub fn new(count: usize, zero: T) -> Self {
        Self {
            effort: vec![zero; count],
            columns: vec![[zero; 6]; count],
            scale: [zero; 6],
            rows: [zero; 6],
            inverse: [[zero; 6]; 6],
        }
    }

    /// For the weights of the rows and their priorities; `wrench` gives the wrench per newton of actuator k, whose
    /// [`Self::effort`] has been set.
    #[inline(always)]
    pub fn update(&mut self, rows: &Vec6<T>, priority: &Vec6<f64>, wrench: impl Fn(usize) -> Vec6<T>) {
        let zero = rows[0].zero();
        let mut reach = [zero; 6];
        for (k, effort) in self.effort.iter().enumerate() {
            let b = wrench(k);
            for i in 0..6 {
                reach[i] = b[i].abs().mul_add(*effort, reach[i]);
            }
        }
        for i in 0..6 {
            // A row that nothing reaches asks for nothing.
            let reached = zero.splat(1e-9).lt(reach[i]);
            let scale = rows[i] * priority[i] / reach[i].max(zero.splat(1e-9));
            self.scale[i] = T::select(reached, scale, zero);
        }
        for (k, effort) in self.effort.iter().enumerate() {
            let b = wrench(k);
            for i in 0..6 {
                self.columns[k][i] = *effort * self.scale[i] * b[i];
            }
        }
        self.rows = *rows;
        let all = zero.splat(1.0);
        self.inverse = self.inverse_of(|_| all);
    }

    /// `s ∘ τ`.
    #[inline(always)]
    pub fn scaled(&self, tau: &Vec6<T>) -> Vec6<T> {
        let mut scaled = *tau;
        for i in 0..6 {
            scaled[i] *= self.scale[i];
        }
        scaled
    }

    /// `A⁺` times a scaled wrench: effort k is then [`Self::share`].
    #[inline(always)]
    pub fn solve(&self, scaled: &Vec6<T>) -> Vec6<T> {
        refined(&self.inverse, scaled)
    }

    /// `f_k/c_k` of a solution.
    #[inline(always)]
    pub fn share(&self, k: usize, solution: &Vec6<T>) -> T {
        dot(&self.columns[k], solution)
    }

    /// `(A + λ)⁻¹` of the actuators that are free (0 or 1).
    #[inline(always)]
    pub fn inverse_of(&self, free: impl Fn(usize) -> T) -> Mat6<T> {
        let (zero, one) = (self.rows[0].zero(), self.rows[0].splat(1.0));
        let mut a = [[zero; 6]; 6];
        for i in 0..6 {
            // Rows that are not controlled are zero: the identity stands in for them.
            a[i][i] = T::select(zero.lt(self.rows[i]), zero, one) + zero.guard(LAMBDA, LAMBDA_SINGLE);
        }
        for (k, column) in self.columns.iter().enumerate() {
            let free = free(k);
            for i in 0..6 {
                let part = column[i] * free;
                for j in 0..=i {
                    a[i][j] = part.mul_add(column[j], a[i][j]);
                }
            }
        }
        for i in 0..6 {
            for j in 0..i {
                a[j][i] = a[i][j];
            }
        }
        restricted_inverse(&a, &[true; 6])
    }
}

/// `A⁺` times a scaled wrench by `G = (A + λ)⁻¹`, iterated: `G (x + λ G (x + λ G x))`.
#[inline(always)]
pub fn refined<T: Real>(inverse: &Mat6<T>, scaled: &Vec6<T>) -> Vec6<T> {
    let mut y = product(inverse, scaled);
    for _ in 0..2 {
        let mut x = *scaled;
        for i in 0..6 {
            x[i] = (y[i] * y[i].guard(LAMBDA, LAMBDA_SINGLE)) + x[i];
        }
        y = product(inverse, &x);
    }
    y
}
