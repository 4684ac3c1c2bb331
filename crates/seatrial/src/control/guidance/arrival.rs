//! When a waypoint is reached, and what happens there.
//!
//! A leg ends when the vehicle enters the sphere of acceptance, `|p_k − p| ≤ R_0` (Taubert et al. 2014, equation 53),
//! or passes the vertical plane through the waypoint across the course. Only a vehicle that has been before this
//! plane on this leg can pass it; one that was beyond from the beginning goes back to the waypoint. Passing counts at
//! any cross-track distance, since nobody should turn round for a missed point; [`Progress::farthest_miss`] tells how
//! far off it was.
//!
//! The turn at a waypoint that is passed begins before it ([`turn`](super::turn)): the leg ends there too, and the smallest
//! distance to the waypoint goes on counting on the next leg.
//!
//! | task | busy at the point from | ends |
//! |---|---|---|
//! | pass | never, or on a leg steeper than `pitch_max` from its plane on | at the sphere or plane; after a steep leg when the depth is within `R_0` |
//! | hold | `hold_radius`, or the plane | when the clock, which starts within `R_0` or `hold_radius`, has run off |
//! | circle | two lookahead distances outside the circle, or the plane | when the angle is swept, counted from within `R_0` or R/4 of the circle, at its depth |
//!
//! A vehicle that cannot stop circles the point instead of holding it. After the last waypoint the mission is
//! complete, and the vehicle holds or circles it.
//!
//! Tests: `law_switching_…`, `law_hold_…`, `law_circle_…`, `law_steep_…` in `tests/guidance.rs`.

use super::constants::Guidance;
use super::fix::Fix;
use super::flag::{below, holds, not, pick};
use super::leg::Place;
use super::progress::Progress;
use super::turn;
use crate::mission::Waypoint;
use crate::number::real::Real;

/// What the vehicle does at its waypoint. Flags are 0 or 1.
#[derive(Clone, Copy, Debug)]
pub struct Work<T> {
    /// It circles the waypoint.
    pub circling: T,
    /// It keeps station there.
    pub holding: T,
    /// The waypoint has a circle of its own.
    ring: T,
    /// Radius of the circle, m.
    pub radius: T,
    /// 1 clockwise, −1 counter-clockwise.
    pub sense: T,
}

impl<T: Real> Work<T> {
    /// The work at the present state.
    #[inline(always)]
    pub fn new(guidance: &Guidance<T>, progress: &Progress<T>) -> Self {
        let leg = &progress.leg;
        let zero = leg.circle.zero();
        let own = leg.circle * not(progress.done);
        let circling = progress.busy * if guidance.hover { own } else { zero.splat(1.0) };
        Self {
            circling,
            holding: progress.busy - circling,
            ring: own.max(circling),
            radius: pick(leg.circle, leg.radius, guidance.loiter_radius),
            sense: leg.sense,
        }
    }

    /// Distance to the waypoint, or to its circle, m.
    #[inline(always)]
    pub fn miss(&self, place: &Place<T>) -> T {
        let level = pick(self.ring, place.range - self.radius, place.range);
        level.mul_add(level, place.below * place.below).sqrt()
    }
}

/// Brings the state of the mission up to date with a fix.
#[inline(always)]
pub fn update<T: Real>(
    guidance: &Guidance<T>,
    waypoints: &[Waypoint],
    progress: &mut Progress<T>,
    fix: &Fix<T>,
    dt: f64,
) {
    let place = progress.leg.place(fix, progress.terrain);
    let before = below(place.along, place.along.zero());
    let passed = (progress.armed * not(before)).max(progress.leg.upright);
    progress.armed = progress.armed.max(before);

    let work = Work::new(guidance, progress);
    let miss = work.miss(&place);
    progress.closest = progress.closest.min(miss);
    let from_passing = |i: usize| fix.position[i] - progress.passing[i];
    let (x, y, z) = (from_passing(0), from_passing(1), from_passing(2));
    let behind = x.mul_add(x, y.mul_add(y, z * z)).sqrt();
    progress.passed_by = progress.passed_by.min(behind);
    let at_once = pass(guidance, progress, &place, passed, miss);
    begin_work(guidance, progress, &work, &place, (passed, at_once));
    let work = Work::new(guidance, progress);
    let ended = count(guidance, progress, &work, &place, dt);

    let complete = at_once.max(ended) * not(progress.done);
    if T::any(holds(complete)) {
        finish(guidance, waypoints, progress, (fix, &work), complete);
    }
}

