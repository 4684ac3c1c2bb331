//! The wide vectors of this processor, on which tests compare lanes with plain numbers; one set, compiled once.

use fearless_simd::Level;

/// The instruction set.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
pub type Wide = fearless_simd::x86::Avx2;

/// The instruction set.
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
pub type Wide = fearless_simd::Neon;

/// The wide vectors; `None` where this processor has none.
pub fn wide() -> Option<Wide> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    return Level::new().as_avx2();
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    Level::new().as_neon()
}
