//! The figures of a flight; `tally` sums them up.
//!
//! Errors of guidance count on the second half of every straight leg, where the vehicle has had time to settle; the
//! depth excursion is how far the vehicle leaves the band between the depths of a leg's two ends; while it turns onto
//! the leg and is still behind its start, the depths of the leg before count too.
//!
//! Tests: `tests/closed_loop.rs`, `tests/flight/test_fly.py` (equal to the same figures from the log).

use super::exceedance::Exceedance;
use super::trial::Violations;
use crate::control::navigation_filter::KINDS;
use crate::number::real::Real;
use std::cell::RefCell;

/// How a flight ended.
pub const ENDINGS: [&str; 4] = ["out of time", "complete", "surfaced", "aborted"];

/// Reads a figure of a flight.
pub type Figure = fn(&Summary<f64>) -> f64;

/// The figures of every flight by name, SI and rad.
pub const FIGURES: [(&str, Figure); 29] = [
    ("ending", |s| s.ending),
    ("duration", |s| s.duration),
    ("distance", |s| s.distance),
    ("energy", |s| s.energy),
    ("cross_track_largest", |s| s.cross_track[0]),
    ("cross_track_rms", |s| s.cross_track[1]),
    ("true_cross_track_largest", |s| s.true_cross_track[0]),
    ("true_cross_track_rms", |s| s.true_cross_track[1]),
    ("vertical_largest", |s| s.vertical[0]),
    ("vertical_rms", |s| s.vertical[1]),
    ("excursion", |s| s.excursion),
    ("depth_largest", |s| s.depth),
    ("altitude_smallest", |s| s.altitude),
    ("waypoints", |s| s.waypoints),
    ("missed_by", |s| s.missed_by),
    ("switches", |s| s.switches),
    ("alert", |s| s.alert[0]),
    ("alert_cause", |s| s.alert[1]),
    ("alert_time", |s| s.alert[2]),
    ("roll_largest", |s| s.tilt[0]),
    ("pitch_largest", |s| s.tilt[1]),
    ("clearance", |s| s.clearance[0]),
    ("clearance_time", |s| s.clearance[1]),
    ("clearance_reserve", |s| s.clearance[2]),
    ("depth_smallest", |s| s.shallowest[0]),
    ("depth_smallest_time", |s| s.shallowest[1]),
    ("roll_time", |s| s.tilt_time[0]),
    ("pitch_time", |s| s.tilt_time[1]),
    ("travel", |s| s.travel),
];

/// The figures of a flight.
#[derive(Clone, Debug)]
pub struct Summary<T> {
    /// Index into [`ENDINGS`]; not a number for what diverged.
    pub ending: T,
    /// Duration, s.
    pub duration: T,
    /// Way over ground, m.
    pub distance: T,
    /// Electrical energy, J.
    pub energy: T,
    /// Largest and root mean square cross-track error on settled legs, m, as guidance saw it.
    pub cross_track: [T; 2],
    /// The same of where the vehicle really was.
    pub true_cross_track: [T; 2],
    /// Largest and root mean square vertical error on settled legs, m.
    pub vertical: [T; 2],
    /// Largest excursion from the depth band of a leg, m.
    pub excursion: T,
    /// Largest depth, m, and smallest altitude, m.
    pub depth: T,
    /// Smallest altitude above the bottom, m; infinite without one.
    pub altitude: T,
    /// Waypoints behind the vehicle.
    pub waypoints: T,
    /// Largest of the smallest distances to the waypoints behind the vehicle, m.
    pub missed_by: T,
    /// Starts and stops of actuators, per minute and actuator.
    pub switches: T,
    /// Strongest reaction, its cause and its time, s.
    pub alert: [T; 3],
    /// Largest roll and pitch, rad.
    pub tilt: [T; 2],
    /// When the largest roll and pitch were, s.
    pub tilt_time: [T; 2],
    /// Smallest depth, m: negative above the surface, and when, s.
    pub shallowest: [T; 2],
    /// Smallest horizontal distance of the hull from an obstacle, m, infinite without any; when, s; and the smallest one
    /// less what the mission promises of that obstacle, m, infinite without a promise.
    pub clearance: [T; 3],
    /// Mean rate at which commands move, shares of an actuator's range per s.
    pub travel: T,
    /// Samples on settled legs, and those of them whose cross-track and vertical error exceeds each threshold.
    pub settled: T,
    /// Of the cross-track, the vertical and the true cross-track error.
    pub exceedance: [Exceedance<T>; 3],
    /// Of the navigation filter, of all sensors and then per kind: mean normalised innovation squared, samples taken and
    /// samples refused; not a number without one.
    pub consistency: [[T; 3]; 1 + KINDS.len()],
    /// What the responses of a trial violate.
    pub violations: Violations<T>,
}