/// 1 where a waypoint without a task is done with on the way.
#[inline(always)]
fn pass<T: Real>(guidance: &Guidance<T>, progress: &Progress<T>, place: &Place<T>, passed: T, miss: T) -> T {
    let leg = &progress.leg;
    let plain = not(leg.hold.max(leg.circle));
    let deep_enough = not(below(leg.acceptance, place.below.abs()));
    let inside = not(below(leg.acceptance, miss));
    let steep = below(guidance.pitch_max, leg.slope.abs()).max(leg.upright);
    let turns = turn::begins(guidance, leg, place) * progress.armed * not(steep);
    plain * inside.max(turns).max(passed * not(steep)).max(progress.busy.max(passed) * deep_enough)
}

/// Marks the vehicle busy where it has come to its work.
#[inline(always)]
fn begin_work<T: Real>(
    guidance: &Guidance<T>,
    progress: &mut Progress<T>,
    work: &Work<T>,
    place: &Place<T>,
    (passed, at_once): (T, T),
) {
    let leg = &progress.leg;
    let capture = guidance.lookahead.mul_add(guidance.lookahead.splat(2.0), work.radius);
    let near_circle = below(place.range, capture);
    let near_point = below(place.range, guidance.hold_radius);
    let near_hold = if guidance.hover { near_point } else { near_circle };
    let near = (leg.hold * near_hold).max(leg.circle * near_circle);
    let begins = near.max(passed * not(at_once)) * not(progress.busy);
    if T::any(holds(begins)) {
        let zero = begins.zero();
        progress.busy = progress.busy.max(begins);
        progress.arrived = pick(begins, zero, progress.arrived);
        progress.clock = pick(begins, zero, progress.clock);
        progress.swept = pick(begins, zero, progress.swept);
        progress.round = pick(begins, zero, progress.round);
        progress.bearing = pick(begins, place.bearing(), progress.bearing);
    }
}

/// Runs the clock and counts the turns; 1 where the task at the waypoint is done.
#[inline(always)]
fn count<T: Real>(
    guidance: &Guidance<T>,
    progress: &mut Progress<T>,
    work: &Work<T>,
    place: &Place<T>,
    dt: f64,
) -> T {
    let leg = &progress.leg;
    if !T::any(holds(progress.busy)) {
        return progress.busy.zero();
    }
    let at_depth = not(below(leg.acceptance, place.below.abs()));
    let band = leg.acceptance.max(work.radius * 0.25);
    let on_circle = not(below(band, (place.range - work.radius).abs())) * at_depth;
    let at_point = not(below(leg.acceptance.max(guidance.hold_radius), work.miss(place)));
    let here = pick(work.circling, on_circle, at_point) * progress.busy;
    progress.arrived = progress.arrived.max(here);
    progress.clock += progress.arrived * dt;

    let bearing = pick(work.circling, place.bearing(), progress.bearing);
    let swept = (bearing - progress.bearing).wrap() * work.sense;
    progress.swept = progress.arrived.mul_add(swept, progress.swept);
    progress.bearing = bearing;

    let waited = leg.hold * not(below(progress.clock, leg.seconds));
    let rounded = leg.circle * not(below(progress.swept, leg.sweep));
    waited.max(rounded) * progress.arrived
}

/// Goes on to the next waypoint, or completes the mission at the last.
#[inline(always)]
fn finish<T: Real>(
    guidance: &Guidance<T>,
    waypoints: &[Waypoint],
    progress: &mut Progress<T>,
    (fix, work): (&Fix<T>, &Work<T>),
    complete: T,
) {
    let last = not(below(progress.index, progress.index.splat(waypoints.len() as f64 - 1.0)));
    progress.farthest = pick(complete, progress.farthest.max(progress.passed_by), progress.farthest);
    // What was busy at its waypoint has been there; a turn may bring the vehicle nearer to one that it passes.
    let passes = not(progress.leg.hold.max(progress.leg.circle));
    progress.farthest =
        pick(complete * not(passes), progress.farthest.max(progress.closest), progress.farthest);
    progress.passed_by = pick(complete, progress.closest * passes, progress.passed_by);
    let place = progress.leg.place(fix, progress.terrain);
    let behind = [progress.leg.end[0], progress.leg.end[1], place.target];
    for (to, from) in progress.passing.iter_mut().zip(behind) {
        *to = pick(complete, from, *to);
    }
    progress.setting_off = pick(complete, work.holding, progress.setting_off);
    turn::lay(guidance, progress, &place, complete * passes);
    let ends = complete * last;
    progress.done = progress.done.max(ends);
    progress.busy = progress.busy.max(ends);
    let go = complete * not(last);
    if T::any(holds(go)) {
        let end = progress.leg.end;
        // Whoever circles is not at the point, and the next line begins where the circle is left.
        let from = [
            pick(work.circling, fix.position[0], end[0]),
            pick(work.circling, fix.position[1], end[1]),
            pick(progress.leg.terrain, progress.depth, end[2]),
        ];
        progress.advance(waypoints, go, &from);
    }
}
