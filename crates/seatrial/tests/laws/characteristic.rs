//! Thrust: tables are exact at their knots and continuous, inflow and place are one vector.

use crate::vehicles::{load, moving, velocity, with};
use proptest::prelude::*;
use seatrial::actuator::characteristic::{Characteristic, FlowTerms, Shape, Table, Thrust};
use seatrial::actuator::wrench::wrench_per_newton;
use seatrial::description::Description;
use seatrial::description::assembly::Structure;
use seatrial::description::vehicle_file::{CharacteristicTable, Environment, Polynomial};
use seatrial::model::vehicle::{Instant, Mode, Vehicle};
use seatrial::number::algebra::{cross, dot};
use std::sync::Arc;

/// Strictly increasing numbers from a start and steps.
fn axis(start: f64, steps: &[f64]) -> Vec<f64> {
    steps
        .iter()
        .scan(start, |x, step| {
            *x += step;
            Some(*x)
        })
        .collect()
}

prop_compose! {
    /// A measured table of 2 to 12 signals and 1 to 4 voltages.
    fn table()(
        columns in 2_usize..12,
        rows in 1_usize..5,
        steps in proptest::collection::vec(prop_oneof![0.1..1.0, 10.0..200.0], 12),
        volts in proptest::collection::vec(0.5..4.0, 4),
        force in proptest::collection::vec(-60.0..60.0, 48),
    ) -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
        let force = (0..rows).map(|i| force[i * columns..(i + 1) * columns].to_vec()).collect();
        (axis(-400.0, &steps[..columns]), axis(8.0, &volts[..rows]), force)
    }
}

