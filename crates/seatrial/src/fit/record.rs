//! A trial as the model sees it: inputs and measurements on a uniform time base, and the parts of it that are simulated.
//!
//! Commands and wrenches are held from sample to sample (zero-order hold), the current is linear in between.

use crate::description::vehicle_file::Environment;
use crate::fit::criterion::CHANNELS;
use crate::model::current::Current;
use crate::model::integrate::State;
use crate::number::algebra::Vec3;
use crate::number::real::Real;

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
    /// Where the surface is, m down of the origin of its positions; all is under water where nothing states it.
    pub surface: Option<f64>,
    /// What the motors do, where that is the same for all candidates ([`Record::play`]).
    pub played: Option<Played>,
}

impl Record {
    /// The recorded current, and `added` to it, at a fraction of the interval after sample `k`.
    #[inline(always)]
    pub(super) fn current<T: Real>(
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
        let mut current = Current { velocity: [unit.zero(); 3], rate: [unit.zero(); 3], pressed: None };
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

/// A motor at the end of a run: all that a run which goes on from there must know of it.
#[derive(Clone, Debug, PartialEq)]
pub struct MotorMemory<T> {
    /// Output of the rate limit, input of the lag.
    pub ramp: T,
    /// Output of the lag.
    pub signal: T,
    /// Time from one entry of `past` to the next, s.
    pub spacing: f64,
    /// What the dead time holds back, newest first: behind a rate limit the ramp at these times, without one the command
    /// during the step that ends there. Empty without dead time.
    pub past: Vec<T>,
}

impl MotorMemory<f64> {
    /// The ramp so many seconds before the end, linear between the entries.
    pub fn ramp(&self, ago: f64) -> f64 {
        let place = ago / self.spacing;
        let at = |i: usize| self.past.get(i).or(self.past.last()).copied().unwrap_or(self.ramp);
        let whole = (place + 1e-6).floor();
        let share = (place - whole).max(0.0);
        // A run of the same step meets the entries themselves, whatever its time base's last digit is.
        let share = if share < 1e-6 { 0.0 } else { share };
        at(whole as usize) + share * (at(whole as usize + 1) - at(whole as usize))
    }

    /// The command during a step, so many seconds before the end in its middle.
    pub fn command(&self, ago: f64) -> f64 {
        self.past.get((ago / self.spacing) as usize).or(self.past.last()).copied().unwrap_or(self.ramp)
    }
}

/// Where the motors are when a run begins.
#[derive(Clone, Debug)]
pub enum MotorStart {
    /// As the record's earlier commands leave them (steady under the first one at its beginning).
    Recorded,
    /// At these signals, held by the command before the record.
    Held(Vec<f64>),
    /// As an earlier run left them.
    Carried(Vec<MotorMemory<f64>>),
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
    /// A steady current besides the record's, NED, m/s.
    pub current: Vec3<f64>,
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
    /// The segment's own state and current, in the kind of `unit`.
    #[inline(always)]
    pub fn of(segment: &Segment, unit: T) -> Self {
        let State { position, attitude, nu } = segment.state;
        let position = position.map(|x| unit.splat(x));
        let attitude = attitude.map(|x| unit.splat(x));
        // Still water stays still water.
        let current = (segment.current != [0.0; 3]).then(|| segment.current.map(|x| unit.splat(x)));
        Self { state: State { position, attitude, nu: nu.map(|x| unit.splat(x)) }, current }
    }
}

/// Signals of all motors on a record, `[step][start, middle, end][actuator]`, each with the force that a
/// measured table makes of it.
#[derive(Clone, Debug)]
pub struct Played {
    pub(super) substeps: usize,
    pub(super) actuators: usize,
    pub(super) signals: Vec<(f64, Option<f64>)>,
}

impl Played {
    /// Signals and forces at the start (`half` = 0), in the middle (1) or at the end (2) of step `s` of sample `k`.
    #[inline(always)]
    pub(super) fn at(&self, k: usize, s: usize, half: usize) -> &[(f64, Option<f64>)] {
        let first = ((k * self.substeps + s) * 3 + half) * self.actuators;
        &self.signals[first..first + self.actuators]
    }
}
