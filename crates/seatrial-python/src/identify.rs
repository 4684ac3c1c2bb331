//! `Record` and `OpenLoop`: trials as the core reads them, and the criterion over candidates.

use crate::convert::{Array, Named, Numbers, optional_rows};
use crate::error::{raised, refused};
use crate::run::inputs;
use crate::vehicle::Vehicle;
use crate::work::{Threads, parallel};
use pyo3::prelude::*;
use seatrial::description::Description;
use seatrial::error::nearest;
use seatrial::fit::batch::{Batch, Candidates};
use seatrial::fit::criterion::{CHANNEL_NAMES, CHANNELS, Loss};
use seatrial::fit::inputs::{Inputs, modes};
use seatrial::fit::observation::{INITIAL_NAMES, INITIALS, NUISANCES, nuisance_names};
use seatrial::fit::record::{self, MotorStart, Segment};
use seatrial::fit::sensitivities::{Point, Prediction, Unknown};
use seatrial::model::integrate::State;
use seatrial::model::vehicle::Mode;
use std::sync::Arc;

/// One trial: inputs on a uniform time base, and measured channels with weights.
///
/// t (n,), s; commands {actuator: (n,)} in its own unit; voltage_v (n,), V; tau (n, 6), N and N m; current (n, 3),
/// NED, m/s; actuators {name: (n,)} measured signals that replace the motor; nu and nu_rate on the half-step
/// grid, (2 substeps (n - 1) + 1, 6), for measured axes; observed and weight (n, 12), SI, in the order u v w p q
/// r x y z roll pitch yaw, weight 0 = masked; rho, kg/m3; g, m/s2;
/// surface, m down of the zero of z: all is under water without it.
#[pyclass(frozen, module = "seatrial")]
pub struct Record {
    inputs: Inputs,
}

#[pymethods]
impl Record {
    #[new]
    #[pyo3(signature = (t, commands = None, *, voltage_v = None, tau = None, current = None, actuators = None, nu = None, nu_rate = None, observed = None, weight = None, rho = None, g = None, surface = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn new(
        t: Numbers,
        commands: Option<Named>,
        voltage_v: Option<Numbers>,
        tau: Option<Numbers>,
        current: Option<Numbers>,
        actuators: Option<Named>,
        nu: Option<Numbers>,
        nu_rate: Option<Numbers>,
        observed: Option<Numbers>,
        weight: Option<Numbers>,
        rho: Option<f64>,
        g: Option<f64>,
        surface: Option<f64>,
    ) -> PyResult<Self> {
        let inputs = Inputs {
            actuators: Named::vectors(actuators)?,
            nu: optional_rows("nu", nu)?,
            nu_rate: optional_rows("nu_rate", nu_rate)?,
            observed: optional_rows("observed", observed)?,
            weight: optional_rows("weight", weight)?,
            ..inputs(t, commands, current, tau, voltage_v, (rho, g, surface))?
        };
        Ok(Self { inputs })
    }

    fn __len__(&self) -> usize {
        self.inputs.t.len()
    }
}

/// A segment as Python gives it: record, first sample, one past the last, position, attitude, nu.
type SegmentTuple = (usize, usize, usize, Numbers, Numbers, Numbers);

/// Candidates of some coefficients on segments of trials: the criterion of an identification stage.
///
/// names: coefficients that vary, in the order of the candidates' columns; segments: (record index, first
/// sample, one past the last, position (3,), attitude (4,) or (3,), nu (6,)); free and measured: letters among
/// XYZKMN, the other axes are frozen; loss: absolute, squared or huber with its knee; substeps per sample.
#[pyclass(frozen, module = "seatrial")]
pub struct OpenLoop {
    description: Arc<Description>,
    records: Vec<record::Record>,
    segments: Vec<Segment>,
    modes: [Mode; 6],
    loss: Loss,
    substeps: usize,
    sought: Vec<usize>,
}

impl OpenLoop {
    fn batch(&self) -> Batch<'_> {
        Batch {
            description: &self.description,
            records: &self.records,
            segments: &self.segments,
            modes: self.modes,
            substeps: self.substeps,
        }
    }
}

