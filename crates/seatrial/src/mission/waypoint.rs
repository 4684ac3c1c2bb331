//! A checked mission: start, waypoints, limits. Guidance knows nothing but these.

use super::farm::Farm;
use super::file::MissionFile;
use crate::number::algebra::Vec3;

/// The most waypoints of a mission: a flight of days, and a bound on a mistyped spacing.
pub const MOST_WAYPOINTS: usize = 10_000;

/// From where the third coordinate of a waypoint counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vertical {
    /// Down from the surface.
    Depth,
    /// Up from the bottom.
    Altitude,
}

/// What is done at a waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// Go on to the next.
    Pass,
    /// Keep station.
    Hold {
        /// So long, s.
        seconds: f64,
        /// With this heading, rad in [−π, π); any when missing.
        heading: Option<f64>,
    },
    /// Fly a circle about it.
    Circle {
        /// Radius, m.
        radius: f64,
        /// Whether it turns to starboard, clockwise seen from above.
        clockwise: bool,
        /// So many times; may be fractional.
        turns: f64,
    },
}

/// Where a leg ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoint {
    /// North, east, depth in m (frame n); the third is the altitude above the bottom for [`Vertical::Altitude`].
    pub position: Vec3<f64>,
    /// From where the third coordinate counts.
    pub vertical: Vertical,
    /// Speed over ground on the leg that ends here, m/s.
    pub speed: f64,
    /// Radius R_0 of the sphere of acceptance, m.
    pub acceptance: f64,
    /// What is done here.
    pub task: Task,
    /// Name in reports.
    pub label: String,
}

/// What the mission may not leave.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Largest depth, m; infinite without a limit.
    pub depth: f64,
    /// Smallest altitude above the bottom, m; 0 without a limit.
    pub altitude: f64,
    /// Longest time, s; infinite without a limit.
    pub time: f64,
    /// Corners of the fence, north and east, m; empty without one.
    pub fence: Vec<[f64; 2]>,
}

/// What stands in the water from the surface to the bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Its outline seen from above.
    pub shape: Farm,
    /// Smallest distance of the hull from it that the mission promises, m; 0: it may come near, but not touch.
    pub distance: f64,
    /// Number of the leg that goes about it, from 1; none for one of `[[obstacles]]`.
    pub leg: Option<usize>,
}

/// Where the first leg begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// North, east, depth, m (frame n).
    pub position: Vec3<f64>,
    /// Heading, rad in [−π, π); towards the first waypoint when missing ([`Mission::start_heading`]).
    pub heading: Option<f64>,
}

/// A checked mission.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// The file, as written.
    pub file: MissionFile,
    /// Where the first leg begins.
    pub start: Start,
    /// The waypoints in the order of travel, at least one.
    pub waypoints: Vec<Waypoint>,
    /// Number of the leg of the file, from 1, that each waypoint belongs to.
    pub legs: Vec<usize>,
    /// What the mission may not leave.
    pub limits: Limits,
    /// What stands in the water: the farms of the legs, then those of `[[obstacles]]`.
    pub obstacles: Vec<Obstacle>,
}
