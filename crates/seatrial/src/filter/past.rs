//! Samples that come late: compared with the estimate of their own time, told of as errors of now.
//!
//! Kept for every step are the estimate x̂ after its samples, the way back F⁻¹ of the transition that led to it, and the
//! correction c that its samples made. The row h of a sample z is carried through the steps since,
//! `y_k = h F_1⁻¹ … F_k⁻¹`, and meets on the way every correction that the estimate has had: the residual is `z − h(x̂) − Σ y_k c_k`. Left out is the noise of the
//! process over the latency, which is small against that of a sensor whose latency is a few steps.
//!
//! Vehicles abreast share the times of what is kept, and each has its own since when.
//!
//! Source: Larsen et al., *Incorporation of time delayed measurements in a discrete-time Kalman filter* (1998), with the
//! transition in place of the gain. Tests: `tests/filter/tracker.rs`.

use super::estimate::{Components, Estimate, STATES};
use super::observation::{Expected, Observation};
use super::row::Row;
use super::transition::Return;
use crate::number::real::Real;

/// The end of one step.
#[derive(Clone)]
struct Moment<T> {
    time: f64,
    estimate: Estimate<T>,
    /// From this moment to the one before.
    back: Box<Return<T>>,
    /// The correction that its samples made.
    moved: Components<T>,
}

/// The estimate between two moments.
#[derive(Clone, Copy)]
struct Between<T> {
    time: f64,
    /// How many steps before the newest the earlier moment is.
    back: usize,
    /// Where in the step the time lies, from 0 to 1.
    share: f64,
    estimate: Estimate<T>,
}

/// The last steps, in a ring.
#[derive(Clone)]
pub(super) struct Past<T> {
    ring: Vec<Moment<T>>,
    newest: usize,
    count: usize,
    /// The time from which on what is kept counts, vehicle by vehicle.
    since: T,
    /// Where the last sample was: those of one sensor are of one time.
    last: Option<Between<T>>,
}

impl<T: Real> Past<T> {
    /// Room for so many steps; none for a filter whose sensors are all in time.
    pub(super) fn new(steps: usize, unit: T) -> Self {
        let moment = Moment {
            time: 0.0,
            estimate: Estimate::at_rest_in(unit),
            back: Box::new(Return::identity(unit)),
            moved: [unit.zero(); STATES],
        };
        let since = unit.splat(f64::INFINITY);
        Self { ring: vec![moment; steps], newest: 0, count: 0, since, last: None }
    }

    /// Whether samples may come late.
    pub(super) fn kept(&self) -> bool {
        !self.ring.is_empty()
    }

    /// What is kept counts from a time on where the mask holds; `estimate` is that of then.
    #[inline(always)]
    pub(super) fn begin(&mut self, mask: T::Mask, time: f64, estimate: &Estimate<T>) {
        self.last = None;
        self.since = T::select(mask, self.since.splat(time), self.since);
        if self.ring.is_empty() {
            return;
        }
        if self.count == 0 || self.at(0).time != time {
            // Nothing goes back beyond it.
            self.keep(time, estimate, None, &self.ring[self.newest].moved.clone());
        }
        let newest = &mut self.ring[self.newest];
        newest.estimate = Estimate::select(mask, estimate, &newest.estimate);
    }

    /// The moment `back` steps before the newest.
    #[inline(always)]
    fn at(&self, back: usize) -> &Moment<T> {
        let place = self.newest + self.ring.len() - back;
        &self.ring[if place < self.ring.len() { place } else { place - self.ring.len() }]
    }

    /// Keeps the end of a step, after the correction `moved` of this moment; what `back` leads to is exchanged for what is
    /// forgotten.
    #[inline(always)]
    pub(super) fn keep(
        &mut self,
        time: f64,
        estimate: &Estimate<T>,
        back: Option<&mut Box<Return<T>>>,
        moved: &Components<T>,
    ) {
        self.last = None;
        if self.ring.is_empty() {
            return;
        }
        self.newest = (self.newest + 1) % self.ring.len();
        self.count = (self.count + 1).min(self.ring.len());
        let moment = &mut self.ring[self.newest];
        (moment.time, moment.estimate, moment.moved) = (time, *estimate, *moved);
        if let Some(back) = back {
            std::mem::swap(&mut moment.back, back);
        }
    }

    /// Finds the estimate at a time, while `present` is that of now; nothing where the time is not kept.
    #[inline(always)]
    fn between(&mut self, time: f64, (now, present): (f64, &Estimate<T>)) -> Option<Between<T>> {
        if let Some(last) = self.last.filter(|last| last.time == time) {
            return Some(last);
        }
        // The newest moment that is not later than the sample, and what comes after it.
        let back = (0..self.count).find(|&back| self.at(back).time <= time + 1e-9)?;
        let before = self.at(back);
        let (then, after) = match back {
            0 => (now, present),
            _ => (self.at(back - 1).time, &self.at(back - 1).estimate),
        };
        let share = (time - before.time) / (then - before.time);
        let mut estimate = before.estimate;
        let mut apart = before.estimate.error_of(after);
        for e in &mut apart {
            *e = *e * share;
        }
        estimate.inject(&apart);
        self.last = Some(Between { time, back, share, estimate });
        self.last
    }

    /// Row and residual, of `now`, of what was measured at a time, while `step` leads back from now to the newest moment;
    /// not seen where the sensor shows nothing or the time is not kept.
    #[inline(always)]
    pub(super) fn expect(
        &mut self,
        (observation, measured, time): (&Observation<T>, T, f64),
        present: (f64, &Estimate<T>),
        step: &Return<T>,
    ) -> Option<(Row<T>, T, T::Mask)> {
        let Between { back, share, estimate, .. } = self.between(time, present)?;
        let Expected { value, mut row, seen } = observation.expected(&estimate);
        let residual = observation.residual(measured, value);
        let kept = self.since.lt(measured.splat(self.at(back).time + 1e-9));
        let seen = T::both(seen, kept);
        // Told of as an error of the nearer end of the interval, and from there through whole steps.
        let nearest = if share < 0.5 { back + 1 } else { back };
        if nearest == 0 {
            return Some((row, residual, seen));
        }
        // The estimate between two moments has its share of the later one's correction.
        let mut corrected = measured.zero();
        if nearest == back {
            corrected += row.times(&self.at(back - 1).moved) * (1.0 - share);
        }
        for later in (1..nearest).rev() {
            row = self.at(later - 1).back.carry(&row);
            let weight = if later == back { 1.0 - share } else { 1.0 };
            corrected += row.times(&self.at(later - 1).moved) * weight;
        }
        Some((step.carry(&row), residual - corrected, seen))
    }
}
