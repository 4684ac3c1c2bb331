//! What of a vehicle a surface of the sea acts on: the hull as the file measures it, and the places of its actuators.
//!
//! Tests: `tests/laws/surface.rs`, `tests/flight/test_surface.py`.

use super::coefficients as names;
use super::geometry::Shape;
use super::placement::Effect;
use super::vehicle_file::{CharacteristicTable, Environment};
use super::{Description, Structure};
use crate::model::surface::{Hull, Place, Surface};
use crate::model::vehicle::{Mode, Vehicle};
use crate::number::algebra::{Vec3, pivots};
use crate::number::plain;
use crate::number::real::Real;

/// Diameter of a propeller whose file gives none, m: assumed, between the 76 mm of small thrusters and the 140 mm of
/// torpedoes.
const ASSUMED_DIAMETER_M: f64 = 0.1;

impl Description {
    /// The hull and its actuators: round with `[geometry]`, a box of its measures, or a cube of the displaced volume.
    pub fn hull(&self) -> Hull {
        let file = &self.file;
        let half = match &file.geometry {
            Some(geometry) => {
                let round = geometry.shape == Shape::Spheroid;
                let height = if round { geometry.diameter_m } else { geometry.height() };
                [geometry.length_m, geometry.diameter_m, height]
            }
            None => {
                let weight = file.environment.rho_kg_m3 * file.environment.g_m_s2;
                // A vehicle without any buoyancy has a hull that makes none.
                [plain::cbrt((self.coefficients[names::BUOYANCY] / weight).max(1e-6)); 3]
            }
        };
        let place = |actuator: &super::ActuatorDescription| match &actuator.effect {
            Effect::Fin(fin) => Some((fin.position_m, 0.5 * fin.area_m2.sqrt())),
            Effect::Thrust(kind, _) => actuator.position.map(|place| (place, 0.5 * diameter(kind))),
        };
        let places: Vec<Option<Place>> = self.actuators.iter().map(place).collect();
        let (propellers, fins) = places.split_at(file.thrusters.len());
        Hull {
            half: half.map(|x| 0.5 * x),
            round: file.geometry.as_ref().is_some_and(|geometry| geometry.shape == Shape::Spheroid),
            propellers: propellers.to_vec(),
            fins: fins.iter().flatten().copied().collect(),
            fades_mass: self.rigid_alone(),
        }
    }

    /// The highest point of the hull over its centre of buoyancy, body frame, m.
    pub fn hull_top(&self) -> Vec3<f64> {
        let mut top = [0, 1, 2].map(|i| self.coefficients[names::CENTRE_OF_BUOYANCY + i]);
        top[2] -= self.hull().half[2];
        top
    }

    /// The depth of O, m, at which the vehicle floats upright in these waters; just under water where it is too heavy to
    /// float.
    pub fn floating_depth(&self, environment: Environment) -> f64 {
        let structure = Structure::new(self, &[]);
        let vehicle = Vehicle::new(self, &structure, &self.coefficients, environment, [Mode::Free; 6]);
        let weight = self.coefficients[names::MASS] * environment.g_m_s2;
        Surface::new(self.hull(), &vehicle.restoring, environment.g_m_s2, 0.0).afloat(weight)
    }

    /// Whether the rigid body can be accelerated without added mass.
    fn rigid_alone(&self) -> bool {
        let matrix = Vehicle::nominal(self).rigid_body.mass_matrix();
        // Rounding must not decide, nor a moment of inertia that stands for nothing: a thousandth of the diagonal.
        pivots(&matrix).iter().zip(0..6).all(|(pivot, i)| *pivot > 1e-3 * matrix[i][i])
    }
}

impl<T: Real> Vehicle<T> {
    /// The same vehicle beneath a surface at a coordinate down, m; without one where that is nothing.
    #[inline(always)]
    pub fn beneath(mut self, description: &Description, g: f64, level: Option<f64>) -> Self {
        self.surface = level.map(|level| Surface::new(description.hull(), &self.restoring, g, level));
        self
    }
}

/// The diameter of a propeller, m.
fn diameter(kind: &CharacteristicTable) -> f64 {
    match kind {
        CharacteristicTable::Quadratic(q) => q.diameter_m,
        CharacteristicTable::Polynomial(p) => p.diameter_m,
        _ => None,
    }
    .filter(|diameter| *diameter > 0.0)
    .unwrap_or(ASSUMED_DIAMETER_M)
}
