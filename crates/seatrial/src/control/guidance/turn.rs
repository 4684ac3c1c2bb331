//! The turn from one leg to the next: a circle that touches both.
//!
//! With the change of course Δψ at a waypoint that is passed, a circle of radius R touches both legs `R tan(Δψ/2)` from
//! their corner and passes it at `R (1/cos(Δψ/2) − 1)`. R is that of the identified turning circle, or what the largest
//! rate of the heading allows, U/ω, if that is larger; at most what passes the waypoint within 0.7 of its radius
//! of acceptance and touches either leg in its nearer half. The leg ends `U τ` before the circle begins, τ being the
//! delay of the course, and the course that is asked for on the circle is that of the path `U τ` ahead. Thus the
//! vehicle's own way, not only its bow, is on the circle.
//!
//! Nothing is anticipated by pursuit, at the end of a leg steeper than the largest pitch, by a vehicle that is farther
//! than `R_0` from its leg or `R_0/2` from its depth, and without a turning circle in the table.
//!
//! Source: wheel-over point and circle of acceptance, Fossen (2011), section 10.3.
//! Tests: `law_turn_…` in `tests/guidance.rs`.

use super::arrival::Work;
use super::constants::Guidance;
use super::flag::{below, holds, not, pick};
use super::leg::{Leg, Place};
use super::path::Path;
use super::progress::Progress;
use super::table::Method;
use crate::number::real::Real;

/// Share of the radius of acceptance within which a turn passes its waypoint: a circle is not kept exactly.
const PASSING: f64 = 0.7;

/// Tangent above which a turn is one on the spot.
const SHARPEST: f64 = 1e3;

/// A turn under way.
#[derive(Clone, Copy, Debug)]
pub struct Turn<T> {
    /// 1 until the circle touches the next leg.
    pub under_way: T,
    /// Centre of the circle, north and east, m.
    centre: [T; 2],
    /// Its radius, m.
    radius: T,
    /// 1 to starboard, −1 to port.
    sense: T,
    /// How far from the corner it touches the legs, m.
    reach: T,
}

crate::memory!(Turn: under_way, centre, radius, sense, reach;);

impl<T: Real> Turn<T> {
    /// No turn.
    pub fn none(unit: T) -> Self {
        let zero = unit.zero();
        Self { under_way: zero, centre: [zero; 2], radius: zero, sense: zero, reach: zero }
    }
}

/// Tangent of half a change of course, positive to starboard, and the largest radius of its circle, m, between legs the
/// shorter of which has this length.
#[inline(always)]
pub fn corner<T: Real>(turn: T, acceptance: T, length: T) -> (T, T) {
    let (sine, cosine) = (turn * 0.5).sin_cos();
    let least = turn.splat(1.0 / SHARPEST);
    let bend = sine / cosine.max(least);
    let passing = acceptance * PASSING * cosine.max(least) / (cosine - 1.0).abs().max(least * least);
    (bend, passing.min(length * 0.5 / bend.abs().max(least)))
}

/// Radius of the turn at the end of a leg, m; 0 for none.
#[inline(always)]
fn radius<T: Real>(guidance: &Guidance<T>, leg: &Leg<T>) -> T {
    let zero = guidance.turn_radius.zero();
    if guidance.method == Method::Pursuit {
        return zero;
    }
    let radius = guidance.turn_radius.max(leg.speed / guidance.turn_rate_max).min(leg.widest);
    T::select(zero.lt(guidance.turn_radius), radius, zero)
}

/// 1 where the vehicle has come to where its turn is asked for.
#[inline(always)]
pub fn begins<T: Real>(guidance: &Guidance<T>, leg: &Leg<T>, place: &Place<T>) -> T {
    let radius = radius(guidance, leg);
    let before = radius.mul_add(leg.bend.abs(), leg.speed * guidance.turn_delay).min(leg.length);
    let near = below(place.cross.abs().max(place.below.abs() * 2.0), leg.acceptance);
    near * below(-before, place.along) * below(radius.zero(), radius)
}

/// Lays the circle at the end of a leg where `go` is 1: it begins one delay of the course ahead.
#[inline(always)]
pub fn lay<T: Real>(guidance: &Guidance<T>, progress: &mut Progress<T>, place: &Place<T>, go: T) {
    let leg = &progress.leg;
    let zero = go.zero();
    let reach = (-place.along - leg.speed * guidance.turn_delay).max(zero);
    let wanted = below(zero, radius(guidance, leg)) * below(zero.splat(SHORTEST), reach);
    let sharp = leg.bend.abs().max(zero.splat(1.0 / SHARPEST));
    let radius = reach / sharp;
    let sense = T::select(leg.bend.lt(zero), zero.splat(-1.0), zero.splat(1.0));
    let aside = sense * radius;
    let turn = Turn {
        under_way: wanted,
        centre: [
            leg.end[0] - reach * leg.cosine - aside * leg.sine,
            leg.end[1] - reach * leg.sine + aside * leg.cosine,
        ],
        radius,
        sense,
        reach,
    };
    let old = progress.turn;
    let f = |new: T, old: T| pick(go, new, old);
    progress.turn = Turn {
        under_way: f(turn.under_way, old.under_way),
        centre: [f(turn.centre[0], old.centre[0]), f(turn.centre[1], old.centre[1])],
        radius: f(turn.radius, old.radius),
        sense: f(turn.sense, old.sense),
        reach: f(turn.reach, old.reach),
    };
}

/// A circle that begins nearer to the corner than this is none, m.
const SHORTEST: f64 = 0.1;

/// The path at the vehicle: the circle until it touches the leg, then the leg.
#[inline(always)]
pub fn path<T: Real>(
    guidance: &Guidance<T>,
    progress: &mut Progress<T>,
    work: &Work<T>,
    (place, line): (&Place<T>, &Path<T>),
) -> Path<T> {
    let turn = &mut progress.turn;
    let leg = &progress.leg;
    let onto = below(place.along, turn.reach - leg.length);
    turn.under_way *= onto * not(work.holding.max(work.circling));
    if !T::any(holds(turn.under_way)) {
        return *line;
    }
    let zero = turn.radius.zero();
    // From the centre to the vehicle.
    let from_centre = |i: usize| leg.end[i] - place.to_end[i] - turn.centre[i];
    let (x, y) = (from_centre(0), from_centre(1));
    let range = x.mul_add(x, y * y).sqrt().max(zero.splat(1e-6));
    let ahead = leg.speed * guidance.turn_delay / turn.radius.max(zero.splat(SHORTEST));
    let course = y.atan2(x) + turn.sense * std::f64::consts::FRAC_PI_2;
    // What is left of the turn, positive in its sense; it ends on the leg's course.
    let left = ((leg.course - course).wrap() * turn.sense - ahead).max(zero);
    let circle = Path {
        course: leg.course - turn.sense * left,
        starboard: [-turn.sense * x / range, -turn.sense * y / range],
        cross: turn.sense * (turn.radius - range),
        ..*line
    };
    line.select(holds(turn.under_way), &circle)
}
