//! Samples of a navigation filter: which are taken, and with what variance.
//!
//! Tests: `tests/flight/test_navigation.py`, `tests/flight/test_acoustics.py`.

use super::fitting::instrument_of;
use super::{FIRST_USBL, LANDMARKS, Landmark, NavigationFilter, finite};
use crate::filter::estimate::POSITION;
use crate::filter::observation::Observation;
use crate::filter::tracker::Sample;
use crate::number::algebra::product;
use crate::number::real::Real;

impl<T: Real> NavigationFilter<T> {
    /// Takes a sample of a channel.
    #[inline(always)]
    pub(super) fn take(&mut self, channel: usize, value: T, age: f64) {
        let (there, zero) = (finite(value), value.zero());
        self.silent[channel] = T::select(there, zero, self.silent[channel]);
        self.first[channel] = T::select(there, value, self.first[channel]);
        let beam =
            (channel >= LANDMARKS && (channel - LANDMARKS) % 2 == 1).then(|| (channel - LANDMARKS) / 2);
        if let Some(mark) =
            beam.filter(|&mark| matches!(self.fitting.landmarks[mark].1, Landmark::Surface(_)))
        {
            self.beams[mark] = T::select(there, value, self.beams[mark]);
            self.observed[channel - 1] = self.fitting.observed(channel - 1, self.beams[mark]);
            return;
        }
        let mut here = T::both(there, self.begun());
        if !T::any(here) {
            return;
        }
        let (instrument, observed) =
            (self.fitting.instruments[instrument_of(channel)], &self.observed[channel]);
        let (Some(instrument), Some(observation)) = (instrument, observed) else { return };
        let mut variance = self.shaken(observation) + (instrument.noise * instrument.noise).max(1e-12);
        if let Some((axis, shifted)) = self.shifted(channel) {
            let offset = instrument.bias * instrument.bias;
            let known = self.tracker.state().covariance(POSITION + axis, POSITION + axis);
            let unsure = T::either(zero.splat(offset).lt(known), not(zero, shifted));
            here = T::both(here, unsure);
            variance += T::select(shifted, zero.splat(offset), zero);
        }
        let sample = Sample { observation, measured: value, variance, age: instrument.latency + age };
        self.tracker.observe_where(here, &sample, &mut self.watches[channel]);
    }

    /// The axis of a fix whose constant offset counts as its error, and where it does: a fix beside others that do not
    /// share the offset. A fix is taken only while the estimate is less sure than that, so that no number of them averages
    /// the offset out.
    #[inline(always)]
    pub(super) fn shifted(&self, channel: usize) -> Option<(usize, T::Mask)> {
        let axis = match channel {
            0 | 1 => channel,
            16 | 17 => channel - 16,
            18..=20 => channel - FIRST_USBL,
            _ => return None,
        };
        let offset = self.fitting.instruments[instrument_of(channel)].map_or(0.0, |i| i.bias);
        let (zero, fixes) = (self.begun.zero(), self.watches[FIRST_USBL].taken);
        let several = if self.fitting.landmarks.is_empty() { fixes } else { zero.splat(1.0) };
        (offset > 0.0).then(|| (axis, zero.lt(several)))
    }

    /// The variance that waves add to an observation.
    #[inline(always)]
    pub(super) fn shaken(&self, observation: &Observation<T>) -> T {
        let Some(swell) = &self.fitting.swell else { return self.begun.zero() };
        let turned = self.tracker.estimate().rotation();
        match observation {
            Observation::Place { along, .. } => swell.share(along) * self.waves.displacement,
            Observation::Velocity { along, over_ground: true, .. } => {
                swell.share(&product(&turned, along)) * self.waves.velocity
            }
            Observation::Echo { along, .. } => {
                swell.share(&product(&turned, along)) * self.waves.displacement
            }
            Observation::Range { .. } => self.waves.displacement,
            _ => self.begun.zero(),
        }
    }
}

/// Where a mask does not hold.
#[inline(always)]
fn not<T: Real>(zero: T, mask: T::Mask) -> T::Mask {
    zero.lt(T::select(mask, zero, zero.splat(1.0)))
}
