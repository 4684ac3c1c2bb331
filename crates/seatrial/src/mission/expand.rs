//! From the legs of a file to waypoints: what is missing comes from the leg before or the top, patterns become points.
//!
//! A message names leg, key, what was expected and what was found. Legs count from 1, as the labels do.
//!
//! Tests: `tests/mission/refusals.rs` (one message per mistake), `tests/mission/expansion.rs`.

use super::farm::{Farm, Round, descent};
use super::file::{Leg, MissionFile};
use super::legs::{Lawnmower, ObstacleTable, Perimeter, Side, Spiral, WaypointLeg};
use super::numbers::{angle, finite, not_negative, place, positive};
use super::patterns::{Coil, Rectangle};
use super::plane::Place;
use super::waypoint::{MOST_WAYPOINTS, Obstacle, Task, Vertical, Waypoint};

/// The waypoints of a mission, and what belongs to them.
pub(super) struct Expansion {
    /// In the order of travel.
    pub waypoints: Vec<Waypoint>,
    /// Number of the leg of each, from 1.
    pub leg: Vec<usize>,
    /// What stands in the water.
    pub obstacles: Vec<Obstacle>,
}

/// Speed in m/s and radius of acceptance in m.
type Pace = (f64, f64);
/// Depth or altitude, m.
type Level = (Vertical, f64);

/// The waypoints of the legs of a file.
pub(super) fn expand(file: &MissionFile) -> Result<Expansion, String> {
    if file.legs.is_empty() {
        return Err("legs: expected at least one [[legs]] table, found none".into());
    }
    let mut way = Way {
        file,
        level: (Vertical::Depth, not_negative("start.depth_m", file.start.depth_m)?),
        out: Expansion { waypoints: Vec::new(), leg: Vec::new(), obstacles: Vec::new() },
    };
    for (k, leg) in file.legs.iter().enumerate() {
        let added = match leg {
            Leg::Waypoint(leg) => way.waypoint(leg, k + 1),
            Leg::Lawnmower(leg) => way.lawnmower(leg),
            Leg::Spiral(leg) => way.spiral(leg),
            Leg::Perimeter(leg) => way.perimeter(leg, k + 1),
        };
        added.and_then(|()| way.room(0.0)).map_err(|message| format!("leg {}: {message}", k + 1))?;
        way.out.leg.resize(way.out.waypoints.len(), k + 1);
    }
    for (k, table) in file.obstacles.iter().enumerate() {
        let obstacle = obstacle(table).map_err(|message| format!("obstacle {}: {message}", k + 1))?;
        way.out.obstacles.push(obstacle);
    }
    Ok(way.out)
}

/// A circle of centre and radius, or a polygon of corners.
fn outline(
    circle: (Option<f64>, Option<f64>, Option<f64>),
    corners: &[Place],
    what: &str,
) -> Result<Farm, String> {
    match (circle, corners) {
        ((Some(north), Some(east), Some(radius)), []) => {
            Ok(Farm::Circle { centre: place(north, east)?, radius: positive("radius_m", radius)? })
        }
        ((None, None, None), [_, ..]) => {
            corners.iter().flatten().try_for_each(|x| finite("corners_m", *x).map(drop))?;
            Farm::polygon(corners).map_err(|message| format!("corners_m: {message}"))
        }
        _ => Err(format!("expected either north_m, east_m and radius_m of a circular {what} or corners_m")),
    }
}

fn obstacle(table: &ObstacleTable) -> Result<Obstacle, String> {
    Ok(Obstacle {
        shape: outline((table.north_m, table.east_m, table.radius_m), &table.corners_m, "obstacle")?,
        distance: not_negative("distance_m", table.distance_m)?,
        leg: None,
    })
}

struct Way<'a> {
    file: &'a MissionFile,
    /// Where the leg before ended.
    level: Level,
    out: Expansion,
}

