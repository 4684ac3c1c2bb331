//! The straight legs of a mission as the figures of a flight see them: read once, looked up every period.
//!
//! Tests: `tests/closed_loop.rs`, `tests/flight/test_fly.py` (figures equal to those from the log).

use crate::mission::{Mission, Task, Vertical};
use crate::number::plain;
use crate::number::real::Real;

/// The way to one waypoint.
#[derive(Clone, Debug)]
struct Leg {
    /// Where it begins, north and east, m.
    from: [f64; 2],
    /// Cosine and sine of its course.
    course: [f64; 2],
    /// Half its horizontal length, m; 0 for the way to a circle, which has no straight end.
    half_length: f64,
    /// Smaller and larger depth of its two ends, m; without bounds where it follows the bottom.
    band: [f64; 2],
    /// The same with the depths of the leg before: a turn begins before its waypoint, on the way to its depth.
    entry: [f64; 2],
}

/// All of them.
#[derive(Clone, Debug)]
pub(super) struct Legs(Vec<Leg>);

impl Legs {
    /// Those of a mission.
    pub fn of(mission: &Mission) -> Self {
        let waypoints = &mission.waypoints;
        let band = |i: usize| {
            let (before, to) = (i.checked_sub(1).map(|i| &waypoints[i]), &waypoints[i]);
            let from = before.map_or(mission.start.position, |w| w.position);
            if [before, Some(to)].into_iter().flatten().any(|w| w.vertical == Vertical::Altitude) {
                return [f64::NEG_INFINITY, f64::INFINITY];
            }
            [from[2].min(to.position[2]), from[2].max(to.position[2])]
        };
        let leg = |i: usize| {
            let (before, waypoint) = (i.checked_sub(1).map(|i| &waypoints[i]), &waypoints[i]);
            let from = before.map_or(mission.start.position, |w| w.position);
            let to = waypoint.position;
            let (north, east) = (to[0] - from[0], to[1] - from[1]);
            let length = plain::hypot(north, east);
            let (own, last) = (band(i), band(i.saturating_sub(1)));
            Leg {
                from: [from[0], from[1]],
                course: [north, east].map(|x| x / length.max(f64::MIN_POSITIVE)),
                half_length: if matches!(waypoint.task, Task::Circle { .. }) { 0.0 } else { 0.5 * length },
                band: own,
                entry: [own[0].min(last[0]), own[1].max(last[1])],
            }
        };
        Self((0..waypoints.len()).map(leg).collect())
    }

    #[inline(always)]
    fn read<T: Real>(&self, index: T, number: impl Fn(&Leg) -> f64) -> T {
        let last = self.0.len() - 1;
        index.tabulated(|i| (number(&self.0[(i.max(0.0) as usize).min(last)]), 0.0))
    }

    /// Where the vehicle, so far from the waypoint, is on the second half of a straight leg.
    #[inline(always)]
    pub fn settled<T: Real>(&self, index: T, distance: T) -> T::Mask {
        distance.lt(self.read(index, |leg| leg.half_length))
    }

    /// How far a place (north, east, depth, m) lies above or below the band of the leg, m. Behind the leg's start,
    /// where the vehicle still turns onto it, the depths of the leg before count too.
    #[inline(always)]
    pub fn excursion<T: Real>(&self, index: T, [x, y, depth]: [T; 3]) -> T {
        let north = x - self.read(index, |leg| leg.from[0]);
        let east = y - self.read(index, |leg| leg.from[1]);
        let (cosine, sine) = (self.read(index, |leg| leg.course[0]), self.read(index, |leg| leg.course[1]));
        let turning = (north * cosine + east * sine).lt(depth.zero());
        let mut band = [depth; 2];
        for k in 0..2 {
            let (own, entry) = (self.read(index, |leg| leg.band[k]), self.read(index, |leg| leg.entry[k]));
            band[k] = T::select(turning, entry, own);
        }
        (depth - band[1]).max(band[0] - depth).max(depth.zero())
    }

    /// Cross-track error of a place (north, east, m) against the straight leg, m, positive to starboard.
    #[inline(always)]
    pub fn across<T: Real>(&self, index: T, [x, y]: [T; 2]) -> T {
        let north = x - self.read(index, |leg| leg.from[0]);
        let east = y - self.read(index, |leg| leg.from[1]);
        let (cosine, sine) = (self.read(index, |leg| leg.course[0]), self.read(index, |leg| leg.course[1]));
        east.mul_sub(cosine, north * sine)
    }
}
