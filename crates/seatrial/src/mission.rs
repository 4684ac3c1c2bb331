//! Missions: a file of legs, and the waypoints that it means.
//!
//! Places are metres north, east and down of an origin (NED). A leg is straight and ends at its waypoint; patterns
//! (lawnmower, spiral, rounds about a fish farm) become waypoints here, so that guidance knows nothing but those. What
//! cannot be flown as written is refused with its leg and key before anything moves.
//!
//! In reading order: [`file`](mod@file), [`legs`] and [`landmarks`], what users write; [`waypoint`], what is flown; [`plane`], the geometry of
//! the plane; [`patterns`] and [`farm`], from a pattern to its places; `expand`, the waypoints of a file; [`fence`], inside
//! or outside; `plan`, courses, slopes, length and time; `check`, what is refused.
//!
//! Source: Taubert et al. (2014), equations 51–53 (waypoints and their sphere of acceptance).
//! Tests: `tests/mission.rs`.

mod check;
mod expand;
pub mod farm;
pub mod fence;
pub mod file;
pub mod landmarks;
pub mod legs;
mod numbers;
pub mod patterns;
mod plan;
pub mod plane;
pub mod waypoint;

use crate::error::Error;
pub use fence::{inside, outside};
use file::Leg;
pub use file::MissionFile;
use legs::{ObstacleTable, Side, WaypointLeg};
pub use waypoint::{Limits, MOST_WAYPOINTS, Mission, Obstacle, Start, Task, Vertical, Waypoint};

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
            legs: expansion.leg.clone(),
            limits: Limits {
                depth: file.limits.max_depth_m.unwrap_or(f64::INFINITY),
                altitude: file.limits.min_altitude_m.unwrap_or(0.0),
                time: file.limits.max_time_s.unwrap_or(f64::INFINITY),
                fence: file.limits.fence_m.clone(),
            },
            obstacles: std::mem::take(&mut expansion.obstacles),
            file,
        };
        check::mission(&mission, &expansion)?;
        Ok(mission)
    }

    /// What messages call an obstacle: the farm of a leg, or the number in the file, from 1.
    ///
    /// # Panics
    /// Where there is no such obstacle.
    pub fn obstacle_name(&self, index: usize) -> String {
        match self.obstacles[index].leg {
            Some(leg) => format!("the farm of leg {leg}"),
            None => {
                let own = self.obstacles[..=index].iter().filter(|o| o.leg.is_none()).count();
                format!("obstacle {own}")
            }
        }
    }

    /// What stands in the water of the mission, and further cylinders: north, east and radius, m.
    pub fn with_cylinders(&self, cylinders: &[(f64, f64, f64)]) -> Vec<Obstacle> {
        let cylinder = |&(north, east, radius): &(f64, f64, f64)| Obstacle {
            shape: farm::Farm::Circle { centre: [north, east], radius },
            distance: 0.0,
            leg: None,
        };
        self.obstacles.iter().cloned().chain(cylinders.iter().map(cylinder)).collect()
    }

    /// The mission with one waypoint elsewhere, north and east in m, every pattern as waypoints.
    ///
    /// # Errors
    /// There is no such waypoint, or the mission is none with it there.
    pub fn with_waypoint_at(&self, waypoint: usize, [north, east]: [f64; 2]) -> Result<Self, Error> {
        let mut moved = self.clone();
        let count = moved.waypoints.len();
        let Some(place) = moved.waypoints.get_mut(waypoint) else {
            return Err(Error::vehicle(
                &self.file.name,
                format!("waypoint {}: expected one of {count}", waypoint + 1),
            ));
        };
        place.position[..2].copy_from_slice(&[north, east]);
        Self::from_toml(&moved.to_expanded_toml(), &self.file.name)
    }

    /// The mission file as written, TOML.
    pub fn to_toml(&self) -> String {
        self.file.to_toml()
    }

    /// The mission file with every pattern as waypoints, TOML: the same mission again.
    ///
    /// A farm that a pattern goes about becomes one of the obstacles.
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
        let standing = |obstacle: &Obstacle| {
            let mut table = ObstacleTable {
                north_m: None,
                east_m: None,
                radius_m: None,
                corners_m: Vec::new(),
                distance_m: obstacle.distance,
            };
            match &obstacle.shape {
                farm::Farm::Circle { centre, radius } => {
                    (table.north_m, table.east_m, table.radius_m) =
                        (Some(centre[0]), Some(centre[1]), Some(*radius));
                }
                farm::Farm::Polygon(corners) => table.corners_m.clone_from(corners),
            }
            table
        };
        MissionFile {
            legs: self.waypoints.iter().map(leg).collect(),
            obstacles: self.obstacles.iter().map(standing).collect(),
            ..self.file.clone()
        }
        .to_toml()
    }
}