#[pymethods]
impl OpenLoop {
    #[new]
    #[pyo3(signature = (vehicle, records, segments, *, names = Vec::new(), free = "XYZKMN", measured = "", loss = "absolute", knee = 1.0, substeps = 1))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn new(
        vehicle: PyRef<'_, Vehicle>,
        records: Vec<PyRef<'_, Record>>,
        segments: Vec<SegmentTuple>,
        names: Vec<String>,
        free: &str,
        measured: &str,
        loss: &str,
        knee: f64,
        substeps: usize,
    ) -> PyResult<Self> {
        let description = vehicle.description.clone();
        let modes = modes(free, measured).map_err(raised)?;
        let substeps = substeps.max(1);
        let replay = modes.contains(&Mode::Measured);
        let sought: Vec<usize> =
            names.iter().map(|n| description.layout.find(n).map_err(refused)).collect::<PyResult<_>>()?;
        let records = records
            .iter()
            .map(|r| {
                let mut record = r.inputs.record(&description, replay, substeps).map_err(raised)?;
                record.play(&description, &sought, substeps);
                Ok(record)
            })
            .collect::<PyResult<Vec<_>>>()?;
        let segments = segments
            .iter()
            .map(|(record, start, stop, position, attitude, nu)| {
                let len = records.get(*record).map_or(0, |r| r.len);
                if !(start + 1 < *stop && *stop <= len) {
                    return Err(refused(format!(
                        "segments: ({record}, {start}, {stop}) is outside of its record of {len} samples"
                    )));
                }
                let attitudes = attitude.attitudes("attitude")?;
                let state =
                    State { position: position.row("position")?, attitude: attitudes[0], nu: nu.row("nu")? };
                Ok(Segment {
                    record: *record,
                    start: *start,
                    stop: *stop,
                    state,
                    current: [0.0; 3],
                    motors: MotorStart::Recorded,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let loss = match loss {
            "absolute" => Loss::Absolute,
            "squared" => Loss::Squared,
            "huber" if knee > 0.0 => Loss::Huber(knee),
            _ => {
                return Err(refused(format!(
                    "loss: expected absolute, squared or huber with a positive knee, found {loss} {knee}"
                )));
            }
        };
        Ok(Self { description, records, segments, modes, loss, substeps, sought })
    }

    /// The same segments from other starts, each in a steady current of its own besides the recorded one: position
    /// (k, 3), attitude (k, 4) or (k, 3), nu (k, 6), and current (k, 3), NED, m/s.
    fn along(&self, position: Numbers, attitude: Numbers, nu: Numbers, current: Numbers) -> PyResult<Self> {
        let (positions, attitudes) = (position.rows("position")?, attitude.attitudes("attitude")?);
        let (velocities, currents) = (nu.rows("nu")?, current.rows("current")?);
        let found = [positions.len(), attitudes.len(), velocities.len(), currents.len()];
        let expected = self.segments.len();
        if found != [expected; 4] {
            return Err(refused(format!(
                "position, attitude, nu, current: expected {expected} rows each, found {found:?}"
            )));
        }
        if !currents.as_flattened().iter().all(|x| x.is_finite()) {
            return Err(refused("current: expected finite numbers, m/s"));
        }
        let mut segments = self.segments.clone();
        let states = positions.into_iter().zip(attitudes).zip(velocities).zip(currents);
        for (segment, (((position, attitude), nu), current)) in segments.iter_mut().zip(states) {
            segment.state = State { position, attitude, nu };
            segment.current = current;
        }
        let (description, records, sought) =
            (self.description.clone(), self.records.clone(), self.sought.clone());
        let Self { modes, loss, substeps, .. } = *self;
        Ok(Self { description, records, segments, modes, loss, substeps, sought })
    }

    /// Sums over the samples of loss(weight * error), shape (k, segments, 12); infinite where a candidate
    /// diverged.
    ///
    /// values (k, names); threads: all when missing.
    #[pyo3(signature = (values, threads = None))]
    fn errors(&self, py: Python<'_>, values: Numbers, threads: Option<Threads>) -> PyResult<Array> {
        let (count, values) = values.matrix("values", self.sought.len())?;
        if count == 0 {
            return Err(refused("values: expected one row per candidate, found none"));
        }
        let candidates = Candidates { sought: &self.sought, values: &values, count };
        let errors = parallel(py, threads, |stop| self.batch().errors(candidates, self.loss, stop))?;
        Ok(Array::new(&[count, self.segments.len(), CHANNELS], errors))
    }

    /// What the channels of every segment show, each (samples, 12), for one candidate (names,).
    ///
    /// nuisance (records, 38) in the order of nuisance_names and initial (segments, 12) in that of
    /// initial_names, both zero when missing.
    #[pyo3(signature = (values, nuisance = None, initial = None, threads = None))]
    fn predict(
        &self,
        py: Python<'_>,
        values: Numbers,
        nuisance: Option<Numbers>,
        initial: Option<Numbers>,
        threads: Option<Threads>,
    ) -> PyResult<Vec<Array>> {
        let place = self.place(values, None, nuisance, initial)?;
        let shown = parallel(py, threads, |stop| self.batch().predictions(place.point(self), stop))?;
        Ok(shown.iter().map(|rows| Array::rows(rows, false)).collect())
    }

    /// What every segment shows and its exact derivatives: per segment ((samples, 12), (samples, channels, m)).
    ///
    /// values (names,); directions (d, names): rows of changes of the coefficients, one per name when missing;
    /// nuisances and initials: names of further unknowns. The m columns are directions, nuisances, initials.
    /// channels: names of those to differentiate, all when missing. nuisance (records, 38) and initial
    /// (segments, 12): values, zero when missing. Derivatives by the variational equations, exact to rounding; where a
    /// function has a corner (|x| at 0, a latency or dead time of whole steps), that of one side or zero.
    #[pyo3(signature = (values, directions = None, *, nuisances = Vec::new(), initials = Vec::new(), channels = None, nuisance = None, initial = None, threads = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn sensitivities(
        &self,
        py: Python<'_>,
        values: Numbers,
        directions: Option<Numbers>,
        nuisances: Vec<String>,
        initials: Vec<String>,
        channels: Option<Vec<String>>,
        nuisance: Option<Numbers>,
        initial: Option<Numbers>,
        threads: Option<Threads>,
    ) -> PyResult<Vec<(Array, Array)>> {
        let asked = Asked { directions, nuisances, initials, channels, nuisance, initial };
        let (shown, channels, unknowns) = self.differentiated(py, values, asked, threads)?;
        Ok(shown
            .into_iter()
            .map(|segment| {
                let shape = [segment.rows.len(), channels, unknowns];
                (Array::rows(&segment.rows, false), Array::new(&shape, segment.jacobian))
            })
            .collect())
    }

    /// The same of all segments in a row: (samples of all, 12) and (samples of all, channels, m).
    #[pyo3(signature = (values, directions = None, *, nuisances = Vec::new(), initials = Vec::new(), channels = None, nuisance = None, initial = None, threads = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn tangents(
        &self,
        py: Python<'_>,
        values: Numbers,
        directions: Option<Numbers>,
        nuisances: Vec<String>,
        initials: Vec<String>,
        channels: Option<Vec<String>>,
        nuisance: Option<Numbers>,
        initial: Option<Numbers>,
        threads: Option<Threads>,
    ) -> PyResult<(Array, Array)> {
        let asked = Asked { directions, nuisances, initials, channels, nuisance, initial };
        let (shown, channels, unknowns) = self.differentiated(py, values, asked, threads)?;
        let samples: usize = shown.iter().map(|segment| segment.rows.len()).sum();
        let mut rows = Vec::with_capacity(samples);
        let mut jacobian = Vec::with_capacity(samples * channels * unknowns);
        for segment in shown {
            rows.extend(segment.rows);
            jacobian.extend(segment.jacobian);
        }
        Ok((Array::rows(&rows, false), Array::new(&[samples, channels, unknowns], jacobian)))
    }

    /// The criterion on what the channels show, (segments, 12), and its gradient, (segments, 12, m).
    ///
    /// Parameters as for sensitivities.
    #[pyo3(signature = (values, directions = None, *, nuisances = Vec::new(), initials = Vec::new(), nuisance = None, initial = None, threads = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn gradient(
        &self,
        py: Python<'_>,
        values: Numbers,
        directions: Option<Numbers>,
        nuisances: Vec<String>,
        initials: Vec<String>,
        nuisance: Option<Numbers>,
        initial: Option<Numbers>,
        threads: Option<Threads>,
    ) -> PyResult<(Array, Array)> {
        let place = self.place(values, directions, nuisance, initial)?;
        let unknowns = place.unknowns(self, &nuisances, &initials)?;
        let found = parallel(py, threads, |stop| {
            self.batch().gradient(place.point(self), &unknowns, self.loss, stop)
        })?;
        let sums: Vec<[f64; CHANNELS]> = found.iter().map(|segment| segment.sums).collect();
        let slopes = found.into_iter().flat_map(|segment| segment.slopes).collect();
        Ok((Array::rows(&sums, false), Array::new(&[self.segments.len(), CHANNELS, unknowns.len()], slopes)))
    }
}

