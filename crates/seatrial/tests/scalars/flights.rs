//! Short flights of three vehicles in which every term of the model is at work, and their derivatives.

use crate::vehicles::{load, times};
use seatrial::description::Description;
use seatrial::fit::batch::Batch;
use seatrial::fit::inputs::{Inputs, modes};
use seatrial::fit::observation::{INITIALS, NUISANCES};
use seatrial::fit::record::{MotorStart, Record, Segment};
use seatrial::fit::sensitivities::{Point, Prediction, Unknown};
use seatrial::model::integrate::State;
use seatrial::model::kinematics::from_euler;
use std::sync::atomic::AtomicBool;

/// The vehicles: propellers with all of their motor, a table over the voltage, and every term invented.
pub const NAMES: [&str; 3] = ["cwolf", "beluga", "every_term"];

/// A vehicle, one trial, two segments of it, and where derivatives are taken; owned.
pub struct Flights {
    /// The vehicle.
    pub description: Description,
    /// One trial of 5 s at 10 Hz.
    pub records: Vec<Record>,
    /// From its beginning with running motors, and from amid it.
    pub segments: Vec<Segment>,
    /// Every coefficient that the vehicle's equations read.
    pub sought: Vec<usize>,
    /// Their values, off the points without derivative.
    pub values: Vec<f64>,
    /// Per record.
    pub nuisance: Vec<[f64; NUISANCES]>,
    /// Per segment.
    pub initial: Vec<[f64; INITIALS]>,
}

/// A number in [-1, 1] that looks random.
pub fn noise(seed: usize) -> f64 {
    let x = (12.9898 * seed as f64 + 0.5).sin() * 43_758.547;
    2.0 * (x - x.floor()) - 1.0
}

/// A vehicle by its name among [`NAMES`].
pub fn vehicle(name: &str) -> Description {
    match name {
        "every_term" => {
            let text = include_str!("../../../../tests/core/every_term.toml");
            Description::from_toml(text, name).expect("a valid file")
        }
        _ => load(name),
    }
}

/// The trial of a vehicle: commands of all actuators that change every half a second, wrench, current,
/// voltage, and measured channels.
pub fn inputs(description: &Description) -> Inputs {
    let n = 51;
    let commands = description.actuators.iter().enumerate().map(|(i, actuator)| {
        let amplitude = match actuator.unit.as_str() {
            "us" => 390.0,
            "N" => 30.0,
            "rad" => 0.4,
            _ => 1400.0,
        };
        let level = |k: usize| actuator.neutral + amplitude * noise(1 + 97 * i + k / 5);
        (actuator.name.clone(), (0..n).map(level).collect())
    });
    Inputs {
        t: times(n, 0.1),
        commands: commands.collect(),
        voltage: (0..n).map(|k| 14.5 + noise(k / 10)).collect(),
        tau: (0..n).map(|k| std::array::from_fn(|i| 3.0 * (0.3 * k as f64 + i as f64).sin())).collect(),
        current: (0..n).map(|k| [0.2, 0.002 * k as f64, -0.05]).collect(),
        observed: (0..n).map(|k| std::array::from_fn(|c| 0.5 * noise(12 * k + c))).collect(),
        weight: (0..n)
            .map(|k| std::array::from_fn(|c| if (k + c) % 5 == 0 { 0.0 } else { 1.0 + 0.1 * c as f64 }))
            .collect(),
        rho: Some(1010.0),
        ..Inputs::default()
    }
}

