//! The rates of what the loops control, from the sensors that tell them.
//!
//! Angles by the gyro (Euler rates), depth by the velocity over ground while it is fresh and by differences of the
//! depth, through a lag, where it is not; surge and sway accelerations are differences of samples.
//!
//! Source: Fossen (2011), section 2.2. Tests: `tests/closed_loop/safety.rs`.

use crate::control::navigation::Measurement;
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
    begun: bool,
}

impl<T: Real> Rates<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        Self { velocity: [unit; 2], depth: unit, sink: unit, begun: false }
    }

    /// Where the velocity over ground is too old to be used.
    #[inline(always)]
    pub fn blind(measured: &Measurement<T>) -> T::Mask {
        measured.age[3].splat(VELOCITY_IS_OLD_S).lt(measured.age[3])
    }

    /// The rates in the order of the loops: m/s², m/s, rad/s; a control period of `dt` seconds after the last call.
    #[inline(always)]
    pub fn see(&mut self, measured: &Measurement<T>, dt: f64) -> Vec6<T> {
        let [roll, pitch, _] = measured.attitude();
        let ([p, q, r], [u, v, w]) = (measured.rates(), measured.velocity());
        let (zero, depth, blind) = (u.zero(), measured.channels[2], Self::blind(measured));
        let ((s_roll, c_roll), (s_pitch, c_pitch)) = (roll.sin_cos(), pitch.sin_cos());
        let yaw = q.mul_add(s_roll, r * c_roll) / c_pitch.max(zero.splat(0.1));
        let sink = (v * s_roll + w * c_roll).mul_add(c_pitch, -(u * s_pitch));
        let per_dt = f64::from(u8::from(self.begun)) / dt;
        let share = dt / (DEPTH_RATE_LAG_S + dt);
        self.sink = T::select(blind, self.sink + ((depth - self.depth) * per_dt - self.sink) * share, sink);
        let change = |now: T, before: T| T::select(blind, zero, (now - before) * per_dt);
        let [u_before, v_before] = self.velocity;
        let rates = [
            change(u, u_before),
            change(v, v_before),
            self.sink,
            s_pitch.mul_add(yaw, p),
            q.mul_sub(c_roll, r * s_roll),
            yaw,
        ];
        (self.velocity, self.depth, self.begun) = ([u, v], depth, true);
        rates
    }
}
