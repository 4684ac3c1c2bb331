//! A thruster as written: placed on the vehicle, its motor and characteristic found, its coefficients read.

use crate::actuator::characteristic::Table;
use crate::actuator::motor::Limits;
use crate::algebra::{Vec3, Vec6};
use crate::allocation::wrench_per_newton;
use crate::coefficients as names;
use crate::error::nearest;
use crate::vehicle_file::{
    BelowMinimum, CharacteristicTable, CommandUnit, MotorTable, Polynomial, Quadratic, Thruster, VehicleFile,
};
use std::sync::Arc;

/// The parts of an actuator that no candidate changes.
#[derive(Clone, Debug)]
pub struct ActuatorDescription {
    /// The thruster as written.
    pub thruster: Thruster,
    /// Static limits of the signal.
    pub limits: Limits,
    /// Wrench about O per newton, as written; [`Description::wrench`](super::Description::wrench) is in use.
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
            CharacteristicTable::Polynomial(_) => "polynomial",
            CharacteristicTable::Table { .. } => "table",
            CharacteristicTable::Direct => "direct",
        }
    }

    /// Electrical power per |n|³, W/(rev/s)³, where it is known.
    pub fn power(&self) -> Option<f64> {
        match &self.characteristic {
            CharacteristicTable::Quadratic(q) => q.power_w_s3,
            CharacteristicTable::Polynomial(p) => p.power_w_s3,
            _ => None,
        }
    }

    /// Whether its characteristic or motor reads the coefficient at an offset of
    /// [`names::ACTUATOR`].
    pub(super) fn uses(&self, offset: usize) -> bool {
        match names::ACTUATOR[offset].0 {
            "gain" | "t" | "K_V" | "T_1" | "T_t" | "lever_K" | "lever_M" | "lever_N" | "astern_ratio"
            | "loss" => true,
            "p1_ahead" | "p1_astern" => self.kind() == "quadratic",
            "p2" | "w" | "q1" | "q2" => match self.kind() {
                "quadratic" => true,
                "polynomial" => self.thruster.command == CommandUnit::Rpm,
                _ => false,
            },
            "n_acc" | "n_dec" => self.rate_limited,
            _ => self.kind() == "polynomial",
        }
    }

    /// The command of a signal.
    pub fn command(&self, signal: f64) -> f64 {
        self.thruster.neutral + if self.thruster.reversed { -signal } else { signal }
    }
}

/// Resolves a thruster's references and writes its coefficients.
pub(super) fn place(
    file: &VehicleFile,
    thruster: &Thruster,
    values: &mut [f64],
) -> Result<ActuatorDescription, String> {
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
    for (name, lever) in ["lever_K", "lever_M", "lever_N"].iter().zip(&wrench[3..]) {
        set(name, *lever);
    }
    set("gain", 1.0);
    set("astern_ratio", 1.0);
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
        CharacteristicTable::Polynomial(p) => {
            for (i, name) in ["a0", "a1", "a11"].iter().enumerate() {
                set(&format!("{name}_ahead"), p.ahead[i]);
                set(&format!("{name}_astern"), p.astern[i]);
            }
            let p2 = inflow_factor(p, file.environment.rho_kg_m3)?;
            for (name, value) in
                [("p2", p2), ("w", p.wake), ("t", p.thrust_deduction), ("q1", p.q1), ("q2", p.q2)]
            {
                if value != 0.0 && name != "t" && thruster.command != CommandUnit::Rpm {
                    return Err(format!(
                        "characteristic \"{}\": inflow and reaction torque follow revolutions; they need command = \"rpm\"",
                        thruster.characteristic
                    ));
                }
                set(name, value);
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

/// p2 of a regression as given or from α2 and the diameter.
fn inflow_factor(p: &Polynomial, rho: f64) -> Result<f64, String> {
    match (p.p2, p.alpha2, p.diameter_m) {
        (Some(p2), None, None) => Ok(p2),
        (None, Some(alpha2), Some(d)) => Ok(alpha2 * rho * d.powi(3)),
        (None, None, _) => Ok(0.0),
        _ => Err("characteristic: expected either p2, or alpha2 and diameter_m, or none of them".into()),
    }
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
