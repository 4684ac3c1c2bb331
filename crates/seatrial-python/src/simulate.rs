//! `State`, `Run`, `Vehicle.simulate` and `simulate_batch`.

use crate::convert::{Array, Numbers};
use crate::error::{interruptible, raised, refused};
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::description::Description;
use seatrial::integrate;
use seatrial::open_loop::batch::{Batch, Candidates, Run as Track};
use seatrial::open_loop::{Record, Segment};
use seatrial::vehicle::Mode;
use seatrial::vehicle_file::Environment;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Position, attitude, velocity and actuators of a vehicle at one instant.
///
/// position (3,) NED, m; attitude (4,) quaternion body to NED or (3,) roll, pitch, yaw, rad; nu (6,),
/// m/s and rad/s; actuators {name: value in the unit of its command}, neutral when missing.
#[pyclass(frozen, module = "seatrial")]
pub struct State {
    pub state: integrate::State<f64>,
    pub signals: BTreeMap<String, f64>,
}

#[pymethods]
impl State {
    #[new]
    #[pyo3(signature = (position = None, attitude = None, nu = None, actuators = None))]
    fn new(
        position: Option<Numbers>,
        attitude: Option<Numbers>,
        nu: Option<Numbers>,
        actuators: Option<BTreeMap<String, f64>>,
    ) -> PyResult<Self> {
        let attitude = attitude.map_or(Ok(vec![[1.0, 0.0, 0.0, 0.0]]), |a| a.attitudes("attitude"))?;
        let state = integrate::State {
            position: position.map_or(Ok([0.0; 3]), |x| x.row("position"))?,
            attitude: attitude[0],
            nu: nu.map_or(Ok([0.0; 6]), |x| x.row("nu"))?,
        };
        if attitude.len() != 1 || !state.nu.iter().chain(&state.position).all(|x| x.is_finite()) {
            return Err(refused("State: expected one finite position, attitude and nu"));
        }
        Ok(Self { state, signals: actuators.unwrap_or_default() })
    }

    /// Position of O, north, east, down, shape (3,), m.
    #[getter]
    fn position(&self) -> Array {
        Array::rows(&[self.state.position], true)
    }

    /// Unit quaternion [w x y z], body to NED, shape (4,).
    #[getter]
    fn attitude(&self) -> Array {
        Array::rows(&[self.state.attitude], true)
    }

    /// [u v w p q r], shape (6,), m/s and rad/s.
    #[getter]
    fn nu(&self) -> Array {
        Array::rows(&[self.state.nu], true)
    }

    /// Actuators in the units of their commands.
    #[getter]
    fn actuators(&self) -> BTreeMap<String, f64> {
        self.signals.clone()
    }
}

/// A simulated run; of a batch, every array has a leading dimension of candidates.
#[pyclass(frozen, module = "seatrial")]
pub struct Run {
    description: Arc<Description>,
    dt: f64,
    start: f64,
    tracks: Vec<Track>,
    batch: bool,
}

impl Run {
    fn array<const C: usize>(&self, read: impl Fn(&Track, usize) -> [f64; C]) -> Array {
        let n = self.tracks[0].states.len();
        let values =
            self.tracks.iter().flat_map(|t| (0..n).flat_map(|k| read(t, k)).collect::<Vec<_>>()).collect();
        let shape = [self.tracks.len(), n, C];
        Array::new(&shape[usize::from(!self.batch)..if C == 1 { 2 } else { 3 }], values)
    }
}

#[pymethods]
impl Run {
    /// Time, shape (n,), s.
    #[getter]
    fn t(&self) -> Array {
        let n = self.tracks[0].states.len();
        Array::new(&[n], (0..n).map(|k| self.start + self.dt * k as f64).collect())
    }

    /// Position of O, north, east, down, shape (n, 3), m.
    #[getter]
    fn position(&self) -> Array {
        self.array(|track, k| track.states[k].position)
    }

    /// Unit quaternions [w x y z], body to NED, shape (n, 4).
    #[getter]
    fn attitude(&self) -> Array {
        self.array(|track, k| track.states[k].attitude)
    }

    /// Roll, pitch and yaw, shape (n, 3), rad.
    #[getter]
    fn euler(&self) -> Array {
        self.array(|track, k| seatrial::kinematics::to_euler(&track.states[k].attitude))
    }

    /// [u v w p q r], shape (n, 6), m/s and rad/s.
    #[getter]
    fn nu(&self) -> Array {
        self.array(|track, k| track.states[k].nu)
    }

    /// Wrench of actuators and tau together about O, shape (n, 6), N and N m.
    #[getter]
    fn tau(&self) -> Array {
        self.array(|track, k| track.tau[k])
    }

