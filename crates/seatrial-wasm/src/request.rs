//! What a page asks: read from TOML, answered by the core.

use crate::Answer;
use seatrial::Error;
use seatrial::control::autopilot::set_point::SET_POINTS;
use seatrial::control::autopilot::settings::{Settings, tunable_index};
use seatrial::control::navigation::{CHANNELS, GROUPS, Outage, Seabed, Sensors};
use seatrial::control::navigation_filter::{GRAVITY, Stated};
use seatrial::description::Description;
use seatrial::fit::inputs::actuator_index;
use seatrial::flight::acoustics::{Acoustics, ROW};
use seatrial::flight::batch::{Case, Cases};
use seatrial::flight::case::SURFACE;
use seatrial::flight::faults::ActuatorFault;
use seatrial::flight::log::columns_with;
use seatrial::flight::reached::{loiter_radius, moments, nearest};
use seatrial::flight::summary::FIGURES;
use seatrial::flight::trial::{Dither, Trial};
use seatrial::flight::waves::Sea;
use seatrial::flight::{Flight, whole_steps};
use seatrial::mission::Mission;
use seatrial::model::integrate::State;
use seatrial::model::kinematics::from_euler;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// One flight, in the terms of `seatrial.fly`; SI and rad.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fly {
    vehicle: String,
    /// The vehicle that the autopilot believes in; the one that flies when empty.
    #[serde(default)]
    model: String,
    autopilot: String,
    mission: String,
    /// Position, attitude (quaternion) and velocities at the start; at rest where the mission begins when missing.
    start: Option<([f64; 3], [f64; 4], [f64; 6])>,
    /// Of the vehicle that flies; its model keeps its own.
    #[serde(default)]
    coefficients: Vec<(String, f64)>,
    #[serde(default)]
    gains: Vec<(String, f64)>,
    current: [f64; 3],
    turbulence: [f64; 3],
    turbulence_times: [f64; 2],
    current_trend: [f64; 3],
    current_walk: [f64; 3],
    /// Significant height, m, peak period, s, direction and spreading, rad, peakedness.
    waves: [f64; 5],
    seed: u64,
    /// Noise, bias, drift and quantum per channel.
    errors: [[f64; 4]; CHANNELS],
    /// Present, every, latency (control periods), drop-outs every s, for s, per group.
    timing: [[f64; 5]; GROUPS],
    /// Of what only a filter reads: kind, and its numbers as [`Acoustics::of_rows`] takes them.
    #[serde(default)]
    acoustics: Vec<(String, [f64; ROW])>,
    /// Where the transceiver of the acoustic positioning is, NED, m.
    #[serde(default)]
    transceiver: [f64; 3],
    /// Actuator, time in s, and the command at which it sticks; not a number: where it is.
    #[serde(default)]
    faults: Vec<(String, f64, f64)>,
    /// Group of sensors, from and until, s.
    #[serde(default)]
    outages: Vec<(usize, f64, f64)>,
    /// North, east and radius, m.
    #[serde(default)]
    obstacles: Vec<(f64, f64, f64)>,
    seabed: Option<Seabed>,
    voltage: f64,
    feedback: bool,
    /// The filter whose estimate the autopilot goes by; missing: what the sensors show.
    navigation: Option<Stated>,
    /// The vehicle that the filter is of; the autopilot's when empty.
    #[serde(default)]
    navigation_model: String,
    /// Its period, s; that of the autopilot when missing.
    navigation_period: Option<f64>,
    /// The waves that the filter was told of; those of the flight when missing.
    navigation_waves: Option<[f64; 5]>,
    rho: Option<f64>,
    g: Option<f64>,
    max_step: f64,
    max_time: f64,
    /// Begin of each set point of a step trial, s; empty where guidance rules.
    #[serde(default)]
    times: Vec<f64>,
    /// Set points by name, a value per time.
    #[serde(default)]
    set_points: Vec<(String, Vec<f64>)>,
    /// Begin of each value of the dither, s, and by actuator what is added to its command.
    #[serde(default)]
    dither_times: Vec<f64>,
    #[serde(default)]
    dither: Vec<(String, Vec<f64>)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfMission {
    mission: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Move {
    mission: String,
    waypoint: usize,
    place: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Changed {
    file: String,
    values: Vec<(String, f64)>,
}

pub fn fly(text: &str) -> Answer {
    let asked: Fly = read(text)?;
    let description = Description::from_toml(&asked.vehicle, "vehicle").map_err(said)?;
    let own = match asked.model.as_str() {
        "" => None,
        file => Some(Description::from_toml(file, "model").map_err(said)?),
    };
    let model = own.as_ref().unwrap_or(&description);
    let settings = Arc::new(Settings::from_toml(&asked.autopilot, "autopilot").map_err(said)?);
    settings.with_tunables(&asked.gains).map_err(said)?;
    settings.fits(model).map_err(said)?;
    let mission = Arc::new(Mission::from_toml(&asked.mission, "mission").map_err(said)?);
    let (mut trial, set_points) = steps(&asked)?;
    trial.dither = dither(&asked, &description)?;
    let outages = asked.outages.iter().map(|&(group, from, until)| Outage { group, from, until });
    let sensors = Sensors::of_rows(asked.errors, asked.timing, outages.collect());
    let dt = settings.file.period_s;
    let filtered = match asked.navigation_model.as_str() {
        "" => None,
        file => Some(Description::from_toml(file, "navigation_model").map_err(said)?),
    };
    let swell = Sea::of_row(asked.navigation_waves.unwrap_or(asked.waves)).swell(GRAVITY);
    let (of, period) = (filtered.as_ref().unwrap_or(model), asked.navigation_period.unwrap_or(dt));
    let fitting = asked.navigation.as_ref().map(|stated| stated.fitting(of, period, swell));
    let fitting = fitting.transpose().map_err(said)?;
    let acoustics = Acoustics::of_rows(&asked.acoustics, asked.transceiver, &mission.file.landmarks)?;
    let flight = Flight {
        description: &description,
        model,
        settings: &settings,
        mission: &mission,
        sensors: &sensors,
        navigation: fitting.as_ref(),
        acoustics: &acoustics,
        feedback: asked.feedback,
        seabed: asked.seabed,
        obstacles: &mission.with_cylinders(&asked.obstacles),
        trial: &trial,
        turbulence_times: asked.turbulence_times,
        environment: description.file.environment.with(asked.rho, asked.g).map_err(said)?,
        surface: SURFACE,
        voltage: asked.voltage,
        substeps: whole_steps(dt / asked.max_step),
        periods: whole_steps(asked.max_time / dt),
    };
    let (sought, coefficients) = indexed(&asked.coefficients, |name| description.layout.find(name))?;
    let (tuned, tunables) = indexed(&asked.gains, tunable_index)?;
    let case = Case {
        coefficients,
        tunables,
        state: state(&asked, &mission),
        current: asked.current,
        turbulence: asked.turbulence,
        current_trend: asked.current_trend,
        current_walk: asked.current_walk,
        offsets: None,
        sea: Sea::of_row(asked.waves),
        seed: asked.seed & ((1 << 53) - 1),
        faults: faults(&asked, &description)?,
        outages: Vec::new(),
        set_points,
        scales: Vec::new(),
    };
    let cases = Cases { coefficients: &sought, tunables: &tuned, cases: &[case] };
    let flown = flight.fly(&cases, true, &AtomicBool::new(false)).map_err(said)?;
    let outcome = flown.into_iter().next().ok_or("fly: nothing was flown")?;
    let columns = columns_with(&description.actuators);
    let near = nearest(&mission, loiter_radius(&settings), &moments(&outcome.log.values, columns.len()));
    let mut numbers: Vec<f64> = FIGURES.iter().map(|(_, of)| of(&outcome.summary)).collect();
    numbers.extend([near.iter().filter(|waypoint| waypoint.reached).count(), near.len()].map(|n| n as f64));
    numbers.extend(outcome.log.in_commands(&description.actuators).values);
    let names: Vec<&str> = FIGURES.iter().map(|(name, _)| *name).chain(["reached", "legs"]).collect();
    Ok((numbers, format!("{}\n{}", names.join(" "), columns.join(" "))))
}

/// Where the flight begins.
fn state(asked: &Fly, mission: &Mission) -> State<f64> {
    let at_rest = || (mission.start.position, from_euler(&[0.0, 0.0, mission.start_heading()]), [0.0; 6]);
    let (position, attitude, nu) = asked.start.unwrap_or_else(at_rest);
    State { position, attitude, nu }
}

/// What is added to the commands.
fn dither(asked: &Fly, vehicle: &Description) -> Result<Dither, String> {
    let of = |(name, values): &(String, Vec<f64>)| {
        let actuator = actuator_index(vehicle, name).map_err(said)?;
        if values.len() != asked.dither_times.len() {
            return Err(format!("dither: {name}: expected {} values", asked.dither_times.len()));
        }
        let sign = if vehicle.actuators[actuator].reversed { -1.0 } else { 1.0 };
        Ok((actuator, values.iter().map(|x| sign * x).collect()))
    };
    let signals = asked.dither.iter().map(of).collect::<Result<Vec<_>, String>>()?;
    Ok(Dither { times: asked.dither_times.clone(), signals })
}

pub fn mission(text: &str) -> Answer {
    let asked: OfMission = read(text)?;
    let mission = Mission::from_toml(&asked.mission, "mission").map_err(said)?;
    let [north, east, depth] = mission.start.position;
    let mut numbers = vec![north, east, depth, mission.start_heading()];
    numbers.extend([mission.path_length(), mission.planned_time(), mission.limits.time]);
    numbers.push(mission.waypoints.len() as f64);
    for waypoint in &mission.waypoints {
        numbers.extend(waypoint.position);
        numbers.push(waypoint.acceptance);
    }
    let labels: Vec<&str> = mission.waypoints.iter().map(|waypoint| waypoint.label.as_str()).collect();
    Ok((numbers, labels.join("\n")))
}

pub fn autopilot(text: &str) -> Answer {
    let asked: Changed = read(text)?;
    let settings = Settings::from_toml(&asked.file, "autopilot").map_err(said)?;
    Ok((Vec::new(), settings.with_tunables(&asked.values).map_err(said)?.file.to_toml()))
}

pub fn vehicle(text: &str) -> Answer {
    let asked: Changed = read(text)?;
    let vehicle = Description::from_toml(&asked.file, "vehicle").map_err(said)?;
    Ok((Vec::new(), vehicle.with_coefficients(&asked.values).map_err(said)?.file.to_toml()))
}

pub fn moved(text: &str) -> Answer {
    let asked: Move = read(text)?;
    let mission = Mission::from_toml(&asked.mission, "mission").map_err(said)?;
    let moved = mission.with_waypoint_at(asked.waypoint, asked.place).map_err(said)?;
    Ok((Vec::new(), moved.to_toml()))
}

/// The step trial and its set points, `[named][time]`.
fn steps(asked: &Fly) -> Result<(Trial, Vec<f64>), String> {
    let mut trial = Trial { times: asked.times.clone(), ..Trial::default() };
    let mut values = Vec::new();
    for (name, row) in &asked.set_points {
        let place = SET_POINTS.iter().position(|known| known == name);
        trial.named.push(place.ok_or_else(|| format!("set_points: there is no {name}"))?);
        if row.len() != trial.times.len() {
            return Err(format!("set_points: {name}: expected {} values", trial.times.len()));
        }
        values.extend(row);
    }
    Ok((trial, values))
}

fn faults(asked: &Fly, vehicle: &Description) -> Result<Vec<ActuatorFault>, String> {
    let of = |(name, from, command): &(String, f64, f64)| {
        let actuator = actuator_index(vehicle, name).map_err(said)?;
        let signal = (!command.is_nan()).then(|| vehicle.actuators[actuator].signal(*command));
        Ok(ActuatorFault { actuator, from: *from, signal })
    };
    asked.faults.iter().map(of).collect()
}

/// Indices and values of what differs from the files.
fn indexed(
    named: &[(String, f64)],
    find: impl Fn(&str) -> Result<usize, String>,
) -> Result<(Vec<usize>, Vec<f64>), String> {
    let pairs = named.iter().map(|(name, value)| Ok((find(name)?, *value)));
    Ok(pairs.collect::<Result<Vec<_>, String>>()?.into_iter().unzip())
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    toml::from_str(text).map_err(|error| format!("request: {error}"))
}

fn said(error: Error) -> String {
    error.to_string()
}
