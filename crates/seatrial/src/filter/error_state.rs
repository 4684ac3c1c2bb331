//! The covariance of the error of a state: predicted through the Jacobian of a step, updated by one scalar at a time.
//!
//! Prediction: `P ← F P Fᵀ + Q`. F has the shape of the state ([`super::estimate`]): twelve rows of motion that depend on
//! attitude, velocity, force and, for the position, the current; below them a diagonal. The products that this shape
//! makes zero are left out.
//!
//! Update by `z = h x + v`, `v ~ (0, r)`: `s = h P hᵀ + r`, `K = P hᵀ/s`, and in Joseph form
//! `P ← (I − K h) P (I − K h)ᵀ + K r Kᵀ`: a sum of two positive semidefinite matrices, whatever rounding does to K.
//! The rows of several uncorrelated scalars may be taken at the same state: the error found so far is subtracted from
//! each residual, and moved into the state once. Then the sum of `ν²/s` over them is the normalised innovation squared
//! of the whole vector.
//!
//! Source: Bucy & Joseph, *Filtering for Stochastic Processes* (1968); Bierman, *Factorization Methods for Discrete
//! Sequential Estimation* (1977), chapter II; Farrell (2008), sections 5.5 and 6.7.
//! Tests: `tests/filter/error_state.rs` (against dense matrix algebra, millions of steps).

use super::estimate::{ATTITUDE, CURRENT, FORCE, POSITION, STATES};
use crate::number::lanes::LANES;
use fearless_simd::{Simd, SimdBase, f64x8};

/// The rows of motion: position, attitude and velocity.
pub const MOTION: usize = FORCE;

/// The columns of the Jacobian of a step: attitude, velocity and force; one more to fill two vectors.
pub const COLUMNS: usize = 16;

/// The derivatives of position, attitude and velocity after a step by attitude, velocity and force before it.
pub type Block = [[f64; COLUMNS]; MOTION];

/// The columns in use: attitude, velocity and force lie side by side.
pub const USED: usize = CURRENT - ATTITUDE;

/// Components come in parts of three.
const PART: usize = 3;

/// One row of the Jacobian of an observation, and which parts of it are not zero.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    derivatives: [f64; STATES],
    parts: u32,
}

impl Row {
    /// Derivatives of parts, each from its first component on; other components have none.
    ///
    /// # Panics
    /// A part that begins at no multiple of three below [`STATES`].
    #[inline(always)]
    pub fn of<const K: usize>(parts: [(usize, [f64; PART]); K]) -> Self {
        let mut row = Self { derivatives: [0.0; STATES], parts: 0 };
        for &(first, derivatives) in &parts {
            assert!(first % PART == 0, "a part begins at a multiple of {PART}, not at {first}");
            row.derivatives[first..first + PART].copy_from_slice(&derivatives);
            row.parts |= 1 << (first / PART);
        }
        row
    }

    /// The derivatives by all components.
    #[inline(always)]
    pub fn derivatives(&self) -> &[f64; STATES] {
        &self.derivatives
    }

    /// `h x`.
    #[inline(always)]
    pub fn times<const N: usize>(&self, x: &[f64; N]) -> f64 {
        let mut sum = 0.0;
        for part in 0..STATES / PART {
            if self.parts >> part & 1 == 1 {
                let k = PART * part;
                let h = &self.derivatives;
                sum += h[k] * x[k] + h[k + 1] * x[k + 1] + h[k + 2] * x[k + 2];
            }
        }
        sum
    }

    /// `h hᵀ`.
    #[inline(always)]
    fn square(&self) -> f64 {
        self.times(&self.derivatives)
    }
}

/// How a step moves the error.
#[derive(Clone, Debug)]
pub struct Transition<const N: usize> {
    /// Derivatives of the motion.
    pub block: Block,
    /// Displacement per velocity of the current, s.
    pub drift: f64,
    /// Diagonal of F from the force on; what stands before is not read.
    pub decay: [f64; N],
    /// Diagonal of Q.
    pub noise: [f64; N],
}

impl<const N: usize> Transition<N> {
    /// A step that changes nothing.
    pub fn identity() -> Self {
        let mut block = [[0.0; COLUMNS]; MOTION];
        for i in ATTITUDE..MOTION {
            block[i][i - ATTITUDE] = 1.0;
        }
        Self { block, drift: 0.0, decay: [1.0; N], noise: [0.0; N] }
    }

