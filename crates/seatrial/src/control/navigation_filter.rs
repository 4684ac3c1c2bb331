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
//! In reading order: [`fitting`], what a filter is made of, and [`stated`], how a caller says it; [`NavigationFilter`], the filter at work; [`mod@told`], what it
//! says.
//!
//! Tests: `tests/flight/test_navigation.py`, `tests/fixed_memory.rs`.

pub mod fitting;
pub mod stated;
pub mod told;

use crate::actuator::motor::Limits;
use crate::control::navigation::{ALTITUDE, VELOCITY as GROUND, WATER};
use crate::description::Description;
use crate::error::Error;
use crate::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use crate::filter::innovation::Watch;
use crate::filter::observation::Observation;
use crate::filter::process::Process;
use crate::filter::swell::Motion;
use crate::filter::tracker::{Sample, Tracker};
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::kinematics::{from_euler, quaternion_product, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Vec3, product};
use fitting::{ATTITUDE_SENSOR, DEPTH, DVL_WATER, GPS, GYRO, POSITION_FIX, USBL, instrument_of};
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

/// Deviations at the start of what was not measured: velocity m/s, rates rad/s.
const AT_START: [f64; 2] = [0.5, 0.1];

/// The first channel of a fix by acoustics.
const FIRST_USBL: usize = 18;

/// One sample: the channel, its value and its age on arrival beyond the sensor's latency, s.
pub type Told = (usize, f64, f64);

/// The filter at work.
pub struct NavigationFilter {
    tracker: Tracker,
    fitting: Fitting,
    plain: Vehicle<f64>,
    limits: Vec<Limits>,
    drive: Drive<f64>,
    targets: Vec<f64>,
    signals: Vec<f64>,
    nodes: Vec<Instant<f64>>,
    h: f64,
    watches: Vec<Watch>,
    /// The last value of every channel before the filter has begun.
    first: Vec<f64>,
    /// Time since the last sample of every channel, s.
    silent: Vec<f64>,
    /// Bearing of the beam on every surface, rad.
    beams: Vec<f64>,
    /// The waves at the depth of now.
    waves: Motion,
    begun: bool,
    /// How often the filter had to begin anew.
    pub restarts: u64,
}

