//! Inside or outside a fence: the crossing number of a polygon.
//!
//! A ray to the east of the place crosses the fence an odd number of times from inside. An edge counts from its lower
//! end in north to below its upper one, so that a corner is crossed once; a place on the fence itself may come out
//! as either.
//!
//! Source: Sunday, *Practical Geometry Algorithms* (2021), crossing number.
//! Tests: `tests/mission/fence.rs` (against the turning of the bearing round the fence; lanes agree).

use crate::number::real::Real;

/// 1 where the place (north, east, m) lies outside the fence, else 0; 0 without a fence, 1 for a place that is not a
/// number.
///
/// The corners are in order, north and east in m; the last joins the first.
#[inline(always)]
pub fn outside<T: Real>(fence: &[[f64; 2]], north: T, east: T) -> T {
    let (one, Some(last)) = (north.splat(1.0), fence.last()) else {
        return north.zero();
    };
    // −1 where the corner lies above the place in north, 1 elsewhere.
    let side = |corner: &[f64; 2]| T::select(north.lt(north.splat(corner[0])), -one, one);
    let (mut from, mut side_from, mut parity) = (last, side(last), one);
    for to in fence {
        let side_to = side(to);
        // A level edge has no slope, and both its ends on one side: it is not crossed whatever comes out here.
        let slope = (to[1] - from[1]) / (to[0] - from[0]);
        let crossing = (north - from[0]).mul_add(north.splat(slope), north.splat(from[1]));
        let crossed = T::both((side_from * side_to).lt(north.zero()), east.lt(crossing));
        parity = T::select(crossed, -parity, parity);
        (from, side_from) = (to, side_to);
    }
    (one + parity) * 0.5
}

/// Whether the place (north, east, m) lies inside the fence; always without a fence.
pub fn inside(fence: &[[f64; 2]], place: [f64; 2]) -> bool {
    outside(fence, place[0], place[1]) == 0.0
}
