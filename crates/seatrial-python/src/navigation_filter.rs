//! `Filter`: the navigation filter of a vehicle, one step at a time; `seatrial.NavigationFilter` builds it.

use crate::autopilot::Clock;
use crate::convert::{Array, Named, Numbers};
use crate::error::{raised, refused};
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::control::intake::Quantity;
use seatrial::control::navigation::{CHANNELS, Measurement};
use seatrial::control::navigation_filter::{Fitting, GRAVITY, LANDMARKS, NavigationFilter, Stated, Told};
use seatrial::description::{Description, Effect};
use seatrial::error::nearest;
use seatrial::filter::estimate::{ATTITUDE, CURRENT, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use seatrial::filter::innovation::Watch;
use seatrial::flight::waves::Sea;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

/// What is told of an acoustic range or fix at most, m.
const FARTHEST: f64 = 2e7;

/// What a filter remembers.
struct Memory {
    filter: NavigationFilter,
    clock: Clock,
    commands: Vec<f64>,
    signals: Vec<f64>,
    voltage: f64,
    impossible: BTreeMap<usize, (u64, f64)>,
}

/// The navigation filter of a vehicle at work: a measurement in, an estimate out, once per period.
#[pyclass(frozen, module = "seatrial")]
pub struct Filter {
    description: Arc<Description>,
    fitting: Fitting,
    channels: Vec<String>,
    memory: Mutex<Memory>,
}

impl Filter {
    fn memory(&self) -> PyResult<MutexGuard<'_, Memory>> {
        self.memory.lock().map_err(|_| refused("the filter failed earlier; make a new one"))
    }

    /// What another filter of this kind is made of, at a period, s.
    pub fn fitting_for(&self, period: f64) -> Fitting {
        Fitting { period, ..self.fitting.clone() }
    }

    /// The vehicle that is its process model.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Whether the thrust of an actuator depends on the supply.
    pub fn needs_voltage(&self) -> bool {
        let depends =
            |effect: &Effect| matches!(effect, Effect::Thrust(_, Some(table)) if table.needs_voltage());
        self.description.actuators.iter().any(|a| depends(&a.effect))
    }

    /// Values by actuator as signals; not a number where none is given.
    fn signals(&self, key: &str, values: Option<Named>) -> PyResult<Vec<f64>> {
        let actuators = &self.description.actuators;
        let names = || actuators.iter().map(|a| a.name.as_str());
        let mut signals = vec![f64::NAN; actuators.len()];
        for (name, value) in Named::scalars(values)? {
            let index = names().position(|known| known == name).ok_or_else(|| {
                refused(format!("{key}: the vehicle has no actuator \"{name}\"{}", nearest(&name, names())))
            })?;
            if value.is_finite() {
                signals[index] = actuators[index].signal(value);
            }
        }
        Ok(signals)
    }

    fn channel(&self, key: &str, name: &str) -> PyResult<usize> {
        self.channels.iter().position(|known| known == name).ok_or_else(|| {
            let known = self.channels.iter().map(String::as_str).chain(["voltage"]);
            refused(format!("{key}: unknown channel \"{name}\"{}", nearest(name, known)))
        })
    }
}

/// Lowest and highest value of a channel that is possible.
fn possible(channel: usize) -> (f64, f64) {
    match channel {
        0..CHANNELS => {
            let (low, high, _) = Quantity::Channel(channel).range();
            (low, high)
        }
        CHANNELS..LANDMARKS => (-FARTHEST, FARTHEST),
        _ if (channel - LANDMARKS).is_multiple_of(2) => (0.0, FARTHEST),
        _ => (-6.3, 6.3),
    }
}

