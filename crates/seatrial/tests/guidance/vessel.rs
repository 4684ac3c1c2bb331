//! A vehicle without forces: heading, pitch and speed follow what is desired with a first-order lag, and the water
//! carries it.

use seatrial::control::guidance::{Desired, Fix, Guidance, GuidanceTable, Method, Progress};
use seatrial::mission::{Start, Task, Vertical, Waypoint};
use seatrial::number::real::Real;

/// Period of the guidance, s.
pub const DT: f64 = 0.1;

/// How the vehicle can move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Depth by pitch; the speed is through the water.
    Torpedo,
    /// Surge, heave and yaw; the speed is over ground.
    Hover,
    /// The same and sway.
    Sway,
}

/// The vehicle.
#[derive(Clone, Copy)]
pub struct Vessel {
    pub kind: Kind,
    pub position: [f64; 3],
    pub yaw: f64,
    pub pitch: f64,
    pub speed: f64,
    pub lateral: f64,
    /// Current, north, east, down, m/s.
    pub current: [f64; 3],
    /// Depth of the bottom by the way north.
    pub bottom: fn(f64) -> f64,
}

impl Vessel {
    pub fn new(kind: Kind, yaw: f64, speed: f64) -> Self {
        Self {
            kind,
            position: [0.0, 0.0, 10.0],
            yaw,
            pitch: 0.0,
            speed,
            lateral: 0.0,
            current: [0.0; 3],
            bottom: |_| 100.0,
        }
    }

    pub fn at(self, position: [f64; 3]) -> Self {
        Self { position, ..self }
    }

    pub fn in_current(self, current: [f64; 3]) -> Self {
        Self { current, ..self }
    }

    /// Velocity over ground: ahead, to starboard, down.
    fn ground(&self) -> [f64; 3] {
        let (s, c) = self.yaw.sin_cos();
        let [ahead, aside] =
            [c * self.current[0] + s * self.current[1], c * self.current[1] - s * self.current[0]];
        match self.kind {
            Kind::Torpedo => [
                self.speed * self.pitch.cos() + ahead,
                aside,
                -self.speed * self.pitch.sin() + self.current[2],
            ],
            Kind::Hover => [self.speed, aside, 0.0],
            Kind::Sway => [self.speed, self.lateral, 0.0],
        }
    }

    pub fn fix(&self) -> Fix<f64> {
        Fix {
            position: self.position,
            altitude: (self.bottom)(self.position[0]) - self.position[2],
            attitude: [0.0, self.pitch, self.yaw],
            velocity: self.ground(),
        }
    }

    pub fn step(&mut self, desired: &Desired<f64>) {
        let (s, c) = self.yaw.sin_cos();
        let [u, v, w] = self.ground();
        self.position[0] += DT * (c * u - s * v);
        self.position[1] += DT * (s * u + c * v);
        self.position[2] += DT * w;
        if self.kind != Kind::Torpedo {
            self.position[2] += DT * (desired.depth - self.position[2]).clamp(-0.5, 0.5);
        }
        self.yaw = Real::wrap(self.yaw + DT / 1.5 * Real::wrap(desired.heading - self.yaw));
        self.pitch += DT / 1.5 * (desired.pitch - self.pitch);
        self.speed += DT / 2.0 * (desired.speed - self.speed);
        self.lateral += DT / 2.0 * (desired.lateral - self.lateral);
    }
}

/// The default table with a method.
pub fn table(method: Method) -> GuidanceTable {
    GuidanceTable { method, ..GuidanceTable::default() }
}

/// Guidance for a kind of vehicle.
pub fn guidance(table: &GuidanceTable, kind: Kind) -> Guidance<f64> {
    Guidance::new(table, 0.0, kind == Kind::Sway, kind != Kind::Torpedo)
}

/// A waypoint at 1.5 m/s with a sphere of 3 m.
pub fn waypoint(position: [f64; 3], task: Task) -> Waypoint {
    Waypoint { position, vertical: Vertical::Depth, speed: 1.5, acceptance: 3.0, task, label: String::new() }
}

pub fn pass(position: [f64; 3]) -> Waypoint {
    waypoint(position, Task::Pass)
}

pub fn start(position: [f64; 3]) -> Start {
    Start { position, heading: None }
}

/// A point of a flight.
pub struct Point {
    pub t: f64,
    pub vessel: Vessel,
    pub desired: Desired<f64>,
}

/// A flight from where the vessel is, and the progress at its end.
pub fn fly(
    guidance: &Guidance<f64>,
    waypoints: &[Waypoint],
    mut vessel: Vessel,
    seconds: f64,
) -> (Vec<Point>, Progress<f64>) {
    let mut progress = guidance.begin(&start(vessel.position), waypoints);
    let points = go_on(guidance, waypoints, &mut progress, &mut vessel, seconds);
    (points, progress)
}

/// The same from a progress.
pub fn go_on(
    guidance: &Guidance<f64>,
    waypoints: &[Waypoint],
    progress: &mut Progress<f64>,
    vessel: &mut Vessel,
    seconds: f64,
) -> Vec<Point> {
    (0..(seconds / DT) as usize)
        .map(|k| {
            let desired = guidance.step(waypoints, progress, &vessel.fix(), DT);
            let point = Point { t: k as f64 * DT, vessel: *vessel, desired };
            vessel.step(&desired);
            point
        })
        .collect()
}

/// Horizontal distance from a point to another.
pub fn range(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The largest of the values.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NEG_INFINITY, f64::max)
}
