//! The circle round a waypoint.
//!
//! With the bearing φ of the vehicle from the centre and its horizontal distance r, the course is
//! `π_p = φ ± π/2` (plus clockwise, seen from above) and the cross-track error, positive to starboard,
//! `y_e = ±(R − r)`: a vehicle inside a clockwise circle is to starboard of it.
//!
//! Source: Fossen (2011), section 10.4.
//! Tests: `law_circle_…` in `tests/guidance.rs`.

use super::arrival::Work;
use super::leg::Place;
use super::path::Path;
use crate::number::real::Real;

/// Distance from the centre below which its bearing is left undefined, m.
const CENTRE: f64 = 1e-9;

/// The path at the vehicle.
#[inline(always)]
pub fn path<T: Real>(work: &Work<T>, place: &Place<T>) -> Path<T> {
    let zero = place.range.zero();
    let range = place.range.max(zero.splat(CENTRE));
    let quarter = work.sense * std::f64::consts::FRAC_PI_2;
    let inward = [place.to_end[0] / range, place.to_end[1] / range];
    Path {
        course: place.bearing() + quarter,
        starboard: [work.sense * inward[0], work.sense * inward[1]],
        cross: work.sense * (work.radius - place.range),
        slope: zero,
        vertical: place.below,
        depth: place.target,
        circling: zero.splat(1.0),
        direct: zero,
        set: zero,
    }
}
