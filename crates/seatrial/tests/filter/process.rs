//! The Jacobian of the process against difference quotients of the plain step, and the water it does not feel.

use crate::scalars::flights::{NAMES, vehicle};
use seatrial::description::Description;
use seatrial::filter::estimate::{ATTITUDE, Estimate, STATES};
use seatrial::filter::process::{Process, lever};
use seatrial::filter::transition::{Block, COLUMNS, MOTION, Transition};
use seatrial::model::current::Current;
use seatrial::model::drive::act;
use seatrial::model::integrate::{State, step};
use seatrial::model::kinematics::from_euler;
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::algebra::transposed_product;

/// A vehicle under way with every component at work.
fn under_way() -> Estimate {
    let motion = State {
        position: [10.0, -4.0, 3.0],
        attitude: from_euler(&[0.1, -0.2, 1.1]),
        nu: [0.8, 0.1, -0.05, 0.02, -0.03, 0.15],
    };
    let mut at = Estimate { motion, ..Estimate::at_rest() };
    at.force = [3.0, -2.0, 1.0, 0.1, 0.2, -0.3];
    at.current = [0.2, -0.1, 0.05];
    at
}

/// What running actuators do at an instant.
fn instants(description: &Description) -> Vec<Instant<f64>> {
    let plain = Vehicle::nominal(description);
    (0..5)
        .map(|k| {
            let signals: Vec<f64> = description
                .actuators
                .iter()
                .map(|a| a.limits.maximum[0].min(10.0) * (0.3 + 0.05 * f64::from(k)))
                .collect();
            let mut instant = Instant::default();
            act(&plain, &signals, 14.8, |_| None, &mut instant);
            instant
        })
        .collect()
}

/// The wrench about O of the unmodelled force, which acts at the centre of gravity.
fn about_o(description: &Description, force: &[f64; 6]) -> [f64; 6] {
    let arm = lever(description);
    std::array::from_fn(|i| {
        force[i] + if i < 3 { 0.0 } else { (0..3).map(|j| arm[i - 3][j] * force[j]).sum::<f64>() }
    })
}

/// The step in plain numbers.
fn plain(description: &Description, at: &Estimate, nodes: &[Instant<f64>], h: f64) -> Estimate {
    let vehicle = Vehicle::nominal(description);
    let wrench = about_o(description, &at.force);
    let mut after = *at;
    for three in nodes.windows(3).step_by(2) {
        let mut three: [Instant<f64>; 3] = std::array::from_fn(|i| three[i].clone());
        for instant in &mut three {
            let known = instant.inflow_free.expect("summed");
            instant.inflow_free = Some(std::array::from_fn(|i| known[i] + wrench[i]));
        }
        after.motion = step(&vehicle, &after.motion, h, &three);
        for i in 0..3 {
            after.motion.position[i] += h * at.current[i];
        }
    }
    after
}

fn moved(description: &Description, nodes: &[Instant<f64>], h: f64) -> (Estimate, Block) {
    let mut at = under_way();
    let mut block = Transition::identity(0.0).block;
    Process::new(description).advance(&mut at, nodes, h, &mut block);
    (at, block)
}

#[test]
fn law_the_jacobian_of_a_step_is_that_of_the_plain_step() {
    for name in NAMES {
        let description = vehicle(name);
        let (nodes, at, h) = (instants(&description), under_way(), 0.05);
        let after = plain(&description, &at, &nodes, h);
        {
            let (found, block) = moved(&description, &nodes, h);
            let apart = after.error_of(&found);
            assert!(apart.iter().all(|e| e.abs() < 1e-12), "{name}: {apart:?}");
            for column in 0..COLUMNS {
                let size = 1e-6;
                let end = |sign: f64| {
                    let mut change = [0.0; STATES];
                    change[ATTITUDE + column] = sign * size;
                    let mut from = at;
                    from.inject(&change);
                    after.error_of(&plain(&description, &from, &nodes, h))
                };
                let (ahead, back) = (end(1.0), end(-1.0));
                for i in 0..MOTION {
                    let quotient = (ahead[i] - back[i]) / (2.0 * size);
                    let exact = block[i][column];
                    // Rounding of 1e-15 over the step, and its square times the third derivative.
                    let close = (quotient - exact).abs() < 2e-8 * (1.0 + exact.abs());
                    assert!(close, "{name}: row {i} column {column}: {quotient} {exact}");
                }
            }
        }
    }
}

