//! The response of a motor to a held command.

use crate::convert::{Array, Numbers};
use crate::error::refused;
use pyo3::prelude::*;
use seatrial::actuator::motor::Limits;
use seatrial::actuator::response::{Dynamics, Response};

/// Signal (m,) of a motor at any times, exact in continuous time, in the unit of the command.
///
/// Static limits, rate limit, dead time and the lag ``K_V e^(-T_t s) / (T_1 s + 1)`` (Taubert et al. 2014,
/// equation 34) in closed form; before ``t[0]`` the motor has settled at the first command.
///
/// Parameters
/// ----------
/// t : (n,)
///     Times in s from which the commands hold, increasing.
/// command : (n,)
///     Distance from neutral, positive ahead (rpm, us or N).
/// at : (m,)
///     Times in s of the response, in any order.
/// K_V, T_1, T_t : float
///     Gain, time constant in s and dead time in s.
/// maximum, minimum : (float, float)
///     Static limits ahead and astern, positive magnitudes.
/// dead_band : bool
///     Whether a command below the minimum gives zero instead of the minimum.
/// n_acc, n_dec : (float, float)
///     Rate limits ahead and astern in unit/s while the magnitude grows and while it shrinks.
///
/// Raises
/// ------
/// SimulationError
///     Times that do not increase, lengths that differ, or a parameter without meaning.
///
/// Examples
/// --------
/// >>> from seatrial._core import motor_response
/// >>> motor_response([0.0, 1.0], [0.0, 1000.0], [1.0, 1.6], T_1=0.5, T_t=0.1).round(1).tolist()
/// [0.0, 632.1]
#[pyfunction]
#[pyo3(signature = (t, command, at, *, K_V = 1.0, T_1 = 0.0, T_t = 0.0, maximum = (f64::INFINITY, f64::INFINITY), minimum = (0.0, 0.0), dead_band = false, n_acc = (f64::INFINITY, f64::INFINITY), n_dec = (f64::INFINITY, f64::INFINITY)))]
#[allow(clippy::too_many_arguments, non_snake_case)]
pub fn motor_response(
    t: Numbers,
    command: Numbers,
    at: Numbers,
    K_V: f64,
    T_1: f64,
    T_t: f64,
    maximum: (f64, f64),
    minimum: (f64, f64),
    dead_band: bool,
    n_acc: (f64, f64),
    n_dec: (f64, f64),
) -> PyResult<Array> {
    let (t, command, at) = (t.vector("t")?, command.vector("command")?, at.vector("at")?);
    if t.is_empty() || t.len() != command.len() {
        return Err(refused(format!(
            "command: expected one number per time, found {} for {} times",
            command.len(),
            t.len()
        )));
    }
    if !t.windows(2).all(|pair| pair[0] < pair[1]) || !t.iter().all(|x| x.is_finite()) {
        return Err(refused("t: expected finite times that increase"));
    }
    let pair = |(ahead, astern): (f64, f64)| [ahead, astern];
    for (name, [ahead, astern], least) in [
        ("maximum", pair(maximum), 0.0),
        ("minimum", pair(minimum), 0.0),
        ("n_acc", pair(n_acc), f64::MIN_POSITIVE),
        ("n_dec", pair(n_dec), f64::MIN_POSITIVE),
        ("T_1 and T_t", [T_1, T_t], 0.0),
    ] {
        if !(ahead >= least && astern >= least) {
            return Err(refused(format!(
                "{name}: expected {} numbers, found {ahead} and {astern}",
                if least > 0.0 { "positive" } else { "non-negative" }
            )));
        }
    }
    let limits = Limits { maximum: pair(maximum), minimum: pair(minimum), dead_band };
    let dynamics = Dynamics { k_v: K_V, t_1: T_1, t_t: T_t, growth: pair(n_acc), shrink: pair(n_dec) };
    let response = Response::new(&t, &command, &limits, dynamics);
    Ok(Array::new(&[at.len()], at.iter().map(|&t| response.at(t)).collect()))
}
