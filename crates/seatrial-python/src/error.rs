//! Errors of the core as the exceptions of `seatrial.base.errors`, and long work that heeds Ctrl-C.

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use seatrial::Error;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

pyo3::import_exception!(seatrial.base.errors, SimulationError);
pyo3::import_exception!(seatrial.base.errors, VehicleError);

/// How often long work looks for signals.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// The exception of an error.
pub fn raised(error: Error) -> PyErr {
    match &error {
        Error::Vehicle { .. } => VehicleError::new_err(error.to_string()),
        Error::Simulation(message) => SimulationError::new_err(message.clone()),
        Error::Interrupted => PyKeyboardInterrupt::new_err(()),
    }
}

/// A `SimulationError`.
pub fn refused(message: impl Into<String>) -> PyErr {
    SimulationError::new_err(message.into())
}

/// Runs `work` without the interpreter lock on `threads` threads (all when missing); stops it at a
/// signal.
pub fn interruptible<R: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce(&AtomicBool) -> Result<R, Error> + Send,
) -> PyResult<R> {
    let stop = AtomicBool::new(false);
    py.detach(|| {
        let (sender, receiver) = mpsc::channel();
        std::thread::scope(|scope| {
            let stop = &stop;
            scope.spawn(move || {
                let pool = threads.map(|n| rayon::ThreadPoolBuilder::new().num_threads(n.max(1)).build());
                let result = match pool {
                    None => work(stop),
                    Some(Ok(pool)) => pool.install(|| work(stop)),
                    Some(Err(error)) => Err(Error::simulation(format!("threads: {error}"))),
                };
                // The receiver outlives this thread.
                let _ = sender.send(result);
            });
            let mut signal = Ok(());
            loop {
                match receiver.recv_timeout(SIGNAL_INTERVAL) {
                    Ok(result) => return signal.and_then(|()| result.map_err(raised)),
                    Err(mpsc::RecvTimeoutError::Timeout) if signal.is_ok() => {
                        signal = Python::attach(|py| py.check_signals());
                        stop.store(signal.is_err(), Ordering::Relaxed);
                    }
                    Err(mpsc::RecvTimeoutError::Timeout) => {}
                    Err(mpsc::RecvTimeoutError::Disconnected) => {
                        return Err(refused("the run ended without a result"));
                    }
                }
            }
        })
    })
}
