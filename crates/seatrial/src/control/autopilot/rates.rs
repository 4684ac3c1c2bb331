//! The rates of what the loops control, from the sensors that tell them.
//!
//! Angles by the gyro (Euler rates), depth by the velocity over ground while all of its components are fresh and by
//! differences of the depth, through a lag, where one is not; surge and sway accelerations are differences of samples.
//!
//! Source: Fossen (2011), section 2.2. Tests: `tests/closed_loop/safety.rs`.

use crate::control::navigation::{DEPTH, Measurement, VELOCITY};
use crate::number::algebra::Vec6;
use crate::number::real::Real;

/// Beyond this age a velocity is not used, s (a log at 1 Hz is younger): it would be a constant error of every loop that it enters.
const VELOCITY_IS_OLD_S: f64 = 2.0;

/// Time constant of the depth's rate from differences, s.
const DEPTH_RATE_LAG_S: f64 = 1.0;

/// What the differences remember.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates<T> {
    velocity: [T; 2],
    depth: T,
    sink: T,
    /// 1 once there is a last sample.
    begun: T,
}

crate::memory!(Rates: velocity, depth, sink, begun;);

impl<T: Real> Rates<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        Self { velocity: [unit; 2], depth: unit, sink: unit, begun: unit }
    }

    /// Where component `i` of the velocity over ground is too old to be used.
    #[inline(always)]
    pub fn blind(measured: &Measurement<T>, i: usize) -> T::Mask {
        let age = measured.age[VELOCITY + i];
        age.splat(VELOCITY_IS_OLD_S).lt(age)
    }

    /// Forgets the last samples: after a pause their differences mean nothing.
    pub fn restart(&mut self) {
        self.begun = self.begun.zero();
    }

    /// Moves the last depth with a jump that is believed, m.
    #[inline(always)]
    pub fn moved_by(&mut self, depth: T) {
        self.depth += depth;
    }

    /// The rates in the order of the loops: m/s², m/s, rad/s; `dt` seconds after the last call.
    #[inline(always)]
    pub fn see(&mut self, measured: &Measurement<T>, dt: f64) -> Vec6<T> {
        let [roll, pitch, _] = measured.attitude();
        let ([p, q, r], [u, v, w]) = (measured.rates(), measured.velocity());
        let (zero, depth) = (u.zero(), measured.channels[DEPTH]);
        let [no_u, no_v, no_w] =
            [Self::blind(measured, 0), Self::blind(measured, 1), Self::blind(measured, 2)];
        let blind = T::either(no_u, T::either(no_v, no_w));
        let ((s_roll, c_roll), (s_pitch, c_pitch)) = (roll.sin_cos(), pitch.sin_cos());
        let yaw = q.mul_add(s_roll, r * c_roll) / c_pitch.max(zero.splat(0.1));
        let sink = (v * s_roll + w * c_roll).mul_add(c_pitch, -(u * s_pitch));
        let per_dt = self.begun / dt;
        let share = dt / (DEPTH_RATE_LAG_S + dt);
        self.sink = T::select(blind, self.sink + ((depth - self.depth) * per_dt - self.sink) * share, sink);
        let change = |blind, now: T, before: T| T::select(blind, zero, (now - before) * per_dt);
        let [u_before, v_before] = self.velocity;
        let rates = [
            change(no_u, u, u_before),
            change(no_v, v, v_before),
            self.sink,
            s_pitch.mul_add(yaw, p),
            q.mul_sub(c_roll, r * s_roll),
            yaw,
        ];
        (self.velocity, self.depth, self.begun) = ([u, v], depth, zero.splat(1.0));
        rates
    }
}
