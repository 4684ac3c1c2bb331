//! Vehicles to test with, and their flight through inputs.

#![allow(dead_code, reason = "every test binary uses a part")]

use proptest::array::{uniform3, uniform4, uniform6, uniform21};
use proptest::prelude::*;
use seatrial::description::coefficients::{FORCES, VELOCITIES, added_mass};
use seatrial::description::{Description, built_in};
use seatrial::fit::batch::{Batch, Run};
use seatrial::fit::inputs::{Inputs, modes};
use seatrial::fit::record::{MotorStart, Segment};
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{Quaternion, normalised, rotation};
use seatrial::model::vehicle::Vehicle;
use seatrial::number::algebra::{Mat6, Vec3, Vec6};
use std::sync::atomic::AtomicBool;

/// Gravity of every vehicle here, m/s².
pub const GRAVITY: f64 = 9.81;

/// A built-in vehicle.
pub fn load(name: &str) -> Description {
    Description::from_toml(built_in(name).expect("a built-in name"), name).expect("a valid built-in file")
}

/// A vehicle without actuators from its coefficients.
pub fn hull(coefficients: &[(String, f64)]) -> Description {
    let lines: String = coefficients.iter().map(|(name, value)| format!("{name} = {value:?}\n")).collect();
    Description::from_toml(&format!("format = 1\nname = \"hull\"\n[coefficients]\n{lines}"), "hull")
        .expect("a valid hull")
}

/// The same vehicle with some coefficients changed.
pub fn with(description: &Description, coefficients: &[(&str, f64)]) -> Description {
    let values: Vec<(String, f64)> = coefficients.iter().map(|(n, x)| ((*n).to_owned(), *x)).collect();
    description.with_coefficients(&values).expect("valid coefficients")
}

/// The value of a coefficient.
pub fn value(description: &Description, name: &str) -> f64 {
    description.coefficients[description.layout.find(name).expect("a known name")]
}

/// Mass, inertia, centres and added mass of a body: any physically possible ones.
#[derive(Clone, Debug)]
pub struct Body {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of gravity, m.
    pub r_g: Vec3<f64>,
    /// Centre of buoyancy, m.
    pub r_b: Vec3<f64>,
    /// Buoyancy over weight.
    pub buoyancy: f64,
    /// Inertia about O, by rows.
    pub i_o: [[f64; 3]; 3],
    /// M_A, positive definite and full.
    pub added: Mat6<f64>,
}

impl Body {
    /// Its coefficients by name.
    pub fn coefficients(&self) -> Vec<(String, f64)> {
        let i = &self.i_o;
        let mut named: Vec<(String, f64)> = [
            ("m", self.mass),
            ("I_x", i[0][0]),
            ("I_y", i[1][1]),
            ("I_z", i[2][2]),
            ("I_xy", -i[0][1]),
            ("I_xz", -i[0][2]),
            ("I_yz", -i[1][2]),
            ("x_g", self.r_g[0]),
            ("y_g", self.r_g[1]),
            ("z_g", self.r_g[2]),
            ("x_b", self.r_b[0]),
            ("y_b", self.r_b[1]),
            ("z_b", self.r_b[2]),
            ("B", self.buoyancy * self.mass * GRAVITY),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
        for row in 0..6 {
            for column in row..6 {
                let name = format!("{}_{}dot", FORCES[row], VELOCITIES[column]);
                named.push((name, -self.added[row][column]));
            }
        }
        named
    }

    /// The body as a vehicle without damping and actuators.
    pub fn vehicle(&self) -> Description {
        hull(&self.coefficients())
    }
}

/// Bodies of 5 to 300 kg and 0.8 to 2.5 m whose centre of gravity lies 20 to 80 mm below that of buoyancy.
pub fn body() -> impl Strategy<Value = Body> {
    let numbers = (5.0..300.0, 0.8..2.5, 0.999..1.001, 0.02..0.08);
    (numbers, uniform3(-0.03..0.03), uniform6(-1.0..1.0), uniform21(-1.0..1.0)).prop_map(
        |((mass, length, buoyancy, below), r_b, shape, factors): ((f64, f64, f64, f64), _, Vec6<f64>, _)| {
            let r_g = [r_b[0], r_b[1] + 0.005, r_b[2] + below];
            let size = mass * length * length;
            // About the centre of gravity: dominant diagonal, moments within the triangle inequality.
            let mut i_o = [[0.0; 3]; 3];
            for k in 0..3 {
                let (next, last) = ((k + 1) % 3, (k + 2) % 3);
                i_o[k][k] = size * (0.08 + 0.02 * shape[k]);
                i_o[next][last] = -0.01 * size * shape[3 + k];
                i_o[last][next] = i_o[next][last];
            }
            // Parallel axes: I_O = I_g + m (|r_g|² 1 − r_g r_gᵀ).
            let square: f64 = r_g.iter().map(|x: &f64| x * x).sum();
            for i in 0..3 {
                for j in 0..3 {
                    let unit = if i == j { square } else { 0.0 };
                    i_o[i][j] += mass * (unit - r_g[i] * r_g[j]);
                }
            }
            Body { mass, r_g, r_b, buoyancy, i_o, added: added(mass, 0.05 * size, &factors) }
        },
    )
}

/// A full positive definite M_A in proportion to a mass and an inertia: S (L Lᵀ/6 + 1/10) S.
fn added(mass: f64, inertia: f64, factors: &[f64; 21]) -> Mat6<f64> {
    let lower = |i: usize, j: usize| if j <= i { factors[i * (i + 1) / 2 + j] } else { 0.0 };
    let scale = |i: usize| if i < 3 { mass.sqrt() } else { inertia.sqrt() };
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let product: f64 = (0..6).map(|k| lower(i, k) * lower(j, k)).sum();
            scale(i) * (product / 6.0 + if i == j { 0.1 } else { 0.0 }) * scale(j)
        })
    })
}

