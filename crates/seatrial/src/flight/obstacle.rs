//! How far the hull is from what stands in the water: net pens, piles.
//!
//! The hull is a capsule along the body's x axis: the line between bow and stern, as thick as the hull is wide. Obstacles
//! reach from the surface to the bottom, so that distances are horizontal. From a circle the distance of the line is exact;
//! from a convex polygon it is the smallest of bow, middle, stern and the polygon's corners against the line, exact but
//! for a hull that lies across a corner. Inside it is negative.
//!
//! Tests: `tests/flight/test_surroundings.py`.

use crate::description::Description;
use crate::mission::Obstacle;
use crate::mission::farm::Farm;
use crate::number::real::Real;

/// Half the length of the line in the hull, m, and the radius about it, m; zero without geometry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hull {
    /// From the middle to either end of the line.
    pub half_length: f64,
    /// Of the capsule.
    pub radius: f64,
}

impl Hull {
    /// That of a vehicle; a point where its file has no geometry.
    pub fn of(description: &Description) -> Self {
        description.file.geometry.as_ref().map_or(Self::default(), |g| {
            let radius = 0.5 * g.diameter_m;
            Self { half_length: (0.5 * g.length_m - radius).max(0.0), radius }
        })
    }
}

/// The line in the hull seen from above.
struct Line<T> {
    middle: [T; 2],
    /// From the middle to the bow.
    half: [T; 2],
    /// Its length.
    length: T,
}

impl<T: Real> Line<T> {
    /// Distance of a place from it, m.
    #[inline(always)]
    fn distance(&self, place: [f64; 2]) -> T {
        let [x, y] = [-self.middle[0] + place[0], -self.middle[1] + place[1]];
        let one = x.splat(1.0);
        let square = (self.length * self.length).max(x.splat(1e-12));
        let share = (x.mul_add(self.half[0], y * self.half[1]) / square).clamped(-one, one);
        let (a, b) = (x - share * self.half[0], y - share * self.half[1]);
        a.mul_add(a, b * b).sqrt()
    }
}

/// Distance of a place from a convex polygon, corners clockwise; inside it is negative.
#[inline(always)]
fn to_polygon<T: Real>(corners: &[[f64; 2]], [x, y]: [T; 2]) -> T {
    let mut outside = x.splat(f64::NEG_INFINITY);
    let mut nearest = x.splat(f64::INFINITY);
    let (zero, one) = (x.zero(), x.splat(1.0));
    for (i, from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % corners.len()];
        let along = [to[0] - from[0], to[1] - from[1]];
        let square = along[0] * along[0] + along[1] * along[1];
        let (a, b) = (x - from[0], y - from[1]);
        let share = ((a * along[0] + b * along[1]) * (1.0 / square)).clamped(zero, one);
        let (c, d) = (a - share * along[0], b - share * along[1]);
        nearest = nearest.min(c.mul_add(c, d * d));
        // To port of a clockwise side is outside.
        outside = outside.max((a * along[1] - b * along[0]) * (1.0 / square.sqrt()));
    }
    T::select(zero.lt(outside), nearest.sqrt(), outside)
}

/// Horizontal distances of the hull from the nearest obstacle, m, and beyond what the mission promises of each, the
/// smallest; negative inside, infinite without obstacles.
///
/// `truth` begins with position N E D, m, roll, pitch and yaw, rad.
#[inline(always)]
pub fn clearance<T: Real>(obstacles: &[Obstacle], hull: Hull, truth: &[T]) -> [T; 2] {
    let far = truth[0].splat(f64::INFINITY);
    if obstacles.is_empty() {
        return [far; 2];
    }
    let (sine, cosine) = truth[5].sin_cos();
    let length = truth[4].sin_cos().1.abs() * hull.half_length;
    let line = Line { middle: [truth[0], truth[1]], half: [cosine * length, sine * length], length };
    let mut found = [far; 2];
    for obstacle in obstacles {
        let distance = match &obstacle.shape {
            Farm::Circle { centre, radius } => line.distance(*centre) - *radius,
            Farm::Polygon(corners) => {
                let at = |share: f64| {
                    [0, 1].map(|i| line.half[i].mul_add(line.length.splat(share), line.middle[i]))
                };
                let mut nearest = far;
                for share in [-1.0, 0.0, 1.0] {
                    nearest = nearest.min(to_polygon(corners, at(share)));
                }
                let beside = corners.iter().fold(far, |least, corner| least.min(line.distance(*corner)));
                T::select(nearest.lt(nearest.zero()), nearest, nearest.min(beside))
            }
        };
        let distance = distance - hull.radius;
        found[0] = found[0].min(distance);
        if obstacle.distance > 0.0 {
            found[1] = found[1].min(distance - obstacle.distance);
        }
    }
    found
}
