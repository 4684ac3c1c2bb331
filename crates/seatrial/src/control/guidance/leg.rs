//! A leg: the straight line that ends at the active waypoint, and where the vehicle is against it.
//!
//! Course `π_p = atan2(ΔE, ΔN)` and slope `γ_p = atan2(−Δz, Δh)`, positive upwards. With the position relative to the
//! end of the leg, the way along it is `s = x cos π_p + y sin π_p` (negative before the end), the cross-track error
//! `y_e = −x sin π_p + y cos π_p` and the vertical error `z_e = (z − z_path) cos γ_p`, perpendicular to the path.
//! Beyond the ends of the leg the path is level.
//!
//! A leg of [`Vertical::Altitude`] follows the bottom: its desired depth is `z + altitude − wanted`, without bottom
//! lock the last desired depth; its slope is zero. A leg without horizontal extent keeps the course before it.
//!
//! Source: Fossen (2011), section 10.3; Taubert et al. (2014), equation 51, corrected (`docs/errata.md`).
//! Tests: `law_errors_are_those_of_a_point_put_beside_the_path`, `law_altitude_…` in `tests/guidance.rs`.

use super::fix::Fix;
use super::flag::{below, not, pick};
use super::path::Path;
use super::turn;
use crate::mission::{Task, Vertical, Waypoint};
use crate::number::algebra::Vec3;
use crate::number::plain;
use crate::number::real::Real;

/// Horizontal extent below which a leg has no course of its own, m.
const SHORTEST: f64 = 0.01;

/// No water is deeper, m: an altitude beyond is no measurement.
const DEEPEST: f64 = 12e3;

/// The active leg. Flags are 0 or 1.
#[derive(Clone, Copy, Debug)]
pub struct Leg<T> {
    /// North, east, depth or altitude of its end, m.
    pub end: Vec3<T>,
    /// The third of these is an altitude.
    pub terrain: T,
    /// Speed, m/s.
    pub speed: T,
    /// Radius of acceptance `R_0`, m.
    pub acceptance: T,
    /// Station is kept at its end.
    pub hold: T,
    /// For so long, s.
    pub seconds: T,
    /// At a given heading.
    pub wished: T,
    /// This one, rad.
    pub heading: T,
    /// Its end is circled.
    pub circle: T,
    /// At this radius, m.
    pub radius: T,
    /// 1 clockwise, −1 counter-clockwise.
    pub sense: T,
    /// Over this angle, rad.
    pub sweep: T,
    /// Course `π_p`, rad, and its sine and cosine.
    pub course: T,
    /// `sin π_p`.
    pub sine: T,
    /// `cos π_p`.
    pub cosine: T,
    /// Horizontal length, m.
    pub length: T,
    /// The leg has no horizontal extent.
    pub upright: T,
    /// Slope `γ_p`, rad, positive upwards.
    pub slope: T,
    /// Depth gained per metre of way.
    pub fall: T,
    /// Tangent of half the change of course at its end, positive to starboard.
    pub bend: T,
    /// Largest radius of the turn there, m; 0 where the vehicle does not turn on its way.
    pub widest: T,
}

/// The vehicle against its leg.
#[derive(Clone, Copy, Debug)]
pub struct Place<T> {
    /// From the vehicle to the end of the leg, north and east, m.
    pub to_end: [T; 2],
    /// Horizontal distance to the end, m.
    pub range: T,
    /// Way along the leg from its end, m: negative before it.
    pub along: T,
    /// Cross-track error, m.
    pub cross: T,
    /// Desired depth at the end, m.
    pub target: T,
    /// How far the vehicle is below that, m.
    pub below: T,
}

crate::memory!(Leg:
    end, terrain, speed, acceptance, hold, seconds, wished, heading, circle, radius, sense, sweep, course, sine, cosine,
    length, upright, slope, fall, bend, widest;);

impl<T: Real> Place<T> {
    /// Bearing of the vehicle from the end of the leg, of a circle φ from its centre, rad.
    #[inline(always)]
    pub fn bearing(&self) -> T {
        (-self.to_end[1]).atan2(-self.to_end[0])
    }
}

