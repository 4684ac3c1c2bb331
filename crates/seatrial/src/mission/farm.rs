//! The way round a fish farm, everywhere at least a distance d away from it.
//!
//! The way is a convex polygon about the curve at distance d: its sides touch that curve, so that the chords keep the
//! distance too. A circle of radius R = r + d takes n sides with corners at `R/cos(π/n)`. A corner of the farm that
//! turns by α takes k corners at `d/cos(α/2k)` from it, k = 1 being the mitre; n and k are the smallest that
//! keep the excess `R (1/cos − 1)` within the tolerance.
//!
//! Source: the mission of Taubert et al. (2014), introduction; offset curves, e.g. Farouki and Neff, *Analytic properties
//! of plane offset curves*, CAGD 7 (1990).
//! Tests: `tests/mission/perimeter.rs` (distance on the chords, excess, direction, stops).

use super::plane::{
    Place, between, cross, difference, distance, distance_of_stretches, distance_to_stretch, towards,
};
use crate::number::plain;
use crate::number::real::Real;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// What stands in the water.
#[derive(Clone, Debug, PartialEq)]
pub enum Farm {
    /// A net cage.
    Circle {
        /// Its centre.
        centre: Place,
        /// Its radius, m.
        radius: f64,
    },
    /// Several cages: a convex polygon, corners clockwise seen from above.
    Polygon(Vec<Place>),
}

/// A way round.
#[derive(Clone, Copy, Debug)]
pub struct Round {
    /// Smallest distance from the farm, m.
    pub distance: f64,
    /// Largest excess over it, m.
    pub tolerance: f64,
    /// Bearing from the farm's centre to the beginning, rad.
    pub bearing: f64,
    /// 1 with the farm to starboard (clockwise), −1 with the farm to port.
    pub side: f64,
    /// Stops on the way.
    pub stops: u32,
}

/// A point of a way round.
#[derive(Clone, Copy, Debug)]
pub struct RoundPoint {
    /// Where.
    pub place: Place,
    /// Share of the round behind it, 0 to below 1.
    pub share: f64,
    /// Number of the stop, from 1.
    pub stop: Option<usize>,
}

impl Farm {
    /// A farm of convex corners, or what is wrong with them.
    pub fn polygon(corners: &[Place]) -> Result<Self, String> {
        let mut corners = corners.to_vec();
        if corners.len() < 3 {
            return Err(format!("expected at least three corners, found {}", corners.len()));
        }
        let doubled: f64 = (0..corners.len())
            .map(|i| {
                cross(
                    difference(corners[0], corners[i]),
                    difference(corners[0], corners[(i + 1) % corners.len()]),
                )
            })
            .sum();
        let turn = |i: usize| {
            let [before, here, after] = [corners.len() - 1, 0, 1].map(|k| corners[(i + k) % corners.len()]);
            let [a, b] = [difference(before, here), difference(here, after)];
            plain::atan2(cross(a, b) * doubled.signum(), a[0] * b[0] + a[1] * b[1])
        };
        for i in 0..corners.len() {
            if distance(corners[i], corners[(i + 1) % corners.len()]) < 1e-6 {
                return Err(format!("corners {} and {} are the same", i + 1, 1 + (i + 1) % corners.len()));
            }
            // A turn by half a circle is a spike; less than zero is a dent.
            if !(-1e-9..PI - 1e-6).contains(&turn(i)) {
                let along = difference(corners[0], corners[1]);
                let beside = |corner: &Place| cross(along, difference(corners[0], *corner)).abs();
                if corners.iter().all(|corner| beside(corner) <= 1e-6 * plain::hypot(along[0], along[1])) {
                    return Err("expected corners that enclose an area, but all lie on one line".into());
                }
                return Err(format!(
                    "expected a convex polygon, but corner {} turns inwards; leave the corner out, or give several convex parts",
                    i + 1
                ));
            }
        }
        if (0..corners.len()).map(turn).sum::<f64>() > 1.5 * TAU {
            return Err(
                "expected a convex polygon, but the corners go round more than once; give them in order"
                    .into(),
            );
        }
        if doubled < 0.0 {
            corners.reverse();
        }
        Ok(Self::Polygon(corners))
    }

    /// Centre of the circle, centroid of the area of the polygon.
    pub fn centre(&self) -> Place {
        match self {
            Self::Circle { centre, .. } => *centre,
            Self::Polygon(corners) => {
                let mut sum = [0.0; 3];
                for i in 0..corners.len() {
                    let [a, b] =
                        [corners[i], corners[(i + 1) % corners.len()]].map(|c| difference(corners[0], c));
                    let area = cross(a, b);
                    sum = [sum[0] + area * (a[0] + b[0]), sum[1] + area * (a[1] + b[1]), sum[2] + 3.0 * area];
                }
                [corners[0][0] + sum[0] / sum[2], corners[0][1] + sum[1] / sum[2]]
            }
        }
    }

