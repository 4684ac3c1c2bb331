//! Weight and buoyancy: `−g(η) = [f_G + f_B; r_g × f_G + r_b × f_B]`.
//!
//! `f_G = Rᵀ [0 0 W]`, `f_B = −Rᵀ [0 0 B]`. The moment depends on `r_g W − r_b B` only. (The paper's
//! (32) adds B with the wrong sign and (33) carries a leading minus too many: see the errata.)
//!
//! Buoyancy is the pressure gradient over the displaced water. Where waves accelerate that water by `a`, the gradient is
//! `ρ (g − a)`, and the hull feels the Froude–Krylov force besides, `τ_FK = (B/g) [a; r_b × a]`: with `M_A ν_c'` it
//! carries a neutral body along with the water.
//!
//! Source: Fossen (2011), section 4.1; Taubert et al. (2014), equations 32, 33, corrected; Newman, *Marine Hydrodynamics*
//! (1977), section 4.13, and DNV-RP-C205 (2010), equation 6.2.2 (inertia coefficient 1 + C_A).
//! Tests: `tests/golden.rs` (MSS `gvect`), `tests/laws.rs` (g is the gradient of potential energy, a neutral body goes
//! with the water).

use crate::number::algebra::{Mat3, Vec3, Vec6, add_cross};
use crate::number::real::Real;

/// Net weight and the moment arm of weight and buoyancy.
#[derive(Clone, Copy)]
pub struct Restoring<T> {
    /// W − B, N, positive when heavy.
    pub net_weight: T,
    /// r_g W − r_b B, N m.
    pub moment: Vec3<T>,
    /// Mass of the displaced water, B/g, kg.
    pub displaced: T,
    /// r_b B/g, kg m.
    pub displaced_moment: Vec3<T>,
}

impl<T: Real> Restoring<T> {
    /// From weight and buoyancy (N) and their centres (m), at gravity g (m/s²).
    #[inline(always)]
    pub fn new((weight, r_g): (T, Vec3<T>), (buoyancy, r_b): (T, Vec3<T>), g: f64) -> Self {
        let displaced = buoyancy * (1.0 / g);
        Self {
            displaced,
            displaced_moment: r_b.map(|x| x * displaced),
            net_weight: weight - buoyancy,
            moment: std::array::from_fn(|i| r_g[i].mul_sub(weight, r_b[i] * buoyancy)),
        }
    }

    /// `tau − g(η)`, N and N m, at the rotation `r` (body → NED).
    #[inline(always)]
    pub fn add(&self, r: &Mat3<T>, tau: &Vec6<T>) -> Vec6<T> {
        self.add_weight(&r[2], tau)
    }

    /// The same where `down` is the vertical in the body frame, or its mean.
    #[inline(always)]
    pub fn add_weight(&self, down: &Vec3<T>, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        for i in 0..3 {
            sum[i] = self.net_weight.mul_add(down[i], sum[i]);
        }
        let moment = add_cross(&self.moment, down, &[sum[3], sum[4], sum[5]]);
        [sum[0], sum[1], sum[2], moment[0], moment[1], moment[2]]
    }

    /// `tau + τ_FK`, N and N m, in water that a pressure gradient accelerates by `a` (body frame, m/s²).
    #[inline(always)]
    pub fn add_pressure(&self, a: &Vec3<T>, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        for i in 0..3 {
            sum[i] = self.displaced.mul_add(a[i], sum[i]);
        }
        let moment = add_cross(&self.displaced_moment, a, &[sum[3], sum[4], sum[5]]);
        [sum[0], sum[1], sum[2], moment[0], moment[1], moment[2]]
    }
}
