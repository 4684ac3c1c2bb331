//! The navigation filter as C: a period of its prediction, a function per sensor, its estimate.
//!
//! Recorded are what the actuators do ([`FilterStep::motors`]) and the equation of motion with its derivatives by the
//! velocity ([`FilterStep::model`]), which differ from vehicle to vehicle. The rest, Runge–Kutta of motion and derivatives,
//! the covariance and what sensors show, is the same for all and would be long as a straight line: it stands as loops in
//! the files of the folder `filter`, the C of [`crate::filter`] and [`crate::control::navigation_filter`].
//!
//! Those files have marks: a line `//if NAME` and its `//end` keep what stands between where NAME holds, and `@NAME@` is
//! made here. A function that nothing calls is left out. Steps come at the period; the model of the vehicle, its
//! environment and supply, the period and the kinds of sensors are part of the program, all other numbers parameters.
//!
//! Tests: `tests/export.rs`, `tests/export/test_c_filter.py`.

mod interface;
mod recorded;
mod sensors;

use super::c::{constant, preamble};
use super::program::{Count, Program, Symbol};
use crate::control::navigation::ALTITUDE;
use crate::control::navigation_filter::fitting::{
    ATTITUDE_SENSOR, DVL, DVL_WATER, ECHO_SOUNDER, GYRO, RANGE, righting,
};
use crate::control::navigation_filter::start::{AT_START, DOUBTED, PATIENCE, RECENT, UNNOTICED};
use crate::control::navigation_filter::{Fitting, Instrument, KINDS, LANDMARKS, LONGEST_STEP, Landmark};
use crate::description::Description;
use crate::error::Error;
use crate::filter::innovation::{COUNTS, FORGETS, LOST, PAUSE};
use crate::filter::observation::Surface;
use crate::filter::process::{by_unmodelled, lever, linear_parts};
use crate::model::vehicle::Vehicle;
use interface::{filled, outputs};
use recorded::recorded;
use std::fmt::Write;

/// How a navigation filter is exported.
pub struct FilterStep<'a> {
    /// Its process model.
    pub description: &'a Description,
    /// What it is made of.
    pub fitting: &'a Fitting,
    /// Supply voltage, V; not a number where it does not matter.
    pub voltage: f64,
}

