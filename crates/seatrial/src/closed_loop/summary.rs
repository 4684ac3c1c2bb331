//! The figures of a flight, summed while it goes on, so that ten thousand flights need no logs.
//!
//! Errors of guidance count on the second half of every straight leg, where the vehicle has had time to settle; the
//! depth excursion is how far the vehicle leaves the band between the depths of a leg's two ends.
//!
//! Tests: `tests/closed_loop.rs`, `tests/test_fly.py` (equal to the same figures from the log).

use super::Flight;
use super::exceedance::{EDGES, Exceedance, edges};
use super::obstacle::clearance;
use super::trial::Violations;
use crate::actuator::motor::Limits;
use crate::autopilot::Thought;
use crate::mission::{Task, Vertical};
use crate::navigation::CHANNELS;
use crate::real::Real;

/// How a flight ended.
pub const ENDINGS: [&str; 4] = ["out of time", "complete", "surfaced", "aborted"];

/// An aborted flight is followed for so long, s, if it does not surface before.
const AFTER_ABORT_S: f64 = 120.0;

/// The figures of a flight.
#[derive(Clone, Debug)]
pub struct Summary<T> {
    /// Index into [`ENDINGS`]; not a number for what diverged.
    pub ending: T,
    /// Duration, s.
    pub duration: T,
    /// Way over ground, m.
    pub distance: T,
    /// Electrical energy, J.
    pub energy: T,
    /// Largest and root mean square cross-track error on settled legs, m, as guidance saw it.
    pub cross_track: [T; 2],
    /// The same of where the vehicle really was.
    pub true_cross_track: [T; 2],
    /// Largest and root mean square vertical error on settled legs, m.
    pub vertical: [T; 2],
    /// Largest excursion from the depth band of a leg, m.
    pub excursion: T,
    /// Largest depth, m, and smallest altitude, m.
    pub depth: T,
    /// Smallest altitude above the bottom, m; infinite without one.
    pub altitude: T,
    /// Waypoints behind the vehicle.
    pub waypoints: T,
    /// Largest of the smallest distances to the waypoints behind the vehicle, m.
    pub missed_by: T,
    /// Starts and stops of actuators, per minute and actuator.
    pub switches: T,
    /// Strongest reaction, its cause and its time, s.
    pub alert: [T; 3],
    /// Largest roll and pitch, rad.
    pub tilt: [T; 2],
    /// Smallest horizontal distance to the edge of an obstacle, m; infinite without any.
    pub clearance: T,
    /// Mean rate at which commands move, shares of an actuator's range per s.
    pub travel: T,
    /// Samples on settled legs, and those of them whose cross-track and vertical error exceeds each threshold.
    pub settled: T,
    /// Of the cross-track, the vertical and the true cross-track error.
    pub exceedance: [Exceedance<T>; 3],
    /// What the responses of a trial violate.
    pub violations: Violations<T>,
    flying: T,
    last: [T; 3],
    before: Vec<T>,
    /// Per actuator, one over its range.
    range: Vec<f64>,
    edges: [f64; EDGES],
}

impl<T: Real> Summary<T> {
    /// A flight that has not begun.
    #[inline(always)]
    pub fn new(flight: &Flight<'_>, unit: T, limits: &[Limits]) -> Self {
        let zero = unit.zero();
        Self {
            ending: zero,
            duration: zero,
            distance: zero,
            energy: zero,
            cross_track: [zero; 2],
            true_cross_track: [zero; 2],
            vertical: [zero; 2],
            excursion: zero,
            depth: zero.splat(f64::NEG_INFINITY),
            altitude: zero.splat(f64::INFINITY),
            waypoints: zero,
            missed_by: zero,
            switches: zero,
            alert: [zero; 3],
            tilt: [zero; 2],
            clearance: zero.splat(f64::INFINITY),
            travel: zero,
            settled: zero,
            exceedance: [Exceedance::new(zero); 3],
            violations: Violations::new(flight.trial, zero),
            flying: zero.splat(1.0),
            last: [zero; 3],
            before: vec![zero; limits.len()],
            range: limits.iter().map(|l| 1.0 / (l.maximum[0] + l.maximum[1])).collect(),
            edges: edges(),
        }
    }

    /// Whether any lane still flies.
    #[inline(always)]
    pub fn any_flying(&self) -> bool {
        T::any(self.flying.splat(0.5).lt(self.flying))
    }

