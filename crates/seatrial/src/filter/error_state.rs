//! The covariance of the error of a state: predicted through the Jacobian of a step, updated by one scalar at a time.
//!
//! Prediction: `P ← F P Fᵀ + Q`. F has the shape of the state ([`super::estimate`]): twelve rows of motion that depend on
//! attitude, velocity, force and, for the position, the current; below them a diagonal. The products that this shape
//! makes zero are left out. P is symmetric: its upper triangle is kept, read and moved, and nothing else.
//!
//! Update by `z = h x + v`, `v ~ (0, r)`: `s = h P hᵀ + r`, `K = P hᵀ/s`, and in Joseph form
//! `P ← (I − K h) P (I − K h)ᵀ + K r Kᵀ`: a sum of two positive semidefinite matrices, whatever rounding does to K.
//! The rows of several uncorrelated scalars may be taken at the same state: the error found so far is subtracted from
//! each residual, and moved into the state once. Then the sum of `ν²/s` over them is the normalised innovation squared
//! of the whole vector. Every update is of rank one, `P ← P − w c cᵀ` with `c = P hᵀ`, `w = (2 − g s) g` and g = 1/s rounded,
//! and P itself is moved by three of them at a time: until then what a row sees is `P hᵀ − Σ w c (c·h)`.
//!
//! Of several vehicles abreast each has its own P. What a row is without it is without for all of them, and so are the
//! times: steps and sensors are of one kind.
//!
//! Source: Bucy & Joseph, *Filtering for Stochastic Processes* (1968); Bierman, *Factorization Methods for Discrete
//! Sequential Estimation* (1977), chapter II; Farrell (2008), sections 5.5 and 6.7.
//! Tests: `tests/filter/error_state.rs` (against dense matrix algebra, millions of steps).

use super::estimate::{ATTITUDE, CURRENT, Components, FORCE, GYRO_BIAS, STATES};
use super::row::{PART, Row};
use super::transition::{COLUMNS, MOTION, Transition};
use crate::number::algebra::Mat3;
use crate::number::real::Real;

/// The columns of `F P` that a prediction asks for in all rows, and so many of them as stay in registers for three rows.
const MOVED: usize = STATES - ATTITUDE;
/// See [`MOVED`].
const WIDE: usize = 7;

/// What an observation says against what was expected of it.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<T = f64> {
    /// Residual less the error found so far: measured minus expected.
    pub value: T,
    /// Its variance.
    pub variance: T,
}

impl<T: Real> Innovation<T> {
    /// The normalised innovation squared: χ² of one degree of freedom where the filter is consistent.
    #[inline(always)]
    pub fn normalised_squared(&self) -> T {
        self.value * self.value / self.variance
    }
}

/// So many updates move P at a time.
const TOGETHER: usize = 3;

/// An update by which P is still to move.
#[derive(Clone, Copy, Debug)]
struct Taken<T> {
    /// Covariance of a scalar with the error, `P hᵀ`.
    cross: Components<T>,
    /// P loses so much of its square; none where the scalar was not taken.
    weight: T,
}

/// The error of an estimate: its covariance, and what observations have found of it and is not yet injected.
#[derive(Clone, Debug)]
pub struct ErrorState<T = f64> {
    /// P before the updates that it is still to move by: its upper triangle, what stands below is not read.
    covariance: [[T; STATES]; STATES],
    /// These updates, and behind them the scalar whose innovation was asked for.
    taken: [Taken<T>; TOGETHER + 1],
    waiting: usize,
    /// The mean of the error.
    pub error: Components<T>,
    /// F P under way: rows of motion, columns from the attitude on.
    moved: [[T; MOVED]; MOTION],
}

impl ErrorState {
    /// An error of this covariance.
    pub fn of(covariance: [[f64; STATES]; STATES]) -> Self {
        Self { covariance, ..Self::new(&[0.0; STATES]) }
    }

    /// P in full.
    pub fn dense(&self) -> [[f64; STATES]; STATES] {
        std::array::from_fn(|i| std::array::from_fn(|j| self.covariance(i, j)))
    }
}

impl<T: Real> ErrorState<T> {
    /// An error of independent components with these standard deviations.
    #[inline(always)]
    pub fn new(deviations: &Components<T>) -> Self {
        let zero = deviations[0].zero();
        let mut covariance = [[zero; STATES]; STATES];
        for i in 0..STATES {
            covariance[i][i] = deviations[i] * deviations[i];
        }
        let none = Taken { cross: [zero; STATES], weight: zero };
        Self {
            covariance,
            taken: [none; TOGETHER + 1],
            waiting: 0,
            error: [zero; STATES],
            moved: [[zero; MOVED]; MOTION],
        }
    }

    /// An entry of P.
    #[inline(always)]
    pub fn covariance(&self, i: usize, j: usize) -> T {
        let mut entry = self.covariance[i.min(j)][i.max(j)];
        for taken in &self.taken[..self.waiting] {
            entry = (taken.cross[i] * taken.weight).neg_mul_add(taken.cross[j], entry);
        }
        entry
    }