    /// F as a full matrix, for those who compare.
    pub fn dense(&self) -> [[f64; N]; N] {
        let mut f = [[0.0; N]; N];
        for i in 0..MOTION {
            f[i][ATTITUDE..CURRENT].copy_from_slice(&self.block[i][..USED]);
        }
        for i in 0..3 {
            f[POSITION + i][POSITION + i] = 1.0;
            f[POSITION + i][CURRENT + i] = self.drift;
        }
        for i in MOTION..N {
            f[i][i] = self.decay[i];
        }
        f
    }

    /// The block by columns, along which vectors run; filled up with zeros to two of them.
    #[inline(always)]
    fn columns(&self) -> [[f64; 2 * LANES]; USED] {
        let mut columns = [[0.0; 2 * LANES]; USED];
        for i in 0..MOTION {
            for k in 0..USED {
                // One by one: vectors would gather and scatter.
                columns[k][i] = std::hint::black_box(self.block[i][k]);
            }
        }
        columns
    }
}

/// The way back over a step: F⁻¹, which has the shape of F.
#[derive(Clone, Debug)]
pub struct Return {
    /// Position, attitude and velocity before the step by attitude, velocity and force after it.
    block: Block,
    /// Displacement per velocity of the current, s.
    drift: f64,
    /// Diagonal of F⁻¹ from the force on.
    growth: [f64; STATES],
}

impl Return {
    /// The way back from nowhere.
    pub fn identity() -> Self {
        let Transition { block, drift, decay, .. } = Transition::identity();
        Self { block, drift, growth: decay }
    }

    /// The row `y = h F⁻¹`: what a row of before the step is after it.
    #[inline(always)]
    pub fn carry(&self, row: &Row) -> Row {
        let h = &row.derivatives;
        let mut sum = [0.0; COLUMNS];
        for part in 0..MOTION / PART {
            if row.parts >> part & 1 == 0 {
                continue;
            }
            for i in PART * part..PART * (part + 1) {
                for k in 0..COLUMNS {
                    sum[k] += h[i] * self.block[i][k];
                }
            }
        }
        let mut y = *h;
        y[ATTITUDE..CURRENT].copy_from_slice(&sum[..USED]);
        for i in FORCE..CURRENT {
            y[i] += h[i] * self.growth[i];
        }
        for i in 0..3 {
            y[CURRENT + i] -= self.drift * h[POSITION + i];
        }
        for i in CURRENT..STATES {
            y[i] *= self.growth[i];
        }
        let placed = row.parts & 1;
        Row { derivatives: y, parts: row.parts | TURNED | (placed << (CURRENT / PART)) }
    }
}

/// The parts that a step mixes into every row: attitude, velocity and force.
const TURNED: u32 = ((1 << (CURRENT / PART)) - 1) & !1;

/// A diagonal of the derivatives of a step by which nothing is divided.
const SMALL: f64 = 0.1;

/// The unit vectors of the first columns, in two groups.
const UNIT: [[[f64; LANES]; 2]; COLUMNS] = {
    let mut unit = [[[0.0; LANES]; 2]; COLUMNS];
    let mut k = 0;
    while k < COLUMNS {
        unit[k][k / LANES][k % LANES] = 1.0;
        k += 1;
    }
    unit
};

