//! The same vehicle written in two ways moves in the same way: full or diagonal, port or starboard,
//! one density or another.

use crate::vehicles::{attitude, body, diagonal, distance, fly, load, moving, times, velocity};
use proptest::array::uniform6;
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::description::assembly::Structure;
use seatrial::description::coefficients::{BIAS, CROSS_FLOW, HULL, LIFT_NAMES, Layout, linear, quadratic};
use seatrial::description::vehicle_file::Environment;
use seatrial::fit::inputs::Inputs;
use seatrial::model::added_mass::AddedMass;
use seatrial::model::damping::Damping;
use seatrial::model::kinematics::rotation;
use seatrial::model::vehicle::{Instant, Mode, Vehicle};

/// A diagonal matrix.
fn matrix(diagonal: &[f64; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { diagonal[i] } else { 0.0 }))
}

properties! {
    #![cases(256)]

    #[test]
    fn law_full_added_mass_equals_the_diagonal(mass in uniform6(0.0..200.0), nu in velocity(3.0, 2.0)) {
        let zero = [0.0; 6];
        let (full, simple) = (AddedMass::Full(matrix(&mass)), AddedMass::Diagonal(mass));
        // Exact: the other products are zeros.
        prop_assert_eq!(full.add_coriolis(&nu, &zero), simple.add_coriolis(&nu, &zero));
        prop_assert_eq!(full.momentum(&nu), simple.momentum(&nu));
        prop_assert_eq!(full.matrix(), simple.matrix());
    }

    #[test]
    fn law_full_damping_equals_the_diagonal(
        first in uniform6(-50.0..0.0),
        second in uniform6(-300.0..0.0),
        nu in velocity(3.0, 2.0),
    ) {
        let full = Damping::Full { linear: matrix(&first), quadratic: matrix(&second) };
        let simple = Damping::Diagonal { linear: first, quadratic: second };
        let (full, simple) = (full.add(&nu, &[0.0; 6]), simple.add(&nu, &[0.0; 6]));
        // Two roundings more of forces up to 3 kN.
        prop_assert!(distance(&full, &simple) < 3e-12);
    }

    #[test]
    fn law_every_damping_term_acts_on_its_row(
        body in body(),
        nu in velocity(3.0, 2.0),
        (row, column) in (0_usize..6, 0_usize..6),
    ) {
        let still = body.vehicle();
        let name = |index: usize| still.layout.name(index);
        let damped = still
            .with_coefficients(&[(name(linear(row, column)), -7.0), (name(quadratic(row, column)), -11.0)])
            .unwrap();
        let force = Vehicle::nominal(&damped).forces(&rotation(&[1.0, 0.0, 0.0, 0.0]), &nu, None).damping;
        for (i, found) in force.iter().enumerate() {
            let x = nu[column];
            let expected = if i == row { -7.0 * x - 11.0 * x.abs() * x } else { 0.0 };
            // Rounding of 120 N.
            prop_assert!((found - expected).abs() < 1e-13 * 120.0);
        }
    }

    #[test]
    fn law_every_lift_term_acts_on_its_row(body in body(), nu in velocity(3.0, 2.0), term in 0_usize..8) {
        let name = LIFT_NAMES[term];
        let lifted = body.vehicle().with_coefficients(&[(name.to_owned(), -7.0)]).unwrap();
        let force = Vehicle::nominal(&lifted).forces(&rotation(&[1.0, 0.0, 0.0, 0.0]), &nu, None).lift;
        // A name is force, u, velocity.
        let axis = |names: &str, letter: &str| names.find(letter).expect("a known letter");
        let (row, column) = (axis("XYZKMN", &name[..1]), axis("uvwpqr", &name[3..]));
        for (i, found) in force.iter().enumerate() {
            let expected = if i == row { -7.0 * nu[0].abs() * nu[column] } else { 0.0 };
            // Rounding of 63 N.
            prop_assert!((found - expected).abs() < 1e-13 * 63.0, "{name}: {force:?}");
        }
    }

    #[test]
    fn law_terms_that_are_sought_but_zero_change_nothing(nu in velocity(2.0, 1.0), attitude in attitude()) {
        let description = load("cwolf");
        let everything: Vec<usize> = (0..HULL).collect();
        let accelerations = [vec![], everything].map(|sought| {
            let structure = Structure::new(&description, &sought);
            let environment = description.file.environment;
            let values = &description.coefficients;
            Vehicle::new(&description, &structure, values, environment, [Mode::Free; 6])
                .acceleration((None, &rotation(&attitude)), &nu, &Instant::default())
        });
        // Other orders of summation: rounding of accelerations up to some hundred m/s².
        prop_assert!(distance(&accelerations[0], &accelerations[1]) < 1e-11);
    }

    #[test]
    fn law_forces_add_up_to_mass_times_acceleration(
        body in body(),
        nu in velocity(2.0, 1.0),
        attitude in attitude(),
        tau in velocity(50.0, 20.0),
    ) {
        let vehicle = Vehicle::nominal(&body.vehicle());
        let r = rotation(&attitude);
        let instant = Instant { tau, ..Instant::default() };
        let acceleration = vehicle.acceleration((None, &r), &nu, &instant);
        let forces = vehicle.forces(&r, &nu, None);
        let inertial = seatrial::number::algebra::product(&vehicle.mass_matrix, &acceleration);
        for i in 0..6 {
            let sum = tau[i] + forces.rigid_body[i] + forces.added_mass[i] + forces.damping[i]
                + forces.lift[i] + forces.restoring[i];
            // Rounding of forces up to 10 kN through an inverse of condition below 1e4.
            prop_assert!((inertial[i] - sum).abs() < 1e-8, "{} against {sum}", inertial[i]);
        }
    }

    #[test]
    fn law_hydrodynamic_terms_follow_the_density(rho in 950.0..1100.0, nu in velocity(2.0, 1.0)) {
        let description = load("cwolf");
        let of = |description: &Description, environment: Environment| {
            let structure = Structure::new(description, &[]);
            Vehicle::new(description, &structure, &description.coefficients, environment, [Mode::Free; 6])
        };
        let reference = description.file.environment;
        let dense = of(&description, Environment { rho_kg_m3: rho, ..reference });
        let ratio = rho / reference.rho_kg_m3;
        let scaled: Vec<(String, f64)> = (13..CROSS_FLOW)
            .filter(|&i| description.coefficients[i] != 0.0)
            .map(|i| (description.layout.name(i), ratio * description.coefficients[i]))
            .collect();
        let scaled = of(&description.with_coefficients(&scaled).unwrap(), reference);
        let r = rotation(&[0.9, 0.3, -0.2, 0.1]);
        let accelerations = [dense, scaled].map(|v| v.acceleration((None, &r), &nu, &Instant::default()));
        // The same products in another order.
        prop_assert!(distance(&accelerations[0], &accelerations[1]) < 1e-11);
    }
}

