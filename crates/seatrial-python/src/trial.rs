//! Set points, dither and corridors of a trial of the loops, from the arrays that Python gives.

use crate::convert::{Named, Numbers};
use crate::error::{raised, refused};
use pyo3::prelude::*;
use seatrial::control::autopilot::set_point::{SET_POINTS, SetPoint};
use seatrial::control::navigation::CHANNEL_NAMES;
use seatrial::description::Description;
use seatrial::error::nearest;
use seatrial::fit::inputs::actuator_index;
use seatrial::flight::trial::{Corridor, Dither, ERRORS, Trial, channel_index};
use std::collections::BTreeMap;

/// A corridor: channel, base and scale (k,), lower, upper, target and clock (P,).
pub type CorridorRow = (String, Numbers, Numbers, Numbers, Numbers, Numbers, Numbers);

/// A trial and what differs in it from case to case.
pub struct Trials {
    /// What all cases share.
    pub trial: Trial,
    /// Per case, `[named][time]`.
    pub set_points: Vec<Vec<f64>>,
    /// Per case, base and scale of each corridor.
    pub scales: Vec<Vec<[f64; 2]>>,
}

/// The place of a set point by its name.
fn place(name: &str) -> PyResult<usize> {
    SET_POINTS.iter().position(|known| *known == name).ok_or_else(|| {
        refused(format!("set_points: unknown set point \"{name}\"{}", nearest(name, SET_POINTS)))
    })
}

/// The times "times" (S,) of what holds from each of them on, finite and rising.
fn times(named: &mut BTreeMap<String, Numbers>, what: &str) -> PyResult<Vec<f64>> {
    let given = named.remove("times").ok_or_else(|| {
        refused(format!("{what}: expected \"times\" (S,), from which on each value holds, found none"))
    })?;
    let times = given.vector(&format!("{what}: times"))?;
    let rises = times.iter().all(|t| t.is_finite()) && times.is_sorted_by(|a, b| a < b);
    if times.is_empty() || !rises {
        return Err(refused(format!("{what}: times: expected rising times in s, at least one")));
    }
    Ok(times)
}

/// The dither {"times": (S,), actuator: (S,) in the unit of its command}.
pub fn dither(given: Option<Named>, vehicle: &Description) -> PyResult<Dither> {
    let mut named = given.map(Named::by_name).unwrap_or_default();
    if named.is_empty() {
        return Ok(Dither::default());
    }
    let times = times(&mut named, "dither")?;
    let mut signals = Vec::new();
    for (name, values) in named {
        let actuator = actuator_index(vehicle, &name).map_err(raised)?;
        let mut values = values.vector(&format!("dither: {name}"))?;
        if values.len() != times.len() || values.iter().any(|x| !x.is_finite()) {
            return Err(refused(format!("dither: {name}: expected {} finite numbers", times.len())));
        }
        if vehicle.actuators[actuator].reversed {
            values.iter_mut().for_each(|x| *x = -*x);
        }
        signals.push((actuator, values));
    }
    Ok(Dither { times, signals })
}

/// The set points of one step.
pub fn set_point(given: Option<Named>) -> PyResult<Option<SetPoint<f64>>> {
    let mut values = Vec::new();
    for (name, value) in Named::scalars(given)? {
        if !value.is_finite() {
            return Err(refused(format!("set_points: {name}: expected a finite number, found {value}")));
        }
        values.push((place(&name)?, value));
    }
    Ok((!values.is_empty()).then(|| SetPoint::of(0.0, values)))
}

impl Trials {
    /// From set points {"times": (S,), name: (k, S) or (S,)} and corridors, for `k` cases.
    pub fn new(set_points: Option<Named>, corridors: Vec<CorridorRow>, k: usize) -> PyResult<Self> {
        let mut trials =
            Self { trial: Trial::default(), set_points: vec![Vec::new(); k], scales: vec![Vec::new(); k] };
        let mut named = set_points.map(Named::by_name).unwrap_or_default();
        if !named.is_empty() {
            trials.trial.times = times(&mut named, "set_points")?;
        }
        for (name, values) in named {
            trials.trial.named.push(place(&name)?);
            let what = format!("set_points: {name}");
            let rows = values.for_cases(&what, k, trials.trial.times.len())?;
            if rows.iter().flatten().any(|x| !x.is_finite()) {
                return Err(refused(format!("{what}: expected finite numbers")));
            }
            trials.set_points.iter_mut().zip(rows).for_each(|(own, row)| own.extend(row));
        }
        for (c, row) in corridors.into_iter().enumerate() {
            trials.add(&format!("corridors[{c}]"), row, k)?;
        }
        Ok(trials)
    }

    fn add(&mut self, what: &str, row: CorridorRow, k: usize) -> PyResult<()> {
        let (name, base, scale, lower, upper, target, clock) = row;
        let known = || CHANNEL_NAMES.iter().chain(&ERRORS).copied();
        let channel = channel_index(&name).ok_or_else(|| {
            refused(format!("{what}: unknown channel \"{name}\"{}", nearest(&name, known())))
        })?;
        let of_cases = |x: Numbers, part: &str| x.for_cases(&format!("{what}: {part}"), k, 1);
        let (base, scale) = (of_cases(base, "base")?, of_cases(scale, "scale")?);
        if base.iter().any(|x| !x[0].is_finite()) {
            return Err(refused(format!("{what}: base: expected finite numbers")));
        }
        if scale.iter().any(|x| !(x[0].is_finite() && x[0] != 0.0)) {
            return Err(refused(format!("{what}: scale: expected numbers other than zero")));
        }
        let list = |x: Numbers, part: &str| x.vector(&format!("{what}: {part}"));
        let corridor = Corridor {
            channel,
            lower: list(lower, "lower")?,
            upper: list(upper, "upper")?,
            target: list(target, "target")?,
            clock: list(clock, "clock")?,
        };
        let lists = [&corridor.lower, &corridor.upper, &corridor.target, &corridor.clock];
        if lists
            .iter()
            .any(|l| l.is_empty() || l.len() != corridor.lower.len() || l.iter().any(|x| x.is_nan()))
        {
            return Err(refused(format!(
                "{what}: expected lower, upper, target and clock of one length, a number per control period each"
            )));
        }
        if corridor.target.iter().chain(&corridor.clock).any(|x| !x.is_finite()) {
            return Err(refused(format!(
                "{what}: expected a finite target and clock; only bounds may be infinite"
            )));
        }
        self.trial.corridors.push(corridor);
        for (own, (base, scale)) in self.scales.iter_mut().zip(base.into_iter().zip(scale)) {
            own.push([base[0], scale[0]]);
        }
        Ok(())
    }
}
