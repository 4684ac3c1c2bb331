//! What a vehicle's actuators can command, said honestly: before a gain is tuned for a row that nothing answers.
//!
//! The allocation matrix is weighed with what each actuator can give (`|b_ik| F_max,k`), forces over the
//! largest force row, moments over the largest moment row, so that newtons and newton metres compare. Its singular values
//! above [`PRACTICAL`] of the largest span what can be commanded in practice; those above [`NUMERICAL`] are its
//! numerical rank. A row's share is the part of a unit demand in it, and in it alone, that lies in that span: 1 can be commanded,
//! 0 cannot, between them it comes only with another row.
//!
//! Source: Fossen (2011), section 12.3; Taubert et al. (2014), equations 49, 50 (whose B⁻¹ does not exist).
//! Tests: `tests/allocation/report.rs`.

use super::minimum::Hold;
use super::reach::{Water, capabilities, is_unlimited, reach};
use super::singular_values::singular_values;
use crate::description::Description;
use crate::description::coefficients::FORCES;
use crate::model::vehicle::Vehicle;
use crate::number::algebra::{Mat6, Vec6};

/// Singular values below this share of the largest cannot be used in practice.
pub const PRACTICAL: f64 = 0.01;
/// Singular values below this share of the largest are the rounding of written directions.
pub const NUMERICAL: f64 = 1e-5;
/// A row with at least this share is commanded.
const WHOLE: f64 = 0.99;
const MOTIONS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// What the actuators can do in one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowAuthority {
    /// X Y Z K M N.
    pub row: &'static str,
    /// Whether the vehicle file lists it as controllable.
    pub controllable: bool,
    /// Share of a unit demand in this row alone while all six rows are held.
    pub share: f64,
    /// The same while only the controllable rows are held; zero for another row.
    pub controlled_share: f64,
    /// The row's own size over the largest singular value.
    pub size: f64,
    /// Largest wrench in positive and negative direction, N or N m.
    pub reach: [f64; 2],
}

/// What is left without one actuator.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Name of the actuator.
    pub actuator: String,
    /// Share per row while the controllable rows are held.
    pub share: Vec6<f64>,
    /// Largest wrench per row in positive and negative direction, N or N m.
    pub reach: [[f64; 2]; 6],
}

/// What a vehicle can command at a speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Authority {
    /// Speed through the water, m/s.
    pub speed: f64,
    /// Per row.
    pub rows: [RowAuthority; 6],
    /// Singular values of the six rows over the largest, descending.
    pub singular_values: Vec6<f64>,
    /// How many are above [`PRACTICAL`].
    pub rank: usize,
    /// How many are above [`NUMERICAL`].
    pub numerical_rank: usize,
    /// Without each actuator in turn.
    pub losses: Vec<Loss>,
}

/// The weighed rows of the allocation matrix and the forces at the speed.
struct Weighed {
    rows: [Vec<f64>; 6],
    wrench: Vec<Vec6<f64>>,
    /// Smallest and largest force per actuator, N.
    force: Vec<[f64; 2]>,
}

/// What the actuators of a described vehicle can command at a speed (m/s), ahead through still water. Where thrust
/// depends on the supply voltage, at the table's lowest one.
pub fn authority(description: &Description, speed: f64) -> Authority {
    let weighed = weighed(description, speed);
    let listed = FORCES.map(|force| description.file.controllable.iter().any(|row| row == force));
    let count = description.actuators.len();
    let (values, projection) = span(&weighed.rows, None);
    let (_, controlled) = span(&masked(&weighed.rows, &listed), None);
    let largest = values[0].max(f64::MIN_POSITIVE);
    let reaches = reaches(&weighed, None);
    let rows = std::array::from_fn(|i| RowAuthority {
        row: FORCES[i],
        controllable: listed[i],
        share: projection[i][i],
        controlled_share: controlled[i][i],
        size: weighed.rows[i].iter().map(|x| x * x).sum::<f64>().sqrt() / largest,
        reach: reaches[i],
    });
    let losses = (0..count).map(|lost| {
        let (_, left) = span(&masked(&weighed.rows, &listed), Some((lost, largest)));
        Loss {
            actuator: description.actuators[lost].name.clone(),
            share: std::array::from_fn(|i| left[i][i]),
            reach: self::reaches(&weighed, Some(lost)),
        }
    });
    let above = |least: f64| values.iter().filter(|value| **value > least * largest).count();
    Authority {
        speed,
        rows,
        singular_values: values.map(|value| value / largest),
        rank: above(PRACTICAL),
        numerical_rank: above(NUMERICAL),
        losses: losses.collect(),
    }
}

/// For each actuator, whether the others command every controllable row as well without it.
pub fn replaceable(description: &Description) -> Vec<bool> {
    let whole = authority(description, 1.0);
    let as_well = |loss: &Loss| {
        let rows = whole.rows.iter().zip(&loss.share);
        rows.filter(|(row, _)| row.controllable).all(|(row, &left)| left > WHOLE * row.controlled_share)
    };
    whole.losses.iter().map(as_well).collect()
}