properties! {
    #![cases(256)]

    #[test]
    fn law_table_is_exact_at_its_knots((signal, voltage, force) in table()) {
        let table = Table::new(signal.clone(), voltage.clone(), force.clone()).unwrap();
        for (i, volt) in voltage.iter().enumerate() {
            for (j, s) in signal.iter().enumerate() {
                // Rounding of 120 N between two knots.
                prop_assert!((table.interpolate(&table.row(*volt), *s).0 - force[i][j]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn law_table_is_bilinear_between_its_knots(
        (signal, voltage, force) in table(),
        (at, weight) in (0.0..1.0, 0.0..1.0),
        (column, row) in (0_usize..11, 0_usize..3),
    ) {
        // At a single voltage both rows are the same.
        let (column, row) = (column % (signal.len() - 1), row % (voltage.len() - 1).max(1));
        let upper = (row + 1).min(voltage.len() - 1);
        let table = Table::new(signal.clone(), voltage.clone(), force.clone()).unwrap();
        let s = signal[column] + at * (signal[column + 1] - signal[column]);
        let volt = voltage[row] + weight * (voltage[upper] - voltage[row]);
        let along = |i: usize| force[i][column] + at * (force[i][column + 1] - force[i][column]);
        let expected: f64 = along(row) + weight * (along(upper) - along(row));
        let (found, slope) = table.interpolate(&table.row(volt), s);
        // 400 µs is known to 6e-14, times a slope of up to 1200 N/µs.
        prop_assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        let step = 1e-7 * (signal[column + 1] - signal[column]);
        if at > 0.01 && at < 0.99 {
            let ahead = table.interpolate(&table.row(volt), s + step).0;
            // The difference of two numbers of rounding 1e-9 over the step.
            prop_assert!((ahead - found - slope * step).abs() < 3e-9);
        }
    }

    #[test]
    fn law_table_is_continuous_and_held_beyond_its_edges((signal, voltage, force) in table(), volt in 5.0..30.0) {
        let table = Table::new(signal.clone(), voltage, force).unwrap();
        let row = table.row(volt);
        for s in &signal {
            let [below, above] = [-1e-9, 1e-9].map(|step| table.interpolate(&row, s + step).0);
            // 2e-9 µs times a slope of up to 1200 N/µs.
            prop_assert!((below - above).abs() < 1e-5);
        }
        let [first, last] = table.range();
        for (beyond, edge) in [(first - 100.0, first), (last + 100.0, last)] {
            // Exact: the same point is read.
            prop_assert_eq!(table.interpolate(&row, beyond).0, table.interpolate(&row, edge).0);
            prop_assert_eq!(table.interpolate(&row, beyond).1, 0.0);
        }
    }

    #[test]
    fn law_quadratic_thrust_is_affine_in_the_inflow(
        n in -2000.0_f64..2000.0,
        (ahead, astern, p2) in (0.01_f64..0.1, 0.01_f64..0.1, -0.6_f64..0.0),
        (q1, q2) in (-0.01_f64..0.01, -0.01_f64..0.01),
        inflow in -3.0_f64..3.0,
    ) {
        let flow = FlowTerms { p2, torque: Some([q1, q2]), inflow: true };
        let shape = Shape::Quadratic { p1: [ahead, astern], flow };
        let thrust = Characteristic { shape, factor: 0.9 }.thrust(n, f64::NAN);
        let rev = n / 60.0;
        let pull = if n < 0.0 { astern } else { ahead };
        let force: f64 = 0.9 * (pull * rev.abs() * rev + p2 * rev.abs() * inflow);
        // Rounding of up to 200 N.
        prop_assert!((thrust.force + thrust.force_per_inflow * inflow - force).abs() < 1e-12);
        let torque = 0.9 * (q1 * rev.abs() * rev + q2 * rev.abs() * inflow);
        // Rounding of up to 15 N m.
        prop_assert!((thrust.torque + thrust.torque_per_inflow * inflow - torque).abs() < 1e-13);
    }

    #[test]
    fn law_polynomial_thrust_is_odd_and_zero_at_rest(a in proptest::array::uniform3(-1.0..1.0), n in 1.0..2000.0) {
        let thrust = |s: f64| {
            let flow = FlowTerms { p2: 0.0, torque: None, inflow: false };
            let shape = Shape::Polynomial { ahead: a, astern: a, flow };
            Characteristic { shape, factor: 1.0 }.thrust(s, f64::NAN).force
        };
        prop_assert_eq!(thrust(n), -thrust(-n));
        prop_assert_eq!(thrust(0.0), 0.0);
        let expected = a[0] + a[1] * n + a[2] * n * n;
        // Rounding of up to 4e6.
        prop_assert!((thrust(n) - expected).abs() < 2e-9);
    }

    #[test]
    fn law_a_polynomial_with_only_a_square_is_the_quadratic(
        n in -2000.0_f64..2000.0,
        (ahead, astern, p2) in (0.01_f64..0.1, 0.01_f64..0.1, -0.6_f64..0.0),
        (q1, q2) in (-0.01_f64..0.01, -0.01_f64..0.01),
    ) {
        let flow = FlowTerms { p2, torque: Some([q1, q2]), inflow: true };
        // p1 is per (rev/s)², a11 per rpm².
        let a11 = |p1: f64| [0.0, 0.0, p1 / 3600.0];
        let polynomial = Shape::Polynomial { ahead: a11(ahead), astern: a11(astern), flow };
        let [square, regression] = [Shape::Quadratic { p1: [ahead, astern], flow }, polynomial]
            .map(|shape| parts(&Characteristic { shape, factor: 0.9 }.thrust(n, f64::NAN)));
        for (a, b) in square.iter().zip(regression) {
            // Rounding.
            prop_assert!((a - b).abs() <= 1e-14 * a.abs(), "{square:?} {regression:?}");
        }
    }

    #[test]
    fn law_thruster_wrench_and_inflow_are_one_vector(
        position in proptest::array::uniform3(-1.0..1.0),
        direction in proptest::array::uniform3(0.1..1.0),
        nu in velocity(2.0, 1.0),
    ) {
        let wrench = wrench_per_newton(&position, &direction).unwrap();
        let length = dot(&direction, &direction).sqrt();
        let d = direction.map(|x: f64| x / length);
        let swirl = cross(&[nu[3], nu[4], nu[5]], &position);
        let local: f64 = (0..3).map(|i| d[i] * (nu[i] + swirl[i])).sum();
        // u_a = d · (v + ω × r) = [d; r × d] · ν, up to a dozen roundings.
        prop_assert!((dot(&wrench, &nu) - local).abs() < 1e-14);
    }

    #[test]
    fn law_thrust_acts_at_its_place_on_the_hull(n in -2000.0..2000.0, nu in velocity(2.0, 0.5)) {
        let description = load("cwolf");
        let vehicle = Vehicle::nominal(&description);
        let r = seatrial::model::kinematics::rotation(&moving(nu).attitude);
        let thrusts: Vec<_> = vehicle.actuators.iter().map(|a| a.characteristic.thrust(n, f64::NAN)).collect();
        let mut wrench = [0.0; 6];
        for (k, actuator) in description.actuators.iter().enumerate() {
            let per_newton = wrench_per_newton(&actuator.position.unwrap(), &actuator.direction).unwrap();
            let force = thrusts[k].force + thrusts[k].force_per_inflow * dot(&per_newton, &nu);
            for i in 0..6 {
                wrench[i] += per_newton[i] * force;
            }
        }
        let driven = vehicle.acceleration((None, &r), &nu, &Instant { thrusts, ..Instant::default() });
        let pushed = vehicle.acceleration((None, &r), &nu, &Instant { tau: wrench, ..Instant::default() });
        // Rounding of accelerations up to some hundred m/s².
        prop_assert!((0..6).all(|i| (driven[i] - pushed[i]).abs() < 1e-11));
    }
}

#[test]
fn law_table_thrust_takes_the_voltage_and_the_density() {
    let table = Table::new(vec![0.0, 100.0], vec![10.0, 20.0], vec![vec![0.0, 4.0], vec![0.0, 8.0]]).unwrap();
    let characteristic = Characteristic { shape: Shape::Table(Arc::new(table)), factor: 0.5 };
    for (volt, force) in [(10.0, 1.0), (15.0, 1.5), (20.0, 2.0), (5.0, 1.0), (30.0, 2.0)] {
        // Halves and quarters are exact.
        assert_eq!(characteristic.thrust(50.0, volt).force, force, "{volt} V");
    }
}

/// Thrust of the first actuator in water of density `rho`, at a signal and 15 V.
fn thrust_in(description: &Description, rho_kg_m3: f64, signal: f64) -> Thrust<f64> {
    let structure = Structure::new(description, &[]);
    let environment = Environment { rho_kg_m3, ..description.file.environment };
    let vehicle =
        Vehicle::new(description, &structure, &description.coefficients, environment, [Mode::Free; 6]);
    vehicle.actuators[0].characteristic.thrust(signal, 15.0)
}

/// Thrust and torque with their slopes over the inflow.
fn parts(thrust: &Thrust<f64>) -> [f64; 4] {
    [thrust.force, thrust.force_per_inflow, thrust.torque, thrust.torque_per_inflow]
}

#[test]
fn law_thrust_and_torque_follow_the_density() {
    let cwolf = with(&load("cwolf"), &[("SbU.q1", 0.003), ("SbU.q2", -0.02)]);
    let mut polynomial = load("cwolf").file;
    let (ahead, astern) = ([1.0, 0.02, 1e-5], [0.5, 0.01, 2e-5]);
    let terms = Polynomial { ahead, astern, p2: Some(-0.5), q1: 0.003, q2: -0.02, ..Polynomial::default() };
    let regression = CharacteristicTable::Polynomial(terms);
    polynomial.characteristics.insert("stern".into(), regression);
    let mut direct = load("cwolf").file;
    direct.characteristics.insert("stern".into(), CharacteristicTable::Direct);
    let vehicles = [
        (cwolf, 1.1),
        (load("beluga"), 1.1),
        (Description::new(polynomial, "polynomial").unwrap(), 1.1),
        // A command in newtons is the thrust in any water.
        (Description::new(direct, "direct").unwrap(), 1.0),
    ];
    for (description, ratio) in vehicles {
        let rho = description.file.environment.rho_kg_m3;
        for signal in [250.0, -250.0] {
            let [reference, dense] = [rho, 1.1 * rho].map(|rho| parts(&thrust_in(&description, rho, signal)));
            assert!(reference[0] * signal > 0.0);
            for (a, b) in reference.iter().zip(dense) {
                // Rounding.
                assert!((ratio * a - b).abs() <= 1e-14 * a.abs(), "{reference:?} {dense:?}");
            }
        }
    }
}

#[test]
fn law_wake_deduction_and_gain_act_where_they_should() {
    let torque = [("SbU.q1", 0.003), ("SbU.q2", -0.02), ("SbU.w", 0.0)];
    let open_water = with(&load("cwolf"), &torque);
    let reference = parts(&thrust_in(&open_water, 1025.0, 1000.0));
    for (name, factors) in [
        // V_a = (1 - w) u_a; the hull's pressure takes t of the thrust, not of the torque.
        ("SbU.w", [1.0, 0.8, 1.0, 0.8]),
        ("SbU.t", [0.8, 0.8, 1.0, 1.0]),
        ("SbU.gain", [0.2, 0.2, 0.2, 0.2]),
    ] {
        let changed = parts(&thrust_in(&with(&open_water, &[(name, 0.2)]), 1025.0, 1000.0));
        for i in 0..4 {
            assert!(reference[i] != 0.0);
            // Rounding.
            assert!((changed[i] - factors[i] * reference[i]).abs() < 1e-15 * 100.0, "{name}: {changed:?}");
        }
    }
}