impl<T: Real> Leg<T> {
    /// The leg to `waypoints[index]` from a place, after a leg of another course. Rare, and long in lanes: kept out
    /// of the step.
    #[inline(never)]
    pub fn read(waypoints: &[Waypoint], index: T, from: &Vec3<T>, course_before: T) -> Self {
        let get = |f: fn(&Waypoint) -> f64| {
            index.listed(waypoints.len(), |i| (waypoints.get(i.max(0.0) as usize).map_or(0.0, f), 0.0))
        };
        let one_if = |f: fn(&Waypoint) -> bool| {
            index.listed(waypoints.len(), |i| {
                (waypoints.get(i.max(0.0) as usize).map_or(0.0, |w| f64::from(u8::from(f(w)))), 0.0)
            })
        };
        let end = [get(|w| w.position[0]), get(|w| w.position[1]), get(|w| w.position[2])];
        let terrain = one_if(|w| w.vertical == Vertical::Altitude);
        let [north, east, down] = [end[0] - from[0], end[1] - from[1], end[2] - from[2]];
        let length = north.mul_add(north, east * east).sqrt();
        let upright = below(length, length.splat(SHORTEST));
        let course = pick(upright, course_before, east.atan2(north));
        let (sine, cosine) = course.sin_cos();
        let level = terrain.max(upright);
        let zero = length.zero();
        let next =
            |i: usize| index.listed(waypoints.len(), |k| (after(waypoints, k.max(0.0) as usize)[i], 0.0));
        let acceptance = get(|w| w.acceptance);
        let (bend, widest) = turn::corner((next(0) - course).wrap(), acceptance, length.min(next(1)));
        Self {
            end,
            terrain,
            speed: get(|w| w.speed),
            acceptance,
            hold: one_if(|w| matches!(w.task, Task::Hold { .. })),
            seconds: get(|w| if let Task::Hold { seconds, .. } = w.task { seconds } else { 0.0 }),
            wished: one_if(|w| matches!(w.task, Task::Hold { heading: Some(_), .. })),
            heading: get(|w| if let Task::Hold { heading: Some(x), .. } = w.task { x } else { 0.0 }),
            circle: one_if(|w| matches!(w.task, Task::Circle { .. })),
            radius: get(|w| if let Task::Circle { radius, .. } = w.task { radius } else { 0.0 }),
            sense: get(|w| if let Task::Circle { clockwise: false, .. } = w.task { -1.0 } else { 1.0 }),
            sweep: get(|w| {
                if let Task::Circle { turns, .. } = w.task { turns * std::f64::consts::TAU } else { 0.0 }
            }),
            course,
            sine,
            cosine,
            length: pick(upright, zero, length),
            upright,
            slope: pick(level, zero, (-down).atan2(length)),
            fall: pick(level, zero, down / length),
            bend,
            widest,
        }
    }

    /// `other` where the mask holds, this leg elsewhere.
    #[inline(always)]
    pub fn select(&self, mask: T::Mask, other: &Self) -> Self {
        let f = |mine: T, others: T| T::select(mask, others, mine);
        let mut end = self.end;
        for i in 0..3 {
            end[i] = f(self.end[i], other.end[i]);
        }
        Self {
            end,
            terrain: f(self.terrain, other.terrain),
            speed: f(self.speed, other.speed),
            acceptance: f(self.acceptance, other.acceptance),
            hold: f(self.hold, other.hold),
            seconds: f(self.seconds, other.seconds),
            wished: f(self.wished, other.wished),
            heading: f(self.heading, other.heading),
            circle: f(self.circle, other.circle),
            radius: f(self.radius, other.radius),
            sense: f(self.sense, other.sense),
            sweep: f(self.sweep, other.sweep),
            course: f(self.course, other.course),
            sine: f(self.sine, other.sine),
            cosine: f(self.cosine, other.cosine),
            length: f(self.length, other.length),
            upright: f(self.upright, other.upright),
            slope: f(self.slope, other.slope),
            fall: f(self.fall, other.fall),
            bend: f(self.bend, other.bend),
            widest: f(self.widest, other.widest),
        }
    }

    /// Where the vehicle is against the leg; `depth` is the last desired one.
    #[inline(always)]
    pub fn place(&self, fix: &Fix<T>, depth: T) -> Place<T> {
        let [x, y] = [fix.position[0] - self.end[0], fix.position[1] - self.end[1]];
        let locked =
            below(fix.altitude, fix.altitude.splat(DEEPEST)) * below(fix.altitude.splat(-1.0), fix.altitude);
        let above_bottom = pick(locked, fix.position[2] + fix.altitude - self.end[2], depth);
        let target = pick(self.terrain, above_bottom, self.end[2]);
        Place {
            to_end: [-x, -y],
            range: x.mul_add(x, y * y).sqrt(),
            along: x.mul_add(self.cosine, y * self.sine),
            cross: y.mul_sub(self.cosine, x * self.sine),
            target,
            below: fix.position[2] - target,
        }
    }

    /// The straight path at the vehicle.
    #[inline(always)]
    pub fn path(&self, place: &Place<T>, fix: &Fix<T>) -> Path<T> {
        let zero = place.along.zero();
        // A leg often begins exactly at the vehicle: rounding must not decide there.
        let within = below(-self.length - SHORTEST, place.along) * below(place.along, zero);
        let way = place.along.clamped(-self.length, zero);
        let depth = self.fall.mul_add(way, place.target);
        let fall = self.fall * within;
        let cosine_of_slope = zero.splat(1.0) / fall.mul_add(fall, zero.splat(1.0)).sqrt();
        Path {
            course: self.course,
            starboard: [-self.sine, self.cosine],
            cross: place.cross,
            slope: self.slope * within,
            vertical: (fix.position[2] - depth) * cosine_of_slope,
            depth,
            circling: zero,
            direct: below(zero, place.along) * not(self.upright),
            set: zero,
        }
    }
}

/// Course and horizontal length of the leg behind a waypoint that is passed, rad and m; 0 m where the vehicle does not
/// pass it, or goes nowhere from there.
fn after(waypoints: &[Waypoint], k: usize) -> [f64; 2] {
    match (waypoints.get(k), waypoints.get(k + 1)) {
        (Some(here), Some(next)) if here.task == Task::Pass => {
            let [north, east] = [0, 1].map(|i| next.position[i] - here.position[i]);
            [plain::atan2(east, north), plain::hypot(north, east)]
        }
        _ => [0.0; 2],
    }
}
