//! `State`, `Run`, and the simulation from one to the other.

use crate::convert::{Array, Named, Numbers, optional_rows};
use crate::error::{raised, refused};
use crate::pickle::{self, Parts, parts, restorer};
use crate::work::{Threads, brief, interruptible, parallel};
use pyo3::prelude::*;
use seatrial::description::{ActuatorDescription, Description};
use seatrial::fit::batch::{Batch, Candidates, Run as Track};
use seatrial::fit::inputs::{Inputs, actuator_index, modes};
use seatrial::fit::record::{MotorMemory, MotorStart, Record, Segment};
use seatrial::model::integrate;
use seatrial::model::vehicle::Mode;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Position, attitude, velocity and actuators of a vehicle at one instant.
///
/// position (3,) NED, m; attitude (4,) quaternion body to NED or (3,) roll, pitch, yaw, rad; nu (6,),
/// m/s and rad/s; actuators {name: value in the unit of its command}, neutral when missing. A Run's final_state also
/// holds what rate limit, lag and dead time of every motor remember, so that the next run goes on as if there were one.
#[pyclass(frozen, module = "seatrial")]
pub struct State {
    pub state: integrate::State<f64>,
    pub signals: BTreeMap<String, f64>,
    /// Per actuator its motor as an earlier run left it; empty for a state that was put together by hand.
    pub motors: BTreeMap<String, MotorMemory<f64>>,
}

#[pymethods]
impl State {
    #[new]
    #[pyo3(signature = (position = None, attitude = None, nu = None, actuators = None))]
    fn new(
        position: Option<Numbers>,
        attitude: Option<Numbers>,
        nu: Option<Numbers>,
        actuators: Option<Named>,
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
        Ok(Self { state, signals: Named::scalars(actuators)?, motors: BTreeMap::new() })
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

    /// Itself: nothing of it can change.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    /// Itself: nothing of it can change.
    #[expect(unused_variables, reason = "the name is Python's")]
    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, StateParts)> {
        let motors = self.motors.iter().map(|(name, motor)| (name.clone(), motor_parts(motor))).collect();
        let parts = (self.position(), self.attitude(), self.nu(), self.actuators(), motors);
        Ok((restorer(py, "_restored_state")?, parts))
    }
}

/// Ramp, signal, spacing and past of a motor.
type MotorParts = (f64, f64, f64, Vec<f64>);

/// Position, attitude, velocity, actuators, and what their motors remember.
type StateParts = (Array, Array, Array, BTreeMap<String, f64>, BTreeMap<String, MotorParts>);

/// The state of exactly these numbers: how a pickled one comes back. Its attitude is not scaled to length one again.
#[pyfunction]
#[pyo3(name = "_restored_state")]
pub fn restored_state(
    position: Numbers,
    attitude: Numbers,
    nu: Numbers,
    actuators: BTreeMap<String, f64>,
    motors: BTreeMap<String, MotorParts>,
) -> PyResult<State> {
    let state = integrate::State {
        position: position.row("position")?,
        attitude: attitude.row("attitude")?,
        nu: nu.row("nu")?,
    };
    let motors = motors.into_iter().map(|(name, parts)| (name, restored_motor(parts))).collect();
    Ok(State { state, signals: actuators, motors })
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
        self.array(|track, k| seatrial::model::kinematics::to_euler(&track.states[k].attitude))
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
            .map(|(i, a)| (a.name.clone(), self.array(|track, k| [a.command(track.signals[k][i])])))
            .collect()
    }

    /// The state at the last sample with all that the motors remember, `initial` of a run that goes on from there.
    ///
    /// Runs that follow one another so equal one run to rounding: lag, rate limit and dead time go on. The command at
    /// the last sample acts from there on: the next run begins with its own. Not of a batch.
    #[getter]
    fn final_state(&self) -> PyResult<State> {
        let [track] = &self.tracks[..] else {
            return Err(refused(format!(
                "final_state: expected a single run, found a batch of {}; simulate the candidate by itself",
                self.tracks.len()
            )));
        };
        let (Some(&state), Some(signals)) = (track.states.last(), track.signals.last()) else {
            return Err(refused("final_state: the run has no samples"));
        };
        let names = || self.description.actuators.iter().map(|a| a.name.clone());
        let commands = self.description.actuators.iter().zip(signals).map(|(a, &signal)| a.command(signal));
        Ok(State {
            state,
            signals: names().zip(commands).collect(),
            motors: names().zip(track.motors.iter().cloned()).collect(),
        })
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, RunParts)> {
        let rows = |read: &dyn Fn(&Track, usize) -> Vec<f64>| {
            let (k, n) = (self.tracks.len(), self.tracks[0].states.len());
            let values: Vec<f64> =
                self.tracks.iter().flat_map(|track| (0..n).flat_map(|i| read(track, i))).collect();
            Array::new(&[k, n, values.len() / (k * n).max(1)], values)
        };
        let state = |track: &Track, i: usize| {
            let integrate::State { position, attitude, nu } = track.states[i];
            [&position[..], &attitude, &nu].concat()
        };
        let parts = (
            parts(&self.description),
            (self.dt, self.start, self.batch),
            (
                rows(&state),
                rows(&|track, i| track.signals[i].clone()),
                rows(&|track, i| track.tau[i].to_vec()),
            ),
            self.tracks.iter().map(|track| track.motors.iter().map(motor_parts).collect()).collect(),
        );
        Ok((restorer(py, "_restored_run")?, parts))
    }
}

