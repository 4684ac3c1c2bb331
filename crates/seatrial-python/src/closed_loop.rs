//! `fly`: cases of a closed-loop flight, and `Flights`, what they were.

use crate::autopilot::Autopilot;
use crate::convert::{Array, Named, Numbers};
use crate::error::{raised, refused};
use crate::log_store::LogStore;
use crate::mission::Mission;
use crate::navigation_filter::Filter;
use crate::pickle::{self, Parts, parts, restorer};
use crate::trial::{CorridorRow, Trials, dither as dither_of};
use crate::vehicle::Vehicle;
use crate::work::{Threads, parallel};
use pyo3::prelude::*;
use seatrial::control::autopilot::settings::{tunable_index, tunable_names};
use seatrial::control::navigation::{CHANNELS, GROUPS, Outage, Sensors};
use seatrial::control::navigation_filter::KINDS;
use seatrial::description::{ActuatorDescription, Description};
use seatrial::fit::inputs::actuator_index;
use seatrial::flight::acoustics::{Acoustics, MOST_LATENCY, ROW};
use seatrial::flight::batch::{Case, Cases, Outcome};
use seatrial::flight::case::SURFACE;
use seatrial::flight::exceedance::{EDGES, edges};
use seatrial::flight::faults::ActuatorFault;
use seatrial::flight::log::{self, Log};
use seatrial::flight::summary::{FIGURES, Summary};
use seatrial::flight::waves::Sea;
use seatrial::flight::{Flight, whole_steps};
use seatrial::model::integrate;
use seatrial::number::lanes::LANES;
use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

/// The flights of k cases: a log of each, where one was kept, and their figures.
#[pyclass(frozen, module = "seatrial")]
pub struct Flights {
    description: Arc<Description>,
    summaries: Vec<Summary<f64>>,
    logs: LogStore,
    dt: f64,
}

impl Flights {
    fn check_case(&self, case: usize) -> PyResult<()> {
        if case < self.logs.len() {
            return Ok(());
        }
        Err(refused(format!("case: expected below {}, found {case}", self.logs.len())))
    }

    /// Settled samples and those above each threshold, of the cross-track (0), vertical (1) or true cross-track error (2).
    fn counts(&self, error: usize) -> Array {
        let row = |s: &Summary<f64>| {
            let above = s.exceedance[error].counts;
            std::iter::once(s.settled).chain(above).collect::<Vec<f64>>()
        };
        Array::new(&[self.summaries.len(), 1 + EDGES], self.summaries.iter().flat_map(row).collect())
    }
}

#[pymethods]
impl Flights {
    /// Number of cases.
    fn __len__(&self) -> usize {
        self.summaries.len()
    }

    /// Names of the columns of a log; cmd.<actuator> and act.<actuator> are in the unit of the command.
    #[getter]
    fn columns(&self) -> Vec<String> {
        log::columns_with(&self.description.actuators)
    }

    /// The log of a case, shape (n, columns), one row per control period; SI and rad.
    fn log(&self, case: usize) -> PyResult<Array> {
        self.check_case(case)?;
        let log = self.logs.get(case).map_err(raised)?.into_owned();
        let Log { values, rows } = log.in_commands(&self.description.actuators);
        let width = self.columns().len();
        Ok(Array::new(&[rows, width], values))
    }

    /// Time of the rows of a case, shape (n,), s.
    fn t(&self, case: usize) -> PyResult<Array> {
        self.check_case(case)?;
        let rows = self.logs.rows(case);
        Ok(Array::new(&[rows], (0..rows).map(|k| k as f64 * self.dt).collect()))
    }

    /// The figures of all cases by name, shape (k,) each; SI and rad, a diverged flight is not a number.
    #[getter]
    fn figures(&self) -> BTreeMap<String, Array> {
        let column = |read: &dyn Fn(&Summary<f64>) -> f64| {
            Array::new(&[self.summaries.len()], self.summaries.iter().map(read).collect())
        };
        let mut figures: BTreeMap<_, _> =
            FIGURES.iter().map(|(name, read)| ((*name).to_owned(), column(read))).collect();
        for (k, kind) in std::iter::once("").chain(KINDS).enumerate() {
            // A sensor that gave the filter nothing has no figures.
            let heard = |s: &Summary<f64>| s.consistency[k][1] + s.consistency[k][2] > 0.0;
            if !self.summaries.iter().any(heard) {
                continue;
            }
            let of = if k == 0 { String::new() } else { format!("{kind}_") };
            for (i, what) in ["nis", "samples", "refused"].into_iter().enumerate() {
                figures.insert(format!("navigation_{of}{what}"), column(&|s| s.consistency[k][i]));
            }
        }
        figures
    }

