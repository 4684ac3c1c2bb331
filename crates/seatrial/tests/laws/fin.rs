//! Lift and drag of a fin in all quadrants.

use crate::vehicles::velocity;
use proptest::prelude::*;
use seatrial::actuator::fin::{Fin, lift_slope};
use seatrial::actuator::motor::Motor;
use seatrial::number::algebra::{Vec6, dot};

/// A rudder aft, upright above the axis.
fn rudder() -> Fin<f64> {
    Fin {
        servo: Motor { k_v: 1.0, t_1: 0.0, t_t: 0.0, rate: None, ideal: true },
        chord: [1.0, 0.0, 0.0],
        normal: [0.0, 1.0, 0.0],
        place: [-1.0, 0.0, -0.2],
        half_rho_area: 0.5 * 1025.0 * 0.02,
        c_la: lift_slope(3.0),
        c_lmax: 1.1,
        c_d0: 0.012,
        c_d90: 1.1,
        k_i: 1.0 / (std::f64::consts::PI * 0.9 * 3.0),
        offset: None,
    }
}

fn wrench(fin: &Fin<f64>, deflection: f64, nu: &Vec6<f64>) -> Vec6<f64> {
    fin.add(deflection.sin_cos(), nu, &[0.0; 6])
}

properties! {
    #![cases(256)]

    #[test]
    fn law_fin_in_line_with_the_flow_only_drags(angle in -3.1..3.1_f64, speed in 0.1..4.0_f64) {
        // Deflected into the flow that comes from there.
        let nu = [speed * angle.cos(), speed * angle.sin(), 0.0, 0.0, 0.0, 0.0];
        let fin = rudder();
        let force = wrench(&fin, angle, &nu);
        let drag = fin.half_rho_area * speed * speed * fin.c_d0;
        // Rounding of up to 160 N, and the 1e-12 m²/s² under the root of the speed.
        prop_assert!((force[0] + drag * angle.cos()).abs() < 1e-9);
        prop_assert!((force[1] + drag * angle.sin()).abs() < 1e-9);
    }

    #[test]
    fn law_fin_drag_takes_energy_and_lift_none(deflection in -1.5..1.5_f64, nu in velocity(3.0, 0.5)) {
        let fin = rudder();
        let power = dot(&wrench(&fin, deflection, &nu), &nu);
        let v: [f64; 2] = [nu[0] - nu[5] * fin.place[1] + nu[4] * fin.place[2],
                           nu[1] + nu[5] * fin.place[0] - nu[3] * fin.place[2]];
        let speed = (v[0] * v[0] + v[1] * v[1]).sqrt();
        let alpha = deflection - v[1].atan2(v[0]);
        let c_l = (0.5 * fin.c_la * (2.0 * alpha).sin()).clamp(-fin.c_lmax, fin.c_lmax);
        let c_d = fin.c_d0 + fin.c_d90 * alpha.sin().powi(2) + fin.k_i * c_l * c_l;
        // Rounding of up to 1 kW.
        prop_assert!((power + fin.half_rho_area * c_d * speed.powi(3)).abs() < 1e-8 * (1.0 + power.abs()));
        prop_assert!(power <= 0.0);
    }

    #[test]
    fn law_fin_is_its_own_mirror_image(deflection in -1.5..1.5_f64, nu in velocity(3.0, 0.5)) {
        let mirrored = [nu[0], -nu[1], nu[2], -nu[3], nu[4], -nu[5]];
        let (one, other) = (wrench(&rudder(), deflection, &nu), wrench(&rudder(), -deflection, &mirrored));
        for (i, sign) in [1.0, -1.0, 1.0, -1.0, 1.0, -1.0].into_iter().enumerate() {
            // Rounding of up to 1 kN.
            prop_assert!((one[i] - sign * other[i]).abs() < 1e-10);
        }
    }

    #[test]
    fn law_fin_turned_about_acts_as_before(deflection in -0.5..0.5_f64, speed in 0.5..3.0_f64) {
        // Half a turn of the fin in the same flow changes nothing: its lift is that of a flat plate's quadrants.
        let nu = [speed, 0.3, 0.0, 0.0, 0.0, 0.0];
        let (one, other) = (wrench(&rudder(), deflection, &nu),
                            wrench(&rudder(), deflection + std::f64::consts::PI, &nu));
        prop_assert!((0..6).all(|i| (one[i] - other[i]).abs() < 1e-9), "{one:?} {other:?}");
    }
}

#[test]
fn law_fin_positive_deflection_pushes_towards_its_normal_and_turns_the_bow_away() {
    let force = wrench(&rudder(), 0.2, &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(force[1] > 0.0, "to starboard");
    assert!(force[5] < 0.0, "a rudder aft turns the bow to port");
    assert!(force[0] < 0.0, "and drags");
    // Small angles: ½ρS c_Lα δ u², Prestero's form; 2 % off by sin 2α/2 and drag.
    let small = rudder().half_rho_area * rudder().c_la * 0.2 * 4.0;
    assert!((force[1] / small - 1.0).abs() < 0.03, "{} {small}", force[1]);
}

#[test]
fn law_fin_at_rest_gives_nothing() {
    // 1e-12 m²/s² under the root: |V| is 1e-6 m/s where there is no flow.
    assert!(wrench(&rudder(), 0.4, &[0.0; 6]).iter().all(|f| f.abs() < 1e-12));
}

#[test]
fn lit_prestero_lift_slope_of_remus_fins() {
    // Prestero (2001), table 4.3 and equation 4.36: aspect ratio 2.21 gives 3.12 per rad.
    assert!((lift_slope(2.21) - 3.12).abs() < 0.005);
}
