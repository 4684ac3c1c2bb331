//! What a navigation filter says: its estimate in place of a measurement, and how sure it is.
//!
//! Tests: `tests/flight/test_navigation.py`.

use super::NavigationFilter;
use super::fitting::instrument_of;
use crate::control::navigation::{ALTITUDE, Measurement};
use crate::filter::estimate::{ATTITUDE, POSITION, STATES, VELOCITY};
use crate::model::kinematics::to_euler;

/// Deviations up to which the estimate stands in for a fresh sample: position and depth m, attitude rad, velocity m/s,
/// rates rad/s.
pub const TRUSTED: [f64; 5] = [20.0, 2.0, 0.2, 0.3, 0.1];

impl NavigationFilter {
    /// Standard deviations of the estimate, constant offsets of its sensors included.
    pub fn deviations(&self) -> [f64; STATES] {
        let mut deviations = self.tracker.deviations();
        let offset = |channel: usize| match self.fitting.instruments[instrument_of(channel)] {
            Some(_) if self.shifted(channel).is_some() => 0.0,
            Some(instrument) if self.watches[channel].taken > 0 => instrument.bias,
            _ => f64::INFINITY,
        };
        let least = |channels: &[usize]| channels.iter().map(|&c| offset(c)).fold(f64::INFINITY, f64::min);
        let places = [least(&[0, 16, 18]), least(&[1, 17, 19]), least(&[2, 20])];
        for i in 0..3 {
            let angle = offset(3 + i);
            for (place, bias) in [(POSITION + i, places[i]), (ATTITUDE + i, angle)] {
                if bias.is_finite() {
                    deviations[place] = deviations[place].hypot(bias);
                }
            }
        }
        deviations
    }

    /// The estimate as what an autopilot is told; `measured` gives the rest: altitude, battery, supply, and ages of what
    /// is not trusted.
    pub fn told(&self, measured: &Measurement<f64>) -> Measurement<f64> {
        let mut told = *measured;
        if !self.begun {
            return told;
        }
        let at = self.tracker.estimate();
        let [roll, pitch, yaw] = to_euler(&at.motion.attitude);
        let [x, y, z] = at.motion.position;
        let [u, v, w] = at.over_ground();
        let [u_w, v_w, w_w, p, q, r] = at.motion.nu;
        let estimate = [x, y, z, roll, pitch, yaw, u, v, w, p, q, r, told.channels[ALTITUDE], u_w, v_w, w_w];
        let deviations = self.tracker.deviations();
        let place = self.tracker.position_deviation();
        let ground: f64 = (0..3).map(|i| deviations[VELOCITY + i]).fold(0.0, f64::max);
        let turning: f64 = (3..6).map(|i| deviations[VELOCITY + i]).fold(0.0, f64::max);
        let trusted = [
            (0..2, place < TRUSTED[0]),
            (2..3, deviations[POSITION + 2] < TRUSTED[1]),
            (3..6, self.tracker.attitude_deviation() < TRUSTED[2]),
            (6..9, ground < TRUSTED[3]),
            (9..12, turning < TRUSTED[4]),
            (13..16, ground < TRUSTED[3]),
        ];
        for (channels, fresh) in trusted {
            for c in channels {
                told.channels[c] = estimate[c];
                if fresh {
                    told.age[c] = 0.0;
                }
            }
        }
        told.disturbance = at.force;
        told
    }
}
