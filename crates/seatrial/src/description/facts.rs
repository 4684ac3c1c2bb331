//! What can be said about a vehicle besides its motion, as plain values by name, for reports.

use super::placement::Effect;
use super::values::Description;
use crate::description::coefficients::HULL;
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
    /// Text.
    Text(String),
    /// Components.
    Vector(Vec<f64>),
}

/// Values by name.
pub type Facts = BTreeMap<&'static str, Value>;

impl From<Option<f64>> for Value {
    fn from(x: Option<f64>) -> Self {
        x.map_or(Self::None, Self::Number)
    }
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

/// Per coefficient that the vehicle can have: unit, start value, default bounds, description.
pub fn coefficients(d: &Description) -> BTreeMap<String, Facts> {
    let known = (0..d.layout.len()).filter(|&i| i < HULL || d.uses(i));
    known
        .map(|i| {
            let bounds = d.default_bounds(i);
            let facts = BTreeMap::from([
                ("unit", Value::Text(d.layout.unit(i, d.command_unit(i)))),
                ("start", Value::Number(d.start_values[i].unwrap_or(d.coefficients[i]))),
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
        [("length", g.length_m), ("diameter", g.diameter_m), ("height", g.height_m.unwrap_or(g.diameter_m))]
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
