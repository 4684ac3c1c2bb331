//! Published numbers that the model reproduces.
//!
//! Taubert: Taubert et al., OCEANS 2014, DOI 10.1109/OCEANS-TAIPEI.2014.6964475, with its errata. Lamb:
//! *The Inertia-Coefficients of an Ellipsoid Moving in Fluid*, R & M 623 (1918). White: *Fluid
//! Mechanics*, drag of finite cylinders. Prestero: REMUS, MIT/WHOI 2001. Da Silva: da Silva et al. (2007),
//! LAUV.

#[path = "support/vehicles.rs"]
mod vehicles;

use seatrial::description::Description;
use seatrial::description::coefficients::{LIFT_NAMES, added_mass, quadratic};
use seatrial::description::geometry::{cross_flow_drag, lamb_factors};
use seatrial::fit::inputs::Inputs;
use seatrial::model::added_mass::AddedMass;
use seatrial::model::current::Current;
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{from_euler, normalised, quaternion_rate, rotation, to_euler};
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::algebra::product;
use seatrial::number::real::Real;
use std::f64::consts::PI;
use vehicles::{GRAVITY, fly, hull, load, moving, times, value, with};

/// The stern propellers of CWolf.
const STERN: [&str; 4] = ["SbU", "SbL", "PU", "PL"];
/// 3 kn, m/s.
const THREE_KNOTS: f64 = 1.543;

/// CWolf without lift: the model of the paper.
fn paper_pure() -> Description {
    with(&load("cwolf"), &LIFT_NAMES.map(|name| (name, 0.0)))
}

/// Commands of `rpm` on all stern propellers for `duration` seconds.
fn ahead(rpm: f64, duration: usize) -> Inputs {
    let count = 10 * duration + 1;
    Inputs {
        t: times(count, 0.1),
        commands: STERN.map(|name| (name.to_owned(), vec![rpm; count])).into(),
        ..Inputs::default()
    }
}

#[test]
fn lit_da_silva_lauv_trims_at_its_thrust() {
    // 8.3398 N hold 1.43 m/s: X_u = X_uu = -2.4.
    let names = ["m", "I_x", "I_y", "I_z", "X_udot", "X_u", "X_uu"];
    let values = [18.0, 0.04, 2.1, 2.1, -1.0, -2.4, -2.4];
    let lauv = hull(&names.map(str::to_owned).into_iter().zip(values).collect::<Vec<_>>());
    let inputs =
        Inputs { t: times(601, 0.1), tau: vec![[8.3398, 0.0, 0.0, 0.0, 0.0, 0.0]], ..Inputs::default() };
    let run = fly(&lauv, &inputs, moving([0.0; 6]), "XYZKMN", 1);
    // Printed digits: 5e-5 N over a slope of 9.3 N s/m.
    assert!((run.states[600].nu[0] - 1.43).abs() < 1e-5, "{}", run.states[600].nu[0]);
}

#[test]
fn lit_lamb_factors_of_prolate_spheroids() {
    // a/b, k1, k2, k' of Lamb's table.
    let table = [
        (1.50, 0.305, 0.621, 0.094),
        (2.00, 0.209, 0.702, 0.240),
        (2.51, 0.156, 0.763, 0.367),
        (2.99, 0.122, 0.803, 0.465),
        (3.99, 0.082, 0.860, 0.608),
        (4.99, 0.059, 0.895, 0.701),
        (6.01, 0.045, 0.918, 0.764),
        (6.97, 0.036, 0.933, 0.805),
        (8.01, 0.029, 0.945, 0.840),
        (9.02, 0.024, 0.954, 0.865),
        (9.97, 0.021, 0.960, 0.883),
    ];
    for (ratio, k1, k2, k_rotation) in table {
        let found = lamb_factors(2.0 * ratio, 1.0);
        // Reckoned by hand: the worst entry, k2 at 2.00, is 0.0022 from the formula.
        for (factor, printed) in found.iter().zip([k1, k2, k_rotation]) {
            assert!((factor - printed).abs() < 2.5e-3, "a/b = {ratio}: {found:?}");
        }
    }
}

