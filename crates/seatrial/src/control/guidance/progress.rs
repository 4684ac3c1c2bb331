//! What guidance remembers from step to step; of fixed size.

use super::fix::Fix;
use super::flag::{holds, pick};
use super::leg::Leg;
use super::turn::Turn;
use crate::mission::{Start, Waypoint};
use crate::number::real::Real;

/// Farther than any mission, m: no distance has been seen yet.
const FAR: f64 = 1e9;

/// How far a mission has come. Flags are 0 or 1.
#[derive(Clone, Copy, Debug)]
pub struct Progress<T> {
    /// Index of the active waypoint.
    pub(super) index: T,
    /// The leg that ends there.
    pub(super) leg: Leg<T>,
    /// 1 once the limited quantities have been taken from what is measured.
    pub(super) started: T,
    /// The vehicle has been before the plane through the waypoint.
    pub(super) armed: T,
    /// The vehicle has come to the waypoint and is busy there: it holds or circles it.
    pub(super) busy: T,
    /// The clock of the hold runs, or the turns count.
    pub(super) arrived: T,
    /// Time since then, s.
    pub(super) clock: T,
    /// Angle swept round the centre since then in the circle's own direction, rad.
    pub(super) swept: T,
    /// Bearing of the vehicle from the centre at the last step, rad.
    pub(super) bearing: T,
    /// The mission is complete.
    pub(super) done: T,
    /// Smallest distance to the active waypoint so far, m.
    pub(super) closest: T,
    /// Largest of these distances over the waypoints that are done with, m.
    pub(super) farthest: T,
    /// The waypoint behind the vehicle, whose turn may have begun before it: north, east, depth, m.
    pub(super) passing: [T; 3],
    /// Smallest distance to it so far, m.
    pub(super) passed_by: T,
    /// The turn onto the active leg.
    pub(super) turn: Turn<T>,
    /// The vehicle sets off from a station with its bow off the course.
    pub(super) setting_off: T,
    /// Heading that is kept on station, rad.
    pub(super) kept_heading: T,
    /// Station was kept at the last step.
    pub(super) was_holding: T,
    /// Drift that the integral has learnt, north and east, s.
    pub(super) drift: [T; 2],
    /// The part of it that turns with a circle, s.
    pub(super) round: T,
    /// The integral of the vertical plane, s.
    pub(super) heave: T,
    /// Desired surge speed, m/s.
    pub(super) speed: T,
    /// Desired sway speed, m/s; the measured one while no station is kept.
    pub(super) lateral: T,
    /// Desired heading, rad.
    pub(super) heading: T,
    /// Desired pitch, rad.
    pub(super) pitch: T,
    /// Desired depth, m.
    pub(super) depth: T,
    /// Depth that the leg last asked for, m: without bottom lock it stays.
    pub(super) terrain: T,
    /// 1 where a mission was interrupted, and what of its leg was put aside then.
    pub(super) interrupted: T,
    pub(super) aside: [T; 9],
}

crate::memory!(Progress:
    index, leg, started, armed, busy, arrived, clock, swept, bearing, done, closest, farthest, passing, passed_by, turn,
    setting_off, kept_heading, was_holding, drift, round, heave, speed, lateral, heading, pitch, depth, terrain,
    interrupted, aside;);

impl<T: Real> Progress<T> {
    /// The state at the start, in the kind of `unit`. Without waypoints the mission is complete.
    pub fn new(start: &Start, waypoints: &[Waypoint], unit: T) -> Self {
        let zero = unit.zero();
        let from = start.position.map(|x| zero.splat(x));
        let course = zero.splat(start.heading.unwrap_or(0.0));
        let empty = zero.splat(if waypoints.is_empty() { 1.0 } else { 0.0 });
        let mut progress = Self {
            index: zero,
            leg: Leg::read(waypoints, zero, &from, course),
            started: zero,
            armed: zero,
            busy: zero,
            arrived: zero,
            clock: zero,
            swept: zero,
            bearing: zero,
            done: zero,
            closest: zero.splat(FAR),
            farthest: zero,
            passing: [zero; 3],
            passed_by: zero,
            turn: Turn::none(zero),
            setting_off: zero,
            kept_heading: zero,
            was_holding: zero,
            drift: [zero; 2],
            round: zero,
            heave: zero,
            speed: zero,
            lateral: zero,
            heading: zero,
            pitch: zero,
            depth: zero,
            terrain: zero,
            interrupted: zero,
            aside: [zero; 9],
        };
        progress.end_at(from, holds(empty));
        progress
    }

    /// Index of the active waypoint.
    #[inline(always)]
    pub fn leg(&self) -> T {
        self.index
    }

    /// Smallest distance to the active waypoint so far, m; to the circumference of a circle.
    #[inline(always)]
    pub fn closest(&self) -> T {
        self.closest
    }

