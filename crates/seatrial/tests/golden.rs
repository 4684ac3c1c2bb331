//! Numbers that other programs computed: the terms of the equation of motion reproduce them.
//!
//! Sources: MSS toolbox (Fossen & Perez) run unmodified in Octave 7.3; the hydrodynamics unit test of
//! gz-sim; Lamb's factors checked by quadrature; the formulas of Taubert et al. (2014) at CWolf's size.

use crate::vehicles::{distance, load, value};
use seatrial::actuator::wrench::wrench_per_newton;
use seatrial::description::coefficients::{added_mass, quadratic};
use seatrial::description::geometry::{Geometry, Shape, lamb_factors};
use seatrial::model::added_mass::AddedMass;
use seatrial::model::kinematics::{from_euler, rotation};
use seatrial::model::restoring::Restoring;
use seatrial::model::rigid_body::RigidBody;
use seatrial::model::vehicle::Vehicle;
use seatrial::number::algebra::{Mat3, product, skew};

/// MSS `rbody`: 20 kg, radii of gyration 0.3, 0.5, 0.6 m about the centre of gravity.
fn mss_body() -> RigidBody<f64> {
    // Its M_RB's rotational block; products of inertia enter with a minus.
    RigidBody::new(20.0, [0.05, -0.01, 0.02], [1.81, 5.058, 7.252, -0.01, 0.02, -0.004])
}

#[test]
fn golden_mss_rbody_mass_matrix() {
    let matrix = mss_body().mass_matrix();
    let coupling = [[0.0, 0.4, 0.2], [-0.4, 0.0, 1.0], [-0.2, -1.0, 0.0]];
    let rotational = [[1.81, 0.01, -0.02], [0.01, 5.058, 0.004], [-0.02, 0.004, 7.252]];
    for i in 0..3 {
        for j in 0..3 {
            // Rounding of one product.
            assert_eq!(matrix[i][j], if i == j { 20.0 } else { 0.0 });
            assert!((matrix[i][3 + j] - coupling[i][j]).abs() < 1e-15);
            assert!((matrix[3 + i][j] - coupling[j][i]).abs() < 1e-15);
            assert!((matrix[3 + i][3 + j] - rotational[i][j]).abs() < 1e-15);
        }
    }
}

#[test]
fn golden_mss_rbody_parallel_axes() {
    // I_g = I_O + m S(r_g)² is m times the squared radii of gyration, so the block above is about O.
    let matrix = mss_body().mass_matrix();
    let s = skew(&[0.05, -0.01, 0.02]);
    let square: Mat3<f64> = std::array::from_fn(|i| product(&s, &[s[0][i], s[1][i], s[2][i]]));
    for (i, radius) in [0.3_f64, 0.5, 0.6].iter().enumerate() {
        for (j, entry) in square[i].iter().enumerate() {
            let expected = if i == j { 20.0 * radius * radius } else { 0.0 };
            // Rounding of 7 kg m².
            assert!((matrix[3 + i][3 + j] + 20.0 * entry - expected).abs() < 1e-14);
        }
    }
}

#[test]
fn golden_mss_rbody_coriolis() {
    // C(4,5), C(4,6), C(5,6) of MSS at ω = (0.1, -0.2, 0.3); without v they make the whole moment.
    let (c45, c46, c56) = (2.1548, 0.9974, 0.167);
    let [p, q, r] = [0.1, -0.2, 0.3];
    let moment = [c45 * q + c46 * r, -c45 * p + c56 * r, -c46 * p - c56 * q];
    let force = mss_body().add_coriolis(&[0.0, 0.0, 0.0, p, q, r], &[0.0; 6]);
    // MSS's figures are exact to rounding: four decimals suffice for these inputs.
    assert!(distance(&[-force[3], -force[4], -force[5]], &moment) < 1e-14, "{force:?}");
}

