//! The number type of the model.
//!
//! The physics is written once, generic over [`Real`], and runs on
//! * `f64`: one vehicle;
//! * [`Lanes`](crate::number::lanes::Lanes): eight `f64` side by side, one candidate per lane;
//! * [`Dual`](crate::number::dual::Dual): a value with its partial derivatives, for exact sensitivities;
//! * [`Traced`](crate::number::traced::Traced): what is done is recorded, for programs that run elsewhere.
//!
//! A branch on a value is a [`Real::select`] on a mask, so that every lane takes its own branch. A
//! constant of the right kind is made from a value at hand: `x.splat(2.0)`.
//!
//! Tests: `tests/scalars.rs` (the number types agree, elementary functions within 2 ulp).

use super::plain;
use super::random::Word;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number, or several that are computed side by side.
pub trait Real:
    Copy
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// The result of a comparison, one truth value per lane.
    type Mask: Copy;
    /// Sixty-four bits, per lane.
    type Word: Word;

    /// The constant `x` in the kind of `self`.
    fn splat(self, x: f64) -> Self;
    /// `self * b + c`; fused in lanes, two operations for `f64` (a fused call without the processor
    /// feature is ten times slower).
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `self * b - c`.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// `c - self * b`.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// `|self|`.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// The smaller of two numbers.
    fn min(self, other: Self) -> Self;
    /// The larger of two numbers.
    fn max(self, other: Self) -> Self;
    /// The largest integer that is not above `self`.
    fn floor(self) -> Self;
    /// Sine and cosine of an angle in rad, |angle| < 1e5.
    fn sin_cos(self) -> (Self, Self);
    /// The angle of the point (`x`, `self`) in (−π, π].
    fn atan2(self, x: Self) -> Self;
    /// `e^self`.
    fn exp(self) -> Self;
    /// The natural logarithm of a positive number.
    fn ln(self) -> Self;
    /// `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// Whether the numbers are equal in every lane: for work that can be left out without changing a bit.
    fn equals(self, other: Self) -> bool;
    /// Where both masks hold.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Where at least one of the masks holds.
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Whether the mask holds in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// `if_true` where the mask holds, `if_false` elsewhere.
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;
    /// A tabulated function: `f` returns value and slope at a point.
    ///
    /// For what arithmetic cannot express: look-ups in records and measured tables. The slope
    /// carries derivatives; plain numbers ignore it.
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> Self;
    /// A list at a whole number from 0 to below `count`: as [`Real::tabulated`], for those who keep the list.
    #[inline(always)]
    fn listed(self, _count: usize, f: impl Fn(f64) -> (f64, f64)) -> Self {
        self.tabulated(f)
    }
    /// A polyline: as [`Real::tabulated`], for those who keep its knots `[x, y]`, of which the piece that ends at
    /// a place counts there.
    #[inline(always)]
    fn along(self, _knots: impl Fn() -> Vec<[f64; 2]>, f: impl Fn(f64) -> (f64, f64)) -> Self {
        self.tabulated(f)
    }
    /// The constant `double`; `single` where numbers have single precision: what keeps a quotient or a pivot off zero.
    #[inline(always)]
    fn guard(self, double: f64, _single: f64) -> Self {
        self.splat(double)
    }
    /// The bits of a whole number from 0 to 2⁵³; it has no slope.
    fn word(self) -> Self::Word;
    /// The low 32 bits of a word as a number, in the kind of `self`.
    fn of_low_half(self, word: Self::Word) -> Self;
    /// The value `self` places before the newest one in a ring, linear between neighbours; place `i` is
    /// `ring[i mod len]`. The length is a power of two; `self` is neither negative nor as long.
    fn before(self, ring: &[Self], newest: usize) -> Self;
    /// The largest value of all lanes.
    fn largest(self) -> f64;
    /// The result of `work`, in lanes a function of its own: one long function has too few registers.
    #[inline(always)]
    fn apart<R>(self, work: impl FnOnce() -> R) -> R {
        work()
    }

    /// Zero in the kind of `self`.
    #[inline(always)]
    fn zero(self) -> Self {
        self.splat(0.0)
    }

    /// The number within bounds.
    #[inline(always)]
    fn clamped(self, lowest: Self, highest: Self) -> Self {
        self.max(lowest).min(highest)
    }

    /// An angle wrapped to [−π, π).
    #[inline(always)]
    fn wrap(self) -> Self {
        let turn = std::f64::consts::TAU;
        let turns = (self * (1.0 / turn) + 0.5).floor();
        turns.neg_mul_add(self.splat(turn), self)
    }

    /// Zero where the magnitude is below 1e-30: a coast-down into denormal numbers is a hundred
    /// times slower than the motion that matters.
    #[inline(always)]
    fn flush(self) -> Self {
        Self::select(self.abs().lt(self.splat(1e-30)), self.zero(), self)
    }
}

impl Real for f64 {
    type Mask = bool;
    type Word = u64;

    #[inline(always)]
    fn splat(self, x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn mul_add(self, b: f64, c: f64) -> f64 {
        self * b + c
    }
    #[inline(always)]
    fn mul_sub(self, b: f64, c: f64) -> f64 {
        self * b - c
    }
    #[inline(always)]
    fn neg_mul_add(self, b: f64, c: f64) -> f64 {
        c - self * b
    }
    #[inline(always)]
    fn abs(self) -> f64 {
        f64::abs(self)
    }
    #[inline(always)]
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn min(self, other: f64) -> f64 {
        // The standard library's leaves the sign of a zero to the platform, and atan2 makes half a turn of it.
        if other < self || self.is_nan() { other } else { self }
    }
    #[inline(always)]
    fn max(self, other: f64) -> f64 {
        if self < other || self.is_nan() { other } else { self }
    }
    #[inline(always)]
    fn floor(self) -> f64 {
        f64::floor(self)
    }
    #[inline(always)]
    fn sin_cos(self) -> (f64, f64) {
        plain::sin_cos(self)
    }
    #[inline(always)]
    fn atan2(self, x: f64) -> f64 {
        plain::atan2(self, x)
    }
    #[inline(always)]
    fn exp(self) -> f64 {
        plain::exp(self)
    }
    #[inline(always)]
    fn ln(self) -> f64 {
        plain::ln(self)
    }
    #[inline(always)]
    fn lt(self, other: f64) -> bool {
        self < other
    }
    #[inline(always)]
    fn equals(self, other: f64) -> bool {
        self == other
    }
    #[inline(always)]
    fn both(a: bool, b: bool) -> bool {
        a && b
    }
    #[inline(always)]
    fn either(a: bool, b: bool) -> bool {
        a || b
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
    #[inline(always)]
    fn select(mask: bool, if_true: f64, if_false: f64) -> f64 {
        if mask { if_true } else { if_false }
    }
    #[inline(always)]
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> f64 {
        f(self).0
    }
    #[inline(always)]
    fn word(self) -> u64 {
        self as u64
    }
    #[inline(always)]
    fn of_low_half(self, word: u64) -> f64 {
        f64::from(word as u32)
    }
    #[inline(always)]
    fn before(self, ring: &[f64], newest: usize) -> f64 {
        let whole = f64::floor(self);
        let (i, mask) = (newest.wrapping_sub(whole as usize), ring.len() - 1);
        let from = ring[i & mask];
        (self - whole) * (ring[i.wrapping_sub(1) & mask] - from) + from
    }
    #[inline(always)]
    fn largest(self) -> f64 {
        self
    }
}
