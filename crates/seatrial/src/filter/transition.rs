//! How a step moves the error, and the way back over it.
//!
//! F has the shape of the state ([`super::estimate`]): twelve rows of motion that depend on attitude, velocity, force and,
//! for the position, the current; below them a diagonal. F⁻¹ has the same. A filter that is told of gusts takes a part of the
//! unmodelled force for accelerated water: then the current follows the force, after the step.
//!
//! Source: Farrell (2008), section 5.5. Tests: `tests/filter/error_state.rs`, `tests/filter/tracker.rs`.

use super::estimate::{ATTITUDE, CURRENT, Components, FORCE, POSITION, STATES, chosen};
use super::row::{PART, Row};
use crate::number::algebra::Mat3;
use crate::number::real::Real;

/// The rows of motion: position, attitude and velocity.
pub const MOTION: usize = FORCE;

/// The columns of the Jacobian of a step: attitude, velocity and force, which lie side by side.
pub const COLUMNS: usize = CURRENT - ATTITUDE;

/// The derivatives of position, attitude and velocity after a step by attitude, velocity and force before it.
pub type Block<T = f64> = [[T; COLUMNS]; MOTION];

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
    /// Derivatives of the current by the linear unmodelled force, of which accelerated water is a part; read where `gusts`.
    pub water: Mat3<T>,
    /// Whether the filter is told of gusts.
    pub gusts: bool,
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
        for k in 0..3 {
            for j in 0..3 {
                f[CURRENT + k][FORCE + j] =
                    if self.gusts { self.water[k][j] * self.decay[FORCE + j] } else { 0.0 };
            }
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
        Self {
            block,
            drift: 0.0,
            decay: [1.0; STATES],
            noise: [zero; STATES],
            water: [[zero; 3]; 3],
            gusts: false,
        }
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
    /// See [`Transition`].
    water: Mat3<T>,
    gusts: bool,
}

impl<T: Real> Return<T> {
    /// The way back from nowhere.
    #[inline(always)]
    pub fn identity(unit: T) -> Self {
        let Transition { block, drift, decay, water, gusts, .. } = Transition::identity(unit);
        Self { block, drift, growth: decay, water, gusts }
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
        // What accelerated the water comes last on the way there, and first on the way back.
        if self.gusts {
            for j in 0..3 {
                for k in 0..3 {
                    y[FORCE + j] = y[CURRENT + k].neg_mul_add(self.water[k][j], y[FORCE + j]);
                }
            }
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
        (back.drift, back.growth, back.water, back.gusts) = (self.drift, growth, self.water, self.gusts);
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
