//! The inputs of a trial or a simulation as given, checked, and turned into a [`Record`] for a vehicle.

use crate::description::Description;
use crate::error::{Error, nearest};
use crate::fit::criterion::CHANNELS;
use crate::fit::record::Record;
use crate::model::vehicle::Mode;
use std::collections::BTreeMap;

/// Numbers over time, before they meet a vehicle. An empty vector means: not given.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    /// Time, s; uniform.
    pub t: Vec<f64>,
    /// Commands per actuator, in its own unit; a missing actuator stays at neutral.
    pub commands: BTreeMap<String, Vec<f64>>,
    /// Measured signals per actuator, in its own unit; they replace the motor.
    pub actuators: BTreeMap<String, Vec<f64>>,
    /// Supply voltage, V.
    pub voltage: Vec<f64>,
    /// Wrench besides the actuators', N and N m: per sample or one for all.
    pub tau: Vec<[f64; 6]>,
    /// Current, NED, m/s: per sample or one for all.
    pub current: Vec<[f64; 3]>,
    /// `ν` on the half-step grid, for measured axes.
    pub nu: Vec<[f64; 6]>,
    /// `ν'` on the half-step grid.
    pub nu_rate: Vec<[f64; 6]>,
    /// Measured channels.
    pub observed: Vec<[f64; CHANNELS]>,
    /// Their weights; zero masks a sample.
    pub weight: Vec<[f64; CHANNELS]>,
    /// Density of the water, kg/m³; the vehicle's when missing.
    pub rho: Option<f64>,
    /// Gravity, m/s²; the vehicle's when missing.
    pub g: Option<f64>,
    /// Where the surface is, m down of the origin; all is under water when missing.
    pub surface: Option<f64>,
}

impl Inputs {
    /// The record for a vehicle. With `replay` the half-step grid of `substeps` steps per sample is
    /// needed.
    ///
    /// # Errors
    /// What does not fit, in which input and row, and what to do.
    pub fn record(&self, description: &Description, replay: bool, substeps: usize) -> Result<Record, Error> {
        let n = self.t.len();
        let dt = uniform_step(&self.t)?;
        finite_rows("tau", &self.tau, &[0, 1, n])?;
        finite_rows("current", &self.current, &[0, 1, n])?;
        if let Some(level) = self.surface.filter(|level| !level.is_finite()) {
            return Err(Error::simulation(format!(
                "surface: expected its coordinate down in m, 0 where depths count from it, found {level}"
            )));
        }
        let nodes = 2 * substeps * (n - 1) + 1;
        if replay {
            finite_rows("nu", &self.nu, &[nodes])?;
            finite_rows("nu_rate", &self.nu_rate, &[nodes])?;
        }
        let mut record = Record {
            dt,
            len: n,
            commands: vec![vec![0.0; n]; description.actuators.len()],
            signals: vec![None; description.actuators.len()],
            voltage: series("voltage_v", &self.voltage, n, true)?,
            tau: if self.tau.len() == 1 { vec![self.tau[0]; n] } else { self.tau.clone() },
            current: self.current.clone(),
            measured: self.nu.iter().zip(&self.nu_rate).map(|(nu, rate)| [*nu, *rate]).collect(),
            observed: self.masked()?,
            weight: self.weight.clone(),
            environment: description.file.environment.with(self.rho, self.g)?,
            surface: self.surface,
            played: None,
        };
        for (name, values) in &self.commands {
            let k = actuator_index(description, name)?;
            let values = series(&format!("commands[\"{name}\"]"), values, n, false)?;
            let actuator = &description.actuators[k];
            record.commands[k] = values.iter().map(|&c| actuator.limits.apply(actuator.signal(c))).collect();
            if self.voltage.is_empty() && actuator.table().is_some_and(|t| t.needs_voltage()) {
                return Err(Error::simulation(format!(
                    "voltage_v: the thrust of {name} depends on the supply voltage; give it in V, shape ({n},)"
                )));
            }
        }
        for (name, values) in &self.actuators {
            let k = actuator_index(description, name)?;
            let values = series(&format!("actuators[\"{name}\"]"), values, n, false)?;
            record.signals[k] = Some(values.iter().map(|&x| description.actuators[k].signal(x)).collect());
        }
        Ok(record)
    }

