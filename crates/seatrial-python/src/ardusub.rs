//! ArduSub's controllers over rows of a log.

use crate::convert::{Array, Numbers};
use crate::error::refused;
use pyo3::prelude::*;
use seatrial::control::ardusub::attitude::{AngleGains, rates_wanted};
use seatrial::control::ardusub::mixer::{COUPLING, FRAMES, MOTORS, Mixer};
use seatrial::control::ardusub::pid::{Gains, State, free, square_root};
use seatrial::control::ardusub::position::{forward_and_lateral, velocity_wanted};
use seatrial::model::kinematics::from_euler;
use std::collections::BTreeMap;

/// Shares (motors, 6) of roll, pitch, yaw, throttle, forward and lateral by the name of each frame.
///
/// They are in the order of ArduSub's ``FRAME_CONFIG``.
#[pyfunction]
pub fn ardusub_frames() -> BTreeMap<&'static str, Array> {
    FRAMES.iter().map(|(name, motors)| (*name, Array::rows(motors, false))).collect()
}

/// Turn rates (n, 3), rad/s, that the angle controllers want for roll, pitch and yaw.
///
/// Parameters
/// ----------
/// wanted, attitude : (n, 3)
///     Roll, pitch and yaw, rad.
/// turning : (n, 3)
///     Turn rate of the attitude wanted, in its own frame, rad/s.
/// gyro : (n, 3)
///     Measured turn rate, rad/s.
/// p : (3,)
///     ``ATC_ANG_RLL_P``, ``ATC_ANG_PIT_P``, ``ATC_ANG_YAW_P``, per s.
/// acceleration : (3,)
///     ``ATC_ACC_R_MAX``, ``ATC_ACC_P_MAX``, ``ATC_ACC_Y_MAX`` in rad/s2; 0: proportional.
/// dt : float
///     Control period, s.
/// yaw_rate_p : float
///     ``ATC_RAT_YAW_P``, s, which bounds the error of yaw; 0: no bound.
#[pyfunction]
#[pyo3(signature = (wanted, attitude, turning, gyro, p, acceleration, dt, *, yaw_rate_p = 0.0))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of one call")]
pub fn ardusub_rates(
    wanted: Numbers,
    attitude: Numbers,
    turning: Numbers,
    gyro: Numbers,
    p: Numbers,
    acceleration: Numbers,
    dt: f64,
    yaw_rate_p: f64,
) -> PyResult<Array> {
    let (wanted, attitude) = (wanted.rows("wanted")?, attitude.rows("attitude")?);
    let (turning, gyro) = (turning.rows("turning")?, gyro.rows("gyro")?);
    let gains = AngleGains {
        p: p.row("p")?,
        acceleration: acceleration.row("acceleration")?,
        rate: [0.0; 3],
        yaw_rate_p,
    };
    for (name, rows) in [("attitude", &attitude), ("turning", &turning), ("gyro", &gyro)] {
        same_length(name, rows.len(), wanted.len())?;
    }
    let rates: Vec<[f64; 3]> = (0..wanted.len())
        .map(|i| {
            let (to, from) = (from_euler(&wanted[i]), from_euler(&attitude[i]));
            rates_wanted(&gains, &to, &turning[i], &from, &gyro[i], dt).rates
        })
        .collect();
    Ok(Array::rows(&rates, false))
}

/// Terms (n, 7) of a PID controller: filtered target and error, P, I, D, FF and D_FF.
///
/// Parameters
/// ----------
/// target, measured : (n,)
/// dt : (n,)
///     Time since the row before, s; what is not positive begins anew with the row's own integral part.
/// integrator : (n,)
///     Integral part with which a row begins, where it begins anew.
/// gains : (6,)
///     P, I, D, FF, D_FF and IMAX.
/// filters : (3,)
///     Cut-offs of target, error and derivative, Hz; 0: none.
#[pyfunction]
pub fn ardusub_terms(
    target: Numbers,
    measured: Numbers,
    dt: Numbers,
    integrator: Numbers,
    gains: Numbers,
    filters: Numbers,
) -> PyResult<Array> {
    let (target, measured) = (target.vector("target")?, measured.vector("measured")?);
    let (dt, integrator) = (dt.vector("dt")?, integrator.vector("integrator")?);
    for (name, rows) in [("measured", &measured), ("dt", &dt), ("integrator", &integrator)] {
        same_length(name, rows.len(), target.len())?;
    }
    let ([p, i, d, ff, d_ff, i_max], [target_hz, error_hz, derivative_hz]) =
        (gains.row::<6>("gains")?, filters.row::<3>("filters")?);
    let gains = Gains { p, i, d, ff, d_ff, i_max, target_hz, error_hz, derivative_hz };
    let mut state = State::at_rest(0.0);
    let rows: Vec<[f64; 7]> = (0..target.len())
        .map(|row| {
            let anew = dt[row] <= 0.0;
            if anew {
                state = State::at_rest(0.0).with_integrator(integrator[row]);
            }
            let passed = if anew { 0.0 } else { dt[row] };
            let terms = state.step(&gains, target[row], measured[row], passed, free);
            [terms.target, terms.error, terms.p, terms.i, terms.d, terms.ff, terms.d_ff]
        })
        .collect();
    Ok(Array::rows(&rows, false))
}

