//! What the integral of the line of sight learns.
//!
//! `y_int' = Δ y_e / ((y_e + κ y_int)² + Δ²)`, in the vertical plane alike. In the steady state `y_e = 0` and
//! `κ y_int/Δ` is the tangent of the crab angle: the integral is the cross-component of the current in disguise.
//!
//! **A change of course.** A current keeps its direction over the bottom when the vehicle turns, so the integral is
//! kept as a vector in n, `y_int = I · n` with n to starboard of the path and `I' = n y_int'`. After a turn of 180°
//! the crab angle thereby changes its side, after one of 90° it is what an earlier leg of that course has learnt (at
//! first nothing), and on a circle both components are learnt. An offset that turns with the vehicle (a compass, a
//! lag on a circle) does not fit this; on a circle a second, scalar integral learns it, on lines it is learnt anew.
//! The vertical integral (trim, buoyancy, an upwelling) is independent of the course and stays. `I` is in proportion
//! to current over speed; after a change of speed the rest is learnt.
//!
//! **Wind-up.** Nothing is learnt on station, on the turn between two legs, beyond the end of a leg, while the heading is more than 60° off the
//! desired one, and while a limit of heading or pitch binds. The crab angle that is learnt stays within 45°, the
//! pitch within its limit.
//!
//! Source: Børhaug, Pavlov and Pettersen (2008), equation 9; Caharija et al. (2016), section III. The damping ratio
//! is `½ √(U/κ)`: κ = U/4 is critical.
//! Tests: `law_integral_…` in `tests/guidance.rs`.

use super::arrival::Work;
use super::constants::Guidance;
use super::fix::Fix;
use super::flag::{below, not};
use super::law::{Aim, offsets};
use super::limits::{heading_follows, pitch_follows};
use super::path::Path;
use super::progress::Progress;
use crate::number::real::Real;

/// Heading error beyond which nothing is learnt, rad.
const FAR_OFF: f64 = 60.0 * std::f64::consts::PI / 180.0;

/// Smallest length that a vector is divided by, s.
const TINY: f64 = 1e-12;

/// One step of the integrals; `aim` is what the path asked for before its limits.
#[inline(always)]
pub fn learn<T: Real>(
    guidance: &Guidance<T>,
    progress: &mut Progress<T>,
    path: &Path<T>,
    aim: &Aim<T>,
    (fix, work, dt): (&Fix<T>, &Work<T>, f64),
) {
    let (learnt, learnt_vertical) = offsets(guidance, progress, path);
    let under_way = not(work.holding) * not(path.direct) * not(progress.turn.under_way);

    let off = (aim.heading - fix.attitude[2]).wrap().abs();
    let free = under_way * below(off, off.splat(FAR_OFF)) * heading_follows(progress, aim.heading);
    let step = rate(path.cross, learnt, guidance.lookahead) * free * dt;
    for i in 0..2 {
        progress.drift[i] = path.starboard[i].mul_add(step, progress.drift[i]);
    }
    let length = progress.drift[0].mul_add(progress.drift[0], progress.drift[1] * progress.drift[1]).sqrt();
    let longest = guidance.lookahead / guidance.integral_gain;
    let scale = (longest / length.max(length.splat(TINY))).min(length.splat(1.0));
    progress.drift = [progress.drift[0] * scale, progress.drift[1] * scale];
    progress.round = path.circling.mul_add(step, progress.round).clamped(-longest, longest);

    let free = under_way * pitch_follows(progress, aim.pitch);
    let step = rate(path.vertical, learnt_vertical, guidance.lookahead_vertical) * free * dt;
    let (sine, cosine) = guidance.pitch_max.sin_cos();
    let longest = guidance.lookahead_vertical * sine / (cosine * guidance.integral_gain_vertical);
    progress.heave = (progress.heave + step).clamped(-longest, longest);
}

/// `Δ e / ((e + κ ∫)² + Δ²)`.
#[inline(always)]
fn rate<T: Real>(error: T, learnt: T, lookahead: T) -> T {
    let sum = error + learnt;
    lookahead * error / sum.mul_add(sum, lookahead * lookahead)
}