fn weighed(description: &Description, speed: f64) -> Weighed {
    let vehicle = Vehicle::nominal(description);
    let holds: Vec<Hold> =
        description.actuators.iter().map(|actuator| Hold::new(&actuator.limits, [1.0, 0.5], 0.0)).collect();
    let mut strength = capabilities(description, &vehicle, &holds);
    strength[vehicle.actuators.len()..].iter_mut().for_each(|force| *force *= speed * speed);
    let nu_r = [speed, 0.0, 0.0, 0.0, 0.0, 0.0];
    let water = Water { nu_r: &nu_r, voltage: f64::NAN, fin_inflow: true };
    let force = holds.iter().enumerate().map(|(k, hold)| {
        let reach = reach(&vehicle, k, hold, &water);
        let unlimited = |side: usize| {
            is_unlimited(&description.actuators[k])
                && description.actuators[k].limits.maximum[side].is_infinite()
        };
        [
            if unlimited(1) { f64::NEG_INFINITY } else { reach.lowest },
            if unlimited(0) { f64::INFINITY } else { reach.highest },
        ]
    });
    let force = force.collect();
    let wrench: Vec<Vec6<f64>> = (0..holds.len()).map(|k| description.wrench(k)).collect();
    let size = |i: usize| wrench.iter().zip(&strength).map(|(b, f)| b[i].abs() * f).sum::<f64>();
    let largest = |rows: std::ops::Range<usize>| rows.map(size).fold(f64::MIN_POSITIVE, f64::max);
    let scale = [largest(0..3), largest(3..6)];
    let row = |i: usize| wrench.iter().zip(&strength).map(|(b, f)| b[i] * f / scale[i / 3]).collect();
    Weighed { rows: std::array::from_fn(row), wrench, force }
}

fn masked(rows: &[Vec<f64>; 6], listed: &[bool; 6]) -> [Vec<f64>; 6] {
    std::array::from_fn(|i| if listed[i] { rows[i].clone() } else { vec![0.0; rows[i].len()] })
}

/// Singular values, and the projection on the span of those that count; without the lost actuator, and against
/// the largest value of the whole vehicle.
fn span(rows: &[Vec<f64>; 6], lost: Option<(usize, f64)>) -> (Vec6<f64>, Mat6<f64>) {
    let mut rows = rows.clone();
    if let Some((lost, _)) = lost {
        rows.iter_mut().for_each(|row| row[lost] = 0.0);
    }
    let (values, u) = singular_values(&rows);
    let largest = lost.map_or(values[0], |(_, largest)| largest);
    let counts = |k: &usize| values[*k] > PRACTICAL * largest && values[*k] > 0.0;
    let entry = |i: usize, j: usize| (0..6).filter(counts).map(|k| u[i][k] * u[j][k]).sum();
    (values, std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))))
}

/// The largest wrench per row in both directions; of a single row the sum over the actuators is exact.
fn reaches(weighed: &Weighed, lost: Option<usize>) -> [[f64; 2]; 6] {
    let mut reach = [[0.0; 2]; 6];
    for (k, (b, force)) in weighed.wrench.iter().zip(&weighed.force).enumerate() {
        for i in (0..6).filter(|&i| lost != Some(k) && b[i].abs() > 1e-9) {
            let ends = [b[i] * force[0], b[i] * force[1]];
            reach[i][0] += ends[0].max(ends[1]);
            reach[i][1] += ends[0].min(ends[1]);
        }
    }
    reach
}

impl Authority {
    /// The rows that are controllable by the file and by the actuators.
    pub fn commanded(&self) -> Vec<&'static str> {
        self.rows.iter().filter(|row| row.controlled_share >= WHOLE).map(|row| row.row).collect()
    }

    /// The report in words, a sentence each.
    pub fn sentences(&self) -> Vec<String> {
        let commanded: Vec<usize> = (0..6).filter(|&i| self.rows[i].controlled_share >= WHOLE).collect();
        let mut said = vec![match commanded.len() {
            0 => format!("At {} m/s no row can be commanded.", self.speed),
            _ => format!(
                "At {} m/s {} can be commanded; the allocation matrix has rank {} of 6{}.",
                self.speed,
                listed(&commanded),
                self.rank,
                if self.numerical_rank > self.rank {
                    format!(" ({} with singular values below 1 % of the largest)", self.numerical_rank)
                } else {
                    String::new()
                }
            ),
        }];
        for (i, row) in self.rows.iter().enumerate().filter(|(i, _)| !commanded.contains(i)) {
            let name = row.row;
            said.push(if row.size == 0.0 {
                format!("{name} cannot be commanded: no actuator acts in {}.", MOTIONS[i])
            } else if row.size < PRACTICAL {
                format!("{name} cannot be commanded: singular value {:.4} of the largest.", row.size)
            } else if row.share < WHOLE && row.controlled_share < WHOLE {
                format!(
                    "{name} cannot be commanded by itself: the actuators produce it only together with other \
                     motions. How much of a demand in {name} alone they meet is up to the priorities of the \
                     autopilot's allocation."
                )
            } else {
                format!("{name} could be commanded, but the vehicle file does not list it as controllable.")
            });
        }
        for loss in &self.losses {
            let (remain, gone): (Vec<usize>, Vec<usize>) =
                commanded.iter().partition(|&&i| loss.share[i] >= WHOLE);
            said.push(match (remain.is_empty(), gone.is_empty()) {
                (_, true) if remain.is_empty() => continue,
                (_, true) => {
                    format!("All of {} remain after the loss of {}.", listed(&remain), loss.actuator)
                }
                (true, _) => format!("Nothing remains after the loss of {}.", loss.actuator),
                _ => format!(
                    "After the loss of {} {} cannot be commanded; {} can.",
                    loss.actuator,
                    listed(&gone),
                    listed(&remain)
                ),
            });
        }
        said
    }
}

/// "surge, pitch and yaw".
fn listed(rows: &[usize]) -> String {
    let names: Vec<&str> = rows.iter().map(|&i| MOTIONS[i]).collect();
    match names.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => names.concat(),
    }
}
