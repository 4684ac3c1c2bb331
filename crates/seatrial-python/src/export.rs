//! The steps of vehicle, autopilot and navigation filter as C.

use crate::autopilot::Autopilot;
use crate::convert::{Numbers, Table};
use crate::error::{raised, refused};
use crate::mission::Mission;
use crate::navigation_filter::Filter;
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::description::facts::Value;
use seatrial::export::autopilot::AutopilotStep;
use seatrial::export::c::Module;
use seatrial::export::filter::FilterStep;
use seatrial::export::program::{Count, Program, Symbol};
use seatrial::export::vehicle::VehicleStep;
use seatrial::model::integrate::State;

/// The numbers of an interface as plain data.
fn symbols(all: &[Symbol]) -> Value {
    let text = |x: &str| Value::Text(x.to_owned());
    let symbol = |s: &Symbol| {
        Value::Table(vec![
            ("name".into(), text(&s.name)),
            ("known_as".into(), text(&s.known_as)),
            ("unit".into(), text(&s.unit)),
            ("about".into(), text(&s.about)),
            ("start".into(), Value::Number(s.start)),
            ("least".into(), Value::Number(s.range[0])),
            ("most".into(), Value::Number(s.range[1])),
        ])
    };
    Value::List(all.iter().map(symbol).collect())
}

/// The operations of a call as plain data.
fn operations(count: Count) -> Value {
    let counts = [
        ("simple", count.simple),
        ("quotients", count.quotients),
        ("functions", count.functions),
        ("decisions", count.decisions),
        ("tables", count.tables),
        ("all", count.all()),
    ];
    Value::Table(counts.iter().map(|(name, n)| ((*name).to_owned(), Value::Whole(*n as i64))).collect())
}

/// A program with its header and source, its numbers and its operations by function, as plain data.
fn exported(program: &Program, prefix: &str, about: &[String], measured: bool) -> Table {
    let source = program.to_c(&Module { prefix, about, measured });
    let (outputs, state) = (program.needed_for(true), program.needed_for(false));
    let counts = if measured {
        vec![("measure", program.count(&outputs)), ("step", program.count(&state))]
    } else {
        let both: Vec<bool> = outputs.iter().zip(&state).map(|(a, b)| *a || *b).collect();
        vec![("step", program.count(&both))]
    };
    let counts = counts.into_iter().map(|(name, count)| (name.to_owned(), operations(count))).collect();
    let interface = &program.interface;
    Table::from_value(Value::Table(vec![
        ("header".into(), Value::Text(source.header)),
        ("source".into(), Value::Text(source.source)),
        ("parameters".into(), symbols(&interface.parameters)),
        ("state".into(), symbols(&interface.state)),
        ("inputs".into(), symbols(&interface.inputs)),
        ("outputs".into(), symbols(&interface.outputs)),
        ("operations".into(), Value::Table(counts)),
    ]))
}

/// The step of a vehicle as C, see `seatrial.export`: header, source, numbers by name, operations.
///
/// Parameters
/// ----------
/// prefix : str
///     Of all public names; an identifier of C.
/// about : list of str
///     Lines of the heads of both files.
/// step_s : float
///     Length of a step, s.
/// position, attitude, nu : (3,), (4,) or (3,), (6,)
///     Where it begins.
#[pyfunction]
#[pyo3(signature = (vehicle, prefix, about, step_s, *, position, attitude, nu, voltage_v = f64::NAN, rho = None, g = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one call")]
pub fn vehicle_c(
    vehicle: PyRef<'_, Vehicle>,
    prefix: &str,
    about: Vec<String>,
    step_s: f64,
    position: Numbers,
    attitude: Numbers,
    nu: Numbers,
    voltage_v: f64,
    rho: Option<f64>,
    g: Option<f64>,
) -> PyResult<Table> {
    if !(step_s.is_finite() && step_s > 0.0) {
        return Err(refused(format!("step_s: expected a positive time in s, found {step_s}")));
    }
    let description = &vehicle.description;
    let attitude = attitude.attitudes("attitude")?;
    let start = State { position: position.row("position")?, attitude: attitude[0], nu: nu.row("nu")? };
    let environment = description.file.environment.with(rho, g).map_err(raised)?;
    let step = VehicleStep { h: step_s, voltage: voltage_v, environment, start };
    Ok(exported(&step.record(description).map_err(raised)?, prefix, &about, true))
}

/// The step of an autopilot on a vehicle and a mission as C, see `seatrial.export`: as `vehicle_c`.
#[pyfunction]
#[pyo3(signature = (autopilot, vehicle, mission, prefix, about, *, feedback = true, voltage_v = f64::NAN))]
pub fn autopilot_c(
    autopilot: PyRef<'_, Autopilot>,
    vehicle: PyRef<'_, Vehicle>,
    mission: PyRef<'_, Mission>,
    prefix: &str,
    about: Vec<String>,
    feedback: bool,
    voltage_v: f64,
) -> PyResult<Table> {
    let step = AutopilotStep {
        settings: &autopilot.settings,
        model: &vehicle.description,
        mission: &mission.core,
        feedback,
        voltage: voltage_v,
    };
    Ok(exported(&step.record().map_err(raised)?, prefix, &about, false))
}

/// A navigation filter as C, see `seatrial.export`: as `vehicle_c`.
///
/// Parameters
/// ----------
/// autopilot : (str, list of str), optional
///     Prefix of an autopilot's program that is told the estimate, and the names of its inputs.
/// start : (3,), optional
///     Where the vehicle begins unless a sensor says it, m; that of the filter by default.
#[pyfunction]
#[pyo3(signature = (filter, prefix, about, *, period_s, autopilot = None, start = None, voltage_v = f64::NAN))]
pub fn filter_c(
    filter: PyRef<'_, Filter>,
    prefix: &str,
    about: Vec<String>,
    period_s: f64,
    autopilot: Option<(String, Vec<String>)>,
    start: Option<Numbers>,
    voltage_v: f64,
) -> PyResult<Table> {
    if voltage_v.is_nan() && filter.needs_voltage() {
        return Err(refused("voltage_v: expected the supply in V, the thrust of an actuator depends on it"));
    }
    let mut fitting = filter.fitting_for(period_s);
    if let Some(place) = start {
        fitting.start.0 = place.row("start")?;
    }
    let step = FilterStep { description: filter.description(), fitting: &fitting, voltage: voltage_v };
    let told = autopilot.as_ref().map(|(prefix, names)| (prefix.as_str(), &names[..]));
    let made = step.write(prefix, &about, told).map_err(raised)?;
    let counts = made.recorded.map(|(name, count)| (name.to_owned(), operations(count))).to_vec();
    Ok(Table::from_value(Value::Table(vec![
        ("header".into(), Value::Text(made.header)),
        ("source".into(), Value::Text(made.source)),
        ("parameters".into(), symbols(&made.parameters)),
        ("state".into(), symbols(&made.state)),
        ("inputs".into(), symbols(&made.inputs)),
        ("outputs".into(), symbols(&made.outputs)),
        ("operations".into(), Value::Table(counts)),
    ])))
}
