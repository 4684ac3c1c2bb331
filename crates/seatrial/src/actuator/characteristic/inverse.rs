//! The inverse characteristic: the signal that gives a wanted thrust at an inflow and a supply voltage.
//!
//! Quadratic and polynomial shapes are one law in the signal s (the command's unit), per direction
//! `|F| = a0 + (a1 ± c) s + a11 s²` with the inflow's slope `c = p2 u_a` per unit of s. Forward inflow (c < 0)
//! makes the branch ahead dip below zero before it grows, by `D = c²/(4 a11)` for a quadratic: there the propeller
//! windmills. To one negative thrust belong then up to three signals. The rule:
//!
//! * the growing part of the branch ahead serves thrusts down to −¾ D, slower than it would run freely;
//! * below that, and at once where the propeller already turns astern, the branch astern, which is monotone.
//!
//! The signal is so monotone in the thrust, has its only jump away from zero (where thrusts of either sign are
//! asked for in cruise) and, with the direction in which it turns, a hysteresis at the jump. Three quarters and
//! not all of D, because the signal per newton grows without bound at D; at ¾ D it is twice that at zero. Under
//! astern inflow everything is mirrored. A thrust of exactly zero is a signal of zero.
//!
//! A measured table gives the signal of least magnitude that reaches the thrust: the first crossing outward
//! from zero, which holds across flat and slightly falling stretches. Where no signal reaches the thrust, the one
//! that comes nearest. Tests: `tests/allocation.rs::law_signal_…`.

use super::{Characteristic, Row, Shape, Table};
use crate::number::real::Real;

/// Share of the dip that the windmilling branch serves.
const WINDMILL: f64 = 0.75;

/// What decides between the branches beside thrust and inflow.
#[derive(Clone, Copy, Debug)]
pub struct Bias<T> {
    /// In which direction the propeller turns: −1, 0 or 1.
    pub turning: T,
    /// Further factor on the thrust astern.
    pub astern_ratio: T,
}

impl<T: Real> Characteristic<T> {
    /// The signal (the command's unit) that gives the thrust `force`, N, at an inflow velocity (m/s) and a supply
    /// voltage (V), for a propeller at rest.
    #[inline(always)]
    pub fn signal(&self, force: T, inflow: T, voltage: f64) -> T {
        let bias = Bias { turning: force.zero(), astern_ratio: force.splat(1.0) };
        self.signal_near(force, inflow, voltage, &bias)
    }

    /// The same for a propeller that turns already, and with the ratio of its thrust astern.
    #[inline(always)]
    pub fn signal_near(&self, force: T, inflow: T, voltage: f64, bias: &Bias<T>) -> T {
        let zero = force.zero();
        // No factor is no thrust: the quotient stays finite and the limits clip the signal.
        let factor = T::select(self.factor.abs().lt(zero.splat(1e-9)), zero.splat(1e-9), self.factor);
        let wanted = force / factor;
        let ratio = bias.astern_ratio.max(zero.splat(1e-9));
        let directed = T::select(wanted.lt(zero), wanted / ratio, wanted);
        let branches = match &self.shape {
            Shape::Quadratic { p1, flow } => {
                let parabola = |p: T| [zero, zero, p * (1.0 / 3600.0)];
                Some((parabola(p1[0]), parabola(p1[1] * ratio), flow.p2))
            }
            Shape::Polynomial { ahead, astern, flow } => {
                let [a0, a1, a11] = *astern;
                Some((*ahead, [a0 * ratio, a1 * ratio, a11 * ratio], flow.p2))
            }
            Shape::Table(_) | Shape::Direct => None,
        };
        let signal = match (branches, &self.shape) {
            (Some((ahead, astern, p2)), _) => {
                let slope = p2 * inflow * (1.0 / 60.0);
                propeller(&Branches { ahead, astern, slope: [slope, slope * ratio] }, wanted, bias.turning)
            }
            (None, Shape::Table(table)) => {
                let row = table.row(voltage);
                directed.along(|| table.inverse_knots(&row), |f| table.reaching(&row, f))
            }
            (None, _) => directed,
        };
        T::select(zero.lt(force.abs()), signal, zero)
    }
}

/// `|F| = a0 + a1 s + a11 s²` ahead and astern, and what the inflow adds per s, of the thrust ahead.
struct Branches<T> {
    ahead: [T; 3],
    astern: [T; 3],
    slope: [T; 2],
}