/// Vehicle; time step, start and whether there are candidates; states, signals and wrenches, each (candidates, n, …);
/// per candidate the motors at the end.
type RunParts = (Parts, (f64, f64, bool), (Array, Array, Array), Vec<Vec<MotorParts>>);

/// The run of exactly these numbers: how a pickled one comes back.
#[pyfunction]
#[pyo3(name = "_restored_run")]
pub fn restored_run(
    vehicle: (String, Numbers),
    timing: (f64, f64, bool),
    tracks: (Numbers, Numbers, Numbers),
    motors: Vec<Vec<MotorParts>>,
) -> PyResult<Run> {
    let description = pickle::description(&vehicle.0, vehicle.1)?;
    let count = description.actuators.len();
    let (states, signals, tau) = tracks;
    let (candidates, n, states) = states.cube("states", 13)?;
    let (_, _, signals) = signals.cube("signals", count)?;
    let (_, _, tau) = tau.cube("tau", 6)?;
    let part = |row: &[f64], from: usize| -> [f64; 3] { std::array::from_fn(|i| row[from + i]) };
    let state = |row: &[f64]| integrate::State {
        position: part(row, 0),
        attitude: std::array::from_fn(|i| row[3 + i]),
        nu: std::array::from_fn(|i| row[7 + i]),
    };
    let motors = motors.into_iter().map(|m| m.into_iter().map(restored_motor).collect::<Vec<_>>());
    let mut motors = motors.chain(std::iter::repeat(Vec::new()));
    let tracks: Vec<Track> = (0..candidates)
        .map(|k| {
            let samples = || k * n..(k + 1) * n;
            Track {
                states: samples().map(|i| state(&states[13 * i..13 * (i + 1)])).collect(),
                signals: samples().map(|i| signals[count * i..count * (i + 1)].to_vec()).collect(),
                tau: samples().map(|i| std::array::from_fn(|c| tau[6 * i + c])).collect(),
                motors: motors.next().unwrap_or_default(),
                unsound: None,
            }
        })
        .collect();
    let (dt, start, batch) = timing;
    Ok(Run { description: Arc::new(description), dt, start, tracks, batch })
}

fn motor_parts(motor: &MotorMemory<f64>) -> MotorParts {
    (motor.ramp, motor.signal, motor.spacing, motor.past.clone())
}

fn restored_motor((ramp, signal, spacing, past): MotorParts) -> MotorMemory<f64> {
    MotorMemory { ramp, signal, spacing, past }
}

