//! A checked autopilot file, and its numbers that a batch may vary.
//!
//! Tests: `tests/closed_loop/modes.rs`.

use super::file::{AutopilotFile, Control, DepthBy, Gain, LoopTable};
use crate::control::control_law::LOOPS;
use crate::control::guidance;
use crate::control::lqr::Lqr;
use crate::control::schedule::{POINTS, Schedule};
use crate::description::Description;
use crate::description::coefficients::FORCES;
use crate::error::{Error, nearest};
use crate::number::real::Real;

/// The embedded autopilots, each for the built-in vehicle of its name.
const BUILT_IN: [(&str, &str); 6] = [
    ("beluga", include_str!("../../../autopilots/beluga.toml")),
    ("bluerov2", include_str!("../../../autopilots/bluerov2.toml")),
    ("bluerov2-heavy", include_str!("../../../autopilots/bluerov2-heavy.toml")),
    ("cwolf", include_str!("../../../autopilots/cwolf.toml")),
    ("lauv", include_str!("../../../autopilots/lauv.toml")),
    ("remus100", include_str!("../../../autopilots/remus100.toml")),
];

/// Names of the built-in autopilots.
pub fn built_in_names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|(name, _)| *name).collect()
}

/// The file of a built-in autopilot.
pub fn built_in(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Tunable numbers per loop: K_P, K_I and K_D at every supporting point, and the reference filter.
pub const PER_LOOP: usize = 3 * POINTS + 1;

/// The longest control period, s.
const LONGEST_PERIOD_S: f64 = 10.0;

/// The gains of a loop as they are named.
const GAINS: [&str; 3] = ["K_P", "K_I", "K_D"];

/// A row of the mode table, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Name.
    pub name: String,
    /// The loops at work.
    pub active: [bool; 6],
    /// The loop that controls the depth.
    pub depth_by: DepthBy,
    /// Forward speed from which the mode takes over, m/s.
    pub from_speed: f64,
    /// How far the speed must fall below it, m/s.
    pub hysteresis: f64,
    /// Actuators or groups at work; all when missing.
    pub actuators: Option<Vec<String>>,
}

/// An autopilot, read and checked, before it meets a vehicle.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The file as written.
    pub file: AutopilotFile,
    /// The supporting points.
    pub schedule: Schedule,
    /// The mode table.
    pub modes: Vec<Mode>,
    /// What a batch may vary, in the order of [`tunable_names`].
    pub tunables: Vec<f64>,
}

/// The names of the numbers that a batch may vary: `heading.K_P.3` (supporting points from 1, K_I per s, K_D times
/// s), `heading.reference_rad_s`, `guidance.lookahead_m` …
pub fn tunable_names() -> Vec<String> {
    let mut names = Vec::with_capacity(6 * PER_LOOP + guidance::TUNABLE.len());
    for name in LOOPS {
        for gain in GAINS {
            names.extend((1..=POINTS).map(|point| format!("{name}.{gain}.{point}")));
        }
        names.push(format!("{name}.reference_rad_s"));
    }
    names.extend(guidance::TUNABLE.iter().map(|name| format!("guidance.{name}")));
    names
}

/// The index of a tunable number.
///
/// # Errors
/// The nearest known name.
pub fn tunable_index(name: &str) -> Result<usize, String> {
    let names = tunable_names();
    names.iter().position(|known| known == name).ok_or_else(|| {
        let near = nearest(name, names.iter().map(String::as_str));
        format!("{name}: expected a gain such as heading.K_P.1, a loop's reference_rad_s or a number of guidance{near}")
    })
}