    /// Per actuator its revolutions, pulse width or newtons behind the motor, shape (n,).
    #[getter]
    fn actuators(&self) -> BTreeMap<String, Array> {
        let described = self.description.actuators.iter().enumerate();
        described
            .map(|(i, a)| (a.thruster.name.clone(), self.array(|track, k| [a.command(track.signals[k][i])])))
            .collect()
    }
}

/// The inputs of a simulation, checked.
pub struct Simulation {
    description: Arc<Description>,
    record: Record,
    segment: Segment,
    modes: [Mode; 6],
    substeps: usize,
    start: f64,
}

impl Simulation {
    #[expect(clippy::too_many_arguments, reason = "the arguments of two public calls, checked in one place")]
    pub fn new(
        description: &Arc<Description>,
        t: Numbers,
        commands: Option<BTreeMap<String, Numbers>>,
        initial: Option<&State>,
        (current, tau, voltage): (Option<Numbers>, Option<Numbers>, Option<Numbers>),
        free: &str,
        max_step: f64,
        (rho, g): (Option<f64>, Option<f64>),
    ) -> PyResult<Self> {
        let t = t.vector("t")?;
        let dt = uniform_step(&t)?;
        let (commands, voltage) = inputs(description, t.len(), commands.unwrap_or_default(), voltage)?;
        let reference = description.file.environment;
        let record = Record {
            dt,
            len: t.len(),
            commands,
            signals: vec![None; description.actuators.len()],
            voltage,
            tau: per_sample("tau", tau, t.len())?,
            current: per_sample("current", current, t.len())?,
            environment: Environment {
                rho_kg_m3: rho.unwrap_or(reference.rho_kg_m3),
                g_m_s2: g.unwrap_or(reference.g_m_s2),
            },
            ..Record::default()
        };
        if !(max_step > 0.0) {
            return Err(refused(format!("max_step: expected a positive time in s, found {max_step}")));
        }
        let state = initial.map_or(
            integrate::State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] },
            |s| s.state,
        );
        let mut signals = vec![0.0; description.actuators.len()];
        for (name, value) in initial.iter().flat_map(|s| &s.signals) {
            let k = actuator_index(description, name)?;
            signals[k] = description.actuators[k].signal(*value);
        }
        Ok(Self {
            description: description.clone(),
            segment: Segment::whole(0, record.len, state, signals),
            record,
            modes: modes(free, "")?,
            substeps: (dt / max_step - 1e-9).ceil().max(1.0) as usize,
            start: t[0],
        })
    }

    fn batch(&self) -> Batch<'_> {
        Batch {
            description: &self.description,
            records: std::slice::from_ref(&self.record),
            segments: std::slice::from_ref(&self.segment),
            modes: self.modes,
            substeps: self.substeps,
        }
    }

    fn wrap(&self, tracks: Vec<Track>, batch: bool) -> Run {
        Run { description: self.description.clone(), dt: self.record.dt, start: self.start, tracks, batch }
    }

    pub fn run(&self, py: Python<'_>) -> PyResult<Run> {
        let track = interruptible(py, None, |stop| self.batch().track(0, stop))?;
        Ok(self.wrap(vec![track], false))
    }
}

