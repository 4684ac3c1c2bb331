//! Energy: conserved without forces, never added by damping; weight and buoyancy have a potential.

use crate::vehicles::{GRAVITY, attitude, body, energy, fly, hull, load, moving, times, value, velocity};
use proptest::array::uniform6;
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::fit::inputs::Inputs;
use seatrial::model::added_mass::AddedMass;
use seatrial::model::damping::Damping;
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{normalised, quaternion_rate, rotation};
use seatrial::model::rigid_body::RigidBody;
use seatrial::model::vehicle::Vehicle;

/// The largest change of the total energy in `duration` seconds, over the initial kinetic energy and that
/// of lifting the centre of gravity by 50 mm.
fn drift(description: &Description, start: State<f64>, duration: f64, h: f64) -> f64 {
    let dt = 0.1;
    let count = (duration / dt) as usize + 1;
    let inputs = Inputs { t: times(count, dt), ..Inputs::default() };
    let run = fly(description, &inputs, start, "XYZKMN", (dt / h).round() as usize);
    let total = |state: &State<f64>| energy(description, state).iter().sum::<f64>();
    let change = run.states.iter().map(|s| (total(s) - total(&start)).abs()).fold(0.0, f64::max);
    change / (energy(description, &start)[0] + 0.05 * GRAVITY * value(description, "m"))
}

properties! {
    #![cases(12)]

    #[test]
    fn law_energy_is_conserved(body in body(), nu in velocity(1.0, 0.8)) {
        let description = body.vehicle();
        let drift = drift(&description, moving(nu), 60.0, 1e-3);
        // The bound of the model's laws.
        prop_assert!(drift < 1e-9, "{drift:e}");
    }
}

properties! {
    #![cases(24)]

    #[test]
    fn law_energy_drift_falls_with_the_fourth_power_of_the_step(body in body(), nu in velocity(1.0, 2.0)) {
        let description = body.vehicle();
        let [coarse, fine] = [0.01, 0.0025].map(|h| drift(&description, moving(nu), 20.0, h));
        // 16 per halving in the limit; the fifth-order term may cancel half of the coarse step's error.
        // Third order would give 64. 1e-12 is rounding.
        prop_assert!(fine < coarse / 90.0 + 1e-12, "{coarse:e} -> {fine:e}");
    }
}

#[test]
fn law_energy_drift_of_a_spinning_body_falls_sixteenfold_per_halving() {
    // CWolf without damping and lift, 50 mm between its centres.
    let cwolf = load("cwolf");
    let kept = |i: usize| i < 35 && cwolf.coefficients[i] != 0.0;
    let mut coefficients: Vec<(String, f64)> = (0..cwolf.layout.len())
        .filter(|&i| kept(i))
        .map(|i| (cwolf.layout.name(i), cwolf.coefficients[i]))
        .collect();
    coefficients.extend([("z_g".to_owned(), 0.03)]);
    let description = hull(&coefficients);
    let spin = moving([0.5, 0.2, -0.1, 2.0, 0.5, -1.0]);
    let drifts = [0.1, 0.05, 0.025, 0.0125].map(|h| drift(&description, spin, 60.0, h));
    for pair in drifts.windows(2) {
        assert!(pair[1] < pair[0] / 16.0, "{drifts:?}");
    }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_coriolis_forces_do_no_work(body in body(), nu in velocity(3.0, 2.0)) {
        let i = &body.i_o;
        let rigid = RigidBody::new(
            body.mass,
            body.r_g,
            [i[0][0], i[1][1], i[2][2], -i[0][1], -i[0][2], -i[1][2]],
        );
        for force in [rigid.add_coriolis(&nu, &[0.0; 6]), AddedMass::Full(body.added).add_coriolis(&nu, &[0.0; 6])] {
            let power: f64 = (0..6).map(|i| nu[i] * force[i]).sum();
            let scale: f64 = (0..6).map(|i| (nu[i] * force[i]).abs()).sum();
            // Rounding of some twenty products, each up to ten times the sum of their magnitudes.
            prop_assert!(power.abs() <= 1e-13 * scale + 1e-12, "{power:e} of {scale:e}");
        }
    }

    #[test]
    fn law_diagonal_damping_never_adds_energy(
        linear in uniform6(-100.0..0.0),
        quadratic in uniform6(-100.0..0.0),
        nu in velocity(3.0, 2.0),
    ) {
        let force = Damping::Diagonal { linear, quadratic }.add(&nu, &[0.0; 6]);
        for i in 0..6 {
            // Exact: the sign of a product is the product of the signs.
            prop_assert!(force[i] * nu[i] < 0.0 || nu[i] == 0.0);
        }
    }

    #[test]
    fn law_restoring_force_is_the_gradient_of_potential_energy(
        body in body(),
        attitude in attitude(),
        nu in velocity(1.0, 1.0),
    ) {
        let description = body.vehicle();
        let at = |step: f64| {
            let r = rotation(&attitude);
            let position = std::array::from_fn(|i| step * (0..3).map(|j| r[i][j] * nu[j]).sum::<f64>());
            let turn = quaternion_rate(&attitude, &[nu[3], nu[4], nu[5]]);
            let attitude = normalised(&std::array::from_fn(|i| attitude[i] + step * turn[i]));
            energy(&description, &State { position, attitude, nu })[1]
        };
        let step = 1e-4;
        let slope = (at(step) - at(-step)) / (2.0 * step);
        let force = Vehicle::nominal(&description).forces(&rotation(&attitude), &nu, None).restoring;
        let power: f64 = (0..6).map(|i| force[i] * nu[i]).sum();
        let weight = body.mass * GRAVITY;
        // Central difference: truncation step²/6 and rounding 1e-16/step of a weight's energy.
        prop_assert!((power + slope).abs() < 1e-8 * weight, "{power} against {}", -slope);
    }
}
