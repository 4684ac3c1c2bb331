//! Every instruction set of this processor gives the same population, forced by `SEATRIAL_SIMD`.
//!
//! The variable is read by the process, so this test starts itself once per level.

use crate::candidates::Trials;
use seatrial::criterion::{CHANNELS, Loss};
use seatrial::real::lanes::{SIMD_VARIABLE, available_levels, level};
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

/// What the process prints under a value of the variable.
fn print_of(variable: &str) -> String {
    let this = std::env::current_exe().expect("the path of this test");
    let output = Command::new(this)
        .args(["--exact", "instruction_sets::population_of_this_process", "--ignored", "--nocapture"])
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

#[test]
fn scalar_instruction_sets_agree() {
    let populations: Vec<(&str, Vec<f64>)> = available_levels()
        .into_iter()
        .map(|(name, _)| {
            let print = print_of(name);
            assert!(print.contains(&format!("level {name}\n")), "{name} was not in force: {print}");
            (name, numbers(&print))
        })
        .collect();
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
    let fused: Vec<&Vec<f64>> =
        populations.iter().filter(|(name, _)| ["avx512", "avx2"].contains(name)).map(|(_, x)| x).collect();
    for pair in fused.windows(2) {
        // Bit by bit: both fuse the same products.
        assert!(pair[0].iter().zip(pair[1]).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn an_unknown_instruction_set_is_refused() {
    let print = print_of("avx1024");
    for part in ["refused", SIMD_VARIABLE, "avx1024", "fallback", "unset"] {
        assert!(print.contains(part), "expected {part:?} in {print:?}");
    }
}