#[test]
fn lit_lamb_factors_of_the_sphere() {
    let [k1, k2, k_rotation] = lamb_factors(2.0 * 1.001, 1.0);
    // 1/2, 1/2, 0 in the limit; linear in the 0.1 % of elongation, and cancellation of e^-3.
    assert!((k1 - 0.5).abs() < 1e-3 && (k2 - 0.5).abs() < 1e-3 && k_rotation.abs() < 1e-5);
}

#[test]
fn lit_white_drag_of_finite_cylinders() {
    let table =
        [(1.0, 0.64), (2.0, 0.68), (3.0, 0.72), (5.0, 0.74), (10.0, 0.82), (20.0, 0.91), (40.0, 0.98)];
    for (slenderness, drag) in table {
        // Rounding: these are the knots.
        assert!((cross_flow_drag(slenderness) - drag).abs() < 1e-15);
    }
    // CWolf's 0.80 at l/d = 8.33, to its two digits.
    assert!((cross_flow_drag(2.5 / 0.3) - 0.80).abs() < 0.01);
}

#[test]
fn lit_taubert_cwolf_added_mass_and_the_spheroids_own() {
    let cwolf = load("cwolf");
    let [k1, k2, k_rotation] = lamb_factors(2.5, 0.15);
    // The paper normalises by m and the cylinder's I_y; factors to the digits that it prints.
    for (name, factor, normaliser) in [
        ("X_udot", k1, 135.0),
        ("Y_vdot", k2, 135.0),
        ("Z_wdot", k2, 135.0),
        ("N_rdot", k_rotation, 71.071875),
    ] {
        let found = value(&cwolf, name);
        assert!((found + factor * normaliser).abs() < 6e-4 * normaliser, "{name} = {found}");
    }
    let start = |i: usize| cwolf.start_values[added_mass(i, i)].expect("filled from the geometry");
    for (i, printed, digits) in [(0, -3.32, 5e-3), (1, -114.5, 0.05), (4, -32.5, 0.05)] {
        assert!((start(i) - printed).abs() < digits, "{}", start(i));
    }
    // (10): the total surge mass is 139 kg, not -131 kg.
    assert!((Vehicle::nominal(&cwolf).mass_matrix[0][0] - 138.71).abs() < 1e-10);
}

#[test]
fn lit_taubert_cwolf_drag() {
    let cwolf = load("cwolf");
    let frontal = 0.5 * 1025.0 * PI * 0.15 * 0.15;
    // (24) with C_Dx = 0.27, (27) with 0.80, (29) and (31) corrected with 1.2: printed digits.
    assert!((value(&cwolf, "X_uu") + frontal * 0.27).abs() < 5e-3);
    assert!((value(&cwolf, "Y_vv") + 0.5 * 1025.0 * 0.80 * 0.75).abs() < 0.05);
    assert!((value(&cwolf, "N_rr") + 1025.0 * 0.80 * 0.15 * 2.5_f64.powi(4) / 32.0).abs() < 5e-3);
    assert!((value(&cwolf, "K_pp") + 0.5 * 1025.0 * 1.2 * 0.1 * 0.2_f64.powi(3)).abs() < 5e-4);
    // The start values differ by the drag coefficient alone: 0.793 of White's curve instead of 0.80.
    for (name, index) in [("Y_vv", quadratic(1, 1)), ("M_qq", quadratic(4, 4)), ("N_rr", quadratic(5, 5))] {
        let start = cwolf.start_values[index].expect("filled from the geometry");
        assert!((start / value(&cwolf, name) - cross_flow_drag(2.5 / 0.3) / 0.80).abs() < 1e-4, "{name}");
    }
    let roll = cwolf.start_values[quadratic(3, 3)].expect("filled from the geometry");
    assert!((roll - value(&cwolf, "K_pp")).abs() < 1e-9);
    // (25), (26): 15.6 N at 3 kn; the bare hull's start value.
    let bare = cwolf.file.geometry.as_ref().expect("a geometry").axial_drag();
    assert!((bare * frontal * THREE_KNOTS * THREE_KNOTS - 15.6).abs() < 0.05);
}

