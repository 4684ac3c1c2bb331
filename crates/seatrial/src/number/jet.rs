//! A number with its derivatives by a few unknowns, both of whatever kind: eight vehicles abreast, each with derivatives of
//! its own.
//!
//! [`Dual`](super::dual::Dual) has one value whose derivatives lie in lanes; here values lie in lanes, and the derivatives
//! beside them. Where no derivative exists the answer is that of the dual number: |x|, √x and atan2 have none at zero.
//!
//! Source: forward accumulation, Griewank & Walther, *Evaluating Derivatives* (2008), chapter 3.
//! Tests: `tests/scalars/jet.rs` (every operation against dual numbers, lane by lane).

use super::real::Real;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value and its derivatives by `N` unknowns.
#[derive(Clone, Copy, Debug)]
pub struct Jet<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its derivatives.
    pub slopes: [T; N],
}

impl<T: Real, const N: usize> Jet<T, N> {
    /// A number that depends on no unknown.
    #[inline(always)]
    pub fn constant(value: T) -> Self {
        Self { value, slopes: [value.zero(); N] }
    }

    /// The function value `value`, its derivatives made of those of two numbers.
    #[inline(always)]
    fn of(value: T, a: &Self, b: &Self, f: impl Fn(T, T) -> T) -> Self {
        let mut slopes = a.slopes;
        for i in 0..N {
            slopes[i] = f(a.slopes[i], b.slopes[i]);
        }
        Self { value, slopes }
    }

    /// The function value `value` whose derivative by this number is `slope`.
    #[inline(always)]
    fn chain(self, value: T, slope: T) -> Self {
        Self::of(value, &self, &self, |own, _| own * slope)
    }
}

impl<T: Real, const N: usize> Neg for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::of(-self.value, &self, &self, |own, _| -own)
    }
}

impl<T: Real, const N: usize> Add for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self::of(self.value + b.value, &self, &b, |x, y| x + y)
    }
}

impl<T: Real, const N: usize> Sub for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self::of(self.value - b.value, &self, &b, |x, y| x - y)
    }
}

impl<T: Real, const N: usize> Mul for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self::of(self.value * b.value, &self, &b, |x, y| x.mul_add(b.value, y * self.value))
    }
}

impl<T: Real, const N: usize> Div for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let (value, scale) = (self.value / b.value, b.value.splat(1.0) / b.value);
        Self::of(value, &self, &b, |x, y| y.neg_mul_add(value, x) * scale)
    }
}

impl<T: Real, const N: usize> Add<f64> for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: f64) -> Self {
        Self { value: self.value + b, ..self }
    }
}

impl<T: Real, const N: usize> Sub<f64> for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: f64) -> Self {
        Self { value: self.value - b, ..self }
    }
}

impl<T: Real, const N: usize> Mul<f64> for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: f64) -> Self {
        self.chain(self.value * b, self.value.splat(b))
    }
}

impl<T: Real, const N: usize> Div<f64> for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: f64) -> Self {
        self.chain(self.value / b, self.value.splat(1.0 / b))
    }
}

impl<T: Real, const N: usize> AddAssign for Jet<T, N> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<T: Real, const N: usize> SubAssign for Jet<T, N> {
    #[inline(always)]
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<T: Real, const N: usize> MulAssign for Jet<T, N> {
    #[inline(always)]
    fn mul_assign(&mut self, b: Self) {
        *self = *self * b;
    }
}

impl<T: Real, const N: usize> Real for Jet<T, N> {
    type Mask = T::Mask;
    type Word = T::Word;

    #[inline(always)]
    fn splat(self, x: f64) -> Self {
        Self::constant(self.value.splat(x))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        let rest = Self::of(c.value, &b, &c, |y, z| y.mul_add(self.value, z));
        Self::of(self.value.mul_add(b.value, c.value), &self, &rest, |x, y| x.mul_add(b.value, y))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        let rest = Self::of(c.value, &b, &c, |y, z| y.mul_sub(self.value, z));
        Self::of(self.value.mul_sub(b.value, c.value), &self, &rest, |x, y| x.mul_add(b.value, y))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        let rest = Self::of(c.value, &b, &c, |y, z| y.neg_mul_add(self.value, z));
        Self::of(self.value.neg_mul_add(b.value, c.value), &self, &rest, |x, y| x.neg_mul_add(b.value, y))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let x = self.value;
        let (zero, one) = (x.zero(), x.splat(1.0));
        let sign = T::select(x.lt(zero), -one, T::select(zero.lt(x), one, zero));
        self.chain(x.abs(), sign)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let zero = root.zero();
        self.chain(root, T::select(zero.lt(root), zero.splat(0.5) / root, zero))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(other.value.lt(self.value), other, self)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(self.value.lt(other.value), other, self)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self::constant(self.value.floor())
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = self.value.sin_cos();
        (self.chain(sine, cosine), self.chain(cosine, -sine))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        // Infinite at the origin, and so near to it that the square underflows.
        let one = x.value.splat(1.0);
        let scale = one / self.value.mul_add(self.value, x.value * x.value);
        let scale = T::select(scale.lt(one.splat(f64::INFINITY)), scale, one.zero());
        let (ahead, across) = (x.value * scale, self.value * scale);
        Self::of(self.value.atan2(x.value), &self, &x, |own, other| own.mul_sub(ahead, other * across))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), self.value.splat(1.0) / self.value)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> T::Mask {
        self.value.lt(other.value)
    }
    #[inline(always)]
    fn equals(self, other: Self) -> bool {
        self.value.equals(other.value) && (0..N).all(|i| self.slopes[i].equals(other.slopes[i]))
    }
    #[inline(always)]
    fn both(a: T::Mask, b: T::Mask) -> T::Mask {
        T::both(a, b)
    }
    #[inline(always)]
    fn either(a: T::Mask, b: T::Mask) -> T::Mask {
        T::either(a, b)
    }
    #[inline(always)]
    fn any(mask: T::Mask) -> bool {
        T::any(mask)
    }
    #[inline(always)]
    fn select(mask: T::Mask, if_true: Self, if_false: Self) -> Self {
        let value = T::select(mask, if_true.value, if_false.value);
        Self::of(value, &if_true, &if_false, |x, y| T::select(mask, x, y))
    }
    #[inline(always)]
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> Self {
        let slope = self.value.tabulated(|x| (f(x).1, 0.0));
        self.chain(self.value.tabulated(f), slope)
    }
    #[inline(always)]
    fn word(self) -> T::Word {
        self.value.word()
    }
    #[inline(always)]
    fn of_low_half(self, word: T::Word) -> Self {
        Self::constant(self.value.of_low_half(word))
    }
    fn before(self, ring: &[Self], newest: usize) -> Self {
        let part = |read: &dyn Fn(&Self) -> T| -> Vec<T> { ring.iter().map(read).collect() };
        let values = part(&|x| x.value);
        // What is whole lies a place earlier where a ring begins, and so does the rise to it.
        let whole = self.value.floor();
        let (from, to) = (whole.before(&values, newest), (whole + 1.0).before(&values, newest));
        let mut slopes = self.slopes;
        for i in 0..N {
            let own = self.value.before(&part(&|x| x.slopes[i]), newest);
            slopes[i] = slopes[i].mul_add(to - from, own);
        }
        Self { value: self.value.before(&values, newest), slopes }
    }
    #[inline(always)]
    fn largest(self) -> f64 {
        self.value.largest()
    }
    #[inline(always)]
    fn flush(self) -> Self {
        Self::of(self.value.flush(), &self, &self, |own, _| own.flush())
    }
}
