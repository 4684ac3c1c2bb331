//! What is known of a vehicle: its file, its coefficients, its actuators in their places. Immutable.

use super::coefficients::{self as names, Layout, Scaling, added_mass, linear, quadratic};
use super::geometry::Shape;
use super::placement::ActuatorDescription;
use super::vehicle_file::VehicleFile;
use crate::model::cross_flow::Strips;
use crate::number::algebra::Vec6;

/// Standard deviations between the ends of a normal distribution's 95 % interval.
const WIDTH_95: f64 = 3.92;

/// A start value of a coefficient, with what is known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartValue {
    /// Index of the coefficient.
    pub index: usize,
    /// The value, SI.
    pub value: f64,
    /// Factors on it that bound the stated 95 % interval.
    pub factors: [f64; 2],
    /// Where it comes from.
    pub source: &'static str,
}

impl StartValue {
    /// Lower and upper end of the stated 95 % interval.
    pub fn interval(&self) -> [f64; 2] {
        let [a, b] = self.factors.map(|factor| factor * self.value);
        [a.min(b), a.max(b)]
    }

    /// Standard deviation of a normal distribution whose 95 % interval is as wide.
    pub fn sd(&self) -> f64 {
        let [low, high] = self.interval();
        (high - low) / WIDTH_95
    }
}

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
    pub start_values: Vec<Option<StartValue>>,
    /// The hull in strips; none where the file says nothing of its shape.
    pub strips: Option<Strips>,
    /// The actuators' coefficients as their motors and characteristics give them.
    pub(super) tabulated: Vec<f64>,
    /// The actuators in the order of the command vector.
    pub actuators: Vec<ActuatorDescription>,
}

impl Description {
    /// Index of the first actuator in the group of actuator `k`.
    pub fn group(&self, k: usize) -> usize {
        let name = |i: usize| &self.actuators[i].group;
        (0..k).find(|&i| name(i) == name(k)).unwrap_or(k)
    }

    /// The value around which a coefficient is sought: the geometry's start value of a body of revolution; what the
    /// file says of a box or frame, whose start values are wide.
    pub fn reference(&self, index: usize) -> f64 {
        let own = self.coefficients[index];
        let round = self.file.geometry.as_ref().is_some_and(|geometry| geometry.shape == Shape::Spheroid);
        self.start_values[index].filter(|_| round).map_or(own, |start| start.value)
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
        // The coefficients hold what the trim told.
        let mut file = VehicleFile { trim: None, ..self.file.clone() };
        let asked = file.geometry.as_ref().is_some_and(|geometry| geometry.shape != Shape::Spheroid);
        file.coefficients = (0..self.layout.len())
            .filter(|&i| {
                let value = self.coefficients[i];
                if i < names::HULL {
                    // Without z_b the file of a box or frame would be asked for it.
                    value != 0.0 || i == names::BUOYANCY || (asked && i == names::CENTRE_OF_BUOYANCY + 2)
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
        let tether = self.file.tether.as_ref();
        match index {
            names::CROSS_FLOW..names::TETHER => return self.strips.is_some(),
            names::TETHER => return tether.is_some(),
            names::STIFFNESS => return tether.is_some_and(|tether| tether.spring().is_some()),
            _ => {}
        }
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
}
