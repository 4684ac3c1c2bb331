//! Every instruction set of this processor flies the same flights, forced by `SEATRIAL_SIMD`, which the process reads:
//! the test starts itself once per level.

use crate::closed_loop::batch::{cases, course, trip};
use seatrial::number::lanes::{SIMD_VARIABLE, available_levels};
use std::process::Command;

#[test]
#[ignore = "started by the test below, once per instruction set"]
fn flights_of_this_process() {
    let trip = trip();
    let (all, coefficients, tunables) = cases(&trip);
    for outcome in trip.fly_with(&all, &coefficients, &tunables) {
        for x in course(&trip, &outcome).into_iter().step_by(97) {
            println!("bits {:016x}", x.to_bits());
        }
    }
}

fn numbers(level: &str) -> Vec<f64> {
    let this = std::env::current_exe().expect("the path of this test");
    let output = Command::new(this)
        .args([
            "--exact",
            "closed_loop::instruction_sets::flights_of_this_process",
            "--ignored",
            "--nocapture",
        ])
        .env(SIMD_VARIABLE, level)
        .output()
        .expect("this test starts itself");
    assert!(output.status.success(), "{level}: {}", String::from_utf8_lossy(&output.stderr));
    let print = String::from_utf8(output.stdout).expect("text");
    let bits = print.lines().filter_map(|line| line.strip_prefix("bits "));
    bits.map(|hex| f64::from_bits(u64::from_str_radix(hex, 16).expect("hexadecimal"))).collect()
}

#[test]
fn scalar_closed_loop_instruction_sets_agree() {
    let found: Vec<(&str, Vec<f64>)> =
        available_levels().into_iter().map(|(name, _)| (name, numbers(name))).collect();
    let (_, reference) = found.last().expect("the fallback is always there");
    assert!(reference.len() > 400);
    for (name, numbers) in &found {
        assert_eq!(numbers.len(), reference.len());
        for (a, b) in numbers.iter().zip(reference) {
            // Fused products are the only difference, and the closed loop damps it.
            assert!((a - b).abs() < 1e-7, "{name}: {a} against {b}");
        }
    }
    let fused = found.iter().filter(|(name, _)| ["avx512", "avx2"].contains(name));
    let fused: Vec<&Vec<f64>> = fused.map(|(_, numbers)| numbers).collect();
    for pair in fused.windows(2) {
        assert!(pair[0].iter().zip(pair[1]).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
