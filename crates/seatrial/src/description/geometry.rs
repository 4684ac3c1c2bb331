//! Start values from a tape measure: inertia, added mass and drag of a body of revolution; of a box in [`super::box_hull`].
//!
//! * Inertia of a solid cylinder: `I_x = ½ m r²`, `I_y = I_z = m (l² + 3 r²)/12`.
//! * Added mass of a prolate spheroid a = l/2, b = r by Lamb's factors of the eccentricity e:
//!   `X_udot = −k1 m_e`, `Y_vdot = Z_wdot = −k2 m_e`, `M_qdot = N_rdot = −k' I_e`, with
//!   `m_e = ⅔ π ρ r² l` and `I_e = m_e (l²/4 + r²)/5`.
//! * Axial drag `C_Dx = 0.44 d/l + 4 C_f l/d + 4 C_f √(d/l)`, `C_f = 0.075/(log₁₀ Re − 2)²` (a laminar form
//!   with a turbulent friction line: a start value, bounds 0.5–4×).
//! * Cross-flow `Y_vv = −½ ρ C_D 2 r l`, C_D of a finite cylinder by l/d; rotation
//!   `M_qq = N_rr = −ρ C_D r l⁴/32`; roll `K_pp = −½ ρ C_Dp Σ A_i r_i³` over fins and tower.
//!
//! Source: Taubert et al. (2014), equations 11–31, corrected; Lamb, *Hydrodynamics* (1932), §§ 114–115;
//! White, *Fluid Mechanics*, drag of finite cylinders.
//! Tests: `tests/golden.rs` (Lamb factors, MSS `imlay61`, CWolf's integrals).

use crate::description::coefficients::{INERTIA, added_mass, quadratic};
use crate::description::values::StartValue;
use crate::number::plain;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Roll damping of a flat plate, C_Dp.
const FLAT_PLATE: f64 = 1.2;
/// Added roll inertia of fins and tower as a share of I_x: no closed formula; a start value.
const ROLL_ADDED_INERTIA: f64 = 0.3;

/// Factors on the start value within which 95 % of torpedoes are expected: from the hulls of REMUS 100 and LAUV, whose
/// fixed fins and fairings the spheroid does not have; what no formula gives is wider.
const INERTIA_95: [f64; 2] = [0.5, 1.5];
const ADDED_AHEAD_95: [f64; 2] = [0.4, 2.5];
const ADDED_ACROSS_95: [f64; 2] = [0.7, 2.0];
const ADDED_ROLL_95: [f64; 2] = [0.2, 5.0];
const ADDED_TURN_95: [f64; 2] = [0.5, 3.0];
const DRAG_AHEAD_95: [f64; 2] = [0.5, 3.0];
const DRAG_ACROSS_95: [f64; 2] = [0.5, 3.0];
const DRAG_ROLL_95: [f64; 2] = [0.2, 5.0];
const DRAG_TURN_95: [f64; 2] = [0.3, 15.0];

/// Measures of a hull.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Length over all, m.
    pub length_m: f64,
    /// Largest diameter, m; of a box or frame its width, which may be written `width_m`.
    #[serde(alias = "width_m")]
    pub diameter_m: f64,
    /// Height, m, where it differs from the diameter; a box or frame needs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    /// `spheroid`, a body of revolution; `box`, a closed hull; `frame`, an open frame with floats and bars.
    #[serde(default)]
    pub shape: Shape,
    /// Speed at which the friction line is read, m/s.
    #[serde(default = "one")]
    pub design_speed_m_s: f64,
    /// Kinematic viscosity of the water, m²/s.
    #[serde(default = "sea_water_viscosity")]
    pub kinematic_viscosity_m2_s: f64,
    /// Fins and tower.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub appendages: Vec<Appendage>,
}

/// The form for which start values are known.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A slender body of revolution.
    #[default]
    Spheroid,
    /// A closed box.
    Box,
    /// An open frame of floats, bars and instruments.
    Frame,
}

/// A plate that damps roll.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Appendage {
    /// Area, m².
    pub area_m2: f64,
    /// Distance of its centroid from the roll axis, m.
    pub arm_m: f64,
}

fn one() -> f64 {
    1.0
}

fn sea_water_viscosity() -> f64 {
    1.19e-6
}

/// Lamb's factors `[k1, k2, k']` of a prolate spheroid of this length and radius, length > 2 radius.
pub fn lamb_factors(length: f64, radius: f64) -> [f64; 3] {
    let (a, b) = (0.5 * length, radius);
    let e2 = 1.0 - plain::powi(b / a, 2);
    let e = e2.sqrt();
    let logarithm = plain::ln((1.0 + e) / (1.0 - e));
    let alpha = 2.0 * (1.0 - e2) / plain::powi(e, 3) * (0.5 * logarithm - e);
    let beta = 1.0 / e2 - (1.0 - e2) / (2.0 * plain::powi(e, 3)) * logarithm;
    let k_rotation = e2 * e2 * (beta - alpha) / ((2.0 - e2) * (2.0 * e2 - (2.0 - e2) * (beta - alpha)));
    [alpha / (2.0 - alpha), beta / (2.0 - beta), k_rotation]
}

