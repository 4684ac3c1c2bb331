//! Moving water at the vehicle, given in NED: ocean current, turbulence, the orbital motion of waves.
//!
//! `ν_r = ν − [v_c; 0]` with `v_c = Rᵀ v_c,n`, and `ν_c' = [−S(ω) v_c + Rᵀ v_c,n'; 0]`. The force
//! `M_A ν_c'` belongs to the equation of motion; the paper's (6) lacks it, which puts a turning CWolf in a
//! 0.5 m/s current off by 51° in a minute (`docs/errata.md`). The water of waves also pushes by its pressure
//! gradient, see [`crate::model::restoring`].
//!
//! Source: Fossen (2011), section 8.3; Taubert et al. (2014), equations 4–6, corrected.
//! Tests: `tests/laws.rs` (Galilean invariance), `tests/cwolf.rs::errata_6_…`.

use crate::number::algebra::{Mat3, Vec3, Vec6, add_cross, transposed_product};
use crate::number::real::Real;

/// The moving water at one instant, NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Current<T> {
    /// Velocity of the water, m/s.
    pub velocity: Vec3<T>,
    /// Its rate of change at a fixed place, m/s².
    pub rate: Vec3<T>,
    /// The part of that rate that a pressure gradient drives, m/s²: that of waves. A current that a file or a log
    /// gives is uniform, and nothing says what drives its changes: the equation of motion has no gradient for it.
    pub pressed: Option<Vec3<T>>,
}

/// Moving water as the vehicle meets it, body frame.
pub struct Relative<T> {
    /// `ν_r`.
    pub nu: Vec6<T>,
    /// `ν_c'`, with the share of the turning frame.
    pub current_rate: Vec6<T>,
    /// The acceleration that a pressure gradient drives, m/s².
    pub pressed: Option<Vec3<T>>,
}

impl Current<f64> {
    /// The same water in the kind of `unit`.
    #[inline(always)]
    pub(crate) fn in_kind_of<T: Real>(&self, unit: T) -> Current<T> {
        let lifted = |v: &Vec3<f64>| [unit.splat(v[0]), unit.splat(v[1]), unit.splat(v[2])];
        let pressed = self.pressed.as_ref().map(lifted);
        Current { velocity: lifted(&self.velocity), rate: lifted(&self.rate), pressed }
    }
}

impl<T: Real> Current<T> {
    /// The water as a vehicle with velocity `nu` at the rotation `r` (body → NED) meets it.
    #[inline(always)]
    pub fn relative(&self, r: &Mat3<T>, nu: &Vec6<T>) -> Relative<T> {
        let k = nu[0];
        let flow = transposed_product(r, &self.velocity);
        let omega = [nu[3], nu[4], nu[5]];
        let rate = add_cross(&flow, &omega, &transposed_product(r, &self.rate));
        Relative {
            nu: [nu[0] - flow[0], nu[1] - flow[1], nu[2] - flow[2], nu[3], nu[4], nu[5]],
            current_rate: [rate[0], rate[1], rate[2], k.zero(), k.zero(), k.zero()],
            pressed: self.pressed.as_ref().map(|a| transposed_product(r, a)),
        }
    }
}
