//! Samples that come late: compared with the estimate of their own time, told of as errors of now.
//!
//! Kept for every step are the estimate x̂ after its samples, the transition F that led to it, and the correction c that
//! its samples made. The row h of a sample z is carried through the steps since, `y_k F_k … F_1 = h`, and meets on the way
//! every correction that the estimate has had: the residual is `z − h(x̂) − Σ y_k c_k`. Left out is the noise of the
//! process over the latency, which is small against that of a sensor whose latency is a few steps.
//!
//! Source: Larsen et al., *Incorporation of time delayed measurements in a discrete-time Kalman filter* (1998), with the
//! transition in place of the gain. Tests: `tests/filter/tracker.rs`.

use super::error_state::{Row, Transition};
use super::estimate::{Estimate, STATES};
use super::observation::Observation;

/// The end of one step.
#[derive(Clone)]
struct Moment {
    time: f64,
    estimate: Estimate,
    /// From the moment before to this one.
    step: Transition<STATES>,
    /// The correction that its samples made.
    moved: [f64; STATES],
}

/// The last steps, in a ring.
#[derive(Clone)]
pub(super) struct Past {
    ring: Vec<Moment>,
    newest: usize,
    count: usize,
}

impl Past {
    /// Room for so many steps; none for a filter whose sensors are all in time.
    pub(super) fn new(steps: usize) -> Self {
        let moment = Moment {
            time: 0.0,
            estimate: Estimate::at_rest(),
            step: Transition::identity(),
            moved: [0.0; STATES],
        };
        Self { ring: vec![moment; steps], newest: 0, count: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// The moment `back` steps before the newest.
    fn at(&self, back: usize) -> &Moment {
        &self.ring[(self.newest + self.ring.len() - back) % self.ring.len()]
    }

    /// Keeps the end of a step, after the correction `moved` of this moment.
    #[inline(always)]
    pub(super) fn keep(
        &mut self,
        time: f64,
        estimate: &Estimate,
        step: &Transition<STATES>,
        moved: &[f64; STATES],
    ) {
        if self.ring.is_empty() {
            return;
        }
        self.newest = (self.newest + 1) % self.ring.len();
        self.count = (self.count + 1).min(self.ring.len());
        let moment = &mut self.ring[self.newest];
        (moment.time, moment.estimate, moment.moved) = (time, *estimate, *moved);
        moment.step.clone_from(step);
    }

    /// Row and residual, of `now`, of what was measured at a time, while `step` leads from the newest moment to now;
    /// nothing where the sensor shows nothing or the time is not kept.
    #[inline(always)]
    pub(super) fn expect(
        &self,
        (observation, measured, time): (&Observation, f64, f64),
        (now, present): (f64, &Estimate),
        step: &Transition<STATES>,
    ) -> Option<(Row, f64)> {
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
            *e *= share;
        }
        estimate.inject(&apart);
        let (expected, row) = observation.expect(&estimate)?;
        let residual = observation.residual(measured, expected);
        // Told of as an error of the nearer end of the interval, and from there through whole steps.
        let nearest = if share < 0.5 { back + 1 } else { back };
        if nearest == 0 {
            return Some((row, residual));
        }
        let mut h = *row.derivatives();
        // The estimate between two moments has its share of the later one's correction.
        let mut corrected = 0.0;
        let mut meet = |h: &[f64; STATES], moment: usize| {
            let weight = if moment + 1 == back { 1.0 - share } else { 1.0 };
            for i in 0..STATES {
                corrected += weight * h[i] * self.at(moment).moved[i];
            }
        };
        if nearest == back {
            meet(&h, back - 1);
        }
        for later in (1..nearest).rev() {
            h = self.at(later - 1).step.back(&h);
            meet(&h, later - 1);
        }
        h = step.back(&h);
        Some((Row::of_all(&h), residual - corrected))
    }
}
