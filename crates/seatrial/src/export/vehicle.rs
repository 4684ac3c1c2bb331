//! The step of a vehicle: commands in, motion out.
//!
//! One step advances motors and motion as [`crate::flight`] does, with the commands held and the current constant; the
//! outputs are the sixteen channels of [`crate::control::navigation::truth`] and the signals of the actuators at the
//! state before it. Coefficients are parameters; what decides over the structure of the program stays as it is: zeros,
//! dead times, limits, tables, environment.

use super::program::{Interface, Program, Symbol};
use crate::actuator::motor::Limits;
use crate::control::navigation::{ALTITUDE, CHANNEL_NAMES, truth};
use crate::description::coefficients as names;
use crate::description::vehicle_file::Environment;
use crate::description::{ActuatorDescription, Description, Structure};
use crate::error::Error;
use crate::flight::case::SURFACE;
use crate::flight::faults::Faults;
use crate::flight::motors::Motors;
use crate::model::current::Current;
use crate::model::integrate::State;
use crate::model::vehicle::{Instant, Mode, Vehicle};
use crate::number::memory::Memory;
use crate::number::real::Real;
use crate::number::traced::Traced;
use crate::ranges;

/// The units of the sixteen channels.
pub const CHANNEL_UNITS: [&str; 16] = [
    "m", "m", "m", "rad", "rad", "rad", "m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s", "m", "m/s", "m/s",
    "m/s",
];

/// What the sixteen channels are.
pub const CHANNEL_ABOUT: [&str; 16] = [
    "position north",
    "position east",
    "depth",
    "roll",
    "pitch",
    "yaw",
    "velocity over ground, ahead",
    "velocity over ground, to starboard",
    "velocity over ground, down",
    "turn rate of roll",
    "turn rate of pitch",
    "turn rate of yaw",
    "altitude above the bottom",
    "velocity through the water, ahead",
    "velocity through the water, to starboard",
    "velocity through the water, down",
];

/// The offset of an actuator's dead time among its coefficients.
const DEAD_TIME: usize = 16;

/// How the step of a vehicle is exported.
#[derive(Clone, Copy, Debug)]
pub struct VehicleStep {
    /// Length of the step, s.
    pub h: f64,
    /// Supply voltage, V; not a number where it does not matter.
    pub voltage: f64,
    /// Water and gravity.
    pub environment: Environment,
    /// Where it begins: position and attitude.
    pub start: State<f64>,
}

/// The signal of a command, or the command of a signal: in the unit of the command, from neutral, positive ahead.
pub(super) fn signal_of(actuator: &ActuatorDescription, command: Traced) -> Traced {
    let distance = command - actuator.neutral;
    if actuator.reversed { -distance } else { distance }
}

/// The command of a signal.
pub(super) fn command_of(actuator: &ActuatorDescription, signal: Traced) -> Traced {
    (if actuator.reversed { -signal } else { signal }) + actuator.neutral
}

impl VehicleStep {
    /// The coefficients that are parameters: their indices.
    fn parameters(description: &Description) -> Vec<usize> {
        let fixed = |i: usize| {
            i.checked_sub(names::HULL).is_some_and(|offset| offset % names::PER_ACTUATOR == DEAD_TIME)
        };
        let of = |i: &usize| description.uses(*i) && description.coefficients[*i] != 0.0 && !fixed(*i);
        (0..description.layout.len()).filter(of).collect()
    }

