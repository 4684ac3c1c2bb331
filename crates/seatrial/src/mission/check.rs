//! What makes a mission unfit to fly: limits that its places or its way leave, legs without length.
//!
//! The way between two waypoints is taken as straight; so is the way over a fence's corner or past a farm.
//!
//! Tests: `tests/mission/refusals.rs` (one message per mistake).

use super::expand::Expansion;
use super::fence::inside;
use super::file::MissionFile;
use super::landmarks;
use super::numbers::{finite, not_negative, positive};
use super::plane::{Place, cross_each_other, distance_to_stretch};
use super::waypoint::{Mission, Obstacle, Task, Vertical};
use crate::number::plain;

/// A leg shorter than this has no direction, m.
const SHORTEST: f64 = 1e-6;

/// Refuses numbers of the tables that have no meaning.
pub(super) fn tables(file: &MissionFile) -> Result<(), String> {
    if let Some(origin) = &file.origin {
        for (key, value, most) in
            [("latitude_deg", origin.latitude_deg, 90.0), ("longitude_deg", origin.longitude_deg, 180.0)]
        {
            if !(-most..=most).contains(&value) {
                return Err(format!("origin.{key}: expected -{most} to {most}, found {value}"));
            }
        }
    }
    finite("start.north_m", file.start.north_m)?;
    finite("start.east_m", file.start.east_m)?;
    let limits = &file.limits;
    limits.max_depth_m.map_or(Ok(0.0), |x| positive("limits.max_depth_m", x))?;
    limits.min_altitude_m.map_or(Ok(0.0), |x| not_negative("limits.min_altitude_m", x))?;
    limits.max_time_s.map_or(Ok(0.0), |x| positive("limits.max_time_s", x))?;
    landmarks::check(&file.landmarks)?;
    limits.fence_m.iter().flatten().try_for_each(|x| finite("limits.fence_m", *x).map(drop))?;
    fence_corners(&limits.fence_m)
}

/// Refuses a fence without area, or with edges that cross: what lies inside would be anybody's guess.
fn fence_corners(fence: &[Place]) -> Result<(), String> {
    let count = fence.len();
    if (1..=2).contains(&count) {
        return Err(format!("limits.fence_m: expected at least three corners, found {count}"));
    }
    let edge = |i: usize| [fence[i], fence[(i + 1) % count]];
    for i in 0..count {
        if let Some(j) = (0..i).find(|&j| cross_each_other(edge(i), edge(j))) {
            return Err(format!(
                "limits.fence_m: expected edges that do not cross, but those behind corners {} and {} do; give the corners in order",
                j + 1,
                i + 1
            ));
        }
    }
    Ok(())
}

/// Refuses a mission that cannot be flown as written.
pub(super) fn mission(mission: &Mission, expansion: &Expansion) -> Result<(), String> {
    let at = |k: usize, message: String| {
        format!("leg {}: \"{}\": {message}", expansion.leg[k], mission.waypoints[k].label)
    };
    let start = mission.start.position;
    let (deepest, longest, planned) = (mission.limits.depth, mission.limits.time, mission.planned_time());
    if start[2] > deepest {
        return Err(format!(
            "start.depth_m: expected at most limits.max_depth_m = {deepest}, found {}",
            start[2]
        ));
    }
    if planned > longest {
        return Err(format!(
            "limits.max_time_s: expected more than the planned {planned:.1} s, found {longest}"
        ));
    }
    if !inside(&mission.limits.fence, [start[0], start[1]]) {
        return Err(format!(
            "start: expected a place inside limits.fence_m, found north {}, east {}",
            start[0], start[1]
        ));
    }
    for k in 0..mission.waypoints.len() {
        level(mission, k).map_err(|message| at(k, message))?;
        fence(mission, k).map_err(|message| at(k, message))?;
        length(mission, k).map_err(|message| at(k, message))?;
        obstacles(mission, k).map_err(|message| at(k, message))?;
    }
    Ok(())
}

fn level(mission: &Mission, k: usize) -> Result<(), String> {
    let (point, limits) = (&mission.waypoints[k], &mission.limits);
    let level = point.position[2];
    match point.vertical {
        Vertical::Depth if level > limits.depth => {
            Err(format!("depth_m: expected at most limits.max_depth_m = {}, found {level}", limits.depth))
        }
        Vertical::Altitude if level < limits.altitude => Err(format!(
            "altitude_m: expected at least limits.min_altitude_m = {}, found {level}",
            limits.altitude
        )),
        _ => Ok(()),
    }
}

/// The way to waypoint `k` as seen from above.
fn stretch(mission: &Mission, k: usize) -> [Place; 2] {
    let from = k.checked_sub(1).map_or(mission.start.position, |i| mission.waypoints[i].position);
    let to = mission.waypoints[k].position;
    [[from[0], from[1]], [to[0], to[1]]]
}

fn fence(mission: &Mission, k: usize) -> Result<(), String> {
    let fence = &mission.limits.fence;
    let [from, to] = stretch(mission, k);
    if !inside(fence, to) {
        return Err(format!(
            "north_m and east_m: expected a place inside limits.fence_m, found north {}, east {}",
            to[0], to[1]
        ));
    }
    let mut edges = (0..fence.len()).map(|i| [fence[i], fence[(i + 1) % fence.len()]]);
    if edges.clone().any(|edge| cross_each_other([from, to], edge)) {
        return Err("expected a path inside limits.fence_m, but the straight path there crosses it; add waypoints that go round".into());
    }
    match mission.waypoints[k].task {
        Task::Circle { radius, .. } if edges.any(|[a, b]| distance_to_stretch(to, a, b) < radius) => {
            Err(format!("circle_radius_m: expected a circle inside limits.fence_m, found radius {radius}"))
        }
        _ => Ok(()),
    }
}

fn length(mission: &Mission, k: usize) -> Result<(), String> {
    let point = &mission.waypoints[k];
    let step = mission.step(k);
    let length = plain::hypot(plain::hypot(step[0], step[1]), step[2]);
    // A vehicle may turn on the spot, to look the other way, or begin with a hold.
    if matches!(point.task, Task::Hold { .. }) {
        return Ok(());
    }
    if k == 0 && length <= point.acceptance {
        return Err(format!(
            "acceptance_radius_m: expected less than the {length:.3} m from the start, found {}; begin farther away or with a smaller radius",
            point.acceptance
        ));
    }
    if k > 0 && length < SHORTEST && mission.waypoints[k - 1].vertical == point.vertical {
        return Err(format!(
            "expected another place than that of \"{}\" before it, found the same; leave one out",
            mission.waypoints[k - 1].label
        ));
    }
    Ok(())
}

fn obstacles(mission: &Mission, k: usize) -> Result<(), String> {
    let [from, to] = stretch(mission, k);
    for (number, Obstacle { shape: farm, distance: wanted, .. }) in mission.obstacles.iter().enumerate() {
        let about = match mission.waypoints[k].task {
            Task::Circle { radius, .. } => farm.distance(to, to) - radius,
            _ => f64::INFINITY,
        };
        let found = farm.distance(from, to).min(about).max(0.0);
        // Rounding of the pattern's own chords.
        if found < wanted - SHORTEST {
            return Err(format!(
                "distance_m: expected to stay {wanted} m from {} on the way there, found {found:.2} m; begin the round elsewhere or go round by further waypoints",
                mission.obstacle_name(number)
            ));
        }
    }
    Ok(())
}
