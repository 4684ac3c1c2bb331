//! `simulate_batch`: candidates of a vehicle under the same commands.

use crate::convert::{Named, Numbers};
use crate::error::{raised, refused};
use crate::run::{Run, Simulation, State, inputs};
use crate::vehicle::Vehicle;
use crate::work::Threads;
use pyo3::prelude::*;
use seatrial::fit::batch::Candidates;

/// The runs of k candidates, coefficients {name: (k,)}, under the same commands; see Vehicle.simulate.
///
/// Every array of the Run has a leading dimension k. The run of a candidate that diverges is no number from there on.
/// Candidates fly side by side in vector lanes and on
/// `threads` threads (all when missing).
#[pyfunction]
#[pyo3(signature = (vehicle, coefficients, t, commands = None, initial = None, current = None, free = "XYZKMN", tau = None, *, voltage_v = None, max_step_s = 0.02, rho = None, g = None, surface = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
pub fn simulate_batch(
    py: Python<'_>,
    vehicle: PyRef<'_, Vehicle>,
    coefficients: Named,
    t: Numbers,
    commands: Option<Named>,
    initial: Option<PyRef<'_, State>>,
    current: Option<Numbers>,
    free: &str,
    tau: Option<Numbers>,
    voltage_v: Option<Numbers>,
    max_step_s: f64,
    rho: Option<f64>,
    g: Option<f64>,
    surface: Option<f64>,
    threads: Option<Threads>,
) -> PyResult<Run> {
    let description = &vehicle.description;
    let inputs = inputs(t, commands, current, tau, voltage_v, (rho, g, surface))?;
    let simulation = Simulation::new(description, &inputs, initial.as_deref(), free, max_step_s)?;
    let mut sought = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for (name, values) in Named::vectors(Some(coefficients))? {
        let index = description.layout.find(&name).map_err(refused)?;
        sought.push(index);
        if columns.first().is_some_and(|c| c.len() != values.len()) || values.is_empty() {
            return Err(refused(format!(
                "coefficients: expected arrays of one length, found {} for {name}",
                values.len()
            )));
        }
        // The run of a value that no vehicle has is no number, as that of an impossible mass matrix.
        let possible = |x: f64| if description.complaint(index, x).is_some() { f64::NAN } else { x };
        columns.push(values.into_iter().map(possible).collect());
    }
    let count = columns.first().map_or(1, Vec::len);
    let values: Vec<f64> = (0..count).flat_map(|k| columns.iter().map(move |c| c[k])).collect();
    let candidates = Candidates { sought: &sought, values: &values, count };
    simulation.run(py, Some(candidates), threads)
}

/// The instruction set of the batches: avx512, avx2, sse4.2, neon or fallback.
#[pyfunction]
pub fn simd_level() -> PyResult<&'static str> {
    seatrial::number::lanes::level().map(|(name, _)| name).map_err(raised)
}
