//! The turbulent current is the process that it says, and moves the vehicle as water does.

use crate::closed_loop::flights::{Trip, case, column};
use seatrial::flight::turbulence::Turbulence;
use seatrial::model::kinematics::{from_euler, rotation};

const TAU_S: f64 = 20.0;
const TAU_2_S: f64 = 2.0;
const DT_S: f64 = 0.1;

/// Velocities of the first axis over the periods.
fn record(seed: f64, periods: usize) -> Vec<f64> {
    let mut current = Turbulence::new(([0.3, 0.0, 0.0], [0.1, 0.1, 0.0]), [TAU_S, TAU_2_S], seed, DT_S);
    (0..periods).map(|k| current.begin(k).expect("it moves").velocity[0]).collect()
}

#[test]
fn law_turbulence_has_its_mean_deviation_and_memory() {
    // 400 records of 200 s: about 4000 independent values.
    let records: Vec<Vec<f64>> = (0..400).map(|seed| record(f64::from(seed), 2000)).collect();
    let mean_of = |read: &dyn Fn(&[f64]) -> f64| records.iter().map(|r| read(r)).sum::<f64>() / 400.0;
    let mean = mean_of(&|r| r.iter().sum::<f64>() / r.len() as f64);
    // Three standard errors of 4000 independent values of 0.1.
    assert!((mean - 0.3).abs() < 3.0 * 0.1 / 4000f64.sqrt(), "{mean}");
    let lagged = |lag: usize| {
        mean_of(&|r| {
            let n = r.len() - lag;
            (0..n).map(|i| (r[i] - 0.3) * (r[i + lag] - 0.3)).sum::<f64>() / n as f64
        })
    };
    let variance = lagged(0);
    // Standard error 2 %; the step of a period biases it by far less.
    assert!((variance.sqrt() - 0.1).abs() < 0.005, "{}", variance.sqrt());
    // Two lags in a row: (τ e^(-t/τ) - τ_2 e^(-t/τ_2))/(τ - τ_2).
    for seconds in [2.0f64, 10.0, 20.0] {
        let wanted =
            (TAU_S * (-seconds / TAU_S).exp() - TAU_2_S * (-seconds / TAU_2_S).exp()) / (TAU_S - TAU_2_S);
        let found = lagged((seconds / DT_S) as usize) / variance;
        assert!((found - wanted).abs() < 0.06, "{seconds} s: {found} {wanted}");
    }
    // It begins in its stationary distribution.
    let first = (records.iter().map(|r| (r[0] - 0.3).powi(2)).sum::<f64>() / 400.0).sqrt();
    assert!((first - 0.1).abs() < 0.012, "{first}");
}

#[test]
fn law_turbulence_is_stationary_and_its_axes_and_seeds_know_nothing_of_each_other() {
    let (sigma, seeds) = ([0.1, 0.05, 0.02], 3000);
    // Values of all axes over standard deviation, soon after the start and later.
    let at = [0, 5, 20, 100, 400];
    let values: Vec<Vec<[f64; 3]>> = (0..seeds)
        .map(|seed| {
            let mut current = Turbulence::new(([0.0; 3], sigma), [TAU_S, TAU_2_S], f64::from(seed), DT_S);
            let all = (0..=400).map(|k| current.begin(k).expect("it moves").velocity);
            let all: Vec<[f64; 3]> = all.collect();
            at.iter().map(|&k| std::array::from_fn(|i| all[k][i] / sigma[i])).collect()
        })
        .collect();
    // Five standard errors: of a mean of products of independent values, and of a mean square.
    let (cross, square) = (5.0 / f64::from(seeds).sqrt(), 5.0 * (2.0 / f64::from(seeds)).sqrt());
    let mean = |of: &dyn Fn(usize) -> f64| (0..seeds as usize).map(of).sum::<f64>() / f64::from(seeds);
    for place in 0..at.len() {
        for i in 0..3 {
            let variance = mean(&|s| values[s][place][i].powi(2));
            assert!((variance - 1.0).abs() < square, "axis {i} after {} periods: {variance}", at[place]);
            let others = mean(&|s| values[s][place][i] * values[s][place][(i + 1) % 3]);
            assert!(others.abs() < cross, "axes {i} and the next: {others}");
            let next = mean(&|s| values[s][place][i] * values[(s + 1) % seeds as usize][place][i]);
            assert!(next.abs() < cross, "a seed and the next: {next}");
        }
    }
}

#[test]
fn turbulence_is_continuous_with_the_rate_that_it_says() {
    let mut current = Turbulence::new(([0.0; 3], [0.1, 0.05, 0.02]), [TAU_S, TAU_2_S], 7.0, DT_S);
    let mut end: Option<[f64; 3]> = None;
    for k in 0..50 {
        let begin = current.begin(k).expect("it moves");
        if let Some(end) = end {
            for axis in 0..3 {
                assert!((begin.velocity[axis] - end[axis]).abs() < 1e-12);
            }
        }
        let middle = current.at(0.5 * DT_S).expect("it moves");
        for axis in 0..3 {
            let moved = begin.velocity[axis] + 0.5 * DT_S * begin.rate[axis];
            assert!((middle.velocity[axis] - moved).abs() < 1e-15);
        }
        end = Some(current.at(DT_S).expect("it moves").velocity);
    }
}

#[test]
fn law_the_water_of_a_flight_is_that_of_its_seed() {
    let mut trip = Trip::cwolf(crate::closed_loop::flights::DIVE);
    trip.seconds = 60.0;
    let (mean, sigma) = ([0.2, -0.1, 0.0], [0.05, 0.08, 0.01]);
    let mut rough = case(mean);
    rough.turbulence = sigma;
    // A neighbour with other water, so that eight lanes fly.
    let flown = trip.fly(&[rough, case([0.0; 3])]).remove(0);
    let of = |names: [&str; 3]| names.map(|name| column(&trip, &flown, name));
    let (ground, water, angles) =
        (of(["u", "v", "w"]), of(["u_water", "v_water", "w_water"]), of(["roll", "pitch", "yaw"]));
    // The seed and the time constants of the flights to test with.
    let mut current = Turbulence::new((mean, sigma), [60.0, 2.0], 1.0, DT_S);
    for k in 0..ground[0].len() {
        let wanted = current.begin(k).expect("it moves").velocity;
        let r = rotation(&from_euler(&angles.each_ref().map(|a| a[k])));
        let drift: [f64; 3] = std::array::from_fn(|i| ground[i][k] - water[i][k]);
        for (row, wanted) in r.iter().zip(wanted) {
            let found: f64 = row.iter().zip(drift).map(|(a, b)| a * b).sum();
            // Lanes round otherwise than plain numbers do.
            assert!((found - wanted).abs() < 1e-9, "{k}: {found} {wanted}");
        }
    }
}
