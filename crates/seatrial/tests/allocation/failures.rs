//! Failed and stuck actuators.

use crate::allocation::setup::Setup;
use crate::vehicles::load;
use seatrial::control::allocation::authority;

const TAU: [f64; 6] = [12.0, 0.0, 3.0, 0.0, 0.8, 1.5];

#[test]
fn law_a_failed_actuator_gets_nothing_and_the_others_take_over() {
    for name in ["beluga", "bluerov2-heavy", "cwolf"] {
        for method in ["pseudo-inverse", "quadratic"] {
            let mut setup = Setup::smooth(name, &format!("method = \"{method}\""));
            for lost in 0..setup.signals.len() {
                let mut usable = vec![1.0; setup.signals.len()];
                usable[lost] = 0.0;
                setup.prepare(&usable, 0.0);
                let reached = setup.allocate(&TAU, &[0.2, 0.0, 0.0, 0.0, 0.0, 0.0]);
                assert_eq!(setup.signals[lost], 0.0);
                let left = &authority(&setup.description, 0.0).losses[lost];
                assert!((0..6).all(|i| setup.rows[i] * (1.0 - left.share[i]) < 1e-6), "{name} {lost}");
                // Rounding, amplified by 1/sigma² of the scaled rows.
                assert!(setup.miss(&TAU, &reached) < 1e-7, "{name} without {lost}: {reached:?}");
            }
            setup.prepare(&vec![1.0; setup.signals.len()], 0.0);
            let reached = setup.allocate(&TAU, &[0.0; 6]);
            assert!(setup.miss(&TAU, &reached) < 1e-8 && setup.signals.iter().all(|s| *s != 0.0));
        }
    }
}

#[test]
fn law_lost_rank_is_met_in_the_least_squares() {
    // Without both vertical thrusters heave and pitch hang together by the stern propellers.
    let mut setup = Setup::smooth("cwolf", "");
    setup.prepare(&[1.0, 1.0, 1.0, 1.0, 0.0, 0.0], 0.0);
    let reached = setup.allocate(&TAU, &[0.0; 6]);
    assert!(reached.iter().all(|x| x.is_finite()));
    // Rounding; the lost direction of the scaled rows is damped to nothing.
    assert!((reached[0] - TAU[0]).abs() < 1e-5 && (reached[5] - TAU[5]).abs() < 1e-5, "{reached:?}");
    assert!((reached[4] - TAU[4]).abs() < 0.5, "pitch before heave: {reached:?}");
    setup.prepare(&[0.0; 6], 0.0);
    let nothing = setup.allocate(&TAU, &[0.0; 6]);
    assert_eq!(nothing, [0.0; 6]);
    assert_eq!(setup.signals, [0.0; 6]);
}

#[test]
fn law_a_stuck_thruster_is_reckoned_with() {
    for name in ["cwolf", "bluerov2-heavy"] {
        let mut setup = Setup::smooth(name, "");
        let signal = if name == "cwolf" { 500.0 } else { 120.0 };
        setup.allocator.stuck(1, signal, true);
        let usable = vec![1.0; setup.signals.len()];
        setup.prepare(&usable, 0.0);
        let reached = setup.allocate(&TAU, &[0.3, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(setup.signals[1], signal);
        // Rounding, amplified as above.
        assert!(setup.miss(&TAU, &reached) < 1e-7, "{name}: {reached:?}");
        setup.allocator.stuck(1, 0.0, false);
        setup.prepare(&usable, 0.0);
        setup.allocate(&TAU, &[0.3, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_ne!(setup.signals[1], signal);
    }
}

#[test]
fn law_the_other_fins_make_up_for_a_stuck_one() {
    let mut setup = Setup::new(load("remus100"), "");
    setup.rows = [1.0, 0.0, 0.0, 0.0, 1.0, 1.0];
    setup.allocator.stuck(3, 0.1, true);
    setup.prepare(&[1.0; 5], 1.8);
    let tau = [5.0, 0.0, 0.0, 0.0, 0.0, 0.3];
    let reached = setup.allocate(&tau, &[1.8, 0.0, 0.0, 0.0, 0.0, 0.0]);
    // Rounding, amplified by 1/sigma² of the scaled rows.
    assert!(setup.miss(&tau, &reached) < 1e-7, "{reached:?}");
    // The neighbour on the other side stands against it.
    assert!((setup.signals[4] + 0.1).abs() < 1e-6, "{:?}", setup.signals);
    assert_eq!(setup.signals[3], 0.1);
}
