//! Random numbers without a state.

use fearless_simd::{Simd, SimdFrom, dispatch, f64x8};
use seatrial::number::lanes::{LANES, available_levels};
use seatrial::number::random::{Noise, Seed, gaussian, gaussians, uniform};

#[test]
fn law_random_numbers_have_their_moments() {
    let n = 200_000;
    let normal: Vec<f64> = (0..n).map(|k| gaussian(7.0, k, 3)).collect();
    let moment = |p: i32| normal.iter().map(|x| x.powi(p)).sum::<f64>() / n as f64;
    let sigma = 1.0 / (n as f64).sqrt();
    assert!(moment(1).abs() < 5.0 * sigma);
    assert!((moment(2) - 1.0).abs() < 5.0 * 2f64.sqrt() * sigma); // variance of x² is 2
    assert!((moment(4) - 3.0).abs() < 5.0 * 96f64.sqrt() * sigma); // variance of x⁴ is 96
    let even: Vec<f64> = (0..n).map(|k| uniform(7.0, k, 3)).collect();
    assert!((even.iter().sum::<f64>() / n as f64 - 0.5).abs() < 5.0 * sigma / 12f64.sqrt());
    assert!(even.iter().all(|x| 0.0 < *x && *x < 1.0));
}

#[test]
fn law_random_numbers_of_other_seeds_steps_and_places_are_unrelated() {
    let n = 100_000;
    let limit = 5.0 / (n as f64).sqrt();
    let correlation = |f: &dyn Fn(usize) -> (f64, f64)| {
        (0..n)
            .map(|k| {
                let (a, b) = f(k);
                a * b
            })
            .sum::<f64>()
            / n as f64
    };
    assert!(correlation(&|k| (gaussian(1.0, k, 0), gaussian(2.0, k, 0))).abs() < limit);
    assert!(correlation(&|k| (gaussian(1.0, k, 0), gaussian(1.0, k + 1, 0))).abs() < limit);
    assert!(correlation(&|k| (gaussian(1.0, k, 0), gaussian(1.0, k, 1))).abs() < limit);
    assert!(correlation(&|k| (gaussian(k as f64, 0, 0), gaussian(k as f64 + 1.0, 0, 0))).abs() < limit);
}

#[test]
fn law_noise_hands_out_both_numbers_of_a_draw() {
    let n = 100_000;
    let mut noise = Noise::<f64, 2>::new(7.0, 3);
    let values: Vec<[f64; 2]> = (0..n).map(|k| [noise.next(0, k), noise.next(1, k)]).collect();
    let mean = |of: &dyn Fn(usize) -> f64| (0..n - 1).map(of).sum::<f64>() / n as f64;
    let limit = 5.0 / (n as f64).sqrt();
    assert!(mean(&|k| values[k][0]).abs() < limit);
    assert!((mean(&|k| values[k][0].powi(2)) - 1.0).abs() < limit * 2f64.sqrt());
    assert!((mean(&|k| values[k][0].powi(4)) - 3.0).abs() < limit * 96f64.sqrt());
    // The two of a draw, samples that follow one another, and places that do.
    assert!(mean(&|k| values[k][0] * values[k + 1][0]).abs() < limit);
    assert!(mean(&|k| values[k][0].powi(2) * values[k + 1][0].powi(2) - 1.0).abs() < limit * 8f64.sqrt());
    assert!(mean(&|k| values[k][0] * values[k][1]).abs() < limit);
    assert_eq!((values[0][0], values[1][0]), gaussians(7.0, 0, 3));
    assert_eq!(values[4][1], gaussian(7.0, 2, 4));
}

/// Numbers of eight seeds abreast.
#[inline(always)]
fn abreast<S: Simd>(simd: S, seeds: &[f64; LANES], step: usize) -> [[f64; LANES]; 2] {
    let (a, b) = gaussians(f64x8::simd_from(simd, *seeds), step, 5);
    [a.into(), b.into()]
}

#[test]
fn scalar_random_numbers_in_lanes_are_those_of_each_seed() {
    for (name, level) in available_levels() {
        for step in 0..200 {
            for seeds in [[3.0; LANES], std::array::from_fn(|k| (k * 7 + step) as f64)] {
                let [a, b] = dispatch!(level, simd => abreast(simd, &seeds, step));
                for lane in 0..LANES {
                    let (x, y) = gaussians(seeds[lane], step, 5);
                    // Logarithm, root and cosine of two units in the last place each, and a product.
                    let apart = (a[lane] - x).abs().max((b[lane] - y).abs());
                    assert!(apart < 1e-14, "{name}, {step}, lane {lane}: {apart:e}");
                }
            }
        }
    }
}

/// Evenly distributed numbers of eight seeds abreast.
#[inline(always)]
fn even<S: Simd>(simd: S, seeds: &[f64; LANES], step: usize) -> [[f64; LANES]; 2] {
    let (a, b) = Seed::new(f64x8::simd_from(simd, *seeds)).two_uniforms(step, 5);
    [a.into(), b.into()]
}

#[test]
fn scalar_hash_in_lanes_is_that_of_each_seed_bit_by_bit() {
    for (name, level) in available_levels() {
        for step in (0..200).chain([usize::MAX]) {
            // Seeds up to the largest, 2⁵³ − 1.
            let seeds: [f64; LANES] = std::array::from_fn(|k| ((1u64 << (7 * k + 4)) - 1) as f64);
            let [a, b] = dispatch!(level, simd => even(simd, &seeds, step));
            for lane in 0..LANES {
                let alone = Seed::new(seeds[lane]).two_uniforms(step, 5);
                assert_eq!((a[lane], b[lane]), alone, "{name}, step {step}, lane {lane}");
            }
        }
    }
}
