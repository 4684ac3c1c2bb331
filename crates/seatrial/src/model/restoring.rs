//! Weight and buoyancy: `−g(η) = [f_G + f_B; r_g × f_G + r_b × f_B]`.
//!
//! `f_G = Rᵀ [0 0 W]`, `f_B = −Rᵀ [0 0 B]`. The moment depends on `r_g W − r_b B` only. (The paper's
//! (32) adds B with the wrong sign and (33) carries a leading minus too many: see the errata.)
//!
//! Source: Fossen (2011), section 4.1; Taubert et al. (2014), equations 32, 33, corrected.
//! Tests: `tests/golden.rs` (MSS `gvect`), `tests/laws.rs` (g is the gradient of potential energy).

use crate::number::algebra::{Mat3, Vec3, Vec6, add_cross};
use crate::number::real::Real;

/// Net weight and the moment arm of weight and buoyancy.
#[derive(Clone, Copy)]
pub struct Restoring<T> {
    /// W − B, N, positive when heavy.
    pub net_weight: T,
    /// r_g W − r_b B, N m.
    pub moment: Vec3<T>,
}

impl<T: Real> Restoring<T> {
    /// From weight and buoyancy (N) and their centres (m).
    #[inline(always)]
    pub fn new(weight: T, r_g: Vec3<T>, buoyancy: T, r_b: Vec3<T>) -> Self {
        Self {
            net_weight: weight - buoyancy,
            moment: std::array::from_fn(|i| r_g[i].mul_sub(weight, r_b[i] * buoyancy)),
        }
    }

    /// `tau − g(η)`, N and N m, at the rotation `r` (body → NED).
    #[inline(always)]
    pub fn add(&self, r: &Mat3<T>, tau: &Vec6<T>) -> Vec6<T> {
        let down = r[2];
        let mut sum = *tau;
        for i in 0..3 {
            sum[i] = self.net_weight.mul_add(down[i], sum[i]);
        }
        let moment = add_cross(&self.moment, &down, &[sum[3], sum[4], sum[5]]);
        [sum[0], sum[1], sum[2], moment[0], moment[1], moment[2]]
    }
}