    /// How many samples of the cross-track error on settled legs there were and, of them, how many exceed each of
    /// `error_edges`, shape (k, 1 + edges).
    #[getter]
    fn cross_track_counts(&self) -> Array {
        self.counts(0)
    }

    /// The same of the vertical error.
    #[getter]
    fn vertical_counts(&self) -> Array {
        self.counts(1)
    }

    /// The same of the true cross-track error.
    #[getter]
    fn true_cross_track_counts(&self) -> Array {
        self.counts(2)
    }

    /// What each corridor of a trial was violated by, shape (k, corridors, 3): time integrals of the shortfall below
    /// the lower bound and of the excess over the upper one, s, and of clock times deviation from the target, s².
    #[getter]
    fn violations(&self) -> Array {
        let sums = |s: &Summary<f64>| s.violations.sums.concat();
        let corridors = self.summaries.first().map_or(0, |s| s.violations.sums.len());
        Array::new(&[self.summaries.len(), corridors, 3], self.summaries.iter().flat_map(sums).collect())
    }

    /// Itself: nothing of it can change.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    /// Itself: nothing of it can change.
    #[expect(unused_variables, reason = "the name is Python's")]
    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, FlightsParts)> {
        let summaries: Vec<Vec<f64>> = self.summaries.iter().map(Summary::to_row).collect();
        let width = summaries.first().map_or(0, Vec::len);
        let summaries = Array::new(&[self.summaries.len(), width], summaries.concat());
        let log = |case: usize| {
            let Log { values, rows } = self.logs.get(case).map_err(raised)?.into_owned();
            Ok(Array::new(&[rows, values.len() / rows.max(1)], values))
        };
        let logs = (0..self.logs.len()).map(log).collect::<PyResult<_>>()?;
        Ok((restorer(py, "_restored_flights")?, (parts(&self.description), self.dt, summaries, logs)))
    }
}

/// Vehicle, control period, figures (cases, …), and a log (n, …) per case.
type FlightsParts = (Parts, f64, Array, Vec<Array>);

/// The flights of exactly these numbers: how pickled ones come back.
#[pyfunction]
#[pyo3(name = "_restored_flights")]
pub fn restored_flights(
    vehicle: (String, Numbers),
    period_s: f64,
    figures: Numbers,
    logs: Vec<Numbers>,
) -> PyResult<Flights> {
    let description = Arc::new(pickle::description(&vehicle.0, vehicle.1)?);
    let (_, figures) = figures.table("figures")?;
    let width = figures.len() / logs.len().max(1);
    let mut flights = Flights { description, summaries: Vec::new(), logs: LogStore::default(), dt: period_s };
    for (case, log) in logs.into_iter().enumerate() {
        let (rows, values) = log.table("log")?;
        let summary = Summary::of_row(&figures[case * width..(case + 1) * width])
            .ok_or_else(|| refused(format!("figures: expected those of a flight, found {width} numbers")))?;
        flights.summaries.push(summary);
        flights.logs.push(Log { values, rows }).map_err(raised)?;
    }
    Ok(flights)
}

/// The thresholds of the counts of errors, m, shape (edges,).
#[pyfunction]
pub fn error_edges() -> Array {
    Array::new(&[EDGES], edges().to_vec())
}

