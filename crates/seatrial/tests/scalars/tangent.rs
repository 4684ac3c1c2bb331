//! A and B of the equation of motion: against difference quotients of the plain model, and both sets of
//! coordinates against each other.

use crate::scalars::flights::{NAMES, vehicle};
use crate::vehicles::{attitude, body, velocity, with};
use proptest::array::uniform3;
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::model::current::Current;
use seatrial::model::kinematics::{
    Quaternion, euler_rate, from_euler, normalised, quaternion_product, rotation, to_euler,
};
use seatrial::model::linearize::{Form, Tangent, linearize};
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::algebra::{Vec3, Vec6, product, skew};
use seatrial::number::dual::Dual;

/// Where the tangent is taken.
#[derive(Clone, Copy, Debug)]
struct Point {
    attitude: Quaternion<f64>,
    nu: Vec6<f64>,
    tau: Vec6<f64>,
    current: Option<Current<f64>>,
}

impl Point {
    fn tangent(&self, description: &Description, form: Form) -> Tangent {
        let vehicle = Vehicle::nominal_in(description, Dual { value: 0.0, partials: 0.0 });
        linearize(&vehicle, form, &self.attitude, &self.nu, (&self.tau, self.current.as_ref(), None))
    }

    /// `x'` in plain numbers where state and wrench are `change` away; without `δ'`, which is zero here.
    fn rate(&self, vehicle: &Vehicle<f64>, form: Form, change: &[f64; 18]) -> [f64; 12] {
        let angle: Vec3<f64> = std::array::from_fn(|i| change[3 + i]);
        let nu: Vec6<f64> = std::array::from_fn(|i| self.nu[i] + change[6 + i]);
        let tau = std::array::from_fn(|i| self.tau[i] + change[12 + i]);
        let euler = to_euler(&self.attitude);
        let moved: Vec3<f64> = std::array::from_fn(|i| euler[i] + angle[i]);
        let attitude = match form {
            Form::Rotation => quaternion_product(&self.attitude, &exponential(&angle)),
            Form::Euler => from_euler(&moved),
        };
        let r = rotation(&attitude);
        let instant = Instant { tau, current: self.current, ..Instant::default() };
        let acceleration = vehicle.acceleration((None, &r), &nu, &instant);
        let turning = match form {
            Form::Rotation => [0.0; 3],
            Form::Euler => {
                let [_, _, _, roll, pitch, yaw] = euler_rate(&moved, &nu);
                [roll, pitch, yaw]
            }
        };
        let [x, y, z] = product(&r, &[nu[0], nu[1], nu[2]]);
        let ([a, b, c], [u, v, w, p, q, s]) = (turning, acceleration);
        [x, y, z, a, b, c, u, v, w, p, q, s]
    }
}

/// The unit quaternion of the rotation vector `delta`.
fn exponential(delta: &Vec3<f64>) -> Quaternion<f64> {
    let angle = delta.iter().map(|x| x * x).sum::<f64>().sqrt();
    let scale = if angle == 0.0 { 0.5 } else { (0.5 * angle).sin() / angle };
    [(0.5 * angle).cos(), delta[0] * scale, delta[1] * scale, delta[2] * scale]
}

/// Checks A and B by central differences.
fn agree(description: &Description, at: &Point, form: Form) {
    let tangent = at.tangent(description, form);
    let vehicle = Vehicle::nominal(description);
    for column in 0..18 {
        let moved = |step: f64| {
            let change = std::array::from_fn(|i| if i == column { step } else { 0.0 });
            at.rate(&vehicle, form, &change)
        };
        let step = 1e-5;
        let (ahead, back) = (moved(step), moved(-step));
        for row in 0..12 {
            if form == Form::Rotation && (3..6).contains(&row) {
                continue;
            }
            let expected = (ahead[row] - back[row]) / (2.0 * step);
            let found = if column < 12 { tangent.a[row][column] } else { tangent.b[row][column - 12] };
            // Rounding of accelerations up to 1e3, 1e-13/step; step² times a third derivative up to 1e2
            // (1/cos² of the pitch); a velocity within the step of zero bends |v| v by the step.
            assert!(
                (found - expected).abs() < 1e-6 * (1.0 + expected.abs()) + 1e-5 * drag(description),
                "{form:?}, row {row}, column {column}: {found} against {expected}"
            );
        }
    }
}

/// The largest quadratic damping per mass or inertia: what a velocity of zero costs the difference quotient.
fn drag(description: &Description) -> f64 {
    let own = |name: &str| description.coefficients[description.layout.find(name).expect("a known name")];
    let of = |quadratic: &str, inertia: &str| (own(quadratic) / own(inertia)).abs();
    [of("X_uu", "m"), of("K_pp", "I_x"), of("M_qq", "I_y"), of("N_rr", "I_z")].into_iter().fold(0.0, f64::max)
}

fn point() -> impl Strategy<Value = Point> {
    let flow = (any::<bool>(), uniform3(-0.5..0.5), uniform3(-0.05..0.05));
    (attitude(), velocity(2.0, 1.0), velocity(40.0, 10.0), flow).prop_map(
        |(attitude, nu, tau, (flows, velocity, rate))| Point {
            attitude,
            nu,
            tau,
            current: flows.then_some(Current { velocity, rate, pressed: None }),
        },
    )
}

/// `Θ' = T ω`, by columns of ω.
fn euler_matrix(attitude: &Quaternion<f64>) -> [[f64; 3]; 3] {
    let euler = to_euler(attitude);
    let column = |k: usize| euler_rate(&euler, &std::array::from_fn(|i| f64::from(u8::from(i == 3 + k))));
    let columns = [0, 1, 2].map(column);
    std::array::from_fn(|i| std::array::from_fn(|k| columns[k][3 + i]))
}

