//! The pseudo-inverse: exact where it can be, of least effort, bounded where it cannot.

use crate::allocation::setup::Setup;
use crate::vehicles::load;
use proptest::prelude::*;
use seatrial::control::allocation::pseudo_inverse::LAMBDA;
use seatrial::number::algebra::{Vec6, dot};

/// A built-in vehicle and a force that all of its thrusters can give, N.
const HOVERING: [(&str, f64); 3] = [("beluga", 8.0), ("bluerov2-heavy", 8.0), ("cwolf", 8.0)];

/// Bound on a force over what an actuator gives in its weaker direction.
const LARGEST_SHARE: f64 = 2.0;

/// The forces at the signals, N.
fn forces(setup: &Setup, nu_r: &Vec6<f64>) -> Vec<f64> {
    let actuators = setup.vehicle.actuators.iter().zip(&setup.signals);
    let each = actuators.map(|(actuator, signal)| {
        let thrust =
            actuator.directed(actuator.characteristic.thrust(*signal, crate::allocation::setup::VOLTAGE));
        thrust.force + thrust.force_per_inflow * dot(&actuator.inflow, nu_r)
    });
    each.collect()
}

fn is_saturated(setup: &Setup) -> bool {
    let limits = setup.description.actuators.iter().map(|a| a.limits.maximum);
    setup.signals.iter().zip(limits).any(|(s, [ahead, astern])| *s >= ahead || *s <= -astern)
}

properties! {
    #![cases(128)]

    #[test]
    fn law_allocation_reaches_what_is_feasible(
        shares in proptest::array::uniform8(-0.5..0.5_f64),
        u in -0.5..1.0_f64,
    ) {
        for (name, force) in HOVERING {
            let mut setup = Setup::smooth(name, "");
            let tau = setup.wrench(&shares, force);
            let nu_r = [u, 0.1, -0.1, 0.0, 0.05, 0.05];
            let reached = setup.allocate(&tau, &nu_r);
            // Rounding of up to 60 N, amplified by 1/sigma² of the scaled rows.
            prop_assert!(setup.miss(&tau, &reached) < 1e-8, "{name}: {tau:?} {reached:?}");
            // Least effort: the forces that made the wrench cost at least as much. Equal thrusters, equal weights.
            if name != "cwolf" {
                let effort: f64 = forces(&setup, &nu_r).iter().map(|f| f * f).sum();
                let given: f64 = shares.iter().map(|s| s * s * force * force).sum();
                prop_assert!(effort <= given * (1.0 + 1e-9), "{name}: {effort} {given}");
            }
        }
    }

    #[test]
    fn law_allocation_misses_no_more_than_clipping(
        shares in proptest::array::uniform8(-3.0..3.0_f64),
        u in -0.5..1.0_f64,
    ) {
        for (name, force) in [("beluga", 40.0), ("cwolf", 60.0)] {
            let nu_r = [u, 0.0, 0.0, 0.0, 0.0, 0.0];
            let mut misses = [0.0; 3];
            let tables = ["redistribution_passes = 0", "", "method = \"quadratic\""];
            for (table, miss) in tables.iter().zip(&mut misses) {
                let mut setup = Setup::smooth(name, table);
                let tau = setup.wrench(&shares, force);
                let reached = setup.allocate(&tau, &nu_r);
                prop_assert!(reached.iter().all(|x| x.is_finite()));
                for (signal, actuator) in setup.signals.iter().zip(&setup.description.actuators) {
                    prop_assert!(*signal <= actuator.limits.maximum[0] && *signal >= -actuator.limits.maximum[1]);
                }
                *miss = setup.allocator.miss(&tau, &reached);
            }
            let [clipped, redistributed, programme] = misses;
            // Rounding.
            prop_assert!(redistributed <= clipped + 1e-9, "{name}: {misses:?}");
            // The programme makes miss² + λ |g|² least, so that it may trade a miss for an effort of at most λ |g|².
            let effort = LAMBDA * 8.0 * LARGEST_SHARE * LARGEST_SHARE;
            prop_assert!(programme <= redistributed.hypot(effort.sqrt()), "{name}: {misses:?}");
        }
    }
}