/// Flies k cases of a mission; see `seatrial.fly`, which says it in the words of a user.
///
/// seeds (k,); position (k, 3) or (3,), attitude (k, 4|3), nu (k, 6), current (k, 3); coefficients {name: (k,)} of the
/// vehicle that flies and gains {name: (k,)} of the autopilot; model: the vehicle that the autopilot takes it for.
/// faults: rows (case, actuator, time in s, command or nan: where it is). errors (16, 4): noise, bias, drift and
/// quantum per channel; timing (7, 5): present, every, latency (control periods), drop-outs every s, for s; outages:
/// rows (group, from, until in s), case_outages: rows (case, group, from, until). seabed (3,): depth in m and slopes
/// north and east; obstacles: rows (north, east, radius in m) besides those of the mission. turbulence (k, 3) or (3,):
/// standard deviation of the current about its mean, NED, m/s, with the time constants turbulence_times_s;
/// current_trend (m/s2) and current_walk (m/s per root of a second), (k, 3) or (3,): slow change of that mean. waves
/// (k, 5) or (5,): significant height, m, peak period, s, direction and spreading, rad, peakedness. set_points
/// {"times": (S,), name: (k, S) or (S,)}: speed, lateral, heading, pitch, depth in place of guidance's, north, east,
/// down by which its plan is moved, each from its time on. dither {"times": (S,), actuator: (S,)}: added to the
/// autopilot's commands from each time on, in their unit. sensor_offsets (k, 16) or (16,): offset of each channel in
/// its standard deviations, in place of the one that the seed draws. navigation: the filter whose
/// estimate the autopilot is told, each case with one of its own; acoustics {kind: (17,)}: noise, offset, quantum, control
/// periods between samples, to the first and of latency, drop-outs every s, for s, reach, share and deviation of outliers, lever
/// arm (3), roll, pitch and yaw of its mounting, of gps, usbl, range and bearing, which see the mission's landmarks;
/// transceiver: place of the acoustic positioning, NED, m. corridors: rows (channel, base (k,), scale (k,), lower, upper,
/// target, clock (P,)), see `Flights.violations`.
#[pyfunction]
#[pyo3(signature = (vehicle, autopilot, mission, seeds, *, model = None, position, attitude, nu, current, coefficients = None, gains = None, faults = Vec::new(), errors, timing, outages = Vec::new(), feedback = true, seabed = None, voltage_v = f64::NAN, rho = None, g = None, max_step_s = 0.02, max_time_s, logs = true, threads = None, turbulence = None, turbulence_times_s = (60.0, 2.0), obstacles = Vec::new(), case_outages = Vec::new(), set_points = None, corridors = Vec::new(), current_trend = None, current_walk = None, waves = None, navigation = None, dither = None, sensor_offsets = None, acoustics = None, transceiver = (0.0, 0.0, 0.0)))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one call")]
pub fn fly(
    py: Python<'_>,
    vehicle: PyRef<'_, Vehicle>,
    autopilot: PyRef<'_, Autopilot>,
    mission: PyRef<'_, Mission>,
    seeds: Vec<u64>,
    model: Option<PyRef<'_, Vehicle>>,
    position: Numbers,
    attitude: Numbers,
    nu: Numbers,
    current: Numbers,
    coefficients: Option<Named>,
    gains: Option<Named>,
    faults: Vec<(usize, String, f64, f64)>,
    errors: Numbers,
    timing: Numbers,
    outages: Vec<(usize, f64, f64)>,
    feedback: bool,
    seabed: Option<Numbers>,
    voltage_v: f64,
    rho: Option<f64>,
    g: Option<f64>,
    max_step_s: f64,
    max_time_s: f64,
    logs: bool,
    threads: Option<Threads>,
    turbulence: Option<Numbers>,
    turbulence_times_s: (f64, f64),
    obstacles: Vec<(f64, f64, f64)>,
    case_outages: Vec<(usize, usize, f64, f64)>,
    set_points: Option<Named>,
    corridors: Vec<CorridorRow>,
    current_trend: Option<Numbers>,
    current_walk: Option<Numbers>,
    waves: Option<Numbers>,
    navigation: Option<PyRef<'_, Filter>>,
    dither: Option<Named>,
    sensor_offsets: Option<Numbers>,
    acoustics: Option<Named>,
    transceiver: (f64, f64, f64),
) -> PyResult<Flights> {
    let description = &vehicle.description;
    let settings = &autopilot.settings;
    let dt = settings.file.period_s;
    let (tau, tau_2) = turbulence_times_s;
    let times = [("turbulence_times_s", tau), ("turbulence_times_s", tau_2)];
    for (name, x) in [("max_step_s", max_step_s), ("max_time_s", max_time_s)].into_iter().chain(times) {
        if !(x.is_finite() && x > 0.0) {
            return Err(refused(format!("{name}: expected a positive time in s, found {x}")));
        }
    }
    let k = seeds.len();
    let starts = Starts {
        position: spread("position", position.rows::<3>("position")?, k)?,
        attitude: spread("attitude", attitude.attitudes("attitude")?, k)?,
        nu: spread("nu", nu.rows::<6>("nu")?, k)?,
        current: spread("current", current.rows::<3>("current")?, k)?,
        turbulence: match turbulence {
            Some(turbulence) => spread("turbulence", turbulence.rows::<3>("turbulence")?, k)?,
            None => vec![[0.0; 3]; k],
        },
        current_trend: match current_trend {
            Some(trend) => spread("current_trend", trend.rows::<3>("current_trend")?, k)?,
            None => vec![[0.0; 3]; k],
        },
        current_walk: match current_walk {
            Some(walk) => spread("current_walk", walk.rows::<3>("current_walk")?, k)?,
            None => vec![[0.0; 3]; k],
        },
        seas: match waves {
            Some(waves) => {
                spread("waves", waves.rows::<5>("waves")?, k)?.into_iter().map(Sea::of_row).collect()
            }
            None => vec![Sea::CALM; k],
        },
    };
    let Trials { mut trial, set_points, scales } = Trials::new(set_points, corridors, k)?;
    trial.dither = dither_of(dither, description)?;
    let (sought, columns) = varied(coefficients, k, |name| description.layout.find(name).map_err(refused))?;
    let (tuned, tunings) = varied(gains, k, |name| tunable_index(name).map_err(refused))?;
    let all = tunable_names();
    // The same gains in a thousand seas are one autopilot to check.
    let mut checked = HashSet::new();
    for i in (0..k).filter(|_| !tuned.is_empty()) {
        if !checked.insert(tunings.iter().map(|column| column[i].to_bits()).collect::<Vec<_>>()) {
            continue;
        }
        let values: Vec<(String, f64)> =
            tuned.iter().zip(&tunings).map(|(&index, column)| (all[index].clone(), column[i])).collect();
        settings.with_tunables(&values).map_err(raised)?;
    }
    let offsets = sensor_offsets
        .map(|rows| spread("sensor_offsets", rows.rows::<CHANNELS>("sensor_offsets")?, k))
        .transpose()?;
    let mut cases: Vec<Case> = (0..k)
        .map(|i| Case {
            coefficients: columns.iter().map(|c| c[i]).collect(),
            tunables: tunings.iter().map(|c| c[i]).collect(),
            state: integrate::State {
                position: starts.position[i],
                attitude: starts.attitude[i],
                nu: starts.nu[i],
            },
            current: starts.current[i],
            turbulence: starts.turbulence[i],
            current_trend: starts.current_trend[i],
            current_walk: starts.current_walk[i],
            sea: starts.seas[i],
            seed: seeds[i] & ((1 << 53) - 1),
            faults: Vec::new(),
            outages: Vec::new(),
            offsets: offsets.as_ref().map(|rows| rows[i]),
            set_points: set_points[i].clone(),
            scales: scales[i].clone(),
        })
        .collect();
    for (case, name, from, command) in faults {
        let actuator = actuator_index(description, &name).map_err(raised)?;
        let signal = (!command.is_nan()).then(|| description.actuators[actuator].signal(command));
        let case = cases
            .get_mut(case)
            .ok_or_else(|| refused(format!("faults: expected a case below {k}, found {case}")))?;
        case.faults.push(ActuatorFault { actuator, from, signal });
    }
    for (case, group, from, until) in case_outages {
        match cases.get_mut(case) {
            Some(case) if group < GROUPS => case.outages.push(Outage { group, from, until }),
            _ => {
                return Err(refused(format!(
                    "case_outages: expected a case below {k} and a group below {GROUPS}, found {case} and {group}"
                )));
            }
        }
    }
    let obstacles = mission.core.with_cylinders(&obstacles);
    let sensors = sensors(&errors, &timing, outages)?;
    let model = model.as_ref().map_or(description, |m| &m.description);
    let same = |(a, b): (&ActuatorDescription, &ActuatorDescription)| a.name == b.name && a.unit == b.unit;
    let pairs = model.actuators.iter().zip(&description.actuators);
    if model.actuators.len() != description.actuators.len() || !pairs.into_iter().all(same) {
        return Err(refused(format!(
            "model: expected the actuators of {} in its order, found those of {}",
            description.file.name, model.file.name
        )));
    }
    settings.fits(model).map_err(raised)?;
    let own = description.file.environment;
    let acoustics = acoustics_of(acoustics, transceiver, &mission.core)?;
    let fitting = navigation.map(|filter| filter.fitting_for(dt));
    let flight = Flight {
        description,
        model,
        settings,
        mission: &mission.core,
        sensors: &sensors,
        feedback,
        seabed: seabed.map(|s| s.row::<3>("seabed")).transpose()?,
        obstacles: &obstacles,
        trial: &trial,
        turbulence_times: [tau, tau_2],
        navigation: fitting.as_ref(),
        acoustics: &acoustics,
        environment: own.with(rho, g).map_err(raised)?,
        surface: SURFACE,
        voltage: voltage_v,
        substeps: whole_steps(dt / max_step_s),
        periods: whole_steps(max_time_s / dt),
    };
    let (summaries, logs) = parallel(py, threads, |stop| {
        let (mut summaries, mut kept) = (Vec::with_capacity(k), LogStore::default());
        while summaries.len() < k {
            let first = summaries.len();
            // A case that flies alone has no lanes and rounds otherwise: none is left over.
            let last = if logs { first + at_once(&kept) } else { k };
            let last = if last + 1 < k { last } else { k };
            let cases = Cases { coefficients: &sought, tunables: &tuned, cases: &cases[first..last] };
            for Outcome { summary, log } in flight.fly(&cases, logs, stop)? {
                summaries.push(summary);
                kept.push(log)?;
            }
        }
        Ok((summaries, kept))
    })?;
    Ok(Flights { description: description.clone(), summaries, logs, dt })
}

