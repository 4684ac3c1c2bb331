//! Ocean current: only the relative motion counts, and a current that grows pulls the added mass along.

use crate::vehicles::{attitude, body, distance, fly, load, moving, times, velocity, with};
use proptest::array::{uniform3, uniform6};
use proptest::prelude::*;
use seatrial::description::assembly::Structure;
use seatrial::fit::inputs::Inputs;
use seatrial::model::current::Current;
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{from_euler, rotation};
use seatrial::model::vehicle::{Mode, Vehicle};
use seatrial::number::algebra::{add_cross, transposed_product};

properties! {
    #![cases(8)]

    #[test]
    fn law_a_current_and_the_same_drift_are_still_water(
        rpm in uniform6(300.0..1500.0),
        (roll, pitch, yaw) in (-0.3..0.3, -0.3..0.3, -3.0..3.0),
        nu in velocity(0.5, 0.2),
        flow in uniform3(-0.5..0.5),
    ) {
        let start = from_euler(&[roll, pitch, yaw]);
        // Off-centre mass and coupled added mass, so that every term takes part.
        let coefficients = [("x_g", 0.05), ("y_g", 0.01), ("z_g", 0.02), ("Y_rdot", -4.0), ("Z_qdot", 3.0)];
        let description = with(&load("cwolf"), &coefficients);
        let names = ["SbU", "SbL", "PU", "PL", "VTB", "VTS"];
        let run = |current: [f64; 3], nu: [f64; 6]| {
            let commands = names.iter().zip(rpm).map(|(name, n)| (name.to_string(), vec![n; 601]));
            let inputs = Inputs {
                t: times(601, 0.1),
                commands: commands.collect(),
                current: vec![current],
                ..Inputs::default()
            };
            fly(&description, &inputs, State { attitude: start, ..moving(nu) }, "XYZKMN", 10)
        };
        let still = run([0.0; 3], nu);
        let along = transposed_product(&rotation(&start), &flow);
        let drifting = run(flow, std::array::from_fn(|i| nu[i] + if i < 3 { along[i] } else { 0.0 }));
        for (k, (a, b)) in still.states.iter().zip(&drifting.states).enumerate() {
            let moved = std::array::from_fn(|i| b.position[i] - flow[i] * 0.1 * k as f64);
            // The bound of the model's laws, at 10 ms: RK4's error differs between the two.
            prop_assert!(distance(&a.position, &moved) < 1e-6, "{:?} {moved:?}", a.position);
            prop_assert!(distance(&a.attitude, &b.attitude) < 1e-6);
        }
    }

    #[test]
    fn law_a_growing_current_pulls_the_added_mass(body in body(), start in attitude(), flow in uniform3(-1.0..1.0)) {
        // Ahead of any rotation: all axes but the three translations are frozen.
        let description = body.vehicle();
        let inputs = |current: Vec<[f64; 3]>| Inputs { t: times(101, 0.1), current, ..Inputs::default() };
        let growing = (0..101).map(|k| flow.map(|x| 0.01 * f64::from(k) * x)).collect();
        let state = State { attitude: start, ..moving([0.0; 6]) };
        let [with, without] = [growing, vec![]].map(|c| {
            fly(&description, &inputs(c), state, "XYZ", 1).states[100].nu
        });
        // (m + M_A) ν' = M_A v_c' at a steady attitude: impulse of the water's acceleration.
        let gained: [f64; 3] = std::array::from_fn(|i| with[i] - without[i]);
        let along = transposed_product(&rotation(&start), &flow);
        for i in 0..3 {
            let added = |x: &[f64; 3]| (0..3).map(|j| body.added[i][j] * x[j]).sum::<f64>();
            let impulse = body.mass * gained[i] + added(&gained) - added(&along);
            // Exact for RK4 (linear in time): rounding of impulses up to a few hundred N s.
            prop_assert!(impulse.abs() < 1e-10, "{impulse:e} N s");
        }
    }
}

#[test]
fn law_the_water_of_waves_pushes_the_displaced_volume() {
    let description = with(&load("cwolf"), &[("z_b", -0.03), ("x_b", 0.1)]);
    let structure = Structure::new(&description, &[]);
    let vehicle = Vehicle::new(
        &description,
        &structure,
        &description.coefficients,
        description.file.environment,
        [Mode::Free; 6],
    );
    let (r, a) = (rotation(&from_euler(&[0.2, -0.3, 1.0])), [0.3, -0.2, 0.5]);
    let driven = |pressed| {
        let current = Current { velocity: [0.1, 0.2, 0.0], rate: a, pressed };
        vehicle.forces(&r, &[1.0, 0.1, -0.2, 0.1, 0.0, 0.3], Some(&current))
    };
    let (waves, current) = (driven(Some(a)), driven(None));
    let along = transposed_product(&r, &a);
    let displaced = vehicle.restoring.displaced;
    let moment = add_cross(&vehicle.restoring.displaced_moment, &along, &[0.0; 3]);
    for i in 0..3 {
        assert!((waves.restoring[i] - current.restoring[i] - displaced * along[i]).abs() < 1e-9);
        assert!((waves.restoring[i + 3] - current.restoring[i + 3] - moment[i]).abs() < 1e-9);
    }
    // The added mass is pulled alike, whatever drives the water.
    assert_eq!(waves.added_mass, current.added_mass);
}
