//! One row of the Jacobian of an observation.
//!
//! Tests: `tests/filter/error_state.rs`, `tests/filter/observation.rs`.

use super::estimate::{Components, STATES};
use crate::number::algebra::Vec3;
use crate::number::real::Real;

/// Components come in parts of three.
pub(super) const PART: usize = 3;

/// One row of the Jacobian of an observation, and which parts of it are not zero.
#[derive(Clone, Copy, Debug)]
pub struct Row<T = f64> {
    pub(super) derivatives: Components<T>,
    pub(super) parts: u32,
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
    pub(super) fn square(&self) -> T {
        self.times(&self.derivatives)
    }
}