/// Any attitude.
pub fn attitude() -> impl Strategy<Value = Quaternion<f64>> {
    uniform4(-1.0..1.0)
        .prop_filter("a direction", |q| q.iter().map(|x: &f64| x * x).sum::<f64>() > 0.01)
        .prop_map(|q| normalised(&q))
}

/// Any velocity up to `linear` m/s and `angular` rad/s per axis.
pub fn velocity(linear: f64, angular: f64) -> impl Strategy<Value = Vec6<f64>> {
    uniform6(-1.0..1.0)
        .prop_map(move |x: Vec6<f64>| std::array::from_fn(|i| x[i] * if i < 3 { linear } else { angular }))
}

/// At the origin, upright, with the velocity `nu`.
pub fn moving(nu: Vec6<f64>) -> State<f64> {
    State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu }
}

/// `count` times, `dt` seconds apart.
pub fn times(count: usize, dt: f64) -> Vec<f64> {
    (0..count).map(|k| k as f64 * dt).collect()
}

/// The run of a vehicle through inputs from a state, its motors stopped, with the `free` axes.
pub fn fly(
    description: &Description,
    inputs: &Inputs,
    state: State<f64>,
    free: &str,
    substeps: usize,
) -> Run {
    let stopped = MotorStart::Held(vec![0.0; description.actuators.len()]);
    fly_from(description, inputs, (state, stopped), (free, ""), substeps)
}

/// The run of a vehicle from a state and its motors, with the free and the measured axes.
pub fn fly_from(
    description: &Description,
    inputs: &Inputs,
    (state, motors): (State<f64>, MotorStart),
    (free, measured): (&str, &str),
    substeps: usize,
) -> Run {
    let record = inputs.record(description, !measured.is_empty(), substeps).expect("valid inputs");
    let segment = Segment { record: 0, start: 0, stop: record.len, state, current: [0.0; 3], motors };
    let batch = Batch {
        description,
        records: &[record],
        segments: &[segment],
        modes: modes(free, measured).expect("axes"),
        substeps,
    };
    batch.track(0, &AtomicBool::new(false)).expect("nobody interrupts")
}

/// Kinetic and potential energy, J; the latter from the places of weight and buoyancy.
pub fn energy(description: &Description, state: &State<f64>) -> [f64; 2] {
    let matrix = Vehicle::nominal(description).mass_matrix;
    let mut kinetic = 0.0;
    for i in 0..6 {
        for j in 0..6 {
            kinetic += 0.5 * state.nu[i] * matrix[i][j] * state.nu[j];
        }
    }
    let depth_of = |point: [&str; 3]| {
        let down = rotation(&state.attitude)[2];
        state.position[2] + (0..3).map(|i| down[i] * value(description, point[i])).sum::<f64>()
    };
    let weight = value(description, "m") * GRAVITY;
    let buoyancy = value(description, "B");
    [kinetic, buoyancy * depth_of(["x_b", "y_b", "z_b"]) - weight * depth_of(["x_g", "y_g", "z_g"])]
}

/// The largest difference of two rows.
pub fn distance<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, |m, x| if x.is_nan() { x } else { m.max(x) })
}

/// Index of a diagonal added-mass derivative.
pub fn diagonal(i: usize) -> usize {
    added_mass(i, i)
}
