//! The reference filter against the differential equation that it solves.

use proptest::prelude::*;
use seatrial::control::reference_filter::Reference;

properties! {
    #![cases(128)]

    /// Two half steps are one step: the solution is exact, whatever the period.
    #[test]
    fn law_reference_filter_does_not_depend_on_the_period(
        value in -5.0..5.0f64, rate in -2.0..2.0f64, wanted in -5.0..5.0f64, omega in 0.05..5.0f64, h in 0.01..2.0f64,
    ) {
        let start = Reference { value, rate, acceleration: 0.1 };
        let once = start.follow(wanted, omega, h, false);
        let twice = start.follow(wanted, omega, 0.5 * h, false).follow(wanted, omega, 0.5 * h, false);
        let scale = 10.0 * (1.0 + omega * omega); // the largest number in the sums
        prop_assert!((once.value - twice.value).abs() < 1e-13 * scale);
        prop_assert!((once.rate - twice.rate).abs() < 1e-13 * scale);
        prop_assert!((once.acceleration - twice.acceleration).abs() < 1e-12 * scale);
    }

    /// Rate and acceleration are the derivatives of the value, and `(d/dt + ω)³ e = 0` holds.
    #[test]
    fn law_reference_filter_obeys_its_equation(
        value in -5.0..5.0f64, rate in -2.0..2.0f64, wanted in -5.0..5.0f64, omega in 0.05..5.0f64,
    ) {
        let start = Reference { value, rate, acceleration: 0.3 };
        let d = 1e-4;
        let at = |h: f64| start.follow(wanted, omega, h, false);
        let (before, now, after) = (at(0.5 - d), at(0.5), at(0.5 + d));
        let scale = 10.0 * (1.0 + omega).powi(3); // the largest number in the sums
        let of = |a: f64, b: f64| (b - a) / (2.0 * d);
        // Central differences: an error of d² of the next derivatives but one, and rounding over d.
        prop_assert!((of(before.value, after.value) - now.rate).abs() < 1e-6 * scale);
        prop_assert!((of(before.rate, after.rate) - now.acceleration).abs() < 1e-5 * scale);
        let jerk = of(before.acceleration, after.acceleration);
        let e = now.value - wanted;
        let right = -(3.0 * omega * now.acceleration + 3.0 * omega.powi(2) * now.rate + omega.powi(3) * e);
        prop_assert!((jerk - right).abs() < 1e-4 * scale);
    }
}

/// A step response from rest does not overshoot, and a heading goes the shortest way.
#[test]
fn law_reference_filter_goes_the_shortest_way_without_overshoot() {
    let mut reference = Reference::at(3.0);
    for _step in 0..400 {
        let before = reference.value;
        reference = reference.follow(-3.0, 0.5, 0.1, true);
        // From 3 rad to −3 rad over ±π is 0.28 rad; the way over zero would be 6 rad.
        assert!(reference.value.abs() >= 3.0 - 1e-9, "{before} -> {}", reference.value);
    }
    assert!((reference.value + 3.0).abs() < 1e-6); // 20 time constants: (1 + 20 + 200) e^-20 of 0.28
}
