//! Plane geometry of missions: places are north and east in m, bearings clockwise from north in rad.
//!
//! Tests: `tests/mission/patterns.rs` and `tests/mission/patterns.rs`, through the missions that use it.

use crate::number::plain;

/// North and east, m.
pub type Place = [f64; 2];

/// The place at `distance` (m) from `from` in the direction `bearing` (rad).
pub fn towards(from: Place, bearing: f64, distance: f64) -> Place {
    let (sine, cosine) = plain::sin_cos(bearing);
    [from[0] + distance * cosine, from[1] + distance * sine]
}

/// `to − from`.
pub fn difference(from: Place, to: Place) -> Place {
    [to[0] - from[0], to[1] - from[1]]
}

/// Distance between two places, m.
pub fn distance(a: Place, b: Place) -> f64 {
    let d = difference(a, b);
    plain::hypot(d[0], d[1])
}

/// `a × b`: positive where b lies clockwise of a, seen from above.
pub fn cross(a: Place, b: Place) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// The place on the way from `a` to `b`, 0 at `a` and 1 at `b`.
pub fn between(a: Place, b: Place, fraction: f64) -> Place {
    [a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1])]
}

/// Distance of a place from the stretch between `a` and `b`, m.
pub fn distance_to_stretch(place: Place, a: Place, b: Place) -> f64 {
    let (along, to) = (difference(a, b), difference(a, place));
    let square = along[0] * along[0] + along[1] * along[1];
    let fraction =
        if square > 0.0 { ((to[0] * along[0] + to[1] * along[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    distance(place, between(a, b, fraction))
}

/// Whether two stretches cross, each passing from one side of the other to its other side.
pub fn cross_each_other(a: [Place; 2], b: [Place; 2]) -> bool {
    let apart = |of: [Place; 2], other: [Place; 2]| {
        let along = difference(of[0], of[1]);
        cross(along, difference(of[0], other[0])) * cross(along, difference(of[0], other[1])) < 0.0
    };
    apart(a, b) && apart(b, a)
}

/// Smallest distance between two stretches, m.
pub fn distance_of_stretches(a: [Place; 2], b: [Place; 2]) -> f64 {
    if cross_each_other(a, b) {
        return 0.0;
    }
    let ends = [(a[0], b), (a[1], b), (b[0], a), (b[1], a)];
    ends.iter().map(|(place, of)| distance_to_stretch(*place, of[0], of[1])).fold(f64::INFINITY, f64::min)
}
