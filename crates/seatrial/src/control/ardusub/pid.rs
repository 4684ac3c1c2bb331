//! The PID controller of ArduPilot, and the square-root controller before it.
//!
//! ```text
//! r ← r + α(f_T) (target − r),          e ← e + α(f_E) (r − y − e),          d ← d + α(f_D) (Δe/Δt − d)
//! I ← I + K_I e Δt within ±I_max, by the rule of its controller while the actuators are at a limit
//! u = K_P e + I + K_D d  +  K_FF r + K_DFF Δr/Δt
//! α(f) = Δt / (Δt + 1/(2π f)), 1 without a filter (f = 0)
//! ```
//!
//! Slew limits (`SMAX`) and notch filters (`NTF`, `NEF`) are not here: both are off unless they are set.
//!
//! Source: ArduPilot, "PID controllers", `AC_PID`, `AC_PID_Basic`, `sqrt_controller` and its inverse in `AP_Math`
//! (structure as facts). Tests: `tests/ardusub.rs`.

use crate::number::real::Real;
use std::f64::consts::TAU;

/// Gains and filters of a controller.
#[derive(Clone, Copy, Debug)]
pub struct Gains<T> {
    /// `P`, `I` (per s), `D` (s), `FF`, `D_FF` (s).
    pub p: T,
    /// See [`Gains::p`].
    pub i: T,
    /// See [`Gains::p`].
    pub d: T,
    /// See [`Gains::p`].
    pub ff: T,
    /// See [`Gains::p`].
    pub d_ff: T,
    /// `IMAX`, limit of the integrator.
    pub i_max: T,
    /// `FLTT`, cut-off of the target's filter, Hz; 0: none.
    pub target_hz: f64,
    /// `FLTE`, of the error's.
    pub error_hz: f64,
    /// `FLTD`, of the derivative's.
    pub derivative_hz: f64,
}

/// Memory of a controller.
#[derive(Clone, Copy, Debug)]
pub struct State<T> {
    /// Filtered target.
    pub target: T,
    /// Filtered error.
    pub error: T,
    /// Filtered derivative of the error, per s.
    pub derivative: T,
    /// Integral part of the output.
    pub integrator: T,
    /// Whether the filters have begun.
    begun: bool,
}

/// Parts of an output.
#[derive(Clone, Copy, Debug)]
pub struct Terms<T> {
    /// Filtered target.
    pub target: T,
    /// Filtered error.
    pub error: T,
    /// Proportional part.
    pub p: T,
    /// Integral part.
    pub i: T,
    /// Derivative part.
    pub d: T,
    /// Feed-forward of the target.
    pub ff: T,
    /// Feed-forward of the target's rate.
    pub d_ff: T,
}

impl<T: Real> Terms<T> {
    /// All of them together.
    #[inline(always)]
    pub fn output(&self) -> T {
        self.p + self.i + self.d + self.ff + self.d_ff
    }
}

/// Share by which a first-order filter of a cut-off (Hz; 0: none) follows within `dt` seconds.
#[inline(always)]
pub fn follows(cut_off: f64, dt: f64) -> f64 {
    if cut_off > 0.0 { dt / (dt + 1.0 / (TAU * cut_off)) } else { 1.0 }
}

impl<T: Real> State<T> {
    /// A controller that has not run yet.
    #[inline(always)]
    pub fn at_rest(unit: T) -> Self {
        let zero = unit.zero();
        Self { target: zero, error: zero, derivative: zero, integrator: zero, begun: false }
    }

    /// The same with another integral part.
    #[inline(always)]
    pub fn with_integrator(self, integrator: T) -> Self {
        Self { integrator, ..self }
    }

