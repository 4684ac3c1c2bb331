//! `Vehicle`: a vehicle file, its coefficients and the terms of its equation of motion.

use crate::convert::{Array, Fact, Named, Numbers, Table, fact_map};
use crate::error::{VehicleError, raised, refused};
use crate::pickle::{self, Parts, parts, restorer};
use crate::run::{Run, Simulation, State, inputs};
use crate::text::file_text;
use pyo3::prelude::*;
use seatrial::control::allocation::authority;
use seatrial::control::allocation::report::RowAuthority;
use seatrial::description::facts::{self, Value};
use seatrial::description::geometry::Shape;
use seatrial::description::vehicle_file::ModelErrorTable;
use seatrial::description::{Description, built_in, built_in_names};
use seatrial::error::nearest;
use seatrial::model::current::Current;
use seatrial::model::kinematics::rotation;
use seatrial::model::linearize::{Form, linearize};
use seatrial::model::vehicle::Instant;
use seatrial::number::algebra::Vec6;
use seatrial::number::dual::Dual;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A speed that can be one.
fn finite(speed_m_s: f64) -> PyResult<f64> {
    if !speed_m_s.is_finite() {
        return Err(refused(format!("speed_m_s: expected a finite number in m/s, found {speed_m_s}")));
    }
    Ok(speed_m_s)
}

/// Depths of O below the surface, one for each of n points; none where none are given.
fn depths(depth: Option<Numbers>, n: usize) -> PyResult<Vec<f64>> {
    let depths = depth.map_or(Ok(Vec::new()), |depth| depth.held("depth", n))?;
    if depths.len() != n && !depths.is_empty() {
        return Err(refused(format!("depth: expected {n} numbers or one, found {}", depths.len())));
    }
    finite_depths(&depths)?;
    Ok(depths)
}

fn finite_depths(depths: &[f64]) -> PyResult<()> {
    match depths.iter().find(|depth| !depth.is_finite()) {
        None => Ok(()),
        Some(wrong) => {
            Err(refused(format!("depth: expected finite numbers in m below the surface, found {wrong}")))
        }
    }
}

/// A vehicle: hull, mass, coefficients and actuators. Immutable.
#[pyclass(frozen, module = "seatrial")]
pub struct Vehicle {
    pub description: Arc<Description>,
}

impl Vehicle {
    fn of(description: Description) -> Self {
        Self { description: Arc::new(description) }
    }

    /// Velocities, rotations and currents of a call, all of the longest's length.
    #[expect(clippy::type_complexity, reason = "three columns of one table")]
    fn columns(
        nu: &Numbers,
        attitude: &Numbers,
        current: Option<&Numbers>,
    ) -> PyResult<Vec<(Vec6<f64>, [f64; 4], Option<Current<f64>>)>> {
        let (nu, attitude) = (nu.rows::<6>("nu")?, attitude.attitudes("attitude")?);
        let current = current.map(|c| c.rows::<3>("current")).transpose()?;
        let n = nu.len().max(attitude.len()).max(current.as_ref().map_or(1, Vec::len));
        let fits = |len: usize| len == n || len == 1;
        if !(fits(nu.len()) && fits(attitude.len()) && current.as_ref().is_none_or(|c| fits(c.len()))) {
            return Err(refused(format!(
                "nu, attitude and current: expected equal numbers of rows or one, found {}, {} and {}",
                nu.len(),
                attitude.len(),
                current.map_or(1, |c| c.len())
            )));
        }
        Ok((0..n)
            .map(|i| {
                let current = current.as_ref().map(|c| Current {
                    velocity: c[i % c.len()],
                    rate: [0.0; 3],
                    pressed: None,
                });
                (nu[i % nu.len()], attitude[i % attitude.len()], current)
            })
            .collect())
    }
}

#[pymethods]
impl Vehicle {
    /// The vehicle of a built-in name or a file.
    ///
    /// Raises VehicleError (a ValueError) that names file, key, what was expected and what was found.
    #[staticmethod]
    fn load(name_or_path: PathBuf) -> PyResult<Self> {
        let name = name_or_path.to_string_lossy().into_owned();
        if let Some(text) = built_in(&name) {
            return Description::from_toml(text, &name).map(Self::of).map_err(raised);
        }
        let text = file_text(&name_or_path).map_err(|error| {
            let near = nearest(&name, built_in_names());
            VehicleError::new_err(format!(
                "{name}: expected a vehicle file or one of the built-in vehicles {}, but the file cannot be read ({error}){near}",
                built_in_names().join(", ")
            ))
        })?;
        Description::from_toml(&text, &name).map(Self::of).map_err(raised)
    }

