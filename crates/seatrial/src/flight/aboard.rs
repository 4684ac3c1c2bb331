//! Navigation filters aboard: the autopilot is told their estimate in place of what the sensors show.
//!
//! The filters of cases that fly in lanes fly in lanes too; GPS, acoustics and sonar, which are rare, are listened to case
//! by case.
//!
//! Tests: `tests/flight/test_navigation.py` (filters abreast equal filters alone).

use super::acoustics::Soundings;
use super::case::{Flight, Setting};
use crate::control::navigation::{CHANNELS, Measurement};
use crate::control::navigation_filter::fitting::{RANGE, instrument_of};
use crate::control::navigation_filter::{Fitting, KIND_OF, KINDS, NavigationFilter, Told};
use crate::number::lanes::{LANES, Lanes};
use crate::number::real::Real;
use fearless_simd::{Simd, SimdBase, f64x8};

/// A number that is told apart by lanes.
pub trait Split: Real {
    /// The number of lanes.
    const PARTS: usize;
    /// One lane.
    fn part(self, lane: usize) -> f64;
    /// All lanes, in the kind of `self`.
    fn join(self, part: impl Fn(usize) -> f64) -> Self;
}

impl Split for f64 {
    const PARTS: usize = 1;
    #[inline(always)]
    fn part(self, _: usize) -> f64 {
        self
    }
    #[inline(always)]
    fn join(self, part: impl Fn(usize) -> f64) -> f64 {
        part(0)
    }
}

impl<S: Simd> Split for Lanes<S> {
    const PARTS: usize = LANES;
    #[inline(always)]
    fn part(self, lane: usize) -> f64 {
        self[lane]
    }
    #[inline(always)]
    fn join(self, part: impl Fn(usize) -> f64) -> Self {
        f64x8::from_fn(self.simd, part)
    }
}

/// The filters of all lanes.
pub struct Aboard<T: Real> {
    filter: NavigationFilter<T>,
    soundings: Vec<Soundings>,
    ages: [T; CHANNELS],
    samples: Vec<Told<T>>,
    /// What was heard aboard of one, and of all, channel by channel.
    heard: Vec<Told>,
    abreast: Vec<(usize, [f64; LANES])>,
}

impl<T: Split> Aboard<T> {
    /// The filters of all lanes on the vehicle that the autopilot believes in.
    pub fn new(flight: &Flight<'_>, fitting: &Fitting, setting: &Setting<T>) -> Self {
        let (model, acoustics) = (flight.model, flight.acoustics);
        let sounded = acoustics.devices.iter().any(Option::is_some);
        let begun = |lane: usize| setting.offsets.as_ref().map(|own| [own[0].part(lane), own[1].part(lane)]);
        let top = flight.description.hull_top();
        let most = 5 + 2 * acoustics.landmarks.len();
        Self {
            filter: NavigationFilter::new_in(model, fitting.clone(), setting.seed),
            soundings: (0..if sounded { T::PARTS } else { 0 })
                .map(|lane| {
                    let own = (setting.seed.part(lane), begun(lane));
                    Soundings::new(acoustics, &fitting.landmarks, &top, own)
                })
                .collect(),
            ages: [setting.seed.splat(f64::INFINITY); CHANNELS],
            samples: Vec::with_capacity(CHANNELS + most),
            heard: Vec::with_capacity(most),
            abreast: Vec::with_capacity(most),
        }
    }

    /// The estimates `elapsed` seconds later, from what the sensors show; `commands` have held since, `signals` are what
    /// the actuators are measured at; a control period is `dt`. The filter of a case that has ended is shown nothing: what
    /// it found does not depend on how long its neighbours fly.
    #[inline(always)]
    pub fn tell(
        &mut self,
        (truth, measured): (&[T; CHANNELS], &Measurement<T>),
        (commands, signals): (&[T], Option<&[T]>),
        (elapsed, dt): (f64, f64),
        flying: Option<T>,
    ) -> Measurement<T> {
        let zero = measured.battery.zero();
        let flying = flying.unwrap_or(zero.splat(1.0));
        let aboard = zero.splat(0.5).lt(flying);
        self.samples.clear();
        for c in 0..CHANNELS {
            // A sample that has arrived is younger than the last one has become.
            let (age, grown) = (measured.age[c], self.ages[c] + 0.5 * elapsed.max(1e-3));
            let arrived = T::both(aboard, T::both(age.lt(grown), age.lt(zero.splat(f64::INFINITY))));
            if T::any(arrived) {
                // Sensors of one kind show their samples at the same times.
                let latency = self.filter.fitting().instruments[KIND_OF[c]].map_or(0.0, |i| i.latency);
                let age = T::select(arrived, age, zero).largest();
                let shown = T::select(arrived, measured.channels[c], zero.splat(f64::NAN));
                self.samples.push((c, shown, (age - latency).max(0.0)));
            }
        }
        self.ages = measured.age;
        self.listen(truth, dt, flying);
        let (filter, samples) = (&mut self.filter, &self.samples);
        zero.apart(
            #[inline(always)]
            || {
                filter.step(samples, (commands, signals), (measured.voltage, elapsed));
                filter.told(measured)
            },
        )
    }

    /// Adds what GPS, acoustics and sonar show, lane by lane.
    fn listen(&mut self, truth: &[T; CHANNELS], dt: f64, flying: T) {
        self.abreast.clear();
        for (lane, soundings) in self.soundings.iter_mut().enumerate() {
            if flying.part(lane) < 0.5 {
                continue;
            }
            self.heard.clear();
            let own: [f64; CHANNELS] = std::array::from_fn(|c| truth[c].part(lane));
            soundings.listen(&own, dt, &mut self.heard);
            for &(channel, value, _) in &self.heard {
                let place = self.abreast.iter().position(|(known, _)| *known == channel);
                let place = place.unwrap_or_else(|| {
                    self.abreast.push((channel, [f64::NAN; LANES]));
                    self.abreast.len() - 1
                });
                self.abreast[place].1[lane] = value;
            }
        }
        // The bearing of a beam comes before its range, whoever hears which.
        let range = |channel: usize| instrument_of(channel) == RANGE;
        self.abreast.sort_by_key(|&(channel, _)| range(channel));
        for &(channel, values) in &self.abreast {
            self.samples.push((channel, flying.join(|lane| values[lane]), 0.0));
        }
    }

    /// Mean normalised innovation squared, the samples that were taken, and those that were refused: over all channels,
    /// then per kind of sensor.
    pub fn consistency(&self) -> [[T; 3]; 1 + KINDS.len()] {
        std::array::from_fn(|k| {
            let kind = k.checked_sub(1);
            let zero = self.ages[0].zero();
            let [mut sum, mut taken, mut refused] = [zero; 3];
            let watches = self.filter.watches().iter().enumerate();
            for (_, watch) in watches.filter(|(c, _)| kind.is_none_or(|kind| instrument_of(*c) == kind)) {
                sum += watch.sum;
                taken += watch.taken;
                refused += watch.refused;
            }
            [sum / taken, taken, refused]
        })
    }
}
