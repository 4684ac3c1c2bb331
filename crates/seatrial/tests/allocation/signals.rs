//! The inverse characteristic gives back the thrust that is asked for.

use crate::allocation::setup::{Setup, VOLTAGE, smooth};
use crate::vehicles::{load, with};
use proptest::prelude::*;
use seatrial::actuator::characteristic::{Bias, Characteristic, FlowTerms, Shape, Table};
use seatrial::description::built_in_names;
use seatrial::model::vehicle::Vehicle;

fn force(characteristic: &Characteristic<f64>, signal: f64, inflow: f64, voltage: f64) -> f64 {
    let thrust = characteristic.thrust(signal, voltage);
    thrust.force + thrust.force_per_inflow * inflow
}

properties! {
    #![cases(128)]

    #[test]
    fn law_signal_gives_the_thrust_of_every_built_in_thruster(
        share in -1.0..1.0_f64,
        inflow in -1.5..2.5_f64,
        voltage in prop_oneof![Just(f64::NAN), 9.0..21.0_f64],
    ) {
        for name in built_in_names() {
            let description = load(name);
            let vehicle = Vehicle::nominal(&description);
            for (actuator, described) in vehicle.actuators.iter().zip(&description.actuators) {
                let [ahead, astern] = described.limits.maximum;
                let limit = if share < 0.0 { -astern } else { ahead };
                let wanted = share.abs() * force(&actuator.characteristic, limit, inflow, voltage);
                let signal = actuator.characteristic.signal(wanted, inflow, voltage);
                let found = force(&actuator.characteristic, signal, inflow, voltage);
                prop_assert!((found - wanted).abs() <= 1e-9 * wanted.abs(), "{name}: {found} {wanted} at {signal}");
                // The largest thrust is that of the limit: what is inside of it needs no more.
                prop_assert!(signal.abs() <= limit.abs() * (1.0 + 1e-9) || wanted * share < 0.0);
            }
        }
    }

    #[test]
    fn law_signal_is_monotone_in_the_thrust(
        forces in (-40.0..40.0_f64, -40.0..40.0_f64),
        near in (-0.5..0.5_f64, -0.5..0.5_f64),
        inflow in -2.0..2.5_f64,
    ) {
        for name in built_in_names() {
            for actuator in &Vehicle::nominal(&load(name)).actuators {
                for (a, b) in [forces, near] {
                    let (low, high) = (a.min(b), a.max(b));
                    let [s, t] = [low, high].map(|f| actuator.characteristic.signal(f, inflow, VOLTAGE));
                    // Rounding of 2500 rpm.
                    prop_assert!(s <= t + 1e-9, "{name}: {s} at {low} N, {t} at {high} N");
                }
            }
        }
    }

    #[test]
    fn law_signal_gives_the_thrust_of_a_polynomial(
        (a1, a11, dead) in (0.0..0.02_f64, 1e-6..3e-5_f64, 0.0..1.0_f64),
        (p2, inflow, ratio) in (-0.6..0.0_f64, -2.0..2.0_f64, 0.5..1.5_f64),
        wanted in -50.0..50.0_f64,
        turning in -1_i32..2,
    ) {
        let flow = FlowTerms { p2, torque: None, inflow: true };
        let [ahead, astern] = [[-dead, a1, a11], [-0.5 * dead, 0.7 * a1, 1.3 * a11]];
        let characteristic = Characteristic { shape: Shape::Polynomial { ahead, astern, flow }, factor: 0.9 };
        let bias = Bias { turning: f64::from(turning), astern_ratio: ratio };
        let signal = characteristic.signal_near(wanted, inflow, f64::NAN, &bias);
        let factor = if signal < 0.0 { ratio } else { 1.0 };
        let found = factor * force(&characteristic, signal, inflow, f64::NAN);
        // Rounding of the parts that cancel, up to 60 N.
        prop_assert!((found - wanted).abs() <= 1e-9 * wanted.abs().max(0.01), "{found} {wanted} at {signal}");
    }

    #[test]
    fn law_signal_of_a_table_is_the_smallest_that_reaches_the_thrust(
        steps in proptest::collection::vec(-0.3..2.0_f64, 12),
        flat in 0_usize..6,
        wanted in -8.0..8.0_f64,
    ) {
        // Odd about zero, with a flat stretch and stretches that fall a little.
        let mut thrust = vec![0.0];
        for (i, step) in steps.iter().enumerate() {
            thrust.push(thrust[i] + if i == flat { 0.0 } else { *step });
        }
        let signal: Vec<f64> = (-12..=12).map(|i| 10.0 * f64::from(i)).collect();
        let row = (-12_i32..=12).map(|i| f64::from(i.signum()) * thrust[i.unsigned_abs() as usize]).collect();
        let table = Table::new(signal, vec![], vec![row]).unwrap();
        let row = table.row(f64::NAN);
        let found = table.reaching(&row, wanted).0;
        let fine = (0..=120_000).map(|i| 0.001 * f64::from(i) * wanted.signum());
        let first = fine.into_iter().find(|&s| {
            let thrust = table.interpolate(&row, s).0;
            if wanted > 0.0 { thrust >= wanted } else { thrust <= wanted }
        });
        match first {
            // The grid of the search.
            Some(first) => prop_assert!((found - first).abs() <= 0.001 + 1e-9, "{found} {first}"),
            None => {
                let most = thrust.iter().fold(0.0_f64, |m, x| m.max(*x));
                prop_assert!((table.interpolate(&row, found).0.abs() - most).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn law_signal_of_no_thrust_is_no_signal() {
    for name in built_in_names() {
        for actuator in &Vehicle::nominal(&load(name)).actuators {
            assert_eq!(actuator.characteristic.signal(0.0, 1.5, VOLTAGE), 0.0, "{name}");
        }
    }
}

#[test]
fn law_signal_does_not_chatter_between_windmilling_and_astern() {
    let vehicle = Vehicle::nominal(&load("cwolf"));
    let stern = &vehicle.actuators[0].characteristic;
    // At 1.5 m/s: runs freely at 1240 rpm; the dip of D = 14.4 N is left at three quarters of it.
    let (mut turning, mut reversals, mut plain) = (1.0, 0, 0);
    let mut before = 1.0;
    for step in 0..2000 {
        let noise = 0.8 * f64::sin(2.4 * f64::from(step));
        let wanted = -0.01 * f64::from(step) + noise;
        let signal = stern.signal_near(wanted, 1.5, f64::NAN, &Bias { turning, astern_ratio: 1.0 });
        let direction = signal.signum();
        reversals += i32::from(direction != turning);
        turning = direction;
        let direction = stern.signal(wanted, 1.5, f64::NAN).signum();
        plain += i32::from(direction != before);
        before = direction;
    }
    assert_eq!(reversals, 1);
    assert!(plain > 5, "the sweep crosses the jump: {plain}");
}

#[test]
fn law_allocation_makes_up_for_wash_and_a_weaker_thrust_astern() {
    for loss in [0.0005, 0.001, 0.002] {
        let changes =
            [("VTB.astern_ratio", 0.8), ("VTS.astern_ratio", 0.7), ("VTB.loss", loss), ("VTS.loss", loss)];
        let mut setup = Setup::new(with(&smooth("cwolf"), &changes), "");
        let tau = [40.0, 0.0, -12.0, 0.0, 2.0, 4.0];
        let reached = setup.allocate(&tau, &[1.0, 0.0, 0.1, 0.0, 0.0, 0.0]);
        // The stern propellers turn at 1400 rpm: |F| sums to 165 N. Four rounds of a one-way loss are exact; rounding of 40 N.
        assert!(setup.miss(&tau, &reached) < 1e-9, "{loss}: {reached:?}");
    }
    let all = ["SbU", "SbL", "PU", "PL", "VTB", "VTS"].map(|name| format!("{name}.loss"));
    let changes: Vec<(&str, f64)> = all.iter().map(|name| (name.as_str(), 5e-4)).collect();
    let mut setup = Setup::new(with(&smooth("cwolf"), &changes), "");
    let tau = [40.0, 0.0, -12.0, 0.0, 2.0, 4.0];
    let reached = setup.allocate(&tau, &[1.0, 0.0, 0.1, 0.0, 0.0, 0.0]);
    // Mutual losses of up to 8 %: four rounds leave 1e-4 of the thrust at most.
    assert!(setup.miss(&tau, &reached) < 4e-3, "{reached:?}");
}
