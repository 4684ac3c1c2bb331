//! Limits of what is asked: no jump reaches the control loops.
//!
//! Speeds keep to a largest value and rate, the heading turns the shorter way at no more than a largest rate, pitch
//! keeps to a largest angle and rate, and the desired depth to a largest rate. All start from what is measured.
//! Tests: `law_limits_hold_at_every_step` in `tests/guidance.rs`.

use super::constants::Guidance;
use super::fix::Fix;
use super::flag::{below, not, pick};
use super::law::Aim;
use super::progress::Progress;
use crate::number::real::Real;

/// From a value towards another by no more than `most`.
#[inline(always)]
pub fn towards<T: Real>(from: T, to: T, most: T) -> T {
    from + (to - from).clamped(-most, most)
}

/// Moves the desired values in `progress` towards the aim.
#[inline(always)]
pub fn apply<T: Real>(
    guidance: &Guidance<T>,
    progress: &mut Progress<T>,
    aim: &Aim<T>,
    fix: &Fix<T>,
    dt: f64,
) {
    let fastest = guidance.speed_max;
    let change = guidance.acceleration_max * dt;
    progress.speed = towards(progress.speed, aim.speed.clamped(-fastest, fastest), change);
    let lateral = towards(progress.lateral, aim.lateral.clamped(-fastest, fastest), change);
    progress.lateral = pick(progress.was_holding, lateral, fix.velocity[1]);

    let turn = guidance.turn_rate_max * dt;
    let off = (aim.heading - progress.heading).wrap();
    progress.heading = (progress.heading + off.clamped(-turn, turn)).wrap();

    let pitch = aim.pitch.clamped(-guidance.pitch_max, guidance.pitch_max);
    progress.pitch = towards(progress.pitch, pitch, guidance.pitch_rate_max * dt);
    progress.depth = towards(progress.depth, aim.depth, guidance.depth_rate_max * dt);
}

/// Angle by which a limited value trails what is asked before an integral stops, rad: noise of the fix moves the aim
/// by less, a turn by more.
const TRAIL: f64 = 0.05;

/// 1 where the limited heading follows the one that is asked for.
#[inline(always)]
pub fn heading_follows<T: Real>(progress: &Progress<T>, heading: T) -> T {
    below((heading - progress.heading).wrap().abs(), heading.splat(TRAIL))
}

/// 1 where the limited pitch follows the one that is asked for.
#[inline(always)]
pub fn pitch_follows<T: Real>(progress: &Progress<T>, pitch: T) -> T {
    not(below(pitch.splat(TRAIL), (pitch - progress.pitch).abs()))
}
