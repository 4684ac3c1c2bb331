//! The state of the filter and its error.
//!
//! `x = [p_n, q, ν_r, τ_u, v_c, b_g]`: position of O (NED, m), attitude, velocity **through the water** (body, m/s and
//! rad/s), unmodelled force (body, N and N m), current (NED, m/s) and bias of the gyro (rad/s). The velocity over ground
//! is `v + R(q)ᵀ v_c`. Written in ν_r the equation of motion does not contain a constant current at all (Galilean
//! invariance), so that its Jacobian has 15 columns in place of 18.
//!
//! The error has 24 components: `p = p̂ + δp`, `R = R̂ exp(S(δ))`, and a sum for the rest.
//!
//! Source: Solà (2017), section 5.3 (nominal state, error in the local frame) and 6.2 (injection); Fossen (2011),
//! section 8.3 (relative velocity).

use crate::model::integrate::State;
use crate::model::kinematics::{Quaternion, normalised, quaternion_product, rotation};
use crate::number::algebra::{Mat3, Vec3, Vec6, transposed_product};

/// The number of components of the error.
pub const STATES: usize = 24;

/// The first component of each part: position, attitude, velocity, unmodelled force, current, gyro bias.
pub const POSITION: usize = 0;
/// See [`POSITION`].
pub const ATTITUDE: usize = 3;
/// See [`POSITION`].
pub const VELOCITY: usize = 6;
/// See [`POSITION`].
pub const FORCE: usize = 12;
/// See [`POSITION`].
pub const CURRENT: usize = 18;
/// See [`POSITION`].
pub const GYRO_BIAS: usize = 21;

/// The mean of the state.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Position, attitude and velocity through the water.
    pub motion: State<f64>,
    /// Force on the vehicle that its model does not know, body frame, N and N m.
    pub force: Vec6<f64>,
    /// Velocity of the water, NED, m/s.
    pub current: Vec3<f64>,
    /// What the gyro shows at rest, rad/s.
    pub gyro_bias: Vec3<f64>,
}

impl Estimate {
    /// A vehicle at rest in still water, heading north at the origin.
    pub fn at_rest() -> Self {
        let motion = State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] };
        Self { motion, force: [0.0; 6], current: [0.0; 3], gyro_bias: [0.0; 3] }
    }

    /// The rotation body → NED.
    pub fn rotation(&self) -> Mat3<f64> {
        rotation(&self.motion.attitude)
    }

    /// Linear velocity over ground in the body frame, m/s.
    pub fn over_ground(&self) -> Vec3<f64> {
        let flow = transposed_product(&self.rotation(), &self.current);
        std::array::from_fn(|i| self.motion.nu[i] + flow[i])
    }

    /// Moves the estimate by an error and returns whether all of it is a number.
    pub fn inject<const N: usize>(&mut self, error: &[f64; N]) -> bool {
        let add = |to: &mut [f64], first: usize| {
            for (x, e) in to.iter_mut().zip(&error[first..]) {
                *x += e;
            }
        };
        add(&mut self.motion.position, POSITION);
        let delta = [error[ATTITUDE], error[ATTITUDE + 1], error[ATTITUDE + 2]];
        let turned = quaternion_product(&self.motion.attitude, &exponential(&delta));
        self.motion.attitude = normalised(&turned);
        add(&mut self.motion.nu, VELOCITY);
        add(&mut self.force, FORCE);
        add(&mut self.current, CURRENT);
        add(&mut self.gyro_bias, GYRO_BIAS);
        error.iter().all(|e| e.is_finite())
    }

    /// The error that leads from here to `other`: what [`Self::inject`] takes.
    pub fn error_of(&self, other: &Self) -> [f64; STATES] {
        let mut error = [0.0; STATES];
        for i in 0..3 {
            error[POSITION + i] = other.motion.position[i] - self.motion.position[i];
            error[CURRENT + i] = other.current[i] - self.current[i];
            error[GYRO_BIAS + i] = other.gyro_bias[i] - self.gyro_bias[i];
        }
        error[ATTITUDE..ATTITUDE + 3]
            .copy_from_slice(&between(&self.motion.attitude, &other.motion.attitude));
        for i in 0..6 {
            error[VELOCITY + i] = other.motion.nu[i] - self.motion.nu[i];
            error[FORCE + i] = other.force[i] - self.force[i];
        }
        error
    }
}

/// The unit quaternion of the rotation vector `delta`, rad.
pub fn exponential(delta: &Vec3<f64>) -> Quaternion<f64> {
    let angle = delta.iter().map(|x| x * x).sum::<f64>().sqrt();
    let scale = if angle < 1e-9 { 0.5 } else { (0.5 * angle).sin() / angle };
    [(0.5 * angle).cos(), delta[0] * scale, delta[1] * scale, delta[2] * scale]
}

/// The rotation vector from one attitude to another in the frame of the first, rad; its length is at most π.
pub fn between(from: &Quaternion<f64>, to: &Quaternion<f64>) -> Vec3<f64> {
    let [w, x, y, z] = *from;
    let [w, x, y, z] = quaternion_product(&[w, -x, -y, -z], to);
    let (w, x, y, z) = if w < 0.0 { (-w, -x, -y, -z) } else { (w, x, y, z) };
    let sine = (x * x + y * y + z * z).sqrt();
    let scale = if sine < 1e-9 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    [x * scale, y * scale, z * scale]
}
