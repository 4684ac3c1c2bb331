//! Rigid body about O: `M_RB = [[m I, −m S(r_g)], [m S(r_g), I_O]]` and the force `−C_RB(ν) ν`.
//!
//! `C_RB(ν) ν` is the Newton–Euler force of the accelerated frame,
//! `[m (ω×v + ω×(ω×r_g)); ω×(I_O ω) + m r_g×(ω×v)]`; every skew-symmetric parametrisation, the
//! paper's (21) among them, gives the same product. Products of inertia are positive integrals
//! `I_xy = ∫ x y dm` and enter `I_O` with a minus.
//!
//! Source: Fossen (2011), sections 3.2–3.3; Taubert et al. (2014), equations 8, 9, 21.
//! Tests: `tests/golden.rs` (MSS `rbody`), `tests/laws.rs` (νᵀ C ν = 0).

use crate::algebra::{Mat3, Mat6, Vec3, Vec6, add_cross, cross, product, skew};
use crate::real::Real;

/// Mass, first moment of mass and inertia about O.
#[derive(Clone, Copy)]
pub struct RigidBody<T> {
    /// Mass, kg.
    pub m: T,
    /// m r_g, kg m.
    pub first_moment: Vec3<T>,
    /// Inertia tensor about O, kg m².
    pub i_o: Mat3<T>,
}

impl<T: Real> RigidBody<T> {
    /// From mass, centre of gravity `r_g` (m) and `[I_x I_y I_z I_xy I_xz I_yz]` about O (kg m²).
    #[inline(always)]
    pub fn new(m: T, r_g: Vec3<T>, inertia: Vec6<T>) -> Self {
        let [x, y, z, xy, xz, yz] = inertia;
        Self { m, first_moment: r_g.map(|c| c * m), i_o: [[x, -xy, -xz], [-xy, y, -yz], [-xz, -yz, z]] }
    }

    /// `M_RB`, kg, kg m, kg m².
    #[inline(always)]
    pub fn mass_matrix(&self) -> Mat6<T> {
        let zero = self.m.zero();
        let s = skew(&self.first_moment);
        let mut matrix = [[zero; 6]; 6];
        for i in 0..3 {
            matrix[i][i] = self.m;
            for j in 0..3 {
                matrix[i][3 + j] = -s[i][j];
                matrix[3 + i][j] = s[i][j];
                matrix[3 + i][3 + j] = self.i_o[i][j];
            }
        }
        matrix
    }

    /// `tau − C_RB(ν) ν`, N and N m.
    #[inline(always)]
    pub fn add_coriolis(&self, nu: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let v = [nu[0], nu[1], nu[2]];
        let omega = [nu[3], nu[4], nu[5]];
        // m v + ω × m r_g and I_O ω + m r_g × v are the momenta; the force is −ω × momentum, where
        // r_g's share of the moment keeps only ω × v.
        let swirl = cross(&omega, &v);
        let spin = cross(&omega, &self.first_moment);
        let linear =
            [self.m.mul_add(v[0], spin[0]), self.m.mul_add(v[1], spin[1]), self.m.mul_add(v[2], spin[2])];
        let angular = product(&self.i_o, &omega);
        let force = add_cross(&linear, &omega, &[tau[0], tau[1], tau[2]]);
        let moment = add_cross(&angular, &omega, &[tau[3], tau[4], tau[5]]);
        let moment = add_cross(&swirl, &self.first_moment, &moment);
        [force[0], force[1], force[2], moment[0], moment[1], moment[2]]
    }
}