    /// Distance of the stretch between two places from the farm, m; 0 where it touches or enters.
    pub fn distance(&self, from: Place, to: Place) -> f64 {
        match self {
            Self::Circle { centre, radius } => (distance_to_stretch(*centre, from, to) - radius).max(0.0),
            Self::Polygon(corners) if super::fence::inside(corners, from) => 0.0,
            Self::Polygon(corners) => (0..corners.len())
                .map(|i| distance_of_stretches([from, to], [corners[i], corners[(i + 1) % corners.len()]]))
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// The corners of the way round, clockwise; none when there are more than `most`.
    fn corners_of_way(&self, round: &Round, most: usize) -> Option<Vec<Place>> {
        // How many parts of `angle` keep the excess of a polygon about a circle of this radius.
        let parts = |angle: f64, radius: f64| {
            let half = plain::acos(radius / (radius + round.tolerance));
            let parts = (angle / (2.0 * half) - 1e-9).ceil().max(1.0);
            (parts < most as f64).then_some(parts as usize)
        };
        match self {
            Self::Circle { centre, radius } => {
                let radius = radius + round.distance;
                let stops = (round.stops as usize).max(1);
                let n = parts(TAU, radius)?.max(4).next_multiple_of(stops);
                let corner = |i| {
                    towards(
                        *centre,
                        round.bearing + TAU * i as f64 / n as f64,
                        radius / plain::cos(PI / n as f64),
                    )
                };
                (n < most).then(|| (0..n).map(corner).collect())
            }
            Self::Polygon(corners) => {
                let mut way = Vec::new();
                for i in 0..corners.len() {
                    let [before, here, after] =
                        [corners.len() - 1, 0, 1].map(|k| corners[(i + k) % corners.len()]);
                    let [first, second] =
                        [difference(before, here), difference(here, after)].map(|d| plain::atan2(d[1], d[0]));
                    let turn = (second - first).wrap();
                    if turn < 1e-9 {
                        continue; // a place on a straight side
                    }
                    let k = parts(turn, round.distance)?;
                    let part = turn / k as f64;
                    way.extend((0..k).map(|j| {
                        // The farm lies to starboard, its outward normal to port.
                        let bearing = first - FRAC_PI_2 + (j as f64 + 0.5) * part;
                        towards(here, bearing, round.distance / plain::cos(0.5 * part))
                    }));
                }
                (way.len() < most).then_some(way)
            }
        }
    }

    /// The points of one round in the order of travel, from where it begins; it ends there again. None when there are
    /// more than `most`.
    ///
    /// Stops divide the length of the round equally, the first where it begins; one within the tolerance of a
    /// corner of the way is moved there, so that no leg is shorter than that. A further point at `1 − 1/max(stops, 4)`
    /// is where a change of depth may begin.
    pub fn round(&self, round: &Round, most: usize) -> Option<Vec<RoundPoint>> {
        let mut way = begin_at(self.corners_of_way(round, most)?, self.centre(), round);
        if round.side < 0.0 {
            way[1..].reverse();
        }
        let mut behind = vec![0.0];
        for i in 0..way.len() {
            behind.push(behind[i] + distance(way[i], way[(i + 1) % way.len()]));
        }
        let length = behind[way.len()];
        let mut points: Vec<RoundPoint> = (0..way.len())
            .map(|i| RoundPoint { place: way[i], share: behind[i] / length, stop: None })
            .collect();
        let stops = round.stops as usize;
        let marks = (0..stops).map(|j| (j as f64 / stops as f64, Some(j + 1)));
        for (share, stop) in marks.chain([(descent(round.stops), None)]) {
            let gap = |p: &RoundPoint| (p.share - share).abs() * length;
            let near = (0..points.len()).min_by(|a, b| gap(&points[*a]).total_cmp(&gap(&points[*b])))?;
            if gap(&points[near]) <= round.tolerance {
                points[near].stop = points[near].stop.or(stop);
                continue;
            }
            let next = points.partition_point(|p| p.share < share);
            let (a, b) =
                (points[next - 1], points.get(next).map_or((1.0, points[0].place), |p| (p.share, p.place)));
            let place = between(a.place, b.1, (share - a.share) / (b.0 - a.share));
            points.insert(next, RoundPoint { place, share, stop });
        }
        Some(points)
    }
}

/// The share of a round at which the way to another depth begins: at the last stop, or with fewer than four on the
/// last quarter.
pub fn descent(stops: u32) -> f64 {
    1.0 - 1.0 / f64::from(stops.max(4))
}

/// The convex way turned so that it begins where the ray from `centre` meets it, or at a corner within the tolerance.
fn begin_at(way: Vec<Place>, centre: Place, round: &Round) -> Vec<Place> {
    let ray = towards([0.0; 2], round.bearing, 1.0);
    let n = way.len();
    // The side whose first corner lies anticlockwise of the ray and whose second does not.
    let side = |i: usize| cross(ray, difference(centre, way[i]));
    let ahead = |i: usize| ray[0] * (way[i][0] - centre[0]) + ray[1] * (way[i][1] - centre[1]) > 0.0;
    let nearest = (0..n).filter(|&i| ahead(i)).min_by(|a, b| side(*a).abs().total_cmp(&side(*b).abs()));
    if let Some(i) = nearest.filter(|&i| side(i).abs() <= round.tolerance) {
        return (0..n).map(|k| way[(i + k) % n]).collect();
    }
    let i = (0..n).find(|&i| side(i) < 0.0 && side((i + 1) % n) > 0.0).unwrap_or(0);
    let (a, b) = (side(i), side((i + 1) % n));
    let first = between(way[i], way[(i + 1) % n], a / (a - b));
    std::iter::once(first).chain((1..=n).map(|k| way[(i + k) % n])).collect()
}
