//! Lift of the hull and its fixed fins: `τ_L,i = |u_r| Σ_j L_ij ν_r,j`.
//!
//! Off unless given. `L` holds hull and **fixed** fins only: no added-mass terms (those come from
//! `M_A`) and no fin that is an actuator. With diagonal damping alone nothing balances the Munk
//! moment and a slender vehicle is course-unstable; the lift of a real one balances it.
//!
//! Source: Prestero, *Verification of a Six-Degree of Freedom Simulation Model for the REMUS AUV*
//! (MIT/WHOI 2001), sections 4.5–4.6, with the Munk and rotation terms taken out.
//! Tests: `tests/laws.rs` (mirror symmetry), `tests/literature.rs`.

use crate::number::algebra::Vec6;
use crate::number::real::Real;

/// `[Y_uv Y_ur Z_uw Z_uq M_uw M_uq N_uv N_ur]`, force per |u| and velocity.
#[derive(Clone, Copy)]
pub struct Lift<T>(pub [T; 8]);

impl<T: Real> Lift<T> {
    /// `tau + τ_L(ν_r)`, N and N m.
    #[inline(always)]
    pub fn add(&self, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let [y_uv, y_ur, z_uw, z_uq, m_uw, m_uq, n_uv, n_ur] = self.0;
        let [u, v, w, _, q, r] = *nu_r;
        let speed = u.abs();
        let mut sum = *tau;
        sum[1] = speed.mul_add(y_uv.mul_add(v, y_ur * r), sum[1]);
        sum[2] = speed.mul_add(z_uw.mul_add(w, z_uq * q), sum[2]);
        sum[4] = speed.mul_add(m_uw.mul_add(w, m_uq * q), sum[4]);
        sum[5] = speed.mul_add(n_uv.mul_add(v, n_ur * r), sum[5]);
        sum
    }
}
