//! Logs of many flights: in memory up to a bound, beyond it in a file without a name.
//!
//! The system removes the file with the last process that uses it, however that ends. It lies where large temporary
//! files belong: in `TMPDIR`, else in `/var/tmp`, because `/tmp` is often memory itself.
//!
//! Tests: `tests/flight/test_many_logs.py`.

use seatrial::Error;
use seatrial::flight::log::Log;
use std::borrow::Cow;
use std::fs::{File, OpenOptions, remove_file};
use std::io::Write;
#[cfg(unix)]
use std::os::unix::fs::FileExt;
#[cfg(windows)]
use std::os::windows::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of logs that stay in memory.
const IN_MEMORY: usize = 256 << 20;

/// Bytes of a number.
const NUMBER: usize = size_of::<f64>();

/// The logs of a batch, in the order of its cases.
#[derive(Default)]
pub struct LogStore {
    kept: Vec<Kept>,
    bytes: usize,
    file: Option<File>,
    written: u64,
}

/// Where a log is.
enum Kept {
    Memory(Log<f64>),
    File { offset: u64, numbers: usize, rows: usize },
}

impl LogStore {
    /// Number of logs.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Bytes of a log, on average; 0 before the first.
    pub fn mean_bytes(&self) -> usize {
        (self.bytes + usize::try_from(self.written).unwrap_or(usize::MAX)) / self.kept.len().max(1)
    }

    /// Keeps the log of the next case.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, mut log: Log<f64>) -> Result<(), Error> {
        log.values.shrink_to_fit();
        let bytes = log.values.len() * NUMBER;
        if self.bytes + bytes <= IN_MEMORY {
            self.bytes += bytes;
            self.kept.push(Kept::Memory(log));
            return Ok(());
        }
        let folder = folder();
        self.write(&folder, &log).map_err(|error| {
            Error::simulation(format!(
                "logs: {} MiB of flights' logs go to a temporary file in {}, which cannot be written ({error}); fly fewer cases at a time, fly without logs, or set TMPDIR to a folder with more space",
                (self.bytes + bytes) >> 20,
                folder.display()
            ))
        })
    }

    fn write(&mut self, folder: &Path, log: &Log<f64>) -> std::io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            empty => empty.insert(unnamed(folder)?),
        };
        let mut bytes = Vec::with_capacity(log.values.len() * NUMBER);
        for x in &log.values {
            bytes.extend_from_slice(&x.to_le_bytes());
        }
        file.write_all(&bytes)?;
        self.kept.push(Kept::File { offset: self.written, numbers: log.values.len(), rows: log.rows });
        self.written += bytes.len() as u64;
        Ok(())
    }

    /// The log of a case.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn get(&self, case: usize) -> Result<Cow<'_, Log<f64>>, Error> {
        let (offset, numbers, rows) = match (&self.kept[case], &self.file) {
            (Kept::Memory(log), _) => return Ok(Cow::Borrowed(log)),
            (Kept::File { offset, numbers, rows }, _) => (*offset, *numbers, *rows),
        };
        let mut bytes = vec![0; numbers * NUMBER];
        let read = self.file.as_ref().map_or(Ok(()), |file| read_at(file, &mut bytes, offset));
        read.map_err(|error| {
            Error::simulation(format!("logs: the temporary file with them cannot be read ({error})"))
        })?;
        let (numbers, _) = bytes.as_chunks();
        Ok(Cow::Owned(Log { values: numbers.iter().map(|&x| f64::from_le_bytes(x)).collect(), rows }))
    }

    /// Number of rows of a case's log.
    pub fn rows(&self, case: usize) -> usize {
        match &self.kept[case] {
            Kept::Memory(log) => log.rows,
            Kept::File { rows, .. } => *rows,
        }
    }
}

/// Reads all of `bytes` from a place in a file.
#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    file.read_exact_at(bytes, offset)
}

/// Reads all of `bytes` from a place in a file.
#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let count = file.seek_read(bytes, offset)?;
        if count == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[count..];
        offset += count as u64;
    }
    Ok(())
}

fn folder() -> PathBuf {
    let given = std::env::var_os("TMPDIR").filter(|text| !text.is_empty()).map(PathBuf::from);
    let usual = || Some(PathBuf::from("/var/tmp")).filter(|path| path.is_dir());
    given.or_else(usual).unwrap_or_else(std::env::temp_dir)
}

/// A new file that has lost its name already.
fn unnamed(folder: &Path) -> std::io::Result<File> {
    static MADE: AtomicU64 = AtomicU64::new(0);
    let number = MADE.fetch_add(1, Ordering::Relaxed);
    let path = folder.join(format!(".seatrial-logs-{}-{number}", std::process::id()));
    // What a killed process with this number left there.
    let _ = remove_file(&path);
    let file = OpenOptions::new().read(true).write(true).create_new(true).open(&path)?;
    remove_file(&path)?;
    Ok(file)
}