    /// The terms `dt` seconds after the last step.
    ///
    /// `rule` says what the integral part becomes, from itself, the filtered error and what it would become: [`free`],
    /// [`towards_zero`] or [`off_its_stops`].
    #[inline(always)]
    pub fn step(
        &mut self,
        gains: &Gains<T>,
        target: T,
        measured: T,
        dt: f64,
        rule: impl Fn(T, T, T) -> T,
    ) -> Terms<T> {
        let zero = target.zero();
        let mut target_rate = zero;
        if self.begun {
            let (last_target, last_error) = (self.target, self.error);
            self.target += (target - self.target) * follows(gains.target_hz, dt);
            self.error += (self.target - measured - self.error) * follows(gains.error_hz, dt);
            let slope = (self.error - last_error) / dt;
            self.derivative += (slope - self.derivative) * follows(gains.derivative_hz, dt);
            target_rate = (self.target - last_target) / dt;
        } else {
            (self.target, self.error, self.begun) = (target, target - measured, true);
        }
        let more = self.integrator + self.error * gains.i * dt;
        self.integrator = rule(self.integrator, self.error, more).clamped(-gains.i_max, gains.i_max);
        Terms {
            target: self.target,
            error: self.error,
            p: self.error * gains.p,
            i: self.integrator,
            d: self.derivative * gains.d,
            ff: self.target * gains.ff,
            d_ff: target_rate * gains.d_ff,
        }
    }
}

/// The rule of an integral part whose actuators have no limit.
#[inline(always)]
pub fn free<T: Real>(_integrator: T, _error: T, next: T) -> T {
    next
}

/// The rule of `AC_PID`: while the actuators are at a limit the integral part goes towards zero only, and one that is
/// zero stays there.
#[inline(always)]
pub fn towards_zero<T: Real>(limited: T::Mask) -> impl Fn(T, T, T) -> T {
    move |integrator, error, next| {
        let inward = (integrator * error).lt(error.zero());
        T::select(limited, T::select(inward, next, integrator), next)
    }
}

/// The rule of `AC_PID_Basic`: at the lower limit the integral part may not fall, at the upper one it may not rise.
#[inline(always)]
pub fn off_its_stops<T: Real>(lower: T::Mask, upper: T::Mask) -> impl Fn(T, T, T) -> T {
    move |integrator, error, next| {
        let zero = error.zero();
        let stopped = T::either(T::both(lower, error.lt(zero)), T::both(upper, zero.lt(error)));
        T::select(stopped, integrator, next)
    }
}

/// The rate wanted for an error: proportional while it is small, the root of it beyond, so that the acceleration of the
/// way back stays within `limit`; none of it beyond what removes the error in a step.
///
/// ```text
/// K_P e                                 |e| ≤ e_l = a/K_P²
/// ± √(2 a (|e| − e_l/2))                beyond
/// ```
///
/// Without a limit (0) it is proportional; without a gain the root alone.
#[inline(always)]
pub fn square_root<T: Real>(error: T, gain: T, limit: T, dt: f64) -> T {
    let (zero, one) = (error.zero(), error.splat(1.0));
    let size = error.abs();
    let (has_gain, has_limit) = (zero.lt(gain), zero.lt(limit));
    let safe = T::select(has_gain, gain, one);
    let linear = T::select(has_gain, limit / (safe * safe), zero);
    let root = (limit * (size - linear * 0.5) * 2.0).max(zero).sqrt();
    let proportional = gain * size;
    let rate = T::select(T::both(has_limit, linear.lt(size)), root, proportional);
    let rate = if dt > 0.0 { rate.min(size / dt) } else { rate };
    T::select(error.lt(zero), -rate, rate)
}

/// The error for which [`square_root`] wants a rate, both without sign.
///
/// ```text
/// ω / K_P                               ω ≤ a/K_P
/// ω²/(2 a) + a/(2 K_P²)                 beyond
/// ```
#[inline(always)]
pub fn inverse_square_root<T: Real>(rate: T, gain: T, limit: T) -> T {
    let slow = limit / gain;
    let root = rate * rate / (limit * 2.0) + slow / gain * 0.5;
    T::select(slow.lt(rate), root, rate / gain)
}
