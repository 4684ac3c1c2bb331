//! The navigation filter of a vehicle: named channels in, one estimate out, once per control period, in fixed memory.
//!
//! The motors are moved by the commands as those of the simulator are, their wrench moves the process model, and the
//! samples that have arrived since correct it ([`crate::filter`]). The filter begins when attitude is known; of position,
//! depth and velocity it takes what has come by then, and what it was told of the start for the rest.
//!
//! What is told to the autopilot in place of the measurement ([`NavigationFilter::told`]) is fresh while its deviation is
//! below [`told::TRUSTED`]; beyond, it is as old as the last sample of its own sensor, and the autopilot's watch decides.
//!
//! A constant offset of a sensor is no noise: it does not show in innovations, and no number of samples averages it
//! out. That of the gyro is a state of the filter; those of position, depth and attitude are added to the deviations
//! that the filter reports ([`NavigationFilter::deviations`]).
//!
//! In reading order: [`fitting`], what a filter is made of, and [`stated`], how a caller says it; [`NavigationFilter`], the filter at work:
//! `start`, how it begins, `samples`, what it takes, and [`mod@told`], what it says.
//!
//! Tests: `tests/flight/test_navigation.py`, `tests/fixed_memory.rs`.

pub mod fitting;
mod samples;
pub(crate) mod start;
pub mod stated;
pub mod told;

use crate::actuator::motor::Limits;
use crate::description::Description;
use crate::filter::innovation::Watch;
use crate::filter::observation::Observation;
use crate::filter::process::Process;
use crate::filter::swell::Motion;
use crate::filter::tracker::Tracker;
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Vec3, Vec6, splat};
use crate::number::real::Real;
pub use fitting::{Fitting, Instrument, KIND_OF, KINDS, LANDMARKS, Landmark};
pub use stated::Stated;

/// A step of the process is at most so long, s: Runge–Kutta is stable and exact enough for the fastest vehicles.
pub(crate) const LONGEST_STEP: f64 = 0.1;

/// After a pause beyond this the filter begins anew, s: what the vehicle did meanwhile is not known.
const LONGEST_PAUSE: f64 = 60.0;

/// Share of the acceleration of the waves by which the vehicle stays behind the water.
const LEFT_BEHIND: f64 = 0.02;

/// Acceleration of gravity, m/s².
pub const GRAVITY: f64 = 9.81;

/// The first channel of a fix by acoustics.
const FIRST_USBL: usize = 18;

/// One sample: the channel, its value, not a number where a vehicle has none, and its age on arrival beyond the sensor's
/// latency, s.
pub type Told<T = f64> = (usize, T, f64);

/// The filter at work, of one vehicle or of several abreast.
pub struct NavigationFilter<T = f64> {
    tracker: Tracker<T>,
    fitting: Fitting,
    plain: Vehicle<T>,
    /// Diagonal of the mass matrix, and the moment per small angle that turns the vehicle upright, N m/rad.
    masses: Vec6<f64>,
    righting: f64,
    limits: Vec<Limits>,
    drive: Drive<T>,
    targets: Vec<T>,
    signals: Vec<T>,
    nodes: Vec<Instant<T>>,
    h: f64,
    watches: Vec<Watch<T>>,
    /// The last value of every channel before the filter has begun.
    first: Vec<T>,
    /// Time since the last sample of every channel, s.
    silent: Vec<T>,
    /// What every channel observes.
    observed: Vec<Option<Observation<T>>>,
    /// Bearing of the beam on every surface, rad.
    beams: Vec<T>,
    /// The waves at the depth of now.
    waves: Motion<T>,
    /// 1 where the filter has begun, 0 elsewhere.
    begun: T,
    /// Time since it began, how long it must have run before it may take itself for lost, and for how long two instruments
    /// have contradicted it, s.
    age: T,
    patience: T,
    doubted: T,
    /// Where it begins unless a fix says it, NED, and the deviation of that, m.
    place: Vec3<T>,
    far: Vec3<T>,
    /// How often the filter had to begin anew.
    pub restarts: T,
}

impl NavigationFilter {
    /// The filter of a vehicle before its first sample.
    pub fn new(description: &Description, fitting: Fitting) -> Self {
        Self::new_in(description, fitting, 0.0)
    }
}

impl<T: Real> NavigationFilter<T> {
    /// [`NavigationFilter::new`] in the kind of `unit`.
    pub fn new_in(description: &Description, fitting: Fitting, unit: T) -> Self {
        let (zero, unknown) = (unit.zero(), unit.splat(f64::NAN));
        let process = Process::new_in(description, unit);
        let (plain, nominal) = (Vehicle::nominal_in(description, zero), Vehicle::nominal(description));
        let steps = (fitting.period / LONGEST_STEP - 1e-9).ceil().max(1.0) as usize;
        let h = fitting.period / steps as f64;
        let latest = fitting.instruments.iter().flatten().map(|i| i.latency).fold(0.0, f64::max);
        let latest = latest + fitting.longest_age;
        let kept = (latest / fitting.period - 1e-9).ceil() as usize;
        let count = description.actuators.len();
        let channels = LANDMARKS + 2 * fitting.landmarks.len();
        let node = Instant {
            thrusts: Vec::with_capacity(plain.actuators.len()),
            deflections: Vec::with_capacity(plain.fins.len()),
            inflow_free: Some([zero; 6]),
            ..Instant::default()
        };
        let nodes = vec![node; 2 * steps + 1];
        let mut filter = Self {
            tracker: Tracker::new_in((process, fitting.noise, fitting.gate), kept, unit),
            drive: Drive::new(&plain, h, UnlimitedDelay::InTheDrive, |i| plain.motor(i).steady(zero)),
            limits: description.actuators.iter().map(|a| a.limits).collect(),
            targets: vec![zero; count],
            signals: vec![zero; count],
            nodes,
            h,
            watches: vec![Watch::new(unit); channels],
            first: vec![unknown; channels],
            silent: vec![unit.splat(f64::INFINITY); channels],
            observed: (0..channels).map(|channel| fitting.observed(channel, zero)).collect(),
            beams: vec![zero; fitting.landmarks.len()],
            waves: Motion::none(unit),
            begun: zero,
            age: zero,
            doubted: zero,
            patience: unit.splat(start::PATIENCE[0]),
            place: splat(unit, &fitting.start.0),
            far: [unit.splat(fitting.start.1); 3],
            restarts: zero,
            masses: std::array::from_fn(|i| nominal.mass_matrix[i][i]),
            righting: fitting::righting(&nominal),
            plain,
            fitting,
        };
        // A clone of an empty list has no room of its own.
        for node in &mut filter.nodes {
            node.thrusts.reserve(filter.plain.actuators.len());
            node.deflections.reserve(filter.plain.fins.len());
        }
        filter
    }

