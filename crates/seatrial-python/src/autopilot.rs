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
use seatrial::control::autopilot::file::Control;
use seatrial::control::autopilot::set_point::SET_POINTS;
use seatrial::control::autopilot::settings::{Settings, built_in, built_in_names};
use seatrial::control::autopilot::{Autopilot as Engaged, AutopilotState, Thought};
use seatrial::control::navigation::{CHANNEL_NAMES, GROUP, GROUP_NAMES, Measurement};
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
        let memory = Memory { state, known: Measurement::nothing(0.0), thought: None };
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

/// What a helm remembers: the autopilot's state, the measurement, and what was thought of it last.
struct Memory {
    state: AutopilotState<f64>,
    known: Measurement<f64>,
    thought: Option<Thought<f64>>,
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
        self.memory.lock().map_err(|_| refused("the helm was lost in an earlier error"))
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
    /// Commands {actuator: value in its own unit} for the next control period.
    ///
    /// measurement: the channels that were measured since the last step: x y z in m (NED), roll pitch yaw in rad,
    /// u v w over ground in m/s, p q r in rad/s, altitude in m (inf: no bottom within reach), u_water v_water w_water in
    /// m/s, battery (share left), voltage in V. Missing channels keep their last value and grow old; a number that is
    /// not finite was not measured. signals: measured commands of the actuators, in the unit of the command, by which
    /// a failed one is found. The autopilot begins when position, depth, attitude and rates have been measured once
    /// (`waiting_for`); before, commands are neutral. set_points: speed and lateral (m/s), heading and pitch (rad), depth
    /// (m) in place of guidance's, or north, east and down (m) by which the plan is moved: steering by hand, while safety
    /// does not react.
    #[pyo3(signature = (measurement, signals = None, *, set_points = None))]
    fn step(
        &self,
        measurement: Named,
        signals: Option<Named>,
        set_points: Option<Named>,
    ) -> PyResult<BTreeMap<String, f64>> {
        let set_point = set_point(set_points)?;
        let mut feedback = vec![f64::NAN; self.description.actuators.len()];
        for (name, command) in Named::scalars(signals)? {
            let index = self.actuator("signals", &name)?;
            if command.is_finite() {
                feedback[index] = self.description.actuators[index].signal(command);
            }
        }
        let measurement = Named::scalars(Some(measurement))?;
        let channel = |name: &str| CHANNEL_NAMES.iter().position(|known| *known == name);
        for name in measurement.keys().filter(|name| channel(name).is_none()) {
            if !["battery", "voltage"].contains(&name.as_str()) {
                let known = CHANNEL_NAMES.iter().copied().chain(["battery", "voltage"]);
                return Err(refused(format!(
                    "measurement: unknown channel \"{name}\"{}",
                    nearest(name, known)
                )));
            }
        }
        let given = |name: &str| measurement.get(name).copied().filter(|x| x.is_finite());
        if let Some(battery) = given("battery").filter(|share| !(0.0..=1.0).contains(share)) {
            return Err(refused(format!("battery: expected the share left, from 0 to 1, found {battery}")));
        }
        if let Some(voltage) = given("voltage").filter(|v| *v <= 0.0) {
            return Err(refused(format!("voltage: expected a positive supply in V, found {voltage}")));
        }
        let mut memory = self.memory()?;
        let Memory { state, known, thought } = &mut *memory;
        let supplied = given("voltage").is_some() || known.voltage.is_finite();
        if let Some(name) = self.thrust_of_supply().filter(|_| !supplied) {
            return Err(refused(format!(
                "voltage: expected the supply in V with the first measurement, the thrust of {name} depends on it"
            )));
        }
        for age in &mut known.age {
            *age += self.autopilot.period();
        }
        for (name, value) in measurement {
            match channel(&name) {
                // No bottom within reach is a measurement; what is not a number was not measured.
                Some(c) if value.is_finite() || (name == "altitude" && value == f64::INFINITY) => {
                    known.channels[c] = value;
                    known.age[GROUP[c]] = 0.0;
                }
                None if name == "battery" && value.is_finite() => known.battery = value,
                None if name == "voltage" && value.is_finite() => known.voltage = value,
                _ => {}
            }
        }
        if known.waiting_for().next().is_none() {
            *thought = Some(self.autopilot.step_to(state, known, Some(&feedback), set_point.as_ref()));
        }
        let commands = self.description.actuators.iter().zip(&state.signals);
        Ok(commands.map(|(actuator, signal)| (actuator.name.clone(), actuator.command(*signal))).collect())
    }

    /// The groups of channels that must be measured before the autopilot begins; empty once it has begun.
    #[getter]
    fn waiting_for(&self) -> PyResult<Vec<&'static str>> {
        Ok(self.memory()?.known.waiting_for().collect())
    }

    /// What the autopilot thought at the last step: mode, reaction and its cause, whether it has ended, the waypoint in
    /// hand, desired speed (m/s), heading (rad) and depth (m), errors (m), actuators given up; empty before the first.
    #[getter]
    fn thought(&self) -> PyResult<BTreeMap<&'static str, Fact>> {
        let memory = self.memory()?;
        let Some(thought) = &memory.thought else { return Ok(BTreeMap::new()) };
        let desired = &thought.desired;
        let cause = (thought.alert.cause as usize).checked_sub(1).map_or("", |i| WATCH_NAMES[i]);
        let given_up = self.description.actuators.iter().enumerate();
        let given_up = given_up.filter(|(i, _)| (thought.given_up as u64 >> i) & 1 == 1);
        let names: Vec<&str> = given_up.map(|(_, actuator)| actuator.name.as_str()).collect();
        Ok(fact_map(BTreeMap::from([
            ("mode", Value::Text(self.autopilot.mode_name(thought.mode as usize).to_owned())),
            ("reaction", Value::Text(REACTIONS[thought.alert.level as usize].to_owned())),
            ("cause", Value::Text(cause.to_owned())),
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