impl Flights {
    /// The flights of a vehicle, without nuisance parameters.
    pub fn new(name: &str) -> Self {
        let description = vehicle(name);
        let record = inputs(&description).record(&description, false, 1).expect("valid inputs");
        let sought: Vec<usize> =
            (0..description.layout.len()).filter(|&index| description.uses(index)).collect();
        let value = |&index: &usize| {
            let own = description.coefficients[index];
            let named = description.layout.name(index);
            // A dead time of whole steps and a lag of zero have a derivative on one side only.
            match named.rsplit_once('.') {
                Some((_, "T_t")) => 1.03 * own + 0.013,
                Some((_, "T_1")) => own + 0.05,
                _ => 1.03 * own,
            }
        };
        let values = sought.iter().map(value).collect();
        let state = State {
            position: [1.0, -2.0, 3.0],
            attitude: from_euler(&[0.3, -0.2, 2.9]),
            nu: [0.8, 0.1, -0.15, 0.12, 0.15, -0.2],
        };
        let running = (0..description.actuators.len()).map(|i| 100.0 * noise(300 + i)).collect();
        let segments = vec![
            Segment {
                record: 0,
                start: 0,
                stop: 31,
                state,
                current: [0.0; 3],
                motors: MotorStart::Held(running),
            },
            Segment {
                record: 0,
                start: 20,
                stop: 51,
                state,
                current: [0.0; 3],
                motors: MotorStart::Recorded,
            },
        ];
        Self {
            description,
            records: vec![record],
            sought,
            values,
            nuisance: vec![[0.0; NUISANCES]],
            initial: vec![[0.0; INITIALS]; segments.len()],
            segments,
        }
    }

    /// The same, with every nuisance parameter and initial condition at a value of its own.
    pub fn disturbed(name: &str) -> Self {
        let mut flights = Self::new(name);
        flights.nuisance[0] = std::array::from_fn(|i| match i {
            // Latencies off whole samples, where the interpolation has a corner.
            8..20 => 0.1 * (i % 3) as f64 + 0.03 + 0.02 * noise(i),
            _ => 0.1 * noise(500 + i),
        });
        for (s, initial) in flights.initial.iter_mut().enumerate() {
            *initial = std::array::from_fn(|i| 0.1 * noise(600 + 20 * s + i));
        }
        flights
    }

    /// With all axes free, in two steps per sample.
    pub fn batch(&self) -> Batch<'_> {
        Batch {
            description: &self.description,
            records: &self.records,
            segments: &self.segments,
            modes: modes("XYZKMN", "").expect("axes"),
            substeps: 2,
        }
    }

    /// The point, with rows of changes of the coefficients.
    pub fn point<'a>(&'a self, directions: &'a [f64]) -> Point<'a> {
        let Self { sought, values, nuisance, initial, .. } = self;
        Point { sought, values, directions, nuisance, initial }
    }

    /// One row per coefficient.
    pub fn axes(&self) -> Vec<f64> {
        let width = self.sought.len();
        (0..width * width).map(|at| f64::from(u8::from(at / width == at % width))).collect()
    }

    /// Every coefficient, nuisance parameter and initial condition.
    pub fn unknowns(&self) -> Vec<Unknown> {
        let directions = (0..self.sought.len()).map(Unknown::Direction);
        let nuisances = (0..NUISANCES).map(Unknown::Nuisance);
        directions.chain(nuisances).chain((0..INITIALS).map(Unknown::Initial)).collect()
    }

    /// What the segments show, and the derivatives of the channels `asked` for.
    pub fn sensitivities(&self, unknowns: &[Unknown], asked: &[usize]) -> Vec<Prediction> {
        let (axes, stop) = (self.axes(), AtomicBool::new(false));
        let found = self.batch().sensitivities(self.point(&axes), unknowns, asked, &stop);
        found.expect("nobody interrupts")
    }

    /// The number behind an unknown; of the first segment where each has its own.
    pub fn number(&mut self, unknown: Unknown) -> Vec<&mut f64> {
        match unknown {
            Unknown::Direction(i) => vec![&mut self.values[i]],
            Unknown::Nuisance(i) => self.nuisance.iter_mut().map(|row| &mut row[i]).collect(),
            Unknown::Initial(i) => self.initial.iter_mut().map(|row| &mut row[i]).collect(),
        }
    }

    /// What `compute` gives with an unknown moved by `step` up and down: central differences.
    pub fn quotient(&mut self, unknown: Unknown, step: f64, compute: impl Fn(&Self) -> Vec<f64>) -> Vec<f64> {
        let mut moved = |by: f64| {
            let before: Vec<f64> = self.number(unknown).iter().map(|x| **x).collect();
            self.number(unknown).into_iter().for_each(|x| *x += by);
            let found = compute(self);
            self.number(unknown).into_iter().zip(before).for_each(|(x, old)| *x = old);
            found
        };
        let (ahead, back) = (moved(step), moved(-step));
        ahead.iter().zip(&back).map(|(a, b)| (a - b) / (2.0 * step)).collect()
    }
}
