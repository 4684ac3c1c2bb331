//! Exact derivatives of whole flights: the values are the plain model's, the partials those of finite
//! differences, and neither threads nor grouping nor instruction set matter.

use crate::scalars::flights::{Flights, NAMES, noise};
use crate::vehicles::{hull, moving, times};
use seatrial::description::assembly::Structure;
use seatrial::fit::criterion::{CHANNELS, Loss};
use seatrial::fit::inputs::Inputs;
use seatrial::fit::observation::{INITIALS, NUISANCES};
use seatrial::fit::open_loop::{Observer, Track, fly};
use seatrial::fit::record::{MotorStart, Segment, Start};
use seatrial::fit::sensitivities::{Gradient, Unknown};
use seatrial::model::vehicle::{Mode, Vehicle};
use seatrial::number::dual::{Dual, Valued};
use std::sync::atomic::AtomicBool;

/// All channels.
const ALL: [usize; CHANNELS] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

/// The run of a segment in a number type.
fn track<T: Valued>(flights: &Flights, values: &[T], segment: &Segment) -> Track<T> {
    let structure = Structure::new(&flights.description, &flights.sought);
    let environment = flights.records[0].environment;
    let vehicle = Vehicle::new(&flights.description, &structure, values, environment, [Mode::Free; 6]);
    let mut observer = Observer::Track(Track::default());
    let start = Start::of(segment, values[0].zero());
    let stop = AtomicBool::new(false);
    fly(&vehicle, &flights.records[0], segment, (2, &start), &mut observer, &stop).expect("no interrupt");
    if let Observer::Track(track) = observer { track } else { Track::default() }
}

/// Every number of a run without its derivatives.
fn numbers<T: Valued>(track: &Track<T>) -> Vec<u64> {
    let states = track.states.iter().flat_map(|s| s.position.into_iter().chain(s.attitude).chain(s.nu));
    let forces = track.tau.iter().flatten().copied();
    let signals = track.signals.iter().flatten().copied();
    states.chain(forces).chain(signals).map(|x| x.value().to_bits()).collect()
}

#[test]
fn scalar_dual_flights_have_the_values_of_f64() {
    for name in NAMES {
        let flights = Flights::new(name);
        let mut plain = flights.description.coefficients.clone();
        for (&index, &value) in flights.sought.iter().zip(&flights.values) {
            plain[index] = value;
        }
        let seeded: Vec<Dual<f64>> =
            plain.iter().enumerate().map(|(i, &value)| Dual { value, partials: noise(i) }).collect();
        for segment in &flights.segments {
            // Bit by bit: the same operations on the same numbers.
            let expected = numbers(&track(&flights, &plain, segment));
            assert_eq!(numbers(&track(&flights, &seeded, segment)), expected, "{name}");
        }
    }
}

/// The natural size of a change of an unknown.
fn size(flights: &mut Flights, unknown: Unknown) -> f64 {
    match unknown {
        Unknown::Direction(_) => flights.number(unknown)[0].abs().max(0.05),
        Unknown::Nuisance(_) | Unknown::Initial(_) => 0.1,
    }
}

#[test]
fn scalar_partials_of_flights_are_finite_differences() {
    for name in NAMES {
        let mut flights = Flights::disturbed(name);
        let unknowns = flights.unknowns();
        let found: Vec<Vec<f64>> =
            flights.sensitivities(&unknowns, &ALL).into_iter().map(|p| p.jacobian).collect();
        let found = found.concat();
        for (j, &unknown) in unknowns.iter().enumerate() {
            let size = size(&mut flights, unknown);
            let expected = flights.quotient(unknown, 1e-7 * size, |flights| {
                let stop = AtomicBool::new(false);
                let shown = flights.batch().predictions(flights.point(&[]), &stop).expect("no interrupt");
                shown.concat().concat()
            });
            // Changes by the unknown's own size; the quotient loses 1e-15/1e-7 to rounding and,
            // where a strip of the hull changes its side within the step, 1e-7 to curvature; the flight grows both.
            for (at, expected) in expected.iter().enumerate() {
                let apart = (found[at * unknowns.len() + j] - expected).abs() * size;
                assert!(apart < 1e-7 * (1.0 + expected.abs() * size), "{name}, {unknown:?}, {at}: {apart:e}");
            }
        }
    }
}