impl Transition<STATES> {
    /// The way back: with A the derivatives of attitude and velocity by themselves, B those by force, C and E those of the
    /// position by both, and D the decay of the force,
    /// `F⁻¹ = [I, −C A⁻¹, (C A⁻¹ B − E) D⁻¹; 0, A⁻¹, −A⁻¹ B D⁻¹]` in the columns of [`Block`].
    #[inline(always)]
    pub fn reversed<S: Simd>(&self, simd: S) -> Return {
        const TURNING: usize = FORCE - ATTITUDE;
        let vector = |row: &[f64; COLUMNS], first: usize| f64x8::from_slice(simd, &row[first..first + LANES]);
        // Gauss and Jordan in place, B carried along: A⁻¹ and A⁻¹ B. The diagonal leads, unless the vehicle turns by nearly
        // a right angle within a step.
        let mut work = [[0.0; COLUMNS]; TURNING];
        work.copy_from_slice(&self.block[ATTITUDE..]);
        let mut leading = [0; TURNING];
        for k in 0..TURNING {
            leading[k] = k;
            if work[k][k].abs() < SMALL {
                leading[k] =
                    (k..TURNING).fold(k, |a, i| if work[i][k].abs() > work[a][k].abs() { i } else { a });
                work.swap(k, leading[k]);
            }
            // The place of the leading column is taken by that of the inverse. It is made by sums of whole vectors, which a
            // vector reads back at once; one number written alone would have to wait.
            let scale = 1.0 / work[k][k];
            let shares: [f64; TURNING] = std::array::from_fn(|i| work[i][k]);
            for (g, first) in [0, LANES].into_iter().enumerate() {
                let own = f64x8::from_slice(simd, &UNIT[k][g]);
                let lead = vector(&work[k], first) * scale + own * (scale - 1.0);
                for i in 0..TURNING {
                    let rest = if i == k { lead } else { vector(&work[i], first) - (lead + own) * shares[i] };
                    rest.store_slice(&mut work[i][first..first + LANES]);
                }
            }
        }
        for k in (0..TURNING).rev().filter(|&k| leading[k] != k) {
            for row in &mut work {
                row.swap(k, leading[k]);
            }
        }
        let mut block = [[0.0; COLUMNS]; MOTION];
        for i in 0..ATTITUDE {
            for first in [0, LANES] {
                let mut sum = simd.splat_f64x8(0.0);
                for k in 0..TURNING {
                    sum -= vector(&work[k], first) * self.block[i][k];
                }
                sum.store_slice(&mut block[i][first..first + LANES]);
            }
            for j in TURNING..USED {
                block[i][j] = -(block[i][j] + self.block[i][j]);
            }
        }
        for i in 0..TURNING {
            block[ATTITUDE + i] = work[i];
            for j in TURNING..USED {
                block[ATTITUDE + i][j] = -work[i][j];
            }
        }
        let mut growth = [1.0; STATES];
        for i in FORCE..STATES {
            growth[i] = 1.0 / self.decay[i];
        }
        for row in &mut block {
            for j in TURNING..USED {
                row[j] *= growth[ATTITUDE + j];
            }
        }
        Return { block, drift: self.drift, growth }
    }
}

/// What an observation says against what was expected of it.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const N: usize> {
    /// Residual less the error found so far: measured minus expected.
    pub value: f64,
    /// Its variance.
    pub variance: f64,
    /// Covariance with the error, `P hᵀ`.
    pub cross: [f64; N],
}

impl<const N: usize> Innovation<N> {
    /// The normalised innovation squared: χ² of one degree of freedom where the filter is consistent.
    #[inline(always)]
    pub fn normalised_squared(&self) -> f64 {
        self.value * self.value / self.variance
    }
}

/// The error of an estimate: its covariance, and what observations have found of it and is not yet injected.
///
/// On the boundary of a cache line, so that no vector of a row of the covariance spans two of them.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub struct ErrorState<const N: usize> {
    /// P.
    pub covariance: [[f64; N]; N],
    /// The mean of the error.
    pub error: [f64; N],
}

impl<const N: usize> ErrorState<N> {
    /// An error of independent components with these standard deviations.
    pub fn new(deviations: &[f64; N]) -> Self {
        let mut covariance = [[0.0; N]; N];
        for i in 0..N {
            covariance[i][i] = deviations[i] * deviations[i];
        }
        Self { covariance, error: [0.0; N] }
    }

    /// The standard deviation of a component.
    #[inline]
    pub fn deviation(&self, i: usize) -> f64 {
        self.covariance[i][i].max(0.0).sqrt()
    }

