//! A thruster or fin as written: placed on the vehicle, its motor and characteristic found, its coefficients
//! read.

use crate::actuator::characteristic::Table;
use crate::actuator::fin::lift_slope;
use crate::actuator::motor::Limits;
use crate::actuator::wrench::wrench_per_newton;
use crate::description::coefficients as names;
use crate::description::vehicle_file::{
    BelowMinimum, CharacteristicTable, CommandUnit, FinTable, MotorTable, Polynomial, Quadratic, Thruster,
    VehicleFile,
};
use crate::error::nearest;
use crate::number::algebra::{Vec3, Vec6};
use crate::number::plain;
use std::sync::Arc;

/// The parts of an actuator that no candidate changes.
#[derive(Clone, Debug)]
pub struct ActuatorDescription {
    /// Name, unique.
    pub name: String,
    /// Group for tied coefficients and reports.
    pub group: String,
    /// Unit of the command.
    pub unit: CommandUnit,
    /// Command without effect, in the command's unit.
    pub neutral: f64,
    /// Whether a command above neutral acts against the direction.
    pub reversed: bool,
    /// Place, m from O, where it is known.
    pub position: Option<Vec3<f64>>,
    /// Static limits of the signal.
    pub limits: Limits,
    /// Wrench about O per newton along the direction, as written;
    /// [`Description::wrench`](super::values::Description::wrench) is in use.
    pub wrench: Vec6<f64>,
    /// Direction of thrust and inflow, of a fin its normal; zero when the wrench has no linear part.
    pub direction: Vec3<f64>,
    /// What the signal does to the water.
    pub effect: Effect,
    /// Whether the motor has a rate limit.
    pub rate_limited: bool,
}

/// What an actuator's signal does to the water.
#[derive(Clone, Debug)]
pub enum Effect {
    /// Thrust by a characteristic as written; the measured table, where that is the characteristic.
    Thrust(CharacteristicTable, Option<Arc<Table>>),
    /// Lift and drag of a fin as written.
    Fin(FinTable),
}

impl ActuatorDescription {
    /// The signal of a command: distance from neutral, positive ahead.
    pub fn signal(&self, command: f64) -> f64 {
        let distance = command - self.neutral;
        if self.reversed { -distance } else { distance }
    }

    /// The name of its characteristic's kind, as in the file.
    pub fn kind(&self) -> &'static str {
        match self.effect {
            Effect::Thrust(CharacteristicTable::Quadratic(_), _) => "quadratic",
            Effect::Thrust(CharacteristicTable::Polynomial(_), _) => "polynomial",
            Effect::Thrust(CharacteristicTable::Table { .. }, _) => "table",
            Effect::Thrust(CharacteristicTable::Direct, _) => "direct",
            Effect::Fin(_) => "fin",
        }
    }

    /// The measured table, where that is its characteristic.
    pub fn table(&self) -> Option<&Table> {
        match &self.effect {
            Effect::Thrust(_, table) => table.as_deref(),
            Effect::Fin(_) => None,
        }
    }

    /// Electrical power per |n|³, W/(rev/s)³, where it is known.
    pub fn power(&self) -> Option<f64> {
        match &self.effect {
            Effect::Thrust(CharacteristicTable::Quadratic(q), _) => q.power_w_s3,
            Effect::Thrust(CharacteristicTable::Polynomial(p), _) => p.power_w_s3,
            _ => None,
        }
    }

    /// Whether its characteristic or motor reads the coefficient at an offset of
    /// [`names::ACTUATOR`].
    pub(super) fn uses(&self, offset: usize) -> bool {
        let fin = matches!(self.effect, Effect::Fin(_));
        match names::ACTUATOR[offset].0 {
            "gain" | "K_V" | "T_1" | "T_t" => true,
            _ if fin || offset >= names::FIN => fin && (offset >= names::FIN || self.limits_rate(offset)),
            "t" | "lever_K" | "lever_M" | "lever_N" | "astern_ratio" | "loss" => true,
            "p1_ahead" | "p1_astern" => self.kind() == "quadratic",
            "p2" | "w" | "q1" | "q2" => match self.kind() {
                "quadratic" => true,
                "polynomial" => self.unit == CommandUnit::Rpm,
                _ => false,
            },
            _ if self.limits_rate(offset) => true,
            "n_acc" | "n_dec" => false,
            _ => self.kind() == "polynomial",
        }
    }

    fn limits_rate(&self, offset: usize) -> bool {
        self.rate_limited && matches!(names::ACTUATOR[offset].0, "n_acc" | "n_dec")
    }

    /// The command of a signal.
    pub fn command(&self, signal: f64) -> f64 {
        self.neutral + if self.reversed { -signal } else { signal }
    }
}

/// A motor's limits, and its coefficients written; whether it limits the rate.
fn drive(
    file: &VehicleFile,
    motor: Option<&String>,
    set: &mut dyn FnMut(&str, f64),
) -> Result<(Limits, bool), String> {
    let ideal = MotorTable { k_v: 1.0, ..MotorTable::default() };
    let motor = match motor {
        None => &ideal,
        Some(name) => file.motors.get(name).ok_or_else(|| unknown("motor", name, file.motors.keys()))?,
    };
    set("K_V", motor.k_v);
    set("T_1", motor.t_1_s);
    set("T_t", motor.t_t_s);
    let rate = motor.n_acc_per_s.or(motor.n_dec_per_s);
    if let Some(rate) = rate {
        set("n_acc", rate);
        set("n_dec", motor.n_dec_per_s.unwrap_or(rate));
    }
    let ahead = motor.maximum_ahead.unwrap_or(f64::INFINITY);
    let limits = Limits {
        maximum: [ahead, motor.maximum_astern.unwrap_or(ahead)],
        minimum: [motor.minimum_ahead, motor.minimum_astern.unwrap_or(motor.minimum_ahead)],
        dead_band: motor.below_minimum == BelowMinimum::Zero,
    };
    Ok((limits, rate.is_some()))
}

