//! The inverse of a fin: the servo's signal, `δ − δ_0`, whose deflection δ gives a wanted force along its normal.
//!
//! With the inflow angle `β = atan2(V_n, V_c)` the angle of attack is exactly `α = δ − β`. The force along the
//! normal, `F_n = ½ ρ S |V| (C_L V_c − C_D(C_L) V_n)`, is solved for C_L by Newton's method (four steps: rounding for
//! inflow angles below 0.5 rad; at β = 0 drag has no share and the first step is exact), then
//! `δ = ½ asin(2 C_L/c_Lα) + β`. Lift repeats itself after half a turn, so that δ stays within ±90° also where the
//! water comes from behind. Beyond the stall, or above the largest lift that `sin α cos α` allows, the deflection
//! of the largest lift is taken.
//!
//! Source: as [`super`]. Tests: `tests/allocation.rs::law_fin_…`.

use super::Fin;
use crate::number::algebra::{Vec6, cross, dot};
use crate::number::real::Real;

/// The water that meets a fin.
#[derive(Clone, Copy, Debug)]
pub struct Flow<T> {
    /// Along the chord, m/s.
    pub along: T,
    /// Along the normal, m/s.
    pub across: T,
}

impl<T: Real> Flow<T> {
    /// The speed as the fin's law takes it, m/s.
    #[inline(always)]
    fn speed(&self) -> T {
        let least = self.along.splat(1e-12);
        self.along.mul_add(self.along, self.across.mul_add(self.across, least)).sqrt()
    }
}

impl<T: Real> Fin<T> {
    /// The water that meets the fin at the relative velocity `nu_r`.
    #[inline(always)]
    pub fn flow(&self, nu_r: &Vec6<T>) -> Flow<T> {
        let unit = nu_r[0];
        let mut axes = [[unit; 3]; 3];
        for i in 0..3 {
            axes[0][i] = unit.splat(self.chord[i]);
            axes[1][i] = unit.splat(self.normal[i]);
            axes[2][i] = unit.splat(self.place[i]);
        }
        let turning = cross(&[nu_r[3], nu_r[4], nu_r[5]], &axes[2]);
        let v = [nu_r[0] + turning[0], nu_r[1] + turning[1], nu_r[2] + turning[2]];
        Flow { along: dot(&axes[0], &v), across: dot(&axes[1], &v) }
    }

    /// Force along the normal, N, at the servo's signal (rad).
    #[inline(always)]
    pub fn normal_force(&self, signal: T, flow: &Flow<T>) -> T {
        let (sin, cos) = self.turned(signal).sin_cos();
        let (v_c, v_n, speed) = (flow.along, flow.across, flow.speed());
        let (sin_a, cos_a) = (sin.mul_sub(v_c, cos * v_n) / speed, cos.mul_add(v_c, sin * v_n) / speed);
        let c_l = (self.c_la * sin_a * cos_a).clamped(-self.c_lmax, self.c_lmax);
        let c_d = (self.k_i * c_l).mul_add(c_l, (self.c_d90 * sin_a).mul_add(sin_a, self.c_d0));
        self.half_rho_area * speed * c_l.mul_sub(v_c, c_d * v_n)
    }

    /// The servo's signal (rad) that gives `force`, N, along the normal, or comes nearest to it short of the stall.
    #[inline(always)]
    pub fn signal(&self, force: T, flow: &Flow<T>) -> T {
        let one = force.splat(1.0);
        let (v_c, v_n) = (Self::sided(flow.along), flow.across);
        let slope = self.c_la.max(one.splat(1e-9));
        let largest = self.c_lmax.min(slope * 0.5);
        let pressure = (self.half_rho_area * flow.speed()).max(one.splat(1e-12));
        let wanted = force / pressure;
        let mut c_l = (wanted / v_c).clamped(-largest, largest);
        for _ in 0..4 {
            let sine = c_l * 2.0 / slope;
            let cosine = sine.neg_mul_add(sine, one).max(one.splat(1e-6)).sqrt();
            let c_d = (self.k_i * c_l).mul_add(c_l, self.c_d90 * (one - cosine) * 0.5) + self.c_d0;
            let c_d_slope = (self.k_i * 2.0).mul_add(c_l, self.c_d90 * sine / (slope * cosine));
            let miss = c_l.mul_sub(v_c, c_d * v_n) - wanted;
            let steep = Self::sided(v_c - c_d_slope * v_n);
            c_l = (c_l - miss / steep).clamped(-largest, largest);
        }
        self.servo_at(Self::attack(c_l, slope) + Self::inflow_angle(flow))
    }

    /// The servo's signal at a deflection.
    #[inline(always)]
    fn servo_at(&self, deflection: T) -> T {
        self.offset.map_or(deflection, |offset| deflection - offset)
    }

    /// The servo's signals between which the force grows and falls, within the servo's limits `[astern, ahead]`
    /// (magnitudes, rad).
    #[inline(always)]
    pub fn working_range(&self, limits: [T; 2], flow: &Flow<T>) -> [T; 2] {
        let slope = self.c_la.max(flow.along.splat(1e-9));
        let (stall, inflow) = (Self::attack(self.c_lmax.min(slope * 0.5), slope), Self::inflow_angle(flow));
        [inflow - stall, inflow + stall].map(|angle| self.servo_at(angle).clamped(-limits[0], limits[1]))
    }

    /// The angle of attack (rad) of a lift coefficient.
    #[inline(always)]
    fn attack(c_l: T, slope: T) -> T {
        let sine = c_l * 2.0 / slope;
        sine.atan2(sine.neg_mul_add(sine, sine.splat(1.0)).max(sine.zero()).sqrt()) * 0.5
    }

    /// The angle from which the water comes, within ±90° of the chord's line, rad.
    #[inline(always)]
    fn inflow_angle(flow: &Flow<T>) -> T {
        let zero = flow.along.zero();
        let across = T::select(flow.along.lt(zero), -flow.across, flow.across);
        across.atan2(flow.along.abs().max(zero.splat(1e-9)))
    }

    /// A divisor with its sign, away from zero.
    #[inline(always)]
    fn sided(x: T) -> T {
        let least = x.splat(1e-9);
        T::select(x.lt(x.zero()), x.min(-least), x.max(least))
    }
}
