//! The step of an autopilot: measurement in, commands out, once per control period.
//!
//! The mission, the autopilot's model of the vehicle, limits, safety and the control period are part of the program; the
//! tunable numbers of the autopilot file are its parameters. Steps come at the control period: what
//! [`Autopilot::step_after`] does after a pause is not part of it, nor are set points from outside.

use super::program::{Interface, Program, Symbol};
use super::vehicle::{CHANNEL_ABOUT, CHANNEL_UNITS, command_of, signal_of};
use crate::control::allocation::{Allocator, Method};
use crate::control::autopilot::settings::{PER_LOOP, Settings, tunable_index};
use crate::control::autopilot::{Autopilot, Thought};
use crate::control::control_law::LOOPS;
use crate::control::navigation::{ALTITUDE, CHANNEL_NAMES, CHANNELS, Measurement};
use crate::control::schedule::POINTS;
use crate::description::Description;
use crate::description::coefficients::FORCES;
use crate::error::Error;
use crate::mission::Mission;
use crate::number::memory::Memory;
use crate::number::real::Real;
use crate::number::traced::Traced;
use std::sync::Arc;

/// How the step of an autopilot is exported.
pub struct AutopilotStep<'a> {
    /// The autopilot.
    pub settings: &'a Arc<Settings>,
    /// Its model of the vehicle.
    pub model: &'a Description,
    /// The mission.
    pub mission: &'a Arc<Mission>,
    /// Whether the actuators' signals are measured.
    pub feedback: bool,
    /// Supply voltage, V; not a number where it does not matter.
    pub voltage: f64,
}

/// Units of the gains of a speed, of depth and of an angle: proportional, integral, derivative.
const SPEED_UNITS: [&str; 3] = ["N s/m", "N/m", "N s2/m"];
const DEPTH_UNITS: [&str; 3] = ["N/m", "N/m per s", "N s/m"];
const ANGLE_UNITS: [&str; 3] = ["N m/rad", "N m/rad per s", "N m s/rad"];

/// Units of the gains of each loop.
const GAIN_UNITS: [[&str; 3]; 6] =
    [SPEED_UNITS, SPEED_UNITS, DEPTH_UNITS, ANGLE_UNITS, ANGLE_UNITS, ANGLE_UNITS];

/// Ends of the names of guidance's numbers, and the units that they tell; the first that fits counts.
const NAME_UNITS: [(&str, &str); 9] = [
    ("_m_s2", "m/s2"),
    ("_m_s", "m/s"),
    ("_deg_s", "deg/s"),
    ("_rad_m", "rad/m"),
    ("_per_s", "1/s"),
    ("_deg", "deg"),
    ("_m", "m"),
    ("_delay_s", "s"),
    ("", "1"),
];

/// The outputs besides commands and demands: name, unit, what they are.
const THOUGHTS: [(&str, &str, &str); 16] = [
    ("desired_speed", "m/s", "desired surge speed"),
    ("desired_lateral", "m/s", "desired sway speed"),
    ("desired_heading", "rad", "desired heading"),
    ("desired_pitch", "rad", "desired pitch"),
    ("desired_depth", "m", "desired depth"),
    ("holding", "1", "1 while station is kept"),
    ("cross_track", "m", "cross-track error, positive to starboard of the path"),
    ("vertical_error", "m", "vertical error, positive below the path"),
    ("distance", "m", "distance to the active waypoint"),
    ("leg", "1", "index of the active waypoint"),
    ("mode", "1", "index of the mode"),
    ("alert", "1", "level of the reaction: 0 none, 1 hold, 2 surface, 3 abort"),
    ("cause", "1", "the watch that called for it, from 1; 0 none"),
    ("given_up", "1", "sum of 2^i over the actuators that were given up"),
    ("suspect", "1", "the actuator that does something else by the motion, from 1; one more: all; 0 none"),
    ("done", "1", "1 when there is nothing more to do"),
];

