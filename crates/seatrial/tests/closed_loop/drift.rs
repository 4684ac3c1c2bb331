//! The slow current is the trend and the random walk that it says.

use seatrial::flight::drift::Drift;
use seatrial::model::current::Current;

const DT_S: f64 = 0.1;

/// Velocities of the first axis over the periods.
fn record(drift: &mut Drift<f64>, periods: usize) -> Vec<f64> {
    let at = |drift: &Drift<f64>, time: f64| {
        let mut current = Current { velocity: [0.0; 3], rate: [0.0; 3], pressed: None };
        drift.add(time, &mut current);
        current
    };
    let mut end = 0.0;
    (0..periods)
        .map(|k| {
            drift.begin(k);
            let (now, next) = (at(drift, 0.0), at(drift, DT_S));
            assert!((now.velocity[0] - end).abs() < 1e-12, "continuous");
            assert!((next.velocity[0] - now.velocity[0] - DT_S * now.rate[0]).abs() < 1e-12, "its rate");
            end = next.velocity[0];
            now.velocity[0]
        })
        .collect()
}

#[test]
fn law_a_random_walk_spreads_with_the_root_of_time() {
    let walk = 0.1 / 60.0;
    let records: Vec<Vec<f64>> = (0..1000)
        .map(|seed| record(&mut Drift::new([0.0; 3], [walk, 0.0, 0.0], f64::from(seed), DT_S), 4001))
        .collect();
    for k in [100, 1000, 4000] {
        let variance = records.iter().map(|r| r[k].powi(2)).sum::<f64>() / 1000.0;
        let wanted = walk * walk * DT_S * k as f64;
        // Five standard errors of a variance of 1000 values.
        assert!((variance / wanted - 1.0).abs() < 5.0 * (2.0f64 / 1000.0).sqrt(), "{k}: {variance} {wanted}");
    }
    // What comes does not know what was.
    let product = records.iter().map(|r| r[1000] * (r[2000] - r[1000])).sum::<f64>() / 1000.0;
    assert!(product.abs() < 5.0 * walk * walk * 100.0 / 1000f64.sqrt(), "{product}");
}

#[test]
fn a_trend_grows_with_time_and_no_seed() {
    let mut drift = Drift::new([1e-4, 0.0, 0.0], [0.0; 3], 1.0, DT_S);
    let record = record(&mut drift, 1001);
    assert!((record[1000] - 0.01).abs() < 1e-12, "{}", record[1000]);
    assert!(drift.moves());
    assert!(!Drift::new([0.0; 3], [0.0; 3], 1.0, DT_S).moves());
}
