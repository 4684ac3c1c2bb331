//! Rigid body about O: `M_RB = [[m I, −m S(r_g)], [m S(r_g), I_O]]` and the force `−C_RB(ν) ν`.
//!
//! `C_RB(ν) ν` is the Newton–Euler force of the accelerated frame,
//! `[m (ω×v + ω×(ω×r_g)); ω×(I_O ω) + m r_g×(ω×v)]`; every skew-symmetric parametrisation, the
//! paper's (21) among them, gives the same product. Products of inertia are positive integrals
//! `I_xy = ∫ x y dm` and enter `I_O` with a minus.
//!
//! Source: Fossen (2011), sections 3.2–3.3; Taubert et al. (2014), equations 8, 9, 21.
//! Tests: `tests/golden.rs` (MSS `rbody`), `tests/laws.rs` (νᵀ C ν = 0).

use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, add_cross, cross, each, product, skew};
use crate::number::real::Real;

/// Mass and inertia about O.
#[derive(Clone, Copy)]
pub enum RigidBody<T> {
    /// Any centre of gravity, any inertia tensor.
    General {
        /// Mass, kg.
        m: T,
        /// m r_g, kg m.
        first_moment: Vec3<T>,
        /// Inertia tensor about O, kg m².
        i_o: Mat3<T>,
    },
    /// Centre of gravity at O and principal axes along the body's: the paper's (10).
    Principal {
        /// Mass, kg.
        m: T,
        /// I_x, I_y, I_z, kg m².
        i_o: Vec3<T>,
    },
}

impl<T: Real> RigidBody<T> {
    /// From mass, centre of gravity `r_g` (m) and `[I_x I_y I_z I_xy I_xz I_yz]` about O (kg m²).
    #[inline(always)]
    pub fn new(m: T, r_g: Vec3<T>, inertia: Vec6<T>) -> Self {
        let [x, y, z, xy, xz, yz] = inertia;
        let i_o = [[x, -xy, -xz], [-xy, y, -yz], [-xz, -yz, z]];
        Self::General { m, first_moment: r_g.map(|c| c * m), i_o }
    }

    /// `M_RB`, kg, kg m, kg m².
    #[inline(always)]
    pub fn mass_matrix(&self) -> Mat6<T> {
        let (Self::General { m, .. } | Self::Principal { m, .. }) = *self;
        let mut matrix = [[m.zero(); 6]; 6];
        for i in 0..3 {
            matrix[i][i] = m;
        }
        match self {
            Self::Principal { i_o, .. } => {
                for i in 0..3 {
                    matrix[3 + i][3 + i] = i_o[i];
                }
            }
            Self::General { first_moment, i_o, .. } => {
                let s = skew(first_moment);
                for i in 0..3 {
                    for j in 0..3 {
                        matrix[i][3 + j] = -s[i][j];
                        matrix[3 + i][j] = s[i][j];
                        matrix[3 + i][3 + j] = i_o[i][j];
                    }
                }
            }
        }
        matrix
    }

    /// `tau − C_RB(ν) ν`, N and N m.
    #[inline(always)]
    pub fn add_coriolis(&self, nu: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let v = [nu[0], nu[1], nu[2]];
        let omega = [nu[3], nu[4], nu[5]];
        let mut force = [tau[0], tau[1], tau[2]];
        let mut moment = [tau[3], tau[4], tau[5]];
        // The force is momentum × ω; the moment is angular momentum × ω, where r_g's share keeps only
        // (ω × v) × m r_g.
        match self {
            Self::Principal { m, i_o } => {
                force = add_cross(&each(&v, |x| *m * x), &omega, &force);
                moment = add_cross(&[i_o[0] * nu[3], i_o[1] * nu[4], i_o[2] * nu[5]], &omega, &moment);
            }
            Self::General { m, first_moment, i_o } => {
                let spin = cross(&omega, first_moment);
                let momentum = [m.mul_add(v[0], spin[0]), m.mul_add(v[1], spin[1]), m.mul_add(v[2], spin[2])];
                force = add_cross(&momentum, &omega, &force);
                moment = add_cross(&product(i_o, &omega), &omega, &moment);
                moment = add_cross(&cross(&omega, &v), first_moment, &moment);
            }
        }
        [force[0], force[1], force[2], moment[0], moment[1], moment[2]]
    }
}
