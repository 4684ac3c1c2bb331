//! The gain-scheduled linear-quadratic regulator with integral action.
//!
//! ```text
//! τ  = τ_ff − K_x(u_d) x + b, within ±τ_max        b += −T_s K_I(u_d) x_I(k−1) + the share of the anti-windup
//! ```
//!
//! x are the first ten of [`STATES`], x_I the errors of the last five, and `K = [K_x K_I]` is one gain per mode and
//! supporting point, interpolated over the desired speed u_d ([`crate::control::schedule`]). The integrals are stored as the
//! wrench `b` that they make: with constant gains that is `−K_I ∫x_I`, and neither a change of the gain nor one of
//! the mode makes the demand jump.
//!
//! What a loop that is not at work contributes: no row of τ, no integral; of its states the error of depth,
//! heading and surge counts for nothing, since nothing is desired; roll, pitch and sway speed count as they are, and
//! so do the rates, because the gain was designed to damp them.
//!
//! Bumpless: where a loop enters or the mode changes, b is preset so that τ continues from what the actuators
//! reached last. A row without an integral of its own forgets its preset within the tracking time.
//! Anti-windup per row, while the actuators miss more than 2 % of τ_max (less is a dead band, no limit): b rests
//! where it would push further into the limit (conditional integration), and it gives back
//! `T_s/T_b (τ_reached − τ)`, at most itself (back-calculation): what the error itself asks for too much is not
//! charged to the integral.
//!
//! The gains of the file stand in `table`.
//!
//! Source: Fossen (2011), section 13.1; Åström and Hägglund, *Advanced PID Control* (2006), section 3.5.
//! Tests: `tests/lqr.rs`. The gains are designed by the Python package `seatrial.control_design`.

mod table;

use crate::control::control_law::{HEADING, HEAVE, PITCH, ROLL, SURGE, SWAY, Situation};
use crate::control::schedule::POINTS;
use crate::number::algebra::Vec6;
use crate::number::real::Real;
pub use table::LqrTable;

/// The number of states.
pub const STATES: usize = 15;

/// The states in the order of the gain's columns: deviations "measured minus desired" (m, rad, m/s, rad/s),
/// then the integrals of the deviations of surge and sway speed (m), depth (m s), pitch and heading (rad s).
/// `w` is the rate of the depth less the desired one where heave is at work; p, q, r are the rates of the angles.
pub const NAMES: [&str; STATES] =
    ["z", "roll", "pitch", "heading", "u", "v", "w", "p", "q", "r", "∫u", "∫v", "∫z", "∫pitch", "∫heading"];

/// The number of states that are no integrals.
const PLAIN: usize = 10;
/// The states whose integrals follow them, in that order.
const INTEGRATED: [usize; STATES - PLAIN] = [4, 5, 0, 2, 3];
/// The loop of each integral.
const LOOP_OF_INTEGRAL: [usize; STATES - PLAIN] = [SURGE, SWAY, HEAVE, PITCH, HEADING];
/// Share of τ_max below which what the actuators miss is no limit.
const NOTICEABLE: f64 = 0.02;

/// The gain at one supporting point: wrench rows in N and N m by [`STATES`] columns.
pub type Gain<T> = [[T; STATES]; 6];

/// The gains of all modes.
#[derive(Clone, Debug)]
pub struct Lqr<T> {
    /// Per mode, in the order of the mode table.
    pub modes: Vec<ModeGain<T>>,
    /// Largest demand per row, N and N m; may be infinite.
    pub tau_max: Vec6<T>,
}

/// The gains of one mode.
#[derive(Clone, Debug)]
pub struct ModeGain<T> {
    /// At the supporting points of the desired speed.
    pub points: [Gain<T>; POINTS],
    /// Tracking time T_b of the back-calculation, s.
    pub tracking: T,
}

/// The memory of the regulator.
#[derive(Clone, Copy, Debug)]
pub struct LqrState<T> {
    /// The wrench b that the integrals make, N and N m.
    pub bias: Vec6<T>,
    /// What it takes up at the next step.
    pending: Vec6<T>,
    /// The demand before the limit ±τ_max.
    unlimited: Vec6<T>,
    /// Index of the mode of the last step; negative before the first.
    mode: T,
}

crate::memory!(LqrState: bias, pending, unlimited, mode;);

impl<T: Real> LqrState<T> {
    /// Nothing integrated, in no mode.
    #[inline(always)]
    pub fn at_rest(unit: T) -> Self {
        let zero = [unit.zero(); 6];
        Self { bias: zero, pending: zero, unlimited: zero, mode: unit.splat(-1.0) }
    }
}