/// A filter as C.
pub struct FilterSource {
    /// `PREFIX.h`.
    pub header: String,
    /// `PREFIX.c`.
    pub source: String,
    /// What may be set.
    pub parameters: Vec<Symbol>,
    /// How many numbers are remembered.
    pub state: Vec<Symbol>,
    /// What the actuators are told and measured at.
    pub inputs: Vec<Symbol>,
    /// The estimate.
    pub outputs: Vec<Symbol>,
    /// Operations of what is recorded: of the motors half a step, of the equation of motion a stage.
    pub recorded: [(&'static str, Count); 2],
}

const HEADER: &str = include_str!("filter/interface.h");
const SOURCES: [&str; 6] = [
    include_str!("filter/algebra.c"),
    include_str!("filter/process.c"),
    include_str!("filter/observation.c"),
    include_str!("filter/past.c"),
    include_str!("filter/tracker.c"),
    include_str!("filter/work.c"),
];

/// Names, first channel and number of channels of the sensors, in the order of [`KINDS`] up to the altitude; unit and what
/// they measure.
const SENSORS: [(usize, usize, &str, &str); 9] = [
    (0, 2, "m", "position north and east"),
    (16, 2, "m", "fix of a GPS, north and east"),
    (18, 3, "m", "fix of acoustics, north, east, down"),
    (2, 1, "m", "depth"),
    (3, 3, "rad", "roll, pitch, yaw"),
    (6, 3, "m/s", "velocity over ground along the axes of the Doppler log"),
    (9, 3, "rad/s", "turn rates about the axes of the gyro"),
    (13, 3, "m/s", "velocity through the water along the axes of its Doppler log"),
    (ALTITUDE, 1, "m", "distance of the bottom along the axis of the echo sounder"),
];

/// The kinds whose axes are turned by their mounting.
const MOUNTED: [usize; 6] = [ATTITUDE_SENSOR, DVL, GYRO, DVL_WATER, ECHO_SOUNDER, RANGE];

impl FilterStep<'_> {
    /// The sensor of a kind, where it can show anything.
    fn instrument(&self, kind: usize) -> Option<Instrument> {
        let seen = match KINDS[kind] {
            "altitude" => self.fitting.bottom.is_some(),
            "range" => !self.fitting.landmarks.is_empty(),
            "bearing" => self.fitting.landmarks.iter().any(|(_, mark)| matches!(mark, Landmark::Beacon(_))),
            _ => true,
        };
        self.fitting.instruments[kind].filter(|_| seen)
    }

    fn kinds(&self) -> impl Iterator<Item = (usize, Instrument)> {
        (0..KINDS.len()).filter_map(|kind| Some((kind, self.instrument(kind)?)))
    }

    /// Steps of the process in a period.
    fn steps(&self) -> usize {
        (self.fitting.period / LONGEST_STEP - 1e-9).ceil().max(1.0) as usize
    }

    /// The moments that are kept for samples that come late.
    fn kept(&self) -> usize {
        let latest = self.kinds().map(|(_, sensor)| sensor.latency).fold(0.0, f64::max);
        let kept = ((latest + self.fitting.longest_age) / self.fitting.period - 1e-9).ceil() as usize;
        if kept > 0 { kept + 2 } else { 0 }
    }

    /// Length of a step of the process, s.
    fn h(&self) -> f64 {
        self.fitting.period / self.steps() as f64
    }

    /// Header and source; `autopilot` is the prefix of a program that is told the estimate, with the names of its inputs.
    ///
    /// # Errors
    /// What of the filter cannot be exported.
    pub fn write(
        &self,
        prefix: &str,
        about: &[String],
        autopilot: Option<(&str, &[String])>,
    ) -> Result<FilterSource, Error> {
        self.possible()?;
        let (motors, model) = (self.motors()?, self.model()?);
        if !model.tape.polylines.is_empty() || !model.tape.lists.is_empty() {
            return Err(Error::simulation(
                "export: an equation of motion with tables is not exported".to_owned(),
            ));
        }
        let (parameters, declared, defaults) = self.parameters();
        let inputs = self.inputs(&motors);
        let outputs = outputs();
        let texts = self.texts(&motors, &model, (&declared, &defaults), &inputs, &outputs, autopilot);
        let holds = self.holds(autopilot.is_some());
        let named = |text: &str| {
            let mut text = kept_parts(text, &holds);
            for (name, made) in &texts {
                text = text.replace(&format!("@{name}@"), made);
            }
            if let Some((autopilot, _)) = autopilot {
                text = text.replace("AUTOPILOT_", &format!("{autopilot}_"));
            }
            text.replace("FILTER_", &format!("{prefix}_"))
        };
        let head = head(about);
        let body = called(&named(&SOURCES.join("\n")));
        let guard = format!("{}_H", prefix.to_uppercase());
        let told = autopilot.map_or(String::new(), |(name, _)| format!("#include \"{name}.h\"\n\n"));
        let numbers = [
            ("CHANNELS", LANDMARKS + 2 * self.fitting.landmarks.len()),
            ("MOUNTS", self.mounts().len().max(1)),
            ("MARKS", self.fitting.landmarks.len()),
            ("KEPT", self.kept()),
        ];
        let mut sizes = String::new();
        for (name, number) in numbers.iter().filter(|(_, number)| *number > 0) {
            let _ = writeln!(sizes, "#define {prefix}_{name} {number}");
        }
        for (i, (name, _)) in self.fitting.landmarks.iter().enumerate() {
            let _ = writeln!(sizes, "#define {prefix}_MARK_{} {i}", Symbol::new(name, "", "", 0.0).name);
        }
        let header = format!(
            "{head}#ifndef {guard}\n#define {guard}\n\n{told}/* Single precision where SEATRIAL_FLOAT is defined, for header \
             and source alike. */\n#ifdef SEATRIAL_FLOAT\ntypedef float {prefix}_real;\n#else\ntypedef double \
             {prefix}_real;\n#endif\n\n{sizes}\n{}#endif\n",
            named(HEADER)
        );
        let tables = motors.tables();
        let constants = self.constants();
        let source = format!(
            "{head}#include \"{prefix}.h\"\n#include <math.h>\n\ntypedef {prefix}_real real;\n\n{}{constants}{tables}{body}",
            preamble(&[&body, &constants, &tables])
        );
        let state = self.remembered(&motors);
        let count = |program: &Program| {
            let (a, b) = (program.needed_for(true), program.needed_for(false));
            program.count(&a.iter().zip(&b).map(|(a, b)| *a || *b).collect::<Vec<bool>>())
        };
        let recorded = [("motors", count(&motors)), ("model", count(&model))];
        Ok(FilterSource { header, source, parameters, state, inputs, outputs, recorded })
    }

    /// Refuses what is not exported.
    fn possible(&self) -> Result<(), Error> {
        let refused = |text: &str| Err(Error::simulation(format!("export: {text}")));
        if self.fitting.swell.is_some() {
            return refused("a filter that is told of waves is not exported; make it without waves");
        }
        if self.description.file.tether.as_ref().is_some_and(|tether| tether.spring().is_some()) {
            return refused(
                "the filter in C does not know the pull of a tether, which depends on the position; leave anchor_m and slack_m out",
            );
        }
        if self.fitting.instruments[ATTITUDE_SENSOR].is_none() {
            return refused(
                "expected a sensor of the attitude, found none; a filter starts from roll, pitch and yaw",
            );
        }
        Ok(())
    }

    /// The kinds whose mountings are kept as rotations.
    fn mounts(&self) -> Vec<usize> {
        self.kinds().map(|(kind, _)| kind).filter(|kind| MOUNTED.contains(kind)).collect()
    }

    /// The names that hold in the marks of the files.
    fn holds(&self, told: bool) -> Vec<&'static str> {
        let plain = Vehicle::nominal(self.description);
        let marks = &self.fitting.landmarks;
        let ranges = self.instrument(RANGE).is_some();
        let mut holds: Vec<&str> = self.kinds().map(|(kind, _)| KINDS[kind]).collect();
        let surface = ranges && marks.iter().any(|(_, mark)| matches!(mark, Landmark::Surface(_)));
        let pen = marks.iter().any(|(_, mark)| matches!(mark, Landmark::Surface(Surface::Cylinder { .. })));
        for (name, held) in [
            ("autopilot", told),
            ("past", self.kept() > 0),
            ("prompt", self.kept() == 0),
            ("place", true),
            ("beacon", marks.iter().any(|(_, mark)| matches!(mark, Landmark::Beacon(_)))),
            ("surface", surface),
            ("pen", surface && pen),
            ("echo", surface || self.instrument(ECHO_SOUNDER).is_some()),
            ("landmarks", !marks.is_empty()),
            ("alone", marks.is_empty()),
            ("inflow", !self.flowing(&plain).is_empty()),
            ("fins", !plain.fins.is_empty()),
        ] {
            if held {
                holds.push(name);
            }
        }
        holds
    }