/// The runs of k candidates, coefficients {name: (k,)}, under the same commands; see Vehicle.simulate.
///
/// Every array of the Run has a leading dimension k. Candidates fly side by side in vector lanes and on
/// `threads` threads (all when missing).
#[pyfunction]
#[pyo3(signature = (vehicle, coefficients, t, commands = None, initial = None, current = None, free = "XYZKMN", tau = None, *, voltage = None, max_step = 0.02, rho = None, g = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
pub fn simulate_batch(
    py: Python<'_>,
    vehicle: PyRef<'_, Vehicle>,
    coefficients: BTreeMap<String, Numbers>,
    t: Numbers,
    commands: Option<BTreeMap<String, Numbers>>,
    initial: Option<PyRef<'_, State>>,
    current: Option<Numbers>,
    free: &str,
    tau: Option<Numbers>,
    voltage: Option<Numbers>,
    max_step: f64,
    rho: Option<f64>,
    g: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Run> {
    let description = &vehicle.description;
    let simulation = Simulation::new(
        description,
        t,
        commands,
        initial.as_deref(),
        (current, tau, voltage),
        free,
        max_step,
        (rho, g),
    )?;
    let mut sought = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for (name, values) in coefficients {
        sought.push(description.layout.find(&name).map_err(refused)?);
        let values = values.vector(&name)?;
        if columns.first().is_some_and(|c| c.len() != values.len()) || values.is_empty() {
            return Err(refused(format!(
                "coefficients: expected arrays of one length, found {} for {name}",
                values.len()
            )));
        }
        columns.push(values);
    }
    let count = columns.first().map_or(1, Vec::len);
    let values: Vec<f64> = (0..count).flat_map(|k| columns.iter().map(move |c| c[k])).collect();
    let candidates = Candidates { sought: &sought, values: &values, count };
    let tracks = interruptible(py, threads, |stop| simulation.batch().tracks(candidates, stop))?;
    Ok(simulation.wrap(tracks, true))
}

/// The step of a uniform time base, s.
pub fn uniform_step(t: &[f64]) -> PyResult<f64> {
    if t.len() < 2 {
        return Err(refused(format!("t: expected two samples or more, found {}", t.len())));
    }
    let dt = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64;
    let odd = t.windows(2).position(|w| !((w[1] - w[0] - dt).abs() <= 1e-6 * dt.abs() + 1e-9 * w[1].abs()));
    match odd {
        _ if !(dt > 0.0) => Err(refused("t: expected increasing times in s")),
        None => Ok(dt),
        Some(k) => Err(refused(format!(
            "t: expected equal steps of {dt:.6} s, found {:.6} s after row {k}; resample to a uniform base",
            t[k + 1] - t[k]
        ))),
    }
}

/// Limited signals per actuator and the voltage, checked; missing actuators stay at neutral.
pub fn inputs(
    description: &Description,
    n: usize,
    commands: BTreeMap<String, Numbers>,
    voltage: Option<Numbers>,
) -> PyResult<(Vec<Vec<f64>>, Vec<f64>)> {
    let mut signals = vec![vec![0.0; n]; description.actuators.len()];
    let voltage = voltage.map_or(Ok(Vec::new()), |v| v.series("voltage", n))?;
    for (name, values) in commands {
        let k = actuator_index(description, &name)?;
        let values = values.series(&format!("commands[\"{name}\"]"), n)?;
        if let Some(row) = values.iter().position(|x| !x.is_finite()) {
            return Err(refused(format!(
                "commands[\"{name}\"]: expected finite numbers, found {} in row {row}",
                values[row]
            )));
        }
        signals[k] = Record::signals_of(description, k, &values);
        if voltage.is_empty() && description.actuators[k].table.as_ref().is_some_and(|t| t.needs_voltage()) {
            return Err(refused(format!(
                "voltage: the thrust of {name} depends on the supply voltage, give it in V, shape ({n},)"
            )));
        }
    }
    Ok((signals, voltage))
}

/// Rows per sample: none, one for all, or n.
fn per_sample<const C: usize>(name: &str, rows: Option<Numbers>, n: usize) -> PyResult<Vec<[f64; C]>> {
    let Some(rows) = rows else {
        return Ok(Vec::new());
    };
    let mut rows = rows.rows::<C>(name)?;
    if name == "tau" && rows.len() == 1 {
        rows = vec![rows[0]; n];
    }
    if (rows.len() != n && rows.len() != 1) || rows.iter().flatten().any(|x| !x.is_finite()) {
        return Err(refused(format!(
            "{name}: expected {n} rows of finite numbers or one, found {} rows",
            rows.len()
        )));
    }
    Ok(rows)
}

/// The index of an actuator.
pub fn actuator_index(description: &Description, name: &str) -> PyResult<usize> {
    let names = || description.actuators.iter().map(|a| a.thruster.name.as_str());
    names().position(|n| n == name).ok_or_else(|| {
        let known: Vec<&str> = names().collect();
        refused(format!(
            "unknown actuator \"{name}\"; {} has {}{}",
            description.file.name,
            known.join(", "),
            seatrial::error::nearest(name, known.iter().copied())
        ))
    })
}

/// The modes of the axes from the letters of the free and the measured ones; the others are frozen.
pub fn modes(free: &str, measured: &str) -> PyResult<[Mode; 6]> {
    let mut modes = [Mode::Frozen; 6];
    for (letters, mode) in [(free, Mode::Free), (measured, Mode::Measured)] {
        for letter in letters.chars() {
            match "XYZKMN".find(letter) {
                Some(i) if modes[i] == Mode::Frozen => modes[i] = mode,
                Some(_) => return Err(refused(format!("axes: {letter} is named twice"))),
                None => {
                    return Err(refused(format!("axes: expected letters among XYZKMN, found \"{letters}\"")));
                }
            }
        }
    }
    Ok(modes)
}

/// The instruction set of the batches: avx512, avx2, sse4.2, neon or fallback.
#[pyfunction]
pub fn simd_level() -> PyResult<&'static str> {
    seatrial::real::lanes::level().map(|(name, _)| name).map_err(raised)
}