#[test]
fn golden_mss_gvect() {
    let restoring = Restoring::new((320.0, [0.01, 0.02, 0.03]), (318.0, [0.005, -0.01, 0.0]), 9.81);
    let expected = [
        0.3973386615901224,
        0.1956867900145114,
        -1.950340654403632,
        -10.28142832666305,
        3.477249802427512,
        -1.745724323055005,
    ];
    for yaw in [0.0, 1.0, -2.5] {
        let force = restoring.add(&rotation(&from_euler(&[-0.1, 0.2, yaw])), &[0.0; 6]);
        // Rounding of 320 N; the figures hold 16 digits.
        assert!(distance(&force.map(|x| -x), &expected) < 1e-13, "{force:?}");
    }
}

/// A bare hull.
fn geometry(length_m: f64, diameter_m: f64) -> Geometry {
    Geometry {
        length_m,
        diameter_m,
        height_m: None,
        shape: Shape::Spheroid,
        design_speed_m_s: 1.543,
        kinematic_viscosity_m2_s: 1.19e-6,
        appendages: vec![],
    }
}

/// The start value of a coefficient for a hull of mass `m`.
fn start_value(geometry: &Geometry, m: f64, rho: f64, index: usize) -> f64 {
    let values = geometry.start_values(m, rho);
    values.iter().find(|start| start.index == index).expect("filled from the geometry").value
}

#[test]
fn golden_mss_imlay61_added_mass() {
    // a = 0.8 m, b = 0.095 m, rho = 1026. Roll is no formula but a share of the inertia: left out.
    let expected = [0.8389085933377652, 29.43763661573727, 29.43763661573727];
    let rotational = [3.426210114723613, 3.426210114723613];
    let of = |i| -start_value(&geometry(1.6, 0.19), 31.0, 1026.0, added_mass(i, i));
    // The logarithm of a slender body loses two digits.
    assert!(distance(&[of(0), of(1), of(2)], &expected) < 1e-11);
    assert!(distance(&[of(4), of(5)], &rotational) < 1e-12);
}

