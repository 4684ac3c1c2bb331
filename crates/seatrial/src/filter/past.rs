//! Samples that come late: compared with the estimate of their own time, told of as errors of now.
//!
//! Kept for every step are the estimate x̂ after its samples, the transition F that led to it, and c, the sum of all
//! corrections since, carried on to now. A sample z of that time has the residual `z − h(x̂) − y c`, where y is its row of
//! now, `y F_k … F_1 = h`: every correction that the estimate has had since is accounted for. Left out is the noise of the
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
    /// Corrections since, as errors of now.
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

    /// Carries the corrections on over a step.
    #[inline(always)]
    pub(super) fn carry(&mut self, step: &Transition<STATES>) {
        let columns = step.columns();
        for moment in &mut self.ring {
            moment.moved = step.times(&columns, &moment.moved);
        }
    }

    /// Keeps the end of a step, after the correction `moved` of this moment; earlier ones are told of it.
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
        for moment in &mut self.ring {
            for i in 0..STATES {
                moment.moved[i] += moved[i];
            }
        }
        self.newest = (self.newest + 1) % self.ring.len();
        self.count = (self.count + 1).min(self.ring.len());
        self.ring[self.newest] =
            Moment { time, estimate: *estimate, step: step.clone(), moved: [0.0; STATES] };
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
        let (then, after, none) = match back {
            0 => (now, present, [0.0; STATES]),
            _ => (self.at(back - 1).time, &self.at(back - 1).estimate, self.at(back - 1).moved),
        };
        let share = (time - before.time) / (then - before.time);
        let (mut estimate, mut moved) = (before.estimate, before.moved);
        estimate.inject(&before.estimate.error_of(after).map(|e| e * share));
        for i in 0..STATES {
            moved[i] += share * (none[i] - moved[i]);
        }
        let (expected, row) = observation.expect(&estimate)?;
        let mut h = [0.0; STATES];
        for &(i, derivative) in row.entries() {
            h[i] += derivative;
        }
        // Told of as an error of the nearer end of the interval, and from there through whole steps.
        let nearest = if share < 0.5 { back + 1 } else { back };
        for later in (1..nearest).rev() {
            h = self.at(later - 1).step.back(&h);
        }
        if nearest > 0 {
            h = step.back(&h);
        }
        let row = Row::of_all(&h);
        Some((row, observation.residual(measured, expected) - row.times(&moved)))
    }
}
