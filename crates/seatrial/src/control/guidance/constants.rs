//! The constants of guidance, for one number type: what the table of the autopilot file says, in SI units.
//!
//! Tests: `tests/guidance.rs` (`law_table_…`).

use super::table::{GuidanceTable, Method};
use crate::number::real::Real;

/// Constants of the guidance; every number may differ from lane to lane.
#[derive(Clone, Copy, Debug)]
pub struct Guidance<T> {
    /// How heading and pitch follow from the errors.
    pub method: Method,
    /// Whether the vehicle can push itself sideways.
    pub sway: bool,
    /// Whether the vehicle can stop: keep its depth without speed.
    pub hover: bool,
    /// Lookahead distance Δ in the horizontal plane, m.
    pub lookahead: T,
    /// Lookahead distance Δ_z in the vertical plane, m.
    pub lookahead_vertical: T,
    /// Speed for which both and the integral gains hold, m/s; 0: any.
    pub lookahead_speed: f64,
    /// Integral gain κ in the horizontal plane, m/s.
    pub integral_gain: T,
    /// Integral gain κ_z in the vertical plane, m/s.
    pub integral_gain_vertical: T,
    /// Largest desired pitch, rad.
    pub pitch_max: T,
    /// Largest rate of the desired heading, rad/s.
    pub turn_rate_max: T,
    /// Largest rate of the desired pitch, rad/s.
    pub pitch_rate_max: T,
    /// Largest rate of the desired depth, m/s.
    pub depth_rate_max: T,
    /// Largest desired speed, m/s.
    pub speed_max: T,
    /// Largest rate of the desired speed, m/s².
    pub acceleration_max: T,
    /// Share of the speed that is left while the heading is 90° or more off.
    pub turn_speed_share: T,
    /// Desired speed per distance when a point is held, 1/s.
    pub hold_gain: T,
    /// Horizontal distance at which station-keeping begins, m.
    pub hold_radius: T,
    /// Horizontal distance beyond which a vehicle turns to the point that it holds, m.
    pub watch_radius: T,
    /// Rate of the heading per error of the sideways speed when a point is held without sway, rad/m.
    pub weathervane_gain: T,
    /// Radius of the circle of a vehicle that cannot stop, m.
    pub loiter_radius: T,
    /// Radius of the turning circle, m; 0: turns begin at the sphere of acceptance, and follow no circle.
    pub turn_radius: T,
    /// Delay of the course by which turns are asked for earlier, s.
    pub turn_delay: T,
}

/// Least share of the lookahead distances on slow legs.
const LEAST_SHARE: f64 = 0.5;

impl<T: Real> Guidance<T> {
    /// The constants of a table in the kind of `unit`, for a vehicle that can push itself sideways (`sway`) and can
    /// keep its depth without speed (`hover`).
    pub fn new(table: &GuidanceTable, unit: T, sway: bool, hover: bool) -> Self {
        let zero = unit.zero();
        let mut guidance = Self {
            lookahead_speed: table.lookahead_speed_m_s,
            method: table.method,
            sway,
            hover,
            lookahead: zero,
            lookahead_vertical: zero,
            integral_gain: zero,
            integral_gain_vertical: zero,
            pitch_max: zero,
            turn_rate_max: zero,
            pitch_rate_max: zero,
            depth_rate_max: zero,
            speed_max: zero,
            acceleration_max: zero,
            turn_speed_share: zero,
            hold_gain: zero,
            hold_radius: zero,
            watch_radius: zero,
            weathervane_gain: zero,
            loiter_radius: zero,
            turn_radius: zero,
            turn_delay: zero,
        };
        for (index, value) in table.tunable().into_iter().enumerate() {
            guidance.set(index, zero.splat(value));
        }
        guidance
    }

    /// Gives the constants the values of the names in [`TUNABLE`](super::table::TUNABLE), in their units.
    pub fn tune(&mut self, values: &[T]) {
        for (index, value) in values.iter().enumerate() {
            self.set(index, *value);
        }
    }

    /// Gives the constant `TUNABLE[index]` a value in the unit of its name; another index does nothing.
    pub fn set(&mut self, index: usize, value: T) {
        let radians = value * (std::f64::consts::PI / 180.0);
        match index {
            0 => self.lookahead = value,
            1 => self.lookahead_vertical = value,
            2 => self.integral_gain = value,
            3 => self.integral_gain_vertical = value,
            4 => self.pitch_max = radians,
            5 => self.turn_rate_max = radians,
            6 => self.pitch_rate_max = radians,
            7 => self.depth_rate_max = value,
            8 => self.speed_max = value,
            9 => self.acceleration_max = value,
            10 => self.turn_speed_share = value,
            11 => self.hold_gain = value,
            12 => self.hold_radius = value,
            13 => self.watch_radius = value,
            14 => self.weathervane_gain = value,
            15 => self.loiter_radius = value,
            16 => self.turn_radius = value,
            17 => self.turn_delay = value,
            _ => {}
        }
    }

    /// The pitch towards a depth that lies `above` metres above the vehicle, rad.
    #[inline(always)]
    pub fn pitch_towards(&self, above: T) -> T {
        above.atan2(self.lookahead_vertical).clamped(-self.pitch_max, self.pitch_max)
    }

    /// The constants for the speed of a leg.
    #[inline(always)]
    pub(super) fn at_speed(&self, speed: T) -> Self {
        if self.lookahead_speed <= 0.0 {
            return *self;
        }
        let share =
            (speed * (1.0 / self.lookahead_speed)).clamped(speed.splat(LEAST_SHARE), speed.splat(1.0));
        Self {
            lookahead: self.lookahead * share,
            lookahead_vertical: self.lookahead_vertical * share,
            integral_gain: self.integral_gain * share,
            integral_gain_vertical: self.integral_gain_vertical * share,
            ..*self
        }
    }
}