impl<T: Real> Summary<T> {
    /// The figures before the first period.
    #[inline(always)]
    pub(super) fn nothing(zero: T, violations: Violations<T>) -> Self {
        Self {
            ending: zero,
            duration: zero,
            distance: zero,
            energy: zero,
            cross_track: [zero; 2],
            true_cross_track: [zero; 2],
            vertical: [zero; 2],
            excursion: zero,
            depth: zero.splat(f64::NEG_INFINITY),
            altitude: zero.splat(f64::INFINITY),
            waypoints: zero,
            missed_by: zero,
            switches: zero,
            alert: [zero; 3],
            tilt: [zero; 2],
            tilt_time: [zero; 2],
            shallowest: [zero.splat(f64::INFINITY), zero],
            clearance: [zero.splat(f64::INFINITY), zero, zero.splat(f64::INFINITY)],
            travel: zero,
            settled: zero,
            exceedance: [Exceedance::new(zero); 3],
            consistency: [[zero.splat(f64::NAN); 3]; 1 + KINDS.len()],
            violations,
        }
    }

    /// The same figures in another number type: one lane of eight.
    pub fn read(&self, lane: impl Fn(&T) -> f64) -> Summary<f64> {
        let two = |x: &[T; 2]| [lane(&x[0]), lane(&x[1])];
        let three = |x: &[T; 3]| [lane(&x[0]), lane(&x[1]), lane(&x[2])];
        Summary {
            ending: lane(&self.ending),
            duration: lane(&self.duration),
            distance: lane(&self.distance),
            energy: lane(&self.energy),
            cross_track: two(&self.cross_track),
            true_cross_track: two(&self.true_cross_track),
            vertical: two(&self.vertical),
            excursion: lane(&self.excursion),
            depth: lane(&self.depth),
            altitude: lane(&self.altitude),
            waypoints: lane(&self.waypoints),
            missed_by: lane(&self.missed_by),
            switches: lane(&self.switches),
            alert: three(&self.alert),
            tilt: two(&self.tilt),
            tilt_time: two(&self.tilt_time),
            shallowest: two(&self.shallowest),
            clearance: three(&self.clearance),
            travel: lane(&self.travel),
            settled: lane(&self.settled),
            exceedance: std::array::from_fn(|i| self.exceedance[i].read(&lane)),
            consistency: std::array::from_fn(|i| three(&self.consistency[i])),
            violations: Violations { sums: self.violations.sums.iter().map(&three).collect() },
        }
    }
}

impl Summary<f64> {
    /// All figures in one row, as [`Summary::of_row`] takes them.
    pub fn to_row(&self) -> Vec<f64> {
        let row = RefCell::new(Vec::new());
        self.read(|x| {
            row.borrow_mut().push(*x);
            *x
        });
        row.into_inner()
    }

    /// The figures of a row; none where its length is that of no summary.
    pub fn of_row(row: &[f64]) -> Option<Self> {
        let nothing = |corridors: usize| Self::nothing(0.0, Violations { sums: vec![[0.0; 3]; corridors] });
        let sums = row.len().checked_sub(nothing(0).to_row().len())?;
        if sums % 3 != 0 {
            return None;
        }
        let rest = RefCell::new(row.iter());
        Some(nothing(sums / 3).read(|_| rest.borrow_mut().next().copied().unwrap_or(f64::NAN)))
    }
}
