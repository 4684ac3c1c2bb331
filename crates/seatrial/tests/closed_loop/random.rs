//! Random numbers without a state.

use seatrial::number::random::{gaussian, uniform};

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
