//! Many cases of a flight: gain sets, vehicles, currents, seeds and faults, eight to a vector, on all threads.
//!
//! A case's result is a function of the case alone, whatever its neighbours, lane and thread. The quadratic programme
//! of the allocation has no lanes, nor have narrow instruction sets here: with them every case flies by itself.
//!
//! Tests: `tests/closed_loop.rs` (lanes equal single flights).

use super::aboard::Split;
use super::case::{Flight, Setting};
use super::faults::{ActuatorFault, Faults, table};
use super::fly;
use super::log::Log;
use super::summary::Summary;
use super::waves::{Harmonic, Sea};
use crate::control::allocation::{AllocationTable, Allocator, Method};
use crate::control::autopilot::Autopilot;
use crate::control::navigation::{CHANNELS, GROUPS, GroupOutage, Outage};
use crate::description::Description;
use crate::description::assembly::Structure;
use crate::error::Error;
use crate::model::integrate::State;
use crate::model::vehicle::{Mode, Vehicle};
use crate::number::lanes::{LANES, level};
use fearless_simd::{Level, Simd, SimdBase, f64x8};
use rayon::prelude::*;
use std::sync::atomic::AtomicBool;

/// One case: what differs between flights.
#[derive(Clone, Debug)]
pub struct Case {
    /// Values of the sought coefficients of the vehicle that flies.
    pub coefficients: Vec<f64>,
    /// Values of the sought tunable numbers of the autopilot.
    pub tunables: Vec<f64>,
    /// Where the flight begins.
    pub state: State<f64>,
    /// Mean of the current, NED, m/s.
    pub current: [f64; 3],
    /// Standard deviation of the current about it, NED, m/s.
    pub turbulence: [f64; 3],
    /// Steady change of the mean, NED, m/s².
    pub current_trend: [f64; 3],
    /// Random walk of the mean, NED, m/s per √s.
    pub current_walk: [f64; 3],
    /// The waves.
    pub sea: Sea,
    /// Seed of the sensors' noise and of the water's motion, a whole number below 2⁵³.
    pub seed: u64,
    /// What fails.
    pub faults: Vec<ActuatorFault>,
    /// Times without samples, besides those of all cases.
    pub outages: Vec<Outage>,
    /// Offset of each channel of the sensors in its standard deviations; `None`: drawn from the seed. All cases have one or none.
    pub offsets: Option<[f64; CHANNELS]>,
    /// Set points of the trial, `[named][time]`.
    pub set_points: Vec<f64>,
    /// Base and scale of each corridor of the trial.
    pub scales: Vec<[f64; 2]>,
}

/// The cases of a flight.
pub struct Cases<'a> {
    /// Indices of the coefficients that vary.
    pub coefficients: &'a [usize],
    /// Indices of the tunable numbers that vary.
    pub tunables: &'a [usize],
    /// The cases.
    pub cases: &'a [Case],
}

/// What is kept of a case.
#[derive(Clone)]
pub struct Outcome {
    /// Its figures.
    pub summary: Summary<f64>,
    /// Its log; empty where none was asked for.
    pub log: Log<f64>,
}

