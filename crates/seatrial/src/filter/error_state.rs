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
//! of the whole vector.
//!
//! Of several vehicles abreast each has its own P. What a row is without it is without for all of them, and so are the
//! times: steps and sensors are of one kind.
//!
//! Source: Bucy & Joseph, *Filtering for Stochastic Processes* (1968); Bierman, *Factorization Methods for Discrete
//! Sequential Estimation* (1977), chapter II; Farrell (2008), sections 5.5 and 6.7.
//! Tests: `tests/filter/error_state.rs` (against dense matrix algebra, millions of steps).

use super::estimate::{ATTITUDE, CURRENT, Components, FORCE, POSITION, STATES, chosen};
use crate::number::algebra::Vec3;
use crate::number::real::Real;

/// The rows of motion: position, attitude and velocity.
pub const MOTION: usize = FORCE;

/// The columns of the Jacobian of a step: attitude, velocity and force, which lie side by side.
pub const COLUMNS: usize = CURRENT - ATTITUDE;

/// The derivatives of position, attitude and velocity after a step by attitude, velocity and force before it.
pub type Block<T = f64> = [[T; COLUMNS]; MOTION];

/// Components come in parts of three.
const PART: usize = 3;

/// The columns of `F P` that a prediction asks for in all rows, and so many of them as stay in registers for three rows.
const MOVED: usize = STATES - ATTITUDE;
/// See [`MOVED`].
const WIDE: usize = 7;

/// One row of the Jacobian of an observation, and which parts of it are not zero.
#[derive(Clone, Copy, Debug)]
pub struct Row<T = f64> {
    derivatives: Components<T>,
    parts: u32,
}

impl<T: Real> Row<T> {
    /// Derivatives of parts, each from its first component on; other components have none.
    ///
    /// # Panics
    /// A part that begins at no multiple of three below [`STATES`].
    #[inline(always)]
    pub fn of<const K: usize>(parts: [(usize, Vec3<T>); K]) -> Self {
        let zero = parts[0].1[0].zero();
        let mut row = Self { derivatives: [zero; STATES], parts: 0 };
        for &(first, derivatives) in &parts {
            assert!(first % PART == 0, "a part begins at a multiple of {PART}, not at {first}");
            row.derivatives[first..first + PART].copy_from_slice(&derivatives);
            row.parts |= 1 << (first / PART);
        }
        row
    }

    /// The derivatives by all components.
    #[inline(always)]
    pub fn derivatives(&self) -> &Components<T> {
        &self.derivatives
    }

    /// The row where the mask holds, none elsewhere.
    #[inline(always)]
    pub(super) fn only(&mut self, mask: T::Mask) {
        let zero = self.derivatives[0].zero();
        for part in (0..STATES / PART).filter(|part| self.parts >> part & 1 == 1) {
            for x in &mut self.derivatives[PART * part..PART * (part + 1)] {
                *x = T::select(mask, *x, zero);
            }
        }
    }

    /// `h x`.
    #[inline(always)]
    pub fn times(&self, x: &Components<T>) -> T {
        let mut sum = x[0].zero();
        for part in 0..STATES / PART {
            if self.parts >> part & 1 == 1 {
                let k = PART * part;
                let h = &self.derivatives;
                sum = h[k].mul_add(x[k], h[k + 1].mul_add(x[k + 1], h[k + 2].mul_add(x[k + 2], sum)));
            }
        }
        sum
    }

    /// `h hᵀ`.
    #[inline(always)]
    fn square(&self) -> T {
        self.times(&self.derivatives)
    }
}

/// How a step moves the error.
#[derive(Clone, Debug)]
pub struct Transition<T = f64> {
    /// Derivatives of the motion.
    pub block: Block<T>,
    /// Displacement per velocity of the current, s.
    pub drift: f64,
    /// Diagonal of F from the force on; what stands before is not read.
    pub decay: [f64; STATES],
    /// Diagonal of Q.
    pub noise: Components<T>,
}

impl Transition {
    /// F as a full matrix, for those who compare.
    pub fn dense(&self) -> [[f64; STATES]; STATES] {
        let mut f = [[0.0; STATES]; STATES];
        for i in 0..MOTION {
            f[i][ATTITUDE..CURRENT].copy_from_slice(&self.block[i]);
        }
        for i in 0..3 {
            f[POSITION + i][POSITION + i] = 1.0;
            f[POSITION + i][CURRENT + i] = self.drift;
        }
        for i in MOTION..STATES {
            f[i][i] = self.decay[i];
        }
        f
    }
}

impl<T: Real> Transition<T> {
    /// A step that changes nothing, in the kind of `unit`.
    #[inline(always)]
    pub fn identity(unit: T) -> Self {
        let (zero, one) = (unit.zero(), unit.splat(1.0));
        let mut block = [[zero; COLUMNS]; MOTION];
        for i in ATTITUDE..MOTION {
            block[i][i - ATTITUDE] = one;
        }
        Self { block, drift: 0.0, decay: [1.0; STATES], noise: [zero; STATES] }
    }
}