    /// Where the filter has begun.
    #[inline(always)]
    pub fn begun(&self) -> T::Mask {
        self.begun.zero().lt(self.begun)
    }

    /// Estimate and covariance.
    pub fn tracker(&self) -> &Tracker<T> {
        &self.tracker
    }

    /// What the filter was made of.
    pub fn fitting(&self) -> &Fitting {
        &self.fitting
    }

    /// The record of every channel.
    pub fn watches(&self) -> &[Watch<T>] {
        &self.watches
    }

    /// Time since the last sample of every channel, s.
    pub fn silent(&self) -> &[T] {
        &self.silent
    }

    /// Moves on by `elapsed` seconds under the commands of the actuators as signals (`None`: as before) and takes the
    /// samples that have arrived since; `measured` are signals that the actuators are measured at now, not a number
    /// where they are not.
    #[inline(always)]
    pub fn step(
        &mut self,
        samples: &[Told<T>],
        (commands, measured): (&[T], Option<&[T]>),
        (voltage, elapsed): (f64, f64),
    ) {
        for silent in &mut self.silent {
            *silent = *silent + elapsed;
        }
        self.age = self.age + elapsed;
        if elapsed > LONGEST_PAUSE {
            self.lose(self.begun(), elapsed);
        }
        let mut left = elapsed.min(LONGEST_PAUSE);
        while left > 1e-9 {
            let time = left.min(self.fitting.period);
            let time = if left - time < 0.5 * self.fitting.period { left } else { time };
            self.pass(commands, voltage, time);
            left -= time;
            // Late samples go back period by period.
            if left > 1e-9 {
                self.settle();
            }
        }
        // What the actuators are measured at is true now: the next step begins there.
        for (state, &signal) in self.drive.states.iter_mut().zip(measured.unwrap_or(&[])) {
            state.signal = T::select(finite(signal), signal, state.signal);
        }
        for &(channel, value, age) in samples {
            self.take(channel, value, age);
        }
        let waiting = self.begun.lt(self.begun.splat(0.5));
        self.settle();
        if T::any(waiting) {
            self.try_to_begin(waiting);
        }
        self.regain(elapsed);
    }

    /// Moves the estimate by what its samples have found; what is no number is lost.
    #[inline(always)]
    fn settle(&mut self) {
        if T::any(self.begun()) {
            let (sound, zero) = (self.tracker.settle(), self.begun.zero());
            let left = T::select(sound, zero, self.begun);
            if T::any(zero.lt(left)) {
                self.lose(zero.lt(left), 0.0);
            }
        }
    }

    /// Lets a time pass: motors, process and covariance.
    #[inline(always)]
    fn pass(&mut self, commands: &[T], voltage: f64, time: f64) {
        for (i, &command) in commands.iter().enumerate() {
            self.targets[i] = T::select(finite(command), self.limits[i].apply(command), self.targets[i]);
            let motor = self.plain.motor(i);
            if motor.ideal && motor.t_t.largest() <= 0.0 {
                self.drive.states[i] = motor.steady(self.targets[i]);
            }
        }
        for k in 0..self.nodes.len() {
            if k > 0 {
                self.drive.advance(&self.targets);
            }
            for (signal, state) in self.signals.iter_mut().zip(&self.drive.states) {
                *signal = state.signal;
            }
            act(&self.plain, &self.signals, voltage, |_| None, &mut self.nodes[k]);
        }
        if T::any(self.begun()) {
            self.roll_on();
            let steps = self.nodes.len() / 2;
            self.tracker.predict(&self.nodes, self.h * time / (self.h * steps as f64));
        }
    }

    /// What the waves are at the depth of now. Their acceleration leans the apparent vertical by a/g: a moment on roll and
    /// pitch with the time constant 1/ω, of which the force walks.
    #[inline(always)]
    fn roll_on(&mut self) {
        let Some(swell) = &self.fitting.swell else { return };
        self.waves = swell.at(self.tracker.estimate().motion.position[2]);
        let Motion { velocity, acceleration, .. } = self.waves;
        let omega = (acceleration / velocity.max(velocity.splat(1e-12))).sqrt();
        let (root, fast) = (acceleration.sqrt(), (omega * 2.0).sqrt());
        for i in 0..6 {
            let push = if i < 3 { LEFT_BEHIND * self.masses[i] } else { self.righting / GRAVITY };
            self.tracker.walk_mut()[i] = root * push * fast;
        }
    }
}

/// Where a number is one.
#[inline(always)]
fn finite<T: Real>(x: T) -> T::Mask {
    x.abs().lt(x.splat(f64::INFINITY))
}