#[test]
fn law_a_constant_current_carries_the_track_and_nothing_else() {
    let description = vehicle("every_term");
    let (at, h, free) = (under_way(), 0.05, Vehicle::nominal(&description));
    let (nodes, wrench) = (instants(&description), about_o(&description, &at.force));
    let (through_water, _) = moved(&description, &nodes, h);
    // The equation of motion over ground, with the current in it.
    let current = Current { velocity: at.current, rate: [0.0; 3], pressed: None };
    let mut over_ground = at.motion;
    over_ground.nu[..3].copy_from_slice(&at.over_ground());
    for three in nodes.windows(3).step_by(2) {
        let mut three: [Instant<f64>; 3] = std::array::from_fn(|i| three[i].clone());
        for instant in &mut three {
            let known = instant.inflow_free.expect("summed");
            instant.inflow_free = Some(std::array::from_fn(|i| known[i] + wrench[i]));
            instant.current = Some(current);
        }
        over_ground = step(&free, &over_ground, h, &three);
    }
    let velocity = through_water.over_ground();
    for i in 0..3 {
        // Both are RK4 of the same motion in different coordinates: they differ by its error.
        assert!((over_ground.position[i] - through_water.motion.position[i]).abs() < 1e-7);
        assert!((over_ground.nu[i] - velocity[i]).abs() < 1e-6);
        assert!((over_ground.nu[3 + i] - through_water.motion.nu[3 + i]).abs() < 1e-6);
    }
}

#[test]
fn law_accelerated_water_is_a_force_at_the_centre_of_gravity() {
    for name in NAMES {
        let description = vehicle(name);
        let (h, free, water) = (0.02, Vehicle::nominal(&description), [0.2, -0.1, 0.15]);
        let nodes = instants(&description);
        let mut at = under_way();
        at.force = [0.0; 6];
        let still = plain(&description, &at, &nodes, h);
        // The equation of motion over ground, with the water's velocity and acceleration in it.
        let mut over_ground = at.motion;
        over_ground.nu[..3].copy_from_slice(&at.over_ground());
        for (k, three) in nodes.windows(3).step_by(2).enumerate() {
            let three: [Instant<f64>; 3] = std::array::from_fn(|i| {
                let mut instant = three[i].clone();
                let time = h * (k as f64 + 0.5 * i as f64);
                let velocity = std::array::from_fn(|j| at.current[j] + water[j] * time);
                instant.current = Some(Current { velocity, rate: water, pressed: None });
                instant
            });
            over_ground = step(&free, &over_ground, h, &three);
        }
        let mass = free.rigid_body.mass_matrix()[0][0];
        let pushed = transposed_product(&at.rotation(), &water);
        for j in 0..3 {
            at.force[j] = -mass * pushed[j];
        }
        let mut found = plain(&description, &at, &nodes, h);
        for j in 0..3 {
            found.current[j] += water[j] * 2.0 * h;
        }
        let velocity = found.over_ground();
        let moved: f64 =
            (0..6).map(|i| (found.motion.nu[i] - still.motion.nu[i]).powi(2)).sum::<f64>().sqrt();
        for i in 0..6 {
            let told = if i < 3 { velocity[i] } else { found.motion.nu[i] };
            // The force is held in the body, which turns by 0.006 rad meanwhile.
            let close = (over_ground.nu[i] - told).abs() < 0.02 * moved;
            assert!(close, "{name}: component {i}: {} {told}, moved {moved}", over_ground.nu[i]);
        }
    }
}
