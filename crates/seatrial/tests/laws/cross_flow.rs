//! Cross-flow drag by strips: against the closed integral, without gain of energy, and as the file has it.

use crate::vehicles::{distance, load, velocity, with};
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::description::coefficients::quadratic;
use seatrial::model::cross_flow::{CrossFlow, STRIPS, Strips};
use seatrial::model::kinematics::rotation;
use seatrial::model::vehicle::Vehicle;

/// Force and moment `∫ |v + x r| (v + x r) dx` and `∫ x |v + x r| (v + x r) dx` between two places, r not zero.
fn closed(v: f64, r: f64, [from, to]: [f64; 2]) -> [f64; 2] {
    // With s = v + x r: the antiderivatives are |s| s²/(3 r) and |s| s² (3 s − 4 v)/(12 r²).
    let at = |x: f64| {
        let s = v + x * r;
        [s.abs() * s * s / (3.0 * r), s.abs() * s * s * (3.0 * s - 4.0 * v) / (12.0 * r * r)]
    };
    [at(to)[0] - at(from)[0], at(to)[1] - at(from)[1]]
}

fn damping(description: &Description, nu: &[f64; 6]) -> [f64; 6] {
    Vehicle::nominal(description).forces(&rotation(&[1.0, 0.0, 0.0, 0.0]), nu, None).damping
}

#[test]
fn golden_cross_flow_of_a_cylinder_by_hand() {
    let cylinder = Strips::new(-1.0, 1.0, |_| [0.2, 0.3]);
    let drag = CrossFlow { strips: cylinder, pressure: [500.0, 500.0] };
    // 500 · 0.2 m · 2 m · (0.3 m/s)² = 18 N; 500 · 0.3 m · 2 m · (0.2 m/s)² = 12 N.
    let sideways = drag.add(&[1.0, 0.3, -0.2, 0.4, 0.0, 0.0], &[0.0; 6]);
    assert!(distance(&sideways, &[0.0, -18.0, 12.0, 0.0, 0.0, 0.0]) < 1e-12, "{sideways:?}");
    // 500 · 0.2 m · 2 · (1 m)⁴/4 · (0.5 rad/s)² = 12.5 N m, 500 · 0.3 m · 2/4 · (0.4 rad/s)² = 12 N m; the kink at
    // the middle falls between two strips, the sum misses it by 3e-4.
    let turning = drag.add(&[1.0, 0.0, 0.0, 0.0, -0.4, 0.5], &[0.0; 6]);
    assert!(distance(&turning, &[0.0, 0.0, 0.0, 0.0, 12.0, -12.5]) < 3e-4 * 12.5, "{turning:?}");
}

#[test]
fn law_strips_are_the_closed_integral() {
    let ends = [-0.9, 0.7];
    let strips = Strips::new(ends[0], ends[1], |_| [1.0, 0.0]);
    let drag = CrossFlow { strips, pressure: [1.0, 1.0] };
    for (v, r) in [(0.3, 1.0), (-0.3, 1.0), (0.2, 0.1), (1.0, -0.4), (0.02, 0.9)] {
        let found = drag.add(&[0.0, v, 0.0, 0.0, 0.0, r], &[0.0; 6]);
        let expected = closed(v, r, ends);
        let turns_on_itself = (v + ends[0] * r) * (v + ends[1] * r) < 0.0;
        // A polynomial without a change of sign; with one, 1.1e-4 of l (l r/2)² at sixteen strips.
        let tolerance = if turns_on_itself { 1.1e-4 * 1.6 * (0.8 * r).powi(2) } else { 1e-13 };
        assert!((found[1] + expected[0]).abs() < tolerance, "{v} {r}: {found:?} against {expected:?}");
        assert!((found[5] + expected[1]).abs() < tolerance, "{v} {r}: {found:?} against {expected:?}");
    }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_cross_flow_drag_never_adds_energy(nu in velocity(3.0, 2.0), slope in -0.2..0.2, bow in 0.1..2.0) {
        let strips = Strips::new(-1.0, bow, |x| [0.5 + slope * x, 0.6 - slope * x]);
        let force = CrossFlow { strips, pressure: [400.0, 300.0] }.add(&nu, &[0.0; 6]);
        let power: f64 = (0..6).map(|i| nu[i] * force[i]).sum();
        let size: f64 = (0..6).map(|i| (nu[i] * force[i]).abs()).sum();
        // Strip by strip −c |s|³; rounding of sixteen strips.
        prop_assert!(power <= 1e-14 * size, "{power:e} of {size:e}");
    }
}