/// The way back over a step: F⁻¹, which has the shape of F.
#[derive(Clone, Debug)]
pub struct Return<T = f64> {
    /// Position, attitude and velocity before the step by attitude, velocity and force after it.
    block: Block<T>,
    /// Displacement per velocity of the current, s.
    drift: f64,
    /// Diagonal of F⁻¹ from the force on.
    growth: [f64; STATES],
}

impl<T: Real> Return<T> {
    /// The way back from nowhere.
    #[inline(always)]
    pub fn identity(unit: T) -> Self {
        let Transition { block, drift, decay, .. } = Transition::identity(unit);
        Self { block, drift, growth: decay }
    }

    /// The row `y = h F⁻¹`: what a row of before the step is after it.
    #[inline(always)]
    pub fn carry(&self, row: &Row<T>) -> Row<T> {
        let h = &row.derivatives;
        let mut sum = [h[0].zero(); COLUMNS];
        for part in 0..MOTION / PART {
            if row.parts >> part & 1 == 0 {
                continue;
            }
            for i in PART * part..PART * (part + 1) {
                for k in 0..COLUMNS {
                    sum[k] = h[i].mul_add(self.block[i][k], sum[k]);
                }
            }
        }
        let mut y = *h;
        y[ATTITUDE..CURRENT].copy_from_slice(&sum);
        for i in FORCE..CURRENT {
            y[i] += h[i] * self.growth[i];
        }
        for i in 0..3 {
            y[CURRENT + i] -= h[POSITION + i] * self.drift;
        }
        for i in CURRENT..STATES {
            y[i] = y[i] * self.growth[i];
        }
        let placed = row.parts & 1;
        Row { derivatives: y, parts: row.parts | TURNED | (placed << (CURRENT / PART)) }
    }
}

/// The parts that a step mixes into every row: attitude, velocity and force.
const TURNED: u32 = ((1 << (CURRENT / PART)) - 1) & !1;

/// A diagonal of the derivatives of a step by which nothing is divided.
const SMALL: f64 = 0.1;

/// The columns of attitude and velocity, before those of the force.
const TURNING: usize = FORCE - ATTITUDE;

impl<T: Real> Transition<T> {
    /// The way back: with A the derivatives of attitude and velocity by themselves, B those by force, C and E those of the
    /// position by both, and D the decay of the force,
    /// `F⁻¹ = [I, −C A⁻¹, (C A⁻¹ B − E) D⁻¹; 0, A⁻¹, −A⁻¹ B D⁻¹]` in the columns of [`Block`].
    #[inline(always)]
    pub fn reverse(&self, back: &mut Return<T>) {
        let zero = self.block[0][0].zero();
        let one = zero.splat(1.0);
        // Gauss and Jordan in place, B carried along: A⁻¹ and A⁻¹ B. The diagonal leads, unless the vehicle turns by nearly
        // a right angle within a step.
        let (place, work) = back.block.split_at_mut(ATTITUDE);
        work.copy_from_slice(&self.block[ATTITUDE..]);
        let mut swaps = Swaps { with: [zero; TURNING], any: 0 };
        for k in 0..TURNING {
            let small = work[k][k].abs().lt(zero.splat(SMALL));
            if T::any(small) {
                swaps.lead(work, k, small);
            }
            // The place of the leading column is taken by that of the inverse.
            let scale = one / work[k][k];
            for j in 0..COLUMNS {
                work[k][j] *= scale;
            }
            work[k][k] = scale;
            let lead = work[k];
            for i in (0..TURNING).filter(|&i| i != k) {
                let share = work[i][k];
                work[i][k] = zero;
                for j in 0..COLUMNS {
                    work[i][j] = share.neg_mul_add(lead[j], work[i][j]);
                }
            }
        }
        swaps.back(work);
        let mut growth = [1.0; STATES];
        for i in FORCE..STATES {
            growth[i] = 1.0 / self.decay[i];
        }
        for i in 0..ATTITUDE {
            let mut sum = [zero; COLUMNS];
            for k in 0..TURNING {
                for j in 0..COLUMNS {
                    sum[j] = work[k][j].neg_mul_add(self.block[i][k], sum[j]);
                }
            }
            for j in TURNING..COLUMNS {
                sum[j] = (sum[j] + self.block[i][j]) * -growth[ATTITUDE + j];
            }
            place[i] = sum;
        }
        for i in 0..TURNING {
            for j in TURNING..COLUMNS {
                work[i][j] = work[i][j] * -growth[ATTITUDE + j];
            }
        }
        (back.drift, back.growth) = (self.drift, growth);
    }
}

/// Which row took the place of another, vehicle by vehicle.
struct Swaps<T> {
    /// The row that came to each place; read where a bit is set.
    with: [T; TURNING],
    any: u32,
}