#[test]
fn golden_gz_sim_added_mass_coriolis() {
    // Entries C(1,5), C(1,6), C(4,5), C(4,6), C(5,6) at nu = 1 … 6. gz-sim's M_A = diag(-1 … -6) holds the
    // derivatives; ours holds the positive masses.
    let added = AddedMass::Diagonal([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let nu = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let force = added.add_coriolis(&nu, &[0.0; 6]);
    // Row 1 is C(1,5) q + C(1,6) r. Exact: small integers.
    assert_eq!(-force[0], 9.0 * 5.0 - 4.0 * 6.0);
    // Row 4 repeats the entries of row 1 for v and w.
    assert_eq!(-force[3], 9.0 * 2.0 - 4.0 * 3.0 + 36.0 * 5.0 - 25.0 * 6.0);
    let spin = added.add_coriolis(&[0.0, 0.0, 0.0, 4.0, 5.0, 6.0], &[0.0; 6]);
    assert_eq!(-spin[3], 36.0 * 5.0 - 25.0 * 6.0);
    assert_eq!(-spin[4], -36.0 * 4.0 + 16.0 * 6.0);
    assert_eq!(-spin[5], 25.0 * 4.0 - 16.0 * 5.0);
}

#[test]
fn golden_prolate_spheroid_lamb_factors() {
    let [k1, k2, k_rotation] = lamb_factors(2.5, 0.15);
    // As many digits as the reference prints.
    assert!((k1 - 0.02748).abs() < 5e-6, "{k1}");
    assert!((k2 - 0.94791).abs() < 5e-6, "{k2}");
    assert!((k_rotation - 0.84841).abs() < 5e-6, "{k_rotation}");
}

#[test]
fn golden_cwolf_inertia_and_spheroid() {
    let hull = geometry(2.5, 0.3);
    let start = |index| start_value(&hull, 135.0, 1025.0, index);
    // Decimal fractions, exact to rounding.
    assert!((start(1) - 1.51875).abs() < 1e-14);
    assert!((start(2) - 71.071875).abs() < 1e-12);
    assert_eq!(start(2), start(3));
    // The spheroid's mass and inertia, by Lamb's factors: as many digits as the reference prints.
    let [k1, _, k_rotation] = lamb_factors(2.5, 0.15);
    assert!((-start(added_mass(0, 0)) / k1 - 120.75).abs() < 0.05);
    assert!((-start(added_mass(5, 5)) / k_rotation - 38.28).abs() < 0.005);
}

#[test]
fn golden_cwolf_drag_coefficients() {
    let hull = geometry(2.5, 0.3);
    // (25), (26) by hand: C_Dx = 0.181 at 3 kn with C_f = 0.00369; the lateral area is 0.75 m². Their digits.
    assert!((hull.axial_drag() - 0.181).abs() < 5e-4, "{}", hull.axial_drag());
    let slenderness = 2.5 / 0.3;
    let friction =
        (hull.axial_drag() - 0.44 / slenderness) / (4.0 * (slenderness + 1.0 / slenderness.sqrt()));
    assert!((friction - 0.00369).abs() < 5e-6, "{friction}");
    let lateral = start_value(&hull, 135.0, 1025.0, quadratic(1, 1));
    let area = -lateral / (0.5 * 1025.0 * seatrial::description::geometry::cross_flow_drag(slenderness));
    assert!((area - 0.75).abs() < 1e-12);
}

#[test]
fn golden_cwolf_yaw_levers() {
    let vehicle = Vehicle::nominal(&load("cwolf"));
    // By hand, of the propellers canted outward and of axial ones at the same (assumed) place; three digits.
    assert!((vehicle.actuators[0].wrench[5] + 0.395).abs() < 5e-4);
    assert!((vehicle.actuators[2].wrench[5] - 0.395).abs() < 5e-4);
    let axial = wrench_per_newton(&[-1.08, 0.134, -0.134], &[1.0, 0.0, 0.0]).unwrap();
    assert!((axial[5] + 0.134).abs() < 1e-15);
}

#[test]
fn golden_cwolf_allocation_has_rank_five() {
    let vehicle = Vehicle::nominal(&load("cwolf"));
    let mut rows: Vec<Vec<f64>> =
        (0..6).map(|i| vehicle.actuators.iter().map(|a| a.wrench[i]).collect()).collect();
    // In roll the cant of the propellers all but cancels their places: singular value 0.002.
    let roll = rows[3].iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((roll - 0.002).abs() < 5e-4, "{roll}");
    // Gauss with full pivoting: the pivots left after the rank are rounding.
    let mut pivots = Vec::new();
    while !rows.is_empty() {
        let place = |rows: &[Vec<f64>]| {
            let each = rows
                .iter()
                .enumerate()
                .flat_map(|(i, r)| r.iter().enumerate().map(move |(j, x)| (i, j, x.abs())));
            each.fold((0, 0, 0.0), |best, x| if x.2 > best.2 { x } else { best })
        };
        let (i, j, size) = place(&rows);
        pivots.push(size);
        let pivot = rows.swap_remove(i);
        for row in &mut rows {
            let factor = if size > 0.0 { row[j] / pivot[j] } else { 0.0 };
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
        }
    }
    assert!(pivots[4] > 1e-3, "{pivots:?}");
    // Directions are written with six digits: the fifth and sixth pivots are three decades apart.
    assert!(pivots[5] < 1e-6, "{pivots:?}");
}

#[test]
fn golden_lauv_straight_and_level_drag() {
    // da Silva et al. (2007): 2.4 u + 2.4 u² = 8.3398 N at 1.43 m/s.
    let lauv = crate::vehicles::with(&crate::vehicles::hull(&body()), &[("X_u", -2.4), ("X_uu", -2.4)]);
    assert_eq!(value(&lauv, "X_u"), -2.4);
    let forces = Vehicle::nominal(&lauv).forces(
        &rotation(&[1.0, 0.0, 0.0, 0.0]),
        &[1.43, 0.0, 0.0, 0.0, 0.0, 0.0],
        None,
    );
    // Printed digits.
    assert!((forces.damping[0] + 8.3398).abs() < 5e-5, "{:?}", forces.damping);
    assert_eq!(forces.damping[1..], [0.0; 5]);
}

/// A body of the LAUV's mass: the drag does not depend on it.
fn body() -> Vec<(String, f64)> {
    let values = [("m", 18.0), ("I_x", 0.04), ("I_y", 2.1), ("I_z", 2.1), ("X_udot", -1.0)];
    values.map(|(name, value)| (name.to_owned(), value)).into()
}
