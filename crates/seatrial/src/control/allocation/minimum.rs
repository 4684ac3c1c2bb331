//! Limits and the hysteresis around the minimum revolutions.
//!
//! Between zero and the minimum a motor's controller lifts the command to the minimum (or drops it), so that
//! a demand that wavers there would switch the propeller on and off. The allocation decides instead:
//!
//! * at rest, a motor starts, at its minimum, when the wanted signal exceeds `start_share` of it;
//! * turning, it stays at the minimum until the wanted signal falls below `stop_share` of it, and then
//!   stops; it reverses at once where the signal wanted astern would start it;
//! * a signal of exactly zero stops it; above the maximum the signal is clipped;
//! * an actuator with an idle signal never stops and never reverses: at least its minimum in that direction.
//!
//! Tests: `tests/allocation.rs::law_minimum_…`.

use crate::actuator::motor::Limits;
use crate::number::real::Real;

/// What one actuator's controller can hold, per direction `[ahead, astern]`, magnitudes in the command's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// Largest signal.
    pub maximum: [f64; 2],
    /// Smallest signal that turns the motor.
    pub minimum: [f64; 2],
    /// Above this a motor at rest starts.
    pub start: [f64; 2],
    /// Below this a turning motor stops.
    pub stop: [f64; 2],
    /// Signed signal about which an actuator that must not stop turns; zero for none.
    pub idle: f64,
}

/// A signal beyond every actuator: no limit.
const UNLIMITED: f64 = 1e6;

impl Hold {
    /// From the motor's limits and the shares of the minimum at which it starts and stops.
    pub fn new(limits: &Limits, [start, stop]: [f64; 2], idle: f64) -> Self {
        let maximum = limits.maximum.map(|x| x.min(UNLIMITED));
        // A hair above a dead band: neutral + signal − neutral must not round into it.
        let hair = if limits.dead_band { 1.0 + 1e-9 } else { 1.0 };
        let minimum = [0, 1].map(|side| (limits.minimum[side] * hair).min(maximum[side]));
        Self { maximum, minimum, start: minimum.map(|x| x * start), stop: minimum.map(|x| x * stop), idle }
    }

    /// The signal that the motor gets for a wanted one; `turning` is −1, 0 or 1 and is kept between calls.
    #[inline(always)]
    pub fn hold<T: Real>(&self, wanted: T, turning: &mut T) -> T {
        let (zero, one) = (wanted.zero(), wanted.splat(1.0));
        let number = |x: f64| zero.splat(x);
        let goes_on = T::select(
            zero.lt(*turning),
            T::select(wanted.lt(number(self.stop[0])), zero, one),
            T::select(turning.lt(zero), T::select((-wanted).lt(number(self.stop[1])), zero, -one), zero),
        );
        let starts = T::select(
            number(self.start[0]).lt(wanted),
            one,
            T::select(number(self.start[1]).lt(-wanted), -one, zero),
        );
        let mut turns = T::select(zero.lt(goes_on.abs()), goes_on, starts);
        turns = T::select(zero.lt(wanted.abs()), turns, zero);
        if self.idle != 0.0 {
            turns = number(self.idle.signum());
        }
        *turning = turns;
        let astern = turns.lt(zero);
        let bound = |x: [f64; 2]| T::select(astern, number(x[1]), number(x[0]));
        turns * (wanted * turns).clamped(bound(self.minimum), bound(self.maximum))
    }

    /// The least and the largest signal that can be commanded.
    pub fn range(&self) -> [f64; 2] {
        [
            if self.idle > 0.0 { self.minimum[0] } else { -self.maximum[1] },
            if self.idle < 0.0 { -self.minimum[1] } else { self.maximum[0] },
        ]
    }
}
