//! From the errors against a path to heading, pitch and speed.
//!
//! | method | heading | pitch |
//! |---|---|---|
//! | pursuit | `atan2(y_k − y, x_k − x)` | `atan2(−(z_k − z), hypot(x_k − x, y_k − y))` |
//! | lookahead | `π_p − atan(y_e/Δ)` | `γ_p + atan(z_e/Δ_z)` |
//! | integral | `π_p − atan((y_e + κ y_int)/Δ)` | `γ_p + atan((z_e + κ_z z_int)/Δ_z)` |
//!
//! `z_e` is positive below the path, so that it raises the bow: the sign is opposite to that of the heading. Pursuit
//! knows no circle, no bottom and no depth that is set by hand; there it is lookahead. A vehicle that has never been before the plane through its
//! waypoint goes straight to it. Towards a point that it will hold it slows down, `u_d = min(U, k r, √(a r))`, the
//! root for a braking at half the largest rate of the speed.
//!
//! Source: Taubert et al. (2014), equations 51 and 52, (51) corrected; Fossen (2011), section 10.3; Børhaug, Pavlov
//! and Pettersen (2008), equations 8 and 9.
//! Tests: `law_pursuit_…`, `law_lookahead_…`, `law_integral_…` in `tests/guidance.rs`.

use super::constants::Guidance;
use super::fix::Fix;
use super::flag::{not, pick};
use super::leg::Place;
use super::path::Path;
use super::progress::Progress;
use super::table::Method;
use crate::number::real::Real;

/// How much the crab angle's tangent grows at most on the way to a station.
const MOST_CRAB: f64 = 4.0;

/// What is asked for before any limit.
#[derive(Clone, Copy, Debug)]
pub struct Aim<T> {
    /// Surge speed, m/s.
    pub speed: T,
    /// Sway speed, m/s.
    pub lateral: T,
    /// Heading, rad, not wrapped.
    pub heading: T,
    /// Pitch, rad.
    pub pitch: T,
    /// Depth, m.
    pub depth: T,
}

impl<T: Real> Aim<T> {
    /// `other` where the mask holds, this aim elsewhere.
    #[inline(always)]
    pub fn select(&self, mask: T::Mask, other: &Self) -> Self {
        let f = |mine: T, others: T| T::select(mask, others, mine);
        Self {
            speed: f(self.speed, other.speed),
            lateral: f(self.lateral, other.lateral),
            heading: f(self.heading, other.heading),
            pitch: f(self.pitch, other.pitch),
            depth: f(self.depth, other.depth),
        }
    }
}

/// Heading, pitch, depth and speed along a path.
#[inline(always)]
pub fn follow<T: Real>(
    guidance: &Guidance<T>,
    progress: &Progress<T>,
    path: &Path<T>,
    place: &Place<T>,
    fix: &Fix<T>,
) -> Aim<T> {
    let zero = path.cross.zero();
    let (learnt, learnt_vertical) = offsets(guidance, progress, path);
    let slow = progress.leg.hold * not(progress.busy) * zero.splat(if guidance.hover { 1.0 } else { 0.0 });
    let braking = (guidance.acceleration_max * place.range).sqrt();
    let full = progress.leg.speed;
    let speed = pick(slow, full.min(braking).min(guidance.hold_gain * place.range), full);
    // The slower, the farther the bow must turn into the current to keep to the line.
    let crab = if guidance.sway {
        zero.splat(1.0)
    } else {
        (full / speed.max(zero.splat(1e-9))).min(zero.splat(MOST_CRAB))
    };
    let lookahead = path.course - learnt.mul_add(crab, path.cross).atan2(guidance.lookahead);
    let pitch = path.slope + (path.vertical + learnt_vertical).atan2(guidance.lookahead_vertical);

    let pursuit = zero.splat(if guidance.method == Method::Pursuit { 1.0 } else { 0.0 }) * not(path.circling);
    let direct = pursuit.max(path.direct * not(progress.armed));
    let bearing = place.to_end[1].atan2(place.to_end[0]);
    let heading = pick(direct, bearing, lookahead);
    let to_point = pursuit * not(progress.leg.terrain.max(path.set));
    let share = pick(progress.setting_off, zero, guidance.turn_speed_share);
    Aim {
        speed: speed * left_in_turn(share, heading - fix.attitude[2]),
        lateral: zero,
        heading,
        pitch: pick(to_point, place.below.atan2(place.range), pitch),
        depth: path.depth,
    }
}

/// `κ y_int` and `κ_z z_int`, m; zero without integral.
#[inline(always)]
pub fn offsets<T: Real>(guidance: &Guidance<T>, progress: &Progress<T>, path: &Path<T>) -> (T, T) {
    let zero = path.cross.zero();
    if guidance.method != Method::Integral {
        return (zero, zero);
    }
    let [north, east] = path.starboard;
    let drift = progress.drift[0].mul_add(north, progress.drift[1] * east);
    let lateral = path.circling.mul_add(progress.round, drift);
    (guidance.integral_gain * lateral, guidance.integral_gain_vertical * progress.heave)
}

/// The share of the speed that is left at a heading error: 1 without, falling with the square of its cosine to
/// `share` at a right angle.
#[inline(always)]
fn left_in_turn<T: Real>(share: T, error: T) -> T {
    let one = share.splat(1.0);
    if share.equals(one) {
        return one;
    }
    let ahead = error.sin_cos().1.max(one.zero());
    (ahead * ahead).mul_add(one - share, share)
}