/// Drag coefficient of a finite cylinder in cross-flow by its slenderness l/d.
pub fn cross_flow_drag(slenderness: f64) -> f64 {
    const CURVE: [(f64, f64); 7] =
        [(1.0, 0.64), (2.0, 0.68), (3.0, 0.72), (5.0, 0.74), (10.0, 0.82), (20.0, 0.91), (40.0, 0.98)];
    interpolated(&CURVE, slenderness)
}

/// A curve read linearly in between, and held beyond its ends.
pub(super) fn interpolated(curve: &[(f64, f64)], at: f64) -> f64 {
    let upper = curve.partition_point(|(x, _)| *x < at).clamp(1, curve.len() - 1);
    let ((x0, y0), (x1, y1)) = (curve[upper - 1], curve[upper]);
    y0 + (y1 - y0) * ((at - x0) / (x1 - x0)).clamp(0.0, 1.0)
}

impl Geometry {
    /// Radius of the hull, m.
    pub fn radius(&self) -> f64 {
        0.5 * self.diameter_m
    }

    /// Height, m: the diameter where none is given.
    pub fn height(&self) -> f64 {
        self.height_m.unwrap_or(self.diameter_m)
    }

    /// Axial drag coefficient on the frontal area π r².
    pub fn axial_drag(&self) -> f64 {
        let slenderness = self.length_m / self.diameter_m;
        let reynolds = self.design_speed_m_s * self.length_m / self.kinematic_viscosity_m2_s;
        let friction = 0.075 / plain::powi(plain::log10(reynolds) - 2.0, 2);
        0.44 / slenderness + 4.0 * friction * slenderness + 4.0 * friction / slenderness.sqrt()
    }

    /// What is wrong with the measures together, if anything.
    pub fn complaint(&self) -> Option<String> {
        (self.shape == Shape::Spheroid && self.length_m <= self.diameter_m).then(|| {
            format!(
                "geometry: a spheroid hull is longer than wide, found length_m = {} and diameter_m = {}; use shape = \"frame\" for an open frame, \"box\" for a closed one",
                self.length_m, self.diameter_m
            )
        })
    }

    /// Start values of the coefficients at mass `m` (kg) in water of density `rho` (kg/m³).
    pub fn start_values(&self, m: f64, rho: f64) -> Vec<StartValue> {
        if self.shape != Shape::Spheroid {
            return super::box_hull::start_values(self, m, rho);
        }
        let (l, r) = (self.length_m, self.radius());
        let i_x = 0.5 * m * r * r;
        let i_y = m * (l * l + 3.0 * r * r) / 12.0;
        let m_e = 2.0 / 3.0 * PI * rho * r * r * l;
        let i_e = m_e * (l * l / 4.0 + r * r) / 5.0;
        let [k1, k2, k_rotation] = lamb_factors(l, r);
        let cross_flow = cross_flow_drag(l / self.diameter_m);
        let lateral = -0.5 * rho * cross_flow * 2.0 * r * l;
        let rotation = -rho * cross_flow * r * plain::powi(l, 4) / 32.0;
        let roll = -0.5
            * rho
            * FLAT_PLATE
            * self.appendages.iter().map(|a| a.area_m2 * plain::powi(a.arm_m, 3)).sum::<f64>();
        let of = |source: &'static str, rows: &[(usize, f64, [f64; 2])]| {
            rows.iter().map(|&(index, value, factors)| StartValue { index, value, factors, source }).collect()
        };
        let groups: [Vec<StartValue>; 5] = [
            of(
                "homogeneous cylinder",
                &[(INERTIA, i_x, INERTIA_95), (INERTIA + 1, i_y, INERTIA_95), (INERTIA + 2, i_y, INERTIA_95)],
            ),
            of(
                "Lamb (1932), §§ 114-115: prolate spheroid",
                &[
                    (added_mass(0, 0), -k1 * m_e, ADDED_AHEAD_95),
                    (added_mass(1, 1), -k2 * m_e, ADDED_ACROSS_95),
                    (added_mass(2, 2), -k2 * m_e, ADDED_ACROSS_95),
                    (added_mass(4, 4), -k_rotation * i_e, ADDED_TURN_95),
                    (added_mass(5, 5), -k_rotation * i_e, ADDED_TURN_95),
                ],
            ),
            of("share of I_x", &[(added_mass(3, 3), -ROLL_ADDED_INERTIA * i_x, ADDED_ROLL_95)]),
            of(
                "Taubert et al. (2014), equations 24-31: drag of a round hull",
                &[
                    (quadratic(0, 0), -0.5 * rho * self.axial_drag() * PI * r * r, DRAG_AHEAD_95),
                    (quadratic(1, 1), lateral, DRAG_ACROSS_95),
                    (quadratic(2, 2), lateral, DRAG_ACROSS_95),
                    (quadratic(4, 4), rotation, DRAG_TURN_95),
                    (quadratic(5, 5), rotation, DRAG_TURN_95),
                ],
            ),
            of("plates of fins and tower", &[(quadratic(3, 3), roll, DRAG_ROLL_95)]),
        ];
        groups.concat()
    }
}
