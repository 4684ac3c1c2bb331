//! Missions: a file of legs, and the waypoints that it means.
//!
//! Places are metres north, east and down of an origin (NED). A leg is straight and ends at its waypoint; patterns
//! (lawnmower, spiral, rounds about a fish farm) become waypoints here, so that guidance knows nothing but those. What
//! cannot be flown as written is refused with its leg and key before anything moves.
//!
//! Source: Taubert et al. (2014), equations 51–53 (waypoints and their sphere of acceptance).
//! Tests: `tests/mission.rs`.

mod check;
mod expand;
pub mod farm;
pub mod fence;
pub mod file;
pub mod legs;
mod numbers;
pub mod patterns;
mod plan;
pub mod plane;

use crate::error::Error;
use crate::number::algebra::Vec3;
pub use fence::{inside, outside};
use file::Leg;
pub use file::MissionFile;
use legs::{Side, WaypointLeg};

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
    /// What the mission may not leave.
    pub limits: Limits,
}

impl Mission {
    /// Reads, expands and checks a mission file; `source_name` stands in messages.
    ///
    /// # Errors
    /// What is wrong with the file, in which leg, at which key, and what to do.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, Error> {
        Self::new(MissionFile::parse(text, source_name)?, source_name)
    }

    /// Expands and checks a parsed file.
    ///
    /// # Errors
    /// What is wrong with the file, in which leg, at which key, and what to do.
    pub fn new(file: MissionFile, source_name: &str) -> Result<Self, Error> {
        Self::checked(file).map_err(|message| Error::vehicle(source_name, message))
    }

    fn checked(file: MissionFile) -> Result<Self, String> {
        check::tables(&file)?;
        let mut expansion = expand::expand(&file)?;
        let heading = file.start.heading_deg.map(|x| numbers::angle("start.heading_deg", x)).transpose()?;
        let mission = Self {
            start: Start { position: [file.start.north_m, file.start.east_m, file.start.depth_m], heading },
            waypoints: std::mem::take(&mut expansion.waypoints),
            limits: Limits {
                depth: file.limits.max_depth_m.unwrap_or(f64::INFINITY),
                altitude: file.limits.min_altitude_m.unwrap_or(0.0),
                time: file.limits.max_time_s.unwrap_or(f64::INFINITY),
                fence: file.limits.fence_m.clone(),
            },
            file,
        };
        check::mission(&mission, &expansion)?;
        Ok(mission)
    }

    /// The mission file as written, TOML.
    pub fn to_toml(&self) -> String {
        self.file.to_toml()
    }

    /// The mission file with every pattern as waypoints, TOML: the same mission again.
    ///
    /// What a pattern alone knows, the farm that no leg may come near, is not in it.
    pub fn to_expanded_toml(&self) -> String {
        let leg = |waypoint: &Waypoint| {
            let [north_m, east_m, third] = waypoint.position;
            let is = |vertical| (waypoint.vertical == vertical).then_some(third);
            let mut leg = WaypointLeg {
                north_m,
                east_m,
                depth_m: is(Vertical::Depth),
                altitude_m: is(Vertical::Altitude),
                speed_m_s: Some(waypoint.speed),
                acceptance_radius_m: Some(waypoint.acceptance),
                label: Some(waypoint.label.clone()),
                ..WaypointLeg::default()
            };
            match waypoint.task {
                Task::Pass => {}
                Task::Hold { seconds, heading } => {
                    leg.hold_s = Some(seconds);
                    leg.heading_deg = heading.map(f64::to_degrees);
                }
                Task::Circle { radius, clockwise, turns } => {
                    leg.circle_radius_m = Some(radius);
                    leg.turns = Some(turns);
                    leg.direction = Some(if clockwise { Side::Starboard } else { Side::Port });
                }
            }
            Leg::Waypoint(leg)
        };
        MissionFile { legs: self.waypoints.iter().map(leg).collect(), ..self.file.clone() }.to_toml()
    }
}
