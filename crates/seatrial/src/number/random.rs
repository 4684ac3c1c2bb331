//! Random numbers that are functions of a seed, a step and a place, without a state: a candidate's noise depends on
//! nothing but its own seed, whatever its lane, thread and neighbours, and equal seeds share their numbers.
//!
//! A hash has 64 bits, and Box and Muller's method makes two normal numbers of it; [`Noise`] hands out both, one
//! after the other. Hash, logarithm, root, sine and cosine are taken in lanes; the seed is hashed once.
//!
//! Source: Steele, Lea and Flood, *Fast splittable pseudorandom number generators* (2014), the finaliser
//! "variant 13"; Box and Muller (1958). Tests: `tests/closed_loop.rs::law_random_…` (moments, independence).

use super::plain;
use super::real::Real;
use std::f64::consts::TAU;

/// 64 bits; of numbers in lanes, as many to a lane.
pub trait Word: Copy {
    /// The constant `x` in the kind of `self`.
    fn splat(self, x: u64) -> Self;
    /// Sum, without the carry.
    fn plus(self, other: Self) -> Self;
    /// Product, its low 64 bits.
    fn times(self, other: Self) -> Self;
    /// Exclusive or.
    fn xor(self, other: Self) -> Self;
    /// Shifted to the right.
    fn right(self, by: u32) -> Self;
}

impl Word for u64 {
    #[inline(always)]
    fn splat(self, x: u64) -> u64 {
        x
    }
    #[inline(always)]
    fn plus(self, other: u64) -> u64 {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn times(self, other: u64) -> u64 {
        self.wrapping_mul(other)
    }
    #[inline(always)]
    fn xor(self, other: u64) -> u64 {
        self ^ other
    }
    #[inline(always)]
    fn right(self, by: u32) -> u64 {
        self >> by
    }
}

/// The next of a sequence of well-mixed words.
#[inline(always)]
fn mixed<W: Word>(x: W) -> W {
    let x = x.plus(x.splat(0x9e37_79b9_7f4a_7c15));
    let x = x.xor(x.right(30)).times(x.splat(0xbf58_476d_1ce4_e5b9));
    let x = x.xor(x.right(27)).times(x.splat(0x94d0_49bb_1331_11eb));
    x.xor(x.right(31))
}

/// The step of what is drawn once, before all others.
pub const ONCE: usize = usize::MAX;

/// A seed, from which numbers are drawn by step and place.
#[derive(Clone, Copy)]
pub struct Seed<T: Real> {
    unit: T,
    mixed: T::Word,
}

impl<T: Real> Seed<T> {
    /// Of a whole number below 2⁵³.
    #[inline(always)]
    pub fn new(seed: T) -> Self {
        Self { unit: seed.zero(), mixed: mixed(seed.word()) }
    }

    /// 64 well-mixed bits of the seed, a step and a place.
    #[inline(always)]
    fn bits(&self, step: usize, place: usize) -> T::Word {
        // The same 64 bits on machines of 32 (WebAssembly, microcontrollers) as on those of 64.
        let step = if step == ONCE { u64::MAX } else { step as u64 };
        let word = self.mixed.xor(self.mixed.splat(step));
        mixed(mixed(word).xor(word.splat(place as u64)))
    }

    /// Two numbers evenly distributed over (0, 1), of 32 bits each.
    #[inline(always)]
    pub fn two_uniforms(&self, step: usize, place: usize) -> (T, T) {
        let bits = self.bits(step, place);
        let even = |word| (self.unit.of_low_half(word) + 0.5) * (1.0 / 4_294_967_296.0);
        (even(bits), even(bits.right(32)))
    }

    /// Two standard normal numbers.
    #[inline(always)]
    pub fn gaussians(&self, step: usize, place: usize) -> (T, T) {
        let (u, v) = self.two_uniforms(step, place);
        let radius = (u.ln() * -2.0).sqrt();
        let (sin, cos) = (v * TAU).sin_cos();
        (radius * cos, radius * sin)
    }
}

/// A number evenly distributed over (0, 1).
pub fn uniform(seed: f64, step: usize, place: usize) -> f64 {
    ((Seed::new(seed).bits(step, place) >> 11) as f64 + 0.5) * plain::powi(2.0, -53)
}

/// Two standard normal numbers of a seed that is used once.
#[inline(always)]
pub fn gaussians<T: Real>(seed: T, step: usize, place: usize) -> (T, T) {
    Seed::new(seed).gaussians(step, place)
}

/// A standard normal number.
pub fn gaussian(seed: f64, step: usize, place: usize) -> f64 {
    gaussians(seed, step, place).0
}

/// White noise of `N` places, sample after sample: each place takes both numbers of a draw in turn.
#[derive(Clone)]
pub struct Noise<T: Real, const N: usize> {
    seed: Seed<T>,
    first: usize,
    rest: [T; N],
}

impl<T: Real, const N: usize> Noise<T, N> {
    /// Noise of the places from `first` on.
    #[inline(always)]
    pub fn new(seed: T, first: usize) -> Self {
        Self { seed: Seed::new(seed), first, rest: [seed.zero(); N] }
    }

    /// Sample `n` of a place, which follows the last one; samples count from 0.
    #[inline(always)]
    pub fn next(&mut self, place: usize, n: usize) -> T {
        if n % 2 == 1 {
            return self.rest[place];
        }
        let (now, then) = self.seed.gaussians(n / 2, self.first + place);
        self.rest[place] = then;
        now
    }
}
