//! A tether at a point of the vehicle: drag of its effective part, and the pull of its elasticity.
//!
//! The part of the tether that the vehicle drags along moves as its point of attachment does:
//!
//! * `F = −½ρ A |v_p| v_p`, `v_p = v_r + ω × r_p`: `A = C_D · area` of that part, m²; at the point `r_p`, so that `r_p × F`
//!   turns the vehicle;
//! * `F = −k max(|d| − L, 0) d/|d|` in NED, `d = p + R r_p − anchor`: stiffness `k` beyond the slack length `L`, towards
//!   an anchor. It needs the place of the vehicle, and is left out where none is told ([`Tether::add`]).
//!
//! The drag is smooth but for `v_p = 0`, where [`LEAST`] rounds `|v_p|`; the pull has a corner where the tether becomes
//! taut. Weight in water and internal drag of a long tether in a shear are none of this: that is a cable model.
//!
//! Source: Faltinsen, *Sea Loads on Ships and Offshore Structures* (1990), chapter 6 (Morison's drag, here in one point);
//! Hooke's law. Tests: `tests/laws/tether.rs`, `tests/diagnosis/test_missing_forces.py`.

use crate::number::algebra::{Mat3, Vec3, Vec6, cross, each, product, splat, transposed_product};
use crate::number::real::Real;

/// Squared speed (m²/s²) and length (m²) that round the roots at zero.
const LEAST: f64 = 1e-12;

/// The tether's elasticity.
#[derive(Clone, Copy, Debug)]
pub struct Spring<T> {
    /// Stiffness beyond the slack length, N/m.
    pub stiffness: T,
    /// The far end, NED, m.
    pub anchor: Vec3<f64>,
    /// Length without pull, m.
    pub slack: f64,
}

/// The tether's forces.
#[derive(Clone, Copy, Debug)]
pub struct Tether<T> {
    /// Point of attachment, body frame, m.
    pub place: Vec3<f64>,
    /// `½ρ A`, kg/m.
    pub drag: T,
    /// `None` where there is no spring and none is sought.
    pub spring: Option<Spring<T>>,
}

impl<T: Real> Tether<T> {
    /// `tau` + the forces at the velocity `nu_r` through the water, N and N m; the pull only at a `position`, NED, m.
    #[inline(always)]
    pub fn add(&self, (position, r): (Option<&Vec3<T>>, &Mat3<T>), nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let [u, v, w, p, q, s] = *nu_r;
        let arm = splat(u, &self.place);
        let turning = cross(&[p, q, s], &arm);
        let moving = [u + turning[0], v + turning[1], w + turning[2]];
        let strength = length(&moving) * self.drag;
        let mut force = each(&moving, |x| -(x * strength));
        if let (Some(spring), Some(position)) = (&self.spring, position) {
            let out = product(r, &arm);
            let mut away = *position;
            for i in 0..3 {
                away[i] = away[i] + out[i] - spring.anchor[i];
            }
            let far = length(&away);
            let pull = (far - spring.slack).max(far.zero()) * spring.stiffness / far;
            let towards = transposed_product(r, &away);
            for i in 0..3 {
                force[i] -= towards[i] * pull;
            }
        }
        let moment = cross(&arm, &force);
        let mut sum = *tau;
        for i in 0..3 {
            sum[i] += force[i];
            sum[3 + i] += moment[i];
        }
        sum
    }
}

/// The length of a vector, smooth at zero.
#[inline(always)]
fn length<T: Real>(x: &Vec3<T>) -> T {
    (x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + LEAST).sqrt()
}
