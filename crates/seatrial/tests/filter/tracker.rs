//! The filter at work: samples that come late, and a gap in them.

use super::error_state::noise;
use crate::vehicles::load;
use seatrial::description::Description;
use seatrial::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, POSITION, STATES, VELOCITY};
use seatrial::filter::innovation::{Gate, Watch};
use seatrial::filter::observation::Observation;
use seatrial::filter::process::Process;
use seatrial::filter::row::Row;
use seatrial::filter::tracker::{Noise, Sample, Tracker};
use seatrial::filter::transition::{COLUMNS, MOTION, Return, Transition};
use seatrial::model::drive::act;
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::random::gaussian;

const DT: f64 = 0.1;

fn quiet() -> Noise {
    Noise {
        force: [0.5, 0.5, 0.5, 0.05, 0.05, 0.05],
        force_time: [10.0; 6],
        acceleration: [0.002; 6],
        current: [0.1, 0.1, 0.0],
        current_time: [1000.0; 3],
        gyro_walk: 1e-6,
        force_walk: [0.0; 6],
        water: [0.0; 3],
        offsets: [0.0; 2],
    }
}

fn tracker(description: &Description, steps: usize) -> Tracker {
    let process = Process::new(description);
    Tracker::new(process, quiet(), Gate::default(), steps)
}

/// Running actuators over one step.
fn nodes(description: &Description, k: usize) -> Vec<Instant<f64>> {
    let plain = Vehicle::nominal(description);
    let turn = 0.15 * (0.03 * k as f64).sin();
    let signals: Vec<f64> = (description.actuators.iter().enumerate())
        .map(|(i, a)| a.limits.maximum[0] * (0.4 + if i % 2 == 0 { turn } else { -turn }))
        .collect();
    let mut instant = Instant::default();
    act(&plain, &signals, 14.8, |_| None, &mut instant);
    vec![instant; 3]
}

#[test]
fn law_a_row_goes_back_through_a_step() {
    let mut step = Transition::identity(0.0);
    for i in 0..MOTION {
        for k in 0..COLUMNS {
            step.block[i][k] += 0.04 * noise(31 * i + k);
        }
    }
    step.drift = 0.1;
    for i in MOTION..STATES {
        step.decay[i] = 0.95;
    }
    step.gusts = true;
    step.water = std::array::from_fn(|k| std::array::from_fn(|j| 0.05 * noise(500 + 5 * k + j)));
    // A quarter of a turn within the step: what leads is not on the diagonal.
    for i in 0..2 {
        step.block[ATTITUDE + i][i] = 0.0;
    }
    (step.block[ATTITUDE][1], step.block[ATTITUDE + 1][0]) = (-1.0, 1.0);
    let f = step.dense();
    let parts = |k: usize| (3 * k, std::array::from_fn(|i| noise(900 + 3 * k + i)));
    for row in
        [Row::of([0, 1, 2, 3, 4, 5, 6, 7].map(parts)), Row::of([parts(0)]), Row::of([parts(3), parts(7)])]
    {
        let mut back = Return::identity(0.0);
        step.reverse(&mut back);
        let y = back.carry(&row);
        for j in 0..STATES {
            let found: f64 = (0..STATES).map(|i| y.derivatives()[i] * f[i][j]).sum();
            assert!((found - row.derivatives()[j]).abs() < 1e-13, "component {j}: {found}");
        }
        // What the row says it is without is nothing.
        let all = y.times(&[1.0; STATES]);
        assert!((all - y.derivatives().iter().sum::<f64>()).abs() < 1e-12);
    }
}

/// Error of position and velocity at the end, m and m/s, when a Doppler log is so many steps late; `told` is whether
/// the filter knows.
fn late(description: &Description, latency: usize, told: bool) -> (f64, f64) {
    let mut filter = tracker(description, latency);
    let mut model = Process::new(description);
    let mut truth = Estimate::at_rest();
    let mut deviations = [0.01; STATES];
    deviations[POSITION + 2] = 0.5;
    deviations[VELOCITY..VELOCITY + 3].fill(0.3);
    deviations[FORCE..CURRENT].fill(0.5);
    filter.begin(&truth, &deviations);
    let along = |i: usize| std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 });
    let sensors: Vec<Observation> = (0..3)
        .map(|i| Observation::Velocity { along: along(i), arm: [0.0; 3], over_ground: true })
        .chain((0..3).map(|axis| Observation::Angle { axis, mount: [1.0, 0.0, 0.0, 0.0] }))
        .collect();
    let mut watches = vec![Watch::default(); sensors.len()];
    let mut shown = Vec::new();
    for k in 0..400 {
        let nodes = nodes(description, k);
        model.advance(&mut truth, &nodes, DT, &mut Transition::identity(0.0).block);
        shown.push(truth);
        filter.predict(&nodes, DT);
        for (i, (observation, watch)) in sensors.iter().zip(&mut watches).enumerate() {
            let behind = if i < 3 { latency } else { 0 };
            let Some(at) = k.checked_sub(behind) else { continue };
            let (value, _) = observation.expect(&shown[at]).expect("seen");
            let measured = value + 0.005 * gaussian(7.0, k, i);
            let age = if told { behind as f64 * DT } else { 0.0 };
            filter.observe(&Sample { observation, measured, variance: 2.5e-5, age }, watch);
        }
        assert!(filter.settle());
    }
    let error = filter.estimate().error_of(&truth);
    let length = |first: usize| (0..3).map(|i| error[first + i].powi(2)).sum::<f64>().sqrt();
    (length(POSITION), length(VELOCITY))
}

#[test]
fn a_late_sample_is_taken_for_its_own_time() {
    let description = load("cwolf");
    let (prompt, known, taken_for_now) =
        (late(&description, 0, true), late(&description, 5, true), late(&description, 5, false));
    assert!(known.0 < 0.1 && known.1 < 0.01, "{known:?}");
    assert!(known.1 < 3.0 * prompt.1.max(0.002), "{known:?} {prompt:?}");
    assert!(taken_for_now.1 > 2.0 * known.1, "{taken_for_now:?} {known:?}");
}

#[test]
fn a_sample_from_before_what_is_kept_is_not_taken() {
    let description = load("cwolf");
    let mut filter = tracker(&description, 3);
    filter.begin(&Estimate::at_rest(), &[0.1; STATES]);
    let observation = Observation::Place { along: [0.0, 0.0, 1.0], arm: [0.0; 3] };
    let mut watch = Watch::default();
    for k in 0..10 {
        filter.predict(&nodes(&description, k), DT);
        filter.settle();
    }
    let mut take = |age| {
        filter.observe(&Sample { observation: &observation, measured: 0.0, variance: 1.0, age }, &mut watch)
    };
    assert!(take(0.35).is_some_and(|verdict| verdict.taken));
    assert!(take(2.0).is_none());
}
