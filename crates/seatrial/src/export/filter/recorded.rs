//! What of a filter is recorded: what the actuators do, and the equation of motion with its derivatives.

use super::super::program::{Interface, Program, Symbol};
use super::super::vehicle::signal_of;
use super::{FilterStep, exactly};
use crate::actuator::characteristic::Thrust;
use crate::error::Error;
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::memory::Memory;
use crate::number::slopes::slopes;
use crate::number::traced::Traced;
use std::fmt::Write;

impl FilterStep<'_> {
    /// The motors: half a step under the commands, and what they do.
    ///
    /// # Errors
    /// What of them cannot be recorded.
    pub fn motors(&self) -> Result<Program, Error> {
        let actuators = &self.description.actuators;
        let plain = Vehicle::nominal(self.description);
        let mut drive =
            Drive::new(&plain, self.h(), UnlimitedDelay::InTheDrive, |i| plain.motor(i).steady(0.0));
        let mut state = Vec::new();
        drive.visit("motor", &mut |name: &str, x: &mut f64| state.push(Symbol::new(name, "1", "", *x)));
        let inputs = actuators.iter().map(|a| {
            let about = format!("command of {} during the period", a.name);
            Symbol::new(&format!("cmd_{}", a.name), a.unit.as_str(), &about, a.neutral)
        });
        let mut outputs: Vec<Symbol> = (0..6).map(|i| exactly(format!("wrench[{i}]"))).collect();
        for (place, _) in self.flowing(&plain) {
            outputs.extend((0..4).map(|k| exactly(format!("thrust[{place}][{k}]"))));
        }
        for fin in 0..plain.fins.len() {
            outputs.extend((0..2).map(|k| exactly(format!("deflection[{fin}][{k}]"))));
        }
        let interface = Interface { parameters: Vec::new(), state, inputs: inputs.collect(), outputs };
        Program::of(interface, |given| {
            let unit = Traced::constant(0.0);
            let vehicle = Vehicle::nominal_in(self.description, unit);
            let mut drive =
                Drive::new(&vehicle, self.h(), UnlimitedDelay::InTheDrive, |i| vehicle.motor(i).steady(unit));
            let mut state = given.state.iter();
            drive.visit("motor", &mut |_: &str, x: &mut Traced| {
                *x = *state.next().expect("as many as were named");
            });
            let asked = actuators.iter().zip(&given.inputs);
            let targets: Vec<Traced> =
                asked.map(|(a, &command)| a.limits.apply(signal_of(a, command))).collect();
            for (i, &target) in targets.iter().enumerate() {
                let motor = vehicle.motor(i);
                if motor.ideal && motor.t_t.known().is_some_and(|time| time <= 0.0) {
                    drive.states[i] = motor.steady(target);
                }
            }
            let signals: Vec<Traced> = drive.states.iter().map(|state| state.signal).collect();
            let mut instant = Instant::default();
            act(&vehicle, &signals, self.voltage, |_| None, &mut instant);
            let mut shown = instant.inflow_free.unwrap_or([unit; 6]).to_vec();
            for (_, i) in self.flowing(&plain) {
                let Thrust { force, force_per_inflow, torque, torque_per_inflow } = instant.thrusts[i];
                shown.extend([force, force_per_inflow, torque, torque_per_inflow]);
            }
            shown.extend(instant.deflections.iter().flat_map(|&(sine, cosine)| [sine, cosine]));
            drive.advance(&targets);
            given.state.clear();
            drive.visit("motor", &mut |_: &str, x: &mut Traced| given.state.push(*x));
            Ok(shown)
        })
    }

    /// The thrusters whose thrust depends on the inflow: their places among themselves and among all.
    pub(super) fn flowing(&self, plain: &Vehicle<f64>) -> Vec<(usize, usize)> {
        let of = (0..plain.actuators.len()).filter(|&i| plain.actuators[i].characteristic.has_inflow());
        of.enumerate().collect()
    }

    /// The equation of motion: the acceleration and its derivatives by the velocity.
    ///
    /// # Errors
    /// What of it cannot be recorded.
    pub fn model(&self) -> Result<Program, Error> {
        let plain = Vehicle::nominal(self.description);
        let flowing = self.flowing(&plain);
        let (thrusters, fins) = (plain.actuators.len(), plain.fins.len());
        let mut inputs: Vec<Symbol> = (0..6).map(|i| exactly(format!("nu[{i}]"))).collect();
        inputs.extend((0..9).map(|i| exactly(format!("r[{}][{}]", i / 3, i % 3))));
        inputs.extend((0..6).map(|i| exactly(format!("on->wrench[{i}]"))));
        inputs.extend((0..4 * flowing.len()).map(|k| exactly(format!("on->thrust[{}][{}]", k / 4, k % 4))));
        inputs.extend((0..2 * fins).map(|k| exactly(format!("on->deflection[{}][{}]", k / 2, k % 2))));
        let mut outputs: Vec<Symbol> = (0..6).map(|i| exactly(format!("rate[{i}]"))).collect();
        outputs.extend((0..36).map(|k| exactly(format!("by_nu[{}][{}]", k / 6, k % 6))));
        let interface = Interface { inputs, outputs, ..Interface::default() };
        Program::of(interface, |given| {
            let unit = Traced::constant(0.0);
            let vehicle = Vehicle::nominal_in(self.description, unit);
            let mut told = given.inputs.iter().copied();
            let mut next = || told.next().expect("as many as were named");
            let nu: [Traced; 6] = std::array::from_fn(|_| next());
            let r: [[Traced; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
            let wrench: [Traced; 6] = std::array::from_fn(|_| next());
            let still = Thrust { force: unit, force_per_inflow: unit, torque: unit, torque_per_inflow: unit };
            let mut thrusts = vec![still; thrusters];
            for &(_, i) in &flowing {
                let [force, force_per_inflow, torque, torque_per_inflow] = std::array::from_fn(|_| next());
                thrusts[i] = Thrust { force, force_per_inflow, torque, torque_per_inflow };
            }
            let deflections = (0..fins).map(|_| (next(), next())).collect();
            let instant = Instant { thrusts, deflections, inflow_free: Some(wrench), ..Instant::default() };
            let rate = vehicle.acceleration((None, &r), &nu, &instant);
            Ok(rate.into_iter().chain(slopes(&rate, &nu).into_iter().flatten()).collect())
        })
    }
}

/// The functions that are recorded.
pub(super) fn recorded(motors: &Program, model: &Program) -> String {
    let unused = |text: &str, names: &[&str]| -> String {
        let idle = names.iter().filter(|name| !text.contains(&format!(" {name}->")));
        idle.map(|name| format!("    (void){name};\n")).collect()
    };
    let mut text = String::new();
    for (about, signature, body, given) in [
        (
            "What the motors do.",
            "static void show(const FILTER_state *s, const FILTER_input *in, struct acting *out)",
            motors.statements(true, false),
            &["s", "in"][..],
        ),
        (
            "Half a step of the motors.",
            "static void drive(FILTER_state *s, const FILTER_input *in)",
            motors.statements(false, true),
            &["s", "in"],
        ),
        (
            "The equation of motion: acceleration, and its derivatives by the velocity.",
            "static void model(const struct moving *in, struct moved *out)",
            model.statements(true, false),
            &["in"],
        ),
    ] {
        let idle = unused(&body, given);
        let _ = write!(text, "/* {about} */\n{signature}\n{{\n{body}{idle}}}\n\n");
    }
    text
}
