//! A vehicle, read and checked: file, coefficients filled from the geometry, actuators placed.
//!
//! Immutable. [`crate::model::vehicle::Vehicle`] is made of it for a number type, a set of coefficients, an
//! environment and the modes of the axes.

mod bounds;
pub mod coefficients;
pub mod facts;
pub mod geometry;
mod placement;
pub mod vehicle_file;

use crate::description::coefficients::{
    self as names, FORCES, Layout, MASS, Scaling, added_mass, linear, quadratic,
};
use crate::description::vehicle_file::VehicleFile;
use crate::error::Error;
use crate::number::algebra::{Vec6, pivots};
pub use placement::{ActuatorDescription, Effect};
use placement::{place, place_fin};
use std::collections::BTreeMap;

/// The embedded vehicles.
const BUILT_IN: [(&str, &str); 5] = [
    ("beluga", include_str!("../vehicles/beluga.toml")),
    ("bluerov2-heavy", include_str!("../vehicles/bluerov2-heavy.toml")),
    ("cwolf", include_str!("../vehicles/cwolf.toml")),
    ("lauv", include_str!("../vehicles/lauv.toml")),
    ("remus100", include_str!("../vehicles/remus100.toml")),
];

/// A checked vehicle.
#[derive(Clone, Debug)]
pub struct Description {
    /// The file, with the values as written.
    pub file: VehicleFile,
    /// Layout of the coefficient vector.
    pub layout: Layout,
    /// The coefficients, SI.
    pub coefficients: Vec<f64>,
    /// The geometry's start value per coefficient, where there is one.
    pub start_values: Vec<Option<f64>>,
    /// The actuators' coefficients as their motors and characteristics give them.
    tabulated: Vec<f64>,
    /// The actuators in the order of the command vector.
    pub actuators: Vec<ActuatorDescription>,
}

/// Names of the built-in vehicles.
pub fn built_in_names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|(name, _)| *name).collect()
}

