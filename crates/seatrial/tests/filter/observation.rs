//! Every row of an observation against difference quotients of what it expects.

use super::error_state::noise;
use seatrial::filter::estimate::{Estimate, STATES};
use seatrial::filter::observation::{Observation, Surface};
use seatrial::model::kinematics::from_euler;
use seatrial::number::algebra::Vec3;

fn somewhere(seed: usize) -> Estimate {
    let mut at = Estimate::at_rest();
    let n = |i: usize| noise(seed + 13 * i);
    at.motion.position = [5.0 * n(0), 5.0 * n(1), 3.0 + n(2)];
    at.motion.attitude = from_euler(&[0.5 * n(3), 0.8 * n(4), 3.0 * n(5)]);
    at.motion.nu = std::array::from_fn(|i| n(6 + i));
    at.current = std::array::from_fn(|i| n(12 + i));
    at.gyro_bias = std::array::from_fn(|i| 0.1 * n(15 + i));
    at
}

fn every() -> Vec<Observation> {
    let arm = [0.4, -0.1, 0.2];
    let along: Vec3<f64> = [0.6, 0.48, 0.64];
    let beacon = [20.0, -15.0, 12.0];
    let mount = from_euler(&[0.02, -0.1, 0.3]);
    let wall = Surface::Plane { normal: [0.8, 0.6, 0.0], offset: 30.0 };
    let bottom = Surface::Plane { normal: [0.0, 0.0, 1.0], offset: 25.0 };
    let pen = Surface::Cylinder { centre: [1.0, 2.0], radius: 25.0 };
    let pile = Surface::Cylinder { centre: [30.0, 2.0], radius: 12.0 };
    let mut all = vec![
        Observation::Place { along, arm },
        Observation::Velocity { along, arm, over_ground: true },
        Observation::Velocity { along, arm, over_ground: false },
        Observation::Rate { about: along },
        Observation::Range { beacon, arm },
        Observation::Bearing { beacon, arm },
    ];
    all.extend((0..3).map(|axis| Observation::Angle { axis, mount }));
    let forward = [1.0, 0.0, 0.0];
    for (along, surface) in [(forward, wall), ([0.0, 0.0, 1.0], bottom), (forward, pen), (forward, pile)] {
        all.push(Observation::Echo { along, arm, surface });
    }
    all
}

#[test]
fn law_every_row_is_the_derivative_of_what_is_expected() {
    for observation in every() {
        let mut seen = 0;
        for seed in 0..40 {
            let at = somewhere(100 * seed);
            let Some((_, row)) = observation.expect(&at) else { continue };
            let dense = row.derivatives();
            let (size, mut whole) = (1e-6, true);
            let quotients: Vec<f64> = (0..STATES)
                .map(|i| {
                    let shown = |sign: f64| {
                        let mut change = [0.0; STATES];
                        change[i] = sign * size;
                        let mut moved = at;
                        moved.inject(&change);
                        observation.expect(&moved).map(|(shown, _)| shown)
                    };
                    match (shown(1.0), shown(-1.0)) {
                        (Some(ahead), Some(back)) => observation.residual(ahead, back) / (2.0 * size),
                        _ => {
                            whole = false;
                            0.0
                        }
                    }
                })
                .collect();
            if !whole {
                continue;
            }
            seen += 1;
            let largest = dense.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
            for i in 0..STATES {
                // The error of a central difference grows with the third power of how steep it is.
                let close = (quotients[i] - dense[i]).abs() < 1e-8 * largest.powi(3);
                assert!(close, "{observation:?} component {i}: {} {}", quotients[i], dense[i]);
            }
        }
        assert!(seen > 3, "{observation:?}: seen only {seen} times");
    }
}

#[test]
fn an_echo_meets_the_near_side_of_a_pile_and_the_inside_of_a_pen() {
    let round = Surface::Cylinder { centre: [10.0, 0.0], radius: 2.0 };
    let at = |north: f64| {
        let mut at = Estimate::at_rest();
        at.motion.position[0] = north;
        let beam = Observation::Echo { along: [1.0, 0.0, 0.0], arm: [0.5, 0.0, 0.0], surface: round };
        beam.expect(&at).map(|(range, _)| range)
    };
    assert!((at(0.0).unwrap() - 7.5).abs() < 1e-12, "from outside");
    assert!((at(10.0).unwrap() - 1.5).abs() < 1e-12, "from inside");
    assert!(at(20.0).is_none(), "behind the sensor");
}

#[test]
fn what_cannot_be_seen_gives_nothing() {
    let mut at = Estimate::at_rest();
    let arm = [0.0; 3];
    assert!(Observation::Range { beacon: [0.0; 3], arm }.expect(&at).is_none());
    assert!(Observation::Bearing { beacon: [0.0, 0.0, 9.0], arm }.expect(&at).is_none());
    let wall = Surface::Plane { normal: [1.0, 0.0, 0.0], offset: 5.0 };
    assert!(Observation::Echo { along: [0.0, 1.0, 0.0], arm, surface: wall }.expect(&at).is_none());
    at.motion.attitude = from_euler(&[0.0, std::f64::consts::FRAC_PI_2, 0.0]);
    let mount = [1.0, 0.0, 0.0, 0.0];
    assert!(Observation::Angle { axis: 2, mount }.expect(&at).is_none(), "yaw at pitch 90 degrees");
    assert!(Observation::Angle { axis: 1, mount }.expect(&at).is_some());
}
