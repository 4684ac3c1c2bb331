//! The tangent of the equation of motion: `x' ≈ f(x_0, τ_0) + A (x − x_0) + B (τ − τ_0)`, exact to rounding.
//!
//! Two sets of coordinates:
//! * [`Form::Rotation`]: `x = [p_n, δ, ν]` with `R = R_0 exp(S(δ))`, R_0 held: no singularity. Then
//!   `δ' = ω + ½ δ × ω + …`, so the block of δ' by δ is `−½ S(ω_0)`.
//! * [`Form::Euler`]: `x = [x y z φ θ ψ ν]`, `η' = J(η) ν`.
//!
//! Inputs are the six components of τ. `A = ∂f/∂x` by dual numbers, one column per evaluation.
//!
//! The pull of a tether goes by the place of the vehicle, which is not asked for: it is left out. So is the surface,
//! unless a depth below it is given.
//!
//! Source: Fossen (2011), sections 2.2 and 7.5.
//! Tests: `tests/scalars/tangent.rs` (both forms say the same), `tests/core/test_linearize.py` (finite differences
//! of the textbook model).

use crate::model::current::Current;
use crate::model::kinematics::{Quaternion, euler_rate, from_euler, quaternion_product, rotation, to_euler};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Vec3, Vec6, cross, product};
use crate::number::dual::Dual;
use crate::number::real::Real;

/// The coordinates of the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `[p_n, δ, ν]`.
    Rotation,
    /// `[x y z φ θ ψ ν]`.
    Euler,
}

/// A and B.
#[derive(Clone, Copy, Debug)]
pub struct Tangent {
    /// `∂x'/∂x`, by rows.
    pub a: [[f64; 12]; 12],
    /// `∂x'/∂τ`, by rows.
    pub b: [[f64; 6]; 12],
}

/// The tangent of a vehicle, whose constants have no partials, at an attitude, a velocity `nu` (m/s, rad/s), a wrench `tau`
/// (N, N m) and, where its surface counts, a depth of O (m).
pub fn linearize(
    vehicle: &Vehicle<Dual<f64>>,
    form: Form,
    attitude: &Quaternion<f64>,
    nu: &Vec6<f64>,
    (tau, current, depth): (&Vec6<f64>, Option<&Current<f64>>, Option<f64>),
) -> Tangent {
    let constant = |value: f64| Dual { value, partials: 0.0 };
    let current = current.map(|c| Current {
        velocity: c.velocity.map(constant),
        rate: c.rate.map(constant),
        pressed: c.pressed.map(|a| a.map(constant)),
    });
    let euler = to_euler(attitude).map(constant);
    let mut tangent = Tangent { a: [[0.0; 12]; 12], b: [[0.0; 6]; 12] };
    for column in 0..18 {
        let seed = |i: usize| if i == column { 1.0 } else { 0.0 };
        let angle: Vec3<Dual<f64>> = std::array::from_fn(|i| Dual { value: 0.0, partials: seed(3 + i) });
        let nu = std::array::from_fn(|i| Dual { value: nu[i], partials: seed(6 + i) });
        let tau = std::array::from_fn(|i| Dual { value: tau[i], partials: seed(12 + i) });
        let (attitude, kinematics) = match form {
            Form::Rotation => about(attitude, &angle, &nu),
            Form::Euler => {
                let euler: Vec3<Dual<f64>> = std::array::from_fn(|i| euler[i] + angle[i]);
                (from_euler(&euler), euler_rate(&euler, &nu))
            }
        };
        let instant = Instant { inflow_free: Some(tau), current, ..Instant::default() };
        let place = depth.map(|depth| {
            let at = [0.0, 0.0, depth];
            std::array::from_fn(|i| Dual { value: at[i], partials: seed(i) })
        });
        let acceleration = vehicle.acceleration((place.as_ref(), &rotation(&attitude)), &nu, &instant);
        for i in 0..12 {
            let rate = if i < 6 { kinematics[i] } else { acceleration[i - 6] };
            match column {
                0..12 => tangent.a[i][column] = rate.partials,
                _ => tangent.b[i][column - 12] = rate.partials,
            }
        }
    }
    tangent
}

/// The attitude `R_0 exp(S(δ))` and `[R v, ω + ½ δ × ω]`, to first order in δ.
fn about<T: Real>(origin: &Quaternion<f64>, delta: &Vec3<T>, nu: &Vec6<T>) -> (Quaternion<T>, Vec6<T>) {
    let one = delta[0].splat(1.0);
    let small = [one, delta[0] * 0.5, delta[1] * 0.5, delta[2] * 0.5];
    let attitude = quaternion_product(&origin.map(|x| one.splat(x)), &small);
    let [u, v, w, p, q, r] = *nu;
    let [north, east, down] = product(&rotation(&attitude), &[u, v, w]);
    let twist = cross(delta, &[p, q, r]);
    (attitude, [north, east, down, p + twist[0] * 0.5, q + twist[1] * 0.5, r + twist[2] * 0.5])
}