#[test]
fn law_redistribution_misses_far_less_than_clipping() {
    // Random demands of up to twice what all thrusters give, at equal priorities and at those of the table: the mean
    // angle between demand and answer in the scaled rows, deg, and the mean miss.
    for priority in ["priority = { X = 1, Y = 1, Z = 1, K = 1, M = 1, N = 1 }", ""] {
        let tables = ["redistribution_passes = 0", "redistribution_passes = 2", "method = \"quadratic\""];
        let mut setups = tables.map(|table| Setup::smooth("bluerov2-heavy", &format!("{table}\n{priority}")));
        let (mut sums, mut count) = ([[0.0; 2]; 3], 0.0);
        let mut seed = 7_u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        };
        for _ in 0..600 {
            let tau = setups[0].wrench(&std::array::from_fn::<f64, 8, _>(|_| 2.0 * uniform()), 40.0);
            let reached = setups.each_mut().map(|setup| setup.allocate(&tau, &[0.0; 6]));
            if !is_saturated(&setups[0]) {
                continue;
            }
            count += 1.0;
            for (k, reached) in reached.iter().enumerate() {
                let allocator = &setups[k].allocator;
                let [miss, a, b] = [(&tau, reached), (&tau, &[0.0; 6]), (reached, &[0.0; 6])]
                    .map(|(from, to)| allocator.miss(from, to));
                // The law of cosines.
                sums[k][0] +=
                    ((a * a + b * b - miss * miss) / (2.0 * a * b)).clamp(-1.0, 1.0).acos().to_degrees();
                sums[k][1] += miss;
            }
        }
        let [clipped, redistributed, programme] = sums.map(|[angle, miss]| [angle / count, miss / count]);
        println!("{count} saturated, {priority:?}: {clipped:?} {redistributed:?} {programme:?}");
        assert!(count > 100.0);
        assert!(
            redistributed[1] < 0.95 * clipped[1] && programme[1] <= redistributed[1],
            "{redistributed:?}"
        );
        assert!(redistributed[0] < clipped[0], "{redistributed:?} {clipped:?}");
    }
}

#[test]
fn law_allocation_of_nothing_is_nothing() {
    for name in ["beluga", "bluerov2-heavy", "cwolf"] {
        let mut setup = Setup::new(load(name), "");
        setup.allocate(&[0.0; 6], &[1.0, 0.1, 0.0, 0.0, 0.0, 0.0]);
        assert!(setup.signals.iter().all(|s| *s == 0.0), "{name}");
    }
}

#[test]
fn law_rows_that_are_not_controlled_cost_nothing() {
    let mut setup = Setup::smooth("beluga", "");
    let all = [5.0, 3.0, -4.0, 0.5, 0.5, 1.0];
    setup.rows = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    setup.prepare(&[1.0; 8], 0.0);
    let some = setup.allocate(&all, &[0.0; 6]);
    // Rounding.
    assert!((some[0] - 5.0).abs() < 1e-9 && (some[5] - 1.0).abs() < 1e-9, "{some:?}");
    assert!([1, 2, 3].iter().all(|&i| (some[i] - all[i]).abs() > 0.1), "{some:?}");
}

#[test]
fn law_a_weight_moves_the_work_to_the_others() {
    let share = |table: &str| {
        let mut setup = Setup::smooth("beluga", table);
        setup.rows = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        setup.prepare(&[1.0; 8], 0.0);
        setup.allocate(&[0.0, 0.0, -8.0, 0.0, 0.0, 0.0], &[0.0; 6]);
        let forces = forces(&setup, &[0.0; 6]);
        forces[1] / forces[2]
    };
    // Least Σ w f²: force as 1/w. Interpolation is linear, so that the thrust comes back exactly.
    assert!((share("") - 1.0).abs() < 1e-9);
    assert!((share("weights = { thruster_1 = 4.0 }") - 0.25).abs() < 1e-9);
    assert!((share("weights = { vertical = 4.0, thruster_1 = 1.0 }") - 4.0).abs() < 1e-9);
}

#[test]
fn law_priority_says_what_gives_way() {
    // Full ahead and a turn: the stern propellers cannot give both.
    let reached = |table: &str| {
        let mut setup = Setup::smooth("cwolf", table);
        setup.allocate(&[320.0, 0.0, 0.0, 0.0, 0.0, 20.0], &[0.0; 6])
    };
    for method in ["redistribution_passes = 3", "method = \"quadratic\""] {
        let attitude = reached(method);
        let surge = reached(&format!("{method}\npriority = {{ X = 100.0, N = 1.0 }}"));
        assert!((attitude[5] - 20.0).abs() < 0.5, "{method}: {attitude:?}");
        assert!(
            attitude[0] < 300.0 && surge[0] > attitude[0] + 5.0 && surge[5] < 10.0,
            "{surge:?} {attitude:?}"
        );
    }
}
