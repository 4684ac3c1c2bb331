//! Truth values as numbers, 0 or 1 per lane, so that they can be kept in a state and joined by arithmetic: a product
//! is "and", [`Real::max`] is "or".

use crate::number::real::Real;

/// 1 where `a < b`.
#[inline(always)]
pub fn below<T: Real>(a: T, b: T) -> T {
    T::select(a.lt(b), a.splat(1.0), a.zero())
}

/// 1 where the flag is 0.
#[inline(always)]
pub fn not<T: Real>(flag: T) -> T {
    flag.splat(1.0) - flag
}

/// The mask of a flag.
#[inline(always)]
pub fn holds<T: Real>(flag: T) -> T::Mask {
    flag.splat(0.5).lt(flag)
}

/// `if_set` where the flag is 1, `otherwise` elsewhere.
#[inline(always)]
pub fn pick<T: Real>(flag: T, if_set: T, otherwise: T) -> T {
    T::select(holds(flag), if_set, otherwise)
}
