//! Station-keeping: the point as a velocity, the heading as the vehicle can.
//!
//! The desired velocity is `k Rᵀ (p_hold − p)` in the horizontal plane, no faster than the leg.
//!
//! **With sway** the heading is the given one or, where none is given, the desired one at arrival; beyond the watch
//! radius, where the thrusters alone do not win, the bow turns to the point.
//!
//! **Without sway** only surge moves the vehicle; what it cannot do itself the current must do. Within the watch
//! radius the heading turns at the rate `k_w (k e_s − v)`, with the distance to starboard e_s (less a dead zone of a
//! quarter of the hold radius) and the measured sideways speed over ground v. In still water this turns the bow to
//! the point until it lies within the dead zone; without that zone the lags would let the vehicle creep round it. In
//! a current of speed V met at the angle δ, `v = V sin δ`, and the sideways distance obeys
//! `e'' + V k_w e' + V k_w k e = 0`: the vehicle settles with its bow in the current, damping ratio `½ √(V k_w/k)`.
//! The same law is unstable with the current from astern, so that it cannot stay there. A given heading pulls weakly,
//! for the point comes first: in still water the vehicle ends up to `0.05 s⁻¹/(k_w k)` metres per radian farther beside
//! it, in a current the bow stays near the current. Beyond the watch radius the bow turns to the point, which lies
//! up-current of whoever drifts, and only ahead is asked for.
//!
//! Tests: `law_hold_…` in `tests/guidance.rs`.

use super::constants::Guidance;
use super::fix::Fix;
use super::flag::{below, holds, pick};
use super::law::Aim;
use super::leg::Place;
use super::progress::Progress;
use crate::number::real::Real;

/// How fast a given heading is sought without sway, 1/s.
const PULL: f64 = 0.05;

/// Share of the hold radius within which a distance to starboard turns nothing.
const DEAD_ZONE: f64 = 0.25;

/// Smallest distance that a speed is divided by, m.
const TINY: f64 = 1e-9;

/// What keeps the station.
#[inline(always)]
pub fn keep<T: Real>(
    guidance: &Guidance<T>,
    progress: &Progress<T>,
    fix: &Fix<T>,
    place: &Place<T>,
    dt: f64,
) -> Aim<T> {
    let leg = &progress.leg;
    let zero = place.range.zero();
    let gain = guidance.hold_gain;
    let fastest = leg.speed;
    let [north, east] = place.to_end;
    let (sine, cosine) = fix.attitude[2].sin_cos();
    let ahead = gain * north.mul_add(cosine, east * sine);
    let starboard = gain * east.mul_sub(cosine, north * sine);
    let outside = below(guidance.watch_radius, place.range);

    let (speed, lateral, heading);
    if guidance.sway {
        let scale = (fastest / (gain * place.range).max(zero.splat(TINY))).min(zero.splat(1.0));
        (speed, lateral) = (ahead * scale, starboard * scale);
        heading = pick(leg.wished, leg.heading, progress.kept_heading);
    } else {
        let lowest = pick(outside, zero, -fastest);
        (speed, lateral) = (ahead.clamped(lowest, fastest), zero);
        let wish = leg.wished * (leg.heading - progress.heading).wrap() * PULL;
        let dead = gain * guidance.hold_radius * DEAD_ZONE;
        let aside = starboard - starboard.clamped(-dead, dead);
        let rate = guidance.weathervane_gain.mul_add(aside - fix.velocity[1], wish);
        heading = rate.mul_add(zero.splat(dt), progress.heading);
    }
    let heading = if T::any(holds(outside)) { pick(outside, east.atan2(north), heading) } else { heading };
    Aim { speed, lateral, heading, pitch: zero, depth: place.target }
}
