//! Locked axes: the reduced system is the full one with the constraint's forces; nothing leaks.

use crate::vehicles::{Body, attitude, body, distance, fly, fly_from, moving, times, velocity, with};
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::description::assembly::Structure;
use seatrial::fit::inputs::Inputs;
use seatrial::fit::record::MotorStart;
use seatrial::model::kinematics::rotation;
use seatrial::model::vehicle::{Instant, Mode, Vehicle};
use seatrial::number::algebra::{product, restricted_inverse};

/// A vehicle whose degrees of freedom have these modes.
fn locked(description: &Description, modes: [Mode; 6]) -> Vehicle<f64> {
    let structure = Structure::new(description, &[]);
    Vehicle::new(description, &structure, &description.coefficients, description.file.environment, modes)
}

/// A body in thick water: a locked axis can feed energy to the others, which damping must outweigh.
fn damped(body: &Body) -> Description {
    let inertia = body.i_o[0][0];
    let names = ["X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r"];
    let values: Vec<(&str, f64)> = names
        .iter()
        .enumerate()
        .map(|(i, name)| (*name, if i < 3 { -2.0 * body.mass } else { -3.0 * inertia }))
        .collect();
    with(&body.vehicle(), &values)
}

fn modes() -> impl Strategy<Value = [Mode; 6]> {
    let mode = prop_oneof![Just(Mode::Free), Just(Mode::Frozen), Just(Mode::Measured)];
    proptest::array::uniform6(mode)
}

properties! {
    #![cases(64)]

    #[test]
    fn law_restricted_inverse_inverts_for_every_set_of_free_axes(body in body()) {
        let matrix = Vehicle::nominal(&body.vehicle()).mass_matrix;
        for set in 0..64_u32 {
            let free: [bool; 6] = std::array::from_fn(|i| set >> i & 1 == 1);
            let inverse = restricted_inverse(&matrix, &free);
            for i in 0..6 {
                for j in 0..6 {
                    if !(free[i] && free[j]) {
                        prop_assert_eq!(inverse[i][j], 0.0, "set {:06b}", set);
                        continue;
                    }
                    let sum: f64 = (0..6).filter(|&k| free[k]).map(|k| matrix[i][k] * inverse[k][j]).sum();
                    let scale = (matrix[i][i] / matrix[j][j]).sqrt();
                    // Rounding times a condition below 1e3 of the matrix scaled to a unit diagonal.
                    prop_assert!((sum - f64::from(i == j)).abs() < 1e-12 * scale, "set {set:06b}: {sum}");
                }
            }
        }
    }

    #[test]
    fn law_reduced_system_is_the_full_one_with_constraint_forces(
        body in body(),
        modes in modes(),
        nu in velocity(2.0, 1.0),
        attitude in attitude(),
        tau in velocity(50.0, 20.0),
        rate in velocity(1.0, 1.0),
    ) {
        let description = body.vehicle();
        let r = rotation(&attitude);
        let instant = |tau| Instant { tau, measured: [nu, rate], ..Instant::default() };
        let reduced = locked(&description, modes).acceleration((None, &r), &nu, &instant(tau));
        let vehicle = Vehicle::nominal(&description);
        let free = vehicle.acceleration((None, &r), &nu, &instant(tau));
        let constraint = product(&vehicle.mass_matrix, &std::array::from_fn(|i| reduced[i] - free[i]));
        let total = std::array::from_fn(|i| tau[i] + constraint[i]);
        for i in 0..6 {
            match modes[i] {
                // Rounding of forces up to 10 kN through an inverse of condition below 1e4.
                Mode::Free => prop_assert!(constraint[i].abs() < 1e-8, "{constraint:?}"),
                Mode::Frozen => prop_assert_eq!(reduced[i], 0.0),
                Mode::Measured => prop_assert_eq!(reduced[i], rate[i]),
            }
        }
        let constrained = vehicle.acceleration((None, &r), &nu, &instant(total));
        // As above, over the smallest mass and inertia.
        prop_assert!(distance(&constrained, &reduced) < 1e-8);
    }
}

properties! {
    #![cases(12)]

    #[test]
    fn law_frozen_axes_keep_their_velocity(body in body(), nu in velocity(1.0, 0.5), tau in velocity(20.0, 5.0)) {
        let inputs = Inputs { t: times(51, 0.1), tau: vec![tau], ..Inputs::default() };
        let run = fly(&damped(&body), &inputs, moving(nu), "XZN", 2);
        for state in &run.states {
            // Exact: nothing is added to them.
            prop_assert_eq!([state.nu[1], state.nu[3], state.nu[4]], [nu[1], nu[3], nu[4]]);
        }
    }

    #[test]
    fn law_measured_axes_replay_the_full_motion(body in body(), nu in velocity(1.0, 0.5), tau in velocity(20.0, 2.0)) {
        let description = damped(&body);
        let substeps = 4;
        let fine = 0.1 / f64::from(2 * substeps);
        // The full motion on the half-step grid, and the rates that the equation of motion gives there.
        let count = 30;
        let nodes = 2 * substeps as usize * (count - 1) + 1;
        let inputs = Inputs { t: times(nodes, fine), tau: vec![tau], ..Inputs::default() };
        let full = fly(&description, &inputs, moving(nu), "XYZKMN", 4);
        let vehicle = Vehicle::nominal(&description);
        let instant = Instant { tau, ..Instant::default() };
        let rates = full.states.iter().map(|s| vehicle.acceleration((None, &rotation(&s.attitude)), &s.nu, &instant));
        let replay = Inputs {
            t: times(count, 0.1),
            tau: vec![tau],
            nu: full.states.iter().map(|s| s.nu).collect(),
            nu_rate: rates.collect(),
            ..Inputs::default()
        };
        let start = (moving(nu), MotorStart::Held(vec![]));
        let run = fly_from(&description, &replay, start, ("XZN", "YKM"), substeps as usize);
        for (k, state) in run.states.iter().enumerate() {
            let expected = &full.states[2 * substeps as usize * k];
            prop_assert_eq!([state.nu[1], state.nu[3]], [expected.nu[1], expected.nu[3]]);
            // RK4's error at 25 ms over 3 s.
            prop_assert!(distance(&state.nu, &expected.nu) < 1e-5, "{:?} {:?}", state.nu, expected.nu);
            prop_assert!(distance(&state.position, &expected.position) < 1e-5);
        }
    }
}
