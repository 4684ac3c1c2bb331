//! Sums up the figures of a flight while it goes on, so that ten thousand flights need no logs.
//!
//! Tests: `tests/closed_loop.rs`, `tests/flight/test_fly.py` (equal to the same figures from the log).

use super::case::Flight;
use super::exceedance::{EDGES, edges};
use super::legs::Legs;
use super::obstacle::{Hull, clearance};
use super::summary::Summary;
use super::trial::Violations;
use crate::actuator::motor::Limits;
use crate::control::autopilot::Thought;
use crate::control::navigation::CHANNELS;
use crate::number::real::Real;

/// An aborted flight is followed for so long, s, if it does not surface before.
const AFTER_ABORT_S: f64 = 120.0;

/// The figures of a flight under way, and what summing them up needs.
pub struct Tally<T> {
    /// Sums so far where a figure is a mean.
    figures: Summary<T>,
    /// 1 until the flight ends.
    flying: T,
    /// Position and commands of the last period.
    last: [T; 3],
    before: Vec<T>,
    /// Per actuator, one over its range.
    range: Vec<f64>,
    legs: Legs,
    edges: [f64; EDGES],
    hull: Hull,
}

impl<T: Real> Tally<T> {
    /// A flight that has not begun.
    #[inline(always)]
    pub fn new(flight: &Flight<'_>, unit: T, limits: &[Limits]) -> Self {
        let zero = unit.zero();
        Self {
            figures: Summary::nothing(zero, Violations::new(flight.trial, zero)),
            flying: zero.splat(1.0),
            last: [zero; 3],
            before: vec![zero; limits.len()],
            range: limits.iter().map(|l| 1.0 / (l.maximum[0] + l.maximum[1])).collect(),
            legs: Legs::of(flight.mission),
            edges: edges(),
            hull: Hull::of(flight.description),
        }
    }

    /// 1 where a case still flies.
    #[inline(always)]
    pub fn flying(&self) -> T {
        self.flying
    }

    /// Whether any lane still flies.
    #[inline(always)]
    pub fn any_flying(&self) -> bool {
        T::any(self.flying.splat(0.5).lt(self.flying))
    }

