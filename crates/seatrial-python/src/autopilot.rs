//! `Autopilot`: an autopilot file; `Helm`: one at work, step by step.

use crate::convert::{Fact, Named, Table, fact_map};
use crate::error::{VehicleError, raised, refused};
use crate::mission::Mission;
use crate::pickle::restorer;
use crate::text::file_text;
use crate::trial::set_point;
use crate::vehicle::Vehicle;
use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::{type_hint_identifier, type_hint_union};
use seatrial::control::allocation::Allocator;
use seatrial::control::autopilot::channels::Use;
use seatrial::control::autopilot::file::Control;
use seatrial::control::autopilot::set_point::SET_POINTS;
use seatrial::control::autopilot::settings::{Settings, built_in, built_in_names};
use seatrial::control::autopilot::{Autopilot as Engaged, AutopilotState, Thought};
use seatrial::control::intake::Quantity;
use seatrial::control::navigation::{CHANNEL_NAMES, CHANNELS, GROUP_NAMES, Measurement};
use seatrial::control::safety::{REACTIONS, WATCH_NAMES};
use seatrial::description::facts::Value;
use seatrial::description::{Description, Effect};
use seatrial::error::nearest;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

/// An autopilot: guidance, gains, modes, allocation and safety. Immutable.
#[pyclass(frozen, module = "seatrial")]
pub struct Autopilot {
    pub settings: Arc<Settings>,
}

impl Autopilot {
    fn of(settings: Settings) -> Self {
        Self { settings: Arc::new(settings) }
    }
}

#[pymethods]
impl Autopilot {
    /// The autopilot of a built-in name or a file.
    ///
    /// Raises VehicleError (a ValueError) that names file, key, what was expected and what was found.
    #[staticmethod]
    fn load(name_or_path: PathBuf) -> PyResult<Self> {
        let name = name_or_path.to_string_lossy().into_owned();
        if let Some(text) = built_in(&name) {
            return Settings::from_toml(text, &name).map(Self::of).map_err(raised);
        }
        let text = file_text(&name_or_path).map_err(|error| {
            let near = nearest(&name, built_in_names());
            VehicleError::new_err(format!(
                "{name}: expected an autopilot file or one of the built-in autopilots {}, but the file cannot be read ({error}){near}",
                built_in_names().join(", ")
            ))
        })?;
        Settings::from_toml(&text, &name).map(Self::of).map_err(raised)
    }

    /// The autopilot of the TOML text of an autopilot file; `source` stands in messages.
    #[staticmethod]
    #[pyo3(signature = (text, source = "<text>"))]
    fn from_toml(text: &str, source: &str) -> PyResult<Self> {
        Settings::from_toml(text, source).map(Self::of).map_err(raised)
    }

