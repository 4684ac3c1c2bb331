//! Cylinders from the surface to the bottom that a vehicle must keep clear of: net cages, piles.
//!
//! Tests: `tests/closed_loop/flights.rs`.

use crate::number::real::Real;

/// A cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// North and east of its axis, m.
    pub centre: [f64; 2],
    /// Radius, m.
    pub radius: f64,
}

/// Horizontal distance of a place (north, east, m) to the nearest edge; negative inside, infinite without obstacles.
#[inline(always)]
pub fn clearance<T: Real>(obstacles: &[Obstacle], [x, y]: [T; 2]) -> T {
    let mut nearest = x.splat(f64::INFINITY);
    for obstacle in obstacles {
        let (north, east) = (x - obstacle.centre[0], y - obstacle.centre[1]);
        nearest = nearest.min(north.mul_add(north, east * east).sqrt() - obstacle.radius);
    }
    nearest
}