    /// Begins anew where the mask holds.
    #[inline(always)]
    pub fn renew(&mut self, mask: T::Mask, deviations: &Components<T>) {
        self.catch_up();
        let zero = deviations[0].zero();
        for i in 0..STATES {
            let row = &mut self.covariance[i];
            row[i] = T::select(mask, deviations[i] * deviations[i], row[i]);
            for x in &mut row[i + 1..] {
                *x = T::select(mask, zero, *x);
            }
            self.error[i] = T::select(mask, zero, self.error[i]);
        }
    }

    /// The standard deviation of a component.
    #[inline(always)]
    pub fn deviation(&self, i: usize) -> T {
        let variance = self.covariance(i, i);
        variance.max(variance.zero()).sqrt()
    }

    /// `P ← F P Fᵀ + Q`.
    #[inline(always)]
    pub fn predict(&mut self, step: &Transition<T>) {
        self.catch_up();
        // Rows that are read from end to end: what F mixes is mirrored below the diagonal.
        for i in ATTITUDE..CURRENT {
            for j in ATTITUDE..i {
                self.covariance[i][j] = self.covariance[j][i];
            }
        }
        for part in 0..MOTION / PART {
            for block in 0..MOVED / WIDE {
                self.mix(step, PART * part, WIDE * block);
            }
        }
        self.place(step);
        for first in (0..MOTION).step_by(PART) {
            for other in (first.max(ATTITUDE)..MOTION).step_by(PART) {
                self.meet(step, first, other);
            }
            for i in first..first + PART {
                for j in MOTION..STATES {
                    self.covariance[i][j] = self.moved[i][j - ATTITUDE] * step.decay[j];
                }
            }
        }
        let p = &mut self.covariance;
        for i in MOTION..STATES {
            for j in i..STATES {
                p[i][j] = p[i][j] * (step.decay[i] * step.decay[j]);
            }
        }
        if step.gusts {
            self.sweep(&step.water);
        }
        for i in 0..STATES {
            self.covariance[i][i] += step.noise[i];
        }
    }

    /// The current follows the force: P of `v_c + E τ_u`.
    #[inline(always)]
    fn sweep(&mut self, water: &Mat3<T>) {
        let p = &mut self.covariance;
        let zero = p[0][0].zero();
        let mut rows = [[zero; STATES]; 3];
        for k in 0..3 {
            for c in 0..STATES {
                for j in 0..3 {
                    let force = FORCE + j;
                    rows[k][c] = water[k][j].mul_add(p[force.min(c)][force.max(c)], rows[k][c]);
                }
            }
        }
        for k in 0..3 {
            for c in 0..CURRENT {
                p[c][CURRENT + k] += rows[k][c];
            }
            for c in GYRO_BIAS..STATES {
                p[CURRENT + k][c] += rows[k][c];
            }
            for l in k..3 {
                let mut sum = rows[k][CURRENT + l] + rows[l][CURRENT + k];
                for j in 0..3 {
                    sum = water[l][j].mul_add(rows[k][FORCE + j], sum);
                }
                p[CURRENT + k][CURRENT + l] += sum;
            }
        }
    }

    /// `F P`: three rows of motion in so many columns as stay in registers, from the attitude on.
    #[inline(always)]
    fn mix(&mut self, step: &Transition<T>, first: usize, from: usize) {
        let (p, zero) = (&self.covariance, self.error[0].zero());
        let mut sum = [[zero; WIDE]; PART];
        if first < ATTITUDE {
            for i in 0..PART {
                for j in 0..WIDE {
                    let (carried, j_) = (CURRENT + i, ATTITUDE + from + j);
                    sum[i][j] = p[carried.min(j_)][carried.max(j_)] * step.drift + p[i][j_];
                }
            }
        }
        for k in 0..COLUMNS {
            let row = &p[ATTITUDE + k];
            for i in 0..PART {
                for j in 0..WIDE {
                    sum[i][j] = row[ATTITUDE + from + j].mul_add(step.block[first + i][k], sum[i][j]);
                }
            }
        }
        for i in 0..PART {
            for j in 0..WIDE {
                self.moved[first + i][from + j] = sum[i][j];
            }
        }
    }

    /// `F P Fᵀ` of the position.
    #[inline(always)]
    fn place(&mut self, step: &Transition<T>) {
        let p = &mut self.covariance;
        for i in 0..ATTITUDE {
            for j in i..ATTITUDE {
                let mut sum = p[j][CURRENT + i] * step.drift + p[i][j];
                sum = self.moved[i][CURRENT - ATTITUDE + j] * step.drift + sum;
                for k in 0..COLUMNS {
                    sum = p[j][ATTITUDE + k].mul_add(step.block[i][k], sum);
                    sum = self.moved[i][k].mul_add(step.block[j][k], sum);
                }
                p[i][j] = sum;
            }
        }
    }

