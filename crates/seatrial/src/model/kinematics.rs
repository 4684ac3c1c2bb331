//! Attitude and position: `p_n' = R v`, `q' = ½ q ⊗ [0, ω]`.
//!
//! Frames: n is north-east-down, b is forward-starboard-down with origin O. `R` maps b to n. The
//! attitude is a unit quaternion `[w x y z]` (b → n): no singularity at θ = ±90°, no trigonometry in
//! the hot loop. Euler angles (roll φ, pitch θ, yaw ψ; rotations ZYX) stand at the edges only.
//!
//! Source: Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control* (2011), section 2.2.
//! Tests: `tests/laws.rs` (quaternion and Euler rates agree, round trips, R is a rotation).

use crate::number::algebra::{Mat3, Vec3, Vec6, dot, each};
use crate::number::real::Real;

/// A unit quaternion `[w x y z]`, body → NED.
pub type Quaternion<T> = [T; 4];

/// The rotation matrix `R(q)`, body → NED.
#[inline(always)]
pub fn rotation<T: Real>(q: &Quaternion<T>) -> Mat3<T> {
    let [w, x, y, z] = *q;
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let one = w.splat(1.0);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    let diagonal_x = x2.neg_mul_add(x, one);
    [
        [z2.neg_mul_add(z, y2.neg_mul_add(y, one)), x.mul_sub(y2, wz), x.mul_add(z2, wy)],
        [x.mul_add(y2, wz), z2.neg_mul_add(z, diagonal_x), y.mul_sub(z2, wx)],
        [x.mul_sub(z2, wy), y.mul_add(z2, wx), y2.neg_mul_add(y, diagonal_x)],
    ]
}

/// `q' = ½ q ⊗ [0, ω]`, ω in the body frame, rad/s.
#[inline(always)]
pub fn quaternion_rate<T: Real>(q: &Quaternion<T>, omega: &Vec3<T>) -> Quaternion<T> {
    let [w, x, y, z] = each(q, |c| c * 0.5);
    let [p, q, r] = *omega;
    [
        -(x.mul_add(p, y.mul_add(q, z * r))),
        w.mul_add(p, y.mul_sub(r, z * q)),
        w.mul_add(q, z.mul_sub(p, x * r)),
        w.mul_add(r, x.mul_sub(q, y * p)),
    ]
}

/// `a ⊗ b`: the rotation `b` followed by `a`.
#[inline(always)]
pub fn quaternion_product<T: Real>(a: &Quaternion<T>, b: &Quaternion<T>) -> Quaternion<T> {
    let [w, x, y, z] = *a;
    let [s, i, j, k] = *b;
    [
        w.mul_sub(s, x.mul_add(i, y.mul_add(j, z * k))),
        w.mul_add(i, x.mul_add(s, y.mul_sub(k, z * j))),
        w.mul_add(j, y.mul_add(s, z.mul_sub(i, x * k))),
        w.mul_add(k, z.mul_add(s, x.mul_sub(j, y * i))),
    ]
}

/// The unit quaternion in the direction of `q`.
#[inline(always)]
pub fn normalised<T: Real>(q: &Quaternion<T>) -> Quaternion<T> {
    let scale = q[0].splat(1.0) / dot(q, q).sqrt();
    each(q, |c| c * scale)
}

/// The unit quaternion in the direction of `q`, whose length one step has moved off 1 by ε ≪ 1.
///
/// Two Newton steps for 1/|q| from 1 leave an error of order ε⁴, without root and division.
#[inline(always)]
pub fn renormalised<T: Real>(q: &Quaternion<T>) -> Quaternion<T> {
    let half_square = dot(q, q) * 0.5;
    let first = half_square.splat(1.5) - half_square;
    let second = (half_square * first).neg_mul_add(first, first.splat(1.5));
    let scale = first * second;
    each(q, |c| c * scale)
}

/// `q = q_z(ψ) ⊗ q_y(θ) ⊗ q_x(φ)` from roll, pitch and yaw, rad.
#[inline(always)]
pub fn from_euler<T: Real>(euler: &Vec3<T>) -> Quaternion<T> {
    let [roll, pitch, yaw] = each(euler, |angle| angle * 0.5);
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    [
        (cr * cp).mul_add(cy, sr * sp * sy),
        (sr * cp).mul_sub(cy, cr * sp * sy),
        (cr * sp).mul_add(cy, sr * cp * sy),
        (cr * cp).mul_sub(sy, sr * sp * cy),
    ]
}

/// Roll, pitch and yaw in rad; pitch in [−π/2, π/2].
#[inline(always)]
pub fn to_euler<T: Real>(q: &Quaternion<T>) -> Vec3<T> {
    let r = rotation(q);
    [euler_angle(&r, 0), euler_angle(&r, 1), euler_angle(&r, 2)]
}

/// Roll (0), pitch (1) or yaw (2) of a rotation, rad.
#[inline(always)]
pub fn euler_angle<T: Real>(r: &Mat3<T>, axis: usize) -> T {
    match axis {
        0 => r[2][1].atan2(r[2][2]),
        1 => (-r[2][0]).atan2(cosine_of_pitch(r)),
        _ => r[1][0].atan2(r[0][0]),
    }
}

/// The cosine of the pitch of a rotation.
#[inline(always)]
pub fn cosine_of_pitch<T: Real>(r: &Mat3<T>) -> T {
    r[2][1].mul_add(r[2][1], r[2][2] * r[2][2]).sqrt()
}

/// `η' = J(η) ν` in Euler angles: NED velocity and the rates of roll, pitch and yaw.
///
/// Not a number at θ = ±90°, where Euler rates do not exist.
pub fn euler_rate<T: Real>(euler: &Vec3<T>, nu: &Vec6<T>) -> Vec6<T> {
    let [u, v, w, p, q, r] = *nu;
    let matrix = rotation(&from_euler(euler));
    let linear = crate::number::algebra::product(&matrix, &[u, v, w]);
    let [(sr, cr), (sp, cp), _] = euler.map(Real::sin_cos);
    let along_yaw = (q * sr + r * cr) / cp;
    [linear[0], linear[1], linear[2], p + sp * along_yaw, q * cr - r * sr, along_yaw]
}