/// The criterion and its gradient.
fn gradient(flights: &Flights, unknowns: &[Unknown], loss: Loss) -> Vec<Gradient> {
    let (axes, stop) = (flights.axes(), AtomicBool::new(false));
    flights.batch().gradient(flights.point(&axes), unknowns, loss, &stop).expect("nobody interrupts")
}

#[test]
fn scalar_gradients_of_the_criterion_are_finite_differences() {
    let mut flights = Flights::disturbed("cwolf");
    let unknowns = flights.unknowns();
    for loss in [Loss::Absolute, Loss::Squared, Loss::Huber(0.4)] {
        let found: Vec<f64> =
            gradient(&flights, &unknowns, loss).into_iter().flat_map(|segment| segment.slopes).collect();
        for (j, &unknown) in unknowns.iter().enumerate() {
            let size = size(&mut flights, unknown);
            let expected = flights.quotient(unknown, 1e-6 * size, |flights| {
                gradient(flights, &[], loss).iter().flat_map(|segment| segment.sums).collect()
            });
            for (at, expected) in expected.iter().enumerate() {
                let apart = (found[at * unknowns.len() + j] - expected).abs() * size;
                // Rounding of sums up to 300 over 60 steps: 1e-12/1e-6. No residual changes its sign within the step.
                assert!(apart < 2e-6 * (1.0 + expected.abs() * size), "{loss:?}, {unknown:?}: {apart:e}");
            }
        }
    }
}

#[test]
fn scalar_the_criterion_of_the_gradient_is_that_of_the_population() {
    let flights = Flights::new("cwolf");
    let candidates =
        seatrial::fit::batch::Candidates { sought: &flights.sought, values: &flights.values, count: 1 };
    for loss in [Loss::Absolute, Loss::Squared, Loss::Huber(0.4)] {
        let expected = flights.batch().errors(candidates, loss, &AtomicBool::new(false)).unwrap();
        let found = gradient(&flights, &[], loss);
        for (found, expected) in found.iter().flat_map(|segment| segment.sums).zip(expected) {
            // Lanes against f64: rounding over 60 steps.
            assert!((found - expected).abs() < 1e-9 * (1.0 + expected), "{loss:?}: {found} {expected}");
        }
    }
}

#[test]
fn scalar_a_diverged_flight_costs_infinity() {
    let mut flights = Flights::new("cwolf");
    let drag = flights.description.layout.find("X_uu").unwrap();
    let place = flights.sought.iter().position(|&index| index == drag).unwrap();
    flights.values[place] = 1e6;
    for segment in gradient(&flights, &[Unknown::Direction(place)], Loss::Squared) {
        assert_eq!(segment.sums[0], f64::INFINITY);
    }
}

#[test]
fn scalar_derivatives_do_not_see_threads_and_grouping() {
    let flights = Flights::disturbed("every_term");
    let unknowns = flights.unknowns();
    let asked = [0, 4, 8, 11];
    let bits = |unknowns: &[Unknown]| -> Vec<u64> {
        let found = flights.sensitivities(unknowns, &asked);
        found.iter().flat_map(|p| p.jacobian.iter().map(|x| x.to_bits())).collect()
    };
    let together = bits(&unknowns);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        // Bit by bit: the same operations on the same numbers.
        assert_eq!(pool.install(|| bits(&unknowns)), together, "{threads} threads");
    }
    // Rotated by three, every unknown has other neighbours and another lane; five at a time, fewer.
    let width = unknowns.len();
    let mut rotated = unknowns.clone();
    rotated.rotate_left(3);
    for (row, expected) in bits(&rotated).chunks(width).zip(together.chunks(width)) {
        assert!((0..width).all(|j| row[j] == expected[(j + 3) % width]));
    }
    for (first, few) in unknowns.chunks(5).enumerate() {
        for (row, expected) in bits(few).chunks(few.len()).zip(together.chunks(width)) {
            assert_eq!(row, &expected[5 * first..][..few.len()]);
        }
    }
    // The same unknown twice has the same derivative twice.
    let twice = [unknowns[3], unknowns[width - 1], unknowns[3]];
    for (row, expected) in bits(&twice).chunks(3).zip(together.chunks(width)) {
        assert_eq!(row, [expected[3], expected[width - 1], expected[3]]);
    }
}

