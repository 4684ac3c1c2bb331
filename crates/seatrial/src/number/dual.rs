//! A number and its partial derivatives: exact sensitivities of whatever is written over [`Real`].
//!
//! `Dual<Lanes<S>>` carries eight partials, one per lane; `Dual<f64>` one. The value is computed with
//! the very operations of `f64`, so it equals the plain model's bit for bit. Derivatives are finite
//! everywhere, at rest too: |x|, √x and atan2 have derivative zero where none exists.
//!
//! Source: forward accumulation, Griewank & Walther, *Evaluating Derivatives* (2008), chapter 3.
//! Tests: `tests/scalars/dual.rs` (every operation against finite differences, values against `f64`).

use super::plain;
use super::real::Real;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value and its partial derivatives, side by side in a number of kind `P`.
#[derive(Clone, Copy, Debug)]
pub struct Dual<P> {
    /// The value.
    pub value: f64,
    /// Derivatives by one unknown per lane.
    pub partials: P,
}

/// A number that stands at one place: `f64` and [`Dual`].
pub trait Valued: Real {
    /// The value without its derivatives.
    fn value(self) -> f64;
}

impl Valued for f64 {
    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
}

impl<P: Real> Valued for Dual<P> {
    #[inline(always)]
    fn value(self) -> f64 {
        self.value
    }
}

impl<P: Real> Dual<P> {
    /// The function value `value` whose derivative by this number is `slope`.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, partials: self.partials * slope }
    }
}

impl<P: Real> Neg for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, partials: -self.partials }
    }
}

impl<P: Real> Add for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { value: self.value + b.value, partials: self.partials + b.partials }
    }
}

impl<P: Real> Sub for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { value: self.value - b.value, partials: self.partials - b.partials }
    }
}

impl<P: Real> Mul for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let p = self.partials;
        Self { value: self.value * b.value, partials: p.mul_add(p.splat(b.value), b.partials * self.value) }
    }
}

impl<P: Real> Div for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let value = self.value / b.value;
        let p = b.partials.neg_mul_add(b.partials.splat(value), self.partials);
        Self { value, partials: p * (1.0 / b.value) }
    }
}

impl<P: Real> Add<f64> for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: f64) -> Self {
        Self { value: self.value + b, ..self }
    }
}

impl<P: Real> Sub<f64> for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: f64) -> Self {
        Self { value: self.value - b, ..self }
    }
}

impl<P: Real> Mul<f64> for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: f64) -> Self {
        self.chain(self.value * b, b)
    }
}

impl<P: Real> Div<f64> for Dual<P> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: f64) -> Self {
        self.chain(self.value / b, 1.0 / b)
    }
}

impl<P: Real> AddAssign for Dual<P> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<P: Real> SubAssign for Dual<P> {
    #[inline(always)]
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<P: Real> MulAssign for Dual<P> {
    #[inline(always)]
    fn mul_assign(&mut self, b: Self) {
        *self = *self * b;
    }
}

impl<P: Real> Real for Dual<P> {
    type Mask = bool;
    type Word = u64;

    #[inline(always)]
    fn splat(self, x: f64) -> Self {
        Self { value: x, partials: self.partials.zero() }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        let p = self.partials;
        let partials = p.mul_add(p.splat(b.value), b.partials.mul_add(p.splat(self.value), c.partials));
        Self { value: self.value * b.value + c.value, partials }
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        let p = self.partials;
        let partials = p.mul_add(p.splat(b.value), b.partials.mul_sub(p.splat(self.value), c.partials));
        Self { value: self.value * b.value - c.value, partials }
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        let p = self.partials;
        let partials =
            p.neg_mul_add(p.splat(b.value), b.partials.neg_mul_add(p.splat(self.value), c.partials));
        Self { value: c.value - self.value * b.value, partials }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let sign = if self.value == 0.0 { 0.0 } else { self.value.signum() };
        self.chain(self.value.abs(), sign)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root == 0.0 { 0.0 } else { 0.5 / root })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if other.value < self.value { other } else { self }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self.value < other.value { other } else { self }
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.splat(self.value.floor())
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = plain::sin_cos(self.value);
        (self.chain(sine, cosine), self.chain(cosine, -sine))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        // Infinite at the origin, and so near to it that the square underflows.
        let scale = 1.0 / (self.value * self.value + x.value * x.value);
        let scale = if scale.is_infinite() { 0.0 } else { scale };
        let p = self.partials;
        let partials = p.mul_sub(p.splat(x.value * scale), x.partials * (self.value * scale));
        Self { value: plain::atan2(self.value, x.value), partials }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let value = plain::exp(self.value);
        self.chain(value, value)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(plain::ln(self.value), 1.0 / self.value)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.value < other.value
    }
    #[inline(always)]
    fn equals(self, other: Self) -> bool {
        self.value == other.value && self.partials.equals(other.partials)
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
    fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
        if mask { if_true } else { if_false }
    }
    #[inline(always)]
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> Self {
        let (value, slope) = f(self.value);
        self.chain(value, slope)
    }
    #[inline(always)]
    fn word(self) -> u64 {
        self.value.word()
    }
    #[inline(always)]
    fn of_low_half(self, word: u64) -> Self {
        self.splat(self.value.of_low_half(word))
    }
    #[inline(always)]
    fn before(self, ring: &[Self], newest: usize) -> Self {
        let whole = self.value.floor();
        let (i, mask) = (newest.wrapping_sub(whole as usize), ring.len() - 1);
        let (from, to) = (ring[i & mask], ring[i.wrapping_sub(1) & mask]);
        let (share, rise) = (self.value - whole, to.value - from.value);
        let p = (to.partials - from.partials).mul_add(self.partials.splat(share), from.partials);
        Self { value: share * rise + from.value, partials: self.partials.mul_add(p.splat(rise), p) }
    }
    #[inline(always)]
    fn largest(self) -> f64 {
        self.value
    }
    /// A vehicle at rest still answers to its unknowns: value and partials are flushed each by itself.
    #[inline(always)]
    fn flush(self) -> Self {
        Self { value: self.value.flush(), partials: self.partials.flush() }
    }
}