    /// Largest of the smallest distances to the waypoints that are done with, m, the last of them until now: every waypoint was reached when it
    /// is not above the radius of acceptance.
    #[inline(always)]
    pub fn farthest_miss(&self) -> T {
        self.farthest.max(self.passed_by)
    }

    /// Drift that the integral has learnt, north and east, as multiples of κ/Δ in s: the crab angle that it asks
    /// for is `atan(κ drift · n / Δ)`.
    #[inline(always)]
    pub fn drift(&self) -> [T; 2] {
        self.drift
    }

    /// 1 while the vehicle keeps station at its waypoint, circles it, or dives there.
    #[inline(always)]
    pub fn busy(&self) -> T {
        self.busy
    }

    /// Forgets what the integrals have learnt.
    pub fn restart_integrals(&mut self) {
        let zero = self.index.zero();
        (self.drift, self.round, self.heave) = ([zero; 2], zero, zero);
    }

    /// Starts the limited quantities from what is measured, where they have not been started.
    #[inline(always)]
    pub(super) fn measured(&mut self, fix: &Fix<T>) {
        let first = self.started.lt(self.started.splat(0.5));
        if !T::any(first) {
            return;
        }
        let set = |to: &mut T, x: T| *to = T::select(first, x, *to);
        set(&mut self.speed, fix.velocity[0]);
        set(&mut self.lateral, fix.velocity[1]);
        set(&mut self.heading, fix.attitude[2].wrap());
        set(&mut self.pitch, fix.attitude[1]);
        set(&mut self.depth, fix.position[2]);
        set(&mut self.terrain, fix.position[2]);
        self.started = self.started.splat(1.0);
    }

    /// Moves the limited quantities with a jump of what is measured, m and rad.
    #[inline(always)]
    pub fn moved_by(&mut self, depth: T, pitch: T, yaw: T) {
        self.depth += depth;
        self.terrain += depth;
        self.pitch += pitch;
        self.heading = (self.heading + yaw).wrap();
    }

    /// Interrupts the mission at the place of the fix.
    #[inline(always)]
    pub(super) fn stop(&mut self, fix: &Fix<T>, at: T::Mask) {
        let under_way = T::both(at, self.done.lt(self.done.splat(0.5)));
        let task = self.task_mut().map(|x| *x);
        for (aside, x) in self.aside.iter_mut().zip(task) {
            *aside = T::select(under_way, x, *aside);
        }
        self.interrupted = T::select(under_way, self.done.splat(1.0), self.interrupted);
        self.end_at(fix.position, at);
    }

    /// Takes up again what was interrupted, on the leg's own line.
    #[inline(always)]
    pub fn resume(&mut self, at: T::Mask) {
        let zero = self.done.zero();
        let resumes = T::both(at, zero.splat(0.5).lt(self.interrupted));
        let aside = self.aside;
        for (x, aside) in self.task_mut().into_iter().zip(aside) {
            *x = T::select(resumes, aside, *x);
        }
        for flag in [&mut self.done, &mut self.interrupted, &mut self.was_holding] {
            *flag = T::select(resumes, zero, *flag);
        }
    }

    /// What an interruption takes from the leg: its end, what is done there, and whether the vehicle was at it.
    #[inline(always)]
    fn task_mut(&mut self) -> [&mut T; 9] {
        let leg = &mut self.leg;
        let [north, east, depth] = &mut leg.end;
        [
            north,
            east,
            depth,
            &mut leg.terrain,
            &mut leg.hold,
            &mut leg.circle,
            &mut leg.wished,
            &mut leg.sense,
            &mut self.busy,
        ]
    }

    /// Ends the mission at a place where the mask holds.
    #[inline(always)]
    fn end_at(&mut self, place: [T; 3], at: T::Mask) {
        let (zero, one) = (self.index.zero(), self.index.splat(1.0));
        let set = |to: &mut T, x: T| *to = T::select(at, x, *to);
        for i in 0..3 {
            set(&mut self.leg.end[i], place[i]);
        }
        for flag in [&mut self.leg.terrain, &mut self.leg.hold, &mut self.leg.circle, &mut self.leg.wished] {
            set(flag, zero);
        }
        for flag in [&mut self.busy, &mut self.done] {
            set(flag, one);
        }
        set(&mut self.leg.sense, one);
        set(&mut self.was_holding, zero);
        set(&mut self.round, zero);
    }

    /// Goes on to the next waypoint where `go` is 1, on a line from `from`.
    #[inline(always)]
    pub(super) fn advance(&mut self, waypoints: &[Waypoint], go: T, from: &[T; 3]) {
        let zero = self.index.zero();
        self.index += go;
        let next = Leg::read(waypoints, self.index, from, self.leg.course);
        self.leg = self.leg.select(holds(go), &next);
        for x in [&mut self.armed, &mut self.busy, &mut self.arrived, &mut self.clock, &mut self.swept] {
            *x = pick(go, zero, *x);
        }
        self.round = pick(go, zero, self.round);
        self.closest = pick(go, zero.splat(FAR), self.closest);
    }
}
