//! The one reader of files that people write: regular files of bounded size, UTF-8.
//!
//! A device or a pipe where a file is expected would be read for ever.
//!
//! Tests: `tests/base/test_hostile_paths.py`.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedStr;
use seatrial::toml_file;
use std::fs::{File, metadata};
use std::io::{Error, Read};
use std::path::{Path, PathBuf};

/// The largest file that is read, bytes; the longest one that people write has some ten thousand lines.
const LARGEST: u64 = 16 << 20;

/// The text of a file, without a byte order mark, or why it cannot be read.
pub fn file_text(path: &Path) -> Result<String, String> {
    let facts = metadata(path).map_err(|error| said(&error))?;
    if facts.is_dir() {
        return Err("it is a folder".into());
    }
    if !facts.is_file() {
        return Err("it is a device, a pipe or a socket, not a regular file".into());
    }
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes))
        .map_err(|error| said(&error))?;
    if bytes.len() as u64 > LARGEST {
        return Err(format!("it is larger than {} MiB", LARGEST >> 20));
    }
    let text = String::from_utf8(bytes).map_err(|_| "not a text file in UTF-8")?;
    Ok(text.strip_prefix('\u{feff}').map_or_else(|| text.clone(), Into::into))
}

/// What the operating system says, without its number.
fn said(error: &Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or_default().into()
}

/// Text of a regular file of bounded size, in UTF-8 with or without a byte order mark.
///
/// Raises ValueError that says why the file cannot be read.
#[pyfunction]
#[pyo3(name = "file_text")]
pub fn file_text_for_python(path: PathBuf) -> PyResult<String> {
    file_text(&path).map_err(PyValueError::new_err)
}

/// Kind of the file with these keys at its top: "a mission"; None where no key tells.
#[pyfunction]
pub fn file_kind(keys: Vec<PyBackedStr>) -> Option<&'static str> {
    toml_file::file_kind(&keys.iter().map(|key| &**key).collect::<Vec<_>>())
}

/// What is wrong with a file of these keys where one of the kind `expected` belongs; None where it may be one.
#[pyfunction]
pub fn wrong_kind(expected: &str, keys: Vec<PyBackedStr>) -> Option<String> {
    toml_file::wrong_kind(expected, &keys.iter().map(|key| &**key).collect::<Vec<_>>())
}
