//! The table `[[lqr]]` of the autopilot file: the regulator's gains in one mode.
//!
//! ```toml
//! [[lqr]]
//! mode = "cruise"
//! tracking_s = 5.0
//! gain = [ [ [row X: 15 numbers], … row N ], … ]     # one or six supporting points
//! ```
//!
//! Rows X Y Z K M N in N and N m, columns in the order of [`super::NAMES`]. Tests: `tests/lqr.rs`.

use super::{Gain, Lqr, ModeGain, STATES};
use crate::control::schedule::POINTS;
use crate::error::{Error, nearest};
use crate::number::algebra::Vec6;
use crate::number::real::Real;
use serde::{Deserialize, Serialize};

/// The gains of one mode as written in the file.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct LqrTable {
    /// Name of the mode.
    pub mode: String,
    /// Tracking time of the back-calculation, s.
    #[serde(default = "tracking")]
    pub tracking_s: f64,
    /// One gain or six, one for each supporting point: rows X Y Z K M N by 15 states.
    pub gain: Vec<Vec<Vec<f64>>>,
}

fn tracking() -> f64 {
    5.0
}

impl LqrTable {
    /// The gain at every supporting point.
    ///
    /// # Errors
    /// What was expected and found.
    fn points(&self) -> Result<[Gain<f64>; POINTS], String> {
        if !(self.tracking_s.is_finite() && self.tracking_s > 0.0) {
            return Err(format!("tracking_s: expected a positive time in s, found {}", self.tracking_s));
        }
        let gains = self.gain.iter().enumerate().map(|(k, rows)| matrix(k, rows));
        let gains = gains.collect::<Result<Vec<Gain<f64>>, String>>()?;
        match gains.as_slice() {
            [gain] => Ok([*gain; POINTS]),
            several => several.try_into().map_err(|_| {
                format!(
                    "gain: expected 1 matrix or {POINTS}, one for each supporting point, found {}; design the gains again for the speeds of [schedule]",
                    several.len()
                )
            }),
        }
    }
}

/// One gain as a matrix.
fn matrix(k: usize, rows: &[Vec<f64>]) -> Result<Gain<f64>, String> {
    let shaped: Option<Vec<[f64; STATES]>> = rows.iter().map(|row| row.as_slice().try_into().ok()).collect();
    let gain: Option<Gain<f64>> = shaped.and_then(|rows| rows.try_into().ok());
    let Some(gain) = gain else {
        let columns: Vec<usize> = rows.iter().map(Vec::len).collect();
        return Err(format!(
            "gain[{k}]: expected 6 rows X Y Z K M N of {STATES} numbers, found rows of {columns:?}; fill rows and states without a gain with 0"
        ));
    };
    match gain.iter().flatten().find(|x| !x.is_finite()) {
        Some(x) => Err(format!("gain[{k}]: expected finite numbers, found {x}; design the gains again")),
        None => Ok(gain),
    }
}

impl<T: Real> Lqr<T> {
    /// The regulator of the tables, one for each of the `modes` by name; `tau_max` (N and N m) may be infinite.
    ///
    /// # Errors
    /// A mode without a table, a table of no mode or of one that has another table, and gains of the wrong shape;
    /// `source_name` stands in messages.
    pub fn new(
        tables: &[LqrTable],
        modes: &[&str],
        tau_max: &Vec6<T>,
        source_name: &str,
    ) -> Result<Self, Error> {
        let refused = |message: String| Error::vehicle(source_name, message);
        let known = || modes.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
        if let Some(table) = tables.iter().find(|table| !modes.contains(&table.mode.as_str())) {
            return Err(refused(format!(
                "lqr.mode: expected a name of [[modes]] ({}), found \"{}\"{}",
                known(),
                table.mode,
                nearest(&table.mode, modes.iter().copied())
            )));
        }
        let unit = tau_max[0];
        let of_mode = |name: &&str| {
            let mut own = tables.iter().filter(|table| table.mode == **name);
            let (Some(table), None) = (own.next(), own.next()) else {
                let found = tables.iter().filter(|table| table.mode == **name).count();
                return Err(refused(format!(
                    "lqr: expected one table [[lqr]] for the mode \"{name}\", found {found}; design gains for each of [[modes]]"
                )));
            };
            let points = table.points().map_err(|message| refused(format!("lqr \"{name}\": {message}")))?;
            let points = points.map(|gain| gain.map(|row| row.map(|x| unit.splat(x))));
            Ok(ModeGain { points, tracking: unit.splat(table.tracking_s) })
        };
        let modes = modes.iter().map(of_mode).collect::<Result<Vec<ModeGain<T>>, Error>>()?;
        Ok(Self { modes, tau_max: *tau_max })
    }
}
