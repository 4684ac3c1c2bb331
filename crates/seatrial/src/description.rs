//! A vehicle, read and checked: file, coefficients filled from the geometry, actuators placed.
//!
//! Immutable. [`crate::vehicle::Vehicle`] is made of it for a number type, a set of coefficients, an
//! environment and the modes of the axes.

use crate::actuator::characteristic::Table;
use crate::actuator::motor::Limits;
use crate::algebra::{Vec3, Vec6, pivots};
use crate::allocation::wrench_per_newton;
use crate::coefficients::{self as names, FORCES, Layout, MASS, Scaling, added_mass, linear, quadratic};
use crate::error::{Error, nearest};
use crate::vehicle_file::{BelowMinimum, CharacteristicTable, MotorTable, Quadratic, Thruster, VehicleFile};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The embedded vehicles.
const BUILT_IN: [(&str, &str); 2] =
    [("beluga", include_str!("../vehicles/beluga.toml")), ("cwolf", include_str!("../vehicles/cwolf.toml"))];

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

/// The parts of an actuator that no candidate changes.
#[derive(Clone, Debug)]
pub struct ActuatorDescription {
    /// The thruster as written.
    pub thruster: Thruster,
    /// Static limits of the signal.
    pub limits: Limits,
    /// Wrench about O per newton.
    pub wrench: Vec6<f64>,
    /// Direction of thrust and inflow; zero when the wrench has no linear part.
    pub direction: Vec3<f64>,
    /// The measured table, where that is its characteristic.
    pub table: Option<Arc<Table>>,
    /// The characteristic as written.
    pub characteristic: CharacteristicTable,
    /// Whether the motor has a rate limit.
    pub rate_limited: bool,
}

impl ActuatorDescription {
    /// The signal of a command: distance from neutral, positive ahead.
    pub fn signal(&self, command: f64) -> f64 {
        let distance = command - self.thruster.neutral;
        if self.thruster.reversed { -distance } else { distance }
    }