impl NavigationFilter {
    /// The filter of a vehicle before its first sample.
    ///
    /// # Errors
    /// A forced instruction set that is not there.
    pub fn new(description: &Description, fitting: Fitting) -> Result<Self, Error> {
        let process = Process::new(description)?;
        let plain = Vehicle::nominal(description);
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
            inflow_free: Some([0.0; 6]),
            ..Instant::default()
        };
        let nodes = vec![node; 2 * steps + 1];
        let mut filter = Self {
            tracker: Tracker::new(process, fitting.noise, fitting.gate, kept),
            drive: Drive::new(&plain, h, UnlimitedDelay::InTheDrive, |i| plain.motor(i).steady(0.0)),
            limits: description.actuators.iter().map(|a| a.limits).collect(),
            targets: vec![0.0; count],
            signals: vec![0.0; count],
            nodes,
            h,
            watches: vec![Watch::default(); channels],
            first: vec![f64::NAN; channels],
            silent: vec![f64::INFINITY; channels],
            beams: vec![0.0; fitting.landmarks.len()],
            waves: Motion::default(),
            begun: false,
            restarts: 0,
            plain,
            fitting,
        };
        // A clone of an empty list has no room of its own.
        for node in &mut filter.nodes {
            node.thrusts.reserve(filter.plain.actuators.len());
            node.deflections.reserve(filter.plain.fins.len());
        }
        Ok(filter)
    }

    /// Whether the filter has begun.
    pub fn begun(&self) -> bool {
        self.begun
    }

    /// Estimate and covariance.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// What the filter was made of.
    pub fn fitting(&self) -> &Fitting {
        &self.fitting
    }

    /// The record of every channel.
    pub fn watches(&self) -> &[Watch] {
        &self.watches
    }

    /// Time since the last sample of every channel, s.
    pub fn silent(&self) -> &[f64] {
        &self.silent
    }

    /// Moves on by `elapsed` seconds under the commands of the actuators as signals (`None`: as before) and takes the
    /// samples that have arrived since; `measured` are signals that the actuators are measured at now, not a number
    /// where they are not.
    pub fn step(
        &mut self,
        samples: &[Told],
        (commands, measured): (&[f64], Option<&[f64]>),
        (voltage, elapsed): (f64, f64),
    ) {
        for silent in &mut self.silent {
            *silent += elapsed;
        }
        if self.begun && elapsed > LONGEST_PAUSE {
            self.lose();
        }
        let mut left = elapsed.min(LONGEST_PAUSE);
        while left > 1e-9 {
            let time = left.min(self.fitting.period);
            let time = if left - time < 0.5 * self.fitting.period { left } else { time };
            self.pass(commands, voltage, time);
            left -= time;
            // Late samples go back period by period.
            if self.begun && left > 1e-9 && !self.tracker.settle() {
                self.lose();
            }
        }
        // What the actuators are measured at is true now: the next step begins there.
        for (state, &signal) in self.drive.states.iter_mut().zip(measured.unwrap_or(&[])) {
            if signal.is_finite() {
                state.signal = signal;
            }
        }
        for &(channel, value, age) in samples {
            self.take(channel, value, age);
        }
        match self.begun {
            true => {
                if !self.tracker.settle() {
                    self.lose();
                }
            }
            false => self.try_to_begin(),
        }
    }

    /// Lets a time pass: motors, process and covariance.
    fn pass(&mut self, commands: &[f64], voltage: f64, time: f64) {
        for (i, &command) in commands.iter().enumerate() {
            if command.is_finite() {
                self.targets[i] = self.limits[i].apply(command);
                let motor = self.plain.motor(i);
                if motor.ideal && motor.t_t <= 0.0 {
                    self.drive.states[i] = motor.steady(self.targets[i]);
                }
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
        if self.begun {
            self.roll_on();
            let steps = self.nodes.len() / 2;
            self.tracker.predict(&self.nodes, self.h * time / (self.h * steps as f64));
        }
    }

    /// Takes a sample of a channel.
    fn take(&mut self, channel: usize, value: f64, age: f64) {
        if !value.is_finite() {
            return;
        }
        self.silent[channel] = 0.0;
        self.first[channel] = value;
        let beam =
            (channel >= LANDMARKS && (channel - LANDMARKS) % 2 == 1).then(|| (channel - LANDMARKS) / 2);
        if let Some(mark) =
            beam.filter(|&mark| matches!(self.fitting.landmarks[mark].1, Landmark::Surface(_)))
        {
            self.beams[mark] = value;
            return;
        }
        if !self.begun {
            return;
        }
        let Some((observation, instrument)) = self.observation(channel) else { return };
        let mut variance = (instrument.noise * instrument.noise).max(1e-12) + self.shaken(&observation);
        if let Some(axis) = self.shifted(channel) {
            let offset = instrument.bias * instrument.bias;
            if self.tracker.state().covariance[POSITION + axis][POSITION + axis] <= offset {
                return;
            }
            variance += offset;
        }
        let sample =
            Sample { observation: &observation, measured: value, variance, age: instrument.latency + age };
        self.tracker.observe(&sample, &mut self.watches[channel]);
    }

    /// The axis of a fix whose constant offset counts as its error: a fix beside others that do not share the offset. A
    /// fix is taken only while the estimate is less sure than that, so that no number of them averages the offset out.
    fn shifted(&self, channel: usize) -> Option<usize> {
        let several = !self.fitting.landmarks.is_empty() || self.watches[FIRST_USBL].taken > 0;
        let axis = match channel {
            0 | 1 => channel,
            16 | 17 => channel - 16,
            18..=20 => channel - FIRST_USBL,
            _ => return None,
        };
        let offset = self.fitting.instruments[instrument_of(channel)].map_or(0.0, |i| i.bias);
        (several && offset > 0.0).then_some(axis)
    }

    /// The variance that waves add to an observation.
    fn shaken(&self, observation: &Observation) -> f64 {
        let Some(swell) = &self.fitting.swell else { return 0.0 };
        let ned = |along: &Vec3<f64>| product(&self.tracker.estimate().rotation(), along);
        match observation {
            Observation::Place { along, .. } => swell.share(along) * self.waves.displacement,
            Observation::Velocity { along, over_ground: true, .. } => {
                swell.share(&ned(along)) * self.waves.velocity
            }
            Observation::Echo { along, .. } => swell.share(&ned(along)) * self.waves.displacement,
            Observation::Range { .. } => self.waves.displacement,
            _ => 0.0,
        }
    }

    /// What the waves are at the depth of now. Their acceleration leans the apparent vertical by a/g: a moment on roll and
    /// pitch with the time constant 1/ω, of which the force walks.
    fn roll_on(&mut self) {
        let Some(swell) = &self.fitting.swell else { return };
        self.waves = swell.at(self.tracker.estimate().motion.position[2]);
        let Motion { velocity, acceleration, .. } = self.waves;
        let omega = (acceleration / velocity.max(1e-12)).sqrt();
        let moment = fitting::righting(&self.plain) * acceleration.sqrt() / GRAVITY;
        let left = LEFT_BEHIND * acceleration.sqrt();
        for i in 0..6 {
            let push = if i < 3 { left * self.plain.mass_matrix[i][i] } else { moment };
            self.tracker.noise_mut().force_walk[i] = push * (2.0 * omega).sqrt();
        }
    }

    /// What a channel observes; nothing where the vehicle has no such sensor.
    fn observation(&self, channel: usize) -> Option<(Observation, Instrument)> {
        let instrument = self.fitting.instruments[instrument_of(channel)]?;
        let Instrument { arm, mount, .. } = instrument;
        let unit = |i: usize| -> Vec3<f64> { std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 }) };
        let tilted = |i: usize| product(&rotation(&mount), &unit(i));
        let observation = match channel {
            0..3 => Observation::Place { along: unit(channel), arm },
            3..6 => Observation::Angle { axis: channel - 3, mount },
            6..9 => Observation::Velocity { along: tilted(channel - 6), arm, over_ground: true },
            9..12 => Observation::Rate { about: tilted(channel - 9) },
            ALTITUDE => Observation::Echo { along: tilted(2), arm, surface: self.fitting.bottom? },
            13..16 => Observation::Velocity { along: tilted(channel - 13), arm, over_ground: false },
            16 | 17 => Observation::Place { along: unit(channel - 16), arm },
            18..21 => Observation::Place { along: unit(channel - 18), arm },
            _ => {
                let mark = (channel - LANDMARKS) / 2;
                let bearing = (channel - LANDMARKS) % 2 == 1;
                self.fitting.landmarks[mark].1.observed(bearing, &instrument, self.beams[mark])
            }
        };
        Some((observation, instrument))
    }

    /// What is lost begins anew from the next samples.
    fn lose(&mut self) {
        self.begun = false;
        self.restarts += 1;
        self.first.fill(f64::NAN);
    }

    /// Begins when the attitude is known.
    fn try_to_begin(&mut self) {
        let of = |kind: usize| self.fitting.instruments[kind].unwrap_or(Instrument::of(0.0));
        let first = |channel: usize| self.first[channel];
        let angles = [first(3), first(4), first(5)];
        if angles.iter().any(|x| !x.is_finite()) {
            return;
        }
        let (mut at, mut deviations) = (Estimate::at_rest(), [0.0; STATES]);
        let [w, x, y, z] = of(ATTITUDE_SENSOR).mount;
        let attitude = from_euler(&angles);
        at.motion.attitude = quaternion_product(&attitude, &[w, -x, -y, -z]);
        let spread = |kind: usize| of(kind).noise.hypot(of(kind).bias).max(1e-6);
        let (start, far) = self.fitting.start;
        for i in 0..3 {
            deviations[ATTITUDE + i] = spread(ATTITUDE_SENSOR);
            let fixes: &[(usize, usize)] = match i {
                2 => &[(2, DEPTH), (20, USBL)],
                _ => &[(0, POSITION_FIX), (16, GPS), (18, USBL)],
            };
            let shift = if i < 2 { i } else { 0 };
            let known = fixes.iter().find(|(channel, kind)| {
                self.fitting.instruments[*kind].is_some() && first(channel + shift).is_finite()
            });
            (at.motion.position[i], deviations[POSITION + i]) = match known {
                Some(&(channel, kind)) => {
                    let arm = product(&at.rotation(), &of(kind).arm);
                    (first(channel + shift) - arm[i], spread(kind))
                }
                // The place of the launch, as whoever launches tells it.
                None if first(i).is_finite() => (first(i), far),
                None => (start[i], far),
            };
            deviations[VELOCITY + i] = AT_START[0];
            deviations[VELOCITY + 3 + i] = AT_START[1];
            let moving =
                first(if self.fitting.instruments[DVL_WATER].is_some() { WATER + i } else { GROUND + i });
            if moving.is_finite() {
                at.motion.nu[i] = moving;
            }
            let turning = first(9 + i);
            if turning.is_finite() {
                at.motion.nu[3 + i] = turning;
            }
            deviations[CURRENT + i] = self.fitting.noise.current[i];
            deviations[GYRO_BIAS + i] = of(GYRO).bias;
        }
        deviations[FORCE..FORCE + 6].copy_from_slice(&self.fitting.noise.force);
        // An offset of the attitude turns weight against buoyancy: a lasting moment that the vehicle does not feel.
        let leaning = of(ATTITUDE_SENSOR).bias * fitting::righting(&self.plain);
        for moment in &mut deviations[FORCE + 3..FORCE + 5] {
            *moment = moment.hypot(leaning);
        }
        self.tracker.begin(&at, &deviations);
        self.begun = true;
    }
}
