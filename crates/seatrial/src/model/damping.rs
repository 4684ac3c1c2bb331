//! Damping: `−D(ν_r) ν_r`, linear and quadratic.
//!
//! Row i of the force is `Σ_j (D_l,ij + D_q,ij |ν_r,j|) ν_r,j` with the derivatives' own signs
//! (`X_u`, `X_uu` … negative). Diagonal unless off-diagonal derivatives are given or sought.
//!
//! Source: Fossen (2011), section 6.4; Taubert et al. (2014), equation 23.
//! Tests: `tests/laws.rs` (diagonal damping never adds energy, full equals diagonal),
//! `tests/golden.rs` (LAUV drag).

use crate::number::algebra::{Mat6, Vec6, each};
use crate::number::real::Real;

/// Damping derivatives: force per velocity, and per velocity times its magnitude.
#[derive(Clone, Copy)]
pub enum Damping<T> {
    /// `X_u, Y_v …` and `X_uu, Y_vv …`.
    Diagonal {
        /// Linear derivatives.
        linear: Vec6<T>,
        /// Quadratic derivatives.
        quadratic: Vec6<T>,
    },
    /// Every pair of axes.
    Full {
        /// Linear derivatives, row = force.
        linear: Mat6<T>,
        /// Quadratic derivatives, row = force.
        quadratic: Mat6<T>,
    },
}

impl<T: Real> Damping<T> {
    /// `tau − D(ν_r) ν_r`, N and N m.
    #[inline(always)]
    pub fn add(&self, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        match self {
            Self::Diagonal { linear, quadratic } => {
                for i in 0..6 {
                    sum[i] = quadratic[i].mul_add(nu_r[i].abs(), linear[i]).mul_add(nu_r[i], sum[i]);
                }
            }
            Self::Full { linear, quadratic } => {
                let square = each(nu_r, |x| x.abs() * x);
                for i in 0..6 {
                    for j in 0..6 {
                        sum[i] = quadratic[i][j].mul_add(square[j], linear[i][j].mul_add(nu_r[j], sum[i]));
                    }
                }
            }
        }
        sum
    }
}
