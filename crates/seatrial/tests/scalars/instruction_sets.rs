//! Every instruction set of this processor gives the same population and the same derivatives, forced by
//! `SEATRIAL_SIMD`.
//!
//! The variable is read by the process, so these tests start themselves once per level.

use crate::scalars::candidates::Trials;
use crate::scalars::flights::{Flights, NAMES};
use seatrial::fit::criterion::{CHANNELS, Loss};
use seatrial::number::lanes::{SIMD_VARIABLE, available_levels, level};
use std::process::Command;
use std::sync::atomic::AtomicBool;

/// Two vectors and a half; the last candidate diverges.
const COUNT: usize = 20;

#[test]
#[ignore = "started by the tests below, once per instruction set"]
fn population_of_this_process() {
    let name = match level() {
        Ok((name, _)) => name,
        Err(error) => {
            println!("\nrefused {error}");
            return;
        }
    };
    let mut trials = Trials::new(COUNT);
    trials.rows[COUNT - 1][0] = 1e6;
    let values: Vec<f64> = trials.rows.iter().flatten().copied().collect();
    let stop = AtomicBool::new(false);
    let sums = trials.batch().errors(trials.candidates(&values), Loss::Absolute, &stop).unwrap();
    let runs = trials.batch().tracks(trials.candidates(&values), &stop).unwrap();
    let ends = runs.iter().flat_map(|run| {
        let state = run.states[run.states.len() - 1];
        state.position.into_iter().chain(state.attitude).chain(state.nu).chain(run.tau[run.tau.len() - 1])
    });
    println!("\nlevel {name}");
    for x in sums.into_iter().chain(ends) {
        println!("bits {:016x}", x.to_bits());
    }
}

#[test]
#[ignore = "started by the tests below, once per instruction set"]
fn derivatives_of_this_process() {
    println!("\nlevel {}", level().expect("an available level").0);
    for name in NAMES {
        let flights = Flights::disturbed(name);
        let unknowns = flights.unknowns();
        for segment in flights.sensitivities(&unknowns, &[0, 3, 7, 11]) {
            // The end of the flight has seen all of it.
            for x in &segment.jacobian[segment.jacobian.len() - 4 * unknowns.len()..] {
                println!("bits {:016x}", x.to_bits());
            }
        }
    }
}

/// What a test prints in a process of its own, under a value of the variable.
fn print_of(test: &str, variable: &str) -> String {
    let this = std::env::current_exe().expect("the path of this test");
    let output = Command::new(this)
        .args(["--exact", &format!("scalars::instruction_sets::{test}"), "--ignored", "--nocapture"])
        .env(SIMD_VARIABLE, variable)
        .output()
        .expect("this test starts itself");
    assert!(output.status.success(), "{variable}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The numbers of a population.
fn numbers(print: &str) -> Vec<f64> {
    let bits = print.lines().filter_map(|line| line.strip_prefix("bits "));
    bits.map(|hex| f64::from_bits(u64::from_str_radix(hex, 16).expect("hexadecimal"))).collect()
}

/// The numbers that a test prints on every instruction set, the fallback's last.
fn on_every_level(test: &str) -> Vec<(&'static str, Vec<f64>)> {
    let numbers = |(name, _)| {
        let print = print_of(test, name);
        assert!(print.contains(&format!("level {name}\n")), "{name} was not in force: {print}");
        (name, numbers(&print))
    };
    available_levels().into_iter().map(numbers).collect()
}

/// Asserts that all levels with fused products gave the same numbers, bit by bit: both fuse the same ones.
fn fused_ones_equal(found: &[(&str, Vec<f64>)]) {
    let fused: Vec<&Vec<f64>> =
        found.iter().filter(|(name, _)| ["avx512", "avx2"].contains(name)).map(|(_, x)| x).collect();
    for pair in fused.windows(2) {
        assert!(pair[0].iter().zip(pair[1]).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn scalar_instruction_sets_agree() {
    let populations = on_every_level("population_of_this_process");
    let criteria = COUNT * 3 * CHANNELS;
    let (_, reference) = populations.last().expect("the fallback is always there");
    assert_eq!(reference.len(), criteria + COUNT * 3 * 19);
    for (name, found) in &populations {
        for (i, (a, b)) in found.iter().zip(reference).enumerate() {
            let diverged = i < criteria && i / (3 * CHANNELS) == COUNT - 1
                || i >= criteria && (i - criteria) / (3 * 19) == COUNT - 1;
            if diverged {
                // Infinity and not-a-number may come a step apart; the criterion of u may not.
                assert!(i >= criteria || !i.is_multiple_of(CHANNELS) || a.is_infinite() && b.is_infinite());
                continue;
            }
            // Rounding over 300 steps: the fused product is the only difference.
            assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()), "{name}, number {i}: {a} against {b}");
        }
    }
    fused_ones_equal(&populations);
}

#[test]
fn scalar_derivatives_of_all_instruction_sets_agree() {
    let found = on_every_level("derivatives_of_this_process");
    let (_, reference) = found.last().expect("the fallback is always there");
    assert!(reference.len() > 3 * 2 * 4 * 150);
    for (name, numbers) in &found {
        for (i, (a, b)) in numbers.iter().zip(reference).enumerate() {
            // Rounding over 60 steps: the partials' fused products are the only difference.
            assert!((a - b).abs() <= 1e-10 * (1.0 + b.abs()), "{name}, number {i}: {a} against {b}");
        }
    }
    fused_ones_equal(&found);
}

#[test]
fn an_unknown_instruction_set_is_refused() {
    let print = print_of("population_of_this_process", "avx1024");
    for part in ["refused", SIMD_VARIABLE, "avx1024", "fallback", "unset"] {
        assert!(print.contains(part), "expected {part:?} in {print:?}");
    }
}