    /// The name of its characteristic's kind, as in the file.
    pub fn kind(&self) -> &'static str {
        match self.characteristic {
            CharacteristicTable::Quadratic(_) => "quadratic",
            CharacteristicTable::Polynomial { .. } => "polynomial",
            CharacteristicTable::Table { .. } => "table",
            CharacteristicTable::Direct => "direct",
        }
    }

    /// Electrical power per |n|³, W/(rev/s)³, where it is known.
    pub fn power(&self) -> Option<f64> {
        match &self.characteristic {
            CharacteristicTable::Quadratic(q) => q.power_w_s3,
            CharacteristicTable::Polynomial { power_w_s3, .. } => *power_w_s3,
            _ => None,
        }
    }

    /// Whether its characteristic or motor reads the coefficient at an offset of
    /// [`names::ACTUATOR`].
    fn uses(&self, offset: usize) -> bool {
        match names::ACTUATOR[offset].0 {
            "gain" | "t" | "K_V" | "T_1" | "T_t" => true,
            "p1_ahead" | "p1_astern" | "p2" | "w" | "q1" | "q2" => self.kind() == "quadratic",
            "n_acc" | "n_dec" => self.rate_limited,
            _ => self.kind() == "polynomial",
        }
    }

    /// The command of a signal.
    pub fn command(&self, signal: f64) -> f64 {
        self.thruster.neutral + if self.thruster.reversed { -signal } else { signal }
    }
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
        if let Some(complaint) = file.geometry.as_ref().and_then(crate::geometry::Geometry::complaint) {
            return Err(fail(complaint));
        }
        let thruster_names: Vec<String> = file.thrusters.iter().map(|t| t.name.clone()).collect();
        for (k, name) in thruster_names.iter().enumerate() {
            if name.is_empty() || name.contains('.') || thruster_names[..k].contains(name) {
                return Err(fail(format!(
                    "thrusters[{k}].name: expected a unique name without a dot, found \"{name}\""
                )));
            }
        }
        let layout = Layout::new(thruster_names);
        let mut coefficients = vec![0.0; layout.len()];
        let actuators = file
            .thrusters
            .iter()
            .enumerate()
            .map(|(k, thruster)| {
                let values = &mut coefficients[layout.actuator(k)..][..names::PER_ACTUATOR];
                place(&file, thruster, values)
                    .map_err(|m| fail(format!("thruster \"{}\": {m}", thruster.name)))
            })
            .collect::<Result<Vec<_>, Error>>()?;

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

    /// The command unit of the actuator that owns coefficient `index`.
    pub fn command_unit(&self, index: usize) -> &'static str {
        index
            .checked_sub(names::HULL)
            .map_or("", |i| self.actuators[i / names::PER_ACTUATOR].thruster.command.as_str())
    }

    /// Default bounds of a coefficient for its identification, around its geometric start value or
    /// its present one; none where nothing is known.
    pub fn default_bounds(&self, index: usize) -> Option<(f64, f64)> {
        let reference = self.start_values[index].unwrap_or(self.coefficients[index]);
        let factors = |low: f64, high: f64| {
            let (a, b) = (low * reference, high * reference);
            (reference != 0.0).then(|| (a.min(b), a.max(b)))
        };
        let is = |f: &dyn Fn(usize, usize) -> usize| (0..6).any(|i| f(i, i) == index);
        if index >= names::HULL {
            return match names::ACTUATOR[(index - names::HULL) % names::PER_ACTUATOR].0 {
                "gain" => Some((0.2, 2.0)),
                "T_1" | "T_t" => Some((0.0, 1.0)),
                "w" | "t" => Some((0.0, 0.5)),
                "K_V" => Some((0.8, 1.2)),
                _ => factors(0.3, 3.0),
            };
        }
        let weight = self.coefficients[MASS] * self.file.environment.g_m_s2;
        let size = self.file.geometry.as_ref().map_or(1.0, |g| g.length_m);
        match index {
            MASS => factors(0.5, 2.0),
            names::BUOYANCY => Some((0.9 * weight, 1.1 * weight)),
            names::CENTRE_OF_GRAVITY..names::BUOYANCY => Some((-0.1 * size, 0.1 * size)),
            names::BIAS..names::HULL => {
                let arm = if index - names::BIAS < 3 { 1.0 } else { size };
                Some((-0.05 * weight * arm, 0.05 * weight * arm))
            }
            _ if is(&added_mass) => factors(0.2, 5.0),
            _ if is(&linear) => factors(0.0, 10.0),
            _ if is(&quadratic) => factors(0.25, 4.0),
            _ if index < names::CENTRE_OF_GRAVITY => factors(0.3, 3.0),
            _ => factors(-3.0, 3.0),
        }
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
        let vehicle = crate::vehicle::Vehicle::<f64>::nominal(self);
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
                        actuator.thruster.name,
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

/// Resolves a thruster's references and writes its coefficients.
fn place(file: &VehicleFile, thruster: &Thruster, values: &mut [f64]) -> Result<ActuatorDescription, String> {
    let wrench = match (&thruster.position_m, &thruster.direction, &thruster.wrench_per_newton) {
        (Some(position), Some(direction), None) => wrench_per_newton(position, direction)?,
        (None, None, Some(wrench)) => *wrench,
        _ => return Err("expected either position_m and direction, or wrench_per_newton".into()),
    };
    if wrench.iter().any(|x| !x.is_finite()) {
        return Err(format!("expected finite numbers for its place, found {wrench:?}"));
    }
    let length = wrench[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
    let direction = std::array::from_fn(|i| if length > 0.0 { wrench[i] / length } else { 0.0 });
    let find = |kind: &str, name: &str, known: Vec<&String>| {
        format!(
            "{kind}: no [{kind}s.{name}] in the file{}",
            nearest(name, known.into_iter().map(String::as_str))
        )
    };
    let ideal = MotorTable { k_v: 1.0, ..MotorTable::default() };
    let motor = match &thruster.motor {
        None => &ideal,
        Some(name) => {
            file.motors.get(name).ok_or_else(|| find("motor", name, file.motors.keys().collect()))?
        }
    };
    let characteristic = file.characteristics.get(&thruster.characteristic).ok_or_else(|| {
        find("characteristic", &thruster.characteristic, file.characteristics.keys().collect())
    })?;
    let mut set = |name: &str, value: f64| {
        let offset = names::ACTUATOR.iter().position(|(n, _, _)| *n == name);
        values[offset.expect("a name of the table above")] = value;
    };
    set("gain", 1.0);
    set("K_V", motor.k_v);
    set("T_1", motor.t_1_s);
    set("T_t", motor.t_t_s);
    let rate = motor.n_acc_per_s.or(motor.n_dec_per_s);
    if let Some(rate) = rate {
        set("n_acc", rate);
        set("n_dec", motor.n_dec_per_s.unwrap_or(rate));
    }
    let mut table = None;
    match characteristic {
        CharacteristicTable::Quadratic(q) => {
            if thruster.command.as_str() != "rpm" {
                return Err("a quadratic characteristic needs command = \"rpm\"".into());
            }
            let [ahead, astern, p2] = thrust_factors(q, file.environment.rho_kg_m3)?;
            for (name, value) in [
                ("p1_ahead", ahead),
                ("p1_astern", astern),
                ("p2", p2),
                ("w", q.wake),
                ("t", q.thrust_deduction),
                ("q1", q.q1),
                ("q2", q.q2),
            ] {
                set(name, value);
            }
        }
        CharacteristicTable::Polynomial { ahead, astern, .. } => {
            for (i, name) in ["a0", "a1", "a11"].iter().enumerate() {
                set(&format!("{name}_ahead"), ahead[i]);
                set(&format!("{name}_astern"), astern[i]);
            }
        }
        CharacteristicTable::Table { signal, voltage_v, force_n } => {
            let measured = Table::new(signal.clone(), voltage_v.clone(), force_n.clone());
            table = Some(Arc::new(
                measured.map_err(|m| format!("characteristic \"{}\": {m}", thruster.characteristic))?,
            ));
        }
        CharacteristicTable::Direct => {}
    }
    let ahead = motor.maximum_ahead.unwrap_or(f64::INFINITY);
    let limits = Limits {
        maximum: [ahead, motor.maximum_astern.unwrap_or(ahead)],
        minimum: [motor.minimum_ahead, motor.minimum_astern.unwrap_or(motor.minimum_ahead)],
        dead_band: motor.below_minimum == BelowMinimum::Zero,
    };
    if limits.maximum.iter().chain(&limits.minimum).any(|x| x.is_nan() || *x < 0.0) {
        return Err("motor: limits are positive magnitudes in both directions".into());
    }
    Ok(ActuatorDescription {
        thruster: thruster.clone(),
        limits,
        wrench,
        direction,
        table,
        characteristic: characteristic.clone(),
        rate_limited: rate.is_some(),
    })
}

/// `[p1 ahead, p1 astern, p2]` as given or from α and the diameter.
fn thrust_factors(q: &Quadratic, rho: f64) -> Result<[f64; 3], String> {
    match (q.p1_ahead, q.alpha1_ahead, q.diameter_m) {
        (Some(p1), None, _) if q.alpha1_astern.is_none() && q.alpha2.is_none() => {
            Ok([p1, q.p1_astern.unwrap_or(p1), q.p2.unwrap_or(0.0)])
        }
        (None, Some(alpha1), Some(d)) if q.p1_astern.is_none() && q.p2.is_none() => {
            let p1 = rho * d.powi(4);
            Ok([alpha1 * p1, q.alpha1_astern.unwrap_or(alpha1) * p1, q.alpha2.unwrap_or(0.0) * rho * d.powi(3)])
        }
        _ => Err("characteristic: expected either p1_ahead (p1_astern, p2) or alpha1_ahead (alpha1_astern, alpha2) and diameter_m".into()),
    }
}