#[test]
fn law_added_mass_and_buoyancy_are_hydrodynamic_and_mass_is_not() {
    use seatrial::description::coefficients::Scaling::{Density, None, Weight};
    for (index, scaling) in
        [(0, None), (3, None), (13, Weight), (diagonal(0), Density), (BIAS + 5, None), (CROSS_FLOW, None)]
    {
        assert_eq!(Layout::scaling(index), scaling, "index {index}");
    }
}

/// The mirror image of a velocity or a wrench in the plane y = 0.
fn mirrored(x: &[f64; 6]) -> [f64; 6] {
    [x[0], -x[1], x[2], -x[3], x[4], -x[5]]
}

properties! {
    #![cases(12)]

    #[test]
    fn law_port_and_starboard_are_mirror_images(
        rpm in uniform6(-2000.0..2000.0),
        nu in velocity(1.0, 0.3),
        flow in -0.5..0.5,
    ) {
        let description = load("cwolf");
        let run = |rpm: [f64; 6], nu: [f64; 6], flow: f64| {
            let names = ["SbU", "SbL", "PU", "PL", "VTB", "VTS"];
            let commands = names.iter().zip(rpm).map(|(name, n)| (name.to_string(), vec![n; 101]));
            let inputs = Inputs {
                t: times(101, 0.1),
                commands: commands.collect(),
                current: vec![[0.2, flow, 0.1]],
                ..Inputs::default()
            };
            fly(&description, &inputs, moving(nu), "XYZKMN", 5)
        };
        let starboard = run(rpm, nu, flow);
        let port = run([rpm[2], rpm[3], rpm[0], rpm[1], rpm[4], rpm[5]], mirrored(&nu), -flow);
        for (a, b) in starboard.states.iter().zip(&port.states) {
            let [x, y, z] = b.position;
            let [w, i, j, k] = b.attitude;
            // 500 steps of rounding: the thrusters are summed in another order.
            prop_assert!(distance(&a.nu, &mirrored(&b.nu)) < 1e-9);
            prop_assert!(distance(&a.position, &[x, -y, z]) < 1e-9);
            prop_assert!(distance(&a.attitude, &[w, -i, j, -k]) < 1e-9);
        }
    }
}

#[test]
fn every_index_has_one_name_that_leads_back() {
    let layout = Layout::new(vec!["bow".into(), "stern".into()]);
    for index in 0..layout.len() {
        assert_eq!(layout.index(&layout.name(index)), Some(index), "{}", layout.name(index));
    }
}

#[test]
fn symmetric_added_mass_shares_one_coefficient() {
    let layout = Layout::new(vec![]);
    assert_eq!(layout.index("N_vdot"), layout.index("Y_rdot"));
    assert_eq!(layout.name(layout.index("M_wdot").unwrap()), "Z_qdot");
}