#[test]
fn lit_taubert_cwolf_bollard_thrust() {
    let vehicle = Vehicle::nominal(&load("cwolf"));
    for (actuator, rpm, printed) in
        [(0, 2000.0, 82.7), (3, -2000.0, -59.0), (4, 2000.0, 28.5), (5, -2000.0, -25.1)]
    {
        let force = vehicle.actuators[actuator].characteristic.thrust(rpm, f64::NAN).force;
        // Printed digits.
        assert!((force - printed).abs() < 0.06, "{force} N at {rpm} rpm");
    }
}

#[test]
fn lit_taubert_cwolf_reaches_six_knots() {
    let steady = |rpm: f64| {
        let run = fly(&load("cwolf"), &ahead(rpm, 100), moving([0.0; 6]), "X", 2);
        run.states[1000].nu[0]
    };
    // Table I: 6 kn = 3.09 m/s at 2000 rpm; the thruster's characteristic is assumed: 5 %.
    assert!((steady(2000.0) - 3.09).abs() < 0.15, "{}", steady(2000.0));
    // Errata: -2.4 m/s astern, to its two digits.
    assert!((steady(-2000.0) + 2.4).abs() < 0.1, "{}", steady(-2000.0));
}

#[test]
fn lit_taubert_pitch_is_stable_with_the_corrected_restoring_moment() {
    // (33) as printed makes pitch grow e-fold in 2.2 s; corrected, it swings with 2π times that.
    let names = ["X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r", "X_uu", "Y_vv", "Z_ww", "K_pp", "M_qq", "N_rr"];
    let weight = 135.0 * GRAVITY;
    let undamped = with(&with(&paper_pure(), &names.map(|name| (name, 0.0))), &[("B", weight)]);
    let time = ((71.071875 + 60.27) / (weight * 0.02)).sqrt();
    assert!((time - 2.2).abs() < 0.05, "{time}");
    let inputs = Inputs { t: times(2001, 0.01), ..Inputs::default() };
    let start = State { attitude: from_euler(&[0.0, 0.02, 0.0]), ..moving([0.0; 6]) };
    let run = fly(&undamped, &inputs, start, "M", 1);
    for (k, state) in run.states.iter().enumerate() {
        let pitch = to_euler(&state.attitude)[1];
        let expected = 0.02 * (0.01 * k as f64 / time).cos();
        // The pendulum's period grows by θ²/16 = 2.5e-5 of 9 rad.
        assert!((pitch - expected).abs() < 0.02 * 3e-4, "sample {k}: {pitch} {expected}");
    }
    // (32) as printed leaves 2648 N at neutral buoyancy.
    let force = Vehicle::nominal(&undamped).forces(&rotation(&start.attitude), &[0.0; 6], None).restoring;
    assert!((2.0 * weight - 2648.0).abs() < 1.0 && force[2].abs() < 1e-9, "{force:?}");
}

#[test]
fn lit_taubert_cwolf_without_lift_is_course_unstable() {
    // Straight ahead at 1000 rpm in the horizontal plane with a trace of sway: it ends spinning at
    // -24 °/s; hull and fins hold the course.
    let end = |description: &Description, duration: usize| {
        let start = moving([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]);
        let run = fly(description, &ahead(1000.0, duration), start, "XYN", 2);
        run.states[10 * duration].nu[5].to_degrees()
    };
    // The published figure names neither revolutions nor free axes: 5 %.
    assert!((end(&paper_pure(), 300) + 24.0).abs() < 1.2, "{}", end(&paper_pure(), 300));
    assert!(end(&load("cwolf"), 300).abs() < 1e-6, "{}", end(&load("cwolf"), 300));
}