    /// Names of the built-in autopilots, those of the built-in vehicles.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        built_in_names()
    }

    /// The autopilot file, TOML.
    fn to_toml(&self) -> String {
        self.settings.file.to_toml()
    }

    /// The same as plain data: the tables of the file by name, keys with their units, defaults filled in.
    fn to_dict(&self) -> Table {
        Table::of(&self.settings.file)
    }

    /// The control law: "pid" or "lqr".
    #[getter]
    fn control(&self) -> &'static str {
        match self.settings.file.control {
            Control::Pid => "pid",
            Control::Lqr => "lqr",
        }
    }

    /// Per loop, in the order surge sway heave roll pitch heading: K_P, K_I_per_s and K_D_s (one number, or six: one per
    /// supporting point), tau_max in N or N m, anti_windup, and reference_rad_s where it has a reference filter.
    fn loops(&self) -> Table {
        Table::of(&self.settings.file.loops)
    }

    /// The table of guidance: method, and numbers whose names carry their units.
    fn guidance(&self) -> Table {
        Table::of(&self.settings.file.guidance)
    }

    /// What is watched and what follows: per watch a reaction, or a table with its reaction and its limits.
    fn safety(&self) -> Table {
        Table::of(&self.settings.file.safety)
    }

    /// Which parts of the model are used ahead of any error: restoring, drag, acceleration.
    fn feed_forward(&self) -> BTreeMap<&'static str, bool> {
        let table = &self.settings.file.feed_forward;
        BTreeMap::from([
            ("restoring", table.restoring),
            ("drag", table.drag),
            ("acceleration", table.acceleration),
        ])
    }

    /// The same autopilot under another name and description.
    fn renamed(&self, name: &str, description: &str) -> Self {
        let mut settings = (*self.settings).clone();
        (settings.file.name, settings.file.description) = (name.to_owned(), description.to_owned());
        Self::of(settings)
    }

    /// Name of the autopilot.
    #[getter]
    fn name(&self) -> &str {
        &self.settings.file.name
    }

    /// What the autopilot is for, in a sentence.
    #[getter]
    fn description(&self) -> &str {
        &self.settings.file.description
    }

    /// Control period, s.
    #[getter]
    fn period_s(&self) -> f64 {
        self.settings.file.period_s
    }

    /// Desired speeds of the six supporting points, m/s.
    #[getter]
    fn speeds_m_s(&self) -> Vec<f64> {
        self.settings.schedule.speeds().to_vec()
    }

    /// The mode table: per mode name, loops (six flags in the order X Y Z K M N), loop_names, depth_by, from_speed_m_s,
    /// hysteresis_m_s, and actuators: names of actuators or groups at work, None for all.
    #[getter]
    fn modes(&self) -> Vec<BTreeMap<&'static str, Fact>> {
        let modes = self.settings.modes.iter().zip(&self.settings.file.modes);
        modes
            .map(|(mode, table)| {
                let loops = mode.active.iter().map(|on| f64::from(u8::from(*on))).collect();
                let words = |names: &[String]| {
                    Value::List(names.iter().map(|name| Value::Text(name.clone())).collect())
                };
                fact_map(BTreeMap::from([
                    ("name", Value::Text(mode.name.clone())),
                    ("loops", Value::Vector(loops)),
                    ("loop_names", words(&table.loops)),
                    ("hysteresis_m_s", Value::Number(mode.hysteresis)),
                    ("actuators", mode.actuators.as_deref().map_or(Value::None, words)),
                    ("depth_by", Value::Text(format!("{:?}", table.depth_by).to_lowercase())),
                    ("from_speed_m_s", Value::Number(mode.from_speed)),
                ]))
            })
            .collect()
    }

    /// The numbers that a batch may vary by name: heading.K_P.1 … (supporting points from 1; K_I per s, K_D times
    /// s), heading.reference_rad_s, guidance.lookahead_m …
    fn gains(&self) -> BTreeMap<String, f64> {
        self.settings.named_tunables().into_iter().collect()
    }

    /// The same autopilot with other values of some gains.
    ///
    /// Raises VehicleError for an unknown name or an impossible value.
    fn with_gains(&self, gains: Named) -> PyResult<Self> {
        let values: Vec<(String, f64)> = Named::scalars(Some(gains))?.into_iter().collect();
        self.settings.with_tunables(&values).map(Self::of).map_err(raised)
    }

    /// The autopilot at work on a vehicle, which is its model, and a mission: one step at a time.
    fn engage(&self, vehicle: &Vehicle, mission: Planned) -> PyResult<Helm> {
        self.settings.fits(&vehicle.description).map_err(raised)?;
        let autopilot =
            Engaged::new(&self.settings, &vehicle.description, &mission.0, &self.settings.tunables)
                .map_err(raised)?;
        let allocation = &self.settings.file.allocation;
        let allocator =
            Allocator::single(&vehicle.description, autopilot.model(), allocation).map_err(raised)?;
        let state = autopilot.begin(allocator);
        let memory = Memory { state, thought: None, clock: Clock::default() };
        Ok(Helm { autopilot, description: vehicle.description.clone(), memory: Mutex::new(memory) })
    }

    /// Itself: nothing of it can change.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    /// Itself: nothing of it can change.
    #[expect(unused_variables, reason = "the name is Python's")]
    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((restorer(py, "_restored_autopilot")?, (self.to_toml(),)))
    }

    fn __repr__(&self) -> String {
        format!("Autopilot('{}', {} modes)", self.name(), self.settings.modes.len())
    }
}

/// The autopilot of the text of its file: how a pickled one comes back.
#[pyfunction]
#[pyo3(name = "_restored_autopilot")]
pub fn restored_autopilot(text: &str) -> PyResult<Autopilot> {
    Autopilot::from_toml(text, "<pickle>")
}

/// A mission of the core, or one of Python that carries it as `core`.
struct Planned(Arc<seatrial::mission::Mission>);

impl<'a, 'py> FromPyObject<'a, 'py> for Planned {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = type_hint_union!(
        type_hint_identifier!("seatrial._core", "Mission"),
        type_hint_identifier!("seatrial.flight.mission", "Mission")
    );
    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(mission) = object.cast::<Mission>() {
            return Ok(Self(mission.get().core.clone()));
        }
        let core = object.getattr("core")?;
        Ok(Self(core.cast::<Mission>()?.get().core.clone()))
    }
}

