//! What a navigation filter says: its estimate in place of a measurement, and how sure it is.
//!
//! Tests: `tests/flight/test_navigation.py`.

use super::NavigationFilter;
use super::fitting::instrument_of;
use crate::control::navigation::{ALTITUDE, Measurement};
use crate::filter::estimate::{ATTITUDE, POSITION, STATES, VELOCITY};
use crate::model::kinematics::to_euler;
use crate::number::plain;
use crate::number::real::Real;

/// Deviations up to which the estimate stands in for a fresh sample: position and depth m, attitude rad, velocity m/s,
/// rates rad/s.
pub const TRUSTED: [f64; 5] = [20.0, 2.0, 0.2, 0.3, 0.1];

impl NavigationFilter {
    /// Standard deviations of the estimate, constant offsets of its sensors included.
    pub fn deviations(&self) -> [f64; STATES] {
        let mut deviations = self.tracker.deviations();
        let offset = |channel: usize| match self.fitting.instruments[instrument_of(channel)] {
            Some(_) if self.shifted(channel).is_some_and(|(_, shifted)| shifted) => 0.0,
            Some(instrument) if self.watches[channel].taken > 0.0 => instrument.bias,
            _ => f64::INFINITY,
        };
        let least = |channels: &[usize]| channels.iter().map(|&c| offset(c)).fold(f64::INFINITY, f64::min);
        let places = [least(&[0, 16, 18]), least(&[1, 17, 19]), least(&[2, 20])];
        for i in 0..3 {
            let angle = offset(3 + i);
            for (place, bias) in [(POSITION + i, places[i]), (ATTITUDE + i, angle)] {
                if bias.is_finite() {
                    deviations[place] = plain::hypot(deviations[place], bias);
                }
            }
        }
        deviations
    }
}

impl<T: Real> NavigationFilter<T> {
    /// The estimate as what an autopilot is told; `measured` gives the rest: altitude, battery, supply, and ages of what
    /// is not trusted.
    #[inline(always)]
    pub fn told(&self, measured: &Measurement<T>) -> Measurement<T> {
        let (mut told, begun) = (*measured, self.begun());
        let at = self.tracker.estimate();
        let [roll, pitch, yaw] = to_euler(&at.motion.attitude);
        let [x, y, z] = at.motion.position;
        let [u, v, w] = at.over_ground();
        let [u_w, v_w, w_w, p, q, r] = at.motion.nu;
        let estimate = [x, y, z, roll, pitch, yaw, u, v, w, p, q, r, told.channels[ALTITUDE], u_w, v_w, w_w];
        let deviation = |i: usize| self.tracker.state().deviation(i);
        let largest = |i: usize| deviation(i).max(deviation(i + 1)).max(deviation(i + 2));
        let ground = largest(VELOCITY);
        let trusted = [
            (0..2, self.tracker.position_deviation(), TRUSTED[0]),
            (2..3, deviation(POSITION + 2), TRUSTED[1]),
            (3..6, self.tracker.attitude_deviation(), TRUSTED[2]),
            (6..9, ground, TRUSTED[3]),
            (9..12, largest(VELOCITY + 3), TRUSTED[4]),
            (13..16, ground, TRUSTED[3]),
        ];
        for (channels, found, most) in trusted {
            let fresh = T::both(begun, found.lt(x.splat(most)));
            for c in channels {
                told.channels[c] = T::select(begun, estimate[c], told.channels[c]);
                told.age[c] = T::select(fresh, x.zero(), told.age[c]);
            }
        }
        told
    }
}
