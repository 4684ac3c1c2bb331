//! What the core knows, as plain values by name, for those who do not know its types: the tables of a file, and what can
//! be said about a vehicle besides its motion.

use super::placement::Effect;
use super::values::Description;
use super::vehicle_file::{CharacteristicTable, MotorTable};
use serde::Serialize;
use std::collections::BTreeMap;

/// A plain value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Not known.
    None,
    /// True or false.
    Flag(bool),
    /// A number, SI unless the name says otherwise.
    Number(f64),
    /// A count.
    Whole(i64),
    /// Text.
    Text(String),
    /// Components.
    Vector(Vec<f64>),
    /// Values in order.
    List(Vec<Value>),
    /// Values by name, in the order of the file.
    Table(Vec<(String, Value)>),
}

/// Values by name.
pub type Facts = BTreeMap<&'static str, Value>;

impl From<Option<f64>> for Value {
    fn from(x: Option<f64>) -> Self {
        x.map_or(Self::None, Self::Number)
    }
}

impl From<toml::Value> for Value {
    fn from(value: toml::Value) -> Self {
        match value {
            toml::Value::Boolean(x) => Self::Flag(x),
            toml::Value::Integer(x) => Self::Whole(x),
            toml::Value::Float(x) => Self::Number(x),
            toml::Value::String(x) => Self::Text(x),
            toml::Value::Datetime(x) => Self::Text(x.to_string()),
            toml::Value::Array(values) => Self::List(values.into_iter().map(Self::from).collect()),
            toml::Value::Table(values) => {
                Self::Table(values.into_iter().map(|(key, value)| (key, value.into())).collect())
            }
        }
    }
}

/// A file of the core, or a part of one, as it would be written: keys with their units, defaults filled in, what was left
/// out without a default missing.
pub fn written<F: Serialize>(file: &F) -> Value {
    toml::Value::try_from(file).expect("a file holds plain numbers, text and tables").into()
}

/// Per actuator, thrusters first, the table of its motor as written; none for an ideal one.
pub fn motors(d: &Description) -> Vec<(String, Option<MotorTable>)> {
    let thrusters = d.file.thrusters.iter().map(|t| (&t.name, &t.motor));
    let all = thrusters.chain(d.file.fins.iter().map(|f| (&f.name, &f.motor)));
    all.map(|(name, motor)| {
        (name.clone(), motor.as_ref().and_then(|motor| d.file.motors.get(motor)).cloned())
    })
    .collect()
}

/// Smallest and largest supply voltage, V, of every table of thrust that was measured at several.
pub fn table_voltages(d: &Description) -> BTreeMap<String, (f64, f64)> {
    let range = |(name, table): (&String, &CharacteristicTable)| match table {
        CharacteristicTable::Table { voltage_v, .. } if !voltage_v.is_empty() => {
            let ends = voltage_v
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
            Some((name.clone(), ends))
        }
        _ => None,
    };
    d.file.characteristics.iter().filter_map(range).collect()
}

/// Group, unit and limits of the command, place, wrench per newton and power of an actuator; area (m²) and chord
/// of a fin, whose wrench is per newton along its normal.
pub fn actuator(d: &Description, k: usize) -> Facts {
    let a = &d.actuators[k];
    let text = |x: &str| Value::Text(x.to_owned());
    let [(maximum_ahead, maximum_astern), (minimum_ahead, minimum_astern)] =
        [a.limits.maximum, a.limits.minimum].map(|l| (Value::Number(l[0]), Value::Number(l[1])));
    let needs_voltage = a.table().is_some_and(|table| table.needs_voltage());
    let fin = match &a.effect {
        Effect::Fin(fin) => Some(fin),
        Effect::Thrust(..) => None,
    };
    BTreeMap::from([
        ("kind", text(if fin.is_some() { "fin" } else { "thruster" })),
        ("group", text(&a.group)),
        ("unit", text(a.unit.as_str())),
        ("neutral", Value::Number(a.neutral)),
        ("reversed", Value::Flag(a.reversed)),
        ("position", a.position.map_or(Value::None, |p| Value::Vector(p.to_vec()))),
        ("chord", fin.map_or(Value::None, |f| Value::Vector(f.chord.to_vec()))),
        ("area", fin.map(|f| f.area_m2).into()),
        ("direction", Value::Vector(a.direction.to_vec())),
        ("wrench", Value::Vector(d.wrench(k).to_vec())),
        ("maximum_ahead", maximum_ahead),
        ("maximum_astern", maximum_astern),
        ("minimum_ahead", minimum_ahead),
        ("minimum_astern", minimum_astern),
        ("characteristic", text(a.kind())),
        ("needs_voltage", Value::Flag(needs_voltage)),
        ("power_w_s3", a.power().into()),
    ])
}

/// Per coefficient that the vehicle can have: unit, start value, default bounds, description; and of what its geometry
/// tells, the value by the formula, the ends of its stated 95 % interval, its standard deviation and its source.
pub fn coefficients(d: &Description) -> BTreeMap<String, Facts> {
    let known = (0..d.layout.len()).filter(|&i| d.uses(i));
    known
        .map(|i| {
            let bounds = d.default_bounds(i);
            let formula = d.start_values[i].filter(|start| start.value != 0.0);
            let [low, high] = formula.map_or([None; 2], |start| start.interval().map(Some));
            let facts = BTreeMap::from([
                ("unit", Value::Text(d.layout.unit(i, d.command_unit(i)))),
                ("start", Value::Number(d.reference(i))),
                ("formula", formula.map(|start| start.value).into()),
                ("low", low.into()),
                ("high", high.into()),
                ("sd", formula.map(|start| start.sd()).into()),
                ("source", formula.map_or(Value::None, |start| Value::Text(start.source.to_owned()))),
                ("lower", bounds.map(|b| b.0).into()),
                ("upper", bounds.map(|b| b.1).into()),
                ("description", Value::Text(d.layout.description(i))),
            ]);
            (d.layout.name(i), facts)
        })
        .collect()
}

/// Measures of the hull, m; none when the file has no geometry.
pub fn geometry(d: &Description) -> BTreeMap<&'static str, f64> {
    let measures = |g: &crate::description::geometry::Geometry| {
        [("length", g.length_m), ("diameter", g.diameter_m), ("height", g.height())]
    };
    d.file.geometry.iter().flat_map(measures).collect()
}

/// Density (kg/m³) and gravity (m/s²) for which the coefficients hold.
pub fn environment(d: &Description) -> BTreeMap<&'static str, f64> {
    BTreeMap::from([("rho", d.file.environment.rho_kg_m3), ("g", d.file.environment.g_m_s2)])
}

/// Hotel load and battery; none when the file has no power.
pub fn power(d: &Description) -> BTreeMap<&'static str, f64> {
    d.file.power.iter().flat_map(|p| [("hotel_w", p.hotel_w), ("battery_wh", p.battery_wh)]).collect()
}
