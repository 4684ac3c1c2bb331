//! `Record` and `OpenLoop`: trials as the core reads them, and the criterion over candidates.

use crate::convert::{Array, Named, Numbers, optional_rows};
use crate::error::{interruptible, raised, refused};
use crate::simulate::inputs;
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::criterion::{CHANNELS, Loss, channels};
use seatrial::description::Description;
use seatrial::integrate::State;
use seatrial::open_loop::batch::{Batch, Candidates};
use seatrial::open_loop::inputs::{Inputs, modes};
use seatrial::open_loop::{self, MotorStart, Segment};
use seatrial::vehicle::Mode;
use std::sync::Arc;

/// One trial: inputs on a uniform time base, and measured channels with weights.
///
/// t (n,), s; commands {actuator: (n,)} in its own unit; voltage (n,), V; tau (n, 6), N and N m; current (n, 3),
/// NED, m/s; actuators {name: (n,)} measured signals that replace the motor; nu and nu_rate on the half-step
/// grid, (2 substeps (n - 1) + 1, 6), for measured axes; observed and weight (n, 12), SI, in the order u v w p q
/// r x y z roll pitch yaw, weight 0 = masked; rho, kg/m3; g, m/s2.
#[pyclass(frozen, module = "seatrial")]
pub struct Record {
    inputs: Inputs,
}

#[pymethods]
impl Record {
    #[new]
    #[pyo3(signature = (t, commands = None, *, voltage = None, tau = None, current = None, actuators = None, nu = None, nu_rate = None, observed = None, weight = None, rho = None, g = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn new(
        t: Numbers,
        commands: Option<Named>,
        voltage: Option<Numbers>,
        tau: Option<Numbers>,
        current: Option<Numbers>,
        actuators: Option<Named>,
        nu: Option<Numbers>,
        nu_rate: Option<Numbers>,
        observed: Option<Numbers>,
        weight: Option<Numbers>,
        rho: Option<f64>,
        g: Option<f64>,
    ) -> PyResult<Self> {
        let inputs = Inputs {
            actuators: Named::vectors(actuators)?,
            nu: optional_rows("nu", nu)?,
            nu_rate: optional_rows("nu_rate", nu_rate)?,
            observed: optional_rows("observed", observed)?,
            weight: optional_rows("weight", weight)?,
            ..inputs(t, commands, current, tau, voltage, rho, g)?
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
    records: Vec<open_loop::Record>,
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
        let records = records
            .iter()
            .map(|r| r.inputs.record(&description, replay, substeps).map_err(raised))
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
        let sought =
            names.iter().map(|n| description.layout.find(n).map_err(refused)).collect::<PyResult<_>>()?;
        Ok(Self { description, records, segments, modes, loss, substeps, sought })
    }

    /// Sums over the samples of loss(weight * error), shape (k, segments, 12); infinite where a candidate
    /// diverged.
    ///
    /// values (k, names); initial_nu (k, 6) is added to the initial velocity of every segment; threads: all
    /// when missing.
    #[pyo3(signature = (values, initial_nu = None, threads = None))]
    fn errors(
        &self,
        py: Python<'_>,
        values: Numbers,
        initial_nu: Option<Numbers>,
        threads: Option<usize>,
    ) -> PyResult<Array> {
        let (count, values) = values.matrix("values", self.sought.len())?;
        let offsets = initial_nu.map(|x| x.rows::<6>("initial_nu")).transpose()?;
        if count == 0 || offsets.as_ref().is_some_and(|o| o.len() != count) {
            return Err(refused("values and initial_nu: expected one row per candidate"));
        }
        let candidates = Candidates { sought: &self.sought, values: &values, count };
        let errors = interruptible(py, threads, |stop| {
            self.batch().errors(candidates, offsets.as_deref(), self.loss, stop)
        })?;
        Ok(Array::new(&[count, self.segments.len(), CHANNELS], errors))
    }

    /// The simulated channels of every segment, each (samples, 12), for one candidate (names,).
    fn predict(&self, py: Python<'_>, values: Numbers) -> PyResult<Vec<Array>> {
        let values = values.vector("values")?;
        if values.len() != self.sought.len() {
            return Err(refused(format!(
                "values: expected {} numbers, found {}",
                self.sought.len(),
                values.len()
            )));
        }
        let candidates = Candidates { sought: &self.sought, values: &values, count: 1 };
        let tracks = interruptible(py, None, |stop| self.batch().tracks(candidates, stop))?;
        Ok(tracks
            .iter()
            .map(|track| Array::rows(&track.states.iter().map(channels).collect::<Vec<_>>(), false))
            .collect())
    }
}