impl<T: Real> Lqr<T> {
    /// The demanded wrench, N and N m, in the mode of this index; zero in the rows that are not active.
    #[inline(always)]
    pub fn step(
        &self,
        state: &mut LqrState<T>,
        situation: &Situation<T>,
        weights: &[T; POINTS],
        mode: T,
    ) -> Vec6<T> {
        let s = situation;
        let (zero, one, half) = (mode.zero(), mode.splat(1.0), mode.splat(0.5));
        let (gain, tracking) = self.scheduled(weights, mode);
        let x = deviations(s);
        let share = (mode.splat(s.dt) / tracking).min(one);
        let mut fresh = zero;
        for i in 0..6 {
            fresh = fresh.max(s.entered[i] * s.active[i]);
        }
        // The first step of all has nothing to go on from.
        let changed = T::both(half.lt((mode - state.mode).abs()), zero.lt(state.mode + half));
        let fresh = T::either(half.lt(fresh), changed);
        let mut demand = [zero; 6];
        for i in 0..6 {
            let active = half.lt(s.active[i]);
            let limit = self.tau_max[i];
            let mut known = s.feed_forward[i];
            for (k, x) in gain[i].iter().zip(&x) {
                known = k.neg_mul_add(*x, known);
            }
            let preset = s.achieved[i] - known;
            let kept = self.unwound(state, s.achieved[i], share, i);
            let bias = T::select(fresh, preset, kept).clamped(-limit, limit);
            state.bias[i] = T::select(active, bias, zero);
            let unlimited = known + state.bias[i];
            state.unlimited[i] = T::select(active, unlimited, zero);
            demand[i] = T::select(active, unlimited.clamped(-limit, limit), zero);
            state.pending[i] = T::select(active, integrated(&gain[i], &x, s), zero);
            let forgotten = -(share * state.bias[i]);
            let rootless = T::both(active, own_integral(&gain[i], i).abs().lt(zero.splat(f64::MIN_POSITIVE)));
            state.pending[i] = T::select(rootless, forgotten, state.pending[i]);
        }
        state.mode = mode;
        demand
    }

    /// The integral's wrench in row `i` after its last increment and what the limits gave back.
    #[inline(always)]
    fn unwound(&self, state: &LqrState<T>, achieved: T, share: T, i: usize) -> T {
        let (bias, pending) = (state.bias[i], state.pending[i]);
        let (zero, missing) = (bias.zero(), achieved - state.unlimited[i]);
        let limited = (self.tau_max[i] * NOTICEABLE).lt(missing.abs());
        let further = T::both(limited, (pending * missing).lt(zero));
        let next = bias + T::select(further, zero, pending);
        let charged = T::both(limited, (next * missing).lt(zero));
        let returned = share.mul_add(missing, next);
        let returned = T::select(zero.lt(next), returned.max(zero), returned.min(zero));
        T::select(charged, returned, next)
    }

    /// Gain and tracking time (s) in a mode at the weights of the supporting points.
    #[inline(always)]
    fn scheduled(&self, weights: &[T; POINTS], mode: T) -> (Gain<T>, T) {
        let (zero, one, half) = (mode.zero(), mode.splat(1.0), mode.splat(0.5));
        let mut gain = [[zero; STATES]; 6];
        let mut tracking = one;
        for (index, candidate) in self.modes.iter().enumerate() {
            let here = (mode - index as f64).abs().lt(half);
            if !T::any(here) {
                continue;
            }
            tracking = T::select(here, candidate.tracking, tracking);
            let share = T::select(here, one, zero);
            for (point, weight) in candidate.points.iter().zip(weights) {
                let weight = share * *weight;
                // Four of the six weights are zero: this saves their work.
                if weight.equals(zero) {
                    continue;
                }
                for i in 0..6 {
                    for j in 0..STATES {
                        gain[i][j] = point[i][j].mul_add(weight, gain[i][j]);
                    }
                }
            }
        }
        (gain, tracking)
    }
}

/// The states that are no integrals.
#[inline(always)]
fn deviations<T: Real>(s: &Situation<T>) -> [T; PLAIN] {
    let (zero, half) = (s.speed.zero(), s.speed.splat(0.5));
    let of = |i: usize, deviation: T, without: T| T::select(half.lt(s.active[i]), deviation, without);
    // Rates of what is controlled: in a turn at a roll the body's q is not the rate of the pitch angle.
    let rate = |i: usize| s.rate[i] - of(i, s.reference_rate[i], zero);
    let sinking = T::select(half.lt(s.active[HEAVE]), rate(HEAVE), s.velocity[HEAVE]);
    [
        of(HEAVE, -s.error[HEAVE], zero),
        of(ROLL, -s.error[ROLL], s.attitude[0]),
        of(PITCH, -s.error[PITCH], s.attitude[1]),
        of(HEADING, -s.error[HEADING], zero),
        of(SURGE, -s.error[SURGE], zero),
        of(SWAY, -s.error[SWAY], s.velocity[1]),
        sinking,
        rate(ROLL),
        rate(PITCH),
        rate(HEADING),
    ]
}

/// What a step adds to the integral's wrench in a row: `−T_s K_I x_I` over the loops at work.
#[inline(always)]
fn integrated<T: Real>(row: &[T; STATES], x: &[T; PLAIN], s: &Situation<T>) -> T {
    let (zero, half) = (s.speed.zero(), s.speed.splat(0.5));
    let mut rate = zero;
    for (k, (&state, &of)) in INTEGRATED.iter().zip(&LOOP_OF_INTEGRAL).enumerate() {
        let error = T::select(half.lt(s.active[of]), x[state], zero);
        rate = row[PLAIN + k].neg_mul_add(error, rate);
    }
    rate * s.dt
}

/// The gain of a row's own integral; zero where it has none.
#[inline(always)]
fn own_integral<T: Real>(row: &[T; STATES], i: usize) -> T {
    match i {
        SURGE => row[PLAIN],
        SWAY => row[PLAIN + 1],
        HEAVE => row[PLAIN + 2],
        PITCH => row[PLAIN + 3],
        HEADING => row[PLAIN + 4],
        _ => row[0].zero(),
    }
}