impl Flight<'_> {
    /// Flies all cases, with logs or without.
    ///
    /// # Errors
    /// [`Error::Interrupted`], what the autopilot cannot do, or a forced instruction set that is not there.
    pub fn fly(&self, cases: &Cases<'_>, logs: bool, stop: &AtomicBool) -> Result<Vec<Outcome>, Error> {
        let (name, level) = level()?;
        let structure = Structure::new(self.description, cases.coefficients);
        let alone = !["avx512", "avx2", "neon"].contains(&name)
            || cases.cases.len() == 1
            || self.settings.file.allocation.method == Method::Quadratic;
        let work = Work { cases, structure: &structure, logs, stop };
        let width = if alone { 1 } else { LANES };
        let groups: Vec<Vec<Outcome>> = (0..cases.cases.len())
            .step_by(width)
            .collect::<Vec<_>>()
            .par_iter()
            .map(|&first| match alone {
                true => self.one(&work, first).map(|outcome| vec![outcome]),
                false => on_level(level, self, &work, first),
            })
            .collect::<Result<_, Error>>()?;
        Ok(groups.into_iter().flatten().collect())
    }

    fn one(&self, work: &Work<'_>, k: usize) -> Result<Outcome, Error> {
        let cases = work.cases;
        let case = &cases.cases[k];
        let mut values = self.description.coefficients.clone();
        for (&index, &value) in cases.coefficients.iter().zip(&case.coefficients) {
            values[index] = value;
        }
        let mut tunables = self.settings.tunables.clone();
        for (&index, &value) in cases.tunables.iter().zip(&case.tunables) {
            tunables[index] = value;
        }
        let (from, signal) = table(&case.faults, self.description.actuators.len());
        let setting = Setting {
            state: case.state,
            current: case.current,
            turbulence: case.turbulence,
            current_trend: case.current_trend,
            current_walk: case.current_walk,
            waves: case.sea.harmonics(case.seed as f64, self.environment.g_m_s2),
            seed: case.seed as f64,
            faults: Faults::new(from, signal, !case.faults.is_empty()),
            outages: case.outages.iter().map(|o| (o.group, [o.from, o.until])).collect(),
            offsets: case.offsets,
            set_points: case.set_points.clone(),
            scales: case.scales.clone(),
        };
        let (summary, log) = self.run(work, (&values, &tunables), &setting, Allocator::single)?;
        Ok(self.outcome(summary, log))
    }

    /// What is kept of a case: the log of a trial to its end, that of a mission to the mission's.
    fn outcome(&self, summary: Summary<f64>, log: Log<f64>) -> Outcome {
        let ends = summary.duration.is_finite() && !self.is_trial();
        let last = (summary.duration / self.settings.file.period_s).round();
        Outcome { log: log.first(if ends { last as usize + 1 } else { usize::MAX }), summary }
    }

    /// Eight cases from `first` on.
    #[inline(always)]
    fn eight<S: Simd>(&self, simd: S, work: &Work<'_>, first: usize) -> Result<Vec<Outcome>, Error> {
        let cases = work.cases;
        let case = |lane: usize| &cases.cases[(first + lane).min(cases.cases.len() - 1)];
        let lanes = |read: &dyn Fn(&Case) -> f64| f64x8::from_fn(simd, |lane| read(case(lane)));
        let splat =
            |values: &[f64]| -> Vec<f64x8<S>> { values.iter().map(|&x| simd.splat_f64x8(x)).collect() };
        let mut values = splat(&self.description.coefficients);
        for (i, &index) in cases.coefficients.iter().enumerate() {
            values[index] = lanes(&|case| case.coefficients[i]);
        }
        let mut tunables = splat(&self.settings.tunables);
        for (i, &index) in cases.tunables.iter().enumerate() {
            tunables[index] = lanes(&|case| case.tunables[i]);
        }
        let actuators = self.description.actuators.len();
        let of = |lane: usize| table(&case(lane).faults, actuators);
        let faults: Vec<(Vec<f64>, Vec<f64>)> = (0..LANES).map(of).collect();
        let any = (0..LANES).any(|lane| !case(lane).faults.is_empty());
        let (named, corridors) =
            (self.trial.named.len() * self.trial.times.len(), self.trial.corridors.len());
        let setting = Setting {
            turbulence: std::array::from_fn(|i| lanes(&|case| case.turbulence[i])),
            current_trend: std::array::from_fn(|i| lanes(&|case| case.current_trend[i])),
            current_walk: std::array::from_fn(|i| lanes(&|case| case.current_walk[i])),
            waves: waves(simd, &case, self.environment.g_m_s2),
            outages: outages(simd, &case),
            offsets: case(0)
                .offsets
                .map(|_| std::array::from_fn(|c| lanes(&|case| case.offsets.map_or(0.0, |own| own[c])))),
            set_points: (0..named).map(|i| lanes(&|case| case.set_points[i])).collect(),
            scales: (0..corridors)
                .map(|c| std::array::from_fn(|i| lanes(&|case| case.scales[c][i])))
                .collect(),
            state: State {
                position: std::array::from_fn(|i| lanes(&|case| case.state.position[i])),
                attitude: std::array::from_fn(|i| lanes(&|case| case.state.attitude[i])),
                nu: std::array::from_fn(|i| lanes(&|case| case.state.nu[i])),
            },
            current: std::array::from_fn(|i| lanes(&|case| case.current[i])),
            seed: lanes(&|case| case.seed as f64),
            faults: Faults::new(
                (0..actuators).map(|i| f64x8::from_fn(simd, |lane| faults[lane].0[i])).collect(),
                (0..actuators).map(|i| f64x8::from_fn(simd, |lane| faults[lane].1[i])).collect(),
                any,
            ),
        };
        let (summary, log) = self.run(work, (&values, &tunables), &setting, Allocator::new)?;
        let outcome = |lane: usize| {
            let summary = summary.read(|x| x[lane]);
            let log = Log { values: log.values.iter().map(|x| x[lane]).collect(), rows: log.rows };
            self.outcome(summary, log)
        };
        Ok((0..LANES.min(cases.cases.len() - first)).map(outcome).collect())
    }

    #[inline(always)]
    fn run<T: Split>(
        &self,
        work: &Work<'_>,
        (values, tunables): (&[T], &[T]),
        setting: &Setting<T>,
        allocator: AllocatorOf<T>,
    ) -> Result<(Summary<T>, Log<T>), Error> {
        let vehicle =
            Vehicle::new(self.description, work.structure, values, self.environment, [Mode::Free; 6])
                .beneath(self.description, self.environment.g_m_s2, self.surface);
        let autopilot = Autopilot::new(self.settings, self.model, self.mission, tunables)?
            .by_estimate(self.navigation.is_some());
        let mut log = Log { values: Vec::new(), rows: 0 };
        let wanted = work.logs.then_some(&mut log);
        let allocator = allocator(self.model, autopilot.model(), &self.settings.file.allocation)?;
        let summary = fly(self, &vehicle, &autopilot, (setting, allocator, wanted), work.stop)?;
        Ok((summary, log))
    }
}

