//! `LinearModel`: a linear model along a recorded motion, the likelihood of its noises and what it predicts.

use crate::convert::{Array, Numbers};
use crate::work::interruptible;
use pyo3::prelude::*;
use seatrial::fit::innovations::{Judged, Model, Noise, Parts, Sizes};

/// A linear model along a motion of n samples with N states, the first S of the vehicle, Y channels and M unknowns.
///
/// transition (n - 1, S, N): the rows of the vehicle's states; driven (n - 1, E): the E entries of the other rows, of
/// what drives it, that are not zero, and places, E of row and column (row 0 is that of state S), in the order of the
/// rows; shown (n, V): the V entries of what the channels show of the states that are not zero, and seen, V of channel
/// and state, in the order of the channels; measured (n, Y) and valid (n, Y), not zero where a sample counts; drift (n - 1, N); slopes (n - 1, S, M),
/// derivatives of a step by the unknowns; start (N,), the expected first state.
///
/// Koopman (1993), Biometrika 80, 117; Maine and Iliff, NASA RP-1168 (1986).
#[pyclass(frozen, module = "seatrial")]
pub struct LinearModel {
    model: Model,
}

#[pymethods]
impl LinearModel {
    #[new]
    #[pyo3(signature = (*, transition, places, driven, seen, shown, measured, valid, drift, slopes, start))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of one public call")]
    fn new(
        transition: Numbers,
        places: Vec<(usize, usize)>,
        driven: Numbers,
        seen: Vec<(usize, usize)>,
        shown: Numbers,
        measured: Numbers,
        valid: Numbers,
        drift: Numbers,
        slopes: Numbers,
        start: Numbers,
    ) -> PyResult<Self> {
        let start = start.vector("start")?;
        let width = start.len();
        let (_, states, transition) = transition.cube("transition", width)?;
        let (_, driven) = driven.matrix("driven", places.len())?;
        let (samples, shown) = shown.matrix("shown", seen.len())?;
        let (rows, measured) = measured.table("measured")?;
        let channels = measured.len() / rows.max(1);
        let (_, valid) = valid.matrix("valid", channels)?;
        let (_, drift) = drift.matrix("drift", width)?;
        let (_, unknowns, slopes) = slopes.block("slopes", states)?;
        let parts = Parts {
            sizes: Sizes { samples, states, width, channels, unknowns },
            transition,
            places,
            driven,
            seen,
            shown,
            measured,
            valid: valid.iter().map(|&x| x != 0.0).collect(),
            drift,
            slopes,
            start,
        };
        Ok(Self { model: Model::new(parts).map_err(crate::error::raised)? })
    }

    /// Logarithm of the likelihood of variances, without its constant, its slopes by process (N,) and sensors (Y,),
    /// and the states at the places kept: smoothed (n, kept), and after the measurements of each sample (n, kept).
    ///
    /// process (N,), per sample; sensors (Y,); start (N,), of the first state; kept: places of states.
    #[pyo3(signature = (process, sensors, start, kept))]
    fn judge(
        &self,
        py: Python<'_>,
        process: Numbers,
        sensors: Numbers,
        start: Numbers,
        kept: Vec<usize>,
    ) -> PyResult<(f64, Array, Array, Array, Array)> {
        let noise = noise(process, sensors, start)?;
        let Judged { likelihood, process, sensors, smoothed, known } =
            interruptible(py, |_| self.model.judge(&noise, &kept))?;
        let rows = [self.model.sizes().samples, kept.len()];
        Ok((
            likelihood,
            Array::new(&[process.len()], process),
            Array::new(&[sensors.len()], sensors),
            Array::new(&rows, smoothed),
            Array::new(&rows, known),
        ))
    }

    /// Logarithm of the likelihood of variances, without its constant, alone: what each sample adds to it, (n,).
    ///
    /// Parameters as for judge.
    fn likelihood(
        &self,
        py: Python<'_>,
        process: Numbers,
        sensors: Numbers,
        start: Numbers,
    ) -> PyResult<Array> {
        let noise = noise(process, sensors, start)?;
        let added = interruptible(py, |_| self.model.likelihood(&noise))?;
        Ok(Array::new(&[added.len()], added))
    }

    /// What the channels are predicted to show so many samples after each measurement, and its derivatives by the
    /// unknowns with the gains held, (n - ahead, Y, 1 + M).
    #[pyo3(signature = (process, sensors, start, ahead = 0))]
    fn predict(
        &self,
        py: Python<'_>,
        process: Numbers,
        sensors: Numbers,
        start: Numbers,
        ahead: usize,
    ) -> PyResult<Array> {
        let noise = noise(process, sensors, start)?;
        let found = interruptible(py, |_| self.model.predict(&noise, ahead))?;
        let Sizes { samples, channels, unknowns, .. } = self.model.sizes();
        Ok(Array::new(&[samples - ahead, channels, 1 + unknowns], found))
    }
}

fn noise(process: Numbers, sensors: Numbers, start: Numbers) -> PyResult<Noise> {
    Ok(Noise {
        process: process.vector("process")?,
        sensors: sensors.vector("sensors")?,
        start: start.vector("start")?,
    })
}