/// The file of a built-in vehicle.
pub fn built_in(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

impl Description {
    /// Reads, fills and checks a vehicle file.
    ///
    /// # Errors
    /// What is wrong with the file, where, and what to do.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, Error> {
        Self::new(VehicleFile::parse(text, source_name)?, source_name)
    }

    /// Fills and checks a parsed file.
    ///
    /// # Errors
    /// What is wrong with the file, where, and what to do.
    pub fn new(file: VehicleFile, source_name: &str) -> Result<Self, Error> {
        let fail = |message: String| Error::vehicle(source_name, message);
        let environment = file.environment;
        for (key, value) in [("rho_kg_m3", environment.rho_kg_m3), ("g_m_s2", environment.g_m_s2)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(fail(format!("environment.{key}: expected a positive number, found {value}")));
            }
        }
        if let Some(row) = file.controllable.iter().find(|row| !FORCES.contains(&row.as_str())) {
            return Err(fail(format!("controllable: expected rows among X Y Z K M N, found \"{row}\"")));
        }
        if let Some(complaint) =
            file.geometry.as_ref().and_then(crate::description::geometry::Geometry::complaint)
        {
            return Err(fail(complaint));
        }
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
            if !value.is_finite() {
                return Err(fail(format!("coefficients.{name}: expected a finite number, found {value}")));
            }
            agree(name, value, given[index].map(|twin| (twin, coefficients[index])))
                .map_err(|m| fail(format!("coefficients.{m}")))?;
            coefficients[index] = value;
            given[index] = Some(name);
        }
        if given[MASS].is_none() {
            return Err(fail("coefficients.m: the mass in kg is missing; weigh the vehicle in air".into()));
        }
        let m = coefficients[MASS];
        if m <= 0.0 {
            return Err(fail(format!("coefficients.m: expected a positive mass in kg, found {m}")));
        }
        let mut start_values = vec![None; layout.len()];
        for (index, value) in file.geometry.iter().flat_map(|g| g.start_values(m, environment.rho_kg_m3)) {
            start_values[index] = Some(value);
            if given[index].is_none() {
                coefficients[index] = value;
            }
        }
        if given[names::BUOYANCY].is_none() {
            coefficients[names::BUOYANCY] = m * environment.g_m_s2;
        }
        let description = Self { file, layout, coefficients, start_values, tabulated, actuators };
        description.check().map_err(fail)?;
        Ok(description)
    }

    /// Index of the first actuator in the group of actuator `k`.
    pub fn group(&self, k: usize) -> usize {
        let name = |i: usize| &self.actuators[i].group;
        (0..k).find(|&i| name(i) == name(k)).unwrap_or(k)
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
            if !value.is_finite() {
                return Err(fail(format!("coefficient {name}: expected a finite number, found {value}")));
            }
            changed.coefficients[index] = *value;
        }
        changed.check().map_err(fail)?;
        Ok(changed)
    }

    /// The names and values that are not zero by nature: what the file gives, the geometry fills, or
    /// the characteristic uses.
    pub fn named_coefficients(&self) -> Vec<(String, f64)> {
        let rigid = 0..=names::BUOYANCY;
        (0..self.layout.len())
            .filter(|&i| {
                rigid.contains(&i) || self.is_diagonal(i) || (self.uses(i) && self.coefficients[i] != 0.0)
            })
            .map(|i| (self.layout.name(i), self.coefficients[i]))
            .collect()
    }

    /// The file with every coefficient written out.
    pub fn filled_file(&self) -> VehicleFile {
        let mut file = self.file.clone();
        file.coefficients = (0..self.layout.len())
            .filter(|&i| {
                let value = self.coefficients[i];
                if i < names::HULL {
                    value != 0.0 || i == names::BUOYANCY
                } else {
                    value != self.tabulated[i]
                }
            })
            .map(|i| (self.layout.name(i), self.coefficients[i]))
            .collect();
        if file.geometry.is_some() {
            // A zero that the geometry would fill must stay a zero; so does a buoyancy of zero, above.
            for (i, start) in self.start_values.iter().enumerate() {
                if start.is_some() && self.coefficients[i] == 0.0 {
                    file.coefficients.insert(self.layout.name(i), 0.0);
                }
            }
        }
        file
    }

    /// Wrench about O per newton of actuator `k`: its direction, and its levers as they are now.
    pub fn wrench(&self, k: usize) -> Vec6<f64> {
        let mut wrench = self.actuators[k].wrench;
        wrench[3..].copy_from_slice(&self.coefficients[self.layout.actuator(k) + names::LEVERS..][..3]);
        wrench
    }

    /// The command unit of the actuator that owns coefficient `index`.
    pub fn command_unit(&self, index: usize) -> &'static str {
        index.checked_sub(names::HULL).map_or("", |i| self.actuators[i / names::PER_ACTUATOR].unit.as_str())
    }

    /// Whether the equation of motion of this vehicle reads the coefficient.
    pub fn uses(&self, index: usize) -> bool {
        index
            .checked_sub(names::HULL)
            .is_none_or(|i| self.actuators[i / names::PER_ACTUATOR].uses(i % names::PER_ACTUATOR))
    }

    fn is_diagonal(&self, index: usize) -> bool {
        (0..6).any(|i| [added_mass(i, i), linear(i, i), quadratic(i, i)].contains(&index))
    }

    /// The factor on a coefficient in water of density `rho` (kg/m³) under gravity `g` (m/s²).
    pub fn environment_factor(&self, index: usize, rho: f64, g: f64) -> f64 {
        let density = rho / self.file.environment.rho_kg_m3;
        match Layout::scaling(index) {
            Scaling::None => 1.0,
            Scaling::Density => density,
            Scaling::Weight => density * g / self.file.environment.g_m_s2,
        }
    }

    fn check(&self) -> Result<(), String> {
        let c = &self.coefficients;
        if let Some(i) = c.iter().position(|x| !x.is_finite()) {
            return Err(format!(
                "coefficient {}: expected a finite number, found {}",
                self.layout.name(i),
                c[i]
            ));
        }
        let positive = (0..4).find(|&i| c[i] <= 0.0);
        if let Some(i) = positive {
            return Err(format!(
                "coefficient {}: expected a positive number, found {}{}",
                self.layout.name(i),
                c[i],
                if i > 0 && c[i] == 0.0 { "; give it, or a [geometry] from which it is filled" } else { "" }
            ));
        }
        let vehicle = crate::model::vehicle::Vehicle::<f64>::nominal(self);
        let pivots = pivots(&vehicle.mass_matrix);
        if let Some(axis) = pivots.iter().position(|p| !(p.is_finite() && *p > 0.0)) {
            return Err(format!(
                "the mass matrix M_RB + M_A is not positive definite at axis {} (pivot {:.4}); added-mass derivatives such as X_udot are negative, products of inertia and off-diagonal terms must be small against the diagonal",
                FORCES[axis], pivots[axis]
            ));
        }
        for (k, actuator) in self.actuators.iter().enumerate() {
            let base = self.layout.actuator(k);
            for (offset, (name, _, _)) in names::ACTUATOR.iter().enumerate() {
                let value = c[base + offset];
                let wrong = match *name {
                    "T_1" | "T_t" => value < 0.0,
                    "K_V" => value <= 0.0,
                    "n_acc" | "n_dec" => actuator.rate_limited && value <= 0.0,
                    _ => false,
                };
                if wrong {
                    return Err(format!(
                        "coefficient {}.{name}: expected a {} number, found {value}",
                        actuator.name,
                        if name.starts_with('T') { "non-negative" } else { "positive" }
                    ));
                }
            }
        }
        Ok(())
    }
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