#[pymethods]
impl Filter {
    /// The filter of a vehicle before its first sample.
    ///
    /// instruments: per kind (position, gps, usbl, depth, attitude, dvl, gyro, dvl_water, altitude, range, bearing) noise,
    /// bias, latency (s), lever arm (3, m), roll, pitch and yaw of its mounting (rad); SI. landmarks: name and kind
    /// ("beacon", "wall", "pen") with numbers: north, east, down; unit normal (3) and offset; north, east, radius. bottom:
    /// unit normal (3) and offset. force (6,), acceleration (6,), current (3,): None for those of a good model. gusts (5,):
    /// deviations north, east, down (m/s), time constant and second lag (s). gate:
    /// deviations and patience in s. start: north, east, down and deviation, m. waves (5,): as of `fly`.
    /// exact_model: the vehicle is simulated by the model itself.
    #[new]
    #[pyo3(signature = (vehicle, *, period_s, instruments, landmarks = Vec::new(), bottom = None, force = None, force_time_s = None, acceleration = None, current = None, current_time_s = None, gusts = None, gyro_walk, gate, start, longest_age_s = 0.0, waves = None, exact_model = false))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one call")]
    fn new(
        vehicle: PyRef<'_, Vehicle>,
        period_s: f64,
        instruments: Named,
        landmarks: Vec<(String, String, Vec<f64>)>,
        bottom: Option<Numbers>,
        force: Option<Numbers>,
        force_time_s: Option<f64>,
        acceleration: Option<Numbers>,
        current: Option<Numbers>,
        current_time_s: Option<f64>,
        gusts: Option<Numbers>,
        gyro_walk: f64,
        gate: (f64, f64),
        start: Numbers,
        longest_age_s: f64,
        waves: Option<Numbers>,
        exact_model: bool,
    ) -> PyResult<Self> {
        let description = vehicle.description.clone();
        let rows = instruments.by_name().into_iter();
        let stated = Stated {
            instruments: rows
                .map(|(kind, row)| Ok((kind.clone(), row.row::<9>(&kind)?)))
                .collect::<PyResult<_>>()?,
            landmarks,
            bottom: bottom.map(|row| row.row("bottom")).transpose()?,
            force: force.map(|row| row.row("force")).transpose()?,
            force_time_s,
            acceleration: acceleration.map(|row| row.row("acceleration")).transpose()?,
            current: current.map(|row| row.row("current")).transpose()?,
            current_time_s,
            gusts: gusts
                .map(|row| row.row::<5>("gusts"))
                .transpose()?
                .map(|[x, y, z, slow, fast]| ([x, y, z], [slow, fast])),
            gyro_walk,
            gate: [gate.0, gate.1],
            start: start.row("start")?,
            longest_age_s,
            exact_model,
        };
        let waves = waves.map(|row| row.row("waves")).transpose()?;
        let swell = waves.and_then(|row| Sea::of_row(row).swell(GRAVITY));
        let fitting = stated.fitting(&description, period_s, swell).map_err(raised)?;
        let filter = NavigationFilter::new(&description, fitting.clone());
        let count = description.actuators.len();
        let memory = Memory {
            filter,
            clock: Clock::default(),
            commands: vec![0.0; count],
            signals: vec![f64::NAN; count],
            voltage: f64::NAN,
            impossible: BTreeMap::new(),
        };
        Ok(Self { description, channels: fitting.channels(), fitting, memory: Mutex::new(memory) })
    }

    /// The estimate {channel: value} after a step; empty until the attitude has been measured once. See
    /// `seatrial.NavigationFilter.step`, which says it in the words of a user.
    #[pyo3(signature = (measurement, commands = None, signals = None, *, ages = None, time_s = None, dt_s = None))]
    fn step(
        &self,
        measurement: Named,
        commands: Option<Named>,
        signals: Option<Named>,
        ages: Option<Named>,
        time_s: Option<f64>,
        dt_s: Option<f64>,
    ) -> PyResult<BTreeMap<String, f64>> {
        let mut late = vec![0.0; self.channels.len()];
        for (name, age) in Named::scalars(ages)? {
            if !(age.is_finite() && age >= 0.0) {
                return Err(refused(format!("ages: {name}: expected a time from zero on in s, found {age}")));
            }
            late[self.channel("ages", &name)?] = age;
        }
        let (mut samples, mut wrong): (Vec<Told>, Vec<(usize, f64)>) = (Vec::new(), Vec::new());
        let mut voltage = f64::NAN;
        for (name, value) in Named::scalars(Some(measurement))? {
            if name == "voltage" {
                voltage = value;
                continue;
            }
            let channel = self.channel("measurement", &name)?;
            let (low, high) = possible(channel);
            match value {
                _ if value.is_nan() => {}
                _ if (low..=high).contains(&value) => samples.push((channel, value, late[channel])),
                _ => wrong.push((channel, value)),
            }
        }
        // The bearing of a beam comes before its range.
        let beam = |channel: usize| channel >= LANDMARKS && (channel - LANDMARKS) % 2 == 1;
        samples.sort_by_key(|&(channel, ..)| !beam(channel));
        let commands = self.signals("commands", commands)?;
        let measured = self.signals("signals", signals)?;
        let mut memory = self.memory()?;
        let (clock, elapsed) = memory.clock.after(time_s, dt_s, self.fitting.period)?;
        let voltage = if voltage > 0.0 && voltage.is_finite() { voltage } else { memory.voltage };
        if voltage.is_nan() && self.needs_voltage() {
            return Err(refused(
                "voltage: expected the supply in V with the first measurement, the thrust of an actuator depends on it",
            ));
        }
        memory.voltage = voltage;
        let elapsed = if memory.filter.begun() { elapsed } else { elapsed.min(self.fitting.period) };
        memory.clock = clock;
        for (channel, value) in wrong {
            let entry = memory.impossible.entry(channel).or_insert((0, value));
            *entry = (entry.0 + 1, value);
        }
        let Memory { filter, commands: held, signals: shown, .. } = &mut *memory;
        for i in 0..held.len() {
            if commands[i].is_finite() {
                held[i] = commands[i];
            }
        }
        shown.copy_from_slice(&measured);
        filter.step(&samples, (held, Some(shown)), (voltage, elapsed));
        if !filter.begun() {
            return Ok(BTreeMap::new());
        }
        let told = filter.told(&Measurement::nothing(0.0));
        let names = self.channels.iter().take(CHANNELS).cloned().zip(told.channels);
        Ok(names.filter(|(name, _)| name != "altitude").collect())
    }

