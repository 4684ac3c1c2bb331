//! Elementary functions of one `f64`: the same bits on every machine.
//!
//! A flight in the page of a report is the flight of the run to the last bit, because sine, logarithm and their like
//! are the same code there as here. Those of the standard library are the platform's: glibc, Apple's library and the
//! one of WebAssembly differ in the last bit, and a limit cycle turns that into another third digit. What is taken
//! is the crate `libm` (FreeBSD's msun and musl in Rust, below 1 unit in the last place, no fused product in them);
//! beside glibc's a flight takes 0.92 to 1.02 of the time (`docs/theory/integration.md`). Square root, floor and the four operations are exact
//! everywhere. `crates/seatrial/clippy.toml` refuses the functions of the standard library in this crate; numbers in
//! lanes have [`elementary`](crate::number::elementary), and exported C has these in double precision (`export/elementary.c`).
//!
//! Tests: `tests/scalars/plain.rs`, `tests/report/test_page_same_flight.py`.

/// Sine and cosine of an angle in rad.
#[inline]
pub fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}

/// Sine of an angle in rad.
#[inline]
pub fn sin(x: f64) -> f64 {
    libm::sincos(x).0
}

/// Cosine of an angle in rad.
#[inline]
pub fn cos(x: f64) -> f64 {
    libm::sincos(x).1
}

/// Tangent of an angle in rad.
#[inline]
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// The angle from 0 to π whose cosine is `x`.
#[inline]
pub fn acos(x: f64) -> f64 {
    libm::acos(x)
}

/// The angle of the point (`x`, `y`) in (−π, π].
#[inline]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// `e^x`.
#[inline]
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// The natural logarithm.
#[inline]
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// The logarithm to the base 10.
#[inline]
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}

/// √(x² + y²).
#[inline]
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}

/// The cube root.
#[inline]
pub fn cbrt(x: f64) -> f64 {
    libm::cbrt(x)
}

/// `x^y`.
#[inline]
pub fn powf(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// `x^n` of a whole `n`, by squaring: that of the standard library may be rounded in any order.
#[inline(always)]
pub fn powi(x: f64, n: i32) -> f64 {
    let (mut product, mut square, mut left) = (1.0, x, n.unsigned_abs());
    while left > 0 {
        if left & 1 == 1 {
            product *= square;
        }
        square *= square;
        left >>= 1;
    }
    if n < 0 { 1.0 / product } else { product }
}
