//! The batch: many candidates × many segments × threads, eight candidates to a vector.
//!
//! Every (candidate group, segment) pair is a task of its own and its result is stored by index, so
//! neither batch size, lane neighbours nor threads change a candidate's result. A diverged candidate is
//! a number, infinity.

use crate::description::Description;
use crate::description::assembly::Structure;
use crate::error::Error;
use crate::fit::criterion::{CHANNELS, Criterion, Loss};
use crate::fit::open_loop::{Observer, Track, fly};
use crate::fit::record::{MotorMemory, MotorStart, Record, Segment, Start};
use crate::model::integrate::State;
use crate::model::vehicle::{Mode, Vehicle};
use crate::number::lanes::{LANES, level};
use crate::number::real::Real;
use fearless_simd::{Level, Simd, SimdBase, f64x8};
use rayon::prelude::*;
use std::sync::atomic::AtomicBool;

/// Candidates: values of the coefficients `sought` (indices), row per candidate.
#[derive(Clone, Copy)]
pub struct Candidates<'a> {
    /// Indices of the coefficients that vary.
    pub sought: &'a [usize],
    /// `values[candidate * sought.len() + i]`.
    pub values: &'a [f64],
    /// Number of candidates.
    pub count: usize,
}

/// The fixed part of a batch.
pub struct Batch<'a> {
    /// The vehicle.
    pub description: &'a Description,
    /// The trials.
    pub records: &'a [Record],
    /// The parts of them that are simulated.
    pub segments: &'a [Segment],
    /// Modes of the degrees of freedom.
    pub modes: [Mode; 6],
    /// Steps per sample.
    pub substeps: usize,
}

/// A run of one candidate through one segment.
pub type Run = Track<f64>;

/// What is asked of a batch: the criterion when there is a loss, else the runs.
struct Work<'a> {
    candidates: Candidates<'a>,
    loss: Option<Loss>,
    stop: &'a AtomicBool,
}

/// The result of one candidate on one segment.
#[derive(Clone, Default)]
struct Outcome {
    track: Run,
    sums: [f64; CHANNELS],
}

impl Batch<'_> {
    /// Sums of the loss, `[candidate][segment][channel]` in one row; infinite where a candidate
    /// diverged.
    ///
    /// # Errors
    /// [`Error::Interrupted`], or a forced instruction set that is not there.
    pub fn errors(
        &self,
        candidates: Candidates<'_>,
        loss: Loss,
        stop: &AtomicBool,
    ) -> Result<Vec<f64>, Error> {
        self.check_observed()?;
        let results = self.run(&Work { candidates, loss: Some(loss), stop })?;
        Ok(results.iter().flat_map(|result| result.sums).collect())
    }

    /// The runs, `[candidate][segment]` in one row.
    ///
    /// # Errors
    /// [`Error::Interrupted`], or a forced instruction set that is not there.
    pub fn tracks(&self, candidates: Candidates<'_>, stop: &AtomicBool) -> Result<Vec<Run>, Error> {
        let results = self.run(&Work { candidates, loss: None, stop })?;
        Ok(results.into_iter().map(|result| result.track).collect())
    }

    /// Every candidate through every segment, `[candidate][segment]` in one row.
    fn run(&self, work: &Work<'_>) -> Result<Vec<Outcome>, Error> {
        let (name, level) = level()?;
        let count = work.candidates.count;
        let structure = Structure::new(self.description, work.candidates.sought);
        let tasks: Vec<(usize, usize)> = (0..count)
            .step_by(LANES)
            .flat_map(|first| (0..self.segments.len()).map(move |s| (first, s)))
            .collect();
        let groups: Vec<Vec<Outcome>> = tasks
            .par_iter()
            .map(|&(first, s)| {
                let last = count.min(first + LANES);
                if name == "fallback" {
                    return (first..last).map(|k| self.one(work, &structure, k, s)).collect();
                }
                on_level(level, self, (work, &structure), first, s)
            })
            .collect::<Result<_, Error>>()?;
        let mut outcomes = vec![Outcome::default(); count * self.segments.len()];
        for (&(first, s), group) in tasks.iter().zip(groups) {
            for (lane, outcome) in group.into_iter().enumerate() {
                outcomes[(first + lane) * self.segments.len() + s] = outcome;
            }
        }
        Ok(outcomes)
    }

    /// Candidate `k` alone through segment `s`, in plain `f64`.
    fn one(&self, work: &Work<'_>, structure: &Structure, k: usize, s: usize) -> Result<Outcome, Error> {
        let width = work.candidates.sought.len();
        let mut values = self.description.coefficients.clone();
        for (i, &index) in work.candidates.sought.iter().enumerate() {
            values[index] = work.candidates.values[k * width + i];
        }
        let (track, sums) = self.fly(work, structure, &values, &self.segments[s])?;
        Ok(Outcome { track, sums: sums.map(finite_or_infinite) })
    }

    /// Eight candidates from `first` on through segment `s`.
    #[inline(always)]
    fn eight<S: Simd>(
        &self,
        simd: S,
        work: &Work<'_>,
        structure: &Structure,
        first: usize,
        s: usize,
    ) -> Result<Vec<Outcome>, Error> {
        let Candidates { sought, values, count } = work.candidates;
        let candidate = |lane: usize| (first + lane).min(count - 1);
        let mut lanes: Vec<f64x8<S>> =
            self.description.coefficients.iter().map(|&x| simd.splat_f64x8(x)).collect();
        for (i, &index) in sought.iter().enumerate() {
            lanes[index] = f64x8::from_fn(simd, |lane| values[candidate(lane) * sought.len() + i]);
        }
        let (track, sums) = self.fly(work, structure, &lanes, &self.segments[s])?;
        let outcome = |lane: usize| Outcome {
            track: lane_of(&track, lane),
            sums: std::array::from_fn(|c| finite_or_infinite(sums[c][lane])),
        };
        Ok((0..LANES.min(count - first)).map(outcome).collect())
    }

    #[inline(always)]
    fn fly<T: Real>(
        &self,
        work: &Work<'_>,
        structure: &Structure,
        values: &[T],
        segment: &Segment,
    ) -> Result<(Track<T>, [T; CHANNELS]), Error> {
        let record = &self.records[segment.record];
        let vehicle = Vehicle::new(self.description, structure, values, record.environment, self.modes)
            .beneath(self.description, record.environment.g_m_s2, record.surface);
        let zero = values[0].zero();
        let mut observer = match work.loss {
            Some(loss) => Observer::Criterion(Criterion::new(
                &record.observed,
                &record.weight,
                segment.start..segment.stop,
                loss,
                zero,
            )),
            None => Observer::Track(Track::default()),
        };
        let start = Start::of(segment, zero);
        fly(&vehicle, record, segment, (self.substeps, &start), &mut observer, work.stop)?;
        Ok(match observer {
            Observer::Criterion(criterion) => (Track::default(), criterion.sums),
            Observer::Track(track) => (track, [zero; CHANNELS]),
            Observer::Shown(_) => (Track::default(), [zero; CHANNELS]),
        })
    }

    /// Refuses segments whose record has no measured channels.
    pub(super) fn check_observed(&self) -> Result<(), Error> {
        if let Some(k) = self.segments.iter().map(|s| s.record).find(|&k| self.records[k].observed.is_empty())
        {
            return Err(Error::simulation(format!(
                "record {k}: the criterion needs measured channels, give observed and weight"
            )));
        }
        Ok(())
    }

    /// The run of the vehicle itself through segment `s`, in plain `f64`.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn track(&self, s: usize, stop: &AtomicBool) -> Result<Run, Error> {
        let itself = Candidates { sought: &[], values: &[], count: 1 };
        let work = Work { candidates: itself, loss: None, stop };
        Ok(self.one(&work, &Structure::new(self.description, &[]), 0, s)?.track)
    }

    /// The same, all of whose numbers are those of a vehicle.
    ///
    /// # Errors
    /// When, in which axis and why the run diverged; [`Error::Interrupted`].
    pub fn sound_track(&self, s: usize, stop: &AtomicBool) -> Result<Run, Error> {
        let run = self.track(s, stop)?;
        match &run.unsound {
            None => Ok(run),
            Some(unsound) => {
                let divergence = self.divergence(s, unsound, stop)?;
                Err(Error::Diverged(divergence.words(self.description)))
            }
        }
    }
}