impl Settings {
    /// Reads and checks an autopilot file.
    ///
    /// # Errors
    /// What is wrong, where, and what to do.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, Error> {
        Self::new(AutopilotFile::parse(text, source_name)?, source_name)
    }

    fn new(file: AutopilotFile, source_name: &str) -> Result<Self, Error> {
        let settings = Self::checked(file).map_err(|m| Error::vehicle(source_name, m))?;
        settings.regulator(0.0)?;
        Ok(settings)
    }

    fn checked(file: AutopilotFile) -> Result<Self, String> {
        if !(file.period_s > 0.0 && file.period_s <= LONGEST_PERIOD_S) {
            return Err(format!(
                "period_s: expected a positive time in s, at most {LONGEST_PERIOD_S}, found {}",
                file.period_s
            ));
        }
        let schedule =
            Schedule::new(file.schedule.speeds_m_s).map_err(|m| format!("schedule.speeds_m_s: {m}"))?;
        for (name, table) in LOOPS.iter().zip(file.loops.in_order()) {
            if let Some(complaint) = table.and_then(complaint) {
                return Err(format!("loops.{name}.{complaint}"));
            }
        }
        let modes = modes(&file)?;
        if let Some(complaint) = file.guidance.complaint() {
            return Err(format!("guidance.{complaint}"));
        }
        if let Some(complaint) = file.safety.complaint() {
            return Err(complaint);
        }
        let mut tunables = Vec::new();
        for table in file.loops.in_order() {
            match table {
                None => tunables.extend([0.0; PER_LOOP]),
                Some(table) => {
                    for gain in [table.k_p, table.k_i_per_s, table.k_d_s] {
                        tunables.extend(gain.points());
                    }
                    tunables.push(table.reference_rad_s.unwrap_or(0.0));
                }
            }
        }
        tunables.extend(file.guidance.tunable());
        Ok(Self { file, schedule, modes, tunables })
    }

    /// The linear-quadratic regulator in the kind of `unit`, where it is the control law.
    ///
    /// # Errors
    /// Tables that do not fit the modes, or gains of the wrong shape.
    #[inline(always)]
    pub(super) fn regulator<T: Real>(&self, unit: T) -> Result<Option<Lqr<T>>, Error> {
        if self.file.control == Control::Pid {
            return Ok(None);
        }
        let names: Vec<&str> = self.modes.iter().map(|mode| mode.name.as_str()).collect();
        let limit = |table: Option<&LoopTable>| unit.splat(table.map_or(f64::INFINITY, |t| t.tau_max));
        let tau_max = self.file.loops.in_order().map(limit);
        Lqr::new(&self.file.lqr, &names, &tau_max, &self.file.name).map(Some)
    }

    /// Refuses a vehicle that cannot command the row of a loop.
    ///
    /// # Errors
    /// The loop, its row, and what the vehicle can command.
    pub fn fits(&self, vehicle: &Description) -> Result<(), Error> {
        for mode in &self.modes {
            for (i, row) in FORCES.iter().enumerate() {
                if mode.active[i] && !vehicle.file.controllable.iter().any(|known| known == row) {
                    return Err(Error::vehicle(
                        &self.file.name,
                        format!(
                            "mode \"{}\": the loop {} needs the row {row}, found {} controllable on {}; leave the loop out, or name the row in the vehicle file",
                            mode.name,
                            LOOPS[i],
                            vehicle.file.controllable.join(" "),
                            vehicle.file.name
                        ),
                    ));
                }
            }
        }
        self.actuators_at_work(vehicle).map(|_| ())
    }

    /// Per mode, 1 for the actuators of a vehicle that are at work.
    ///
    /// # Errors
    /// A mode names an actuator or group that the vehicle does not have.
    pub(super) fn actuators_at_work(&self, vehicle: &Description) -> Result<Vec<Vec<f64>>, Error> {
        let mut modes = Vec::with_capacity(self.modes.len());
        for (k, mode) in self.modes.iter().enumerate() {
            let mut at_work = vec![1.0; vehicle.actuators.len()];
            if let Some(named) = &mode.actuators {
                at_work.fill(0.0);
                for name in named {
                    let mut any = false;
                    for (actuator, share) in vehicle.actuators.iter().zip(&mut at_work) {
                        if actuator.name == *name || actuator.group == *name {
                            (*share, any) = (1.0, true);
                        }
                    }
                    if !any {
                        let known =
                            vehicle.actuators.iter().flat_map(|a| [a.name.as_str(), a.group.as_str()]);
                        return Err(Error::vehicle(
                            &self.file.name,
                            format!(
                                "modes[{}] \"{}\".actuators: the vehicle {} has no actuator or group \"{name}\"{}",
                                k + 1,
                                mode.name,
                                vehicle.file.name,
                                nearest(name, known)
                            ),
                        ));
                    }
                }
            }
            modes.push(at_work);
        }
        Ok(modes)
    }

    /// The names and values of what this autopilot has and a batch may vary.
    pub fn named_tunables(&self) -> Vec<(String, f64)> {
        let loops = self.file.loops.in_order();
        let has = |i: usize| match loops.get(i / PER_LOOP) {
            Some(table) => table.is_some_and(|t| i % PER_LOOP < 3 * POINTS || t.reference_rad_s.is_some()),
            None => true,
        };
        let named = tunable_names().into_iter().zip(self.tunables.iter().copied());
        named.enumerate().filter(|(i, _)| has(*i)).map(|(_, pair)| pair).collect()
    }

    /// The same autopilot with other values of some tunable numbers.
    ///
    /// # Errors
    /// An unknown name, a loop that it does not have, or a value that is not possible.
    pub fn with_tunables(&self, values: &[(String, f64)]) -> Result<Self, Error> {
        let fail = |message: String| Error::vehicle(&self.file.name, message);
        let mut tunables = self.tunables.clone();
        let known = self.named_tunables();
        for (name, value) in values {
            let index = tunable_index(name).map_err(fail)?;
            if !known.iter().any(|(own, _)| own == name) {
                return Err(fail(format!(
                    "{name}: this autopilot has no such loop or filter; add it to its file"
                )));
            }
            tunables[index] = *value;
        }
        let mut file = self.file.clone();
        let loops = &mut file.loops;
        let tables = [
            &mut loops.surge,
            &mut loops.sway,
            &mut loops.heave,
            &mut loops.roll,
            &mut loops.pitch,
            &mut loops.heading,
        ];
        for (table, row) in tables.into_iter().zip(tunables.chunks_exact(PER_LOOP)) {
            let Some(table) = table else { continue };
            let gain = |k: usize| Gain::of(std::array::from_fn(|i| row[k * POINTS + i]));
            (table.k_p, table.k_i_per_s, table.k_d_s) = (gain(0), gain(1), gain(2));
            if table.reference_rad_s.is_some() {
                table.reference_rad_s = Some(row[3 * POINTS]);
            }
        }
        file.guidance.set_tunable(&tunables[6 * PER_LOOP..]);
        Self::new(file, &self.file.name)
    }
}

