//! The numbers of a filter by name and unit: parameters, inputs, the estimate.

use super::super::c::constant;
use super::super::program::{Program, Symbol};
use super::super::vehicle::{CHANNEL_ABOUT, CHANNEL_UNITS};
use super::{FilterStep, SENSORS, exactly, mark_name, signal_name};
use crate::control::navigation::{ALTITUDE, CHANNEL_NAMES, CHANNELS};
use crate::control::navigation_filter::fitting::{DEPTH, GPS, POSITION_FIX, USBL, instrument_of};
use crate::control::navigation_filter::{KINDS, LANDMARKS, Landmark};
use crate::description::coefficients::FORCES;
use crate::filter::estimate::STATES;
use crate::filter::observation::Surface;
use crate::filter::transition::{COLUMNS, MOTION};
use crate::model::kinematics::to_euler;
use std::fmt::Write;

impl FilterStep<'_> {
    /// The parameters: as symbols, as members of a struct, and their values in C.
    pub(super) fn parameters(&self) -> (Vec<Symbol>, String, String) {
        let (mut symbols, mut declared, mut defaults) = (Vec::new(), String::new(), String::new());
        let mut add = |name: &str, unit: &str, about: &str, value: f64| {
            let mut symbol = exactly(name.to_owned());
            (symbol.unit, symbol.about, symbol.start) = (unit.to_owned(), about.to_owned(), value);
            let _ = writeln!(defaults, "    p->{name} = {};", constant(value));
            symbols.push(symbol);
        };
        for (kind, sensor) in self.kinds() {
            let name = KINDS[kind];
            let (unit, about) = match SENSORS.get(kind) {
                Some(&(.., unit, about)) => (unit, about),
                None if name == "range" => ("m", "distance of a landmark"),
                None => ("rad", "bearing of a beacon about the down axis"),
            };
            let _ = writeln!(declared, "    FILTER_instrument {name}; /* {unit}: {about} */");
            let of = |what: &str| format!("{about}: {what}");
            add(&format!("{name}.noise"), unit, &of("standard deviation of a sample"), sensor.noise);
            add(&format!("{name}.bias"), unit, &of("standard deviation of its constant offset"), sensor.bias);
            add(&format!("{name}.latency"), "s", &of("age of a sample when it arrives"), sensor.latency);
            for (i, x) in sensor.arm.into_iter().enumerate() {
                add(&format!("{name}.arm[{i}]"), "m", &of("place of the sensor"), x);
            }
            for (i, x) in to_euler(&sensor.mount).into_iter().enumerate() {
                add(&format!("{name}.mount[{i}]"), "rad", &of("mounting of the sensor"), x);
            }
        }
        for (name, mark) in &self.fitting.landmarks {
            let (unit, about, numbers) = match *mark {
                Landmark::Beacon(place) => ("m", "north, east, down of the beacon", place.to_vec()),
                Landmark::Surface(Surface::Plane { normal: [x, y, z], offset }) => (
                    "1, m",
                    "unit normal of the wall (north, east, down) and its offset",
                    vec![x, y, z, offset],
                ),
                Landmark::Surface(Surface::Cylinder { centre: [north, east], radius }) => {
                    ("m", "north and east of the axis of the pen, its radius", vec![north, east, radius])
                }
            };
            let name = mark_name(name);
            let _ = writeln!(declared, "    FILTER_real {name}[{}]; /* {unit}: {about} */", numbers.len());
            numbers.into_iter().enumerate().for_each(|(i, x)| add(&format!("{name}[{i}]"), unit, about, x));
        }
        if let Some(Surface::Plane { normal: [x, y, z], offset }) = self.fitting.bottom {
            let about = "unit normal of the bottom (north, east, down) and its offset";
            let _ = writeln!(declared, "    FILTER_real bottom[4]; /* 1, m: {about} */");
            [x, y, z, offset]
                .into_iter()
                .enumerate()
                .for_each(|(i, x)| add(&format!("bottom[{i}]"), "1, m", about, x));
        }
        let (noise, gate) = (&self.fitting.noise, &self.fitting.gate);
        let (start, far) = self.fitting.start;
        for (name, unit, about, numbers) in [
            (
                "force",
                "N, N m",
                "standard deviation of the force that the model does not know",
                &noise.force[..],
            ),
            ("force_time", "s", "its time constants", &noise.force_time),
            ("water", "1/kg", "acceleration of the water per newton of it, in gusts", &noise.water),
            (
                "acceleration",
                "m/s, rad/s",
                "velocity that white noise of acceleration makes in a second",
                &noise.acceleration,
            ),
            ("current", "m/s", "standard deviation of the current", &noise.current),
            ("current_time", "s", "its time constants", &noise.current_time),
            (
                "gyro_walk",
                "rad/s",
                "standard deviation by which the offset of the gyro moves in a second",
                &[noise.gyro_walk],
            ),
            (
                "gate",
                "1",
                "standard deviations of an innovation beyond which a sample is refused",
                &[gate.threshold.sqrt()],
            ),
            (
                "patience",
                "s",
                "time of refusals without a break after which a sensor is believed again",
                &[gate.patience],
            ),
            ("start", "m", "north, east, down of the start unless a sensor says it", &start),
            ("start_deviation", "m", "standard deviation of that", &[far]),
        ] {
            if let [x] = numbers {
                let _ = writeln!(declared, "    FILTER_real {name}; /* {unit}: {about} */");
                add(name, unit, about, *x);
                continue;
            }
            let _ = writeln!(declared, "    FILTER_real {name}[{}]; /* {unit}: {about} */", numbers.len());
            numbers.iter().enumerate().for_each(|(i, &x)| add(&format!("{name}[{i}]"), unit, about, x));
        }
        (symbols, declared, defaults)
    }

    /// What is remembered, number by number.
    pub(super) fn remembered(&self, motors: &Program) -> Vec<Symbol> {
        let channels = LANDMARKS + 2 * self.fitting.landmarks.len();
        let once = [("time", 1), ("age", 1), ("patience", 1), ("doubted", 1), ("place", 3), ("far", 3)];
        let mut all: Vec<(String, usize)> = once.map(|(name, count)| (name.to_owned(), count)).to_vec();
        let mean =
            [("position", 3), ("attitude", 4), ("nu", 6), ("force", 6), ("current", 3), ("gyro_bias", 3)];
        all.extend(mean.map(|(part, count)| (format!("mean.{part}"), count)));
        all.extend((0..STATES).map(|i| (format!("covariance[{i}]"), STATES)));
        all.push(("error".to_owned(), STATES));
        all.extend(["first", "silent"].map(|name| (name.to_owned(), channels)));
        let watch = ["sum", "recent", "since", "last", "gap", "taken", "refused", "recovered", "in_a_row"];
        all.extend((0..channels).flat_map(|c| watch.map(|name| (format!("watch[{c}].{name}"), 1))));
        if self.holds(false).contains(&"surface") {
            all.push(("beam".to_owned(), self.fitting.landmarks.len()));
        }
        for k in 0..self.kept() {
            all.push((format!("past[{k}].time"), 1));
            all.extend(mean.map(|(part, count)| (format!("past[{k}].mean.{part}"), count)));
            all.extend((0..MOTION).map(|i| (format!("past[{k}].back[{i}]"), COLUMNS)));
            all.extend((0..3).map(|i| (format!("past[{k}].swept[{i}]"), 3)));
            all.push((format!("past[{k}].moved"), STATES));
        }
        all.extend((0..MOTION).filter(|_| self.kept() > 0).map(|i| (format!("back[{i}]"), COLUMNS)));
        all.extend((0..3).filter(|_| self.kept() > 0).map(|i| (format!("swept[{i}]"), 3)));
        let flags = ["begun", "open", "restarts"].map(|name| (name.to_owned(), 1));
        all.extend(flags);
        let numbers = all.into_iter().flat_map(|(name, count)| {
            (0..count).map(move |i| exactly(if count == 1 { name.clone() } else { format!("{name}[{i}]") }))
        });
        numbers.chain(motors.interface.state.iter().cloned()).collect()
    }

    /// Commands, and what the actuators are measured at where the motors remember it.
    pub(super) fn inputs(&self, motors: &Program) -> Vec<Symbol> {
        let remembers = |i: usize| motors.interface.state.iter().any(|s| s.known_as == signal_name(i));
        let actuators = self.description.actuators.iter().enumerate().filter(|(i, _)| remembers(*i));
        let measured = actuators.map(|(_, a)| {
            let about =
                format!("what {} was measured at, at the end of the period; NAN where it was not", a.name);
            Symbol::new(&format!("act_{}", a.name), a.unit.as_str(), &about, f64::NAN)
        });
        motors.interface.inputs.iter().cloned().chain(measured).collect()
    }

    /// What the actuators were measured at takes the place of what the motors remember.
    pub(super) fn shown(&self, motors: &Program) -> String {
        let mut text = String::new();
        for (i, actuator) in self.description.actuators.iter().enumerate() {
            let Some(symbol) = motors.interface.state.iter().find(|s| s.known_as == signal_name(i)) else {
                continue;
            };
            let input = Symbol::new(&format!("act_{}", actuator.name), "", "", 0.0).name;
            let neutral = constant(actuator.neutral);
            let value = match (actuator.neutral == 0.0, actuator.reversed) {
                (true, false) => format!("in->{input}"),
                (true, true) => format!("-in->{input}"),
                (false, false) => format!("in->{input} - {neutral}"),
                (false, true) => format!("{neutral} - in->{input}"),
            };
            let _ = writeln!(
                text,
                "    if (is_number(in->{input}))\n    {{\n        s->{} = {value};\n    }}",
                symbol.name
            );
        }
        text
    }

    /// The estimate put into the outputs.
    pub(super) fn told(&self, outputs: &[Symbol]) -> String {
        let mut text = String::new();
        text += "    for (i = 0; i < 3; i++)\n    {\n        real bias = R(INFINITY);\n";
        for (kind, sure) in [(POSITION_FIX, "i < 2"), (GPS, "i < 2"), (USBL, ""), (DEPTH, "i == 2")] {
            if self.instrument(kind).is_none() {
                continue;
            }
            let channel = if kind == DEPTH { "2".to_owned() } else { format!("{} + i", SENSORS[kind].0) };
            let line = format!("bias = SMALLER(bias, offset(p, s, &p->{}, {channel}));", KINDS[kind]);
            let _ = match sure {
                "" => writeln!(text, "        {line}"),
                _ => writeln!(text, "        if ({sure})\n        {{\n            {line}\n        }}"),
            };
        }
        text += "        out->deviation[i] = together(out->deviation[i], bias);\n        out->deviation[3 + i] = \
                 together(out->deviation[3 + i], offset(p, s, &p->attitude, 3 + i));\n    }\n";
        for symbol in outputs {
            let name = &symbol.name;
            let channel = CHANNEL_NAMES.iter().position(|known| known == name);
            let age =
                name.strip_prefix("age_").and_then(|of| CHANNEL_NAMES.iter().position(|known| *known == of));
            let value = match (channel, age) {
                (Some(c), _) => format!("channels[{c}]"),
                (_, Some(c)) => {
                    let kind = instrument_of(c);
                    let latency = match self.instrument(kind) {
                        Some(_) => format!("p->{}.latency", KINDS[kind]),
                        None => "R(0.0)".to_owned(),
                    };
                    format!("age_of(s, fresh[{c}], {c}, {latency})")
                }
                _ => estimated(name),
            };
            let _ = writeln!(text, "    out->{name} = {value};");
        }
        text
    }
}