/// What a helm is told, by its name.
fn quantity(name: &str) -> Option<Quantity> {
    match name {
        "battery" => Some(Quantity::Battery),
        "voltage" => Some(Quantity::Voltage),
        _ => CHANNEL_NAMES.iter().position(|known| *known == name).map(Quantity::Channel),
    }
}

/// The name of what a helm is told.
fn name_of(of: Quantity) -> &'static str {
    match of {
        Quantity::Battery => "battery",
        Quantity::Voltage => "voltage",
        Quantity::Channel(c) => CHANNEL_NAMES[c],
    }
}

/// A measurement as samples.
fn quantities(measurement: Named) -> PyResult<Vec<(Quantity, f64)>> {
    let sample = |(name, value): (String, f64)| {
        let of = quantity(&name).ok_or_else(|| {
            let known = CHANNEL_NAMES.iter().copied().chain(["battery", "voltage"]);
            refused(format!("measurement: unknown channel \"{name}\"{}", nearest(&name, known)))
        })?;
        Ok((of, value))
    };
    Named::scalars(Some(measurement))?.into_iter().map(sample).collect()
}

/// What a helm remembers: the autopilot's state, what was thought last, and when.
struct Memory {
    state: AutopilotState<f64>,
    thought: Option<Thought<f64>>,
    clock: Clock,
}

impl Memory {
    /// What the autopilot goes by: what is believed, once it has begun.
    fn known(&self) -> &Measurement<f64> {
        if self.thought.is_some() { self.state.screen().believed() } else { self.state.intake().measured() }
    }
}

/// The time of a helm or a navigation filter.
#[derive(Clone, Copy, Default)]
pub struct Clock {
    /// The last time that was told, or what has passed since the first step, s.
    now: f64,
    /// Whether any time was told: the first one has none before it.
    told: bool,
    /// Since the last commands were made, s.
    held: f64,
}

/// Commands are made anew after this share of a control period; what comes sooner only brings samples.
const SOONEST: f64 = 0.5;

impl Clock {
    /// The clock after a step at `time_s`, or `dt_s` after the last one, or a control period after it; and how much
    /// later that is.
    pub fn after(self, time_s: Option<f64>, dt_s: Option<f64>, period: f64) -> PyResult<(Self, f64)> {
        let (now, mut elapsed) = match (time_s, dt_s) {
            (Some(_), Some(_)) => return Err(refused("step: expected time_s or dt_s, found both")),
            (None, None) => (self.now + period, period),
            (None, Some(dt)) if dt.is_finite() && dt > 0.0 => (self.now + dt, dt),
            (None, Some(dt)) => {
                return Err(refused(format!(
                    "dt_s: expected a positive time since the last step in s, found {dt}"
                )));
            }
            (Some(time), None) if !time.is_finite() => {
                return Err(refused(format!("time_s: expected a finite time in s, found {time}")));
            }
            (Some(time), None) if !self.told => (time, period),
            (Some(time), None) if time > self.now => (time, time - self.now),
            (Some(time), None) => {
                return Err(refused(format!(
                    "time_s: expected a time after that of the last step, {} s, found {time}; give the time of a clock \
                     that only runs forward",
                    self.now
                )));
            }
        };
        // Differences of a clock are rounded.
        if (elapsed - period).abs() < 1e-6 * period {
            elapsed = period;
        }
        let told = self.told || time_s.is_some();
        Ok((Self { now, told, held: self.held + elapsed }, elapsed))
    }
}

/// An autopilot at work: a measurement in, commands out, once per control period.
#[pyclass(frozen, module = "seatrial")]
pub struct Helm {
    autopilot: Engaged<f64>,
    description: Arc<Description>,
    memory: Mutex<Memory>,
}

impl Helm {
    fn memory(&self) -> PyResult<MutexGuard<'_, Memory>> {
        self.memory.lock().map_err(|_| refused("the helm failed earlier; make a new one"))
    }

    /// The first actuator whose thrust depends on the supply voltage.
    fn thrust_of_supply(&self) -> Option<&str> {
        let depends =
            |effect: &Effect| matches!(effect, Effect::Thrust(_, Some(table)) if table.needs_voltage());
        self.description.actuators.iter().find(|a| depends(&a.effect)).map(|a| a.name.as_str())
    }

    /// The index of an actuator by its name.
    fn actuator(&self, key: &str, name: &str) -> PyResult<usize> {
        let names = || self.description.actuators.iter().map(|a| a.name.as_str());
        names().position(|known| known == name).ok_or_else(|| {
            refused(format!("{key}: the vehicle has no actuator \"{name}\"{}", nearest(name, names())))
        })
    }
}

