//! The table `[allocation]` of an autopilot file.
//!
//! ```toml
//! [allocation]
//! method = "pseudo-inverse"            # or "quadratic", for a single vehicle
//! weights = { stern = 1.0, VTB = 4.0 } # actuator or group: factor on the cost 1/F_max²
//! priority = { X = 1.0, M = 10.0 }     # rows: what gives way when not all can be reached
//! start_share = 1.0                    # of the minimum signal: above it a motor starts; more where noise asks for it
//! stop_share = 0.5                     # below it a motor stops
//! idle = { bow = 300.0 }               # actuator or group: signal about which it keeps turning
//! redistribution_passes = 2
//! ```
//!
//! Tests: `tests/allocation/table.rs`.

use super::minimum::Hold;
use crate::description::coefficients::FORCES;
use crate::description::{Description, Effect};
use crate::error::{Error, nearest};
use crate::number::algebra::Vec6;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How the wrench is distributed.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Weighted pseudo-inverse with redistribution.
    #[default]
    PseudoInverse,
    /// Bounded quadratic programme, of a single vehicle.
    Quadratic,
}

/// The table `[allocation]`.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct AllocationTable {
    /// How the wrench is distributed.
    pub method: Method,
    /// Factor on the cost 1/F_max² of an actuator's force, by actuator or group; 1 by default.
    pub weights: BTreeMap<String, f64>,
    /// Priority of a row among X Y Z K M N: X and Y 1, Z 3, K, M and N 10 by default.
    pub priority: BTreeMap<String, f64>,
    /// Share of the minimum signal above which a motor starts.
    pub start_share: f64,
    /// Share of the minimum signal below which a motor stops.
    pub stop_share: f64,
    /// Signal about which an actuator keeps turning, in the unit of its command from neutral, by actuator or group.
    pub idle: BTreeMap<String, f64>,
    /// How often what saturated actuators leave is given to the others.
    pub redistribution_passes: u32,
    /// Below this speed fins are held at zero, m/s.
    pub fin_least_speed_m_s: f64,
    /// Whether fins follow the inflow, so that their whole force is the demanded one; else the demand is what
    /// they give beyond their force at rest, which stays with the hull as its own stability.
    pub fin_inflow: bool,
}

impl Default for AllocationTable {
    fn default() -> Self {
        Self {
            method: Method::PseudoInverse,
            weights: BTreeMap::new(),
            priority: BTreeMap::new(),
            start_share: 1.0,
            stop_share: 0.5,
            idle: BTreeMap::new(),
            redistribution_passes: 2,
            fin_least_speed_m_s: 0.3,
            fin_inflow: true,
        }
    }
}

/// The table, resolved for the actuators of a vehicle.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    /// Per actuator: limits and hysteresis.
    pub holds: Vec<Hold>,
    /// Per actuator: 1/√weight.
    pub ease: Vec<f64>,
    /// Per row, the largest 1.
    pub priority: Vec6<f64>,
    /// How often saturation is redistributed.
    pub passes: u32,
    /// Below this speed fins are held, m/s.
    pub fin_least_speed: f64,
    /// Whether fins follow the inflow.
    pub fin_inflow: bool,
}

impl AllocationTable {
    /// The same table for populations, which have no quadratic programme.
    pub fn for_populations(&self) -> Self {
        Self { method: Method::PseudoInverse, ..self.clone() }
    }

    /// Checks the table against a vehicle.
    pub(super) fn settings(&self, description: &Description) -> Result<Settings, Error> {
        self.resolve(description)
            .map_err(|m| Error::vehicle(&description.file.name, format!("allocation.{m}")))
    }

    fn resolve(&self, description: &Description) -> Result<Settings, String> {
        for (key, value, most) in [
            ("start_share", self.start_share, 10.0),
            ("stop_share", self.stop_share, self.start_share),
            ("fin_least_speed_m_s", self.fin_least_speed_m_s, f64::MAX),
        ] {
            if !(0.0..=most).contains(&value) {
                let range = match key {
                    "stop_share" => "a number from 0 to start_share, or the motor stops as it starts".into(),
                    "start_share" => "a number from 0 to 10".to_owned(),
                    _ => "a speed of at least 0 m/s".to_owned(),
                };
                return Err(format!("{key}: expected {range}, found {value}"));
            }
        }
        let weights = each(description, "weights", &self.weights, 1.0)?;
        for (name, value) in &self.weights {
            if !(value.is_finite() && *value > 0.0) {
                return Err(format!("weights.{name}: expected a positive number, found {value}"));
            }
        }
        let mut priority = [1.0, 1.0, 3.0, 10.0, 10.0, 10.0];
        for (name, value) in &self.priority {
            let Some(row) = FORCES.iter().position(|force| force == name) else {
                let near = nearest(name, FORCES);
                return Err(format!("priority: expected rows among X Y Z K M N, found \"{name}\"{near}"));
            };
            if !(*value >= 1e-3 && *value <= 1e3) {
                return Err(format!("priority.{name}: expected a number from 0.001 to 1000, found {value}"));
            }
            priority[row] = *value;
        }
        let largest = priority.iter().fold(0.0, |m: f64, x| m.max(*x));
        let idle = each(description, "idle", &self.idle, 0.0)?;
        let shares = [self.start_share, self.stop_share];
        let mut holds = Vec::with_capacity(idle.len());
        for (actuator, idle) in description.actuators.iter().zip(&idle) {
            let hold = Hold::new(&actuator.limits, shares, *idle);
            if let Some(side) = (0..2).find(|&side| hold.start[side] > hold.maximum[side]) {
                return Err(format!(
                    "start_share: expected a start below the largest signal of \"{}\", {} {}, found {}; take a smaller share",
                    actuator.name,
                    hold.maximum[side],
                    actuator.unit.as_str(),
                    hold.start[side]
                ));
            }
            let side = usize::from(*idle < 0.0);
            let (least, most) = (hold.minimum[side], hold.maximum[side]);
            if *idle != 0.0 && matches!(actuator.effect, Effect::Fin(_)) {
                return Err(format!("idle: \"{}\" is a fin, which needs none", actuator.name));
            }
            if *idle != 0.0 && !(least..=most).contains(&idle.abs()) {
                return Err(format!(
                    "idle: expected for \"{}\" a magnitude between its limits {least} and {most} {}, found {idle}",
                    actuator.name,
                    actuator.unit.as_str()
                ));
            }
            holds.push(hold);
        }
        Ok(Settings {
            holds,
            ease: weights.iter().map(|w| 1.0 / w.sqrt()).collect(),
            priority: priority.map(|p| p / largest),
            passes: self.redistribution_passes.min(16),
            fin_least_speed: self.fin_least_speed_m_s,
            fin_inflow: self.fin_inflow,
        })
    }
}

/// A number per actuator, by its name or else its group.
fn each(
    description: &Description,
    key: &str,
    given: &BTreeMap<String, f64>,
    default: f64,
) -> Result<Vec<f64>, String> {
    let known = || description.actuators.iter().flat_map(|a| [a.name.as_str(), a.group.as_str()]);
    for name in given.keys() {
        if name.is_empty() || !known().any(|k| k == name) {
            return Err(format!(
                "{key}: no actuator or group \"{name}\"{}",
                nearest(name, known().filter(|k| !k.is_empty()))
            ));
        }
    }
    let of = |name: &str| given.get(name).copied();
    Ok(description.actuators.iter().map(|a| of(&a.name).or(of(&a.group)).unwrap_or(default)).collect())
}