/// Attitude and position after 60 s in a current, with `M_A ν_c'` or without it.
fn turn(description: &Description, flow: [f64; 3], complete: bool) -> ([f64; 3], [f64; 3]) {
    let vehicle = Vehicle::nominal(description);
    let thrusts: Vec<_> = [1500.0, 1500.0, 1200.0, 1200.0, 0.0, 0.0]
        .iter()
        .zip(&vehicle.actuators)
        .map(|(rpm, actuator)| actuator.characteristic.thrust(*rpm, f64::NAN))
        .collect();
    let current = Current { velocity: flow, rate: [0.0; 3] };
    let rate = |state: &[f64; 13]| {
        let [_, _, _, w, x, y, z, nu @ ..] = *state;
        let r = rotation(&[w, x, y, z]);
        let nu_c_rate = current.relative(&r, &nu).1;
        let missing = vehicle.added_mass.momentum(&nu_c_rate).map(|f| if complete { 0.0 } else { -f });
        let instant =
            Instant { thrusts: thrusts.clone(), tau: missing, current: Some(current), ..Instant::default() };
        let [n, e, d] = product(&r, &[nu[0], nu[1], nu[2]]);
        let [qw, qx, qy, qz] = quaternion_rate(&[w, x, y, z], &[nu[3], nu[4], nu[5]]);
        let [u, v, heave, p, q, yaw] = vehicle.acceleration(&r, &nu, &instant);
        [n, e, d, qw, qx, qy, qz, u, v, heave, p, q, yaw]
    };
    let mut state = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    let h = 0.02;
    for _ in 0..3000 {
        let at = |slope: &[f64; 13], h: f64| std::array::from_fn(|i| state[i] + h * slope[i]);
        let a = rate(&state);
        let b = rate(&at(&a, 0.5 * h));
        let c = rate(&at(&b, 0.5 * h));
        let d = rate(&at(&c, h));
        state = std::array::from_fn(|i| state[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]));
        let unit = normalised(&[state[3], state[4], state[5], state[6]]);
        state[3..7].copy_from_slice(&unit);
    }
    (to_euler(&[state[3], state[4], state[5], state[6]]), [state[0], state[1], state[2]])
}

#[test]
fn lit_taubert_turning_in_a_current_needs_the_waters_acceleration() {
    let flow = [0.0, 0.5, 0.0];
    let (whole, part) = (turn(&paper_pure(), flow, true), turn(&paper_pure(), flow, false));
    let yaw = (whole.0[2] - part.0[2]).wrap().to_degrees().abs();
    let off = (0..3).map(|i| (whole.1[i] - part.1[i]).powi(2)).sum::<f64>().sqrt();
    // Errata of (6): 52° and 8.4 m after 60 s in 0.5 m/s; the manoeuvre is not published: 15 %.
    assert!((yaw - 52.0).abs() < 8.0, "{yaw} degrees");
    assert!((off - 8.4).abs() < 1.3, "{off} m");
    // In still water the term is nothing.
    assert_eq!(turn(&paper_pure(), [0.0; 3], true), turn(&paper_pure(), [0.0; 3], false));
}

#[test]
fn lit_prestero_remus_munk_moment_and_rotation_terms() {
    // X_udot = -0.93 and Y_vdot = -35.5: of the published N_uv = -24 and Y_ur = 5.22 the model's M_A holds
    // -34.57 and -0.93, so that +10.57 and +6.15 are left for lift and fins.
    let added = AddedMass::Diagonal([0.93, 35.5, 35.5, 0.0704, 4.88, 4.88]);
    let munk = added.add_coriolis(&[1.0, 1.0, 0.0, 0.0, 0.0, 0.0], &[0.0; 6]);
    // Decimal fractions, exact to rounding.
    assert!((munk[5] + 34.57).abs() < 1e-14);
    assert!((-24.0 - munk[5] - 10.57).abs() < 1e-13);
    let turning = added.add_coriolis(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0], &[0.0; 6]);
    assert!((turning[1] + 0.93).abs() < 1e-15);
    assert!((5.22 - turning[1] - 6.15).abs() < 1e-14);
}
