//! Navigation filters aboard: the autopilot is told their estimate in place of what the sensors show.
//!
//! Every case has a filter of its own, one after the other where cases fly in lanes: a filter's vectors run along its
//! covariance, not along the cases.
//!
//! Tests: `tests/flight/test_navigation.py`.

use super::acoustics::Soundings;
use super::case::{Flight, Setting};
use crate::control::navigation::{CHANNELS, Measurement};
use crate::control::navigation_filter::fitting::instrument_of;
use crate::control::navigation_filter::{Fitting, KIND_OF, KINDS, NavigationFilter, Told};
use crate::error::Error;
use crate::filter::innovation::Watch;
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

/// One filter per lane.
pub struct Aboard {
    filters: Vec<NavigationFilter>,
    soundings: Vec<Soundings>,
    ages: Vec<[f64; CHANNELS]>,
    told: Vec<Measurement<f64>>,
    samples: Vec<Told>,
    commands: Vec<f64>,
    signals: Vec<f64>,
}

impl Aboard {
    /// The filters of all lanes on the vehicle that the autopilot believes in.
    ///
    /// # Errors
    /// A forced instruction set that is not there.
    pub fn new<T: Split>(
        flight: &Flight<'_>,
        fitting: &Fitting,
        setting: &Setting<T>,
    ) -> Result<Self, Error> {
        let (model, acoustics, lanes) = (flight.model, flight.acoustics, T::PARTS);
        let actuators = model.actuators.len();
        let begun = |lane: usize| setting.offsets.as_ref().map(|own| [own[0].part(lane), own[1].part(lane)]);
        Ok(Self {
            filters: (0..lanes)
                .map(|_| NavigationFilter::new(model, fitting.clone()))
                .collect::<Result<_, _>>()?,
            soundings: (0..lanes)
                .map(|lane| {
                    Soundings::new(acoustics, &fitting.landmarks, (setting.seed.part(lane), begun(lane)))
                })
                .collect(),
            ages: vec![[f64::INFINITY; CHANNELS]; lanes],
            told: vec![Measurement::nothing(0.0); lanes],
            samples: Vec::with_capacity(CHANNELS + 5 + 2 * acoustics.landmarks.len()),
            commands: vec![0.0; actuators],
            signals: vec![0.0; actuators],
        })
    }

    /// The estimates `elapsed` seconds later, from what the sensors show; `commands` have held since, `signals` are what
    /// the actuators are measured at; a control period is `dt`. The filter of a case that has ended stands still: what it
    /// found does not depend on how long its neighbours fly.
    #[inline(always)]
    pub fn tell<T: Split>(
        &mut self,
        (truth, measured): (&[T; CHANNELS], &Measurement<T>),
        (commands, signals): (&[T], Option<&[T]>),
        (elapsed, dt): (f64, f64),
        flying: Option<T>,
    ) -> Measurement<T> {
        for lane in 0..T::PARTS {
            if flying.is_some_and(|flying| flying.part(lane) < 0.5) {
                continue;
            }
            let mut shown = Measurement::nothing(0.0);
            for c in 0..CHANNELS {
                shown.channels[c] = measured.channels[c].part(lane);
                shown.age[c] = measured.age[c].part(lane);
            }
            (shown.battery, shown.voltage) = (measured.battery.part(lane), measured.voltage);
            for (i, command) in commands.iter().enumerate() {
                self.commands[i] = command.part(lane);
                self.signals[i] = signals.map_or(f64::NAN, |s| s[i].part(lane));
            }
            let truth = std::array::from_fn(|c| truth[c].part(lane));
            self.one(lane, (&truth, &shown), (elapsed, dt));
        }
        let (told, unit) = (&self.told, measured.battery);
        let mut all = *measured;
        for c in 0..CHANNELS {
            all.channels[c] = unit.join(|lane| told[lane].channels[c]);
            all.age[c] = unit.join(|lane| told[lane].age[c]);
        }
        for i in 0..6 {
            all.disturbance[i] = unit.join(|lane| told[lane].disturbance[i]);
        }
        all
    }

    fn one(
        &mut self,
        lane: usize,
        (truth, shown): (&[f64; CHANNELS], &Measurement<f64>),
        (elapsed, dt): (f64, f64),
    ) {
        let (filter, ages) = (&mut self.filters[lane], &mut self.ages[lane]);
        self.samples.clear();
        for c in 0..CHANNELS {
            // A sample that has arrived is younger than the last one has become.
            if shown.age[c] < ages[c] + 0.5 * elapsed.max(1e-3) && shown.age[c].is_finite() {
                let latency = filter.fitting().instruments[KIND_OF[c]].map_or(0.0, |i| i.latency);
                self.samples.push((c, shown.channels[c], (shown.age[c] - latency).max(0.0)));
            }
        }
        *ages = shown.age;
        self.soundings[lane].listen(truth, dt, &mut self.samples);
        filter.step(&self.samples, (&self.commands, Some(&self.signals)), (shown.voltage, elapsed));
        self.told[lane] = filter.told(shown);
    }

    /// Mean normalised innovation squared, the samples that were taken, and those that were refused: over all channels,
    /// then per kind of sensor.
    pub fn consistency<T: Split>(&self, unit: T) -> [[T; 3]; 1 + KINDS.len()] {
        let sums = |lane: usize, kind: Option<usize>| {
            let watches = self.filters[lane].watches().iter().enumerate();
            let own = watches.filter(|(c, _)| kind.is_none_or(|kind| instrument_of(*c) == kind));
            let add = |[sum, taken, refused]: [f64; 3], (_, w): (usize, &Watch)| {
                [sum + w.sum, taken + w.taken as f64, refused + w.refused as f64]
            };
            let [sum, taken, refused] = own.fold([0.0; 3], add);
            [sum / taken, taken, refused]
        };
        std::array::from_fn(|k| std::array::from_fn(|i| unit.join(|lane| sums(lane, k.checked_sub(1))[i])))
    }
}
