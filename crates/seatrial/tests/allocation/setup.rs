//! Allocators of built-in vehicles.

#![allow(dead_code, reason = "every test binary uses a part")]

use crate::vehicles::load;
use seatrial::control::allocation::{AllocationTable, Allocator};
use seatrial::description::Description;
use seatrial::description::coefficients::FORCES;
use seatrial::model::vehicle::Vehicle;
use seatrial::number::algebra::Vec6;

/// Supply of the tests, V: between two rows of the T200's table.
pub const VOLTAGE: f64 = 14.8;

/// A vehicle with its allocator.
pub struct Setup {
    pub description: Description,
    pub vehicle: Vehicle<f64>,
    pub allocator: Allocator<f64>,
    /// Controllable rows by the file.
    pub rows: Vec6<f64>,
    pub signals: Vec<f64>,
}

impl Setup {
    /// A described vehicle by a table in TOML.
    pub fn new(description: Description, table: &str) -> Self {
        let table: AllocationTable = toml::from_str(table).expect("a valid table");
        let vehicle = Vehicle::nominal(&description);
        let allocator = Allocator::single(&description, &vehicle, &table).expect("a table that fits");
        let listed = |force: &str| description.file.controllable.iter().any(|row| row == force);
        let rows = FORCES.map(|force| f64::from(listed(force)));
        let signals = vec![0.0; description.actuators.len()];
        let mut setup = Self { description, vehicle, allocator, rows, signals };
        setup.prepare(&vec![1.0; setup.signals.len()], 0.0);
        setup
    }

    /// A built-in vehicle whose motors have no minimum.
    pub fn smooth(name: &str, table: &str) -> Self {
        Self::new(smooth(name), table)
    }

    pub fn prepare(&mut self, usable: &[f64], speed: f64) {
        let rows = self.rows;
        self.allocator.prepare(&self.vehicle, &rows, usable, speed);
    }

    pub fn allocate(&mut self, tau: &Vec6<f64>, nu_r: &Vec6<f64>) -> Vec6<f64> {
        self.allocator.allocate(&self.vehicle, tau, nu_r, VOLTAGE, &mut self.signals)
    }

    /// Forces over F_max to a wrench.
    pub fn wrench(&self, shares: &[f64], force: f64) -> Vec6<f64> {
        let mut tau = [0.0; 6];
        for (k, share) in (0..self.signals.len()).zip(shares) {
            let b = self.description.wrench(k);
            (0..6).for_each(|i| tau[i] += b[i] * share * force);
        }
        tau
    }

    /// The largest miss in the controlled rows.
    pub fn miss(&self, a: &Vec6<f64>, b: &Vec6<f64>) -> f64 {
        (0..6).map(|i| self.rows[i] * (a[i] - b[i]).abs()).fold(0.0, f64::max)
    }
}

/// A built-in vehicle whose motors have no minimum.
pub fn smooth(name: &str) -> Description {
    let mut file = load(name).file;
    for motor in file.motors.values_mut() {
        (motor.minimum_ahead, motor.minimum_astern) = (0.0, None);
    }
    Description::new(file, name).expect("a valid file")
}
