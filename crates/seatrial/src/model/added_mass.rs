//! Added mass: `M_A` symmetric 6×6, and the force `−C_A(ν_r) ν_r`.
//!
//! `C_A` by the standard construction from the momentum of the entrained water
//! `[a; b] = M_A ν_r`: `−C_A ν_r = [a × ω; a × v_r + b × ω]`. For a diagonal `M_A` this is the paper's
//! (22). The Munk moment `(Y_vdot − X_udot) u v` … is included.
//!
//! Source: Fossen (2011), section 6.3 and equation 6.43; Taubert et al. (2014), equations 14–22.
//! Tests: `tests/golden.rs` (gz-sim C_A), `tests/laws.rs` (νᵀ C ν = 0, full equals diagonal).

use crate::number::algebra::{Mat6, Vec6, add_cross, product};
use crate::number::real::Real;

/// `M_A`, positive (the derivatives `X_udot` … carry the minus), kg, kg m, kg m².
#[derive(Clone, Copy)]
pub enum AddedMass<T> {
    /// Only the derivatives `X_udot, Y_vdot, Z_wdot, K_pdot, M_qdot, N_rdot`.
    Diagonal(Vec6<T>),
    /// Any symmetric matrix.
    Full(Mat6<T>),
}

impl<T: Real> AddedMass<T> {
    /// `M_A` as a full matrix.
    #[inline(always)]
    pub fn matrix(&self) -> Mat6<T> {
        match self {
            Self::Full(matrix) => *matrix,
            Self::Diagonal(diagonal) => {
                let mut matrix = [[diagonal[0].zero(); 6]; 6];
                for i in 0..6 {
                    matrix[i][i] = diagonal[i];
                }
                matrix
            }
        }
    }

    /// `M_A ν`: the momentum of the entrained water.
    #[inline(always)]
    pub fn momentum(&self, nu: &Vec6<T>) -> Vec6<T> {
        match self {
            Self::Full(matrix) => product(matrix, nu),
            Self::Diagonal(d) => {
                let mut momentum = *nu;
                for i in 0..6 {
                    momentum[i] = d[i] * nu[i];
                }
                momentum
            }
        }
    }

    /// `tau − C_A(ν_r) ν_r`, N and N m.
    #[inline(always)]
    pub fn add_coriolis(&self, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let [a0, a1, a2, b0, b1, b2] = self.momentum(nu_r);
        let (a, b) = ([a0, a1, a2], [b0, b1, b2]);
        let v = [nu_r[0], nu_r[1], nu_r[2]];
        let omega = [nu_r[3], nu_r[4], nu_r[5]];
        let force = add_cross(&a, &omega, &[tau[0], tau[1], tau[2]]);
        let moment = add_cross(&a, &v, &[tau[3], tau[4], tau[5]]);
        let moment = add_cross(&b, &omega, &moment);
        [force[0], force[1], force[2], moment[0], moment[1], moment[2]]
    }
}