    /// The measured channels with zeros where the weight is zero: a masked sample may hold anything, and
    /// zero times not-a-number must not reach the sum.
    fn masked(&self) -> Result<Vec<[f64; CHANNELS]>, Error> {
        let n = self.t.len();
        if self.observed.len() != self.weight.len() || !(self.observed.is_empty() || self.observed.len() == n)
        {
            return Err(Error::simulation(format!(
                "observed and weight: expected both with {n} rows, or none, found {} and {}",
                self.observed.len(),
                self.weight.len()
            )));
        }
        let mut observed = self.observed.clone();
        for (k, (row, weight)) in observed.iter_mut().zip(&self.weight).enumerate() {
            for c in 0..CHANNELS {
                if weight[c] == 0.0 {
                    row[c] = 0.0;
                } else if !(row[c].is_finite() && weight[c] > 0.0 && weight[c].is_finite()) {
                    return Err(Error::simulation(format!(
                        "observed: expected finite numbers where the weight is positive, found {} with weight {} in row {k}, channel {}",
                        row[c],
                        weight[c],
                        crate::fit::criterion::CHANNEL_NAMES[c]
                    )));
                }
            }
        }
        Ok(observed)
    }
}

/// The step of a uniform time base, s.
///
/// # Errors
/// The row after which the step is another.
pub fn uniform_step(t: &[f64]) -> Result<f64, Error> {
    if t.len() < 2 {
        return Err(Error::simulation(format!("t: expected two samples or more, found {}", t.len())));
    }
    let dt = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64;
    if !(dt.is_finite() && dt > 0.0) {
        return Err(Error::simulation("t: expected increasing times in s".to_owned()));
    }
    let uneven = |w: &[f64]| {
        let off = (w[1] - w[0] - dt).abs();
        off.is_nan() || off > 1e-6 * dt + 1e-9 * w[1].abs()
    };
    match t.windows(2).position(uneven) {
        None => Ok(dt),
        Some(k) => Err(Error::simulation(format!(
            "t: expected equal steps of {dt:.6} s, found {:.6} s after row {k}; resample to a uniform base",
            t[k + 1] - t[k]
        ))),
    }
}

/// The index of an actuator.
///
/// # Errors
/// The known names, and the nearest one.
pub fn actuator_index(description: &Description, name: &str) -> Result<usize, Error> {
    let known: Vec<&str> = description.actuators.iter().map(|a| a.name.as_str()).collect();
    known.iter().position(|n| *n == name).ok_or_else(|| {
        Error::simulation(format!(
            "unknown actuator \"{name}\"; {} has {}{}",
            description.file.name,
            known.join(", "),
            nearest(name, known.iter().copied())
        ))
    })
}

/// The modes of the axes from the letters of the free and the measured ones; the others are frozen.
///
/// # Errors
/// A letter that is no axis or stands twice.
pub fn modes(free: &str, measured: &str) -> Result<[Mode; 6], Error> {
    let mut modes = [Mode::Frozen; 6];
    for (letters, mode) in [(free, Mode::Free), (measured, Mode::Measured)] {
        for letter in letters.chars() {
            match "XYZKMN".find(letter) {
                Some(i) if modes[i] == Mode::Frozen => modes[i] = mode,
                Some(_) => return Err(Error::simulation(format!("axes: {letter} is named twice"))),
                None => {
                    return Err(Error::simulation(format!(
                        "axes: expected letters among XYZKMN, found \"{letters}\""
                    )));
                }
            }
        }
    }
    Ok(modes)
}

/// A series of n finite numbers; an empty one where that is `optional`.
fn series(name: &str, values: &[f64], n: usize, optional: bool) -> Result<Vec<f64>, Error> {
    if values.len() != n && !(optional && values.is_empty()) {
        return Err(Error::simulation(format!("{name}: expected {n} numbers, found {}", values.len())));
    }
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(values.to_vec()),
        Some(row) => Err(Error::simulation(format!(
            "{name}: expected finite numbers, found {} in row {row}",
            values[row]
        ))),
    }
}

fn finite_rows<const C: usize>(name: &str, rows: &[[f64; C]], lengths: &[usize]) -> Result<(), Error> {
    if !lengths.contains(&rows.len()) {
        let expected: Vec<String> = lengths.iter().filter(|n| **n > 0).map(usize::to_string).collect();
        return Err(Error::simulation(format!(
            "{name}: expected {} rows, found {}",
            expected.join(" or "),
            rows.len()
        )));
    }
    match rows.iter().position(|row| row.iter().any(|x| !x.is_finite())) {
        None => Ok(()),
        Some(k) => {
            Err(Error::simulation(format!("{name}: expected finite numbers, found {:?} in row {k}", rows[k])))
        }
    }
}
