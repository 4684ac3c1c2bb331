//! Open loop: recorded commands in, motion out; one vehicle, or candidates × segments × threads.
//!
//! A [`Record`] is a trial on a uniform time base; commands and wrenches are held from sample to sample
//! (zero-order hold), the current is linear in between. A [`Segment`] is a part of it that starts from
//! a measured state. One step per stage: `substeps` equal steps per sample.
//!
//! Tests: `tests/laws.rs`, `tests/scalars.rs` (lanes equal `f64`, a candidate is alone in its result).

pub mod batch;
pub mod inputs;
pub mod motors;
pub mod sensitivities;

use crate::description::vehicle_file::Environment;
use crate::error::Error;
use crate::fit::criterion::{CHANNELS, Criterion};
use crate::fit::observation::Shown;
use crate::model::current::Current;
use crate::model::integrate::{State, step};
use crate::model::kinematics::rotation;
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::Vec3;
use crate::number::real::Real;
use motors::{Motors, Played};
use std::sync::atomic::{AtomicBool, Ordering};

/// The inputs and measurements of one trial, sampled every `dt` seconds.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// Time between samples, s.
    pub dt: f64,
    /// Number of samples.
    pub len: usize,
    /// Per actuator the signal asked of the motor: limited commands.
    pub commands: Vec<Vec<f64>>,
    /// Per actuator the measured signal, where it replaces the motor.
    pub signals: Vec<Option<Vec<f64>>>,
    /// Supply voltage, V; empty when unknown.
    pub voltage: Vec<f64>,
    /// Wrench from outside the actuators; empty when none.
    pub tau: Vec<[f64; 6]>,
    /// Current, NED, m/s: empty, one, or one per sample.
    pub current: Vec<[f64; 3]>,
    /// `ν` and `ν'` at every half step, for measured axes; empty when none.
    pub measured: Vec<[[f64; 6]; 2]>,
    /// Measured channels; empty when none.
    pub observed: Vec<[f64; CHANNELS]>,
    /// Weights of the measured channels.
    pub weight: Vec<[f64; CHANNELS]>,
    /// Water and gravity of the trial.
    pub environment: Environment,
    /// What the motors do, where that is the same for all candidates ([`Record::play`]).
    pub played: Option<Played>,
}

impl Record {
    /// The recorded current, and `added` to it, at a fraction of the interval after sample `k`.
    #[inline(always)]
    fn current<T: Real>(
        &self,
        k: usize,
        fraction: f64,
        unit: T,
        added: Option<&Vec3<T>>,
    ) -> Option<Current<T>> {
        let n = self.current.len();
        if n == 0 && added.is_none() {
            return None;
        }
        let at = |k: usize| self.current.get(k.min(n.wrapping_sub(1))).copied().unwrap_or_default();
        let (from, to) = (at(k), at(k + 1));
        let mut current = Current { velocity: [unit.zero(); 3], rate: [unit.zero(); 3] };
        for i in 0..3 {
            let change = to[i] - from[i];
            current.velocity[i] = unit.splat(from[i] + fraction * change);
            current.rate[i] = unit.splat(change / self.dt);
            if let Some(added) = added {
                current.velocity[i] += added[i];
            }
        }
        Some(current)
    }
}

/// Where the motors are when a run begins.
#[derive(Clone, Debug)]
pub enum MotorStart {
    /// As the record's earlier commands leave them (steady under the first one at its beginning).
    Recorded,
    /// At these signals, held by the command before the record.
    Held(Vec<f64>),
}

/// A part of a record, simulated from a given state.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Index of the record.
    pub record: usize,
    /// First sample: the given state.
    pub start: usize,
    /// One past the last sample.
    pub stop: usize,
    /// The state at `start`.
    pub state: State<f64>,
    /// The motors at `start`.
    pub motors: MotorStart,
}

/// How a segment begins, in the number type of the run.
#[derive(Clone, Copy, Debug)]
pub struct Start<T> {
    /// The state at the first sample.
    pub state: State<T>,
    /// A current besides the record's, NED, m/s.
    pub current: Option<Vec3<T>>,
}