impl<T: Real> Swaps<T> {
    /// Brings the row of the largest entry of a column to its diagonal where the mask holds.
    #[inline(always)]
    fn lead(&mut self, work: &mut [[T; COLUMNS]], k: usize, mask: T::Mask) {
        let (mut place, mut most) = (work[k][k].splat(k as f64), work[k][k].abs());
        for i in k + 1..TURNING {
            let larger = T::both(mask, most.lt(work[i][k].abs()));
            place = T::select(larger, place.splat(i as f64), place);
            most = T::select(larger, work[i][k].abs(), most);
        }
        self.with[k] = place;
        self.any |= 1 << k;
        for i in k + 1..TURNING {
            let here = is(place, i);
            let (a, b) = (work[k], work[i]);
            (work[k], work[i]) = (chosen(here, &b, &a), chosen(here, &a, &b));
        }
    }

    /// What was done to the rows undone on the columns of the inverse.
    #[inline(always)]
    fn back(&self, work: &mut [[T; COLUMNS]]) {
        for k in (0..TURNING).rev().filter(|k| self.any >> k & 1 == 1) {
            for i in k + 1..TURNING {
                let here = is(self.with[k], i);
                for row in work.iter_mut() {
                    let (a, b) = (row[k], row[i]);
                    (row[k], row[i]) = (T::select(here, b, a), T::select(here, a, b));
                }
            }
        }
    }
}

/// Where a number is `i`.
#[inline(always)]
fn is<T: Real>(x: T, i: usize) -> T::Mask {
    (x - i as f64).abs().lt(x.splat(0.5))
}

/// What an observation says against what was expected of it.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<T = f64> {
    /// Residual less the error found so far: measured minus expected.
    pub value: T,
    /// Its variance.
    pub variance: T,
    /// Covariance with the error, `P hᵀ`.
    pub cross: Components<T>,
}

impl<T: Real> Innovation<T> {
    /// The normalised innovation squared: χ² of one degree of freedom where the filter is consistent.
    #[inline(always)]
    pub fn normalised_squared(&self) -> T {
        self.value * self.value / self.variance
    }
}

/// The error of an estimate: its covariance, and what observations have found of it and is not yet injected.
#[derive(Clone, Debug)]
pub struct ErrorState<T = f64> {
    /// P: its upper triangle, what stands below is not read.
    pub covariance: [[T; STATES]; STATES],
    /// The mean of the error.
    pub error: Components<T>,
    /// F P under way: rows of motion, columns from the attitude on.
    moved: [[T; MOVED]; MOTION],
}

impl ErrorState {
    /// P in full.
    pub fn dense(&self) -> [[f64; STATES]; STATES] {
        let mut dense = self.covariance;
        for i in 0..STATES {
            for j in 0..i {
                dense[i][j] = dense[j][i];
            }
        }
        dense
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
        Self { covariance, error: [zero; STATES], moved: [[zero; MOVED]; MOTION] }
    }

    /// Begins anew where the mask holds.
    #[inline(always)]
    pub fn renew(&mut self, mask: T::Mask, deviations: &Components<T>) {
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
        let variance = self.covariance[i][i];
        variance.max(variance.zero()).sqrt()
    }

    /// `P ← F P Fᵀ + Q`.
    #[inline(always)]
    pub fn predict(&mut self, step: &Transition<T>) {
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
        for i in 0..STATES {
            p[i][i] += step.noise[i];
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
    pub fn innovation(&self, row: &Row<T>, residual: T, variance: T) -> Innovation<T> {
        let (h, p) = (&row.derivatives, &self.covariance);
        let mut cross = [variance.zero(); STATES];
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
        Innovation { value: residual - row.times(&self.error), variance: row.times(&cross) + variance, cross }
    }

    /// Takes a scalar where the mask holds: mean and covariance of the error after it.
    #[inline(always)]
    pub fn update(&mut self, row: &Row<T>, innovation: &Innovation<T>, variance: T, mask: T::Mask) {
        let (p, c) = (&mut self.covariance, &innovation.cross);
        let zero = variance.zero();
        let scale = T::select(mask, zero.splat(1.0) / innovation.variance, zero);
        let value = T::select(mask, innovation.value, zero);
        // B = (I − K h) P; then B (I − K h)ᵀ + K r Kᵀ = B − (B hᵀ − r K) Kᵀ, where B hᵀ = P hᵀ − K (h P hᵀ). All of it
        // is a multiple of P hᵀ in every row.
        let seen = row.times(c) + variance;
        for i in 0..STATES {
            let gain = c[i] * scale;
            self.error[i] = gain.mul_add(value, self.error[i]);
            let part = gain.neg_mul_add(seen, c[i]).mul_add(scale, gain);
            for j in i..STATES {
                p[i][j] = part.neg_mul_add(c[j], p[i][j]);
            }
        }
    }

    /// Forgets so much of the components that a scalar shows that the scalar's variance grows by `variance`.
    #[inline(always)]
    pub fn forget(&mut self, row: &Row<T>, variance: T) {
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
        let none = [self.error[0].zero(); STATES];
        std::mem::replace(&mut self.error, none)
    }
}