    /// `F P Fᵀ` of three rows of motion and three others that are not of the position.
    #[inline(always)]
    fn meet(&mut self, step: &Transition<T>, first: usize, other: usize) {
        let mut sum = [[self.error[0].zero(); PART]; PART];
        for k in 0..COLUMNS {
            for i in 0..PART {
                for j in 0..PART {
                    sum[i][j] = self.moved[first + i][k].mul_add(step.block[other + j][k], sum[i][j]);
                }
            }
        }
        for i in 0..PART {
            for j in 0..PART {
                if first + i <= other + j {
                    self.covariance[first + i][other + j] = sum[i][j];
                }
            }
        }
    }

    /// What a scalar of variance `variance` says whose residual at the estimate is `residual`.
    #[inline(always)]
    pub fn innovation(&mut self, row: &Row<T>, residual: T, variance: T) -> Innovation<T> {
        if self.waiting == TOGETHER {
            self.catch_up();
        }
        let (h, p) = (&row.derivatives, &self.covariance);
        let (before, here) = self.taken.split_at_mut(self.waiting);
        let cross = &mut here[0].cross;
        *cross = [variance.zero(); STATES];
        for part in 0..STATES / PART {
            if row.parts >> part & 1 == 0 {
                continue;
            }
            let first = PART * part;
            let own = [h[first], h[first + 1], h[first + 2]];
            // Down the columns as far as the part, and along the rows from there.
            for j in 0..first {
                for k in 0..PART {
                    cross[j] = own[k].mul_add(p[j][first + k], cross[j]);
                }
            }
            for j in first..first + PART {
                for k in 0..PART {
                    let i = first + k;
                    cross[j] = own[k].mul_add(p[i.min(j)][i.max(j)], cross[j]);
                }
            }
            for j in first + PART..STATES {
                for k in 0..PART {
                    cross[j] = own[k].mul_add(p[first + k][j], cross[j]);
                }
            }
        }
        for taken in before {
            let share = row.times(&taken.cross) * taken.weight;
            for j in 0..STATES {
                cross[j] = share.neg_mul_add(taken.cross[j], cross[j]);
            }
        }
        Innovation { value: residual - row.times(&self.error), variance: row.times(cross) + variance }
    }

    /// Takes the scalar whose innovation was asked for last where the mask holds: mean and covariance of the error after
    /// it.
    #[inline(always)]
    pub fn update(&mut self, innovation: &Innovation<T>, mask: T::Mask) {
        if !T::any(mask) {
            return;
        }
        let (one, taken) = (innovation.variance.splat(1.0), &mut self.taken[self.waiting]);
        let zero = one.zero();
        let scale = T::select(mask, one / innovation.variance, zero);
        let moved = T::select(mask, innovation.value * scale, zero);
        for i in 0..STATES {
            self.error[i] = taken.cross[i].mul_add(moved, self.error[i]);
        }
        // (I − K h) P (I − K h)ᵀ + K r Kᵀ = P − K cᵀ − c Kᵀ + K s Kᵀ with K = c/s.
        taken.weight = scale.neg_mul_add(innovation.variance, zero.splat(2.0)) * scale;
        self.waiting += 1;
    }

    /// Moves P by the updates that wait.
    #[inline(always)]
    fn catch_up(&mut self) {
        match self.waiting {
            0 => return,
            1 => self.subtract::<1>(),
            2 => self.subtract::<2>(),
            _ => self.subtract::<TOGETHER>(),
        }
        self.waiting = 0;
    }

    /// Moves P by so many updates, three rows at a time.
    #[inline(always)]
    fn subtract<const K: usize>(&mut self) {
        let (p, taken) = (&mut self.covariance, &self.taken);
        for first in (0..STATES).step_by(PART) {
            let mut shares = [[p[0][0]; K]; PART];
            for i in 0..PART {
                for k in 0..K {
                    shares[i][k] = taken[k].cross[first + i] * taken[k].weight;
                }
            }
            for i in 0..PART {
                for j in first + i..first + PART {
                    for k in 0..K {
                        p[first + i][j] = shares[i][k].neg_mul_add(taken[k].cross[j], p[first + i][j]);
                    }
                }
            }
            for j in first + PART..STATES {
                for i in 0..PART {
                    let mut entry = p[first + i][j];
                    for k in 0..K {
                        entry = shares[i][k].neg_mul_add(taken[k].cross[j], entry);
                    }
                    p[first + i][j] = entry;
                }
            }
        }
    }

    /// Forgets so much of the components that a scalar shows that the scalar's variance grows by `variance`.
    #[inline(always)]
    pub fn forget(&mut self, row: &Row<T>, variance: T) {
        self.catch_up();
        let (h, square) = (&row.derivatives, row.square());
        let scale = variance / (square * square).max(variance.splat(f64::MIN_POSITIVE));
        for i in 0..STATES {
            for j in i..STATES {
                self.covariance[i][j] += h[i] * h[j] * scale;
            }
        }
    }

    /// The error found so far, which is none from then on.
    #[inline(always)]
    pub fn take(&mut self) -> Components<T> {
        self.catch_up();
        let none = [self.error[0].zero(); STATES];
        std::mem::replace(&mut self.error, none)
    }
}
