//! `Autopilot`: an autopilot file; `Helm`: one at work, step by step.

use crate::convert::{Fact, Named, fact_map};
use crate::error::{VehicleError, raised, refused};
use crate::mission::Mission;
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::allocation::Allocator;
use seatrial::autopilot::settings::{Settings, built_in, built_in_names};
use seatrial::autopilot::{Autopilot as Engaged, AutopilotState};
use seatrial::description::Description;
use seatrial::error::nearest;
use seatrial::facts::Value;
use seatrial::navigation::{CHANNEL_NAMES, GROUP, GROUP_NAMES, Measurement};
use seatrial::safety::{REACTIONS, WATCH_NAMES};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

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
        let text = std::fs::read_to_string(&name_or_path).map_err(|error| {
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

    /// The mode table: per mode name, loops (six flags in the order X Y Z K M N), depth_by and from_speed_m_s.
    #[getter]
    fn modes(&self) -> Vec<BTreeMap<&'static str, Fact>> {
        let modes = self.settings.modes.iter().zip(&self.settings.file.modes);
        modes
            .map(|(mode, table)| {
                let loops = mode.active.iter().map(|on| f64::from(u8::from(*on))).collect();
                fact_map(BTreeMap::from([
                    ("name", Value::Text(mode.name.clone())),
                    ("loops", Value::Vector(loops)),
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
    fn engage(&self, vehicle: &Vehicle, mission: &Mission) -> PyResult<Helm> {
        self.settings.fits(&vehicle.description).map_err(raised)?;
        let autopilot =
            Engaged::new(&self.settings, &vehicle.description, &mission.core, &self.settings.tunables)
                .map_err(raised)?;
        let allocation = &self.settings.file.allocation;
        let allocator =
            Allocator::single(&vehicle.description, autopilot.model(), allocation).map_err(raised)?;
        let state = autopilot.begin(allocator);
        let measurement = Measurement::nothing(0.0);
        let description = vehicle.description.clone();
        Ok(Helm { autopilot, description, memory: Mutex::new((state, measurement)) })
    }

    fn __repr__(&self) -> String {
        format!("Autopilot('{}', {} modes)", self.name(), self.settings.modes.len())
    }
}

/// An autopilot at work: a measurement in, commands out, once per control period.
#[pyclass(frozen, module = "seatrial")]
pub struct Helm {
    autopilot: Engaged<f64>,
    description: Arc<Description>,
    memory: Mutex<(AutopilotState<f64>, Measurement<f64>)>,
}

#[pymethods]
impl Helm {
    /// Commands {actuator: value in its own unit} for the next control period.
    ///
    /// measurement: the channels that were measured since the last step: x y z in m (NED), roll pitch yaw in rad,
    /// u v w over ground in m/s, p q r in rad/s, altitude in m, u_water v_water w_water in m/s, battery (share left),
    /// voltage in V. Missing channels keep their last value and grow old. signals: measured commands of the
    /// actuators, in the unit of the command, by which a failed one is found. A number that is not finite was not
    /// measured. The autopilot begins when position, depth, attitude, velocity and rates have been measured once; before, commands are neutral.
    #[pyo3(signature = (measurement, signals = None))]
    fn step(&self, measurement: Named, signals: Option<Named>) -> PyResult<BTreeMap<String, f64>> {
        let mut memory = self.memory.lock().map_err(|_| refused("the helm was lost in an earlier error"))?;
        let (state, known) = &mut *memory;
        for age in &mut known.age {
            *age += self.autopilot.period();
        }
        for (name, value) in Named::scalars(Some(measurement))? {
            match CHANNEL_NAMES.iter().position(|known| *known == name) {
                // What is not a number was not measured.
                Some(_) if !value.is_finite() => {}
                Some(c) => {
                    known.channels[c] = value;
                    known.age[GROUP[c]] = 0.0;
                }
                None if name == "battery" => known.battery = value,
                None if name == "voltage" => known.voltage = value,
                None => {
                    let near = nearest(&name, CHANNEL_NAMES);
                    return Err(refused(format!("measurement: unknown channel \"{name}\"{near}")));
                }
            }
        }
        let names = || self.description.actuators.iter().map(|a| a.name.as_str());
        let mut feedback = vec![f64::NAN; self.description.actuators.len()];
        for (name, command) in Named::scalars(signals)? {
            let index = names().position(|known| known == name).ok_or_else(|| {
                refused(format!("signals: the vehicle has no actuator \"{name}\"{}", nearest(&name, names())))
            })?;
            feedback[index] = self.description.actuators[index].signal(command);
        }
        if known.is_complete() {
            self.autopilot.step(state, known, Some(&feedback));
        }
        let commands = self.description.actuators.iter().zip(&state.signals);
        Ok(commands.map(|(actuator, signal)| (actuator.name.clone(), actuator.command(*signal))).collect())
    }

    /// Takes an actuator out of the allocation from the next step on.
    fn declare_failed(&self, actuator: &str) -> PyResult<()> {
        let names = || self.description.actuators.iter().map(|a| a.name.as_str());
        let index = names().position(|name| name == actuator).ok_or_else(|| {
            refused(format!("actuator: the vehicle has no \"{actuator}\"{}", nearest(actuator, names())))
        })?;
        let mut memory = self.memory.lock().map_err(|_| refused("the helm was lost in an earlier error"))?;
        self.autopilot.declare_failed(&mut memory.0, index, 1.0);
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
        ("loops", seatrial::control_law::LOOPS.to_vec()),
        ("endings", seatrial::closed_loop::summary::ENDINGS.to_vec()),
    ])
}
