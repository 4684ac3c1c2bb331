//! Guidance as written in the autopilot file, table `[guidance]`.
//!
//! Tests: `tests/guidance.rs` (`law_table_…`).

use serde::{Deserialize, Serialize};

/// How heading and pitch follow from the errors.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Straight to the waypoint.
    Pursuit,
    /// To a point of the path ahead.
    Lookahead,
    /// The same, and the drift is learnt.
    #[default]
    Integral,
}

/// From waypoints to desired values.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct GuidanceTable {
    /// How heading and pitch follow from the errors.
    pub method: Method,
    /// Lookahead distance Δ in the horizontal plane, m: two to five lengths of the vehicle, and at least twice the
    /// speed times the delay of the course, reference filter included.
    pub lookahead_m: f64,
    /// Lookahead distance Δ_z in the vertical plane, m.
    pub lookahead_vertical_m: f64,
    /// Speed for which lookahead distances and integral gains hold, m/s: on slower legs they shrink in proportion, to a
    /// half at the least; 0: the same at any speed.
    pub lookahead_speed_m_s: f64,
    /// Integral gain κ in the horizontal plane, m/s: a quarter of the speed is critically damped.
    pub integral_gain_m_s: f64,
    /// Integral gain κ_z in the vertical plane, m/s.
    pub integral_gain_vertical_m_s: f64,
    /// Largest desired pitch, deg; 20 in Taubert et al. (2014). Steeper legs end in a dive on the spot or a spiral.
    pub pitch_max_deg: f64,
    /// Largest rate of the desired heading, deg/s.
    pub turn_rate_max_deg_s: f64,
    /// Largest rate of the desired pitch, deg/s.
    pub pitch_rate_max_deg_s: f64,
    /// Largest rate of the desired depth, m/s.
    pub depth_rate_max_m_s: f64,
    /// Largest desired speed, m/s.
    pub speed_max_m_s: f64,
    /// Largest rate of the desired speed, m/s².
    pub acceleration_max_m_s2: f64,
    /// Share of the speed that is left while the heading is 90° or more off; 1: turns do not slow down.
    pub turn_speed_share: f64,
    /// Desired speed per distance when a point is held, 1/s.
    pub hold_gain_per_s: f64,
    /// Horizontal distance at which station-keeping begins, m.
    pub hold_radius_m: f64,
    /// Horizontal distance beyond which a vehicle turns to the point that it holds, m.
    pub watch_radius_m: f64,
    /// Rate of the heading per error of the sideways speed when a point is held without sway, rad/m; five times
    /// `hold_gain_per_s` is well damped in currents from 0.2 m/s on.
    pub weathervane_gain_rad_m: f64,
    /// Radius of the circle of a vehicle that cannot stop, m.
    pub loiter_radius_m: f64,
    /// Radius of the turning circle with which turns begin before their waypoint, m; at least speed over
    /// `turn_rate_max_deg_s` counts. 0: a turn begins at the sphere of acceptance.
    pub turn_radius_m: f64,
    /// Delay of the course, s, by which turns begin earlier; with `turn_radius_m` only.
    pub turn_delay_s: f64,
}

impl Default for GuidanceTable {
    fn default() -> Self {
        Self {
            method: Method::Integral,
            lookahead_m: 10.0,
            lookahead_vertical_m: 8.0,
            lookahead_speed_m_s: 0.0,
            integral_gain_m_s: 0.25,
            integral_gain_vertical_m_s: 0.1,
            pitch_max_deg: 20.0,
            turn_rate_max_deg_s: 15.0,
            pitch_rate_max_deg_s: 5.0,
            depth_rate_max_m_s: 0.4,
            speed_max_m_s: 5.0,
            acceleration_max_m_s2: 0.2,
            turn_speed_share: 1.0,
            hold_gain_per_s: 0.2,
            hold_radius_m: 2.0,
            watch_radius_m: 5.0,
            weathervane_gain_rad_m: 1.0,
            loiter_radius_m: 20.0,
            turn_radius_m: 0.0,
            turn_delay_s: 0.0,
        }
    }
}

