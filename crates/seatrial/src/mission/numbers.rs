//! What a key may hold: numbers with a meaning, or a sentence that names the key.
//!
//! Tests: `tests/mission/refusals.rs`.

use super::plane::Place;
use crate::number::real::Real;

/// The number when it is finite.
pub(super) fn finite(key: &str, x: f64) -> Result<f64, String> {
    if x.is_finite() { Ok(x) } else { Err(format!("{key}: expected a finite number, found {x}")) }
}

/// The number when it is finite and above zero.
pub(super) fn positive(key: &str, x: f64) -> Result<f64, String> {
    if x.is_finite() && x > 0.0 {
        Ok(x)
    } else {
        Err(format!("{key}: expected a positive number, found {x}"))
    }
}

/// The number when it is finite and not below zero.
pub(super) fn not_negative(key: &str, x: f64) -> Result<f64, String> {
    if x.is_finite() && x >= 0.0 {
        Ok(x)
    } else {
        Err(format!("{key}: expected zero or a positive number, found {x}"))
    }
}

/// An angle given in degrees as rad in [−π, π).
pub(super) fn angle(key: &str, degrees: f64) -> Result<f64, String> {
    Ok(finite(key, degrees)?.to_radians().wrap())
}

/// A place from its two keys.
pub(super) fn place(north: f64, east: f64) -> Result<Place, String> {
    Ok([finite("north_m", north)?, finite("east_m", east)?])
}
