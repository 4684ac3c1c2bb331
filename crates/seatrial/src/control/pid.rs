//! The adaptive PID controller of one loop.
//!
//! ```text
//! τ   = K_P(u_d) e + I + K_D(u_d) (r' − y') + τ_ff, within ±τ_max
//! I  += T_s K_I(u_d) e(k−1) + the share of the anti-windup
//! ```
//!
//! The gains are interpolated over six supporting points of the desired speed u_d ([`crate::control::schedule`]). K_I is
//! inside the sum: scheduled over a raw sum of errors, the output would jump with the gain (the paper's
//! equation 54). The derivative acts on the measurement; a filtered reference, which does not jump, adds its own rate
//! r'. Anti-windup: back-calculation moves the integral by `T_s K_I/K_P (τ_reached − τ)`, towards what the actuators
//! do and at most to zero; conditional integration stops it while it pushes further into a limit. When a loop enters, its integral is
//! preset so that the demand continues from what the actuators reached last (reset bias, bumpless).
//!
//! Gains are physical: K_P in N or N m per unit of error, K_I per s, K_D times s; they do not change with the period.
//!
//! Source: Taubert et al. (2014), equation 54, corrected, and figure 18 (PID controller); Åström and Hägglund,
//! *Advanced PID Control* (2006), sections 3.3–3.5. Tests: `tests/control.rs::law_pid_…`.

use crate::control::control_law::{AntiWindup, Situation};
use crate::control::schedule::{POINTS, interpolated};
use crate::number::real::Real;

/// The gains of a loop at the supporting points.
#[derive(Clone, Copy, Debug)]
pub struct Pid<T> {
    /// N or N m per m/s, m or rad.
    pub k_p: [T; POINTS],
    /// `k_p` per s.
    pub k_i: [T; POINTS],
    /// `k_p` times s.
    pub k_d: [T; POINTS],
    /// Largest demand, N or N m.
    pub tau_max: T,
    /// Against wind-up.
    pub anti_windup: AntiWindup,
}

/// The memory of a loop.
#[derive(Clone, Copy, Debug)]
pub struct PidState<T> {
    /// Integral part, N or N m.
    pub integral: T,
    /// What the integral takes up at the next step.
    pending: T,
    /// The demand before the limit ±τ_max.
    unlimited: T,
}

crate::memory!(PidState: integral, pending, unlimited;);

impl<T: Real> PidState<T> {
    /// Nothing integrated.
    #[inline(always)]
    pub fn at_rest(unit: T) -> Self {
        let zero = unit.zero();
        Self { integral: zero, pending: zero, unlimited: zero }
    }
}

impl<T: Real> Pid<T> {
    /// The demand of loop `i`, N or N m; zero where it is not active.
    #[inline(always)]
    pub fn step(
        &self,
        state: &mut PidState<T>,
        situation: &Situation<T>,
        weights: &[T; POINTS],
        i: usize,
    ) -> T {
        let s = situation;
        let (error, zero) = (s.error[i], s.error[i].zero());
        let half = zero.splat(0.5);
        let k_p = interpolated(&self.k_p, weights);
        let k_i = interpolated(&self.k_i, weights);
        let k_d = interpolated(&self.k_d, weights);
        // What the limits took from the demand of the last step.
        let missing = state.unlimited - s.achieved[i];
        let integral = match self.anti_windup {
            AntiWindup::None => state.integral + state.pending,
            AntiWindup::BackCalculation => {
                let rate = k_i / k_p.max(zero.splat(f64::MIN_POSITIVE));
                let share = (rate * s.dt).min(zero.splat(1.0));
                let next = state.integral + state.pending;
                let returned = share.neg_mul_add(missing, next);
                // At most itself: what the error alone asks too much is not charged to the integral.
                let returned = T::select(zero.lt(next), returned.max(zero), returned.min(zero));
                T::select(zero.lt(next * missing), returned, next)
            }
            AntiWindup::Conditional => {
                let noticeable = (self.tau_max * 1e-6).lt(missing.abs());
                let further = zero.lt(missing * state.pending);
                let taken = T::select(T::both(noticeable, further), zero, state.pending);
                state.integral + taken
            }
        };
        let known = k_d.mul_add(s.reference_rate[i] - s.rate[i], s.feed_forward[i]);
        let proportional = k_p.mul_add(error, known);
        let limit = |x: T| x.clamped(-self.tau_max, self.tau_max);
        let preset = limit(s.achieved[i] - proportional);
        let entered = half.lt(s.entered[i]);
        let active = half.lt(s.active[i]);
        let integral = T::select(entered, preset, integral);
        // An integral beyond the limit could not be used.
        state.integral = T::select(active, limit(integral), zero);
        let unlimited = proportional + state.integral;
        let demand = limit(unlimited);
        state.unlimited = T::select(active, unlimited, zero);
        state.pending = T::select(active, k_i * error * s.dt, zero);
        T::select(active, demand, zero)
    }
}