impl AutopilotStep<'_> {
    /// The names and values of what may be tuned.
    fn parameters(&self) -> Vec<Symbol> {
        let unit = |index: usize, name: &str| match index / PER_LOOP {
            i if i < LOOPS.len() => match index % PER_LOOP / POINTS {
                gain @ 0..=2 => GAIN_UNITS[i][gain].to_owned(),
                _ => "rad/s".to_owned(),
            },
            _ => NAME_UNITS.iter().find(|(end, _)| name.ends_with(end)).map_or("1", |(_, u)| u).to_owned(),
        };
        let of = |(name, value): (String, f64)| {
            let index = tunable_index(&name).unwrap_or(usize::MAX);
            Symbol::new(&name, &unit(index, &name), &format!("{name} of the autopilot file"), value)
        };
        self.settings.named_tunables().into_iter().map(of).collect()
    }

    fn interface(&self) -> Result<Interface, Error> {
        let mut state = Vec::new();
        let autopilot =
            Autopilot::<f64>::new(self.settings, self.model, self.mission, &self.settings.tunables)?;
        let table = &self.settings.file.allocation;
        let mut pilot = autopilot.begin(Allocator::new(self.model, autopilot.model(), table)?);
        pilot.visit("", &mut |name: &str, x: &mut f64| state.push(Symbol::new(name, "1", "", *x)));
        let started = |c: usize, start: f64| if c >= ALTITUDE { f64::INFINITY } else { start };
        let channels = (0..CHANNELS).map(|c| {
            let start = if c == ALTITUDE { f64::INFINITY } else { 0.0 };
            Symbol::new(CHANNEL_NAMES[c], CHANNEL_UNITS[c], CHANNEL_ABOUT[c], start)
        });
        let ages = (0..CHANNELS).map(|c| {
            let about = format!("time since {} was true; infinite before its first sample", CHANNEL_NAMES[c]);
            Symbol::new(&format!("age_{}", CHANNEL_NAMES[c]), "s", &about, started(c, 0.0))
        });
        let mut inputs: Vec<Symbol> = channels.chain(ages).collect();
        inputs.push(Symbol::new("battery", "1", "share of the battery that is left", 1.0));
        let about = "1 for one step: the operator's reset, which leaves every reaction";
        inputs.push(Symbol::new("reset", "1", about, 0.0));
        let actuators = &self.model.actuators;
        if self.feedback {
            inputs.extend(actuators.iter().map(|a| {
                let about = format!("what {} does, in the unit of its command", a.name);
                Symbol::new(&format!("act_{}", a.name), a.unit.as_str(), &about, a.neutral)
            }));
        }
        let commands = actuators.iter().map(|a| {
            let about = format!("command of {}", a.name);
            Symbol::new(&format!("cmd_{}", a.name), a.unit.as_str(), &about, a.neutral)
        });
        let thoughts = THOUGHTS.iter().map(|(name, unit, about)| Symbol::new(name, unit, about, 0.0));
        let demands = (0..6).map(|i| {
            let unit = if i < 3 { "N" } else { "N m" };
            Symbol::new(&format!("demanded_{}", FORCES[i]), unit, "demand of the loops", 0.0)
        });
        let outputs = commands.chain(thoughts).chain(demands).collect();
        Ok(Interface { parameters: self.parameters(), state, inputs, outputs })
    }

    /// Records the step.
    ///
    /// # Errors
    /// What the autopilot cannot do on this vehicle, and what cannot be recorded.
    pub fn record(&self) -> Result<Program, Error> {
        let table = &self.settings.file.allocation;
        if table.method == Method::Quadratic {
            return Err(Error::vehicle(
                &self.settings.file.name,
                "allocation.method: \"quadratic\" iterates until it has found its solution, which a program without \
                 loops cannot; export with \"pseudo-inverse\""
                    .to_owned(),
            ));
        }
        self.settings.fits(self.model)?;
        let interface = self.interface()?;
        let indices: Vec<usize> = interface
            .parameters
            .iter()
            .map(|symbol| tunable_index(&symbol.known_as).map_err(Error::simulation))
            .collect::<Result<_, _>>()?;
        Program::of(interface, |given| {
            let mut tunables: Vec<Traced> =
                self.settings.tunables.iter().map(|&x| Traced::constant(x)).collect();
            for (&index, &value) in indices.iter().zip(&given.parameters) {
                tunables[index] = value;
            }
            let autopilot = Autopilot::new(self.settings, self.model, self.mission, &tunables)?;
            let mut pilot = autopilot.begin(Allocator::new(self.model, autopilot.model(), table)?);
            let mut state = given.state.iter();
            pilot
                .visit("", &mut |_: &str, x: &mut Traced| *x = *state.next().expect("as many as were named"));

            let mut inputs = given.inputs.iter().copied();
            let mut told = |count: usize| inputs.by_ref().take(count).collect::<Vec<Traced>>();
            let (channels, ages, battery, reset) = (told(CHANNELS), told(CHANNELS), told(1), told(1)[0]);
            let actuators = &self.model.actuators;
            let signals = actuators.iter().zip(told(if self.feedback { actuators.len() } else { 0 }));
            let feedback: Vec<Traced> = signals.map(|(a, shown)| signal_of(a, shown)).collect();
            let mut measured = Measurement::nothing(battery[0]);
            measured.channels.copy_from_slice(&channels);
            measured.age.copy_from_slice(&ages);
            (measured.battery, measured.voltage) = (battery[0], self.voltage);
            pilot.reset(reset.splat(0.5).lt(reset));
            let thought = autopilot.step(&mut pilot, &measured, self.feedback.then_some(&feedback[..]));
            given.state.clear();
            pilot.visit("", &mut |_: &str, x: &mut Traced| given.state.push(*x));
            let commands = actuators.iter().zip(&pilot.signals).map(|(a, &signal)| command_of(a, signal));
            Ok(commands.chain(row(&thought)).collect())
        })
    }
}

/// The outputs besides the commands, in the order of [`THOUGHTS`] and the demands.
pub fn row<T: Real>(thought: &Thought<T>) -> impl Iterator<Item = T> + use<T> {
    let Thought { desired, mode, alert, demanded, given_up, suspect, ended, .. } = *thought;
    let told = [
        desired.speed,
        desired.lateral,
        desired.heading,
        desired.pitch,
        desired.depth,
        desired.holding,
        desired.cross_track,
        desired.vertical_error,
        desired.distance,
        desired.leg,
        mode,
        alert.level,
        alert.cause,
        given_up,
        suspect,
        ended,
    ];
    told.into_iter().chain(demanded)
}
