//! Start values of a box and of an open frame from a tape measure: inertia, added mass and damping, each with its
//! stated 95 % interval.
//!
//! Axis i moves the face A_i (shorter side a, longer side b) with the depth h behind it:
//! * Inertia of a homogeneous box, `I_x = m (w² + h²)/12` and so on.
//! * Added mass `A_i = ρ C_A(b/a) π/4 a² b (1 + √((1 − λ²)/(2 (1 + λ²)))) φ`, `λ = √A_i/(√A_i + h)`: a rectangular plate
//!   with what its sides add; φ is what openings leave, 1 of a closed box.
//! * In rotation, plates spread over the two other measures: `I_A = κ (A_j l_k² + A_k l_j²)/12`; κ of a disc.
//! * Quadratic damping `−½ ρ C_D A_i`; in rotation the strips `−½ ρ C_Dr l_i (l_j⁴ + l_k⁴)/32`.
//! * Linear damping as a share of the quadratic one: a speed at which both are alike.
//!
//! Source: DNV-RP-H103 (2011), table A-2 (plates) and 4.6.3 (sides, perforation); DNV-RP-C205, appendix E (drag of
//! cubes and plates); Lamb, *Hydrodynamics* (1932), § 108 (disc). Intervals: spread of published open frames,
//! `docs/theory/geometry.md`.
//! Tests: `tests/files.rs`, `tests/vehicle/test_box_hulls.py`.

use super::coefficients::{INERTIA, added_mass, linear, quadratic};
use super::geometry::{Geometry, Shape, interpolated};
use super::values::StartValue;
use std::f64::consts::PI;

/// C_A of a rectangular plate by its longer over its shorter side: DNV-RP-H103, table A-2.
const PLATE: [(f64, f64); 10] = [
    (1.0, 0.579),
    (1.25, 0.642),
    (1.5, 0.690),
    (2.0, 0.757),
    (2.5, 0.801),
    (3.0, 0.830),
    (4.0, 0.871),
    (5.0, 0.897),
    (8.0, 0.934),
    (10.0, 0.947),
];
/// Share of the added mass that a frame open by 40 % keeps: e^((10 − 40)/28), DNV-RP-H103, 4.6.3.4. Open by 20 % it
/// keeps 0.76, by 60 % 0.17.
const OPEN_FRAME: f64 = 0.343;
/// Added inertia of a disc over that of its added mass spread evenly: (16/45)/(8/3 · 1/4).
const DISC: f64 = 0.533;
/// Inertia of an open frame over that of a homogeneous box: heavy parts lie inside the floats and bars.
const FRAME_INERTIA: f64 = 0.75;
/// C_D of a closed box, of an open frame on its outline, and of either in rotation, where edges lead.
const BOX_DRAG: f64 = 1.05;
const FRAME_DRAG: f64 = 0.9;
const ROTATION_DRAG: f64 = 2.0;
/// Speed, m/s, and rate, rad/s, at which linear and quadratic damping are alike.
const LINEAR_SPEED: f64 = 0.12;
const LINEAR_RATE: f64 = 0.4;

/// Factors on the start value within which 95 % of vehicles are expected: inertia, added mass in translation and in
/// rotation, quadratic damping in translation and in rotation, linear damping. They are e^(1.96 s) of the spread s of
/// published open frames about the formula, rounded outward.
const INERTIA_95: [f64; 2] = [0.5, 2.1];
const ADDED_95: [f64; 2] = [0.4, 2.5];
const ADDED_ROTATION_95: [f64; 2] = [0.2, 5.0];
const DRAG_95: [f64; 2] = [0.25, 4.0];
const DRAG_ROTATION_95: [f64; 2] = [0.1, 8.0];
const LINEAR_95: [f64; 2] = [0.0, 8.0];

const SOLID: &str = "homogeneous box";
const PLATES: &str = "DNV-RP-H103, table A-2 and 4.6.3: rectangular plates with sides";
const ROTATED_PLATES: &str = "plates of DNV-RP-H103 spread as Lamb's disc";
const FACES: &str = "DNV-RP-C205, appendix E: drag of the faces";
const STRIPS: &str = "strips of the faces, C_D 2";
const LINEAR: &str = "share of the quadratic damping of published open frames";

/// Start values of the 21 diagonal coefficients at mass `m` (kg) in water of density `rho` (kg/m³).
pub(super) fn start_values(geometry: &Geometry, m: f64, rho: f64) -> Vec<StartValue> {
    let open = geometry.shape == Shape::Frame;
    let size = [geometry.length_m, geometry.diameter_m, geometry.height()];
    let [kept, heavy, drag] =
        if open { [OPEN_FRAME, FRAME_INERTIA, FRAME_DRAG] } else { [1.0, 1.0, BOX_DRAG] };
    let added = [0, 1, 2].map(|i| kept * rho * face_added(size, i));
    let mut values = Vec::with_capacity(21);
    for i in 0..3 {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let (d_j, d_k) = (size[j] * size[j], size[k] * size[k]);
        let spread = DISC * (added[j] * d_k + added[k] * d_j) / 12.0;
        let along = 0.5 * rho * drag * size[j] * size[k];
        let about = 0.5 * rho * ROTATION_DRAG * size[i] * (d_j * d_j + d_k * d_k) / 32.0;
        let mut push =
            |index, value, factors, source| values.push(StartValue { index, value, factors, source });
        push(INERTIA + i, heavy * m * (d_j + d_k) / 12.0, INERTIA_95, SOLID);
        push(added_mass(i, i), -added[i], ADDED_95, PLATES);
        push(added_mass(i + 3, i + 3), -spread, ADDED_ROTATION_95, ROTATED_PLATES);
        push(quadratic(i, i), -along, DRAG_95, FACES);
        push(quadratic(i + 3, i + 3), -about, DRAG_ROTATION_95, STRIPS);
        push(linear(i, i), -LINEAR_SPEED * along, LINEAR_95, LINEAR);
        push(linear(i + 3, i + 3), -LINEAR_RATE * about, LINEAR_95, LINEAR);
    }
    values
}

/// Added mass over density, m³, of a closed box that moves along axis `i`.
fn face_added(size: [f64; 3], i: usize) -> f64 {
    let (d_j, d_k) = (size[(i + 1) % 3], size[(i + 2) % 3]);
    let (a, b) = (d_j.min(d_k), d_j.max(d_k));
    let lambda = (a * b).sqrt() / ((a * b).sqrt() + size[i]);
    let squared = lambda * lambda;
    let sides = 1.0 + ((1.0 - squared) / (2.0 * (1.0 + squared))).sqrt();
    interpolated(&PLATE, b / a) * 0.25 * PI * a * a * b * sides
}