/// Where the motors are in a state: as an earlier run left them, else held at their signals.
fn motors(description: &Description, initial: Option<&State>) -> PyResult<MotorStart> {
    let mut signals = vec![0.0; description.actuators.len()];
    for (name, value) in initial.iter().flat_map(|s| &s.signals) {
        let k = actuator_index(description, name).map_err(raised)?;
        signals[k] = description.actuators[k].signal(*value);
    }
    let Some(carried) = initial.map(|s| &s.motors).filter(|motors| !motors.is_empty()) else {
        return Ok(MotorStart::Held(signals));
    };
    let motor = |(k, actuator): (usize, &ActuatorDescription)| {
        let stopped = MotorMemory { ramp: signals[k], signal: signals[k], spacing: 1.0, past: Vec::new() };
        carried.get(&actuator.name).cloned().unwrap_or(stopped)
    };
    Ok(MotorStart::Carried(description.actuators.iter().enumerate().map(motor).collect()))
}

/// The most steps between two samples: at three million steps a second some minutes.
const MOST_SUBSTEPS: f64 = 1e9;

/// A run of so few steps is over before a thread that could be stopped had begun: a vehicle that is stepped.
const BRIEF_STEPS: usize = 200;

/// A simulation, checked: one record, one segment.
pub struct Simulation {
    description: Arc<Description>,
    record: Record,
    segment: Segment,
    modes: [Mode; 6],
    substeps: usize,
    start: f64,
}

impl Simulation {
    pub fn new(
        description: &Arc<Description>,
        inputs: &Inputs,
        initial: Option<&State>,
        free: &str,
        max_step_s: f64,
    ) -> PyResult<Self> {
        let record = inputs.record(description, false, 1).map_err(raised)?;
        if max_step_s.is_nan() || max_step_s <= 0.0 {
            return Err(refused(format!("max_step_s: expected a positive time in s, found {max_step_s}")));
        }
        let substeps = (record.dt / max_step_s - 1e-9).ceil().max(1.0);
        if substeps > MOST_SUBSTEPS {
            return Err(refused(format!(
                "t: expected samples at most {:.3e} s apart at max_step_s = {max_step_s}, found {:.3e}; add samples",
                MOST_SUBSTEPS * max_step_s,
                record.dt
            )));
        }
        let rest = integrate::State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] };
        let state = initial.map_or(rest, |s| s.state);
        Ok(Self {
            description: description.clone(),
            segment: Segment::whole(0, record.len, state, motors(description, initial)?),
            substeps: substeps as usize,
            record,
            modes: modes(free, "").map_err(raised)?,
            start: inputs.t[0],
        })
    }

    /// The vehicle itself, or candidates with a leading dimension.
    pub fn run(
        &self,
        py: Python<'_>,
        candidates: Option<Candidates<'_>>,
        threads: Option<Threads>,
    ) -> PyResult<Run> {
        let batch = Batch {
            description: &self.description,
            records: std::slice::from_ref(&self.record),
            segments: std::slice::from_ref(&self.segment),
            modes: self.modes,
            substeps: self.substeps,
        };
        let tracks = match candidates {
            None if self.record.len * self.substeps <= BRIEF_STEPS => {
                vec![brief(py, |stop| batch.sound_track(0, stop))?]
            }
            None => vec![interruptible(py, |stop| batch.sound_track(0, stop))?],
            Some(candidates) => parallel(py, threads, |stop| batch.tracks(candidates, stop))?,
        };
        let (description, dt, start) = (self.description.clone(), self.record.dt, self.start);
        Ok(Run { description, dt, start, tracks, batch: candidates.is_some() })
    }
}

/// The inputs of a simulation as Python gives them.
pub fn inputs(
    t: Numbers,
    commands: Option<Named>,
    current: Option<Numbers>,
    tau: Option<Numbers>,
    voltage_v: Option<Numbers>,
    (rho, g, surface): (Option<f64>, Option<f64>, Option<f64>),
) -> PyResult<Inputs> {
    let t = t.vector("t")?;
    let n = t.len();
    Ok(Inputs {
        t,
        commands: Named::held(commands, n)?,
        current: optional_rows("current", current)?,
        tau: optional_rows("tau", tau)?,
        voltage: voltage_v.map_or(Ok(Vec::new()), |v| v.held("voltage_v", n))?,
        rho,
        g,
        surface,
        ..Inputs::default()
    })
}
