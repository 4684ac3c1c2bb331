//! From a vehicle file to a checked [`Description`]: coefficients filled from the geometry, actuators placed, everything
//! refused that cannot move.
//!
//! Tests: `tests/files.rs`.

use super::coefficients::{self as names, FORCES, Layout, MASS};
use super::missing;
use super::placement::{place, place_fin};
use super::values::Description;
use super::vehicle_file::{CrossFlowTable, ModelErrorTable, TetherTable, VehicleFile};
use crate::error::Error;
use crate::model::vehicle::Vehicle;
use crate::number::algebra::pivots;
use crate::ranges;
use std::collections::BTreeMap;

impl Description {
    /// Reads, fills and checks a vehicle file.
    ///
    /// # Errors
    /// What is wrong with the file, where, and what to do.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, Error> {
        let read = VehicleFile::parse(text, source_name);
        // One message for all that is missing, whether the reader stumbles over it or the physics would.
        match (missing::complaint(text), read) {
            (Some(message), Ok(_)) => Err(Error::vehicle(source_name, message)),
            (Some(message), Err(error)) if error.to_string().contains("missing field") => {
                Err(Error::vehicle(source_name, message))
            }
            (_, read) => Self::new(read?, source_name),
        }
    }

    /// Fills and checks a parsed file.
    ///
    /// # Errors
    /// What is wrong with the file, where, and what to do.
    pub fn new(file: VehicleFile, source_name: &str) -> Result<Self, Error> {
        let fail = |message: String| Error::vehicle(source_name, message);
        let environment = file.environment;
        if let Some(row) = file.controllable.iter().find(|row| !FORCES.contains(&row.as_str())) {
            return Err(fail(format!("controllable: expected rows among X Y Z K M N, found \"{row}\"")));
        }
        if let Some(complaint) = file.geometry.as_ref().and_then(super::geometry::Geometry::complaint) {
            return Err(fail(complaint));
        }
        if let Some(complaint) = file.cross_flow.as_ref().and_then(CrossFlowTable::complaint) {
            return Err(fail(complaint));
        }
        if let Some(complaint) = file.tether.as_ref().and_then(TetherTable::complaint) {
            return Err(fail(complaint));
        }
        let strips = match (&file.cross_flow, &file.geometry) {
            (Some(table), _) => Some(table.strips()),
            (None, geometry) => geometry.as_ref().map(super::geometry::Geometry::strips),
        };
        let thrusters = file.thrusters.iter().map(|t| &t.name);
        let actuator_names: Vec<String> =
            thrusters.chain(file.fins.iter().map(|f| &f.name)).cloned().collect();
        for (k, name) in actuator_names.iter().enumerate() {
            if name.is_empty() || name.contains('.') || actuator_names[..k].contains(name) {
                let (list, k) = match k.checked_sub(file.thrusters.len()) {
                    None => ("thrusters", k),
                    Some(k) => ("fins", k),
                };
                return Err(fail(format!(
                    "{list}[{k}].name: expected a unique name without a dot, found \"{name}\""
                )));
            }
        }
        let layout = Layout::new(actuator_names);
        let mut coefficients = vec![0.0; layout.len()];
        let mut actuators = Vec::with_capacity(layout.actuators());
        let mut slots = coefficients[names::HULL..].chunks_exact_mut(names::PER_ACTUATOR);
        let mut slot = || slots.next().expect("as many slots as actuators");
        for thruster in &file.thrusters {
            let placed = place(&file, thruster, slot());
            actuators.push(placed.map_err(|m| fail(format!("thruster \"{}\": {m}", thruster.name)))?);
        }
        for fin in &file.fins {
            let placed = place_fin(&file, fin, slot());
            actuators.push(placed.map_err(|m| fail(format!("fin \"{}\": {m}", fin.name)))?);
        }

        let tabulated = coefficients.clone();
        let mut given: Vec<Option<&str>> = vec![None; layout.len()];
        for (name, &value) in &file.coefficients {
            let index = layout.find(name).map_err(|m| fail(format!("coefficients: {m}")))?;
            agree(name, value, given[index].map(|twin| (twin, coefficients[index])))
                .map_err(|m| fail(format!("coefficients.{m}")))?;
            coefficients[index] = value;
            given[index] = Some(name);
        }
        if given[MASS].is_none() {
            return Err(fail("coefficients.m: the mass in kg is missing; weigh the vehicle in air".into()));
        }
        let m = coefficients[MASS];
        let mut start_values = vec![None; layout.len()];
        for start in file.geometry.iter().flat_map(|g| g.start_values(m, environment.rho_kg_m3)) {
            let index = start.index;
            start_values[index] = Some(start);
            if given[index].is_none() && !by_strips(index, &coefficients) {
                coefficients[index] = start.value;
            }
        }
        let trim = file.trim.unwrap_or_default();
        for (index, value) in [
            (names::BUOYANCY, (m - trim.weight_in_water_kg.unwrap_or(0.0)) * environment.g_m_s2),
            (
                names::CENTRE_OF_BUOYANCY + 2,
                coefficients[names::CENTRE_OF_GRAVITY + 2] - trim.righting_arm_m.unwrap_or(0.0),
            ),
        ] {
            let measured =
                if index == names::BUOYANCY { trim.weight_in_water_kg } else { trim.righting_arm_m };
            if given[index].is_none() && (index == names::BUOYANCY || measured.is_some()) {
                coefficients[index] = value;
            } else if let (Some(name), Some(_)) = (given[index], measured) {
                return Err(fail(format!(
                    "coefficients.{name}: found together with what [trim] says of it; keep one of the two"
                )));
            }
        }
        let description = Self { file, layout, coefficients, start_values, strips, tabulated, actuators };
        description.check().map_err(fail)?;
        Ok(description)
    }

    /// The vehicle of a file with exactly these coefficients, in the order of its layout: a vehicle put together again
    /// from its parts.
    ///
    /// # Errors
    /// What is wrong with the file or the coefficients, and where.
    pub fn from_parts(text: &str, coefficients: Vec<f64>, source_name: &str) -> Result<Self, Error> {
        let mut description = Self::from_toml(text, source_name)?;
        let (expected, found) = (description.layout.len(), coefficients.len());
        if found != expected {
            let message = format!("expected {expected} coefficients, found {found}");
            return Err(Error::vehicle(source_name, message));
        }
        description.coefficients = coefficients;
        description.check().map_err(|message| Error::vehicle(source_name, message))?;
        Ok(description)
    }

    /// The same vehicle with other values of some coefficients.
    ///
    /// # Errors
    /// An unknown name, a value that is not finite, two values for a symmetric pair, or a mass matrix
    /// that is not positive definite.
    pub fn with_coefficients(&self, values: &[(String, f64)]) -> Result<Self, Error> {
        let fail = |message: String| Error::vehicle(&self.file.name, message);
        let mut changed = self.clone();
        let mut given = BTreeMap::new();
        for (name, value) in values {
            let index = self.layout.find(name).map_err(fail)?;
            agree(name, *value, given.insert(index, (name.as_str(), *value))).map_err(fail)?;
            changed.coefficients[index] = *value;
        }
        changed.check().map_err(fail)?;
        Ok(changed)
    }

    /// The same vehicle, of which the file says what its model left unexplained, or with `None` nothing.
    ///
    /// # Errors
    /// A number beyond its range.
    pub fn with_model_error(&self, table: Option<ModelErrorTable>) -> Result<Self, Error> {
        let file = VehicleFile { model_error: table, ..self.file.clone() };
        Self::from_parts(&file.to_toml(), self.coefficients.clone(), &self.file.name)
    }

    /// What is wrong with a value of a coefficient, and with which.
    pub fn complaint(&self, index: usize, value: f64) -> Option<String> {
        // What is not there has no meaning: the rate limit of a motor without one.
        if value == 0.0 && index >= names::HULL && !self.uses(index) {
            return None;
        }
        let name = self.layout.name(index);
        ranges::coefficient(&name).complaint(value).map(|wrong| format!("coefficient {name}: {wrong}"))
    }

    fn check(&self) -> Result<(), String> {
        let c = &self.coefficients;
        if let Some(complaint) = (0..c.len()).find_map(|i| self.complaint(i, c[i])) {
            return Err(complaint);
        }
        if let Some(i) = (names::CROSS_FLOW..names::TETHER).find(|&i| c[i] != 0.0 && !self.uses(i)) {
            return Err(format!(
                "coefficient {}: the shape of the hull is missing, which defines its strips; give [cross_flow] with x_m and diameter_m, or [geometry]",
                self.layout.name(i)
            ));
        }
        if let Some(i) = (names::TETHER..names::HULL).find(|&i| c[i] != 0.0 && !self.uses(i)) {
            return Err(format!(
                "coefficient {}: the tether is missing; give [tether] with position_m{}",
                self.layout.name(i),
                if i == names::TETHER { "" } else { ", anchor_m and slack_m" },
            ));
        }
        let vehicle = Vehicle::nominal(self);
        let pivots = pivots(&vehicle.mass_matrix);
        if let Some(axis) = pivots.iter().position(|p| !(p.is_finite() && *p > 0.0)) {
            return Err(format!(
                "the mass matrix M_RB + M_A is not positive definite at axis {} (pivot {:.4}); added-mass derivatives such as X_udot are negative, products of inertia and off-diagonal terms must be small against the diagonal, and moments of inertia are about O: I_y and I_z are larger than m x_g^2",
                FORCES[axis], pivots[axis]
            ));
        }
        Ok(())
    }
}

/// Whether the strips make this drag already, so that the geometry must not add its own.
fn by_strips(index: usize, coefficients: &[f64]) -> bool {
    [[1, 5], [2, 4]]
        .iter()
        .zip(&coefficients[names::CROSS_FLOW..])
        .any(|(axes, c_d)| *c_d != 0.0 && axes.iter().any(|&i| names::quadratic(i, i) == index))
}

/// Refuses a value that differs from the one given for the same coefficient, perhaps under its other name.
fn agree(name: &str, value: f64, earlier: Option<(&str, f64)>) -> Result<(), String> {
    match earlier {
        Some((twin, other)) if other != value => {
            Err(format!("{name}: found {value}, but {twin} = {other}; M_A is symmetric, give one of the two"))
        }
        _ => Ok(()),
    }
}