/// Asserts `A_Θ P = P A_δ` in the rows given, P = diag(1, T, 1), and the same for B.
fn consistent(description: &Description, at: &Point, rows: &[usize]) {
    let (delta, theta) = (at.tangent(description, Form::Rotation), at.tangent(description, Form::Euler));
    let t = euler_matrix(&at.attitude);
    let p: [[f64; 12]; 12] = std::array::from_fn(|i| {
        std::array::from_fn(|j| match (i / 3, j / 3) {
            (1, 1) => t[i - 3][j - 3],
            _ => f64::from(u8::from(i == j)),
        })
    });
    let size = delta.a.iter().flatten().fold(1.0, |m: f64, x| m.max(x.abs()));
    let scale = t.iter().flatten().fold(1.0, |m: f64, x| m.max(x.abs()));
    for &i in rows {
        for j in 0..12 {
            let left: f64 = (0..12).map(|k| theta.a[i][k] * p[k][j]).sum();
            let right: f64 = (0..12).map(|k| p[i][k] * delta.a[k][j]).sum();
            // Two orders of the same sums; the largest entry counts, times those of T.
            assert!(
                (left - right).abs() < 1e-12 * size * scale * scale,
                "({i}, {j}): {left} against {right}"
            );
        }
        for j in 0..6 {
            let right: f64 = (0..12).map(|k| p[i][k] * delta.b[k][j]).sum();
            assert!((theta.b[i][j] - right).abs() < 1e-12, "B ({i}, {j})");
        }
    }
}

properties! {
    #![cases(100)]

    #[test]
    fn scalar_tangents_are_finite_differences(at in point()) {
        for name in NAMES {
            let description = vehicle(name);
            agree(&description, &at, Form::Rotation);
            if to_euler(&at.attitude)[1].abs() < 1.3 {
                agree(&description, &at, Form::Euler);
            }
        }
    }

    #[test]
    fn scalar_tangents_of_any_body_are_finite_differences(body in body(), at in point()) {
        let added = [("Y_r", 3.0), ("M_ww", -2.0), ("N_uv", 4.0), ("K_0", 0.1), ("X_uu", -9.0)];
        agree(&with(&body.vehicle(), &added), &at, Form::Rotation);
    }

    #[test]
    fn law_both_sets_of_coordinates_say_the_same(at in point(), turning in any::<bool>()) {
        prop_assume!(to_euler(&at.attitude)[1].abs() < 1.3);
        // Where the vehicle does not turn, A_Θ is A_δ in other coordinates; where it turns, the change of the
        // coordinates' own rates comes in, but not in the rows of place and velocity.
        let nu = std::array::from_fn(|i| if turning || i < 3 { at.nu[i] } else { 0.0 });
        let rows: Vec<usize> = (0..12).filter(|i| !turning || !(3..6).contains(i)).collect();
        let at = Point { nu, ..at };
        for name in NAMES {
            consistent(&vehicle(name), &at, &rows);
        }
    }

    #[test]
    fn law_the_rotation_vector_turns_with_the_vehicle(at in point()) {
        let tangent = at.tangent(&vehicle("cwolf"), Form::Rotation);
        let omega = [at.nu[3], at.nu[4], at.nu[5]];
        let half = skew(&omega).map(|row| row.map(|x| -0.5 * x));
        let step = 1e-3;
        // δ after `time` seconds from `delta`: R_0 exp(S(δ)) turned on by ω.
        let later = |delta: &Vec3<f64>, omega: &Vec3<f64>, time: f64| {
            let turned = quaternion_product(&exponential(delta), &exponential(&omega.map(|x| x * time)));
            let [w, v @ ..] = normalised(&turned);
            let sine = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.map(|x| x * if sine == 0.0 { 2.0 } else { 2.0 * sine.atan2(w) / sine })
        };
        let rate = |delta: &Vec3<f64>, omega: &Vec3<f64>| -> Vec3<f64> {
            let (ahead, back) = (later(delta, omega, step), later(delta, omega, -step));
            std::array::from_fn(|i| (ahead[i] - back[i]) / (2.0 * step))
        };
        for j in 0..3 {
            let unit = |size: f64| std::array::from_fn(|i| if i == j { size } else { 0.0 });
            let (ahead, back) = (rate(&unit(step), &omega), rate(&unit(-step), &omega));
            for i in 0..3 {
                prop_assert_eq!(tangent.a[3 + i][3 + j], half[i][j]);
                let expected = (ahead[i] - back[i]) / (2.0 * step);
                // Difference of differences: step² times a derivative of order one, 1e-16/step².
                prop_assert!((half[i][j] - expected).abs() < 1e-5, "{} {}", half[i][j], expected);
                prop_assert_eq!(tangent.a[3 + i][9 + j], f64::from(u8::from(i == j)));
            }
        }
    }
}

#[test]
fn scalar_tangents_are_finite_at_rest_and_upright_or_not() {
    for name in NAMES {
        let description = vehicle(name);
        for pitch in [0.0, std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2] {
            let attitude = from_euler(&[0.0, pitch, 0.3]);
            let still = Some(Current { velocity: [0.0; 3], rate: [0.0; 3], pressed: None });
            for current in [None, still] {
                let at = Point { attitude, nu: [0.0; 6], tau: [0.0; 6], current };
                let tangent = at.tangent(&description, Form::Rotation);
                assert!(tangent.a.iter().flatten().chain(tangent.b.iter().flatten()).all(|x| x.is_finite()));
                agree(&description, &at, Form::Rotation);
            }
        }
    }
}