#[test]
fn the_geometry_gives_the_strips_and_the_strips_replace_its_drag() {
    let cwolf = load("cwolf");
    let geometry = cwolf.file.geometry.as_ref().expect("CWolf has a geometry");
    let mut file = cwolf.file.clone();
    for name in ["Y_vv", "N_rr", "Z_ww", "M_qq"] {
        file.coefficients.remove(name);
    }
    let by_geometry = Description::new(file.clone(), "filled").unwrap();
    assert!(by_geometry.coefficients[quadratic(1, 1)] < 0.0);
    file.coefficients.insert("C_Dy".into(), 0.8);
    let stripped = Description::new(file, "stripped").unwrap();
    assert_eq!(stripped.coefficients[quadratic(1, 1)], 0.0);
    assert_eq!(stripped.coefficients[quadratic(5, 5)], 0.0);
    assert!(stripped.coefficients[quadratic(2, 2)] < 0.0, "the other plane keeps its own");
    // The same drag sideways as ½ρ C_Dy d l, beside the linear one.
    let plain = with(&stripped, &[("C_Dy", 0.0)]);
    let nu = [0.0, 0.4, 0.0, 0.0, 0.0, 0.0];
    let share = damping(&stripped, &nu)[1] - damping(&plain, &nu)[1];
    let area = geometry.length_m * geometry.height_m.unwrap_or(geometry.diameter_m);
    let expected = -0.5 * stripped.file.environment.rho_kg_m3 * 0.8 * area * 0.16;
    assert!((share - expected).abs() < 1e-12 * expected.abs(), "{share} against {expected}");
    // Written and read again it is the same vehicle: neither drag comes back.
    let text = stripped.filled_file().to_toml();
    assert_eq!(Description::from_toml(&text, "again").unwrap().coefficients, stripped.coefficients);
}

#[test]
fn strips_follow_the_table_of_the_file() {
    let text = seatrial::description::built_in("cwolf").unwrap();
    let head = text.find("[coefficients]").unwrap();
    let file = |table: &str| format!("{}[cross_flow]\n{table}\n\n{}", &text[..head], &text[head..]);
    let read = |table: &str| Description::from_toml(&file(table), "boat.toml");
    let cone = read("x_m = [-1.0, 1.0]\ndiameter_m = [0.0, 0.4]").unwrap();
    let strips = cone.strips.unwrap();
    // Area and first moment of a triangle, exact for Gauss's rule.
    assert!((strips.side.iter().sum::<f64>() - 0.4).abs() < 1e-14);
    let moment: f64 = (0..STRIPS).map(|i| strips.x[i] * strips.above[i]).sum();
    assert!((moment - 0.4 / 3.0).abs() < 1e-14);
    for (table, parts) in [
        ("x_m = [1.0, -1.0]\ndiameter_m = [0.2, 0.2]", ["cross_flow.x_m", "increasing"]),
        ("x_m = [-1.0, 1.0]\ndiameter_m = [0.2]", ["cross_flow.diameter_m", "expected 2 numbers"]),
        (
            "x_m = [-1.0, 1.0]\ndiameter_m = [0.2, -0.2]",
            ["cross_flow.diameter_m", "zero or a positive number"],
        ),
        ("x_m = [-1.0, 1.0]\ndiameter_m = [0.2, 0.2]\nheight_m = [0.2]", ["cross_flow.height_m", "found 1"]),
    ] {
        let message = read(table).unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn a_cross_flow_coefficient_needs_the_shape_of_the_hull() {
    let mut file = load("cwolf").file;
    file.geometry = None;
    let bare = Description::new(file, "bare").unwrap();
    let message = bare.with_coefficients(&[("C_Dy".into(), 0.8)]).unwrap_err().to_string();
    assert!(message.contains("C_Dy") && message.contains("[cross_flow]"), "{message}");
    assert!(!bare.uses(bare.layout.index("C_Dz").unwrap()));
}
