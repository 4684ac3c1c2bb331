//! The equation of motion in lanes against `f64`, and finite at rest.

use crate::processor::wide;
use crate::vehicles::{attitude, body, distance, load, velocity, with};
use fearless_simd::{Simd, SimdBase, f64x8};
use proptest::array::uniform3;
use seatrial::description::Description;
use seatrial::description::assembly::Structure;
use seatrial::model::current::Current;
use seatrial::model::kinematics::{rotation, to_euler};
use seatrial::model::vehicle::{Instant, Mode, Vehicle};
use seatrial::number::lanes::LANES;
use seatrial::number::real::Real;

/// One point of the state space.
#[derive(Clone, Copy)]
struct Point {
    attitude: [f64; 4],
    nu: [f64; 6],
    flow: [f64; 3],
    signal: f64,
}

/// `ν'` and the Euler angles at a point, in the kind of `values`.
#[inline(always)]
fn acceleration<T: Real>(description: &Description, values: &[T], sought: &[usize], at: &Point) -> [T; 9] {
    let structure = Structure::new(description, sought);
    let environment = description.file.environment;
    let vehicle = Vehicle::new(description, &structure, values, environment, [Mode::Free; 6]);
    let unit = values[0];
    let q = at.attitude.map(|x| unit.splat(x));
    let thrusts = vehicle.actuators.iter().map(|a| a.characteristic.thrust(unit.splat(at.signal), 15.0));
    let instant = Instant {
        thrusts: thrusts.collect(),
        tau: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
        current: Some(Current {
            velocity: at.flow.map(|x| unit.splat(x)),
            rate: [0.01, 0.0, -0.01].map(|x| unit.splat(x)),
            pressed: Some([0.02, 0.01, 0.0].map(|x| unit.splat(x))),
        }),
        ..Instant::default()
    };
    let [u, v, w, p, q_, r] =
        vehicle.acceleration((None, &rotation(&q)), &at.nu.map(|x| unit.splat(x)), &instant);
    let [roll, pitch, yaw] = to_euler(&q);
    [u, v, w, p, q_, r, roll, pitch, yaw]
}

/// The same for eight candidates whose coefficients are `factors` of the vehicle's own.
#[inline(always)]
fn in_lanes<S: Simd>(
    simd: S,
    description: &Description,
    sought: &[usize],
    factors: &[f64; LANES],
    at: &Point,
) -> [[f64; LANES]; 9] {
    let values: Vec<f64x8<S>> =
        description.coefficients.iter().map(|&c| f64x8::from_fn(simd, |lane| factors[lane] * c)).collect();
    acceleration(description, &values, sought, at).map(Into::into)
}

/// The same on one instruction set, where this processor has it: `instruction_sets.rs` runs the model on
/// all of them, this compiles it once more for a single one.
fn on_processor(
    description: &Description,
    sought: &[usize],
    factors: &[f64; LANES],
    at: &Point,
) -> Option<[[f64; LANES]; 9]> {
    let simd = wide()?;
    Some(simd.vectorize(|| in_lanes(simd, description, sought, factors, at)))
}

/// Checks lanes against `f64`.
fn agree(description: &Description, sought: &[usize], at: &Point) {
    let factors: [f64; LANES] = std::array::from_fn(|lane| 0.8 + 0.05 * lane as f64);
    let lanes = on_processor(description, sought, &factors, at);
    for lane in 0..LANES {
        let values: Vec<f64> = description.coefficients.iter().map(|c| factors[lane] * c).collect();
        let expected = acceleration(description, &values, sought, at);
        assert!(expected.iter().all(|x| x.is_finite()), "{expected:?}");
        let Some(found) = lanes.map(|rows| rows.map(|row| row[lane])) else { continue };
        let size = expected.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
        // The bound of the model's laws, relative to the largest component.
        assert!(distance(&found, &expected) < 1e-12 * size, "{found:?} against {expected:?}");
    }
}

properties! {
    #![cases(64)]

    #[test]
    fn scalar_accelerations_of_the_built_in_vehicles_agree(
        attitude in attitude(),
        nu in velocity(2.0, 1.0),
        flow in uniform3(-0.5..0.5),
        signal in -400.0..400.0,
    ) {
        let at = Point { attitude, nu, flow, signal };
        for name in ["cwolf", "beluga"] {
            let description = load(name);
            let everything: Vec<usize> = (0..description.layout.len()).collect();
            for sought in [&[][..], &everything] {
                agree(&description, sought, &at);
            }
        }
    }

    #[test]
    fn scalar_accelerations_of_any_body_agree(
        body in body(),
        attitude in attitude(),
        nu in velocity(2.0, 1.0),
        flow in uniform3(-0.5..0.5),
    ) {
        let description = with(&body.vehicle(), &[("Y_r", 3.0), ("M_ww", -2.0), ("N_uv", 4.0), ("K_0", 0.1)]);
        agree(&description, &[], &Point { attitude, nu, flow, signal: 0.0 });
    }
}

#[test]
fn scalar_everything_is_finite_at_rest() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // Upright, upside down, and both ends of pitch.
    let attitudes =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [half, 0.0, half, 0.0], [half, 0.0, -half, 0.0]];
    for attitude in attitudes {
        for signal in [0.0, -0.0] {
            for name in ["cwolf", "beluga"] {
                let description = load(name);
                let everything: Vec<usize> = (0..description.layout.len()).collect();
                let at = Point { attitude, nu: [0.0; 6], flow: [0.0; 3], signal };
                let plain = acceleration(&description, &description.coefficients, &everything, &at);
                assert!(plain.iter().all(|x| x.is_finite()), "{name}: {plain:?}");
                agree(&description, &everything, &at);
            }
        }
    }
}
