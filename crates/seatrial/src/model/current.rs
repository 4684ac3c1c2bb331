//! Ocean current: uniform and irrotational, given in NED.
//!
//! `ν_r = ν − [v_c; 0]` with `v_c = Rᵀ v_c,n`, and `ν_c' = [−S(ω) v_c + Rᵀ v_c,n'; 0]`. The force
//! `M_A ν_c'` belongs to the equation of motion; the paper's (6) lacks it, which puts a turning CWolf in a
//! 0.5 m/s current off by 51° in a minute (`docs/errata.md`).
//!
//! Source: Fossen (2011), section 8.3; Taubert et al. (2014), equations 4–6, corrected.
//! Tests: `tests/laws.rs` (Galilean invariance), `tests/cwolf.rs::errata_6_…`.

use crate::number::algebra::{Mat3, Vec3, Vec6, add_cross, transposed_product};
use crate::number::real::Real;

/// The current at one instant, NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Current<T> {
    /// Velocity of the water, m/s.
    pub velocity: Vec3<T>,
    /// Its rate of change, m/s².
    pub rate: Vec3<T>,
}

impl<T: Real> Current<T> {
    /// `ν_r` and `ν_c'` of a vehicle with velocity `nu` at the rotation `r` (body → NED).
    #[inline(always)]
    pub fn relative(&self, r: &Mat3<T>, nu: &Vec6<T>) -> (Vec6<T>, Vec6<T>) {
        let k = nu[0];
        let flow = transposed_product(r, &self.velocity);
        let rate = transposed_product(r, &self.rate);
        let omega = [nu[3], nu[4], nu[5]];
        let rate = add_cross(&flow, &omega, &rate);
        (
            [nu[0] - flow[0], nu[1] - flow[1], nu[2] - flow[2], nu[3], nu[4], nu[5]],
            [rate[0], rate[1], rate[2], k.zero(), k.zero(), k.zero()],
        )
    }
}
