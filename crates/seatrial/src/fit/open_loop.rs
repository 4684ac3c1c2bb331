//! Open loop: recorded commands in, motion out; one vehicle, or candidates × segments × threads.
//!
//! A [`Record`] is a trial on a uniform time base; commands and wrenches are held from sample to sample
//! (zero-order hold), the current is linear in between. A [`Segment`] is a part of it that starts from
//! a measured state. One step per stage: `substeps` equal steps per sample.
//!
//! Tests: `tests/laws.rs`, `tests/scalars.rs` (lanes equal `f64`, a candidate is alone in its result).

use crate::error::Error;
use crate::fit::criterion::Criterion;
use crate::fit::divergence::is_sound;
use crate::fit::motors::Motors;
use crate::fit::observation::Shown;
use crate::fit::record::{MotorMemory, Record, Segment, Start};
use crate::model::integrate::{State, step};
use crate::model::kinematics::rotation;
use crate::model::vehicle::{Instant, Vehicle, hand_on};
use crate::number::algebra::Vec3;
use crate::number::real::Real;
use std::sync::atomic::{AtomicBool, Ordering};

/// After so many steps within a sample the caller may stop the run.
pub(super) const STEPS_BETWEEN_LOOKS: usize = 4096;

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
    /// The motors at the end.
    pub motors: Vec<MotorMemory<T>>,
    /// Where the run left what a vehicle can do, in any lane.
    pub unsound: Option<Unsound<T>>,
}

/// Where a run left what a vehicle can do.
#[derive(Clone, Debug)]
pub struct Unsound<T> {
    /// Steps of the integration from the start of the run.
    pub steps: usize,
    /// The state before the last of them.
    pub last: State<T>,
}

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self { states: Vec::new(), signals: Vec::new(), tau: Vec::new(), motors: Vec::new(), unsound: None }
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
    let h = record.dt / substeps as f64;
    let mut course = Course::new(vehicle, record, segment, substeps, start.current, state.nu[0].zero());
    for k in segment.start..segment.stop {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        for s in 0..substeps {
            // Between two samples there may be a day.
            if s % STEPS_BETWEEN_LOOKS == STEPS_BETWEEN_LOOKS - 1 && stop.load(Ordering::Relaxed) {
                return Err(Error::Interrupted);
            }
            course.begin(k, s);
            if s == 0 {
                if k == segment.start {
                    state.replay(vehicle, &course.instants[0]);
                }
                observe(observer, k, segment.start, (vehicle, &state), &course);
                if k + 1 == segment.stop {
                    if let Observer::Track(track) = observer {
                        track.motors = course.motors.memory(k);
                    }
                    return Ok(());
                }
            }
            course.go_on(k, s);
            let before = state;
            state = step(vehicle, &state, h, &course.instants);
            hand_on(&mut course.instants);
            if let Observer::Track(track) = observer
                && track.unsound.is_none()
                && !is_sound(&state)
            {
                let steps = (k - segment.start) * substeps + s + 1;
                track.unsound = Some(Unsound { steps, last: before });
            }
        }
    }
    Ok(())
}

/// What acts on a vehicle along a record, step by step.
pub(super) struct Course<'a, T> {
    /// The vehicle's motors.
    pub motors: Motors<'a, T>,
    /// The start, the middle and the end of the step.
    pub instants: [Instant<T>; 3],
    record: &'a Record,
    substeps: usize,
    /// A current besides the record's, NED, m/s.
    current: Option<Vec3<T>>,
    unit: T,
}

impl<'a, T: Real> Course<'a, T> {
    /// The course as a segment meets it.
    #[inline(always)]
    pub fn new(
        vehicle: &'a Vehicle<T>,
        record: &'a Record,
        segment: &Segment,
        substeps: usize,
        current: Option<Vec3<T>>,
        unit: T,
    ) -> Self {
        let motors = Motors::new(vehicle, record, segment, substeps, unit);
        Self { motors, instants: Default::default(), record, substeps, current, unit }
    }

    /// The same with motors that follow those of a course in plain numbers.
    #[inline(always)]
    pub fn following(
        vehicle: &'a Vehicle<T>,
        record: &'a Record,
        segment: &Segment,
        substeps: usize,
        current: Option<Vec3<T>>,
        unit: T,
    ) -> Self {
        let motors = Motors::following(vehicle, record, segment, substeps, unit);
        Self { motors, instants: Default::default(), record, substeps, current, unit }
    }

    /// Step `s` of sample `k` begins: all that acts but the thrusts of its middle and its end.
    #[inline(always)]
    pub fn begin(&mut self, k: usize, s: usize) {
        self.motors.begin(k, s);
        self.act(k, s);
    }

    /// The same with the motors of a course in plain numbers.
    #[inline(always)]
    pub fn begin_with(&mut self, plain: &Course<'a, f64>, k: usize, s: usize) {
        self.motors.follow(&plain.motors);
        self.act(k, s);
    }

    /// What acts as step `s` of sample `k` begins, at the present signals.
    #[inline(always)]
    fn act(&mut self, k: usize, s: usize) {
        let record = self.record;
        if s == 0 {
            let tau = record.tau.get(k).copied().unwrap_or_default();
            for instant in &mut self.instants {
                instant.tau = tau;
            }
        }
        // At a sample wrench and voltage change; an ideal motor's signal jumps at any step.
        if s == 0 || self.motors.any_ideal {
            self.motors.thrust(k, &mut self.instants[0]);
        }
        for (i, instant) in self.instants.iter_mut().enumerate() {
            let fraction = (s as f64 + 0.5 * i as f64) / self.substeps as f64;
            instant.current = record.current(k, fraction, self.unit, self.current.as_ref());
            let node = (2 * (k * self.substeps + s) + i).min(record.measured.len().saturating_sub(1));
            if let Some(measured) = record.measured.get(node) {
                instant.measured = *measured;
            }
        }
    }

    /// The thrusts in the middle and at the end of step `s` of sample `k`.
    #[inline(always)]
    pub fn go_on(&mut self, k: usize, s: usize) {
        for half in 1..3 {
            self.half(k, s, half);
        }
    }

    /// The thrusts in the middle (`half` = 1) or at the end (2) of step `s` of sample `k`.
    #[inline(always)]
    pub fn half(&mut self, k: usize, s: usize, half: usize) {
        self.motors.go_on(k, s, half);
        self.motors.thrust(k, &mut self.instants[half]);
    }

    /// The same with the motors of a course in plain numbers.
    #[inline(always)]
    pub fn half_with(&mut self, plain: &Course<'a, f64>, k: usize, half: usize) {
        self.motors.follow(&plain.motors);
        self.motors.thrust(k, &mut self.instants[half]);
    }
}

#[inline(always)]
fn observe<T: Real>(
    observer: &mut Observer<'_, T>,
    k: usize,
    start: usize,
    (vehicle, state): (&Vehicle<T>, &State<T>),
    course: &Course<'_, T>,
) {
    match observer {
        Observer::Criterion(criterion) => {
            if k > start {
                criterion.add(k, state);
            }
        }
        Observer::Shown(shown) => shown.add(state),
        Observer::Track(track) => {
            let instant = &course.instants[0];
            let r = rotation(&state.attitude);
            let nu_r = match &instant.current {
                Some(current) => current.relative(&r, &state.nu).nu,
                None => state.nu,
            };
            track.states.push(*state);
            track.tau.push(vehicle.wrench_at((&state.position, &r), (&state.nu, &nu_r), instant));
            track.signals.push(course.motors.signals.clone());
        }
    }
}