/// The numbers that may differ from candidate to candidate: keys of the table.
pub const TUNABLE: [&str; 18] = [
    "lookahead_m",
    "lookahead_vertical_m",
    "integral_gain_m_s",
    "integral_gain_vertical_m_s",
    "pitch_max_deg",
    "turn_rate_max_deg_s",
    "pitch_rate_max_deg_s",
    "depth_rate_max_m_s",
    "speed_max_m_s",
    "acceleration_max_m_s2",
    "turn_speed_share",
    "hold_gain_per_s",
    "hold_radius_m",
    "watch_radius_m",
    "weathervane_gain_rad_m",
    "loiter_radius_m",
    "turn_radius_m",
    "turn_delay_s",
];

/// Indices in [`TUNABLE`] of what may be zero.
const MAY_BE_ZERO: [usize; 6] = [2, 3, 10, 14, 16, 17];
const PITCH_MAX: usize = 4;
const TURN_SPEED_SHARE: usize = 10;

impl GuidanceTable {
    /// The values of the names in [`TUNABLE`].
    pub fn tunable(&self) -> [f64; TUNABLE.len()] {
        let mut copy = *self;
        copy.places().map(|place| *place)
    }

    /// Gives the names in [`TUNABLE`] their values; missing ones stay.
    pub fn set_tunable(&mut self, values: &[f64]) {
        for (place, value) in self.places().into_iter().zip(values) {
            *place = *value;
        }
    }

    fn places(&mut self) -> [&mut f64; TUNABLE.len()] {
        [
            &mut self.lookahead_m,
            &mut self.lookahead_vertical_m,
            &mut self.integral_gain_m_s,
            &mut self.integral_gain_vertical_m_s,
            &mut self.pitch_max_deg,
            &mut self.turn_rate_max_deg_s,
            &mut self.pitch_rate_max_deg_s,
            &mut self.depth_rate_max_m_s,
            &mut self.speed_max_m_s,
            &mut self.acceleration_max_m_s2,
            &mut self.turn_speed_share,
            &mut self.hold_gain_per_s,
            &mut self.hold_radius_m,
            &mut self.watch_radius_m,
            &mut self.weathervane_gain_rad_m,
            &mut self.loiter_radius_m,
            &mut self.turn_radius_m,
            &mut self.turn_delay_s,
        ]
    }

    /// What is wrong with the table, if anything: `key: expected …, found …; what to do`.
    pub fn complaint(&self) -> Option<String> {
        let speed = self.lookahead_speed_m_s;
        if !(0.0..=f64::MAX).contains(&speed) {
            return Some(format!(
                "lookahead_speed_m_s: expected a finite number, 0 or above, found {speed}; mend it or leave it out for the default"
            ));
        }
        for (index, (key, value)) in TUNABLE.iter().zip(self.tunable()).enumerate() {
            let (range, advice) = match index {
                PITCH_MAX => ((0.0, 85.0), "an angle above 0 and up to 85°"),
                TURN_SPEED_SHARE => ((0.0, 1.0), "a share from 0 to 1, 1 to keep the speed in turns"),
                i if MAY_BE_ZERO.contains(&i) => ((0.0, f64::MAX), "a finite number, 0 or above"),
                _ => ((0.0, f64::MAX), "a finite number above 0"),
            };
            let zero_is_wrong = value == 0.0 && !MAY_BE_ZERO.contains(&index);
            if !(range.0..=range.1).contains(&value) || zero_is_wrong {
                return Some(format!(
                    "{key}: expected {advice}, found {value}; mend it or leave it out for the default"
                ));
            }
        }
        (self.watch_radius_m < self.hold_radius_m).then(|| {
            format!(
                "watch_radius_m: expected at least hold_radius_m = {}, found {}; a vehicle that begins to keep station \
                 would at once turn away from its heading",
                self.hold_radius_m, self.watch_radius_m
            )
        })
    }
}