/// Velocity wanted (n,), m/s, for an error of position; see ``PSC_*_POS_P``.
///
/// Parameters
/// ----------
/// error, velocity : (n,)
///     Target minus position, m, and the velocity of the target, m/s.
/// p : float
///     Per s.
/// acceleration : float
///     Limit of the way back, m/s2; 0: proportional.
/// dt : float
///     Control period, s.
#[pyfunction]
pub fn ardusub_velocity(
    error: Numbers,
    velocity: Numbers,
    p: f64,
    acceleration: f64,
    dt: f64,
) -> PyResult<Array> {
    let (error, velocity) = (error.vector("error")?, velocity.vector("velocity")?);
    same_length("velocity", velocity.len(), error.len())?;
    let wanted = error.iter().zip(&velocity);
    let wanted = wanted.map(|(&e, &v)| velocity_wanted(e, v, p, acceleration, dt)).collect();
    Ok(Array::new(&[error.len()], wanted))
}

/// Rate wanted (n,) of the square-root controller for an error (n,).
#[pyfunction]
pub fn ardusub_square_root(error: Numbers, p: f64, limit: f64, dt: f64) -> PyResult<Array> {
    let error = error.vector("error")?;
    Ok(Array::new(&[error.len()], error.iter().map(|&e| square_root(e, p, limit, dt)).collect()))
}

/// Forward and lateral (n, 2), -1 to 1, of an acceleration wanted.
///
/// Parameters
/// ----------
/// acceleration : (n, 2)
///     North and east, m/s2.
/// heading : (n,)
///     rad.
/// limit : float
///     Largest lean angle, rad.
#[pyfunction]
pub fn ardusub_forward_lateral(acceleration: Numbers, heading: Numbers, limit: f64) -> PyResult<Array> {
    let (acceleration, heading) = (acceleration.rows::<2>("acceleration")?, heading.vector("heading")?);
    same_length("heading", heading.len(), acceleration.len())?;
    let rows: Vec<[f64; 2]> =
        acceleration.iter().zip(&heading).map(|(a, &psi)| forward_and_lateral(a, psi, limit)).collect();
    Ok(Array::rows(&rows, false))
}

/// Pulse widths (n, motors), whole us, of a frame's motors.
///
/// Parameters
/// ----------
/// frame : str
///     As of `ardusub_frames`.
/// demands : (n, 6)
///     Roll, pitch, yaw, throttle (-1 to 1, up), forward and lateral.
/// direction : (motors,)
///     ``MOT_n_DIRECTION``, 1 or -1.
/// pulse : (2,)
///     ``MOT_PWM_MIN`` and ``MOT_PWM_MAX``, us.
/// coupling : float, optional
///     ``MOT_FV_CPLNG_K``, which counts for the frame Vectored; ArduSub's default when omitted.
#[pyfunction]
#[pyo3(signature = (frame, demands, direction, pulse = None, *, coupling = None))]
pub fn ardusub_pulses(
    frame: &str,
    demands: Numbers,
    direction: Numbers,
    pulse: Option<Numbers>,
    coupling: Option<f64>,
) -> PyResult<Array> {
    let mixer = mixer_of(frame, direction, pulse, coupling)?;
    let motors = mixer.motors;
    let demands = demands.rows::<6>("demands")?;
    let pulses = demands
        .iter()
        .flat_map(|row| mixer.thrusts(row).into_iter().take(motors.len()).map(|thrust| mixer.pulse(thrust)))
        .collect();
    Ok(Array::new(&[demands.len(), motors.len()], pulses))
}

/// The mixer of a frame, with a direction for each of its motors.
pub fn mixer_of(
    frame: &str,
    direction: Numbers,
    pulse: Option<Numbers>,
    coupling: Option<f64>,
) -> PyResult<Mixer> {
    let pulse = pulse.map_or(Ok([1100.0, 1900.0]), |pulse| pulse.row("pulse"))?;
    let mut mixer = Mixer::of(frame, [1.0; MOTORS], pulse, coupling.unwrap_or(COUPLING)).map_err(refused)?;
    let given = direction.vector("direction")?;
    same_length("direction", given.len(), mixer.motors.len())?;
    mixer.direction[..given.len()].copy_from_slice(&given);
    Ok(mixer)
}

/// Refuses rows of another number.
fn same_length(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found == expected {
        return Ok(());
    }
    Err(refused(format!("{name}: expected {expected} rows, found {found}")))
}