/// The outages of eight cases, the n-th of a group abreast; a lane without one has it at infinity.
#[inline(always)]
fn outages<'a, S: Simd>(simd: S, case: &impl Fn(usize) -> &'a Case) -> Vec<GroupOutage<f64x8<S>>> {
    let own = |lane: usize, group: usize| case(lane).outages.iter().filter(move |o| o.group == group);
    let mut abreast = Vec::new();
    for group in 0..GROUPS {
        let most = (0..LANES).map(|lane| own(lane, group).count()).max().unwrap_or(0);
        for place in 0..most {
            let end = |read: fn(&Outage) -> f64| {
                f64x8::from_fn(simd, |lane| own(lane, group).nth(place).map_or(f64::INFINITY, read))
            };
            abreast.push((group, [end(|o| o.from), end(|o| o.until)]));
        }
    }
    abreast
}

/// The waves of eight cases, harmonic by harmonic abreast; empty where all are calm.
#[inline(always)]
fn waves<'a, S: Simd>(simd: S, case: &impl Fn(usize) -> &'a Case, g: f64) -> Vec<Harmonic<f64x8<S>>> {
    let own: [_; LANES] = std::array::from_fn(|lane| case(lane).sea.harmonics(case(lane).seed as f64, g));
    let most = own.iter().map(Vec::len).max().unwrap_or(0);
    let abreast = |i: usize, read: &dyn Fn(&Harmonic<f64>) -> f64| {
        f64x8::from_fn(simd, |lane| read(own[lane].get(i).unwrap_or(&Harmonic::STILL)))
    };
    (0..most)
        .map(|i| Harmonic {
            omega: abreast(i, &|h| h.omega),
            number: abreast(i, &|h| h.number),
            direction: [abreast(i, &|h| h.direction[0]), abreast(i, &|h| h.direction[1])],
            phase: abreast(i, &|h| h.phase),
            speed: abreast(i, &|h| h.speed),
        })
        .collect()
}

/// How the allocator of a number type is made.
type AllocatorOf<T> = fn(&Description, &Vehicle<T>, &AllocationTable) -> Result<Allocator<T>, Error>;

/// What is asked of a batch.
struct Work<'a> {
    cases: &'a Cases<'a>,
    structure: &'a Structure,
    logs: bool,
    stop: &'a AtomicBool,
}

/// Compiles the closed loop once per wide instruction set; on the others lanes do not pay for their build.
fn on_level(level: Level, flight: &Flight<'_>, work: &Work<'_>, first: usize) -> Result<Vec<Outcome>, Error> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || flight.eight(simd, work, first),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || flight.eight(simd, work, first),
            );
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(
            #[inline(always)]
            || flight.eight(simd, work, first),
        );
    }
    Err(Error::simulation(format!("{level:?}: no lanes for this instruction set")))
}