    /// Takes one more control period `k`, its commands and the energy used so far.
    #[inline(always)]
    pub fn add(
        &mut self,
        flight: &Flight<'_>,
        truth: &[T; CHANNELS],
        thought: &Thought<T>,
        (k, commands, used): (usize, &[T], T),
    ) {
        let zero = self.flying.zero();
        let (one, half) = (zero.splat(1.0), zero.splat(0.5));
        let dt = flight.settings.file.period_s;
        let flying = half.lt(self.flying);
        let keep = |new: T, old: T| T::select(flying, new, old);
        let [x, y, z, roll, pitch, ..] = *truth;
        if k > 0 {
            let [a, b, c] = [x - self.last[0], y - self.last[1], z - self.last[2]];
            let way = a.mul_add(a, b.mul_add(b, c * c)).sqrt();
            self.distance = keep(self.distance + way, self.distance);
        }
        self.last = [x, y, z];
        // What has diverged is not a number, and flies no further.
        let sound = (x + y + z).abs().lt(zero.splat(f64::INFINITY));
        let now = T::select(sound, zero.splat(k as f64 * dt), zero.splat(f64::NAN));
        self.duration = keep(now, self.duration);
        self.energy = keep(used, self.energy);
        self.depth = keep(self.depth.max(z), self.depth);
        self.altitude = keep(self.altitude.min(truth[12]), self.altitude);
        self.clearance = keep(self.clearance.min(clearance(flight.obstacles, [x, y])), self.clearance);
        self.tilt = [
            keep(self.tilt[0].max(roll.abs()), self.tilt[0]),
            keep(self.tilt[1].max(pitch.abs()), self.tilt[1]),
        ];
        let desired = &thought.desired;
        let alert = thought.alert;
        let on_mission = T::both(flying, T::both(alert.level.lt(half), desired.done.lt(half)));
        let (near, upper, lower) = self.leg(flight, desired.leg, desired.distance);
        let counts = T::both(T::both(on_mission, desired.holding.lt(half)), half.lt(near));
        let share = T::select(counts, one, zero);
        self.settled += share;
        let across = self.across(flight, desired.leg, [x, y]);
        let errors = [desired.cross_track, desired.vertical_error, across];
        let sums = [&mut self.cross_track, &mut self.vertical, &mut self.true_cross_track];
        for ((sum, error), above) in sums.into_iter().zip(errors).zip(&mut self.exceedance) {
            sum[0] = T::select(counts, sum[0].max(error.abs()), sum[0]);
            sum[1] += T::select(counts, error * error, zero);
            if T::any(counts) {
                above.add(error, counts, &self.edges);
            }
        }
        let out = (z - lower).max(upper - z).max(zero);
        self.excursion = T::select(on_mission, self.excursion.max(out), self.excursion);
        // A reaction ends the mission where the vehicle is: that waypoint is not behind it.
        let behind = desired.leg + T::select(alert.level.lt(half), desired.done, zero);
        self.waypoints = T::select(T::both(flying, sound), behind, self.waypoints);
        self.missed_by = keep(thought.missed_by, self.missed_by);
        let turns = |command: T| T::select(zero.lt(command.abs()), one, zero);
        for ((was, &command), range) in self.before.iter_mut().zip(commands).zip(&self.range) {
            if k > 0 {
                self.switches += T::select(flying, (turns(command) - turns(*was)).abs(), zero);
                self.travel += T::select(flying, (command - *was).abs() * *range, zero);
            }
            *was = command;
        }
        self.alert = [
            keep(alert.level, self.alert[0]),
            keep(alert.cause, self.alert[1]),
            keep(alert.since, self.alert[2]),
        ];
        let ended = half.lt(thought.ended);
        let aborted = zero.splat(2.5).lt(alert.level);
        let over = (alert.since + AFTER_ABORT_S).lt(zero.splat(k as f64 * dt));
        let ends = T::either(ended, T::both(aborted, over));
        let rises = zero.splat(1.5).lt(alert.level);
        let ending = T::select(aborted, zero.splat(3.0), T::select(rises, zero.splat(2.0), one));
        let ending = T::select(ends, ending, self.ending);
        let ending = T::select(sound, ending, zero.splat(f64::NAN));
        self.ending = T::select(flying, ending, self.ending);
        self.flying = T::select(ends, zero, T::select(sound, self.flying, zero));
    }

    /// 1 on the second half of a straight leg, and the band of its depths.
    #[inline(always)]
    fn leg(&self, flight: &Flight<'_>, leg: T, distance: T) -> (T, T, T) {
        let waypoints = &flight.mission.waypoints;
        let at = |leg: f64| (leg.max(0.0) as usize).min(waypoints.len() - 1);
        let before = |i: usize| match i {
            0 => flight.mission.start.position,
            _ => waypoints[i - 1].position,
        };
        let half_length = leg.tabulated(|leg| {
            let (from, waypoint) = (before(at(leg)), &waypoints[at(leg)]);
            if matches!(waypoint.task, Task::Circle { .. }) {
                return (0.0, 0.0);
            }
            let to = waypoint.position;
            (0.5 * (to[0] - from[0]).hypot(to[1] - from[1]), 0.0)
        });
        let depths = |leg: f64| {
            let i = at(leg);
            let follows = |i: usize| waypoints[i].vertical == Vertical::Altitude;
            let free = follows(i) || (i > 0 && follows(i - 1));
            if free {
                [f64::NEG_INFINITY, f64::INFINITY]
            } else {
                let (from, to) = (before(i)[2], waypoints[i].position[2]);
                [from.min(to), from.max(to)]
            }
        };
        let upper = leg.tabulated(|leg| (depths(leg)[0], 0.0));
        let lower = leg.tabulated(|leg| (depths(leg)[1], 0.0));
        let near = T::select(distance.lt(half_length), leg.splat(1.0), leg.zero());
        (near, upper, lower)
    }