    /// `P ← F P Fᵀ + Q`; N is a multiple of [`LANES`].
    #[inline(always)]
    pub fn predict<S: Simd>(&mut self, simd: S, step: &Transition<N>) {
        let p = &mut self.covariance;
        let vector = |row: &[f64], first: usize| f64x8::from_slice(simd, &row[first..first + LANES]);
        // F P, rows of motion, eight columns at a time. Products and sums are not fused: every instruction set finds the
        // same bits.
        let mut rows = [[0.0; N]; MOTION];
        for first in (0..N).step_by(LANES) {
            for i in 0..MOTION {
                let mut sum = simd.splat_f64x8(0.0);
                if i < ATTITUDE {
                    sum = vector(&p[i], first) + vector(&p[CURRENT + i], first) * step.drift;
                }
                for k in 0..USED {
                    sum += vector(&p[ATTITUDE + k], first) * step.block[i][k];
                }
                sum.store_slice(&mut rows[i][first..first + LANES]);
            }
        }
        // Fᵀ by rows, so that the second product runs along them too.
        let transposed = step.columns();
        for i in 0..MOTION {
            let row = &rows[i];
            let mut motion = [0.0; 2 * LANES];
            for first in [0, LANES] {
                let mut sum = simd.splat_f64x8(0.0);
                for k in 0..USED {
                    sum += vector(&transposed[k], first) * row[ATTITUDE + k];
                }
                sum.store_slice(&mut motion[first..first + LANES]);
            }
            for j in 0..ATTITUDE {
                motion[j] += row[j] + step.drift * row[CURRENT + j];
            }
            p[i][..MOTION].copy_from_slice(&motion[..MOTION]);
            for j in MOTION..N {
                p[i][j] = row[j] * step.decay[j];
            }
        }
        for i in MOTION..N {
            for j in MOTION..N {
                p[i][j] *= step.decay[i] * step.decay[j];
            }
        }
        // One triangle rules: rounding leaves no asymmetry that could grow. Below the motion there is none.
        for i in 0..N {
            for j in 0..i.min(MOTION) {
                // One by one: vectors would gather down the columns.
                p[i][j] = std::hint::black_box(p[j][i]);
            }
            p[i][i] += step.noise[i];
        }
    }

    /// What a scalar of variance `variance` says whose residual at the estimate is `residual`.
    #[inline(always)]
    pub fn innovation(&self, row: &Row, residual: f64, variance: f64) -> Innovation<N> {
        // P hᵀ = (h P)ᵀ, along rows.
        let mut cross = [0.0; N];
        for part in 0..STATES / PART {
            if row.parts >> part & 1 == 0 {
                continue;
            }
            for k in PART * part..PART * (part + 1) {
                let (h, p) = (row.derivatives[k], &self.covariance[k]);
                for j in 0..N {
                    cross[j] += h * p[j];
                }
            }
        }
        Innovation { value: residual - row.times(&self.error), variance: row.times(&cross) + variance, cross }
    }

    /// Takes a scalar: mean and covariance of the error after it.
    #[inline(always)]
    pub fn update(&mut self, row: &Row, innovation: &Innovation<N>, variance: f64) {
        let (p, c) = (&mut self.covariance, &innovation.cross);
        let scale = 1.0 / innovation.variance;
        let mut gain = [0.0; N];
        for j in 0..N {
            gain[j] = c[j] * scale;
            self.error[j] += gain[j] * innovation.value;
        }
        // B = (I − K h) P; then B (I − K h)ᵀ + K r Kᵀ = B − (B hᵀ − r K) Kᵀ, where B hᵀ = P hᵀ − K (h P hᵀ). All of it
        // is a multiple of P hᵀ in every row.
        let seen = row.times(c) + variance;
        let mut parts = [0.0; N];
        for i in 0..N {
            parts[i] = gain[i] + (c[i] - gain[i] * seen) * scale;
        }
        for i in 0..N {
            // Keeps the compiler from running vectors down the columns, where it would gather and scatter.
            let taken = std::hint::black_box(parts[i]);
            for j in 0..N {
                p[i][j] -= taken * c[j];
            }
        }
    }

    /// Forgets so much of the components that a scalar shows that the scalar's variance grows by `variance`.
    pub fn forget(&mut self, row: &Row, variance: f64) {
        let scale = variance / row.square().powi(2).max(f64::MIN_POSITIVE);
        for (i, a) in row.derivatives.iter().enumerate() {
            for (j, b) in row.derivatives.iter().enumerate() {
                self.covariance[i][j] += a * b * scale;
            }
        }
    }

    /// The error found so far, which is none from then on.
    #[inline(always)]
    pub fn take(&mut self) -> [f64; N] {
        std::mem::replace(&mut self.error, [0.0; N])
    }
}
