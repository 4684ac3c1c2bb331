//! A candidate's result is its own: of lane neighbours, batch size, order and threads independent.

use crate::scalars::candidates::Trials;
use seatrial::Error;
use seatrial::fit::criterion::{CHANNELS, Loss};
use std::sync::atomic::AtomicBool;

/// Number of candidates: two full vectors and a part of a third.
const COUNT: usize = 19;

/// The criteria of candidates given by their rows, one vector each.
fn errors(trials: &Trials, rows: &[&Vec<f64>]) -> Vec<Vec<u64>> {
    let values: Vec<f64> = rows.iter().flat_map(|row| row.iter().copied()).collect();
    let sums = trials
        .batch()
        .errors(trials.candidates(&values), Loss::Absolute, &AtomicBool::new(false))
        .expect("nobody interrupts");
    let width = trials.segments.len() * CHANNELS;
    sums.chunks(width).map(|chunk| chunk.iter().map(|x| x.to_bits()).collect()).collect()
}

// Results are compared bit by bit: the same operations on the same numbers.

#[test]
fn scalar_a_candidate_does_not_see_the_size_of_the_batch() {
    let trials = Trials::new(COUNT);
    let all: Vec<&Vec<f64>> = trials.rows.iter().collect();
    let together = errors(&trials, &all);
    for size in [1, 3, 8, 9] {
        let parts: Vec<Vec<u64>> = all.chunks(size).flat_map(|rows| errors(&trials, rows)).collect();
        assert_eq!(parts, together, "batches of {size}");
    }
}

#[test]
fn scalar_a_candidate_does_not_see_its_neighbours() {
    let trials = Trials::new(COUNT);
    let all: Vec<&Vec<f64>> = trials.rows.iter().collect();
    let together = errors(&trials, &all);
    let mut reversed = errors(&trials, &all.iter().rev().copied().collect::<Vec<_>>());
    reversed.reverse();
    assert_eq!(reversed, together);
    // Among neighbours that diverge, one of them not even a number.
    for wild in [1e6, f64::INFINITY, f64::NAN] {
        let mut bad = trials.rows[1].clone();
        bad[0] = wild;
        for (i, row) in all.iter().enumerate().take(3) {
            let company = errors(&trials, &[&bad, row, &bad, &bad]);
            assert_eq!(company[1], together[i], "candidate {i} beside {wild}");
        }
    }
}

#[test]
fn scalar_a_candidate_does_not_see_the_threads() {
    let trials = Trials::new(COUNT);
    let all: Vec<&Vec<f64>> = trials.rows.iter().collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| errors(&trials, &all))
    };
    let one = on(1);
    assert_eq!(on(2), one);
    assert_eq!(on(5), one);
}

#[test]
fn scalar_a_diverged_candidate_costs_infinity() {
    let trials = Trials::new(3);
    // Drag that drives, and an added mass that leaves no mass at all.
    for (column, value) in [(0, 1e6), (5, 500.0), (0, f64::NAN)] {
        let mut bad = trials.rows[1].clone();
        bad[column] = value;
        let sums = errors(&trials, &[&trials.rows[0], &bad, &trials.rows[2]]);
        // u counts in every segment.
        for segment in 0..trials.segments.len() {
            assert_eq!(f64::from_bits(sums[1][segment * CHANNELS]), f64::INFINITY, "{value}");
        }
        assert!(sums[1].iter().all(|bits| !f64::from_bits(*bits).is_nan()));
        assert!([&sums[0], &sums[2]].iter().all(|row| row.iter().all(|x| f64::from_bits(*x).is_finite())));
    }
}

#[test]
fn scalar_a_candidate_without_changes_is_the_vehicle_itself() {
    let trials = Trials::new(1);
    let stop = AtomicBool::new(false);
    let runs = trials.batch().tracks(trials.candidates(&trials.rows[0]), &stop).unwrap();
    for (s, run) in runs.iter().enumerate() {
        let itself = trials.batch().track(s, &stop).unwrap();
        for (a, b) in run.states.iter().zip(&itself.states) {
            let change = crate::vehicles::distance(&a.nu, &b.nu);
            // Lanes fuse products, f64 does not: rounding over 300 steps.
            assert!(
                change < 1e-9 && crate::vehicles::distance(&a.position, &b.position) < 1e-9,
                "{change:e}"
            );
        }
        for (a, b) in run.signals.iter().flatten().zip(itself.signals.iter().flatten()) {
            assert!((a - b).abs() < 1e-9);
        }
        for (a, b) in run.tau.iter().zip(&itself.tau) {
            assert!(crate::vehicles::distance(a, b) < 1e-9);
        }
    }
}

#[test]
fn an_interrupted_batch_says_so() {
    let trials = Trials::new(9);
    let values: Vec<f64> = trials.rows.iter().flatten().copied().collect();
    let stopped = AtomicBool::new(true);
    let result = trials.batch().errors(trials.candidates(&values), Loss::Absolute, &stopped);
    assert_eq!(result, Err(Error::Interrupted));
}
