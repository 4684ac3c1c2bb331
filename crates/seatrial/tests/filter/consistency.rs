//! What the covariance says against what the errors are: NEES and NIS over fifty runs of a vehicle that obeys the model.

use crate::vehicles::load;
use seatrial::description::Description;
use seatrial::filter::error_state::ErrorState;
use seatrial::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use seatrial::filter::innovation::{Gate, Watch};
use seatrial::filter::observation::Observation;
use seatrial::filter::process::Process;
use seatrial::filter::transition::Transition;
use seatrial::model::drive::act;
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::random::gaussian;

const DT: f64 = 0.1;
const STEPS: usize = 150;
const RUNS: usize = 50;

/// Deviations at the start and of the noise of a step.
fn deviations() -> ([f64; STATES], [f64; STATES]) {
    let (mut start, mut noise) = ([0.0; STATES], [0.0; STATES]);
    for i in 0..3 {
        start[POSITION + i] = 2.0;
        start[ATTITUDE + i] = 0.03;
        (start[VELOCITY + i], noise[VELOCITY + i]) = (0.1, 0.002);
        (start[VELOCITY + 3 + i], noise[VELOCITY + 3 + i]) = (0.02, 0.001);
        (start[FORCE + i], noise[FORCE + i]) = (2.0, 0.3);
        (start[FORCE + 3 + i], noise[FORCE + 3 + i]) = (0.3, 0.05);
        (start[CURRENT + i], noise[CURRENT + i]) = (0.2, 0.002);
        start[GYRO_BIAS + i] = 0.005;
    }
    (start, noise)
}

/// The sensors: what they show, the deviation of their noise, and every so many steps.
fn sensors() -> Vec<(Observation, f64, usize)> {
    let arm = [0.5, 0.0, 0.2];
    let unit = |i: usize| std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 });
    let mut sensors = Vec::new();
    for i in 0..3 {
        sensors.push((Observation::Velocity { along: unit(i), arm, over_ground: true }, 0.02, 3));
        sensors.push((Observation::Angle { axis: i, mount: [1.0, 0.0, 0.0, 0.0] }, 0.005, 2));
        sensors.push((Observation::Rate { about: unit(i) }, 0.003, 1));
    }
    sensors.push((Observation::Place { along: unit(2), arm }, 0.05, 2));
    sensors.push((Observation::Range { beacon: [60.0, 20.0, 10.0], arm }, 0.3, 7));
    sensors.push((Observation::Bearing { beacon: [60.0, 20.0, 10.0], arm }, 0.02, 11));
    sensors
}

/// Mean NEES of a component and mean NIS over all runs.
fn run(description: &Description) -> (f64, f64) {
    let (start, noise) = deviations();
    let plain = Vehicle::nominal(description);
    let mut model = Process::new(description);
    let (mut nees, mut nis) = (0.0, (0.0, 0.0));
    for seed in 0..RUNS {
        let draw = |k: usize, place: usize| gaussian(seed as f64, k, place);
        let mut truth = Estimate::at_rest();
        truth.motion.nu[0] = 0.7;
        let mut estimate = truth;
        estimate.inject(&std::array::from_fn(|i| start[i] * draw(usize::MAX, i)));
        // The error is drawn about the estimate, so that the covariance is its own.
        let mut state = ErrorState::new(&start);
        let mut watch = Watch::default();
        let gate = Gate { threshold: f64::INFINITY, patience: 5.0 };
        for k in 0..STEPS {
            let signals: Vec<f64> = (description.actuators.iter().enumerate())
                .map(|(i, a)| a.limits.maximum[0] * (0.4 + 0.2 * (0.05 * k as f64 + i as f64).sin()))
                .collect();
            let mut instant = Instant::default();
            act(&plain, &signals, 14.8, |_| None, &mut instant);
            let nodes = vec![instant; 3];
            model.advance(&mut truth, &nodes, DT, &mut Transition::identity(0.0).block);
            truth.inject(&std::array::from_fn(|i| noise[i] * draw(k, i)));
            let mut step = Transition::identity(0.0);
            model.advance(&mut estimate, &nodes, DT, &mut step.block);
            step.drift = DT;
            step.noise = noise.map(|x| x * x);
            state.predict(&step);
            for (place, (sensor, deviation, every)) in sensors().into_iter().enumerate() {
                if k % every != 0 {
                    continue;
                }
                let Some((shown, _)) = sensor.expect(&truth) else { continue };
                let Some((expected, row)) = sensor.expect(&estimate) else { continue };
                let measured = shown + deviation * draw(k, STATES + place);
                let residual = sensor.residual(measured, expected);
                watch.judge(
                    &mut state,
                    &gate,
                    (&row, residual, deviation * deviation),
                    (k as f64 * DT, true),
                );
            }
            estimate.inject(&state.take());
        }
        nees += squared(&state, &estimate.error_of(&truth)) / (STATES * RUNS) as f64;
        nis = (nis.0 + watch.sum, nis.1 + watch.taken);
    }
    (nees, nis.0 / nis.1)
}

/// `eᵀ P⁻¹ e` by Cholesky factors.
fn squared(state: &ErrorState, error: &[f64; STATES]) -> f64 {
    let p = state.dense();
    let mut l = [[0.0; STATES]; STATES];
    let (mut y, mut sum) = ([0.0; STATES], 0.0);
    for j in 0..STATES {
        l[j][j] = (p[j][j] - (0..j).map(|k| l[j][k] * l[j][k]).sum::<f64>()).sqrt();
        for i in j + 1..STATES {
            l[i][j] = (p[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>()) / l[j][j];
        }
        y[j] = (error[j] - (0..j).map(|k| l[j][k] * y[k]).sum::<f64>()) / l[j][j];
        sum += y[j] * y[j];
    }
    sum
}

#[test]
fn law_errors_are_as_large_as_the_covariance_says() {
    let description = load("cwolf");
    let (nees, nis) = run(&description);
    // 50 runs of 24 degrees of freedom: 1.96 √(2/1200) = 0.080; the NIS of 38,000 scalars: 0.014, twice that for what is
    // not linear.
    assert!((nees - 1.0).abs() < 0.080, "NEES {nees}");
    assert!((nis - 1.0).abs() < 0.028, "NIS {nis}");
}