#[pymethods]
impl Helm {
    /// Commands {actuator: value in its own unit} from now on.
    ///
    /// measurement: the channels that were measured since the last step: x y z in m (NED), roll pitch yaw in rad,
    /// u v w over ground in m/s, p q r in rad/s, altitude in m (inf: no bottom within reach), u_water v_water w_water in
    /// m/s, battery (share left), voltage in V. A missing channel, None or nan keeps its last value and grows old by itself;
    /// what is impossible (yaw = 270 rad, u = inf) was not measured either, and is counted in `refused`. signals: measured
    /// commands of the actuators, in the unit of the command, by which a failed one is found. The autopilot begins when
    /// all that it needs of position, depth, attitude and rates has been measured once (`waiting_for`); before, commands
    /// are neutral. set_points: speed and lateral (m/s), heading and pitch (rad), depth (m) in place of guidance's, or
    /// north, east and down (m) by which the plan is moved: steering by hand, while safety does not react. time_s: when
    /// the samples were taken, s on a clock that runs forward, or dt_s: how long after the last step; a control period
    /// without either. Sooner than half a period after the last commands, these stay.
    ///
    /// Raises SimulationError for an unknown name, what is no number, and a time that does not advance; nothing of such a
    /// call is taken. Before the autopilot has begun, for an impossible battery or voltage too.
    #[pyo3(signature = (measurement, signals = None, *, set_points = None, time_s = None, dt_s = None))]
    fn step(
        &self,
        measurement: Named,
        signals: Option<Named>,
        set_points: Option<Named>,
        time_s: Option<f64>,
        dt_s: Option<f64>,
    ) -> PyResult<BTreeMap<String, f64>> {
        let set_point = set_point(set_points)?;
        let mut feedback = vec![f64::NAN; self.description.actuators.len()];
        for (name, command) in Named::scalars(signals)? {
            let index = self.actuator("signals", &name)?;
            if command.is_finite() {
                feedback[index] = self.description.actuators[index].signal(command);
            }
        }
        let samples = quantities(measurement)?;
        let mut memory = self.memory()?;
        let Memory { state, thought, clock } = &mut *memory;
        let (now, elapsed) = clock.after(time_s, dt_s, self.autopilot.period())?;
        let begun = thought.is_some();
        let mut next = state.intake().clone();
        next.elapse(elapsed);
        for &(of, value) in &samples {
            next.take(of, value);
        }
        if !begun {
            // At the desk a wrong unit is an error; under way it must not stop the vehicle.
            let told = samples.iter().filter(|(_, value)| value.is_finite());
            for of in told.map(|(of, _)| *of).filter(|of| !matches!(of, Quantity::Channel(_))) {
                if let Some(wrong) = next.refused().find(|wrong| wrong.of == of) {
                    return Err(refused(format!("{}: {wrong}", name_of(of))));
                }
            }
            if let Some(name) = self.thrust_of_supply().filter(|_| next.measured().voltage.is_nan()) {
                return Err(refused(format!(
                    "voltage: expected the supply in V with the first measurement, the thrust of {name} depends on it"
                )));
            }
        }
        (*state.intake_mut(), *clock) = (next, now);
        let ready = begun || self.autopilot.waiting_for(state.intake().measured()).next().is_none();
        if ready && (!begun || clock.held >= SOONEST * self.autopilot.period()) {
            let around = (set_point.as_ref(), clock.held);
            *thought = Some(self.autopilot.decide(state, Some(&feedback), around));
            clock.held = 0.0;
        }
        let commands = self.description.actuators.iter().zip(&state.signals);
        Ok(commands.map(|(actuator, signal)| (actuator.name.clone(), actuator.command(*signal))).collect())
    }

