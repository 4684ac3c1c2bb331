//! Motor and controller: limits, rate limit, dead time and first-order lag of the signal.
//!
//! 1. Static ([`Limits`]): above the maximum clip; between zero and the minimum *lift* to the minimum
//!    (the controller cannot hold less) or, as a true dead band, drop to zero; exactly zero stays.
//! 2. Rate: `n_acc` while |n| grows, `n_dec` while it shrinks; a reversal first brakes to zero.
//! 3. Dead time `T_t`: the ramp's past is read `T_t` earlier, linearly between half steps ([`DeadTime`]). It is
//!    smooth in T_t: a delay of the command would move a ramp in whole steps only. Where there is no rate
//!    limit the command itself is read earlier ([`crate::fit::open_loop`]), which a pure delay allows.
//! 4. Lag `K_V/(T_1 s + 1)` with first-order hold, because its input is a ramp after the rate limit:
//!    `n(t+h) = a n(t) + K_V [(1−a) u(t) + (1 − (T_1/h)(1−a)) (u(t+h) − u(t))]`, `a = e^(−h/T_1)`.
//!    The motor advances by half steps, so that Runge–Kutta sees the signal at its midpoint.
//!
//! Source: Taubert et al. (2014), equation 34 and figures 4–6 (static behaviour, rate limits, step response).
//! Unit: the command's own (rpm, µs, N).
//! Tests: `tests/laws.rs::law_motor_…`.

use crate::number::memory::{Memory, Visit};
use crate::number::real::Real;

/// Static limits of the command, positive magnitudes for both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest signal ahead and astern.
    pub maximum: [f64; 2],
    /// Smallest signal that the controller holds ahead and astern.
    pub minimum: [f64; 2],
    /// Between zero and the minimum: `false` lifts to the minimum, `true` drops to zero.
    pub dead_band: bool,
}

impl Limits {
    /// The signal that the controller asks of the motor; of what is not a number, the same.
    #[inline(always)]
    pub fn apply<T: Real>(&self, command: T) -> T {
        let zero = command.zero();
        let astern = command.lt(zero);
        let of = |[ahead, back]: [f64; 2]| T::select(astern, zero.splat(back), zero.splat(ahead));
        let (maximum, minimum) = (of(self.maximum), of(self.minimum));
        let magnitude = command.abs();
        let lifted = if self.dead_band { zero } else { minimum.min(maximum) };
        let held = T::select(magnitude.lt(minimum), lifted, magnitude.min(maximum));
        T::select(zero.lt(magnitude), T::select(astern, -held, held), command)
    }
}

/// Dynamics of a motor.
#[derive(Clone, Copy)]
pub struct Motor<T> {
    /// Static gain of the lag.
    pub k_v: T,
    /// Time constant T_1, s.
    pub t_1: T,
    /// Dead time T_t, s.
    pub t_t: T,
    /// Rate limit while the magnitude grows and while it shrinks, unit/s; `None` = unlimited.
    pub rate: Option<[T; 2]>,
    /// Neither rate limit nor lag: the signal jumps with the command, at the start of a step.
    pub ideal: bool,
}

/// Where a motor is: the rate-limited command and the signal after the lag.
#[derive(Clone, Copy, Debug)]
pub struct MotorState<T> {
    /// Output of the rate limit, input of the lag.
    pub ramp: T,
    /// Output of the lag: revolutions, pulse width or newtons.
    pub signal: T,
}

/// Constants of one motor for a step of fixed length.
#[derive(Clone, Copy)]
pub struct MotorStep<T> {
    decay: T,
    held: T,
    ramped: T,
    growth: T,
    shrink: T,
    growth_per_shrink: T,
    limited: bool,
}

crate::memory!(MotorState: ramp, signal;);

impl<T: Real> Motor<T> {
    /// The constants of a step of `h` seconds.
    #[inline(always)]
    pub fn step(&self, h: f64) -> MotorStep<T> {
        let one = self.k_v.splat(1.0);
        // A time constant far below the step is no lag; the bound keeps the quotient finite.
        let t_1 = self.t_1.max(one.splat(1e-12 * h));
        let decay = (-(one.splat(h) / t_1)).exp();
        let settled = one - decay;
        let [growth, shrink] = self.rate.unwrap_or([one, one]).map(|rate| rate * h);
        MotorStep {
            decay,
            held: self.k_v * settled,
            ramped: self.k_v * (t_1 * (1.0 / h)).neg_mul_add(settled, one),
            growth,
            shrink,
            growth_per_shrink: growth / shrink,
            limited: self.rate.is_some(),
        }
    }

    /// The steady state under the constant command `command` (after the static limits).
    #[inline(always)]
    pub fn steady(&self, command: T) -> MotorState<T> {
        MotorState { ramp: command, signal: self.k_v * command }
    }
}