    /// The channels that must be measured before the filter begins; empty once it has begun.
    #[getter]
    fn waiting_for(&self) -> PyResult<Vec<&'static str>> {
        let memory = self.memory()?;
        Ok(if memory.filter.begun() { Vec::new() } else { vec!["roll", "pitch", "yaw"] })
    }

    /// What is estimated besides the channels: force (6,) in N and N m, body frame, current (3,) NED in m/s, gyro_bias (3,)
    /// in rad/s; and the standard deviations of all: position (3,), attitude (3,), velocity (6,) …
    #[getter]
    fn state(&self) -> PyResult<BTreeMap<String, Array>> {
        let memory = self.memory()?;
        let tracker = memory.filter.tracker();
        let (at, deviations) = (tracker.estimate(), memory.filter.deviations());
        let vector = |x: &[f64]| Array::new(&[x.len()], x.to_vec());
        let of = |first: usize, count: usize| vector(&deviations[first..first + count]);
        Ok([
            ("force", vector(&at.force)),
            ("current", vector(&at.current)),
            ("gyro_bias", vector(&at.gyro_bias)),
            ("attitude_quaternion", vector(&at.motion.attitude)),
            ("position_deviation", of(POSITION, 3)),
            ("attitude_deviation", of(ATTITUDE, 3)),
            ("velocity_deviation", of(VELOCITY, 6)),
            ("force_deviation", of(FORCE, 6)),
            ("current_deviation", of(CURRENT, 3)),
            ("gyro_bias_deviation", of(GYRO_BIAS, 3)),
        ]
        .map(|(name, x)| (name.to_owned(), x))
        .into())
    }

    /// The covariance of the error, shape (24, 24): position, attitude, velocity, force, current, gyro bias.
    #[getter]
    fn covariance(&self) -> PyResult<Array> {
        let memory = self.memory()?;
        let p = memory.filter.tracker().state().dense();
        Ok(Array::new(&[STATES, STATES], p.concat()))
    }

    /// Per channel that has been measured: samples taken and refused, recoveries, mean normalised innovation squared and
    /// its 95 % band, time since the last sample in s, impossible samples.
    #[getter]
    fn watches(&self) -> PyResult<BTreeMap<String, [f64; 8]>> {
        let memory = self.memory()?;
        let all = self.channels.iter().zip(memory.filter.watches()).zip(memory.filter.silent());
        let row = |(c, ((name, w), silent)): (usize, ((&String, &Watch), &f64))| {
            let impossible = memory.impossible.get(&c).map_or(0, |entry| entry.0) as f64;
            let [low, high] = w.band();
            let seen = w.taken + w.refused + w.recovered + impossible > 0.0;
            let row = [w.taken, w.refused, w.recovered, w.consistency(), low, high, *silent, impossible];
            seen.then(|| (name.clone(), row))
        };
        Ok(all.enumerate().filter_map(row).collect())
    }

    /// How often the filter had to begin anew: after a pause beyond a minute, where it had lost its lock, or when its
    /// estimate was no number.
    #[getter]
    fn restarts(&self) -> PyResult<u64> {
        Ok(self.memory()?.filter.restarts as u64)
    }

    /// The names of all channels that a step takes, besides voltage.
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.channels.clone()
    }
}
