//! Wrench about O per newton of an actuator: a column of the allocation matrix.
//!
//! A thruster at `r` with unit direction `d` has the column `[d; r × d]`.
//!
//! Source: Taubert et al. (2014), equations 39–47; Fossen (2011), section 12.3.
//! Tests: `tests/golden.rs` (CWolf's levers and rank).

use crate::number::algebra::{Vec3, Vec6, cross};

/// `[d; r × d]` for a position (m) and a direction, which is normalised.
///
/// # Errors
/// When the direction has no length.
pub fn wrench_per_newton(position: &Vec3<f64>, direction: &Vec3<f64>) -> Result<Vec6<f64>, String> {
    let length = crate::number::algebra::dot(direction, direction).sqrt();
    if !(length.is_finite() && length > 0.0) {
        return Err(format!(
            "the direction {direction:?} has no length; give the direction of positive thrust"
        ));
    }
    let d = direction.map(|c| c / length);
    let [k, m, n] = cross(position, &d);
    Ok([d[0], d[1], d[2], k, m, n])
}
