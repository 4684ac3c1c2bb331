//! Integration: fourth order for a driven vehicle, unit quaternions, no denormal numbers.

use crate::vehicles::{body, distance, fly, hull, load, moving, times, velocity, with};
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::fit::inputs::Inputs;

#[test]
fn law_a_driven_vehicle_is_integrated_with_order_four() {
    // No corner within a step: no cross-flow damping (|v| v), no lift (|u| v), no rate limit.
    let none = ["Y_vv", "Z_ww", "K_pp", "M_qq", "N_rr", "Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq"];
    let mut smooth: Vec<(String, f64)> = none.iter().map(|name| (name.to_string(), 0.0)).collect();
    smooth.extend([("N_uv".to_owned(), 0.0), ("N_ur".to_owned(), 0.0)]);
    let mut file = load("cwolf").file;
    for motor in file.motors.values_mut() {
        (motor.n_acc_per_s, motor.n_dec_per_s) = (None, None);
    }
    let description = Description::new(file, "cwolf").unwrap().with_coefficients(&smooth).unwrap();
    let rpm = |n: f64, m: f64| (0..21).map(|k| if k % 10 < 5 { n } else { m }).collect::<Vec<f64>>();
    let commands = [("SbU", rpm(900.0, 1200.0)), ("PL", rpm(1500.0, 400.0)), ("VTB", rpm(500.0, 700.0))];
    let inputs = Inputs {
        t: times(21, 0.2),
        commands: commands.map(|(name, values)| (name.to_owned(), values)).into(),
        current: (0..21).map(|k| [0.02 * f64::from(k), 0.3, -0.01 * f64::from(k)]).collect(),
        ..Inputs::default()
    };
    let start = moving([1.5, 0.3, 0.2, 0.3, 0.2, 0.3]);
    let end = |substeps: usize| {
        let state = fly(&description, &inputs, start, "XYZKMN", substeps).states[20];
        let ([x, y, z], [u, v, w, p, q, r]) = (state.position, state.nu);
        [x, y, z, u, v, w, p, q, r]
    };
    let exact = end(256);
    let [coarse, fine] = [8, 16].map(|substeps| distance(&end(substeps), &exact));
    let order = (coarse / fine).log2();
    // Asymptotic within 0.2 at these steps; third order would be 3.
    assert!((order - 4.0).abs() < 0.2, "order {order}: {coarse:e} -> {fine:e}");
}

properties! {
    #![cases(12)]

    #[test]
    fn law_the_attitude_stays_a_unit_quaternion(body in body(), nu in velocity(1.0, 2.0)) {
        let inputs = Inputs { t: times(201, 0.1), ..Inputs::default() };
        for state in fly(&body.vehicle(), &inputs, moving(nu), "XYZKMN", 2).states {
            let square: f64 = state.attitude.iter().map(|x| x * x).sum();
            // Four squares and their sum, normalised after every step.
            prop_assert!((square - 1.0).abs() < 2e-15);
        }
    }
}

#[test]
fn law_a_coast_down_ends_at_zero_and_not_in_denormals() {
    let names = ["m", "I_x", "I_y", "I_z", "X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r"];
    let values = [10.0, 1.0, 1.0, 1.0, -20.0, -20.0, -20.0, -2.0, -2.0, -2.0];
    let coefficients: Vec<(String, f64)> = names.iter().map(|n| n.to_string()).zip(values).collect();
    let inputs = Inputs { t: times(601, 0.1), ..Inputs::default() };
    let run = fly(&hull(&coefficients), &inputs, moving([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]), "XYZKMN", 1);
    // exp(-2 t) passes 1e-30 after 35 s.
    for state in &run.states {
        assert!(state.nu.iter().all(|x| *x == 0.0 || x.abs() >= 1e-30), "{:?}", state.nu);
    }
    assert_eq!(run.states[600].nu, [0.0; 6]);
    assert!(run.states[300].nu.iter().all(|x| x.abs() > 1e-30));
}

#[test]
fn law_a_motor_runs_down_to_zero_and_not_to_denormals() {
    let description = with(&load("cwolf"), &[("SbU.n_dec", 1e6)]);
    let rpm = (0..301).map(|k| if k < 10 { 1000.0 } else { 0.0 }).collect();
    let inputs =
        Inputs { t: times(301, 0.1), commands: [("SbU".to_owned(), rpm)].into(), ..Inputs::default() };
    let run = fly(&description, &inputs, moving([0.0; 6]), "XYZKMN", 1);
    assert!(run.signals[10][0] > 900.0);
    assert!(run.signals.iter().all(|row| row[0] == 0.0 || row[0] >= 1e-30));
    // exp(-20 s/0.15 s) is far below 1e-30.
    assert_eq!(run.signals[300][0], 0.0);
}
