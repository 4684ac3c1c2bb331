//! The supporting points of adaptive gains.

use proptest::prelude::*;
use seatrial::control::schedule::{POINTS, Schedule, interpolated};

const SPEEDS: [f64; POINTS] = [-5.0, -3.0, -1.0, 1.0, 3.0, 5.0];

properties! {
    #![cases(256)]

    /// The weights are shares, and a gain that is linear in the speed is interpolated exactly.
    #[test]
    fn law_schedule_interpolates_linearly(u in -8.0..8.0f64, a in -5.0..5.0f64, b in -5.0..5.0f64) {
        let schedule = Schedule::new(SPEEDS).expect("increasing");
        let weights = schedule.weights(u);
        prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
        prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12); // rounding
        let gain = SPEEDS.map(|s| a * s + b);
        let held = u.clamp(-5.0, 5.0);
        prop_assert!((interpolated(&gain, &weights) - (a * held + b)).abs() < 1e-12 * 30.0); // rounding of |a s + b| <= 30
    }
}

#[test]
fn law_schedule_refuses_speeds_that_do_not_increase() {
    let message = Schedule::new([0.0, 1.0, 1.0, 2.0, 3.0, 4.0]).expect_err("equal speeds");
    assert!(message.contains("strictly increasing"), "{message}");
    assert!(Schedule::new([f64::NAN, 1.0, 1.5, 2.0, 3.0, 4.0]).is_err());
}