/// The estimate: what an autopilot is told, and the rest of the state.
pub(super) fn outputs() -> Vec<Symbol> {
    let own = || (0..CHANNELS).filter(|&c| c != ALTITUDE);
    let channels = own().map(|c| Symbol::new(CHANNEL_NAMES[c], CHANNEL_UNITS[c], CHANNEL_ABOUT[c], 0.0));
    let ages = own().map(|c| {
        let about =
            format!("0 where {} is trusted, else the age of the last sample of its sensor", CHANNEL_NAMES[c]);
        Symbol::new(&format!("age_{}", CHANNEL_NAMES[c]), "s", &about, f64::INFINITY)
    });
    let forces = (0..6).map(|i| {
        let unit = if i < 3 { "N" } else { "N m" };
        Symbol::new(&format!("force_{}", FORCES[i]), unit, "force that the model does not know", 0.0)
    });
    let water = ["north", "east", "down"].map(|axis| {
        Symbol::new(&format!("current_{axis}"), "m/s", &format!("velocity of the water, {axis}"), 0.0)
    });
    let gyro = ["p", "q", "r"].map(|axis| {
        Symbol::new(&format!("gyro_bias_{axis}"), "rad/s", &format!("offset of the gyro, {axis}"), 0.0)
    });
    channels.chain(ages).chain(forces).chain(water).chain(gyro).collect()
}

/// An output that is a number of the mean.
fn estimated(name: &str) -> String {
    let at = |part: &str, names: &[&str], own: &str| {
        names.iter().position(|known| *known == own).map(|i| format!("at->{part}[{i}]"))
    };
    let of = |(prefix, part, names): (&str, &str, &[&str])| {
        name.strip_prefix(prefix).and_then(|own| at(part, names, own))
    };
    [
        ("force_", "force", &FORCES[..]),
        ("current_", "current", &["north", "east", "down"]),
        ("gyro_bias_", "gyro_bias", &["p", "q", "r"]),
    ]
    .into_iter()
    .find_map(of)
    .unwrap_or_else(|| "R(0.0)".to_owned())
}

/// The inputs of an autopilot that the estimate tells.
pub(super) fn filled(outputs: &[Symbol], names: &[String]) -> String {
    let told = outputs.iter().filter(|symbol| names.contains(&symbol.name));
    told.map(|symbol| format!("    in->{0} = out.{0};\n", symbol.name)).collect()
}