    /// What the step reads and writes.
    fn interface(&self, description: &Description) -> Interface {
        let parameters = Self::parameters(description)
            .into_iter()
            .map(|i| {
                let unit = description.layout.unit(i, description.command_unit(i));
                let unit = if unit.is_empty() { "1".to_owned() } else { unit };
                let about = description.layout.description(i);
                let name = description.layout.name(i);
                let allowed = ranges::coefficient(&name);
                // Just above what is too small itself.
                let least = if allowed.open { allowed.least + f64::MIN_POSITIVE } else { allowed.least };
                let range = [least, allowed.most];
                Symbol { range, ..Symbol::new(&name, &unit, &about, description.coefficients[i]) }
            })
            .collect();
        let actuators = &description.actuators;
        let commands = actuators.iter().map(|a| {
            Symbol::new(
                &format!("cmd_{}", a.name),
                a.unit.as_str(),
                &format!("command of {}", a.name),
                a.neutral,
            )
        });
        let water = ["north", "east", "down"].map(|axis| {
            Symbol::new(&format!("current_{axis}"), "m/s", &format!("velocity of the water, {axis}"), 0.0)
        });
        let bottom = Symbol::new("bottom", "m", "depth of the bottom here; infinite for none", f64::INFINITY);
        let channels = (0..CHANNEL_NAMES.len()).map(|c| {
            let start = if c == ALTITUDE { f64::INFINITY } else { 0.0 };
            Symbol::new(CHANNEL_NAMES[c], CHANNEL_UNITS[c], CHANNEL_ABOUT[c], start)
        });
        let signals = actuators.iter().map(|a| {
            let about = format!("what {} does, in the unit of its command", a.name);
            Symbol::new(&format!("act_{}", a.name), a.unit.as_str(), &about, a.neutral)
        });
        let mut state = Vec::new();
        let (mut body, mut motors) = self.parts(description, &description.coefficients, 0.0);
        let mut keep = |name: &str, x: &mut f64| state.push(Symbol::new(name, "1", "", *x));
        body.visit("", &mut keep);
        motors.visit("motor", &mut keep);
        Interface {
            parameters,
            state,
            inputs: commands.chain(water).chain([bottom]).collect(),
            outputs: channels.chain(signals).collect(),
        }
    }

    /// State and motors at the start, in the kind of `unit`.
    fn parts<T: Real>(&self, description: &Description, values: &[T], unit: T) -> (State<T>, Motors<T>) {
        let vehicle = self.vehicle(description, values);
        let lift = |x: f64| unit.splat(x);
        let [north, east, depth] = self.start.position;
        // As in a flight: who is launched higher than it floats is afloat.
        let depth = depth.max(description.floating_depth(self.environment));
        let state = State {
            position: [north, east, depth].map(lift),
            attitude: self.start.attitude.map(lift),
            nu: self.start.nu.map(lift),
        };
        (state, Motors::new(&vehicle, &limits(description), self.h, unit))
    }

    fn vehicle<T: Real>(&self, description: &Description, values: &[T]) -> Vehicle<T> {
        let structure = Structure::new(description, &[]);
        Vehicle::new(description, &structure, values, self.environment, [Mode::Free; 6]).beneath(
            description,
            self.environment.g_m_s2,
            SURFACE,
        )
    }

    /// Records the step.
    ///
    /// # Errors
    /// What of it cannot be recorded.
    pub fn record(&self, description: &Description) -> Result<Program, Error> {
        let indices = Self::parameters(description);
        Program::of(self.interface(description), |given| {
            let unit = Traced::constant(0.0);
            let mut values: Vec<Traced> =
                description.coefficients.iter().map(|&x| Traced::constant(x)).collect();
            for (&index, &value) in indices.iter().zip(&given.parameters) {
                values[index] = value;
            }
            let vehicle = self.vehicle(description, &values);
            let (mut body, mut motors) = self.parts(description, &values, unit);
            let mut state = given.state.iter();
            let mut set = |_: &str, x: &mut Traced| *x = *state.next().expect("as many as were named");
            body.visit("", &mut set);
            motors.visit("motor", &mut set);

            let count = description.actuators.len();
            let (commands, water) = given.inputs.split_at(count);
            let current =
                Current { velocity: [water[0], water[1], water[2]], rate: [unit; 3], pressed: None };
            let none = Faults::new(vec![unit; count], vec![unit; count], false);
            motors.show(&none, 0.0);
            let mut shown = truth(&body, Some(&current), None);
            shown[ALTITUDE] = water[3] - shown[2];
            let signals = description.actuators.iter().zip(&motors.signals);
            let outputs =
                shown.into_iter().chain(signals.map(|(a, &signal)| command_of(a, signal))).collect();

            let targets: Vec<Traced> = description
                .actuators
                .iter()
                .zip(commands)
                .map(|(a, &command)| signal_of(a, command))
                .collect();
            motors.command(&vehicle, &targets, &limits(description));
            let mut instants: [Instant<Traced>; 3] = Default::default();
            for instant in &mut instants {
                instant.current = Some(current);
            }
            let mut next =
                motors.substep(&vehicle, &body, &mut instants, (true, 0.0, self.h), (&none, self.voltage));
            given.state.clear();
            let mut keep = |_: &str, x: &mut Traced| given.state.push(*x);
            next.visit("", &mut keep);
            motors.visit("motor", &mut keep);
            Ok(outputs)
        })
    }
}

fn limits(description: &Description) -> Vec<Limits> {
    description.actuators.iter().map(|a| a.limits).collect()
}