/// The signal of a propeller that gives `force`.
#[inline(always)]
fn propeller<T: Real>(branches: &Branches<T>, force: T, turning: T) -> T {
    let zero = force.zero();
    // Seen from the direction that the inflow pushes back.
    let mirrored = zero.lt(branches.slope[0]);
    let pick = |a: T, b: T| T::select(mirrored, a, b);
    let f = pick(-force, force);
    let (mut near, mut far) = (branches.ahead, branches.astern);
    for i in 0..3 {
        near[i] = pick(branches.astern[i], branches.ahead[i]);
        far[i] = pick(branches.ahead[i], branches.astern[i]);
    }
    let [ahead, astern] = branches.slope;
    let back = [pick(astern, ahead).abs(), pick(ahead, astern).abs()];
    let [a0, a1, a11] = near;
    let (with, without) = ((a1 - back[0]).min(zero), a1.min(zero));
    let dip = (with * with - without * without) / (a11.max(zero.splat(1e-30)) * 4.0) - a0.max(zero);
    let dip = T::select(zero.lt(a11), dip.max(zero), zero);
    let share = T::select(pick(-turning, turning).lt(zero), zero, zero.splat(WINDMILL));
    let windmill = growing(&[a0, a1 - back[0], a11], f);
    let braking = -growing(&[far[0], far[1] + back[1], far[2]], -f);
    let signal = T::select(f.lt(-(dip * share)), braking, windmill);
    pick(-signal, signal)
}

/// The s ≥ 0 on the growing part of `a0 + a1 s + a11 s² = f`; the summit where f is above it.
#[inline(always)]
fn growing<T: Real>([a0, a1, a11]: &[T; 3], f: T) -> T {
    let zero = f.zero();
    let tiny = zero.splat(1e-30);
    let rest = f - *a0;
    let square = (*a11 * 4.0).mul_add(rest, *a1 * *a1);
    let root = square.max(zero).sqrt();
    // Two forms of the same root, each where it does not cancel.
    let rising = rest * 2.0 / (*a1 + root).max(tiny);
    let falling = (root - *a1) / (a11.max(tiny) * 2.0);
    let nonzero = T::select(a11.abs().lt(tiny), tiny, *a11);
    let summit = -*a1 / (nonzero * 2.0);
    let signal = T::select(a1.lt(zero), falling, rising);
    T::select(square.lt(zero), summit, signal).max(zero)
}

impl Table {
    /// Force and signal at the knots of [`Self::reaching`], which is a polyline with jumps; the force does not fall.
    pub fn inverse_knots(&self, row: &Row<'_>) -> Vec<[f64; 2]> {
        let [first, last] = self.range();
        let start = 0.0_f64.clamp(first, last);
        let start = (start, self.interpolate(row, start).0);
        let knots = self.knots(row);
        // Outward from zero: a knot counts where its force goes beyond all before it.
        let outward = |knots: &mut dyn Iterator<Item = [f64; 2]>, sense: f64| {
            let (mut before, mut most, mut found) = (start, start.1, Vec::new());
            for knot in knots.map(|[signal, force]| (signal, force)) {
                if sense * (knot.1 - most) > 0.0 {
                    let slope = (knot.0 - before.0) / (knot.1 - before.1);
                    found.extend([[most, before.0 + slope * (most - before.1)], [knot.1, knot.0]]);
                    most = knot.1;
                }
                before = knot;
            }
            found
        };
        let mut inverse = outward(&mut knots.iter().rev().copied().filter(|knot| knot[0] < start.0), -1.0);
        inverse.reverse();
        inverse.push([start.1, start.0]);
        inverse.extend(outward(&mut knots.iter().copied().filter(|knot| knot[0] > start.0), 1.0));
        inverse
    }

    /// The signal of least magnitude whose thrust reaches `force`, N, and its slope; where none does, the one
    /// that comes nearest.
    #[inline(never)]
    pub fn reaching(&self, row: &Row<'_>, force: f64) -> (f64, f64) {
        if force.is_nan() {
            return (f64::NAN, f64::NAN);
        }
        let [first, last] = self.range();
        let start = 0.0_f64.clamp(first, last);
        let mut before = (start, self.interpolate(row, start).0);
        let rising = force > before.1;
        let beyond = |thrust: f64, limit: f64| if rising { thrust >= limit } else { thrust <= limit };
        if before.1 == force {
            return (start, 0.0);
        }
        let mut nearest = before;
        let from = if rising { self.signal.partition_point(|&s| s <= start) } else { 0 };
        let until = if rising { self.signal.len() } else { self.signal.partition_point(|&s| s < start) };
        for step in 0..until - from {
            let j = if rising { from + step } else { until - 1 - step };
            let knot = (self.signal[j], row.0[j] + (row.1[j] - row.0[j]) * row.2);
            if beyond(knot.1, force) {
                let slope = (knot.0 - before.0) / (knot.1 - before.1);
                return (before.0 + slope * (force - before.1), slope);
            }
            if beyond(knot.1, nearest.1) && knot.1 != nearest.1 {
                nearest = knot;
            }
            before = knot;
        }
        (nearest.0, 0.0)
    }
}