/// Compiles the batch once per instruction set; the fallback is the plain `f64` model.
fn on_level(
    level: Level,
    batch: &Batch<'_>,
    (work, structure): (&Work<'_>, &Structure),
    first: usize,
    s: usize,
) -> Result<Vec<Outcome>, Error> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || batch.eight(simd, work, structure, first, s),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || batch.eight(simd, work, structure, first, s),
            );
        }
        if let Some(simd) = level.as_sse4_2() {
            return simd.vectorize(
                #[inline(always)]
                || batch.eight(simd, work, structure, first, s),
            );
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(
            #[inline(always)]
            || batch.eight(simd, work, structure, first, s),
        );
    }
    Err(Error::simulation(format!("{level:?}: no lanes for this instruction set")))
}

fn finite_or_infinite(x: f64) -> f64 {
    if x.is_finite() { x } else { f64::INFINITY }
}

/// One lane of a run.
fn lane_of<S: Simd>(track: &Track<f64x8<S>>, lane: usize) -> Run {
    let states = track.states.iter().map(|s| State {
        position: s.position.map(|x| x[lane]),
        attitude: s.attitude.map(|x| x[lane]),
        nu: s.nu.map(|x| x[lane]),
    });
    let memory = |motor: &MotorMemory<f64x8<S>>| MotorMemory {
        ramp: motor.ramp[lane],
        signal: motor.signal[lane],
        spacing: motor.spacing,
        past: motor.past.iter().map(|x| x[lane]).collect(),
    };
    Run {
        states: states.collect(),
        signals: track.signals.iter().map(|row| row.iter().map(|x| x[lane]).collect()).collect(),
        tau: track.tau.iter().map(|row| row.map(|x| x[lane])).collect(),
        motors: track.motors.iter().map(memory).collect(),
        unsound: None,
    }
}

impl Segment {
    /// The whole of record `record` of `len` samples from a state.
    pub fn whole(record: usize, len: usize, state: State<f64>, motors: MotorStart) -> Self {
        Self { record, start: 0, stop: len, state, current: [0.0; 3], motors }
    }
}