impl<T: Real> MotorStep<T> {
    /// The state one step later under the command `target` (after the static limits), without dead time.
    #[inline(always)]
    pub fn advance(&self, state: &MotorState<T>, target: T) -> MotorState<T> {
        let (from, ramp) = self.course(state.ramp, target);
        MotorState { ramp, signal: self.lag(state.signal, from, ramp) }
    }

    /// The rate-limited command at the start and the end of a step; without a limit it jumps at the start.
    #[inline(always)]
    pub fn course(&self, ramp: T, target: T) -> (T, T) {
        // A ramp at its target stays there: most of the time this saves the work below.
        let moving = self.limited && !ramp.equals(target);
        if moving { (ramp, self.ramp(ramp, target)) } else { (target, target) }
    }

    /// The signal one step later while the lag's input goes from `from` to `to`.
    #[inline(always)]
    pub fn lag(&self, signal: T, from: T, to: T) -> T {
        self.ramped.mul_add(to - from, self.held.mul_add(from, self.decay * signal)).flush()
    }

    /// The rate-limited command one step later.
    #[inline(always)]
    fn ramp(&self, ramp: T, target: T) -> T {
        let zero = ramp.zero();
        let reversed = ramp.lt(zero);
        let magnitude = ramp.abs();
        let wanted = T::select(reversed, -target, target);
        let grown = wanted.min(magnitude + self.growth);
        let braked = magnitude - self.shrink;
        let shrunk = wanted.max(braked);
        // Past zero: the time left after braking lets the other direction grow.
        let beyond = wanted.max((braked * self.growth_per_shrink).min(zero));
        let shrunk = T::select(wanted.lt(zero), T::select(braked.lt(zero), beyond, braked), shrunk);
        let next = T::select(magnitude.lt(wanted), grown, shrunk);
        T::select(reversed, -next, next)
    }
}

/// The dead time behind a rate limit: the ramp's past, half a step apart, and where the lag reads it.
#[derive(Clone)]
pub struct DeadTime<T> {
    /// T_t in half steps.
    delay: T,
    ring: Vec<T>,
    /// Place of the present ramp in the ring.
    now: usize,
    /// What the lag's input is at present.
    input: T,
    /// For how many half steps the ramp has stood.
    still: usize,
}

/// The past, newest first, whatever the place of the present in the ring.
impl<T: Real> Memory<T> for DeadTime<T> {
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>) {
        let mask = self.ring.len() - 1;
        for ago in 0..=mask {
            self.ring[self.now.wrapping_sub(ago) & mask].visit(&format!("{name}_past_{ago}"), f);
        }
        self.input.visit(&format!("{name}_input"), f);
    }
}

impl<T: Real> DeadTime<T> {
    /// Dead time of `delay` half steps; the ramp has stood at `ramp` for longer.
    pub fn new(delay: T, ramp: T) -> Self {
        // The bounds keep the ring finite where a candidate's dead time is not a number.
        let length = (delay.largest().clamp(0.0, 65_536.0) as usize + 2).next_power_of_two();
        Self { delay, ring: vec![ramp; length], now: 0, input: ramp, still: length }
    }

    /// Where there is a dead time.
    #[inline(always)]
    pub fn is_late(&self) -> T::Mask {
        self.delay.zero().lt(self.delay)
    }

    /// Takes for the past ramp what `past` gives so many half steps ago; returns the lag's input at present.
    #[inline(always)]
    pub fn settle(&mut self, past: impl Fn(usize) -> T) -> T {
        let mask = self.ring.len() - 1;
        for ago in 0..=mask {
            self.ring[self.now.wrapping_sub(ago) & mask] = past(ago);
        }
        self.still = 0;
        self.input = self.delay.before(&self.ring, self.now);
        self.input
    }

    /// The ramp at present and so many half steps ago, newest first.
    pub fn past(&self) -> Vec<T> {
        let mask = self.ring.len() - 1;
        (0..=mask).map(|ago| self.ring[self.now.wrapping_sub(ago) & mask]).collect()
    }

    /// The lag's input at the start and the end of half a step that ends with the ramp at `ramp`.
    #[inline(always)]
    pub fn pass(&mut self, ramp: T) -> (T, T) {
        let mask = self.ring.len() - 1;
        let before = self.ring[self.now];
        if ramp.equals(before) {
            // All of the past is the present: most of the time this saves the work below.
            if self.still > mask {
                return (ramp, ramp);
            }
            self.still += 1;
        } else {
            self.still = 0;
        }
        self.now = (self.now + 1) & mask;
        self.ring[self.now] = ramp;
        let from = std::mem::replace(&mut self.input, self.delay.before(&self.ring, self.now));
        (from, self.input)
    }
}