/// Number of flights whose logs are in memory together: no more than some megabytes of them, but work for all threads.
fn at_once(kept: &LogStore) -> usize {
    const TOGETHER: usize = 64 << 20;
    let least = LANES * rayon::current_num_threads();
    match kept.mean_bytes() {
        0 => least,
        bytes => (TOGETHER / bytes).clamp(least, 64 * least).next_multiple_of(LANES),
    }
}

/// Where the cases begin.
struct Starts {
    position: Vec<[f64; 3]>,
    attitude: Vec<[f64; 4]>,
    nu: Vec<[f64; 6]>,
    current: Vec<[f64; 3]>,
    turbulence: Vec<[f64; 3]>,
    current_trend: Vec<[f64; 3]>,
    current_walk: Vec<[f64; 3]>,
    seas: Vec<Sea>,
}

/// One row for each of `k` cases, from as many or one.
fn spread<const C: usize>(name: &str, rows: Vec<[f64; C]>, k: usize) -> PyResult<Vec<[f64; C]>> {
    if rows.iter().flatten().any(|x| !x.is_finite()) {
        return Err(refused(format!("{name}: expected finite numbers")));
    }
    match rows.len() {
        1 => Ok(vec![rows[0]; k]),
        n if n == k => Ok(rows),
        n => Err(refused(format!("{name}: expected one row or {k}, found {n}"))),
    }
}