/// What is to be differentiated, where and by what.
struct Asked {
    directions: Option<Numbers>,
    nuisances: Vec<String>,
    initials: Vec<String>,
    channels: Option<Vec<String>>,
    nuisance: Option<Numbers>,
    initial: Option<Numbers>,
}

impl OpenLoop {
    /// What every segment shows with its derivatives, how many channels and unknowns.
    fn differentiated(
        &self,
        py: Python<'_>,
        values: Numbers,
        asked: Asked,
        threads: Option<Threads>,
    ) -> PyResult<(Vec<Prediction>, usize, usize)> {
        let Asked { directions, nuisances, initials, channels, nuisance, initial } = asked;
        let place = self.place(values, directions, nuisance, initial)?;
        let unknowns = place.unknowns(self, &nuisances, &initials)?;
        let asked = channels.map_or(Ok((0..CHANNELS).collect()), |names| {
            names.iter().map(|n| named("channels", n, &CHANNEL_NAMES)).collect::<PyResult<Vec<_>>>()
        })?;
        let shown = parallel(py, threads, |stop| {
            self.batch().sensitivities(place.point(self), &unknowns, &asked, stop)
        })?;
        Ok((shown, asked.len(), unknowns.len()))
    }

    /// Values and directions as Python gives them, checked.
    fn place(
        &self,
        values: Numbers,
        directions: Option<Numbers>,
        nuisance: Option<Numbers>,
        initial: Option<Numbers>,
    ) -> PyResult<Place> {
        let width = self.sought.len();
        let values = values.vector("values")?;
        if values.len() != width {
            return Err(refused(format!("values: expected {width} numbers, found {}", values.len())));
        }
        let (rows, directions) = match directions {
            Some(directions) => directions.matrix("directions", width)?,
            None => {
                (width, (0..width * width).map(|at| f64::from(u8::from(at / width == at % width))).collect())
            }
        };
        let nuisance = table("nuisance", nuisance, self.records.len())?;
        let initial = table("initial", initial, self.segments.len())?;
        Ok(Place { values, directions, rows, nuisance, initial })
    }
}

