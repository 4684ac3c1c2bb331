//! The table `[safety]` of the autopilot file: when each watch is true, and what is done then.
//!
//! Tests: `tests/closed_loop/safety.rs`, `tests/files.rs`.

use super::{Reaction, STALE, WATCHES};
use crate::control::contradiction::Thresholds;
use crate::control::navigation::GROUP_NAMES;
use serde::{Deserialize, Serialize};

/// What should come, samples or the waypoint, and does not.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Stale {
    /// Without it for so long, s.
    pub after_s: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// The battery.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// Share of the charge below which it is low.
    pub below: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// Actuators whose measured signal does not follow.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ActuatorWatch {
    /// Deviation from the expected signal, as a share of the largest one.
    pub deviation: f64,
    /// For so long, s.
    pub after_s: f64,
    /// What is done besides allocating anew without it.
    pub reaction: Reaction,
}

/// A forward speed that stays away from the desired one.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct SpeedWatch {
    /// By so much at least, m/s, and by [`super::watches::OFF_SPEED`] of the desired speed.
    pub off_m_s: f64,
    /// For so long, s.
    pub after_s: f64,
    /// What is done then.
    pub reaction: Reaction,
}

/// The table `[safety]` of the autopilot file.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct SafetyTable {
    /// Forward speed while surfacing, m/s.
    pub surface_speed_m_s: f64,
    /// Depth at which the vehicle counts as surfaced, m.
    pub surfaced_above_m: f64,
    /// A channel that repeats one value for so long, s, while the others say that it must have changed, is frozen: it
    /// is as old as that value.
    pub frozen_after_s: f64,
    /// Horizontal position.
    pub stale_position: Stale,
    /// Depth.
    pub stale_depth: Stale,
    /// Roll, pitch and heading.
    pub stale_attitude: Stale,
    /// Velocity over ground.
    pub stale_velocity: Stale,
    /// Turn rates.
    pub stale_rates: Stale,
    /// Altitude, on legs that follow the bottom and on missions with a least altitude.
    pub stale_altitude: Stale,
    /// The mission's largest depth is passed.
    pub depth: Reaction,
    /// The altitude is below the mission's smallest one.
    pub altitude: Reaction,
    /// The vehicle is outside the mission's fence.
    pub fence: Reaction,
    /// The mission takes longer than its limit.
    pub time: Reaction,
    /// The battery is low.
    pub battery: Battery,
    /// An actuator does not follow.
    pub actuator: ActuatorWatch,
    /// The waypoint comes no nearer.
    pub progress: Stale,
    /// From where on sensors contradict each other.
    pub contradiction: Thresholds,
    /// The speed does not follow.
    pub speed: SpeedWatch,
    /// While surfacing the vehicle must come half a metre higher within so long, s.
    pub ascent_after_s: f64,
}

impl Default for SafetyTable {
    fn default() -> Self {
        let stale = |after_s, reaction| Stale { after_s, reaction };
        Self {
            surface_speed_m_s: 0.5,
            surfaced_above_m: 0.5,
            frozen_after_s: 2.0,
            // It is told after ten seconds, and the fence is held against dead reckoning meanwhile, which a log that is
            // off by 0.05 m/s and a heading by 6° lead 12 m astray in this time at 1.5 m/s.
            stale_position: stale(60.0, Reaction::Surface),
            stale_depth: stale(5.0, Reaction::Abort),
            stale_attitude: stale(2.0, Reaction::Abort),
            stale_velocity: stale(20.0, Reaction::Surface),
            stale_rates: stale(2.0, Reaction::Abort),
            stale_altitude: stale(20.0, Reaction::Surface),
            depth: Reaction::Surface,
            altitude: Reaction::Surface,
            fence: Reaction::Hold,
            time: Reaction::Surface,
            battery: Battery { below: 0.1, reaction: Reaction::Surface },
            actuator: ActuatorWatch { deviation: 0.2, after_s: 2.0, reaction: Reaction::Continue },
            progress: stale(120.0, Reaction::Surface),
            contradiction: Thresholds::default(),
            speed: SpeedWatch { off_m_s: 0.3, after_s: 8.0, reaction: Reaction::Continue },
            ascent_after_s: 30.0,
        }
    }
}

impl SafetyTable {
    /// What is wrong with the table, if anything.
    pub fn complaint(&self) -> Option<String> {
        let stale = self.stale();
        let times =
            stale.iter().zip(GROUP_NAMES).map(|(s, name)| (format!("stale_{name}.after_s"), s.after_s));
        let others = [
            ("surface_speed_m_s".to_owned(), self.surface_speed_m_s),
            ("surfaced_above_m".to_owned(), self.surfaced_above_m),
            ("frozen_after_s".to_owned(), self.frozen_after_s),
            ("actuator.after_s".to_owned(), self.actuator.after_s),
            ("actuator.deviation".to_owned(), self.actuator.deviation),
            ("progress.after_s".to_owned(), self.progress.after_s),
            ("contradiction.position_m".to_owned(), self.contradiction.position_m),
            ("contradiction.depth_m".to_owned(), self.contradiction.depth_m),
            ("contradiction.angle_deg".to_owned(), self.contradiction.angle_deg),
            ("contradiction.roughness_m_s".to_owned(), self.contradiction.roughness_m_s),
            ("contradiction.heading_off_deg".to_owned(), self.contradiction.heading_off_deg),
            ("contradiction.pitch_off_deg".to_owned(), self.contradiction.pitch_off_deg),
            ("contradiction.gyro_off_deg_s".to_owned(), self.contradiction.gyro_off_deg_s),
            ("contradiction.after_s".to_owned(), self.contradiction.after_s),
            ("contradiction.over_after_s".to_owned(), self.contradiction.over_after_s),
            ("speed.off_m_s".to_owned(), self.speed.off_m_s),
            ("speed.after_s".to_owned(), self.speed.after_s),
            ("ascent_after_s".to_owned(), self.ascent_after_s),
        ];
        let wrong = times.chain(others).find(|(_, x)| x.is_nan() || *x <= 0.0);
        if let Some((key, x)) = wrong {
            return Some(format!("safety.{key}: expected a positive number, found {x}"));
        }
        let below = self.battery.below;
        if !(0.0..1.0).contains(&below) {
            return Some(format!("safety.battery.below: expected a share from 0 to 1, found {below}"));
        }
        None
    }

    /// The watches over the age of a group.
    pub(super) fn stale(&self) -> [Stale; STALE] {
        [
            self.stale_position,
            self.stale_depth,
            self.stale_attitude,
            self.stale_velocity,
            self.stale_rates,
            self.stale_altitude,
        ]
    }

    /// The reaction of each watch.
    #[inline(always)]
    pub(super) fn reactions(&self) -> [Reaction; WATCHES] {
        [
            self.stale_position.reaction,
            self.stale_depth.reaction,
            self.stale_attitude.reaction,
            self.stale_velocity.reaction,
            self.stale_rates.reaction,
            self.stale_altitude.reaction,
            self.depth,
            self.altitude,
            self.fence,
            self.time,
            self.battery.reaction,
            self.actuator.reaction,
            self.progress.reaction,
            self.stale_position.reaction,
            self.stale_depth.reaction,
            self.stale_attitude.reaction,
            Reaction::Continue,
            self.speed.reaction,
            Reaction::Continue,
            if self.stale_depth.reaction == Reaction::Abort { Reaction::Abort } else { Reaction::Continue },
        ]
    }
}