    /// The constants of the source.
    fn constants(&self) -> String {
        let (by_force, by_vertical) = (by_unmodelled(self.description), linear_parts(self.description).1);
        let mut text = String::new();
        let (period, steps) = (self.fitting.period, self.steps());
        let moving = if self.instrument(DVL_WATER).is_some() { 13 } else { 6 };
        let plain = Vehicle::nominal(self.description);
        for (name, value) in [
            ("PERIOD", constant(period)),
            ("STEPS", steps.to_string()),
            ("STEP", constant(self.h())),
            ("KEPT", self.kept().to_string()),
            ("MOVING", moving.to_string()),
            ("RIGHTING", constant(righting(&plain))),
            ("SLACK", "GUARD(1e-8, 1e-3)".to_owned()),
            ("SMALLEST", constant(f64::MIN_POSITIVE)),
            ("LONG", "GUARD(1e9, 1024.0)".to_owned()),
            ("PAUSE", constant(PAUSE)),
            ("FORGETS", constant(FORGETS)),
            ("COUNTS", constant(COUNTS)),
            ("LOST", constant(LOST)),
            ("UNKNOWN_SPEED", constant(AT_START[0])),
            ("UNKNOWN_RATE", constant(AT_START[1])),
            ("PATIENCE", constant(PATIENCE[0])),
            ("LONGEST_PATIENCE", constant(PATIENCE[1])),
            ("UNNOTICED", constant(UNNOTICED)),
            ("DOUBTED", constant(DOUBTED)),
            ("RECENT", constant(RECENT)),
        ] {
            let _ = writeln!(text, "#define {name} {value}");
        }
        for (place, kind) in self.mounts().into_iter().enumerate() {
            let _ = writeln!(text, "#define MOUNT_{} {place}", KINDS[kind]);
        }
        let bearing = (0..self.fitting.landmarks.len())
            .filter(|&i| matches!(self.fitting.landmarks[i].1, Landmark::Beacon(_)))
            .map(|i| format!(" || ((channel) == {})", LANDMARKS + 2 * i + 1))
            .collect::<String>();
        let _ = writeln!(text, "#define IS_ANGLE(channel) ((((channel) >= 3) && ((channel) < 6)){bearing})");
        for (name, rows) in [
            ("by_force[6][6]", by_force.map(|row| row.to_vec()).to_vec()),
            ("by_vertical[6][3]", by_vertical.map(|row| row.to_vec()).to_vec()),
            ("lever[3][3]", lever(self.description).map(|row| row.to_vec()).to_vec()),
        ] {
            let _ = writeln!(text, "\nstatic const real {name} = {{");
            for row in rows {
                let _ = writeln!(
                    text,
                    "    {{ {} }},",
                    row.into_iter().map(constant).collect::<Vec<_>>().join(", ")
                );
            }
            text += "};\n";
        }
        text + "\n"
    }

