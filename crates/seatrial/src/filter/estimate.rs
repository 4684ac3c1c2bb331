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
use crate::number::algebra::{Mat3, Vec3, Vec6, dot, each, transposed_product};
use crate::number::real::Real;

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

/// One number per component of the error.
pub type Components<T> = [T; STATES];

/// The mean of the state, of one vehicle or of several abreast.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<T = f64> {
    /// Position, attitude and velocity through the water.
    pub motion: State<T>,
    /// Force on the vehicle that its model does not know, body frame, N and N m.
    pub force: Vec6<T>,
    /// Velocity of the water, NED, m/s.
    pub current: Vec3<T>,
    /// What the gyro shows at rest, rad/s.
    pub gyro_bias: Vec3<T>,
}

impl Estimate {
    /// A vehicle at rest in still water, heading north at the origin.
    pub fn at_rest() -> Self {
        Self::at_rest_in(0.0)
    }
}

impl<T: Real> Estimate<T> {
    /// [`Estimate::at_rest`] in the kind of `unit`.
    #[inline(always)]
    pub fn at_rest_in(unit: T) -> Self {
        let (zero, one) = (unit.zero(), unit.splat(1.0));
        let motion = State { position: [zero; 3], attitude: [one, zero, zero, zero], nu: [zero; 6] };
        Self { motion, force: [zero; 6], current: [zero; 3], gyro_bias: [zero; 3] }
    }

    /// The rotation body → NED.
    #[inline(always)]
    pub fn rotation(&self) -> Mat3<T> {
        rotation(&self.motion.attitude)
    }

    /// Linear velocity over ground in the body frame, m/s.
    #[inline(always)]
    pub fn over_ground(&self) -> Vec3<T> {
        let mut velocity = transposed_product(&self.rotation(), &self.current);
        for i in 0..3 {
            velocity[i] += self.motion.nu[i];
        }
        velocity
    }

    /// Moves the estimate by an error; see [`Self::is_finite`].
    #[inline(always)]
    pub fn inject(&mut self, error: &Components<T>) {
        add(&mut self.motion.position, error, POSITION);
        let delta = [error[ATTITUDE], error[ATTITUDE + 1], error[ATTITUDE + 2]];
        let turned = quaternion_product(&self.motion.attitude, &exponential(&delta));
        self.motion.attitude = normalised(&turned);
        add(&mut self.motion.nu, error, VELOCITY);
        add(&mut self.force, error, FORCE);
        add(&mut self.current, error, CURRENT);
        add(&mut self.gyro_bias, error, GYRO_BIAS);
    }

    /// Whether all of it is a number.
    #[inline(always)]
    pub fn is_finite(&self) -> T::Mask {
        // What is not finite leaves no zero.
        let mut rest = self.force[0].zero();
        for x in self.motion.row() {
            rest += x * 0.0;
        }
        for x in self.force.iter().chain(&self.current).chain(&self.gyro_bias) {
            rest += *x * 0.0;
        }
        rest.lt(rest.splat(1.0))
    }

    /// The error that leads from here to `other`: what [`Self::inject`] takes.
    #[inline(always)]
    pub fn error_of(&self, other: &Self) -> Components<T> {
        let mut error = [self.force[0].zero(); STATES];
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

    /// `a` where the mask holds, `b` elsewhere.
    #[inline(always)]
    pub fn select(mask: T::Mask, a: &Self, b: &Self) -> Self {
        Self {
            motion: State {
                position: chosen(mask, &a.motion.position, &b.motion.position),
                attitude: chosen(mask, &a.motion.attitude, &b.motion.attitude),
                nu: chosen(mask, &a.motion.nu, &b.motion.nu),
            },
            force: chosen(mask, &a.force, &b.force),
            current: chosen(mask, &a.current, &b.current),
            gyro_bias: chosen(mask, &a.gyro_bias, &b.gyro_bias),
        }
    }
}

#[inline(always)]
fn add<T: Real, const N: usize>(to: &mut [T; N], error: &Components<T>, first: usize) {
    for i in 0..N {
        to[i] += error[first + i];
    }
}

/// `a` where the mask holds, `b` elsewhere.
#[inline(always)]
pub(crate) fn chosen<T: Real, const N: usize>(mask: T::Mask, a: &[T; N], b: &[T; N]) -> [T; N] {
    let mut both = *b;
    for i in 0..N {
        both[i] = T::select(mask, a[i], b[i]);
    }
    both
}

/// The unit quaternion of the rotation vector `delta`, rad.
#[inline(always)]
pub fn exponential<T: Real>(delta: &Vec3<T>) -> Quaternion<T> {
    let angle = dot(delta, delta).sqrt();
    let (sine, cosine) = (angle * 0.5).sin_cos();
    let scale = T::select(angle.lt(angle.splat(1e-9)), angle.splat(0.5), sine / angle);
    [cosine, delta[0] * scale, delta[1] * scale, delta[2] * scale]
}

/// The rotation vector from one attitude to another in the frame of the first, rad; its length is at most π.
#[inline(always)]
pub fn between<T: Real>(from: &Quaternion<T>, to: &Quaternion<T>) -> Vec3<T> {
    let [w, x, y, z] = *from;
    let turn = quaternion_product(&[w, -x, -y, -z], to);
    let one = w.splat(1.0);
    let sign = T::select(turn[0].lt(one.zero()), -one, one);
    let [w, x, y, z] = each(&turn, |part| part * sign);
    let sine = dot(&[x, y, z], &[x, y, z]).sqrt();
    let scale = T::select(sine.lt(one.splat(1e-9)), one * 2.0, sine.atan2(w) * 2.0 / sine);
    [x * scale, y * scale, z * scale]
}