#[test]
fn scalar_derivatives_where_nothing_disturbs_do_not_see_grouping() {
    // At zero, coefficients could take a way of their own: they take that of their request.
    let flights = Flights::new("cwolf");
    let unknowns = flights.unknowns();
    let asked = [1, 9, 10];
    let together = flights.sensitivities(&unknowns, &asked);
    let mut rotated = unknowns.clone();
    rotated.rotate_left(5);
    let width = unknowns.len();
    for (found, expected) in flights.sensitivities(&rotated, &asked).iter().zip(&together) {
        for (row, expected) in found.jacobian.chunks(width).zip(expected.jacobian.chunks(width)) {
            // Equal zeros may differ in sign.
            assert!((0..width).all(|j| row[j] == expected[(j + 5) % width]));
        }
    }
    // Alone they take the plain model's: rounding over 60 steps, of derivatives up to 100.
    let alone: Vec<Unknown> = (0..flights.sought.len()).map(Unknown::Direction).collect();
    for (found, expected) in flights.sensitivities(&alone, &asked).iter().zip(&together) {
        for (row, expected) in found.jacobian.chunks(alone.len()).zip(expected.jacobian.chunks(width)) {
            for (a, b) in row.iter().zip(expected) {
                assert!((a - b).abs() < 1e-10 * (1.0 + b.abs()), "{a} {b}");
            }
        }
    }
}

#[test]
fn scalar_a_direction_is_the_sum_of_its_coefficients() {
    let flights = Flights::new("cwolf");
    let width = flights.sought.len();
    let direction: Vec<f64> = (0..width).map(|i| noise(900 + i)).collect();
    let stop = AtomicBool::new(false);
    let along = flights
        .batch()
        .sensitivities(flights.point(&direction), &[Unknown::Direction(0)], &ALL, &stop)
        .expect("nobody interrupts");
    let single: Vec<Unknown> = (0..width).map(Unknown::Direction).collect();
    for (found, parts) in along.iter().zip(flights.sensitivities(&single, &ALL)) {
        for (found, row) in found.jacobian.iter().zip(parts.jacobian.chunks(width)) {
            let terms = || row.iter().zip(&direction).map(|(a, b)| a * b);
            let size: f64 = terms().map(f64::abs).sum();
            // The order of a sum over the coefficients, and rounding over 60 steps.
            assert!((found - terms().sum::<f64>()).abs() < 1e-10 * (1.0 + size));
        }
    }
}

#[test]
fn scalar_a_vehicle_at_rest_answers_to_its_unknowns() {
    // Neutral, upright, at rest: nothing moves, and everything could.
    let coefficients = [
        ("m", 100.0),
        ("I_x", 10.0),
        ("I_y", 10.0),
        ("I_z", 10.0),
        ("B", 981.0),
        ("z_b", -0.02),
        ("X_udot", -20.0),
        ("X_u", -30.0),
        ("X_uu", -50.0),
    ];
    let description = hull(&coefficients.map(|(name, value)| (name.to_owned(), value)));
    let n = 41;
    let inputs = Inputs { t: times(n, 0.1), ..Inputs::default() };
    let record = inputs.record(&description, false, 1).expect("valid inputs");
    let state = moving([0.0; 6]);
    let segment =
        Segment { record: 0, start: 0, stop: n, state, current: [0.0; 3], motors: MotorStart::Recorded };
    let sought: Vec<usize> = (0..description.layout.len()).collect();
    let values = sought.iter().map(|&index| description.coefficients[index]).collect();
    let flights = Flights {
        description,
        records: vec![record],
        segments: vec![segment],
        values,
        sought,
        nuisance: vec![[0.0; NUISANCES]],
        initial: vec![[0.0; INITIALS]],
    };
    let unknowns = flights.unknowns();
    let shown = flights.sensitivities(&unknowns, &ALL);
    assert!(shown[0].rows.iter().flatten().all(|&x| x == 0.0));
    assert!(shown[0].jacobian.iter().all(|x| x.is_finite()));
    let column = |name: &str| flights.description.layout.find(name).expect("a known name");
    let of_u = |k: usize, name: &str| shown[0].jacobian[k * CHANNELS * unknowns.len() + column(name)];
    for k in 0..n {
        // (m − X_udot) u' = X_0 + X_u u from rest; 80 steps of RK4 of 0.0125 time constants, each off by
        // 0.0125⁵/120 of the end value 1/30.
        let expected = (1.0 - (-30.0 / 120.0 * 0.1 * k as f64).exp()) / 30.0;
        assert!((of_u(k, "X_0") - expected).abs() < 7e-12, "{k}");
        assert_eq!(of_u(k, "X_u"), 0.0);
        assert_eq!(of_u(k, "X_uu"), 0.0);
    }
}
