//! Default bounds of the coefficients for their identification.
//!
//! Factors around the geometric start value: axial drag is known to 0.5–4×, cross-flow to 0.25–4×, added mass to 0.2–5×, inertia to
//! 0.3–3×; a trim that grows with the speed to a fifth of the drag either way; what has no start value gets bounds by the vehicle's weight and size, or none.

use super::values::Description;
use crate::description::coefficients::{self as names, MASS, added_mass, linear, quadratic};

/// Largest deflection at neutral that is sought, rad: a horn that sits one tooth off.
const LARGEST_OFFSET: f64 = 0.2;

/// Largest cross-flow drag coefficient that is sought: a flat plate across the flow has 2.
const LARGEST_CROSS_FLOW: f64 = 2.0;

/// Largest trim that is sought, as a share of the drag; its moment has the hull's length as arm.
const TRIM: f64 = 0.2;

impl Description {
    /// Default bounds of a coefficient for its identification, around its geometric start value or
    /// its present one; none where nothing is known.
    pub fn default_bounds(&self, index: usize) -> Option<(f64, f64)> {
        let reference = self.reference(index);
        let factors = |low: f64, high: f64| {
            let (a, b) = (low * reference, high * reference);
            (reference != 0.0).then(|| (a.min(b), a.max(b)))
        };
        let is = |f: &dyn Fn(usize, usize) -> usize| (0..6).any(|i| f(i, i) == index);
        if index >= names::HULL {
            return match names::ACTUATOR[(index - names::HULL) % names::PER_ACTUATOR].0 {
                "gain" => Some((0.2, 2.0)),
                "astern_ratio" => Some((0.5, 1.5)),
                "loss" => Some((0.0, 0.02)),
                "T_1" | "T_t" => Some((0.0, 1.0)),
                "w" | "t" => Some((0.0, 0.5)),
                "K_V" => Some((0.8, 1.2)),
                "offset" => Some((-LARGEST_OFFSET, LARGEST_OFFSET)),
                _ => factors(0.3, 3.0),
            };
        }
        let weight = self.coefficients[MASS] * self.file.environment.g_m_s2;
        let size = self.file.geometry.as_ref().map_or(1.0, |g| g.length_m);
        let drag = self.reference(quadratic(0, 0)).abs();
        match index {
            MASS => factors(0.5, 2.0),
            names::BUOYANCY => Some((0.9 * weight, 1.1 * weight)),
            names::CENTRE_OF_GRAVITY..names::BUOYANCY => Some((-0.1 * size, 0.1 * size)),
            names::BIAS..names::CROSS_FLOW => {
                let arm = if index - names::BIAS < 3 { 1.0 } else { size };
                Some((-0.05 * weight * arm, 0.05 * weight * arm))
            }
            names::CROSS_FLOW..names::TETHER => Some((0.0, LARGEST_CROSS_FLOW)),
            names::TETHER => Some((0.0, LARGEST_CROSS_FLOW * size * size)),
            names::STIFFNESS => Some((0.0, 0.1 * weight / size)),
            _ if is(&added_mass) => factors(0.2, 5.0),
            _ if is(&linear) => factors(0.0, 10.0),
            _ if index == quadratic(0, 0) => factors(0.5, 4.0),
            _ if is(&quadratic) => factors(0.25, 4.0),
            _ if reference == 0.0 && drag > 0.0 && (1..6).any(|i| quadratic(i, 0) == index) => {
                let arm = if index < quadratic(3, 0) { 1.0 } else { size };
                Some((-TRIM * drag * arm, TRIM * drag * arm))
            }
            _ if index < names::CENTRE_OF_GRAVITY => factors(0.3, 3.0),
            _ => factors(-3.0, 3.0),
        }
    }
}
