//! How objects of the core are taken apart and put together again, by pickle, copy and process pools: to the last bit.
//!
//! A description is the text of its file, whose numbers are written so that they are read back exactly, and its
//! coefficients, which may be others than the file's.

use crate::convert::{Array, Numbers};
use crate::error::raised;
use pyo3::prelude::*;
use seatrial::description::Description;

/// The function of this module that puts an object together.
pub fn restorer<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("seatrial._core")?.getattr(name)
}

/// The text of the file, and the coefficients.
pub type Parts = (String, Array);

/// A description taken apart.
pub fn parts(description: &Description) -> Parts {
    let coefficients = description.coefficients.clone();
    (description.file.to_toml(), Array::new(&[coefficients.len()], coefficients))
}

/// A description put together again.
pub fn description(text: &str, coefficients: Numbers) -> PyResult<Description> {
    Description::from_parts(text, coefficients.vector("coefficients")?, "<pickle>").map_err(raised)
}
