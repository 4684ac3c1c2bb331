//! A movable fin: lift and drag of an all-moving surface, valid in all four quadrants and without angles.
//!
//! The unit chord `e_c` points to the leading edge at zero deflection, the unit normal `e_n` is where a
//! positive deflection δ moves the leading edge and, under way, the force. With V the part of
//! `v_r + ω × r` in their plane, `V_c = V·e_c`, `V_n = V·e_n`:
//!
//! ```text
//! |V| sin α = sin δ V_c − cos δ V_n        |V| cos α = cos δ V_c + sin δ V_n
//! C_L = c_Lα sin α cos α, within ±C_Lmax   C_D = C_D0 + C_D90 sin²α + k_i C_L²
//! F   = ½ ρ S |V| [C_L (V_c e_n − V_n e_c) − C_D V]        |V| = √(V·V + 10⁻¹²)
//! ```
//!
//! The deflection is the servo's signal and a fixed offset `δ_0` of the fin on its shaft, `δ = n + δ_0`.
//! `k_i = 1/(π e Λ)` with the aspect ratio Λ and Oswald's efficiency e. Lift beyond the stall stays at C_Lmax
//! until the profile stands across the flow. No added mass of the fin, no wake of hull or propeller.
//!
//! Source: Fossen (2011), section 9.8; Hoerner and Borst (1975), chapters 3 and 17; Prestero (2001), section
//! 4.7 (its small-angle form is the limit). The way back, from force to deflection: [`Fin::deflection`].
//! Tests: `tests/laws.rs::law_fin_…`, `tests/core/test_scalar_textbook.py`.

mod inverse;

use super::motor::Motor;
use crate::number::algebra::{Vec3, Vec6, cross, dot};
use crate::number::real::Real;
pub use inverse::Flow;

/// A fin behind its servo.
#[derive(Clone)]
pub struct Fin<T> {
    /// How the deflection follows the command, rad.
    pub servo: Motor<T>,
    /// Unit vector to the leading edge at zero deflection.
    pub chord: Vec3<f64>,
    /// Unit vector towards which a positive deflection moves the leading edge.
    pub normal: Vec3<f64>,
    /// Place of the centre of pressure, m from O.
    pub place: Vec3<f64>,
    /// ½ ρ S times the gain, kg/m.
    pub half_rho_area: T,
    /// Slope of the lift coefficient, per rad.
    pub c_la: T,
    /// Largest lift coefficient.
    pub c_lmax: T,
    /// Drag coefficient in line with the flow.
    pub c_d0: T,
    /// Further drag coefficient across the flow.
    pub c_d90: T,
    /// Induced drag per squared lift coefficient.
    pub k_i: T,
    /// Deflection where the servo stands at zero, rad; `None` where there is none and none is sought.
    pub offset: Option<T>,
}

/// Sine and cosine of a fin's deflection.
pub type Deflection<T> = (T, T);

impl<T: Real> Fin<T> {
    /// The deflection at the servo's signal, rad: `δ = n + δ_0`.
    #[inline(always)]
    pub fn turned(&self, signal: T) -> T {
        self.offset.map_or(signal, |offset| signal + offset)
    }

    /// `tau` + wrench about O, N and N m, at a deflection and the relative velocity `nu_r`.
    #[inline(always)]
    pub fn add(&self, (sin, cos): Deflection<T>, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let unit = nu_r[0];
        let lift = |v: &Vec3<f64>| [unit.splat(v[0]), unit.splat(v[1]), unit.splat(v[2])];
        let (chord, normal, place) = (lift(&self.chord), lift(&self.normal), lift(&self.place));
        let turning = cross(&[nu_r[3], nu_r[4], nu_r[5]], &place);
        let v = [nu_r[0] + turning[0], nu_r[1] + turning[1], nu_r[2] + turning[2]];
        let (v_c, v_n) = (dot(&chord, &v), dot(&normal, &v));
        let speed = v_c.mul_add(v_c, v_n.mul_add(v_n, unit.splat(1e-12))).sqrt();
        let (sin_a, cos_a) = (sin.mul_sub(v_c, cos * v_n) / speed, cos.mul_add(v_c, sin * v_n) / speed);
        let c_l = (self.c_la * sin_a * cos_a).min(self.c_lmax).max(-self.c_lmax);
        let c_d = (self.k_i * c_l).mul_add(c_l, (self.c_d90 * sin_a).mul_add(sin_a, self.c_d0));
        let pressure = self.half_rho_area * speed;
        let along = -(pressure * c_d.mul_add(v_c, c_l * v_n));
        let across = pressure * c_l.mul_sub(v_c, c_d * v_n);
        let mut force = [unit; 3];
        for i in 0..3 {
            force[i] = along.mul_add(chord[i], across * normal[i]);
        }
        let moment = cross(&place, &force);
        let mut sum = *tau;
        for i in 0..3 {
            sum[i] += force[i];
            sum[3 + i] += moment[i];
        }
        sum
    }
}

/// Slope of the lift coefficient of a fin of effective aspect ratio Λ, per rad: `1/(1/(2·0.9 π) + 1/(π Λ))`
/// (Hoerner and Borst 1975, as Prestero 2001 uses it).
pub fn lift_slope(aspect_ratio: f64) -> f64 {
    let pi = std::f64::consts::PI;
    1.0 / (1.0 / (1.8 * pi) + 1.0 / (pi * aspect_ratio))
}
