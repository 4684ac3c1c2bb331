//! Trials of the loops: set points over time, a dither on top of the commands, and the constraint criteria that their responses are held against.
//!
//! `Q = Σ [(C_u − y)⁺, (y − C_o)⁺] T`, the two sides apart, over the control periods of T seconds; y is normalised,
//! `(channel − base)/scale`, so that a step from `base` to `base + scale` goes from 0 to 1. A feasible response has Q = 0,
//! so the tie-breaker `Σ t |y − target| T` orders the feasible ones, t being the time since the step.
//!
//! Source: Taubert et al. (2014), equations 55–57, (57) corrected: it prints C_u for C_o. Tests:
//! `tests/closed_loop/set_points.rs` (the dither too), `tests/tuning/test_step_trial.py` (equal to the same sums from the log).

use crate::control::autopilot::Thought;
use crate::control::autopilot::set_point::SetPoint;
use crate::control::navigation::{CHANNEL_NAMES, CHANNELS};
use crate::number::real::Real;

/// The first and the second channel of a corridor beyond those of [`crate::control::navigation`]: the errors of guidance, m.
pub const ERRORS: [&str; 2] = ["cross_track", "vertical_error"];

/// The index of a corridor's channel.
pub fn channel_index(name: &str) -> Option<usize> {
    CHANNEL_NAMES.iter().chain(&ERRORS).position(|known| *known == name)
}

/// Bounds of one channel; every list holds a value per control period, at least one.
#[derive(Clone, Debug)]
pub struct Corridor {
    /// The channel, see [`channel_index`].
    pub channel: usize,
    /// Lower bound; −∞ for none.
    pub lower: Vec<f64>,
    /// Upper bound; ∞ for none.
    pub upper: Vec<f64>,
    /// Where the response should be.
    pub target: Vec<f64>,
    /// Weight of the deviation from it, s since the step.
    pub clock: Vec<f64>,
}

/// What is added to the commands of the autopilot, so that a log tells the vehicle from its controller.
#[derive(Clone, Debug, Default)]
pub struct Dither {
    /// The values change at these times, s; before the first nothing is added.
    pub times: Vec<f64>,
    /// Per actuator that has one its index and a signal for each time.
    pub signals: Vec<(usize, Vec<f64>)>,
}

impl Dither {
    /// Writes what is added at a time, s, into a value per actuator.
    #[inline(always)]
    pub fn write<T: Real>(&self, added: &mut [T], time: f64) {
        let begun = self.times.partition_point(|t| *t <= time + 1e-9);
        for (actuator, signals) in self.signals.iter().filter(|_| begun > 0) {
            added[*actuator] = added[*actuator].splat(signals[begun - 1]);
        }
    }
}

/// What all cases of a trial share.
#[derive(Clone, Debug, Default)]
pub struct Trial {
    /// The set points change at these times, s; the first ones hold from the beginning.
    pub times: Vec<f64>,
    /// Which set points are given, see [`crate::control::autopilot::set_point::SET_POINTS`].
    pub named: Vec<usize>,
    /// The constraint criteria.
    pub corridors: Vec<Corridor>,
    /// What is added to the commands.
    pub dither: Dither,
}

impl Trial {
    /// The set points at a time, s, of a case's `values[named][time]`; nothing where guidance rules alone.
    #[inline(always)]
    pub fn set_point<T: Real>(&self, unit: T, values: &[T], time: f64) -> Option<SetPoint<T>> {
        if self.named.is_empty() {
            return None;
        }
        let count = self.times.len();
        let now = self.times.iter().rposition(|t| *t <= time + 1e-9).unwrap_or(0);
        Some(SetPoint::of(unit, self.named.iter().enumerate().map(|(i, &n)| (n, values[i * count + now]))))
    }
}

/// What a response violates: seconds below, seconds above, and the tie-breaker, s².
#[derive(Clone, Debug)]
pub struct Violations<T> {
    /// Per corridor, the three sums.
    pub sums: Vec<[T; 3]>,
}

impl<T: Real> Violations<T> {
    /// Nothing violated yet.
    #[inline(always)]
    pub fn new(trial: &Trial, unit: T) -> Self {
        Self { sums: vec![[unit; 3]; trial.corridors.len()] }
    }

    /// Takes control period `k` of `dt` seconds; `scales` are base and scale of each corridor.
    #[inline(always)]
    pub fn add(
        &mut self,
        trial: &Trial,
        (truth, thought): (&[T; CHANNELS], &Thought<T>),
        scales: &[[T; 2]],
        (k, dt): (usize, f64),
    ) {
        for ((sum, corridor), [base, scale]) in self.sums.iter_mut().zip(&trial.corridors).zip(scales) {
            let shown = match corridor.channel {
                c if c < CHANNELS => truth[c] - *base,
                CHANNELS => thought.desired.cross_track - *base,
                _ => thought.desired.vertical_error - *base,
            };
            let angle = (3..6).contains(&corridor.channel);
            let y = if angle { shown.wrap() } else { shown } / *scale;
            let at = |list: &[f64]| y.splat(list[k.min(list.len() - 1)]);
            let (below, above) = (at(&corridor.lower) - y, y - at(&corridor.upper));
            let zero = y.zero();
            // What has diverged violates everything: a maximum would lose that it is not a number.
            let sound = y.abs().lt(zero.splat(f64::INFINITY));
            let counted = |x: T| T::select(sound, x, zero.splat(f64::INFINITY));
            sum[0] += counted(below.max(zero)) * dt;
            sum[1] += counted(above.max(zero)) * dt;
            sum[2] += counted((y - at(&corridor.target)).abs() * at(&corridor.clock)) * dt;
        }
    }
}