    /// The vehicle of the TOML text of a vehicle file; `source` stands in messages.
    #[staticmethod]
    #[pyo3(signature = (text, source = "<text>"))]
    fn from_toml(text: &str, source: &str) -> PyResult<Self> {
        Description::from_toml(text, source).map(Self::of).map_err(raised)
    }

    /// Names of the built-in vehicles.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        built_in_names()
    }

    /// The vehicle file with every coefficient written out, TOML.
    fn to_toml(&self) -> String {
        self.description.filled_file().to_toml()
    }

    /// The same as plain data: the tables of the file by name, coefficients written out.
    fn to_dict(&self) -> Table {
        Table::of(&self.description.filled_file())
    }

    /// Name of the vehicle.
    #[getter]
    fn name(&self) -> &str {
        &self.description.file.name
    }

    /// What the vehicle is, in a sentence.
    #[getter]
    fn description(&self) -> &str {
        &self.description.file.description
    }

    /// Names of the actuators in the order of the allocation matrix's columns.
    #[getter]
    fn actuators(&self) -> Vec<String> {
        self.description.actuators.iter().map(|a| a.name.clone()).collect()
    }

    /// Rows of the wrench that the vehicle can command, among X Y Z K M N.
    #[getter]
    fn controllable(&self) -> Vec<String> {
        self.description.file.controllable.clone()
    }

    /// Per actuator: kind, group, unit, neutral and limits of its command, place, wrench per newton, power.
    fn actuator_info(&self) -> BTreeMap<String, BTreeMap<&'static str, Fact>> {
        let d = &self.description;
        let named = |(k, name): (usize, String)| (name, fact_map(facts::actuator(d, k)));
        self.actuators().into_iter().enumerate().map(named).collect()
    }

    /// Per actuator the table of its motor as the vehicle file has it, defaults filled in; empty for an ideal motor.
    ///
    /// Keys maximum_ahead, maximum_astern, minimum_ahead, minimum_astern, n_acc_per_s and n_dec_per_s in the unit of the
    /// command, below_minimum ("lift" or "zero"), K_V, T_1_s and T_t_s; what has no default and is not given is missing.
    fn motors(&self) -> BTreeMap<String, Table> {
        let named = facts::motors(&self.description).into_iter();
        named.map(|(name, motor)| (name, motor.as_ref().map_or_else(Table::empty, Table::of))).collect()
    }

    /// Smallest and largest supply voltage, V, of every table of thrust that was measured at several, by its name.
    fn table_voltages(&self) -> BTreeMap<String, (f64, f64)> {
        facts::table_voltages(&self.description)
    }

    /// "spheroid", "box" or "frame"; None when the file has no geometry.
    #[getter]
    fn hull_shape(&self) -> Option<&'static str> {
        self.description.file.geometry.as_ref().map(|geometry| match geometry.shape {
            Shape::Spheroid => "spheroid",
            Shape::Box => "box",
            Shape::Frame => "frame",
        })
    }

    /// Measures of the hull in m (length, diameter, height); empty when the file has none.
    fn geometry(&self) -> BTreeMap<&'static str, f64> {
        facts::geometry(&self.description)
    }

    /// Water and gravity for which the coefficients hold: rho in kg/m3, g in m/s2.
    fn environment(&self) -> BTreeMap<&'static str, f64> {
        facts::environment(&self.description)
    }

    /// Hotel load in W and battery energy in W h; empty when the file has none.
    fn power(&self) -> BTreeMap<&'static str, f64> {
        facts::power(&self.description)
    }

    /// The coefficients by name, SI.
    fn coefficients(&self) -> BTreeMap<String, f64> {
        self.description.named_coefficients().into_iter().collect()
    }

    /// Per coefficient, absent ones too: unit, start value, default bounds (lower, upper), description.
    ///
    /// Of what the geometry tells, else None: `formula`, the value by it, SI; `low` and `high`, the ends of its stated 95 % interval; `sd`, the
    /// standard deviation of a normal distribution whose interval is as wide; `source`.
    fn coefficient_info(&self) -> BTreeMap<String, BTreeMap<&'static str, Fact>> {
        let info = facts::coefficients(&self.description);
        info.into_iter().map(|(name, facts)| (name, fact_map(facts))).collect()
    }

    /// The same vehicle with other values of some coefficients, SI.
    ///
    /// Raises VehicleError for an unknown name or an impossible mass matrix.
    fn with_coefficients(&self, coefficients: Named) -> PyResult<Self> {
        let values: Vec<(String, f64)> = Named::scalars(Some(coefficients))?.into_iter().collect();
        self.description.with_coefficients(&values).map(Self::of).map_err(raised)
    }

    /// The same vehicle with the [model_error] of its file: what its model leaves unexplained, by which a
    /// navigation filter on it goes unless it is told otherwise.
    ///
    /// force (6,), standard deviation of the force and moment that the model does not know, N and N m;
    /// force_time_s, its time constant; acceleration (6,), standard deviation of the velocities after a second
    /// of white acceleration, m/s and rad/s. Raises VehicleError for a number beyond its range.
    #[pyo3(signature = (*, force, force_time_s, acceleration))]
    fn with_model_error(&self, force: Numbers, force_time_s: f64, acceleration: Numbers) -> PyResult<Self> {
        let table = ModelErrorTable {
            force: force.row("force")?,
            force_time_s,
            acceleration: acceleration.row("acceleration")?,
        };
        self.description.with_model_error(Some(table)).map(Self::of).map_err(raised)
    }

    /// The same vehicle without [model_error] in its file.
    fn without_model_error(&self) -> PyResult<Self> {
        self.description.with_model_error(None).map(Self::of).map_err(raised)
    }

    /// M = M_RB + M_A, shape (6, 6), in kg, kg m, kg m2.
    fn mass_matrix(&self) -> Array {
        Array::rows(&self.nominal().mass_matrix, false)
    }

    /// Wrench about O per newton of each actuator, shape (6, actuators).
    fn allocation_matrix(&self) -> Array {
        let count = self.description.actuators.len();
        let columns: Vec<Vec6<f64>> = (0..count).map(|k| self.description.wrench(k)).collect();
        let values = (0..6).flat_map(|i| columns.iter().map(move |c| c[i])).collect();
        Array::new(&[6, columns.len()], values)
    }

    /// Per row X Y Z K M N what the actuators can command at speed_m_s, ahead through still water.
    ///
    /// controllable: whether the vehicle file lists the row; share: part of a unit demand in this row alone that can be
    /// produced with all six rows held; controlled_share: with the controllable ones held; reach: largest wrench in
    /// positive and negative direction, N or N m; size: the row's weight over the largest singular value.
    #[pyo3(signature = (speed_m_s = 0.0))]
    fn authority(&self, speed_m_s: f64) -> PyResult<BTreeMap<&'static str, BTreeMap<&'static str, Fact>>> {
        let found = authority(&self.description, finite(speed_m_s)?);
        let facts = |row: &RowAuthority| {
            fact_map(BTreeMap::from([
                ("controllable", Value::Flag(row.controllable)),
                ("share", Value::Number(row.share)),
                ("controlled_share", Value::Number(row.controlled_share)),
                ("reach", Value::Vector(row.reach.to_vec())),
                ("size", Value::Number(row.size)),
            ]))
        };
        Ok(found.rows.iter().map(|row| (row.row, facts(row))).collect())
    }

    /// The same in sentences: what cannot be commanded, and what remains after the loss of each actuator.
    #[pyo3(signature = (speed_m_s = 0.0))]
    fn authority_sentences(&self, speed_m_s: f64) -> PyResult<Vec<String>> {
        Ok(authority(&self.description, finite(speed_m_s)?).sentences())
    }

    /// The acceleration nu' under the wrench tau, body frame, m/s2 and rad/s2.
    ///
    /// nu and tau (n, 6) or (6,); attitude (n, 4) quaternion body to NED or (n, 3) roll, pitch, yaw in
    /// rad; current (3,) or (n, 3), NED, m/s. Returns the shape of nu. The pull of a tether, which goes by the
    /// place of the vehicle, is left out. depth, one number or (n,), is that of O below the surface in m; all of the
    /// vehicle is under water without it. Fossen (2011), equation 7.9.
    #[pyo3(signature = (nu, attitude, tau, current = None, *, depth = None))]
    fn acceleration(
        &self,
        nu: Numbers,
        attitude: Numbers,
        tau: Numbers,
        current: Option<Numbers>,
        depth: Option<Numbers>,
    ) -> PyResult<Array> {
        let columns = Self::columns(&nu, &attitude, current.as_ref())?;
        let wrenches = tau.rows::<6>("tau")?;
        if wrenches.len() != 1 && wrenches.len() != columns.len() && columns.len() != 1 {
            return Err(refused(format!(
                "tau: expected {} rows or one, found {}",
                columns.len(),
                wrenches.len()
            )));
        }
        let count = columns.len().max(wrenches.len());
        let depths = depths(depth, count)?;
        let vehicle = self.at_surface(!depths.is_empty());
        let rows: Vec<Vec6<f64>> = (0..count)
            .map(|i| {
                let (nu, attitude, current) = columns[i % columns.len()];
                let instant = Instant { tau: wrenches[i % wrenches.len()], current, ..Instant::default() };
                let place = depths.get(i).map(|depth| [0.0, 0.0, *depth]);
                vehicle.acceleration((place.as_ref(), &rotation(&attitude)), &nu, &instant)
            })
            .collect();
        Ok(Array::rows(&rows, nu.is_single() && rows.len() == 1))
    }

    /// Every term of the equation of motion as force on the vehicle, (n, 6), body frame, N and N m.
    ///
    /// Keys rigid_body (-C_RB nu), added_mass (-C_A nu_r + M_A nu_c'), damping (-D nu_r), lift, restoring
    /// (-g), and bias where the vehicle has one; their sum + tau = mass_matrix @ acceleration. depth, one number or
    /// (n,), is that of O below the surface in m: each term is then that of the part under water, and the mass matrix
    /// M_RB + submerged share times M_A.
    #[pyo3(signature = (nu, attitude, current = None, *, depth = None))]
    fn forces(
        &self,
        nu: Numbers,
        attitude: Numbers,
        current: Option<Numbers>,
        depth: Option<Numbers>,
    ) -> PyResult<BTreeMap<&'static str, Array>> {
        let columns = Self::columns(&nu, &attitude, current.as_ref())?;
        let depths = depths(depth, columns.len())?;
        let vehicle = self.at_surface(!depths.is_empty());
        let (rows, shares): (Vec<_>, Vec<f64>) = columns
            .iter()
            .enumerate()
            .map(|(i, (nu, attitude, current))| {
                let (r, current) = (rotation(attitude), current.as_ref());
                match (&vehicle.surface, depths.get(i)) {
                    (Some(surface), Some(&depth)) => {
                        let (terms, wet) = vehicle.forces_at(surface, depth, (&r, nu), current);
                        (terms, wet.share)
                    }
                    _ => (vehicle.forces(&r, nu, current), 1.0),
                }
            })
            .unzip();
        let single = nu.is_single() && rows.len() == 1;
        let term = |read: fn(&seatrial::model::vehicle::Forces<f64>) -> Vec6<f64>| {
            Array::rows(&rows.iter().map(read).collect::<Vec<_>>(), single)
        };
        let mut terms = BTreeMap::from([
            ("rigid_body", term(|f| f.rigid_body)),
            ("added_mass", term(|f| f.added_mass)),
            ("damping", term(|f| f.damping)),
            ("lift", term(|f| f.lift)),
            ("restoring", term(|f| f.restoring)),
        ]);
        if let Some(bias) = vehicle.bias {
            let acting: Vec<Vec6<f64>> = shares.iter().map(|share| bias.map(|x| x * share)).collect();
            terms.insert("bias", Array::rows(&acting, single));
        }
        Ok(terms)
    }

    /// A, shape (12, 12), and B, shape (12, 6), of the equation of motion at a velocity, an attitude and a wrench.
    ///
    /// State [p_n, delta, nu] with R = R_0 exp(S(delta)), R_0 held, so that delta' = omega + 1/2 delta x omega;
    /// with form="euler" [x y z phi theta psi nu]. nu (6,), attitude (4,) quaternion or (3,) roll, pitch, yaw,
    /// tau (6,), current (3,) NED. A = df/dx and B = df/dtau, exact to rounding (dual numbers). depth, that of O below
    /// the surface in m, lets the surface count; all of the vehicle is under water without it.
    #[pyo3(signature = (nu, attitude, tau, current = None, *, form = "rotation", depth = None))]
    fn linearize(
        &self,
        nu: Numbers,
        attitude: Numbers,
        tau: Numbers,
        current: Option<Numbers>,
        form: &str,
        depth: Option<f64>,
    ) -> PyResult<(Array, Array)> {
        let form = match form {
            "rotation" => Form::Rotation,
            "euler" => Form::Euler,
            _ => return Err(refused(format!("form: expected rotation or euler, found \"{form}\""))),
        };
        let tau = tau.row::<6>("tau")?;
        let columns = Self::columns(&nu, &attitude, current.as_ref())?;
        let [(nu, attitude, current)] = columns[..] else {
            return Err(refused("nu, attitude and current: expected one row each, a tangent has one point"));
        };
        finite_depths(depth.as_slice())?;
        let vehicle = seatrial::model::vehicle::Vehicle::nominal_in(
            &self.description,
            Dual { value: 0.0, partials: 0.0 },
        )
        .beneath(&self.description, self.description.file.environment.g_m_s2, depth.map(|_| 0.0));
        let tangent = linearize(&vehicle, form, &attitude, &nu, (&tau, current.as_ref(), depth));
        Ok((Array::rows(&tangent.a, false), Array::rows(&tangent.b, false)))
    }

    /// The run under commands {actuator: (n,)} in the actuators' own units, held from sample to sample; one number is held
    /// for the whole run. With `initial` the final_state of a run before, the run goes on as if there were one.
    ///
    /// t (n,) uniform, s; missing actuators stay at neutral; current (3,) or (n, 3), NED, m/s; free names
    /// the free axes among XYZKMN, the others keep their velocity; tau (n, 6) is a wrench besides the
    /// actuators'; voltage_v (n,) or one number, V; max_step_s, s; rho, kg/m3; g, m/s2; surface: where the sea ends, m
    /// down (0 where z is the depth), without it all of the vehicle is under water. Runge-Kutta of fourth order.
    ///
    /// Raises DivergenceError, a SimulationError, where the run diverges: when, in which axis, why, and what to do.
    #[pyo3(signature = (t, commands = None, initial = None, current = None, free = "XYZKMN", tau = None, *, voltage_v = None, max_step_s = 0.02, rho = None, g = None, surface = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn simulate(
        &self,
        py: Python<'_>,
        t: Numbers,
        commands: Option<Named>,
        initial: Option<PyRef<'_, State>>,
        current: Option<Numbers>,
        free: &str,
        tau: Option<Numbers>,
        voltage_v: Option<Numbers>,
        max_step_s: f64,
        rho: Option<f64>,
        g: Option<f64>,
        surface: Option<f64>,
    ) -> PyResult<Run> {
        let inputs = inputs(t, commands, current, tau, voltage_v, (rho, g, surface))?;
        Simulation::new(&self.description, &inputs, initial.as_deref(), free, max_step_s)?.run(py, None, None)
    }

    /// The highest point of the hull over its centre of buoyancy, shape (3,), body frame, m.
    fn hull_top(&self) -> Array {
        Array::rows(&[self.description.hull_top()], true)
    }

    /// Depth of O in m at which the vehicle floats upright and at rest; just under water where it is too heavy to float.
    #[pyo3(signature = (*, rho = None, g = None))]
    fn floating_depth(&self, rho: Option<f64>, g: Option<f64>) -> PyResult<f64> {
        let environment = self.description.file.environment.with(rho, g).map_err(raised)?;
        Ok(self.description.floating_depth(environment))
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        Ok((restorer(py, "_restored_vehicle")?, parts(&self.description)))
    }

    fn __repr__(&self) -> String {
        format!("Vehicle('{}', {} actuators)", self.name(), self.description.actuators.len())
    }
}

impl Vehicle {
    fn nominal(&self) -> seatrial::model::vehicle::Vehicle<f64> {
        seatrial::model::vehicle::Vehicle::nominal(&self.description)
    }

    /// The same beneath a surface at depth 0, where that counts.
    fn at_surface(&self, counts: bool) -> seatrial::model::vehicle::Vehicle<f64> {
        let g = self.description.file.environment.g_m_s2;
        self.nominal().beneath(&self.description, g, counts.then_some(0.0))
    }
}

/// The vehicle of the text of its file with exactly these coefficients: how a pickled one comes back.
#[pyfunction]
#[pyo3(name = "_restored_vehicle")]
pub fn restored_vehicle(text: &str, coefficients: Numbers) -> PyResult<Vehicle> {
    pickle::description(text, coefficients).map(Vehicle::of)
}