impl<T: Real> Start<T> {
    /// The segment's own state, in the kind of `unit`.
    #[inline(always)]
    pub fn of(segment: &Segment, unit: T) -> Self {
        let State { position, attitude, nu } = segment.state;
        let position = position.map(|x| unit.splat(x));
        let attitude = attitude.map(|x| unit.splat(x));
        Self { state: State { position, attitude, nu: nu.map(|x| unit.splat(x)) }, current: None }
    }
}

/// What is kept of a run.
pub enum Observer<'a, T> {
    /// Everything, at every sample.
    Track(Track<T>),
    /// The criterion only.
    Criterion(Criterion<'a, T>),
    /// What some channels show.
    Shown(Shown<'a, T>),
}

/// A run, sample by sample.
#[derive(Clone)]
pub struct Track<T> {
    /// State.
    pub states: Vec<State<T>>,
    /// Signal per actuator.
    pub signals: Vec<Vec<T>>,
    /// Wrench of actuators and outside together.
    pub tau: Vec<[T; 6]>,
}

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self { states: Vec::new(), signals: Vec::new(), tau: Vec::new() }
    }
}

/// Runs a vehicle through a segment from its `start`.
///
/// # Errors
/// [`Error::Interrupted`] when `stop` is set.
#[inline(always)]
pub fn fly<T: Real>(
    vehicle: &Vehicle<T>,
    record: &Record,
    segment: &Segment,
    (substeps, start): (usize, &Start<T>),
    observer: &mut Observer<'_, T>,
    stop: &AtomicBool,
) -> Result<(), Error> {
    let mut state = start.state;
    let unit = state.nu[0].zero();
    let h = record.dt / substeps as f64;
    let mut motors = Motors::new(vehicle, record, segment, substeps, unit);
    let mut instants: [Instant<T>; 3] = Default::default();
    for k in segment.start..segment.stop {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let tau = record.tau.get(k).copied().unwrap_or_default();
        for instant in &mut instants {
            instant.tau = tau;
        }
        for s in 0..substeps {
            motors.begin(k, s);
            // At a sample wrench and voltage change; an ideal motor's signal jumps at any step.
            if s == 0 || motors.any_ideal {
                motors.thrust(k, &mut instants[0]);
            }
            for (i, instant) in instants.iter_mut().enumerate() {
                let fraction = (s as f64 + 0.5 * i as f64) / substeps as f64;
                instant.current = record.current(k, fraction, unit, start.current.as_ref());
                let node = (2 * (k * substeps + s) + i).min(record.measured.len().saturating_sub(1));
                if let Some(measured) = record.measured.get(node) {
                    instant.measured = *measured;
                }
            }
            if s == 0 {
                if k == segment.start {
                    state.replay(vehicle, &instants[0]);
                }
                observe(observer, k, segment.start, (vehicle, &state), (&motors, &instants[0]));
                if k + 1 == segment.stop {
                    return Ok(());
                }
            }
            for half in 1..3 {
                motors.go_on(k, s, half);
                motors.thrust(k, &mut instants[half]);
            }
            state = step(vehicle, &state, h, &instants);
            let (first, rest) = instants.split_at_mut(1);
            std::mem::swap(&mut first[0].thrusts, &mut rest[1].thrusts);
            first[0].inflow_free = rest[1].inflow_free;
        }
    }
    Ok(())
}

#[inline(always)]
fn observe<T: Real>(
    observer: &mut Observer<'_, T>,
    k: usize,
    start: usize,
    (vehicle, state): (&Vehicle<T>, &State<T>),
    (motors, instant): (&Motors<'_, T>, &Instant<T>),
) {
    match observer {
        Observer::Criterion(criterion) => {
            if k > start {
                criterion.add(k, state);
            }
        }
        Observer::Shown(shown) => shown.add(state),
        Observer::Track(track) => {
            let nu_r = match &instant.current {
                Some(current) => current.relative(&rotation(&state.attitude), &state.nu).0,
                None => state.nu,
            };
            track.states.push(*state);
            track.tau.push(vehicle.wrench(instant, &nu_r));
            track.signals.push(motors.signals.clone());
        }
    }
}
