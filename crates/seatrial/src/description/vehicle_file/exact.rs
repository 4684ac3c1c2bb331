//! Rows of a fixed number of numbers: one too many is as wrong as one too few, and neither is passed over.
//!
//! Tests: `tests/files.rs`.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

/// Exactly N numbers.
pub(crate) fn exactly<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<[f64; N], D::Error> {
    let row = Vec::<f64>::deserialize(deserializer)?;
    row.try_into()
        .map_err(|row: Vec<f64>| D::Error::custom(format!("expected {N} numbers, found {}", row.len())))
}

/// Exactly N numbers, of a key that may be missing.
pub(crate) fn exactly_if_given<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<Option<[f64; N]>, D::Error> {
    exactly(deserializer).map(Some)
}
