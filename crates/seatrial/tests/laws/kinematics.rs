//! Attitude: the rotation matrix, quaternion and Euler angles say the same.

use crate::vehicles::{attitude, distance, velocity};
use proptest::prelude::*;
use seatrial::model::kinematics::{
    euler_rate, from_euler, quaternion_product, quaternion_rate, rotation, to_euler,
};
use seatrial::number::algebra::product;
use seatrial::number::real::Real;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Roll, pitch within `steepest` rad, yaw.
fn euler(steepest: f64) -> impl Strategy<Value = [f64; 3]> {
    (-PI..PI, -steepest..steepest, -PI..PI).prop_map(|(roll, pitch, yaw)| [roll, pitch, yaw])
}

properties! {
    #![cases(256)]

    #[test]
    fn law_rotation_is_orthonormal_and_right_handed(q in attitude()) {
        let r = rotation(&q);
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| r[i][k] * r[j][k]).sum();
                // Three dozen roundings of numbers up to one, of 1.1e-16 each.
                prop_assert!((product - f64::from(i == j)).abs() < 4e-15);
            }
        }
        let [x, y, z] = r;
        let [a, b, c] = seatrial::number::algebra::cross(&x, &y);
        prop_assert!(distance(&[a, b, c], &z) < 4e-15);
    }

    #[test]
    fn law_euler_angles_round_trip(angles in euler(1.55)) {
        let back = to_euler(&from_euler(&angles));
        for i in 0..3 {
            // Rounding 2e-16 over cos 1.55 = 0.02, and the jump of the angle at ±π.
            prop_assert!((back[i] - angles[i]).wrap().abs() < 1e-13, "{angles:?} -> {back:?}");
        }
    }

    #[test]
    fn law_quaternion_round_trips_up_to_its_sign(q in attitude()) {
        let angles = to_euler(&q);
        prop_assume!(angles[1].abs() < 1.57);
        let back = from_euler(&angles);
        let opposite = back.map(|x| -x);
        // Rounding over cos 1.57 = 8e-4.
        prop_assert!(distance(&back, &q).min(distance(&opposite, &q)) < 1e-11);
    }

    #[test]
    fn law_pitch_is_right_at_the_singularity(roll in -PI..PI, yaw in -PI..PI, up in any::<bool>()) {
        let pitch = if up { FRAC_PI_2 } else { -FRAC_PI_2 };
        let back = to_euler(&from_euler(&[roll, pitch, yaw]));
        prop_assert!(back.iter().all(|x| x.is_finite()));
        // The arctangent of two roundings: their root.
        prop_assert!((back[1] - pitch).abs() < 1e-7);
    }

    #[test]
    fn law_quaternion_and_euler_rates_agree(angles in euler(1.4), nu in velocity(2.0, 1.0)) {
        let rate = euler_rate(&angles, &nu);
        let step = 1e-5;
        let at = |step: f64| from_euler(&std::array::from_fn(|i| angles[i] + step * rate[3 + i]));
        let (after, before) = (at(step), at(-step));
        let quotient: [f64; 4] = std::array::from_fn(|i| (after[i] - before[i]) / (2.0 * step));
        let exact = quaternion_rate(&from_euler(&angles), &[nu[3], nu[4], nu[5]]);
        // Central difference: rates up to 15 rad/s cubed times step²/6, and rounding 1e-16/step.
        prop_assert!(distance(&quotient, &exact) < 1e-7);
        let r = rotation(&from_euler(&angles));
        let velocity = product(&r, &[nu[0], nu[1], nu[2]]);
        prop_assert!(distance(&velocity, &[rate[0], rate[1], rate[2]]) < 1e-14);
    }

    #[test]
    fn law_a_product_of_quaternions_is_one_rotation_after_the_other(a in attitude(), b in attitude()) {
        let found = rotation(&quaternion_product(&a, &b));
        for k in 0..3 {
            let axis = std::array::from_fn(|i| f64::from(u8::from(i == k)));
            let expected = product(&rotation(&a), &product(&rotation(&b), &axis));
            // A few dozen roundings of numbers up to one.
            prop_assert!(distance(&[found[0][k], found[1][k], found[2][k]], &expected) < 4e-15);
        }
        let [w, x, y, z] = a;
        let none = quaternion_product(&a, &[w, -x, -y, -z]);
        prop_assert!(distance(&none, &[1.0, 0.0, 0.0, 0.0]) < 1e-15);
        prop_assert_eq!(quaternion_product(&a, &[1.0, 0.0, 0.0, 0.0]), a);
    }

    #[test]
    fn law_the_quaternion_rate_is_half_a_product(q in attitude(), nu in velocity(1.0, 1.0)) {
        let half = quaternion_product(&q, &[0.0, 0.5 * nu[3], 0.5 * nu[4], 0.5 * nu[5]]);
        // Two orders of three products.
        prop_assert!(distance(&half, &quaternion_rate(&q, &[nu[3], nu[4], nu[5]])) < 1e-15);
    }

    #[test]
    fn law_wrapped_angles_differ_by_whole_turns(angle in -1e4_f64..1e4) {
        let wrapped = angle.wrap();
        // Rounding of 1e4 rad: 2e-12.
        prop_assert!((-PI - 2e-12..=PI + 2e-12).contains(&wrapped));
        let turns = (angle - wrapped) / TAU;
        prop_assert!((turns - turns.round()).abs() < 1e-11);
    }
}
