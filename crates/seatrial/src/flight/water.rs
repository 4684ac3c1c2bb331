//! The water about a vehicle under way: mean current and turbulence, slow change, waves, summed.
//!
//! Tests: `tests/closed_loop/{turbulence,drift,waves}.rs`.

use super::case::{Flight, Setting};
use super::drift::Drift;
use super::turbulence::Turbulence;
use super::waves::Waves;
use crate::model::current::Current;
use crate::model::integrate::State;
use crate::model::kinematics::rotation;
use crate::number::algebra::product;
use crate::number::real::Real;

/// All that moves the water.
pub struct Water<'a, T: Real> {
    turbulence: Turbulence<T>,
    drift: Drift<T>,
    waves: Waves<'a, T>,
    zero: T,
}

impl<'a, T: Real> Water<'a, T> {
    /// The water of a case.
    #[inline(always)]
    pub fn new(flight: &Flight<'_>, setting: &'a Setting<T>, dt: f64) -> Self {
        let (seed, zero) = (setting.seed, setting.seed.zero());
        let uneven = (setting.current, setting.turbulence);
        Self {
            turbulence: Turbulence::new(uneven, flight.turbulence_times, seed, dt),
            drift: Drift::new(setting.current_trend, setting.current_walk, seed, dt),
            waves: Waves::new(&setting.waves, zero, dt),
            zero,
        }
    }

    /// The water at the beginning of control period `k`, which follows the last one; nothing where it is still.
    #[inline(always)]
    pub fn begin(&mut self, k: usize, state: &State<T>) -> Option<Current<T>> {
        self.turbulence.begin(k);
        self.drift.begin(k);
        if self.waves.any() {
            let [u, v, w, ..] = state.nu;
            let velocity = product(&rotation(&state.attitude), &[u, v, w]);
            self.waves.begin(k, &state.position, &velocity);
        }
        self.at(0.0)
    }

    /// The water `time` seconds into the period.
    #[inline(always)]
    pub fn at(&self, time: f64) -> Option<Current<T>> {
        let steady = self.turbulence.at(time);
        if !self.drift.moves() && !self.waves.any() {
            return steady;
        }
        let mut current = match steady {
            Some(current) => current,
            None => Current { velocity: [self.zero; 3], rate: [self.zero; 3], pressed: None },
        };
        self.drift.add(time, &mut current);
        self.waves.add(time, &mut current);
        Some(current)
    }

    /// Whether it differs within a period.
    pub fn varies(&self) -> bool {
        self.turbulence.varies() || self.drift.moves() || self.waves.any()
    }
}
