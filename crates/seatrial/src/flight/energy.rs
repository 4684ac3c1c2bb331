//! Electrical energy: hotel load and the propellers' `c_P |n|³`, n in rev/s.
//!
//! Thrusters without a power factor take nothing: the sum is then that of the others.
//!
//! Tests: `tests/closed_loop.rs`.

use crate::description::vehicle_file::CharacteristicTable;
use crate::description::{Description, Effect};
use crate::number::plain;
use crate::number::real::Real;

/// Power and energy of a flight.
pub struct Energy<T> {
    hotel: f64,
    /// Capacity of the battery, J; infinite where it is not known.
    capacity: f64,
    /// Per actuator, W/(unit of the signal)³.
    factors: Vec<f64>,
    /// Used so far, J.
    pub used: T,
}

impl<T: Real> Energy<T> {
    /// A full battery.
    pub fn new(description: &Description, unit: T) -> Self {
        let power = description.file.power;
        let factor = |effect: &Effect| match effect {
            Effect::Thrust(CharacteristicTable::Quadratic(q), _) => q.power_w_s3,
            Effect::Thrust(CharacteristicTable::Polynomial(p), _) => p.power_w_s3,
            _ => None,
        };
        let per_minute = plain::powi(60.0, -3);
        let of = description.actuators.iter().map(|a| factor(&a.effect).unwrap_or(0.0) * per_minute);
        Self {
            hotel: power.map_or(0.0, |p| p.hotel_w),
            capacity: power.map_or(f64::INFINITY, |p| p.battery_wh * 3600.0),
            factors: of.collect(),
            used: unit.zero(),
        }
    }

    /// The present power at the actuators' signals, W.
    #[inline(always)]
    pub fn power(&self, signals: &[T]) -> T {
        let mut power = self.used.splat(self.hotel);
        for (signal, &factor) in signals.iter().zip(&self.factors) {
            if factor != 0.0 {
                let n = signal.abs();
                power += n * n * n * factor;
            }
        }
        power
    }

    /// Takes a power over a time.
    #[inline(always)]
    pub fn use_up(&mut self, power: T, dt: f64) {
        self.used += power * dt;
    }

    /// The share that is left, not below zero.
    #[inline(always)]
    pub fn left(&self) -> T {
        (self.used * (-1.0 / self.capacity) + 1.0).max(self.used.zero())
    }
}
