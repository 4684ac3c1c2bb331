//! Length, time, course and slope of a mission as planned: straight between waypoints, at the speeds of the legs.
//!
//! A circle is joined at its point nearest to where the vehicle comes from and left after its turns; what the
//! guidance cuts at corners, current and acceleration are not in it. The bottom is taken as level: between two
//! altitudes the vehicle climbs by their difference, between a depth and an altitude by nothing that is known here.
//!
//! Tests: `tests/mission/plan.rs`.

use super::plane::{Place, difference, distance, towards};
use super::waypoint::{Mission, Task, Vertical};
use crate::number::algebra::Vec3;
use crate::number::plain;
use std::f64::consts::{PI, TAU};

/// What lies between two waypoints, and what is done at the second.
struct Stage {
    /// Straight way, m.
    straight: f64,
    /// Circle, m.
    circle: f64,
    /// Station-keeping, s.
    hold: f64,
}

impl Mission {
    /// Length of the path in m, from the start to the last waypoint, in space, circles included.
    pub fn path_length(&self) -> f64 {
        self.stages().iter().map(|stage| stage.straight + stage.circle).sum()
    }

    /// Time for the path in s at the speeds of its legs, with station-keeping and circles.
    pub fn planned_time(&self) -> f64 {
        let time = |(stage, speed): (&Stage, f64)| (stage.straight + stage.circle) / speed + stage.hold;
        self.stages().iter().zip(self.waypoints.iter().map(|w| w.speed)).map(time).sum()
    }

    /// Per waypoint the course over ground of the straight way to it from the one before, rad in (−π, π]; where that
    /// is vertical, the course before it (at first the start's heading, or north).
    pub fn courses(&self) -> Vec<f64> {
        let mut course = self.start.heading.unwrap_or(0.0);
        (0..self.waypoints.len())
            .map(|k| {
                let [north, east, _] = self.step(k);
                if north != 0.0 || east != 0.0 {
                    course = plain::atan2(east, north);
                }
                course
            })
            .collect()
    }

    /// Per waypoint the slope of the straight way to it, rad in [−π/2, π/2], positive upwards.
    pub fn slopes(&self) -> Vec<f64> {
        let slope = |[north, east, down]: Vec3<f64>| plain::atan2(0.0 - down, plain::hypot(north, east));
        (0..self.waypoints.len()).map(|k| slope(self.step(k))).collect()
    }

    /// The waypoint with the steepest way to it, by its index, and its slope in rad, positive upwards.
    pub fn steepest(&self) -> (usize, f64) {
        let steeper = |a: (usize, f64), b: (usize, f64)| if b.1.abs() > a.1.abs() { b } else { a };
        self.slopes().into_iter().enumerate().fold((0, 0.0), steeper)
    }

    /// The heading with which the mission begins, rad: the start's, or the course to the first waypoint.
    pub fn start_heading(&self) -> f64 {
        self.start.heading.unwrap_or_else(|| self.courses()[0])
    }

    /// From the waypoint before (or the start) to waypoint `k`: north, east, down in m.
    pub(super) fn step(&self, k: usize) -> Vec3<f64> {
        let (from, vertical) = match k.checked_sub(1).map(|i| &self.waypoints[i]) {
            None => (self.start.position, Vertical::Depth),
            Some(before) => (before.position, before.vertical),
        };
        let to = &self.waypoints[k];
        let down = match (vertical, to.vertical) {
            (Vertical::Depth, Vertical::Depth) => to.position[2] - from[2],
            (Vertical::Altitude, Vertical::Altitude) => from[2] - to.position[2],
            _ => 0.0,
        };
        [to.position[0] - from[0], to.position[1] - from[1], down]
    }

    fn stages(&self) -> Vec<Stage> {
        let mut here: Place = [self.start.position[0], self.start.position[1]];
        let stage = |(k, down): (usize, f64)| {
            let waypoint = &self.waypoints[k];
            let place = [waypoint.position[0], waypoint.position[1]];
            let across = distance(here, place);
            let (horizontal, circle, hold, end) = match waypoint.task {
                Task::Pass => (across, 0.0, 0.0, place),
                Task::Hold { seconds, .. } => (across, 0.0, seconds, place),
                Task::Circle { radius, clockwise, turns } => {
                    let to = difference(here, place);
                    let joined = plain::atan2(to[1], to[0]) + PI;
                    let turned = if clockwise { TAU * turns } else { -TAU * turns };
                    let end = towards(place, joined + turned, radius);
                    ((across - radius).abs(), TAU * radius * turns, 0.0, end)
                }
            };
            here = end;
            Stage { straight: plain::hypot(horizontal, down), circle, hold }
        };
        (0..self.waypoints.len()).map(|k| (k, self.step(k)[2])).map(stage).collect()
    }
}
