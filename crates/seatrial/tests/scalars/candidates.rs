//! A population of CWolf candidates and the trials that they fly.

use crate::vehicles::{load, moving, times};
use seatrial::description::Description;
use seatrial::fit::batch::{Batch, Candidates};
use seatrial::fit::inputs::{Inputs, modes};
use seatrial::fit::record::{MotorStart, Record, Segment};

/// Sought coefficients and the relative spread of the candidates.
const SOUGHT: [(&str, f64); 12] = [
    ("X_uu", 0.5),
    ("Y_vv", 0.5),
    ("N_rr", 0.3),
    ("N_uv", 0.2),
    ("z_b", 0.5),
    ("X_udot", 0.9),
    ("SbU.gain", 0.2),
    ("PL.T_t", 0.9),
    ("SbL.T_1", 0.9),
    ("VTB.K_V", 0.1),
    ("PU.n_acc", 0.5),
    ("SbU.p2", 0.5),
];

/// Vehicle, trials, segments and candidates, owned.
pub struct Trials {
    /// The vehicle.
    pub description: Description,
    /// Two trials.
    pub records: Vec<Record>,
    /// Parts of them, with motors as recorded or held.
    pub segments: Vec<Segment>,
    /// Indices of the sought coefficients.
    pub sought: Vec<usize>,
    /// Row per candidate.
    pub rows: Vec<Vec<f64>>,
}

/// A number in [-1, 1] that looks random.
fn noise(seed: usize) -> f64 {
    (12.9898 * seed as f64 + 0.5).sin()
}

/// The inputs of trial `which`, 15 s at 10 Hz.
pub fn inputs(which: usize) -> Inputs {
    let n = 151;
    let command = |actuator: usize| {
        (0..n).map(|k| (1200.0 * noise(100 * which + 7 * actuator + k / 25)).round()).collect::<Vec<f64>>()
    };
    let names = ["SbU", "SbL", "PU", "PL", "VTB", "VTS"];
    Inputs {
        t: times(n, 0.1),
        commands: names.iter().enumerate().map(|(i, name)| (name.to_string(), command(i))).collect(),
        current: (0..n).map(|k| [0.2, 0.001 * k as f64, 0.0]).collect(),
        observed: (0..n)
            .map(|k| std::array::from_fn(|c| noise(k + c) * if c < 9 { 1.0 } else { 3.0 }))
            .collect(),
        weight: (0..n).map(|k| std::array::from_fn(|c| if (k + c) % 5 == 0 { 0.0 } else { 1.0 })).collect(),
        rho: Some(if which == 0 { 1000.0 } else { 1025.0 }),
        ..Inputs::default()
    }
}

impl Trials {
    /// `count` candidates, the first of which is CWolf itself.
    pub fn new(count: usize) -> Self {
        let description = load("cwolf");
        let sought: Vec<usize> =
            SOUGHT.iter().map(|(name, _)| description.layout.find(name).expect("a known name")).collect();
        let row = |candidate: usize| {
            let value = |(i, (_, spread)): (usize, &(&str, f64))| {
                let change = if candidate == 0 { 0.0 } else { spread * noise(31 * candidate + i) };
                description.coefficients[sought[i]] * (1.0 + change)
            };
            SOUGHT.iter().enumerate().map(value).collect()
        };
        let rows = (0..count).map(row).collect();
        let records =
            (0..2).map(|which| inputs(which).record(&description, false, 1).expect("valid inputs")).collect();
        let state = moving([1.0, 0.1, -0.05, 0.02, 0.05, -0.1]);
        let segment =
            |record, start, stop, motors| Segment { record, start, stop, state, current: [0.0; 3], motors };
        let segments = vec![
            segment(0, 0, 151, MotorStart::Held(vec![300.0, 0.0, -200.0, 0.0, 150.0, 0.0])),
            segment(0, 40, 120, MotorStart::Recorded),
            segment(1, 10, 151, MotorStart::Recorded),
        ];
        Self { description, records, segments, sought, rows }
    }

    /// The batch of the trials with all axes free, in two steps per sample.
    pub fn batch(&self) -> Batch<'_> {
        Batch {
            description: &self.description,
            records: &self.records,
            segments: &self.segments,
            modes: modes("XYZKMN", "").expect("axes"),
            substeps: 2,
        }
    }

    /// Candidates from their rows in one piece.
    pub fn candidates<'a>(&'a self, values: &'a [f64]) -> Candidates<'a> {
        Candidates { sought: &self.sought, values, count: values.len() / self.sought.len() }
    }
}