impl Way<'_> {
    /// Refuses `more` waypoints beyond the most that a mission may have.
    fn room(&self, more: f64) -> Result<(), String> {
        let count = self.out.waypoints.len() as f64 + more;
        if count <= MOST_WAYPOINTS as f64 {
            return Ok(());
        }
        Err(format!(
            "expected at most {MOST_WAYPOINTS} waypoints in a mission, found more; choose wider spacing or tolerance"
        ))
    }

    /// Room for a pattern whose points were none because they were too many.
    fn fitting<P>(&self, points: Option<Vec<P>>) -> Result<Vec<P>, String> {
        match points {
            Some(points) => self.room(points.len() as f64).map(|()| points),
            None => self.room(f64::INFINITY).map(|()| Vec::new()),
        }
    }

    fn pace(&self, speed: Option<f64>, acceptance: Option<f64>) -> Result<Pace, String> {
        let given = |key: &str, own: Option<f64>, common: Option<f64>| match own.or(common) {
            Some(x) => positive(key, x),
            None => Err(format!("{key}: expected a number here or at the top of the file, found none")),
        };
        Ok((
            given("speed_m_s", speed, self.file.speed_m_s)?,
            given("acceptance_radius_m", acceptance, self.file.acceptance_radius_m)?,
        ))
    }

    fn level(&self, depth: Option<f64>, altitude: Option<f64>) -> Result<Level, String> {
        match (depth, altitude) {
            (Some(_), Some(_)) => Err("depth_m and altitude_m: expected one of the two, found both".into()),
            (Some(depth), None) => Ok((Vertical::Depth, not_negative("depth_m", depth)?)),
            (None, Some(altitude)) => Ok((Vertical::Altitude, positive("altitude_m", altitude)?)),
            (None, None) => Ok(self.level),
        }
    }

    fn push(&mut self, place: Place, level: Level, pace: Pace, (task, label): (Task, String)) {
        self.level = level;
        self.out.waypoints.push(Waypoint {
            position: [place[0], place[1], level.1],
            vertical: level.0,
            speed: pace.0,
            acceptance: pace.1,
            task,
            label,
        });
    }

    fn waypoint(&mut self, leg: &WaypointLeg, number: usize) -> Result<(), String> {
        let place = place(leg.north_m, leg.east_m)?;
        let level = self.level(leg.depth_m, leg.altitude_m)?;
        let pace = self.pace(leg.speed_m_s, leg.acceptance_radius_m)?;
        let task = match (leg.hold_s, leg.circle_radius_m, leg.turns) {
            (Some(_), Some(_), _) => {
                return Err("hold_s and circle_radius_m: expected one of the two, found both".into());
            }
            (_, Some(_), None) => {
                return Err("turns: expected the number of turns of the circle, found none".into());
            }
            (_, None, Some(_)) => {
                return Err("circle_radius_m: expected the radius of the turns, found none".into());
            }
            (Some(seconds), None, None) => Task::Hold {
                seconds: positive("hold_s", seconds)?,
                heading: leg.heading_deg.map(|x| angle("heading_deg", x)).transpose()?,
            },
            (None, Some(radius), Some(turns)) => Task::Circle {
                radius: positive("circle_radius_m", radius)?,
                clockwise: leg.direction != Some(Side::Port),
                turns: positive("turns", turns)?,
            },
            (None, None, None) => Task::Pass,
        };
        if leg.direction.is_some() && leg.circle_radius_m.is_none() {
            return Err(
                "direction: expected only with circle_radius_m and turns; remove it or give them".into()
            );
        }
        if leg.heading_deg.is_some() && leg.hold_s.is_none() {
            return Err(
                "heading_deg: expected only with hold_s; on the way the heading follows the path".into()
            );
        }
        let label = leg.label.clone().unwrap_or_else(|| format!("waypoint {number}"));
        self.push(place, level, pace, (task, label));
        Ok(())
    }

    fn lawnmower(&mut self, leg: &Lawnmower) -> Result<(), String> {
        let rectangle = Rectangle {
            corner: place(leg.north_m, leg.east_m)?,
            bearing: angle("heading_deg", leg.heading_deg)?,
            length: positive("length_m", leg.length_m)?,
            width: positive("width_m", leg.width_m)?,
            spacing: positive("spacing_m", leg.spacing_m)?,
            side: leg.side.sign(),
            overshoot: not_negative("overshoot_m", leg.overshoot_m)?,
        };
        let level = self.level(leg.depth_m, leg.altitude_m)?;
        let pace = self.pace(leg.speed_m_s, leg.acceptance_radius_m)?;
        self.room(2.0 * rectangle.count())?;
        let name = leg.label.as_deref().unwrap_or("lawnmower");
        let lines = rectangle.lines();
        for (i, [begin, end]) in lines.iter().enumerate() {
            let label = format!("{name} {}/{}", i + 1, lines.len());
            self.push(*begin, level, pace, (Task::Pass, format!("to {label}")));
            self.push(*end, level, pace, (Task::Pass, label));
        }
        Ok(())
    }

    fn spiral(&mut self, leg: &Spiral) -> Result<(), String> {
        let radii = [
            not_negative("start_radius_m", leg.start_radius_m)?,
            not_negative("end_radius_m", leg.end_radius_m)?,
        ];
        let change = (radii[1] - radii[0]).abs();
        let turns = match (leg.spacing_m, leg.turns) {
            (Some(_), Some(_)) => {
                return Err("spacing_m and turns: expected one of the two, found both".into());
            }
            (None, None) => {
                return Err("spacing_m: expected the distance between arms, or turns, found neither".into());
            }
            (None, Some(turns)) => positive("turns", turns)?,
            (Some(spacing), None) if change > 0.0 => change / positive("spacing_m", spacing)?,
            (Some(_), None) => return Err("turns: expected a number for equal radii, found spacing_m".into()),
        };
        if radii == [0.0; 2] {
            return Err(
                "end_radius_m: expected a radius above zero at the start or the end, found none".into()
            );
        }
        let coil = Coil {
            centre: place(leg.north_m, leg.east_m)?,
            radii,
            turns,
            bearing: angle("start_bearing_deg", leg.start_bearing_deg)?,
            side: leg.direction.sign(),
            tolerance: positive("tolerance_m", leg.tolerance_m)?,
        };
        let pace = self.pace(leg.speed_m_s, leg.acceptance_radius_m)?;
        let (vertical, begin) = self.level(leg.depth_m, leg.altitude_m)?;
        let end = match leg.end_depth_m {
            None => begin,
            Some(_) if vertical == Vertical::Altitude => {
                return Err(
                    "end_depth_m: expected a depth where the spiral begins too, found an altitude".into()
                );
            }
            Some(end) => not_negative("end_depth_m", end)?,
        };
        let name = leg.label.as_deref().unwrap_or("spiral");
        let points = self.fitting(coil.points(MOST_WAYPOINTS))?;
        for (i, (share, place)) in points.iter().enumerate() {
            let level = (vertical, begin + share * (end - begin));
            let label = format!("{name} {}/{}", i + 1, points.len());
            self.push(*place, level, pace, (Task::Pass, label));
        }
        Ok(())
    }

    fn perimeter(&mut self, leg: &Perimeter, number: usize) -> Result<(), String> {
        let farm = outline((leg.north_m, leg.east_m, leg.radius_m), &leg.corners_m, "farm")?;
        let promised = positive("distance_m", leg.distance_m)?;
        let round = Round {
            distance: promised + not_negative("margin_m", leg.margin_m)?,
            tolerance: positive("tolerance_m", leg.tolerance_m)?,
            bearing: angle("start_bearing_deg", leg.start_bearing_deg)?,
            side: leg.direction.sign(),
            stops: leg.stops,
        };
        let seconds = match (leg.stops, leg.stop_s) {
            (0, None) => 0.0,
            (0, Some(_)) => {
                return Err("stop_s: expected only with stops; give their number or remove it".into());
            }
            (_, None) => return Err("stop_s: expected the time at each stop in s, found none".into()),
            (_, Some(seconds)) => positive("stop_s", seconds)?,
        };
        let pace = self.pace(leg.speed_m_s, leg.acceptance_radius_m)?;
        let levels: Vec<Level> = match &leg.depths_m[..] {
            [] => vec![self.level],
            depths => {
                let level = |depth: &f64| Ok((Vertical::Depth, not_negative("depths_m", *depth)?));
                depths.iter().map(level).collect::<Result<_, String>>()?
            }
        };
        let name = leg.label.as_deref().unwrap_or("farm");
        let points = self.fitting(farm.round(&round, MOST_WAYPOINTS))?;
        self.room((points.len() * levels.len()) as f64)?;
        if points.iter().filter(|p| p.stop.is_some()).count() != leg.stops as usize {
            return Err(format!(
                "stops: expected stops more than twice tolerance_m = {} m apart, found {}",
                round.tolerance, leg.stops
            ));
        }
        let begin = descent(leg.stops);
        for (i, level) in levels.iter().enumerate() {
            let next = levels.get(i + 1).unwrap_or(level);
            let shown = |(vertical, metres): &Level| match vertical {
                Vertical::Depth => format!("{metres} m"),
                Vertical::Altitude => format!("{metres} m above the bottom"),
            };
            for point in &points {
                let sunk = ((point.share - begin) / (1.0 - begin)).max(0.0);
                let (task, label) = match point.stop {
                    Some(stop) => {
                        let task = Task::Hold { seconds, heading: None };
                        (task, format!("{name} stop {stop} at {}", shown(level)))
                    }
                    None if sunk > 0.0 && next != level => {
                        (Task::Pass, format!("{name} round {} to {}", i + 1, shown(next)))
                    }
                    None => (Task::Pass, format!("{name} round {} at {}", i + 1, shown(level))),
                };
                self.push(point.place, (level.0, level.1 + sunk * (next.1 - level.1)), pace, (task, label));
            }
            if i + 1 == levels.len() {
                self.push(
                    points[0].place,
                    *level,
                    pace,
                    (Task::Pass, format!("{name} round {} closed", i + 1)),
                );
            }
        }
        self.out.obstacles.push(Obstacle { shape: farm, distance: promised, leg: Some(number) });
        Ok(())
    }
}
