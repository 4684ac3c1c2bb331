//! Guidance: from the plan and the present position to desired speed, heading, pitch and depth.
//!
//! In reading order: [`table`], what users write; [`constants`], the same in SI units; [`fix`], what is told of the vehicle;
//! [`flag`], truth values as numbers; [`path`], a path at the vehicle; [`leg`]; [`progress`], what is remembered; then the
//! steps below.
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
pub mod constants;
pub mod fix;
pub mod flag;
pub mod hold;
pub mod integral;
pub mod law;
pub mod leg;
pub mod limits;
pub mod path;
pub mod progress;
pub mod table;
pub mod turn;

use crate::mission::{Start, Waypoint};
use crate::number::real::Real;
pub use constants::Guidance;
pub use fix::Fix;
use flag::{below, holds, not, pick};
pub use progress::Progress;
pub use table::{GuidanceTable, Method, TUNABLE};

/// Angle off the course within which a vehicle that sets off from a station has turned, rad.
const SET_OFF: f64 = 0.35;

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
    /// The state of a mission that has not begun.
    pub fn begin(&self, start: &Start, waypoints: &[Waypoint]) -> Progress<T> {
        Progress::new(start, waypoints, self.lookahead.zero())
    }

    /// Ends the mission where the mask holds: the vehicle keeps, or circles, the place of the fix.
    #[inline(always)]
    pub fn stop_here(&self, progress: &mut Progress<T>, fix: &Fix<T>, at: T::Mask) {
        progress.stop(fix, at);
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
        self.step_at_depth(waypoints, progress, fix, (dt, None))
    }

    /// As [`step`](Self::step), on a level path at a given depth (m) where the mask holds, in place of the plan's.
    #[inline(always)]
    pub fn step_at_depth(
        &self,
        waypoints: &[Waypoint],
        progress: &mut Progress<T>,
        fix: &Fix<T>,
        (dt, depth): (f64, Option<(T, T::Mask)>),
    ) -> Desired<T> {
        progress.measured(fix);
        self.at_speed(progress.leg.speed).go_on(waypoints, progress, fix, (dt, depth))
    }

    #[inline(always)]
    fn go_on(
        &self,
        waypoints: &[Waypoint],
        progress: &mut Progress<T>,
        fix: &Fix<T>,
        (dt, depth): (f64, Option<(T, T::Mask)>),
    ) -> Desired<T> {
        arrival::update(self, waypoints, progress, fix, dt);

        let work = arrival::Work::new(self, progress);
        let place = progress.leg.place(fix, progress.terrain);
        progress.terrain = place.target;
        let line = progress.leg.path(&place, fix);
        let mut path = turn::path(self, progress, &work, (&place, &line));
        if T::any(holds(work.circling)) {
            let round = circle::path(&work, &place);
            path = path.select(holds(work.circling), &round);
        }
        if let Some((depth, at)) = depth {
            path = path.select(at, &path.level_at(depth, fix.position[2]));
        }
        let under_way = law::follow(self, progress, &path, &place, fix);
        let off = (under_way.heading - fix.attitude[2]).wrap().abs();
        progress.setting_off *= below(off.splat(SET_OFF), off);
        // The heading at arrival is kept from then on.
        let arrives = work.holding * not(progress.was_holding);
        progress.kept_heading = pick(arrives, progress.heading, progress.kept_heading);
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
