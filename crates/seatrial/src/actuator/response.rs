//! The response of a motor to a held command in continuous time, without a step: what a step test of logged
//! revolutions is compared with.
//!
//! Static limits, rate limit and dead time make a piecewise linear `u(t)` of a piecewise constant command;
//! the lag `T_1 ṅ + n = K_V u` is solved in closed form on each piece `u = a + s (t − t_0)`:
//! `n(t) = K_V [a + s (t − t_0 − T_1)] + (n_0 − K_V [a − s T_1]) e^(−(t − t_0)/T_1)`.
//! The dead time shifts the pieces, so that the response is smooth in T_t wherever a sample lies; a chain
//! that advances step by step ([`super::motor`]) tends to it as the step goes to zero. The rate limits may
//! differ by direction here.
//!
//! Source: Taubert et al. (2014), equation 34 and figures 4–6 (static behaviour, rate limits, step response).
//! Unit: the command's own (rpm, µs, N).
//! Tests: `tests/laws.rs::law_response_…`.

use super::motor::Limits;
use crate::number::plain;

/// Dynamics of a motor with rate limits for each direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dynamics {
    /// Static gain of the lag.
    pub k_v: f64,
    /// Time constant, s.
    pub t_1: f64,
    /// Dead time, s.
    pub t_t: f64,
    /// Rate limit while the magnitude grows, ahead and astern, unit/s; infinite = unlimited.
    pub growth: [f64; 2],
    /// Rate limit while the magnitude shrinks, ahead and astern, unit/s.
    pub shrink: [f64; 2],
}

/// A stretch of time on which the lag's input is linear.
#[derive(Clone, Copy, Debug)]
struct Piece {
    start: f64,
    input: f64,
    slope: f64,
    /// Output of the lag at the start.
    signal: f64,
}

/// The response to one command record.
#[derive(Clone, Debug)]
pub struct Response {
    dynamics: Dynamics,
    pieces: Vec<Piece>,
}

impl Response {
    /// The response to `command[i]`, held from `t[i]` to `t[i + 1]`; before `t[0]` the motor has settled.
    pub fn new(t: &[f64], command: &[f64], limits: &Limits, dynamics: Dynamics) -> Self {
        let mut response = Self { dynamics, pieces: Vec::with_capacity(2 * t.len()) };
        let Some(&first) = command.first() else { return response };
        let mut ramp = limits.apply(first);
        response.push(f64::NEG_INFINITY, ramp, 0.0);
        for (i, (&start, &command)) in t.iter().zip(command).enumerate() {
            let stop = t.get(i + 1).copied().unwrap_or(f64::INFINITY);
            ramp = response.run(start, stop, ramp, limits.apply(command));
        }
        response
    }

    /// Heads for `target` from `ramp` between two times; returns where the ramp is at the end.
    fn run(&mut self, start: f64, stop: f64, ramp: f64, target: f64) -> f64 {
        let (mut now, mut ramp) = (start, ramp);
        while ramp != target {
            let braking = ramp * target < 0.0;
            let goal = if braking { 0.0 } else { target };
            let growing = goal.abs() > ramp.abs();
            let side = usize::from(if growing { goal < 0.0 } else { ramp < 0.0 });
            let rate = if growing { self.dynamics.growth[side] } else { self.dynamics.shrink[side] };
            let duration = (goal - ramp).abs() / rate;
            if duration == 0.0 {
                ramp = goal;
                continue;
            }
            let slope = rate.copysign(goal - ramp);
            self.push(now, ramp, slope);
            if now + duration >= stop {
                return ramp + slope * (stop - now);
            }
            (now, ramp) = (now + duration, goal);
        }
        self.push(now, ramp, 0.0);
        ramp
    }

    /// Adds a piece that begins when the one before ends.
    fn push(&mut self, start: f64, input: f64, slope: f64) {
        let signal = match self.pieces.last() {
            None => self.dynamics.k_v * input,
            Some(last) => self.on(last, start),
        };
        self.pieces.push(Piece { start, input, slope, signal });
    }

    /// The signal on a piece, before the dead time.
    fn on(&self, piece: &Piece, t: f64) -> f64 {
        let Dynamics { k_v, t_1, .. } = self.dynamics;
        if piece.start == f64::NEG_INFINITY {
            return piece.signal;
        }
        let elapsed = t - piece.start;
        let settled = |elapsed: f64| k_v * (piece.input + piece.slope * (elapsed - t_1));
        let forgotten = if t_1 > 0.0 { plain::exp(-elapsed / t_1) } else { 0.0 };
        settled(elapsed) + (piece.signal - settled(0.0)) * forgotten
    }

    /// The signal at a time, s.
    pub fn at(&self, t: f64) -> f64 {
        let reached = t - self.dynamics.t_t;
        match self.pieces.partition_point(|piece| piece.start <= reached) {
            0 => f64::NAN,
            after => self.on(&self.pieces[after - 1], reached),
        }
    }
}
