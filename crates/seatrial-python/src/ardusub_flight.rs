//! A vehicle under ArduSub's cascade along targets over time.

use crate::ardusub::mixer_of;
use crate::convert::{Array, Named, Numbers};
use crate::error::refused;
use crate::vehicle::Vehicle;
use crate::work::{Threads, parallel};
use pyo3::prelude::*;
use seatrial::control::ardusub::cascade::{INTEGRALS, WANTED, Wanted};
use seatrial::control::ardusub::parameters::{PARAMETERS, index};
use seatrial::flight::ardusub::{COLUMNS, Case, Course};
use seatrial::model::integrate;
use std::collections::BTreeMap;

/// ArduSub's defaults of the parameters that `ardusub_fly` takes, by name, in ArduSub's units (4.7 and later).
#[pyfunction]
pub fn ardusub_defaults() -> BTreeMap<&'static str, f64> {
    PARAMETERS.iter().map(|(name, value, _)| (*name, *value)).collect()
}

/// Flies k cases along targets: rows (k, n, 20) of place (m, NED), roll, pitch, yaw (rad), velocity (body), the demands of
/// roll, pitch, yaw, throttle, forward and lateral (-1 to 1), and the load of the motors by roll, pitch and throttle and by
/// yaw, forward and lateral (1: at the limit).
///
/// frame, direction, pulse and coupling as of `ardusub_pulses`. parameters {name: (k,) or a number} by `ardusub_defaults`, which hold
/// where none is given. targets (N, 20), a row per control period: roll, pitch, yaw (rad), rate of that yaw (rad/s),
/// north, east, down (m), their velocity and acceleration, the pilot's throttle, forward and lateral, 1 where the depth
/// and where the place is controlled, supply (V), 1 where the attitude is asked for and its target moves there, limited in
/// rate and acceleration, 0 where it is the target. position (k, 3) or (3,), attitude (k, 4|3), nu (k, 6); integrals (k, 7):
/// integral parts of roll, pitch, yaw, of the vertical velocity and acceleration, north and east. coefficients {name:
/// (k,)} of the vehicle. current (k, 3), NED, m/s; wander (k, 6): standard deviation of a wrench in the body frame that
/// the model does not know, with the time constant wander_s; tether (k, 3): force, NED, N, at the point tether_at, m;
/// supply (k, 3): thrust over that of the voltage at the beginning, its fall per s and at full load. noise (2,): standard
/// deviation on gyro (rad/s) and velocity (m/s). A row is kept every `every` periods.
#[pyfunction]
#[pyo3(signature = (vehicle, frame, direction, targets, *, seeds, period_s, every, parameters = None, coefficients = None, position, attitude, nu, integrals, current, wander, wander_s, tether, tether_at, supply, noise, pulse = None, coupling = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one call")]
pub fn ardusub_fly(
    py: Python<'_>,
    vehicle: PyRef<'_, Vehicle>,
    frame: &str,
    direction: Numbers,
    targets: Numbers,
    seeds: Vec<u64>,
    period_s: f64,
    every: usize,
    parameters: Option<Named>,
    coefficients: Option<Named>,
    position: Numbers,
    attitude: Numbers,
    nu: Numbers,
    integrals: Numbers,
    current: Numbers,
    wander: Numbers,
    wander_s: f64,
    tether: Numbers,
    tether_at: Numbers,
    supply: Numbers,
    noise: Numbers,
    pulse: Option<Numbers>,
    coupling: Option<f64>,
    threads: Option<Threads>,
) -> PyResult<Array> {
    let description = &vehicle.description;
    let mixer = mixer_of(frame, direction, pulse, coupling)?;
    let motors = mixer.motors;
    if description.actuators.len() != motors.len() {
        return Err(refused(format!(
            "vehicle: expected the {} motors of {frame}, found {} actuators",
            motors.len(),
            description.actuators.len()
        )));
    }
    for (name, x) in [("period_s", period_s), ("wander_s", wander_s)] {
        if !(x.is_finite() && x > 0.0) {
            return Err(refused(format!("{name}: expected a positive time in s, found {x}")));
        }
    }
    if every == 0 {
        return Err(refused("every: expected at least one control period, found 0"));
    }
    let k = seeds.len();
    let rows = targets.rows::<WANTED>("targets")?;
    if rows.is_empty() || rows.iter().flatten().any(|x| !x.is_finite()) {
        return Err(refused("targets: expected one or more rows of finite numbers"));
    }
    let wanted: Vec<Wanted> = rows.iter().map(Wanted::of).collect();
    let (given, own) = by_name(parameters, k, |name| index(name).map_err(refused))?;
    let (sought, values) = by_name(coefficients, k, |name| description.layout.find(name).map_err(refused))?;
    let [position, nu] = [position.for_cases("position", k, 3)?, nu.for_cases("nu", k, 6)?];
    let attitudes = attitude.attitudes("attitude")?;
    if attitudes.len() != k && attitudes.len() != 1 {
        return Err(refused(format!("attitude: expected {k} or 1, found {}", attitudes.len())));
    }
    let integrals = integrals.for_cases("integrals", k, INTEGRALS)?;
    let (current, wander) = (current.for_cases("current", k, 3)?, wander.for_cases("wander", k, 6)?);
    let (tether, supply) = (tether.for_cases("tether", k, 3)?, supply.for_cases("supply", k, 3)?);
    let cases: Vec<Case> = (0..k)
        .map(|i| Case {
            coefficients: values.iter().map(|column| column[i]).collect(),
            parameters: own.iter().map(|column| column[i]).collect(),
            state: integrate::State {
                position: row(&position[i]),
                attitude: attitudes[i % attitudes.len()],
                nu: row(&nu[i]),
            },
            integrals: row(&integrals[i]),
            current: row(&current[i]),
            wander: row(&wander[i]),
            tether: row(&tether[i]),
            supply: row(&supply[i]),
            seed: seeds[i] & ((1 << 53) - 1),
        })
        .collect();
    let course = Course {
        description,
        mixer: &mixer,
        wanted: &wanted,
        period: period_s,
        every,
        noise: noise.row("noise")?,
        wander_s,
        tether_at: tether_at.row("tether_at")?,
        coefficients: &sought,
        parameters: &given,
    };
    let flown = parallel(py, threads, |stop| course.fly(&cases, stop))?;
    Ok(Array::new(&[k, course.rows(), COLUMNS], flown))
}

/// The numbers of a row.
fn row<const N: usize>(values: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| values[i])
}

/// Indices of what is named, and a value of each for every case.
fn by_name(
    named: Option<Named>,
    k: usize,
    find: impl Fn(&str) -> PyResult<usize>,
) -> PyResult<(Vec<usize>, Vec<Vec<f64>>)> {
    let (mut indices, mut columns) = (Vec::new(), Vec::new());
    for (name, numbers) in named.map_or_else(BTreeMap::new, Named::by_name) {
        let rows = numbers.for_cases(&name, k, 1)?;
        let values: Vec<f64> = rows.into_iter().map(|row| row[0]).collect();
        if let Some(x) = values.iter().find(|x| !x.is_finite()) {
            return Err(refused(format!("{name}: expected finite numbers, found {x}")));
        }
        indices.push(find(&name)?);
        columns.push(values);
    }
    Ok((indices, columns))
}
