//! Guidance: from the plan and the present position to desired speed, heading, pitch and depth.
//!
//! One [`step`](Guidance::step) per period of the autopilot: [`arrival`] decides which waypoint is active and
//! whether the vehicle is under way to it or busy there; [`leg`] and [`circle`] give the path and the error against
//! it; [`law`] makes heading, pitch and speed of it; [`hold`] keeps station; [`integral`] learns the drift;
//! [`limits`] bounds what is asked. Nothing allocates, and each lane may be on another leg.
//!
//! Frame n (north, east, down), SI and radians. Cross-track error `y_e` is positive to starboard of the path,
//! vertical error `z_e` positive below it.
//!
//! Source: Taubert et al. (2014), equations 51–53, with (51) corrected; Fossen (2011), sections 10.3 and 10.4;
//! Børhaug, Pavlov and Pettersen (2008) and Caharija et al. (2016) for the integral.
//! Tests: `tests/guidance.rs`. Text: `docs/theory/guidance.md`.

pub mod arrival;
pub mod circle;
pub mod flag;
pub mod hold;
pub mod integral;
pub mod law;
pub mod leg;
pub mod limits;
pub mod progress;
pub mod table;

use crate::mission::{Start, Waypoint};
use crate::number::algebra::Vec3;
use crate::number::real::Real;
use flag::{holds, not};
pub use progress::Progress;
pub use table::{GuidanceTable, Method, TUNABLE};

/// Constants of the guidance; every number may differ from lane to lane.
#[derive(Clone, Copy, Debug)]
pub struct Guidance<T> {
    /// How heading and pitch follow from the errors.
    pub method: Method,
    /// Whether the vehicle can push itself sideways.
    pub sway: bool,
    /// Whether the vehicle can stop: keep its depth without speed.
    pub hover: bool,
    /// Lookahead distance Δ in the horizontal plane, m.
    pub lookahead: T,
    /// Lookahead distance Δ_z in the vertical plane, m.
    pub lookahead_vertical: T,
    /// Speed for which both and the integral gains hold, m/s; 0: any.
    pub lookahead_speed: f64,
    /// Integral gain κ in the horizontal plane, m/s.
    pub integral_gain: T,
    /// Integral gain κ_z in the vertical plane, m/s.
    pub integral_gain_vertical: T,
    /// Largest desired pitch, rad.
    pub pitch_max: T,
    /// Largest rate of the desired heading, rad/s.
    pub turn_rate_max: T,
    /// Largest rate of the desired pitch, rad/s.
    pub pitch_rate_max: T,
    /// Largest rate of the desired depth, m/s.
    pub depth_rate_max: T,
    /// Largest desired speed, m/s.
    pub speed_max: T,
    /// Largest rate of the desired speed, m/s².
    pub acceleration_max: T,
    /// Share of the speed that is left while the heading is 90° or more off.
    pub turn_speed_share: T,
    /// Desired speed per distance when a point is held, 1/s.
    pub hold_gain: T,
    /// Horizontal distance at which station-keeping begins, m.
    pub hold_radius: T,
    /// Horizontal distance beyond which a vehicle turns to the point that it holds, m.
    pub watch_radius: T,
    /// Rate of the heading per error of the sideways speed when a point is held without sway, rad/m.
    pub weathervane_gain: T,
    /// Radius of the circle of a vehicle that cannot stop, m.
    pub loiter_radius: T,
}

/// Least share of the lookahead distances on slow legs.
const LEAST_SHARE: f64 = 0.5;

/// Where the vehicle is and how it moves, as the navigation says.
#[derive(Clone, Copy, Debug)]
pub struct Fix<T> {
    /// North, east, depth, m.
    pub position: Vec3<T>,
    /// Altitude above the bottom, m; not a number or infinite without bottom lock.
    pub altitude: T,
    /// Roll, pitch, yaw, rad.
    pub attitude: Vec3<T>,
    /// Velocity over ground in the body frame, m/s.
    pub velocity: Vec3<T>,
}

/// What the control loops are asked for.
#[derive(Clone, Copy, Debug)]
pub struct Desired<T> {
    /// Surge speed, m/s.
    pub speed: T,
    /// Sway speed, m/s; zero unless station is kept by a vehicle with sway.
    pub lateral: T,
    /// Heading, rad in [−π, π).
    pub heading: T,
    /// Pitch, rad, for depth by pitch.
    pub pitch: T,
    /// Depth, m, for depth by heave.
    pub depth: T,
    /// 1 while station is kept.
    pub holding: T,
    /// Cross-track error, m, positive to starboard of the path; zero while station is kept.
    pub cross_track: T,
    /// Vertical error, m, positive below the path, perpendicular to it.
    pub vertical_error: T,
    /// Distance to the active waypoint, of a circle to its circumference, m.
    pub distance: T,
    /// Index of the active waypoint.
    pub leg: T,
    /// 1 when the mission is complete.
    pub done: T,
}