/// What is wrong with a loop, if anything.
fn complaint(table: &LoopTable) -> Option<String> {
    for (key, gain) in [("K_P", table.k_p), ("K_I_per_s", table.k_i_per_s), ("K_D_s", table.k_d_s)] {
        if let Some(wrong) = gain.points().iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
            return Some(format!("{key}: expected numbers from zero on, found {wrong}"));
        }
    }
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if !positive(table.tau_max) {
        return Some(format!("tau_max: expected a positive number of N or N m, found {}", table.tau_max));
    }
    let omega = table.reference_rad_s.filter(|omega| !positive(*omega))?;
    Some(format!("reference_rad_s: expected a positive frequency, found {omega}; leave it out for no filter"))
}

fn modes(file: &AutopilotFile) -> Result<Vec<Mode>, String> {
    if file.modes.is_empty() {
        return Err("modes: expected one or more [[modes]], found none".into());
    }
    let loops = file.loops.in_order();
    let mut modes: Vec<Mode> = Vec::with_capacity(file.modes.len());
    for (k, table) in file.modes.iter().enumerate() {
        let at = format!("modes[{}] \"{}\"", k + 1, table.name);
        if modes.iter().any(|mode| mode.name == table.name) {
            return Err(format!("{at}.name: expected another name than the modes before it"));
        }
        let mut active = [false; 6];
        for name in &table.loops {
            let index = LOOPS
                .iter()
                .position(|known| known == name)
                .ok_or_else(|| format!("{at}.loops: unknown loop \"{name}\"{}", nearest(name, LOOPS)))?;
            if loops[index].is_none() && file.control == Control::Pid {
                return Err(format!(
                    "{at}.loops: \"{name}\" has no table; add [loops.{name}] with its gains"
                ));
            }
            active[index] = true;
        }
        let by = match table.depth_by {
            DepthBy::Heave => crate::control::control_law::HEAVE,
            DepthBy::Pitch => crate::control::control_law::PITCH,
        };
        if !active[by] {
            return Err(format!(
                "{at}.depth_by: expected one of the mode's loops, found \"{}\"; add it to loops",
                LOOPS[by]
            ));
        }
        if table.depth_by == DepthBy::Pitch && active[crate::control::control_law::HEAVE] {
            return Err(format!(
                "{at}.loops: expected no \"heave\" with depth_by = \"pitch\"; choose one of the two"
            ));
        }
        let (from_speed, hysteresis) = (table.from_speed_m_s, table.hysteresis_m_s);
        let lowest = modes.last().map_or(0.0, |mode: &Mode| mode.from_speed);
        let rises = if k == 0 { from_speed == 0.0 } else { from_speed > lowest };
        if !(from_speed.is_finite() && rises) {
            let expected = if k == 0 {
                "zero or nothing in the first mode".into()
            } else {
                format!("more than {lowest} m/s")
            };
            return Err(format!(
                "{at}.from_speed_m_s: expected {expected}, found {from_speed}; sort the modes by speed"
            ));
        }
        if !(hysteresis >= 0.0 && (k == 0 || hysteresis < from_speed)) {
            return Err(format!(
                "{at}.hysteresis_m_s: expected from zero to below from_speed_m_s, found {hysteresis}"
            ));
        }
        let (name, actuators) = (table.name.clone(), table.actuators.clone());
        modes.push(Mode { name, active, depth_by: table.depth_by, from_speed, hysteresis, actuators });
    }
    Ok(modes)
}
