//! Random numbers that are functions of a seed, a step and a place, without a state: a candidate's noise depends on
//! nothing but its own seed, whatever its lane, thread and neighbours, and equal seeds share their numbers.
//!
//! A hash has 64 bits, and Box and Muller's method makes two normal numbers of it; [`Noise`] hands out both, one
//! after the other. The bits are drawn lane by lane, their logarithm, root and cosine are taken eight abreast.
//!
//! Source: Steele, Lea and Flood, *Fast splittable pseudorandom number generators* (2014), the finaliser
//! "variant 13"; Box and Muller (1958). Tests: `tests/closed_loop.rs::law_random_…` (moments, independence).

use super::real::Real;
use std::f64::consts::TAU;

/// 64 well-mixed bits of a seed (a whole number below 2⁵³), a step and a place.
#[inline(always)]
fn bits(seed: f64, step: usize, place: usize) -> u64 {
    let mut x = seed as u64;
    for word in [step as u64, place as u64] {
        x = mixed(x.wrapping_add(0x9e37_79b9_7f4a_7c15)) ^ word;
    }
    mixed(x.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

#[inline(always)]
fn mixed(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A number evenly distributed over (0, 1).
pub fn uniform(seed: f64, step: usize, place: usize) -> f64 {
    ((bits(seed, step, place) >> 11) as f64 + 0.5) * 2f64.powi(-53)
}

/// Two numbers evenly distributed over (0, 1), of 32 bits each.
#[inline(always)]
pub fn two_uniforms<T: Real>(seed: T, step: usize, place: usize) -> (T, T) {
    seed.two_of(|seed| {
        let bits = bits(seed, step, place);
        let half = |x: u64| (f64::from(x as u32) + 0.5) * (1.0 / 4_294_967_296.0);
        (half(bits), half(bits >> 32))
    })
}

/// Two standard normal numbers.
#[inline(always)]
pub fn gaussians<T: Real>(seed: T, step: usize, place: usize) -> (T, T) {
    let (u, v) = two_uniforms(seed, step, place);
    let radius = (u.ln() * -2.0).sqrt();
    let (sin, cos) = (v * TAU).sin_cos();
    (radius * cos, radius * sin)
}

/// A standard normal number.
pub fn gaussian(seed: f64, step: usize, place: usize) -> f64 {
    gaussians(seed, step, place).0
}

/// White noise of `N` places, sample after sample: each place takes both numbers of a draw in turn.
#[derive(Clone)]
pub struct Noise<T, const N: usize> {
    seed: T,
    first: usize,
    rest: [T; N],
}

impl<T: Real, const N: usize> Noise<T, N> {
    /// Noise of the places from `first` on.
    #[inline(always)]
    pub fn new(seed: T, first: usize) -> Self {
        Self { seed, first, rest: [seed.zero(); N] }
    }

    /// Sample `n` of a place, which follows the last one; samples count from 0.
    #[inline(always)]
    pub fn next(&mut self, place: usize, n: usize) -> T {
        if n % 2 == 1 {
            return self.rest[place];
        }
        let (now, then) = gaussians(self.seed, n / 2, self.first + place);
        self.rest[place] = then;
        now
    }
}
