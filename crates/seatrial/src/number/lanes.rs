//! Eight `f64` side by side: the number type of populations, one candidate per lane.
//!
//! The vectors come from the crate `fearless_simd`, which picks the processor's widest instruction
//! set at run time. The levels with fused multiply-add (AVX2, AVX-512) give bit-equal results; the
//! others agree to about 1e-12.

use super::elementary;
use super::random::Word;
use super::real::Real;
use fearless_simd::{Level, Simd, f64x8, mask64x8, prelude::*, u64x8};

/// Eight numbers of the instruction set `S`.
pub type Lanes<S> = f64x8<S>;

/// The number of lanes.
pub const LANES: usize = 8;

/// The environment variable that forces an instruction set.
pub const SIMD_VARIABLE: &str = "SEATRIAL_SIMD";

/// The instruction sets that this processor has, widest first, by the names that
/// `SEATRIAL_SIMD` takes.
pub fn available_levels() -> Vec<(&'static str, Level)> {
    let widest = Level::new();
    let mut levels = Vec::new();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        levels.extend(widest.as_avx512().map(|s| ("avx512", s.level())));
        levels.extend(widest.as_avx2().map(|s| ("avx2", s.level())));
        levels.extend(widest.as_sse4_2().map(|s| ("sse4.2", s.level())));
    }
    #[cfg(target_arch = "aarch64")]
    levels.extend(widest.as_neon().map(|s| ("neon", s.level())));
    let _ = widest;
    levels.push(("fallback", Level::fallback()));
    levels
}

/// The instruction set in use: the widest, or the one that `SEATRIAL_SIMD` names.
///
/// An unknown or unavailable name is an error that lists the available ones.
pub fn level() -> Result<(&'static str, Level), crate::Error> {
    let levels = available_levels();
    match std::env::var(SIMD_VARIABLE) {
        Err(_) => Ok(levels[0]),
        Ok(wanted) => levels.iter().find(|(name, _)| *name == wanted).copied().ok_or_else(|| {
            let names: Vec<&str> = levels.iter().map(|(name, _)| *name).collect();
            crate::Error::simulation(format!(
                "{SIMD_VARIABLE}: this processor offers {}, found {wanted:?}; unset the variable to use the widest",
                names.join(", ")
            ))
        }),
    }
}

/// The result of `work` on plain numbers, compiled once more for the wide vectors of an instruction set; the same bits on all.
#[inline(always)]
pub fn wide<R>(level: Level, work: impl FnOnce() -> R) -> R {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(work);
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(work);
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(work);
    }
    let _ = level;
    work()
}

/// 2⁵²: from here on the last bit of a number counts whole ones.
const TWO_52: f64 = 4_503_599_627_370_496.0;

impl<S: Simd> Word for u64x8<S> {
    #[inline(always)]
    fn splat(self, x: u64) -> Self {
        self.simd.splat_u64x8(x)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self * other
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        self ^ other
    }
    #[inline(always)]
    fn right(self, by: u32) -> Self {
        self >> by
    }
}

impl<S: Simd> Real for Lanes<S> {
    type Mask = mask64x8<S>;
    type Word = u64x8<S>;

    #[inline(always)]
    fn splat(self, x: f64) -> Self {
        self.simd.splat_f64x8(x)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.simd.mul_add_f64x8(self, b, c)
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self.simd.mul_sub_f64x8(self, b, c)
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        self.simd.mul_add_f64x8(-self, b, c)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.simd.abs_f64x8(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.simd.sqrt_f64x8(self)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.simd.min_f64x8(self, other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.simd.max_f64x8(self, other)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.simd.floor_f64x8(self)
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        elementary::sin_cos(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        elementary::atan2(self, x)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        elementary::exp(self)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        elementary::ln(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> mask64x8<S> {
        self.simd.simd_lt_f64x8(self, other)
    }
    #[inline(always)]
    fn equals(self, other: Self) -> bool {
        self.simd.simd_eq_f64x8(self, other).all_true()
    }
    #[inline(always)]
    fn both(a: mask64x8<S>, b: mask64x8<S>) -> mask64x8<S> {
        a & b
    }
    #[inline(always)]
    fn either(a: mask64x8<S>, b: mask64x8<S>) -> mask64x8<S> {
        a | b
    }
    #[inline(always)]
    fn any(mask: mask64x8<S>) -> bool {
        mask.any_true()
    }
    #[inline(always)]
    fn select(mask: mask64x8<S>, if_true: Self, if_false: Self) -> Self {
        mask.select(if_true, if_false)
    }
    /// Lane by lane; once for all when the lanes are equal, which is the common case (the same
    /// recorded command at the same dead time).
    #[inline(always)]
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> Self {
        let points: [f64; LANES] = self.into();
        if self.equals(self.splat(points[0])) {
            return self.splat(f(points[0]).0);
        }
        let mut values = [0.0; LANES];
        for lane in 0..LANES {
            values[lane] = f(points[lane]).0;
        }
        f64x8::simd_from(self.simd, values)
    }
    #[inline(always)]
    fn word(self) -> u64x8<S> {
        let numbers: [f64; LANES] = self.into();
        u64x8::from_fn(self.simd, |lane| numbers[lane] as u64)
    }
    /// As the mantissa of a number from 2⁵² on, which is exact.
    #[inline(always)]
    fn of_low_half(self, word: u64x8<S>) -> Self {
        let mantissa = word & self.simd.splat_u64x8(0xffff_ffff);
        elementary::number(mantissa | self.simd.splat_u64x8(TWO_52.to_bits())) - TWO_52
    }
    #[inline(always)]
    fn before(self, ring: &[Self], newest: usize) -> Self {
        let whole = Real::floor(self);
        let mask = ring.len() - 1;
        let places: [f64; LANES] = whole.into();
        let (from, to) = if whole.equals(self.splat(places[0])) {
            let i = newest.wrapping_sub(places[0] as usize);
            (ring[i & mask], ring[i.wrapping_sub(1) & mask])
        } else {
            let (from, to) = gathered(ring, &places, newest);
            (f64x8::simd_from(self.simd, from), f64x8::simd_from(self.simd, to))
        };
        Real::mul_add(self - whole, to - from, from)
    }
    #[inline(always)]
    fn largest(self) -> f64 {
        let values: [f64; LANES] = self.into();
        values.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
    #[inline(always)]
    fn apart<R>(self, work: impl FnOnce() -> R) -> R {
        self.simd.vectorize(work)
    }
}

/// Per lane the values so many places before the newest one in a ring, and one more. Out of line: it is rare, and
/// long code in the hot loop costs more than the call.
#[inline(never)]
fn gathered<S: Simd>(
    ring: &[Lanes<S>],
    places: &[f64; LANES],
    newest: usize,
) -> ([f64; LANES], [f64; LANES]) {
    let mask = ring.len() - 1;
    let (mut from, mut to) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let i = newest.wrapping_sub(places[lane] as usize);
        from[lane] = ring[i & mask][lane];
        to[lane] = ring[i.wrapping_sub(1) & mask][lane];
    }
    (from, to)
}