    /// The groups of channels that must be measured before the autopilot begins; empty once it has begun.
    #[getter]
    fn waiting_for(&self) -> PyResult<Vec<&'static str>> {
        let memory = self.memory()?;
        Ok(self.autopilot.waiting_for(memory.state.intake().measured()).collect())
    }

    /// The age in s of every channel that the autopilot uses: the time since its last good sample, inf before the first.
    #[getter]
    fn ages(&self) -> PyResult<BTreeMap<&'static str, f64>> {
        let memory = self.memory()?;
        let age = &memory.known().age;
        let used = (0..CHANNELS).filter(|&c| self.autopilot.uses()[c] != Use::Idle);
        Ok(used.map(|c| (CHANNEL_NAMES[c], age[c])).collect())
    }

    /// Samples that were not believed, by channel: how many, and what was wrong last: impossible, a jump, or the same value
    /// for too long.
    #[getter]
    fn refused(&self) -> PyResult<BTreeMap<&'static str, (u64, String)>> {
        let memory = self.memory()?;
        let impossible = memory.state.intake().refused();
        let mut refused: BTreeMap<_, _> =
            impossible.map(|wrong| (name_of(wrong.of), (wrong.count as u64, wrong.to_string()))).collect();
        let screen = memory.state.screen();
        for (c, name) in CHANNEL_NAMES.into_iter().enumerate() {
            let (count, frozen) = (screen.refused(c) as u64, screen.frozen_for(c));
            if count > 0 {
                let shown = memory.state.intake().measured().channels[c];
                let (_, _, unit) = Quantity::Channel(c).range();
                let why = if frozen > 0.0 {
                    format!(
                        "{shown:.4} {unit} for {frozen:.1} s, while the other sensors say that it must have changed"
                    )
                } else {
                    "changed faster than any vehicle".to_owned()
                };
                let entry = refused.entry(name).or_insert((0, why.clone()));
                entry.0 += count;
                if frozen > 0.0 {
                    entry.1 = why;
                }
            }
        }
        Ok(refused)
    }

    /// What the autopilot thought at the last step: mode, reaction, its cause and the channel that was stale, whether it has ended, the waypoint in
    /// hand, desired speed (m/s), heading (rad) and depth (m), errors (m), actuators given up, and the one that the motion makes suspect ("all" where none works); empty before the first.
    #[getter]
    fn thought(&self) -> PyResult<BTreeMap<&'static str, Fact>> {
        let memory = self.memory()?;
        let Some(thought) = &memory.thought else { return Ok(BTreeMap::new()) };
        let desired = &thought.desired;
        let cause = (thought.alert.cause as usize).checked_sub(1).map_or("", |i| WATCH_NAMES[i]);
        let channel = (thought.alert.channel as usize).checked_sub(1).map_or("", |c| CHANNEL_NAMES[c]);
        let given_up = self.description.actuators.iter().enumerate();
        let given_up = given_up.filter(|(i, _)| (thought.given_up as u64 >> i) & 1 == 1);
        let names: Vec<&str> = given_up.map(|(_, actuator)| actuator.name.as_str()).collect();
        let suspect = (thought.suspect as usize).checked_sub(1);
        let suspect = suspect.map_or("", |i| self.description.actuators.get(i).map_or("all", |a| &a.name));
        Ok(fact_map(BTreeMap::from([
            ("suspect", Value::Text(suspect.to_owned())),
            ("mode", Value::Text(self.autopilot.mode_name(thought.mode as usize).to_owned())),
            ("reaction", Value::Text(REACTIONS[thought.alert.level as usize].to_owned())),
            ("cause", Value::Text(cause.to_owned())),
            ("channel", Value::Text(channel.to_owned())),
            ("ended", Value::Flag(thought.ended > 0.5)),
            ("waypoint", Value::Number(desired.leg + 1.0)),
            ("distance", Value::Number(desired.distance)),
            ("speed", Value::Number(desired.speed)),
            ("heading", Value::Number(desired.heading)),
            ("depth", Value::Number(desired.depth)),
            ("cross_track", Value::Number(desired.cross_track)),
            ("vertical_error", Value::Number(desired.vertical_error)),
            ("given_up", Value::Text(names.join(" "))),
        ])))
    }

    /// The operator's reset: leaves every reaction, whatever called for it, and takes up the mission where it was
    /// interrupted. What is still true calls again after its time. Actuators that were given up stay so: see `declare_failed`.
    fn reset(&self) -> PyResult<()> {
        self.memory()?.state.reset(true);
        Ok(())
    }

    /// Takes an actuator out of the allocation from the next step on, or back into it.
    #[pyo3(signature = (actuator, failed = true))]
    fn declare_failed(&self, actuator: &str, failed: bool) -> PyResult<()> {
        let index = self.actuator("actuator", actuator)?;
        let mut memory = self.memory()?;
        self.autopilot.declare_failed(&mut memory.state, index, f64::from(u8::from(failed)));
        Ok(())
    }
}

/// The names behind the numbers of a flight: channels, groups, reactions and watches of the autopilot.
#[pyfunction]
pub fn autopilot_names() -> BTreeMap<&'static str, Vec<&'static str>> {
    BTreeMap::from([
        ("channels", CHANNEL_NAMES.to_vec()),
        ("groups", GROUP_NAMES.to_vec()),
        ("reactions", REACTIONS.to_vec()),
        ("watches", WATCH_NAMES.to_vec()),
        ("loops", seatrial::control::control_law::LOOPS.to_vec()),
        ("endings", seatrial::flight::summary::ENDINGS.to_vec()),
        ("set_points", SET_POINTS.to_vec()),
    ])
}