/// The message for a name that the file does not define.
fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a String>) -> String {
    format!("{kind}: no [{kind}s.{name}] in the file{}", nearest(name, known.map(String::as_str)))
}

/// Writes a coefficient of an actuator by its name.
fn writer(values: &mut [f64]) -> impl FnMut(&str, f64) {
    |name, value| {
        let offset = names::ACTUATOR.iter().position(|(n, _, _)| *n == name);
        values[offset.expect("a name of the table of coefficients")] = value;
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
    if thruster.command == CommandUnit::Radian {
        return Err(
            "command: a thruster takes \"rpm\", \"us\" or \"N\"; radians are a fin's, under [[fins]]".into(),
        );
    }
    let length = wrench[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
    let direction = std::array::from_fn(|i| if length > 0.0 { wrench[i] / length } else { 0.0 });
    let mut set = writer(values);
    let (limits, rate_limited) = drive(file, thruster.motor.as_ref(), &mut set)?;
    let characteristic = file
        .characteristics
        .get(&thruster.characteristic)
        .ok_or_else(|| unknown("characteristic", &thruster.characteristic, file.characteristics.keys()))?;
    for (name, lever) in ["lever_K", "lever_M", "lever_N"].iter().zip(&wrench[3..]) {
        set(name, *lever);
    }
    set("gain", 1.0);
    set("astern_ratio", 1.0);
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
    Ok(ActuatorDescription {
        name: thruster.name.clone(),
        group: thruster.group.clone(),
        unit: thruster.command,
        neutral: thruster.neutral,
        reversed: thruster.reversed,
        position: thruster.position_m,
        limits,
        wrench,
        direction,
        effect: Effect::Thrust(characteristic.clone(), table),
        rate_limited,
    })
}

/// Largest deflection of a fin's servo either way, rad: a fin across the flow. A larger limit is one in degrees.
const ACROSS: f64 = std::f64::consts::FRAC_PI_2;

/// Refuses limits of a servo that no fin deflects to.
fn check_deflections(servo: &str, limits: &Limits) -> Result<(), String> {
    let sides = [("maximum", limits.maximum), ("minimum", limits.minimum)];
    for (kind, values) in sides {
        for (side, value) in ["ahead", "astern"].iter().zip(values) {
            // Without a limit the flow and the deflection that is commanded decide.
            if value.is_finite() && value > ACROSS {
                return Err(format!(
                    "motors.{servo}.{kind}_{side}: expected a deflection of at most {ACROSS:.3} rad (90 degrees) for a \
                     fin, found {value}; give it in rad: {value} degrees are {:.4} rad",
                    value.to_radians()
                ));
            }
        }
    }
    Ok(())
}

/// Resolves a fin's servo and writes its coefficients.
pub(super) fn place_fin(
    file: &VehicleFile,
    fin: &FinTable,
    values: &mut [f64],
) -> Result<ActuatorDescription, String> {
    let wrench = wrench_per_newton(&fin.position_m, &fin.normal).map_err(|m| format!("normal: {m}"))?;
    let chord = wrench_per_newton(&fin.position_m, &fin.chord).map_err(|m| format!("chord: {m}"))?;
    let cosine: f64 = (0..3).map(|i| wrench[i] * chord[i]).sum();
    if cosine.abs() > 1e-3 {
        return Err(format!(
            "normal: expected at right angles to chord, found {:.1} degrees between them",
            plain::acos(cosine).to_degrees()
        ));
    }
    let mut set = writer(values);
    let (limits, rate_limited) = drive(file, fin.motor.as_ref(), &mut set)?;
    check_deflections(fin.motor.as_deref().unwrap_or_default(), &limits)?;
    set("gain", 1.0);
    set("astern_ratio", 1.0);
    set("C_La", fin.c_l_alpha.unwrap_or_else(|| lift_slope(fin.aspect_ratio)));
    set("C_Lmax", fin.c_l_max);
    set("C_D0", fin.c_d_0);
    set("C_D90", fin.c_d_90);
    set("offset", fin.offset_deg.to_radians());
    set("k_i", 1.0 / (std::f64::consts::PI * fin.oswald * fin.aspect_ratio));
    for (name, lever) in ["lever_K", "lever_M", "lever_N"].iter().zip(&wrench[3..]) {
        set(name, *lever);
    }
    Ok(ActuatorDescription {
        name: fin.name.clone(),
        group: fin.group.clone(),
        unit: CommandUnit::Radian,
        neutral: fin.neutral,
        reversed: fin.reversed,
        position: Some(fin.position_m),
        limits,
        wrench,
        direction: [wrench[0], wrench[1], wrench[2]],
        effect: Effect::Fin(fin.clone()),
        rate_limited,
    })
}

/// p2 of a regression as given or from α2 and the diameter.
fn inflow_factor(p: &Polynomial, rho: f64) -> Result<f64, String> {
    match (p.p2, p.alpha2, p.diameter_m) {
        (Some(p2), None, None) => Ok(p2),
        (None, Some(alpha2), Some(d)) => Ok(alpha2 * rho * plain::powi(d, 3)),
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
            let p1 = rho * plain::powi(d, 4);
            Ok([alpha1 * p1, q.alpha1_astern.unwrap_or(alpha1) * p1, q.alpha2.unwrap_or(0.0) * rho * plain::powi(d, 3)])
        }
        _ => Err("characteristic: expected either p1_ahead (p1_astern, p2) or alpha1_ahead (alpha1_astern, alpha2) and diameter_m".into()),
    }
}
