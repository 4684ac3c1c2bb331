//! Long work: without the interpreter lock, on a number of threads, and ended by Ctrl-C.
//!
//! Threads do not survive a fork, and a pool that waits for the parent's would wait for ever: the pool belongs to one
//! process, and a child makes its own when it first needs one.
//!
//! Tests: `tests/core/test_processes.py`.

use crate::error::{raised, refused};
use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::types::PyBool;
use rayon::{ThreadPool, ThreadPoolBuilder};
use seatrial::Error;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{RwLock, mpsc};
use std::time::Duration;

/// How often long work looks for signals.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// The most threads that can be asked for.
const MOST_THREADS: usize = 1024;

/// Sets the number of threads where no call names one.
const THREADS_VARIABLE: &str = "RAYON_NUM_THREADS";

/// A number of threads as a caller gives it.
#[derive(Clone, Copy)]
pub struct Threads(usize);

impl<'a, 'py> FromPyObject<'a, 'py> for Threads {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = <usize as FromPyObject>::INPUT_TYPE;
    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        // True and False are whole numbers to Python, and no number of threads.
        let whole = if object.is_instance_of::<PyBool>() { None } else { object.extract().ok() };
        match whole {
            Some(n) if (1..=MOST_THREADS).contains(&n) => Ok(Self(n)),
            _ => {
                let found = object.repr().map_or_else(|_| "something else".into(), |text| text.to_string());
                Err(refused(format!("threads: {}, or None for all processors, found {found}", expected())))
            }
        }
    }
}

fn expected() -> String {
    format!("expected a whole number from 1 to {MOST_THREADS}")
}

/// Refuse a number of threads that is none: expected from 1 to 1024, or None for all processors.
#[pyfunction]
#[pyo3(signature = (threads))]
pub fn checked_threads(threads: Option<Threads>) -> PyResult<()> {
    if threads.is_some() { Ok(()) } else { check_variable() }
}

/// Refuses what the environment asks for, where it is no number of threads.
fn check_variable() -> PyResult<()> {
    let text = std::env::var(THREADS_VARIABLE).unwrap_or_default();
    let text = text.trim();
    if text.is_empty() || text.parse().is_ok_and(|n| (1..=MOST_THREADS).contains(&n)) {
        return Ok(());
    }
    let expected = expected();
    Err(refused(format!(
        "environment variable {THREADS_VARIABLE}: {expected}, found {text:?}; correct or unset it"
    )))
}

/// A pool of threads and the process that they run in.
struct Own {
    process: u32,
    pool: ThreadPool,
}

/// The pool of this process for all processors; in a forked child its parent's, until the first long work there.
///
/// A parent's is never freed in a child: it would wait for threads that are not there. Nobody waits for the lock
/// either, which a fork may have left shut.
static POOL: RwLock<Option<&'static Own>> = RwLock::new(None);

/// Runs parallel work in a pool of this process.
fn in_pool<R: Send>(
    threads: Option<Threads>,
    work: impl FnOnce() -> Result<R, Error> + Send,
) -> Result<R, Error> {
    if let Some(Threads(count)) = threads {
        return built(count)?.install(work);
    }
    let process = std::process::id();
    let of_this_process = |own: &&'static Own| own.process == process;
    if let Some(own) = POOL.try_read().ok().and_then(|kept| *kept).filter(of_this_process) {
        return own.pool.install(work);
    }
    let own: &'static Own = Box::leak(Box::new(Own { process, pool: built(0)? }));
    if let Ok(mut kept) = POOL.try_write() {
        kept.replace(own);
    }
    own.pool.install(work)
}

/// A pool with so many threads; 0 for all processors.
fn built(count: usize) -> Result<ThreadPool, Error> {
    ThreadPoolBuilder::new()
        .num_threads(count)
        .build()
        .map_err(|error| Error::simulation(format!("threads: {error}; ask for fewer")))
}

/// Runs parallel `work` without the interpreter lock on `threads` threads; stops it at a signal.
pub fn parallel<R: Send>(
    py: Python<'_>,
    threads: Option<Threads>,
    work: impl FnOnce(&AtomicBool) -> Result<R, Error> + Send,
) -> PyResult<R> {
    checked_threads(threads)?;
    interruptible(py, |stop| in_pool(threads, || work(stop)))
}

/// Runs work of some microseconds without the interpreter lock on the caller's thread: another one would take longer to
/// start.
pub fn brief<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<R, Error> + Send,
) -> PyResult<R> {
    py.detach(|| work(&AtomicBool::new(false))).map_err(raised)
}

/// Runs `work` without the interpreter lock on one thread; stops it at a signal.
pub fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<R, Error> + Send,
) -> PyResult<R> {
    let stop = AtomicBool::new(false);
    py.detach(|| {
        let (sender, receiver) = mpsc::channel();
        std::thread::scope(|scope| {
            let stop = &stop;
            // The receiver outlives this thread.
            scope.spawn(move || drop(sender.send(work(stop))));
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
