//! The criterion that accumulates is the sum over the run, and masked samples do not matter.

use crate::scalars::candidates::{Trials, inputs};
use seatrial::fit::criterion::{CHANNELS, Loss, channels};
use seatrial::fit::record::Record;
use seatrial::number::real::Real;
use std::sync::atomic::AtomicBool;

/// The loss by its definition.
fn loss_of(loss: Loss, error: f64) -> f64 {
    match loss {
        Loss::Absolute => error.abs(),
        Loss::Squared => error.powi(2),
        Loss::Huber(knee) if error.abs() < knee => error.powi(2) / (2.0 * knee),
        Loss::Huber(knee) => error.abs() - knee / 2.0,
    }
}

#[test]
fn scalar_criterion_is_the_sum_over_the_run() {
    let trials = Trials::new(9);
    let values: Vec<f64> = trials.rows.iter().flatten().copied().collect();
    let stop = AtomicBool::new(false);
    let runs = trials.batch().tracks(trials.candidates(&values), &stop).unwrap();
    for loss in [Loss::Absolute, Loss::Squared, Loss::Huber(0.4)] {
        let sums = trials.batch().errors(trials.candidates(&values), loss, &stop).unwrap();
        for (i, run) in runs.iter().enumerate() {
            let segment = &trials.segments[i % trials.segments.len()];
            let record = &trials.records[segment.record];
            let mut expected = [0.0; CHANNELS];
            // The first sample is the given state: it does not count.
            for k in segment.start + 1..segment.stop {
                let simulated = channels(&run.states[k - segment.start]);
                for c in 0..CHANNELS {
                    let error = record.observed[k][c] - simulated[c];
                    let error = if c < 9 { error } else { error.wrap() };
                    expected[c] += loss_of(loss, record.weight[k][c] * error);
                }
            }
            for c in 0..CHANNELS {
                let found = sums[i * CHANNELS + c];
                // Rounding of the angles through the arctangent, over 150 samples.
                assert!((found - expected[c]).abs() < 1e-9 * (1.0 + expected[c]), "{found} {}", expected[c]);
            }
        }
    }
}

/// The sums of one candidate on the first trial with other measurements.
fn sums(observed: Vec<[f64; CHANNELS]>, weight: Vec<[f64; CHANNELS]>) -> Vec<f64> {
    let mut trials = Trials::new(1);
    let measured = seatrial::fit::inputs::Inputs { observed, weight, ..inputs(0) };
    let record: Record = measured.record(&trials.description, false, 1).unwrap();
    trials.records[0] = record;
    let stop = AtomicBool::new(false);
    trials.batch().errors(trials.candidates(&trials.rows[0]), Loss::Absolute, &stop).unwrap()
}

#[test]
fn scalar_masked_samples_do_not_matter() {
    let given = inputs(0);
    let expected = sums(given.observed.clone(), given.weight.clone());
    for junk in [f64::NAN, f64::INFINITY, 1e300] {
        let mut observed = given.observed.clone();
        for (row, weight) in observed.iter_mut().zip(&given.weight) {
            for c in 0..CHANNELS {
                if weight[c] == 0.0 {
                    row[c] = junk;
                }
            }
        }
        // Bit by bit: the masked samples add a zero.
        assert_eq!(sums(observed, given.weight.clone()), expected, "{junk}");
    }
}

#[test]
fn scalar_a_channel_without_weight_costs_nothing() {
    let given = inputs(0);
    let unweighted: Vec<[f64; CHANNELS]> = given
        .weight
        .iter()
        .map(|row| std::array::from_fn(|c| if c == 2 || c >= 9 { 0.0 } else { row[c] }))
        .collect();
    let all = sums(given.observed.clone(), given.weight);
    let some = sums(vec![[f64::NAN; CHANNELS]; 0].into_iter().chain(given.observed).collect(), unweighted);
    for c in 0..CHANNELS {
        assert_eq!(some[c], if c == 2 || c >= 9 { 0.0 } else { all[c] }, "channel {c}");
    }
}

#[test]
fn a_measurement_that_counts_must_be_a_number() {
    let mut given = inputs(0);
    given.observed[7][3] = f64::NAN;
    given.weight[7][3] = 1.0;
    let description = Trials::new(1).description;
    let message = given.record(&description, false, 1).unwrap_err().to_string();
    assert!(["finite", "row 7", "channel p"].iter().all(|part| message.contains(part)), "{message}");
}