/// Indices and columns of what varies from case to case.
fn varied(
    named: Option<Named>,
    k: usize,
    find: impl Fn(&str) -> PyResult<usize>,
) -> PyResult<(Vec<usize>, Vec<Vec<f64>>)> {
    let (mut indices, mut columns) = (Vec::new(), Vec::new());
    for (name, values) in Named::vectors(named)? {
        if values.len() != k {
            return Err(refused(format!(
                "{name}: expected {k} values, one per case, found {}",
                values.len()
            )));
        }
        indices.push(find(&name)?);
        columns.push(values);
    }
    Ok((indices, columns))
}

/// What only a navigation filter reads: a row per kind, and the landmarks of the mission.
fn acoustics_of(
    rows: Option<Named>,
    (north, east, down): (f64, f64, f64),
    mission: &seatrial::mission::Mission,
) -> PyResult<Acoustics> {
    let rows: Vec<(String, [f64; ROW])> = rows
        .map(Named::by_name)
        .into_iter()
        .flatten()
        .map(|(kind, row)| Ok((kind.to_owned(), row.row::<ROW>(&kind)?)))
        .collect::<PyResult<_>>()?;
    Acoustics::of_rows(&rows, [north, east, down], &mission.file.landmarks).map_err(refused)
}

/// The sensors of the arrays that Python gives.
fn sensors(errors: &Numbers, timing: &Numbers, outages: Vec<(usize, f64, f64)>) -> PyResult<Sensors> {
    let (errors, timing) = (errors.rows::<4>("errors")?, timing.rows::<5>("timing")?);
    if errors.len() != CHANNELS || timing.len() != GROUPS {
        return Err(refused(format!(
            "sensors: expected {CHANNELS} rows of errors and {GROUPS} of timing, found {} and {}",
            errors.len(),
            timing.len()
        )));
    }
    if let Some([_, _, latency, ..]) = timing.iter().find(|row| row[2] > MOST_LATENCY) {
        return Err(refused(format!(
            "timing: expected a latency of at most {MOST_LATENCY} control periods, found {latency}"
        )));
    }
    if let Some((group, ..)) = outages.iter().find(|row| row.0 >= GROUPS) {
        return Err(refused(format!("outages: expected a group below {GROUPS}, found {group}")));
    }
    let outages = outages.into_iter().map(|(group, from, until)| Outage { group, from, until });
    Ok(Sensors::of_rows(
        std::array::from_fn(|c| errors[c]),
        std::array::from_fn(|g| timing[g]),
        outages.collect(),
    ))
}