    /// What stands for the names in the files.
    fn texts(
        &self,
        motors: &Program,
        model: &Program,
        (declared, defaults): (&str, &str),
        inputs: &[Symbol],
        outputs: &[Symbol],
        autopilot: Option<(&str, &[String])>,
    ) -> Vec<(&'static str, String)> {
        let plain = Vehicle::nominal(self.description);
        let members = |symbols: &[Symbol]| -> String {
            let line = |s: &Symbol| format!("    FILTER_real {}; /* {}: {} */\n", s.name, s.unit, s.about);
            symbols.iter().map(line).collect()
        };
        let state = &motors.interface.state;
        let rest = |symbols: &[Symbol], what: &str| -> String {
            let line = |s: &Symbol| format!("    {what}->{} = {};\n", s.name, constant(s.start));
            symbols.iter().map(line).collect()
        };
        let (sensors, sensing) = self.functions();
        vec![
            ("PARAMETERS", declared.to_owned()),
            ("DEFAULTS", defaults.to_owned()),
            ("MOTORS", state.iter().map(|s| format!("    FILTER_real {};\n", s.name)).collect()),
            ("MOTORS_AT_REST", rest(state, "s") + &rest(inputs, "in")),
            ("INPUTS", members(inputs)),
            ("OUTPUTS", members(outputs)),
            ("THRUSTS", self.flowing(&plain).len().to_string()),
            ("FINS", plain.fins.len().to_string()),
            ("RECORDED", recorded(motors, model)),
            ("SHOWN", self.shown(motors)),
            ("EXPECTED", self.expected()),
            ("SHIFTED", self.shifted()),
            ("FIXED", self.fixed(false)),
            ("FIXED_DEPTH", self.fixed(true)),
            ("MOUNTED", self.mounted()),
            ("SENSORS", sensors),
            ("SENSING", sensing),
            ("TOLD", self.told(outputs)),
            ("FILLED", autopilot.map_or(String::new(), |(_, names)| filled(outputs, names))),
        ]
    }
}

/// A number whose name in C is this.
fn exactly(name: String) -> Symbol {
    Symbol { known_as: name.clone(), name, ..Symbol::new("", "1", "", 0.0) }
}

/// What the motors call the signal of an actuator.
fn signal_name(i: usize) -> String {
    format!("motor_states_{i}_signal")
}

/// The parameter of a landmark.
fn mark_name(name: &str) -> String {
    format!("mark_{}", Symbol::new(name, "", "", 0.0).name)
}

fn head(about: &[String]) -> String {
    let lines: String = about.iter().map(|line| format!(" * {}\n", line.replace("*/", "* /"))).collect();
    format!("/*\n{lines} */\n")
}

/// A text without the parts whose name does not hold, and without the marks.
fn kept_parts(text: &str, holds: &[&str]) -> String {
    let (mut kept, mut around) = (String::new(), Vec::new());
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("//if ") {
            around.push(holds.contains(&name));
        } else if line == "//end" {
            around.pop();
        } else if around.iter().all(|held| *held) {
            kept += line;
            kept.push('\n');
        }
    }
    kept
}

/// A source without the functions that nothing calls; functions stand between empty lines.
fn called(text: &str) -> String {
    let mut parts: Vec<&str> = text.split("\n\n").collect();
    let name = |part: &str| -> Option<String> {
        let line = part.lines().find(|line| line.starts_with("static ") && line.contains('('))?;
        let before = line.split('(').next()?;
        Some(before.rsplit([' ', '*']).next()?.to_owned())
    };
    loop {
        let idle = (0..parts.len()).find(|&i| {
            name(parts[i]).is_some_and(|name| {
                let call = format!("{name}(");
                let calls = |part: &&str| {
                    part.match_indices(&call)
                        .any(|(at, _)| !part[..at].ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_'))
                };
                !parts.iter().enumerate().any(|(j, part)| j != i && calls(part))
            })
        });
        match idle {
            Some(i) => parts.remove(i),
            None => return parts.join("\n\n"),
        };
    }
}
