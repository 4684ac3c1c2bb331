//! What can be wrong with a file, a call or a simulation, said so that the reader can mend it.

use std::cmp::Reverse;
use thiserror::Error;

/// A failure of the core. Each kind becomes one exception class in Python.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A vehicle file that cannot be used.
    #[error("{source_name}: {message}")]
    Vehicle {
        /// The file, or the name of the built-in vehicle.
        source_name: String,
        /// Key, what was expected, what was found, what to do.
        message: String,
    },
    /// A simulation that cannot be run as asked.
    #[error("{0}")]
    Simulation(String),
    /// A simulation that left what a vehicle can do.
    #[error("{0}")]
    Diverged(String),
    /// The caller stopped the run.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// A vehicle error at `source_name`.
    pub fn vehicle(source_name: &str, message: impl Into<String>) -> Self {
        Self::Vehicle { source_name: source_name.to_owned(), message: message.into() }
    }

    /// A simulation error.
    pub fn simulation(message: impl Into<String>) -> Self {
        Self::Simulation(message.into())
    }
}

/// ` (did you mean "…"?)` with the known name nearest to `wanted`, or nothing when none is near.
pub fn nearest<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let near = known
        .into_iter()
        .map(|name| {
            let (wanted, known) = (wanted.to_lowercase(), name.to_lowercase());
            let distance = strsim::damerau_levenshtein(&wanted, &known);
            let other = wanted.replace('_', "") != known.replace('_', "");
            ((distance, other, Reverse(strsim::levenshtein(&wanted, &known))), name)
        })
        // Of names as near as one another the one with the same letters, then the one whose letters changed places: two
        // changes without that.
        .min_by_key(|(order, _)| *order)
        .map(|((distance, ..), name)| (distance, name));
    match near {
        Some((distance, name)) if distance <= 1 + wanted.len() / 3 => {
            format!("; did you mean \"{name}\"?")
        }
        _ => String::new(),
    }
}