    /// Takes one more control period `k`, its commands, the energy used so far, and base and scale of each corridor.
    #[inline(always)]
    pub fn add(
        &mut self,
        flight: &Flight<'_>,
        truth: &[T; CHANNELS],
        thought: &Thought<T>,
        (k, commands, used, scales): (usize, &[T], T, &[[T; 2]]),
    ) {
        let zero = self.flying.zero();
        let (one, half) = (zero.splat(1.0), zero.splat(0.5));
        let dt = flight.settings.file.period_s;
        let flying = half.lt(self.flying);
        let keep = |new: T, old: T| T::select(flying, new, old);
        let [x, y, z, roll, pitch, ..] = *truth;
        let figures = &mut self.figures;
        if k > 0 {
            let [a, b, c] = [x - self.last[0], y - self.last[1], z - self.last[2]];
            let way = a.mul_add(a, b.mul_add(b, c * c)).sqrt();
            figures.distance = keep(figures.distance + way, figures.distance);
        }
        self.last = [x, y, z];
        // What has diverged is not a number, and flies no further.
        let sound = (x + y + z).abs().lt(zero.splat(f64::INFINITY));
        let now = T::select(sound, zero.splat(k as f64 * dt), zero.splat(f64::NAN));
        figures.duration = keep(now, figures.duration);
        figures.energy = keep(used, figures.energy);
        figures.depth = keep(figures.depth.max(z), figures.depth);
        figures.altitude = keep(figures.altitude.min(truth[12]), figures.altitude);
        let time = zero.splat(k as f64 * dt);
        if !flight.obstacles.is_empty() {
            let [free, reserve] = clearance(flight.obstacles, self.hull, truth);
            let nearer = T::both(flying, free.lt(figures.clearance[0]));
            figures.clearance[0] = T::select(nearer, free, figures.clearance[0]);
            figures.clearance[1] = T::select(nearer, time, figures.clearance[1]);
            figures.clearance[2] = keep(figures.clearance[2].min(reserve), figures.clearance[2]);
        }
        let higher = T::both(flying, z.lt(figures.shallowest[0]));
        figures.shallowest[0] = T::select(higher, z, figures.shallowest[0]);
        figures.shallowest[1] = T::select(higher, time, figures.shallowest[1]);
        for (i, angle) in [roll.abs(), pitch.abs()].into_iter().enumerate() {
            let larger = T::both(flying, figures.tilt[i].lt(angle));
            figures.tilt[i] = T::select(larger, angle, figures.tilt[i]);
            figures.tilt_time[i] = T::select(larger, time, figures.tilt_time[i]);
        }
        let desired = &thought.desired;
        let alert = thought.alert;
        let on_mission = T::both(flying, T::both(alert.level.lt(half), desired.done.lt(half)));
        let settled = self.legs.settled(desired.leg, desired.distance);
        let counts = T::both(T::both(on_mission, desired.holding.lt(half)), settled);
        figures.settled += T::select(counts, one, zero);
        let across = self.legs.across(desired.leg, [x, y]);
        let errors = [desired.cross_track, desired.vertical_error, across];
        let sums = [&mut figures.cross_track, &mut figures.vertical, &mut figures.true_cross_track];
        for ((sum, error), above) in sums.into_iter().zip(errors).zip(&mut figures.exceedance) {
            sum[0] = T::select(counts, sum[0].max(error.abs()), sum[0]);
            sum[1] += T::select(counts, error * error, zero);
            if T::any(counts) {
                above.add(error, counts, &self.edges);
            }
        }
        let out = self.legs.excursion(desired.leg, [x, y, z]);
        figures.excursion = T::select(on_mission, figures.excursion.max(out), figures.excursion);
        // A reaction ends the mission where the vehicle is: that waypoint is not behind it.
        let behind = desired.leg + T::select(alert.level.lt(half), desired.done, zero);
        figures.waypoints = T::select(T::both(flying, sound), behind, figures.waypoints);
        figures.missed_by = keep(thought.missed_by, figures.missed_by);
        let turns = |command: T| T::select(zero.lt(command.abs()), one, zero);
        for ((was, &command), range) in self.before.iter_mut().zip(commands).zip(&self.range) {
            if k > 0 {
                figures.switches += T::select(flying, (turns(command) - turns(*was)).abs(), zero);
                figures.travel += T::select(flying, (command - *was).abs() * *range, zero);
            }
            *was = command;
        }
        figures.alert = [
            keep(alert.level, figures.alert[0]),
            // What is told without a reaction is in the log.
            keep(T::select(half.lt(alert.level), alert.cause, zero), figures.alert[1]),
            keep(alert.since, figures.alert[2]),
        ];
        let ended = half.lt(thought.ended);
        let aborted = zero.splat(2.5).lt(alert.level);
        let over = (alert.since + AFTER_ABORT_S).lt(zero.splat(k as f64 * dt));
        let ends = T::either(ended, T::both(aborted, over));
        let rises = zero.splat(1.5).lt(alert.level);
        let ending = T::select(aborted, zero.splat(3.0), T::select(rises, zero.splat(2.0), one));
        let ending = T::select(ends, ending, figures.ending);
        let ending = T::select(sound, ending, zero.splat(f64::NAN));
        figures.ending = T::select(flying, ending, figures.ending);
        self.flying = T::select(ends, zero, T::select(sound, self.flying, zero));
        figures.violations.add(flight.trial, (truth, thought), scales, (k, dt));
    }

    /// The figures, sums turned into means.
    #[inline(always)]
    pub fn finish(self) -> Summary<T> {
        let mut figures = self.figures;
        let (one, none) = (figures.settled.splat(1.0), figures.settled.splat(f64::NAN));
        let any = one.zero().lt(figures.settled);
        for sum in [&mut figures.cross_track, &mut figures.vertical, &mut figures.true_cross_track] {
            sum[1] = (sum[1] / figures.settled.max(one)).sqrt();
            // Who never settled on a leg has no error of guidance, rather than none at all.
            for figure in sum {
                *figure = T::select(any, *figure, none);
            }
        }
        // Of what diverged nothing is a figure: its last sound value would be a good one.
        let sound = figures.duration.abs().lt(one.splat(f64::INFINITY));
        let errors = figures.cross_track.iter_mut().chain(&mut figures.true_cross_track);
        let pairs = errors.chain(&mut figures.vertical).chain(&mut figures.tilt);
        let pairs = pairs.chain(&mut figures.tilt_time).chain(&mut figures.shallowest);
        let pairs = pairs.chain(&mut figures.clearance);
        for figure in pairs.chain([
            &mut figures.energy,
            &mut figures.excursion,
            &mut figures.depth,
            &mut figures.altitude,
            &mut figures.distance,
            &mut figures.missed_by,
        ]) {
            *figure = T::select(sound, *figure, none);
        }
        // At least a tick; of what diverged it stays no number.
        let (minutes, tick) = (figures.duration * (1.0 / 60.0), one.splat(1e-9));
        let minutes = T::select(minutes.lt(tick), tick, minutes);
        let actuators = self.before.len().max(1) as f64;
        figures.switches = figures.switches / (minutes * actuators);
        figures.travel = figures.travel / (minutes * (60.0 * actuators));
        figures
    }
}
