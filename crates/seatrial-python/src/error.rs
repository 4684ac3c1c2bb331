//! Errors of the core as the exceptions of `seatrial.base.errors`.

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use seatrial::Error;

pyo3::import_exception!(seatrial.base.errors, DivergenceError);
pyo3::import_exception!(seatrial.base.errors, SimulationError);
pyo3::import_exception!(seatrial.base.errors, VehicleError);

/// The exception of an error.
pub fn raised(error: Error) -> PyErr {
    match &error {
        Error::Vehicle { .. } => VehicleError::new_err(error.to_string()),
        Error::Simulation(message) => SimulationError::new_err(message.clone()),
        Error::Diverged(message) => DivergenceError::new_err(message.clone()),
        Error::Interrupted => PyKeyboardInterrupt::new_err(()),
    }
}

/// A `SimulationError`.
pub fn refused(message: impl Into<String>) -> PyErr {
    SimulationError::new_err(message.into())
}