impl<T: Real> Guidance<T> {
    /// The constants of a table in the kind of `unit`, for a vehicle that can push itself sideways (`sway`) and can
    /// keep its depth without speed (`hover`).
    pub fn new(table: &GuidanceTable, unit: T, sway: bool, hover: bool) -> Self {
        let zero = unit.zero();
        let mut guidance = Self {
            lookahead_speed: table.lookahead_speed_m_s,
            method: table.method,
            sway,
            hover,
            lookahead: zero,
            lookahead_vertical: zero,
            integral_gain: zero,
            integral_gain_vertical: zero,
            pitch_max: zero,
            turn_rate_max: zero,
            pitch_rate_max: zero,
            depth_rate_max: zero,
            speed_max: zero,
            acceleration_max: zero,
            turn_speed_share: zero,
            hold_gain: zero,
            hold_radius: zero,
            watch_radius: zero,
            weathervane_gain: zero,
            loiter_radius: zero,
        };
        for (index, value) in table.tunable().into_iter().enumerate() {
            guidance.set(index, zero.splat(value));
        }
        guidance
    }

    /// Gives the constants the values of the names in [`TUNABLE`], in their units.
    pub fn tune(&mut self, values: &[T]) {
        for (index, value) in values.iter().enumerate() {
            self.set(index, *value);
        }
    }

    /// Gives the constant `TUNABLE[index]` a value in the unit of its name; another index does nothing.
    pub fn set(&mut self, index: usize, value: T) {
        let radians = value * (std::f64::consts::PI / 180.0);
        match index {
            0 => self.lookahead = value,
            1 => self.lookahead_vertical = value,
            2 => self.integral_gain = value,
            3 => self.integral_gain_vertical = value,
            4 => self.pitch_max = radians,
            5 => self.turn_rate_max = radians,
            6 => self.pitch_rate_max = radians,
            7 => self.depth_rate_max = value,
            8 => self.speed_max = value,
            9 => self.acceleration_max = value,
            10 => self.turn_speed_share = value,
            11 => self.hold_gain = value,
            12 => self.hold_radius = value,
            13 => self.watch_radius = value,
            14 => self.weathervane_gain = value,
            15 => self.loiter_radius = value,
            _ => {}
        }
    }

    /// The state of a mission that has not begun.
    pub fn begin(&self, start: &Start, waypoints: &[Waypoint]) -> Progress<T> {
        Progress::new(start, waypoints, self.lookahead.zero())
    }

    /// Ends the mission where the mask holds: the vehicle keeps, or circles, the place of the fix.
    #[inline(always)]
    pub fn stop_here(&self, progress: &mut Progress<T>, fix: &Fix<T>, at: T::Mask) {
        progress.stop(fix, at);
    }

    /// The pitch towards a depth that lies `above` metres above the vehicle, rad.
    #[inline(always)]
    pub fn pitch_towards(&self, above: T) -> T {
        above.atan2(self.lookahead_vertical).clamped(-self.pitch_max, self.pitch_max)
    }

    /// What is desired at this instant; `dt` seconds pass until the next call.
    ///
    /// The first call starts every limited quantity from what is measured.
    #[inline(always)]
    pub fn step(
        &self,
        waypoints: &[Waypoint],
        progress: &mut Progress<T>,
        fix: &Fix<T>,
        dt: f64,
    ) -> Desired<T> {
        if !progress.started {
            progress.measured(fix);
        }
        self.at_speed(progress.leg.speed).go_on(waypoints, progress, fix, dt)
    }

    /// The constants for the speed of a leg.
    #[inline(always)]
    fn at_speed(&self, speed: T) -> Self {
        if self.lookahead_speed <= 0.0 {
            return *self;
        }
        let share =
            (speed * (1.0 / self.lookahead_speed)).clamped(speed.splat(LEAST_SHARE), speed.splat(1.0));
        Self {
            lookahead: self.lookahead * share,
            lookahead_vertical: self.lookahead_vertical * share,
            integral_gain: self.integral_gain * share,
            integral_gain_vertical: self.integral_gain_vertical * share,
            ..*self
        }
    }

    #[inline(always)]
    fn go_on(&self, waypoints: &[Waypoint], progress: &mut Progress<T>, fix: &Fix<T>, dt: f64) -> Desired<T> {
        arrival::update(self, waypoints, progress, fix, dt);

        let work = arrival::Work::new(self, progress);
        let place = progress.leg.place(fix, progress.terrain);
        progress.terrain = place.target;
        let mut path = progress.leg.path(&place, fix);
        if T::any(holds(work.circling)) {
            let round = circle::path(&work, &place);
            path = path.select(holds(work.circling), &round);
        }
        let under_way = law::follow(self, progress, &path, &place, fix);
        let asked = if T::any(holds(work.holding)) {
            let kept = hold::keep(self, progress, fix, &place, dt);
            under_way.select(holds(work.holding), &kept)
        } else {
            under_way
        };
        progress.was_holding = work.holding;
        limits::apply(self, progress, &asked, fix, dt);
        if self.method == Method::Integral {
            integral::learn(self, progress, &path, &under_way, (fix, &work, dt));
        }
        Desired {
            speed: progress.speed,
            lateral: if self.sway { progress.lateral * work.holding } else { place.range.zero() },
            heading: progress.heading,
            pitch: progress.pitch,
            depth: progress.depth,
            holding: work.holding,
            cross_track: path.cross * not(work.holding),
            vertical_error: path.vertical,
            distance: work.miss(&place),
            leg: progress.index,
            done: progress.done,
        }
    }
}
