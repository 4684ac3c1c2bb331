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
use crate::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use crate::filter::innovation::Watch;
use crate::filter::observation::Observation;
use crate::filter::process::Process;
use crate::filter::swell::Motion;
use crate::filter::tracker::{Sample, Tracker};
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::kinematics::{from_euler, quaternion_product, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Vec3, Vec6, product};
use crate::number::real::Real;
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
    /// Bearing of the beam on every surface, rad.
    beams: Vec<T>,
    /// The waves at the depth of now.
    waves: Motion<T>,
    /// 1 where the filter has begun, 0 elsewhere.
    begun: T,
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
            beams: vec![zero; fitting.landmarks.len()],
            waves: Motion::none(unit),
            begun: zero,
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
        if elapsed > LONGEST_PAUSE {
            self.lose(self.begun());
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
    }

    /// Moves the estimate by what its samples have found; what is no number is lost.
    #[inline(always)]
    fn settle(&mut self) {
        if T::any(self.begun()) {
            let (sound, zero) = (self.tracker.settle(), self.begun.zero());
            let left = T::select(sound, zero, self.begun);
            if T::any(zero.lt(left)) {
                self.lose(zero.lt(left));
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

    /// Takes a sample of a channel.
    #[inline(always)]
    fn take(&mut self, channel: usize, value: T, age: f64) {
        let (there, zero) = (finite(value), value.zero());
        self.silent[channel] = T::select(there, zero, self.silent[channel]);
        self.first[channel] = T::select(there, value, self.first[channel]);
        let beam =
            (channel >= LANDMARKS && (channel - LANDMARKS) % 2 == 1).then(|| (channel - LANDMARKS) / 2);
        if let Some(mark) =
            beam.filter(|&mark| matches!(self.fitting.landmarks[mark].1, Landmark::Surface(_)))
        {
            self.beams[mark] = T::select(there, value, self.beams[mark]);
            return;
        }
        let mut here = T::both(there, self.begun());
        if !T::any(here) {
            return;
        }
        let Some((observation, instrument)) = self.observation(channel) else { return };
        let mut variance = self.shaken(&observation) + (instrument.noise * instrument.noise).max(1e-12);
        if let Some((axis, shifted)) = self.shifted(channel) {
            let offset = instrument.bias * instrument.bias;
            let known = self.tracker.state().covariance[POSITION + axis][POSITION + axis];
            let unsure = T::either(zero.splat(offset).lt(known), not(zero, shifted));
            here = T::both(here, unsure);
            variance += T::select(shifted, zero.splat(offset), zero);
        }
        let sample =
            Sample { observation: &observation, measured: value, variance, age: instrument.latency + age };
        self.tracker.observe_where(here, &sample, &mut self.watches[channel]);
    }

    /// The axis of a fix whose constant offset counts as its error, and where it does: a fix beside others that do not
    /// share the offset. A fix is taken only while the estimate is less sure than that, so that no number of them averages
    /// the offset out.
    #[inline(always)]
    fn shifted(&self, channel: usize) -> Option<(usize, T::Mask)> {
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
    fn shaken(&self, observation: &Observation<T>) -> T {
        let Some(swell) = &self.fitting.swell else { return self.begun.zero() };
        let ned = |along: &Vec3<T>| product(&self.tracker.estimate().rotation(), along);
        match observation {
            Observation::Place { along, .. } => swell.share(along) * self.waves.displacement,
            Observation::Velocity { along, over_ground: true, .. } => {
                swell.share(&ned(along)) * self.waves.velocity
            }
            Observation::Echo { along, .. } => swell.share(&ned(along)) * self.waves.displacement,
            Observation::Range { .. } => self.waves.displacement,
            _ => self.begun.zero(),
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

    /// What a channel observes; nothing where the vehicle has no such sensor.
    #[inline(always)]
    fn observation(&self, channel: usize) -> Option<(Observation<T>, Instrument)> {
        let instrument = self.fitting.instruments[instrument_of(channel)]?;
        let (zero, one) = (self.begun.zero(), self.begun.splat(1.0));
        let (arm, mount) = (instrument.arm.map(|x| zero.splat(x)), instrument.mount.map(|x| zero.splat(x)));
        let unit = |i: usize| {
            let mut along = [zero; 3];
            along[i] = one;
            along
        };
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
    #[inline(always)]
    fn lose(&mut self, mask: T::Mask) {
        let (zero, one) = (self.begun.zero(), self.begun.splat(1.0));
        self.restarts += T::select(mask, one, zero);
        self.begun = T::select(mask, zero, self.begun);
        for first in &mut self.first {
            *first = T::select(mask, zero.splat(f64::NAN), *first);
        }
    }

    /// Begins where the mask holds and the attitude is known.
    #[inline(always)]
    fn try_to_begin(&mut self, mask: T::Mask) {
        let of = |kind: usize| self.fitting.instruments[kind].unwrap_or(Instrument::of(0.0));
        let first = |channel: usize| self.first[channel];
        let zero = self.begun.zero();
        // The last of several that is known.
        let known = |or: T, channel: usize| T::select(finite(first(channel)), first(channel), or);
        let angles = [first(3), first(4), first(5)];
        let ready = T::both(T::both(finite(angles[0]), finite(angles[1])), T::both(finite(angles[2]), mask));
        if !T::any(ready) {
            return;
        }
        let (mut at, mut deviations) = (Estimate::at_rest_in(zero), [zero; STATES]);
        let [w, x, y, z] = of(ATTITUDE_SENSOR).mount.map(|x| zero.splat(x));
        at.motion.attitude = quaternion_product(&from_euler(&angles), &[w, -x, -y, -z]);
        let spread = |kind: usize| of(kind).noise.hypot(of(kind).bias).max(1e-6);
        let (start, far) = self.fitting.start;
        let turned = at.rotation();
        for i in 0..3 {
            deviations[ATTITUDE + i] = zero.splat(spread(ATTITUDE_SENSOR));
            // The place of the launch, as whoever launches tells it.
            let mut place = known(zero.splat(start[i]), i);
            let mut deviation = zero.splat(far);
            let fixes: &[(usize, usize)] = match i {
                2 => &[(20, USBL), (2, DEPTH)],
                _ => &[(18, USBL), (16, GPS), (0, POSITION_FIX)],
            };
            for &(channel, kind) in fixes {
                if self.fitting.instruments[kind].is_some() {
                    let fix = first(channel + if i < 2 { i } else { 0 });
                    let arm = product(&turned, &of(kind).arm.map(|x| zero.splat(x)));
                    place = T::select(finite(fix), fix - arm[i], place);
                    deviation = T::select(finite(fix), zero.splat(spread(kind)), deviation);
                }
            }
            (at.motion.position[i], deviations[POSITION + i]) = (place, deviation);
            deviations[VELOCITY + i] = zero.splat(AT_START[0]);
            deviations[VELOCITY + 3 + i] = zero.splat(AT_START[1]);
            let through = self.fitting.instruments[DVL_WATER].is_some();
            at.motion.nu[i] = known(zero, if through { WATER + i } else { GROUND + i });
            at.motion.nu[3 + i] = known(zero, 9 + i);
            deviations[CURRENT + i] = zero.splat(self.fitting.noise.current[i]);
            deviations[GYRO_BIAS + i] = zero.splat(of(GYRO).bias);
        }
        // An offset of the attitude turns weight against buoyancy: a lasting moment that the vehicle does not feel.
        let leaning = of(ATTITUDE_SENSOR).bias * self.righting;
        for i in 0..6 {
            let force = self.fitting.noise.force[i];
            let leaned = if i == 3 || i == 4 { force.hypot(leaning) } else { force };
            deviations[FORCE + i] = zero.splat(leaned);
        }
        self.tracker.begin_where(ready, &at, &deviations);
        self.begun = T::select(ready, zero.splat(1.0), self.begun);
    }
}

/// Where a number is one.
#[inline(always)]
fn finite<T: Real>(x: T) -> T::Mask {
    x.abs().lt(x.splat(f64::INFINITY))
}

/// Where a mask does not hold.
#[inline(always)]
fn not<T: Real>(zero: T, mask: T::Mask) -> T::Mask {
    zero.lt(T::select(mask, zero, zero.splat(1.0)))
}