/// Where derivatives are taken.
struct Place {
    values: Vec<f64>,
    directions: Vec<f64>,
    rows: usize,
    nuisance: Vec<[f64; NUISANCES]>,
    initial: Vec<[f64; INITIALS]>,
}

impl Place {
    fn point<'a>(&'a self, open_loop: &'a OpenLoop) -> Point<'a> {
        Point {
            sought: &open_loop.sought,
            values: &self.values,
            directions: &self.directions,
            nuisance: &self.nuisance,
            initial: &self.initial,
        }
    }

    /// Directions, nuisances, initials.
    fn unknowns(
        &self,
        open_loop: &OpenLoop,
        nuisances: &[String],
        initials: &[String],
    ) -> PyResult<Vec<Unknown>> {
        let known: Vec<String> = nuisance_names();
        let mut unknowns: Vec<Unknown> = (0..self.rows).map(Unknown::Direction).collect();
        if open_loop.sought.is_empty() {
            unknowns.clear();
        }
        for name in nuisances {
            unknowns.push(Unknown::Nuisance(named("nuisances", name, &known)?));
        }
        for name in initials {
            unknowns.push(Unknown::Initial(named("initials", name, &INITIAL_NAMES)?));
        }
        Ok(unknowns)
    }
}

/// The place of a name among the known ones.
fn named<N: AsRef<str>>(what: &str, name: &str, known: &[N]) -> PyResult<usize> {
    known.iter().position(|k| k.as_ref() == name).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(AsRef::as_ref).collect();
        let near = nearest(name, known.iter().copied());
        refused(format!("{what}: expected {}, found \"{name}\"{near}", known.join(", ")))
    })
}

/// Rows of numbers, zero when missing.
fn table<const C: usize>(name: &str, rows: Option<Numbers>, count: usize) -> PyResult<Vec<[f64; C]>> {
    let rows = rows.map_or(Ok(vec![[0.0; C]; count]), |rows| rows.rows(name))?;
    if rows.len() == count {
        return Ok(rows);
    }
    Err(refused(format!("{name}: expected {count} rows of {C}, found {}", rows.len())))
}

/// Names of the nuisance parameters of a trial, in the order of OpenLoop's rows.
#[pyfunction]
#[pyo3(name = "nuisance_names")]
pub fn all_nuisance_names() -> Vec<String> {
    nuisance_names()
}

/// Names of the initial conditions of a segment, in the order of OpenLoop's rows.
#[pyfunction]
pub fn initial_names() -> Vec<&'static str> {
    INITIAL_NAMES.to_vec()
}