    /// Cross-track error of a place (north, east, m) against the straight leg to a waypoint.
    #[inline(always)]
    fn across(&self, flight: &Flight<'_>, leg: T, [x, y]: [T; 2]) -> T {
        let waypoints = &flight.mission.waypoints;
        let ends = |leg: f64| {
            let i = (leg.max(0.0) as usize).min(waypoints.len() - 1);
            let from = if i == 0 { flight.mission.start.position } else { waypoints[i - 1].position };
            let to = waypoints[i].position;
            let length = (to[0] - from[0]).hypot(to[1] - from[1]).max(f64::MIN_POSITIVE);
            (from, [(to[0] - from[0]) / length, (to[1] - from[1]) / length])
        };
        let north = x - leg.tabulated(|leg| (ends(leg).0[0], 0.0));
        let east = y - leg.tabulated(|leg| (ends(leg).0[1], 0.0));
        let (cosine, sine) =
            (leg.tabulated(|leg| (ends(leg).1[0], 0.0)), leg.tabulated(|leg| (ends(leg).1[1], 0.0)));
        east.mul_sub(cosine, north * sine)
    }

    /// The same figures in another number type: one lane of eight.
    pub fn read(&self, lane: impl Fn(&T) -> f64) -> Summary<f64> {
        let two = |x: &[T; 2]| [lane(&x[0]), lane(&x[1])];
        let three = |x: &[T; 3]| [lane(&x[0]), lane(&x[1]), lane(&x[2])];
        Summary {
            ending: lane(&self.ending),
            duration: lane(&self.duration),
            distance: lane(&self.distance),
            energy: lane(&self.energy),
            cross_track: two(&self.cross_track),
            true_cross_track: two(&self.true_cross_track),
            vertical: two(&self.vertical),
            excursion: lane(&self.excursion),
            depth: lane(&self.depth),
            altitude: lane(&self.altitude),
            waypoints: lane(&self.waypoints),
            missed_by: lane(&self.missed_by),
            switches: lane(&self.switches),
            alert: three(&self.alert),
            tilt: two(&self.tilt),
            clearance: lane(&self.clearance),
            travel: lane(&self.travel),
            settled: lane(&self.settled),
            exceedance: std::array::from_fn(|i| self.exceedance[i].read(&lane)),
            violations: Violations { sums: self.violations.sums.iter().map(&three).collect() },
            flying: lane(&self.flying),
            last: three(&self.last),
            before: self.before.iter().map(&lane).collect(),
            range: self.range.clone(),
            edges: self.edges,
        }
    }

    /// Turns sums into means.
    #[inline(always)]
    pub fn finish(&mut self) {
        let (one, none) = (self.settled.splat(1.0), self.settled.splat(f64::NAN));
        let any = one.zero().lt(self.settled);
        for sum in [&mut self.cross_track, &mut self.vertical, &mut self.true_cross_track] {
            sum[1] = (sum[1] / self.settled.max(one)).sqrt();
            // Who never settled on a leg has no error of guidance, rather than none at all.
            for figure in sum {
                *figure = T::select(any, *figure, none);
            }
        }
        // Of what diverged nothing is a figure: its last sound value would be a good one.
        let sound = self.duration.abs().lt(one.splat(f64::INFINITY));
        let errors = self.cross_track.iter_mut().chain(&mut self.true_cross_track);
        let pairs = errors.chain(&mut self.vertical).chain(&mut self.tilt);
        for figure in pairs.chain([
            &mut self.energy,
            &mut self.excursion,
            &mut self.depth,
            &mut self.altitude,
            &mut self.clearance,
            &mut self.distance,
            &mut self.missed_by,
        ]) {
            *figure = T::select(sound, *figure, none);
        }
        // At least a tick; of what diverged it stays no number.
        let (minutes, tick) = (self.duration * (1.0 / 60.0), one.splat(1e-9));
        let minutes = T::select(minutes.lt(tick), tick, minutes);
        let actuators = self.before.len().max(1) as f64;
        self.switches = self.switches / (minutes * actuators);
        self.travel = self.travel / (minutes * (60.0 * actuators));
    }
}
