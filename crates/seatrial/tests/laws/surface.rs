//! The sea's surface: submerged volumes against clipped ones, energy, the floating draught, and no change under water.

use crate::vehicles::{GRAVITY, attitude, distance, fly, load, moving, times, value, velocity};
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::fit::batch::{Batch, Candidates};
use seatrial::fit::inputs::{Inputs, modes};
use seatrial::fit::record::{MotorStart, Segment};
use seatrial::model::integrate::State;
use seatrial::model::kinematics::{Quaternion, from_euler, rotation};
use seatrial::model::surface::{Surface, propeller_share};
use seatrial::model::vehicle::Vehicle;
use seatrial::number::algebra::{Vec3, dot};
use std::sync::atomic::AtomicBool;

/// Length, width and height of the hulls, m.
const BOX: [f64; 3] = [0.8, 0.5, 0.3];
const TORPEDO: [f64; 2] = [1.6, 0.2];
/// Centre of buoyancy, m.
const CENTRE: Vec3<f64> = [0.02, 0.01, -0.03];

/// A hull without actuators: weight over buoyancy, its geometry and further coefficients.
fn hull(geometry: &str, weight: f64, coefficients: &str) -> Description {
    let text = format!(
        "format = 1\nname = \"hull\"\n[geometry]\n{geometry}\n[coefficients]\nm = {}\nB = {}\nz_g = 0.02\nx_b = {}\ny_b = {}\nz_b = {}\nI_x = 0.9\nI_y = 1.4\nI_z = 1.6\n{coefficients}",
        30.0 * weight,
        30.0 * GRAVITY,
        CENTRE[0],
        CENTRE[1],
        CENTRE[2],
    );
    Description::from_toml(&text, "hull").expect("a valid hull")
}

fn boxed(weight: f64, coefficients: &str) -> Description {
    let [l, w, h] = BOX;
    let shape = format!("shape = \"box\"\nlength_m = {l}\ndiameter_m = {w}\nheight_m = {h}");
    hull(&shape, weight, coefficients)
}

fn torpedo(weight: f64, coefficients: &str) -> Description {
    hull(&format!("length_m = {}\ndiameter_m = {}", TORPEDO[0], TORPEDO[1]), weight, coefficients)
}

const ADDED: &str =
    "X_udot = -6.0\nY_vdot = -20.0\nZ_wdot = -25.0\nK_pdot = -0.2\nM_qdot = -0.9\nN_rdot = -0.8\n";
const DRAG: &str =
    "X_u = -3.0\nX_uu = -12.0\nY_vv = -60.0\nZ_ww = -80.0\nK_p = -0.3\nM_qq = -3.0\nN_r = -0.9\n";
const NO_DRAG: &str = "X_uu = 0.0\nY_vv = 0.0\nZ_ww = 0.0\nK_pp = 0.0\nM_qq = 0.0\nN_rr = 0.0\nX_u = 0.0\nY_v = 0.0\nZ_w = 0.0\nK_p = 0.0\nM_q = 0.0\nN_r = 0.0\n";

fn surface(description: &Description) -> Surface<f64> {
    let vehicle = Vehicle::nominal(description).beneath(description, GRAVITY, Some(0.0));
    vehicle.surface.expect("a surface was given")
}

/// Share and first moment over the volume of a body below the surface, by summing cells.
fn clipped(
    inside: impl Fn(&Vec3<f64>) -> bool,
    size: Vec3<f64>,
    depth: f64,
    n: &Vec3<f64>,
) -> (f64, Vec3<f64>) {
    const CELLS: usize = 60;
    let (mut all, mut wet, mut moment) = (0.0, 0.0, [0.0; 3]);
    for cell in 0..CELLS.pow(3) {
        let at = [cell / CELLS / CELLS, cell / CELLS % CELLS, cell % CELLS];
        let p: Vec3<f64> = std::array::from_fn(|i| size[i] * ((at[i] as f64 + 0.5) / CELLS as f64 - 0.5));
        if !inside(&p) {
            continue;
        }
        all += 1.0;
        let place: Vec3<f64> = std::array::from_fn(|i| p[i] + CENTRE[i]);
        if depth + dot(n, &place) > 0.0 {
            wet += 1.0;
            for i in 0..3 {
                moment[i] += place[i];
            }
        }
    }
    (wet / all, moment.map(|x| x / all))
}

properties! {
    #![cases(16)]

    #[test]
    fn law_the_wet_part_of_a_hull_is_that_of_its_clipped_volume(q in attitude(), share in -1.0..1.0) {
        let n = rotation(&q)[2];
        let round = |p: &Vec3<f64>| p[1].hypot(p[2]) < 0.5 * TORPEDO[1];
        let [length, diameter] = TORPEDO;
        type Inside<'a> = &'a dyn Fn(&Vec3<f64>) -> bool;
        let hulls: [(Description, Vec3<f64>, Inside<'_>, f64); 2] = [
            (boxed(1.0, ""), BOX, &|_| true, 0.012),
            (torpedo(1.0, ""), [length, diameter, diameter], &round, 0.025),
        ];
        for (description, size, inside, tolerance) in hulls {
            let reach: f64 = (0..3).map(|i| 0.5 * size[i] * n[i].abs()).sum();
            let depth = share * reach - dot(&n, &CENTRE);
            let wet = surface(&description).wet(depth, &n, &[0.0; 6]);
            let (exact, moment) = clipped(inside, size, depth, &n);
            // Rounding shrinks a box by 2 %, the disc of two layers is off by 2 %; the cells are 1/60 of the hull.
            prop_assert!((wet.share - exact).abs() < tolerance + 0.008, "{} {exact}", wet.share);
            for i in 0..3 {
                prop_assert!((wet.moment[i] - moment[i]).abs() < (tolerance + 0.008) * size[i] * 0.5 + 1e-4);
            }
        }
    }

    #[test]
    fn law_share_and_moment_are_slopes_of_one_potential(q in attitude(), share in -0.95..0.95) {
        let n = rotation(&q)[2];
        for description in [boxed(1.0, ""), torpedo(1.0, "")] {
            let surface = surface(&description);
            let depth = share * 0.4;
            // dm/dd = ds/dn: the curl of a gradient vanishes. The half widths know n beyond its unit length.
            let step = 1e-6;
            let at = |depth: f64, n: &Vec3<f64>| surface.wet(depth, n, &[0.0; 6]);
            for i in 0..3 {
                let by_depth = (at(depth + step, &n).moment[i] - at(depth - step, &n).moment[i]) / (2.0 * step);
                let moved = |by: f64| std::array::from_fn(|j| n[j] + if i == j { by } else { 0.0 });
                let by_n = (at(depth, &moved(step)).share - at(depth, &moved(-step)).share) / (2.0 * step);
                prop_assert!((by_depth - by_n).abs() < 2e-5 * (1.0 + by_n.abs()), "{by_depth} {by_n}");
            }
        }
    }
}

#[test]
fn law_the_share_grows_with_depth_from_none_to_exactly_all() {
    for description in [boxed(1.0, ""), torpedo(1.0, "")] {
        let surface = surface(&description);
        for euler in [[0.0, 0.0, 0.0], [0.3, 0.1, 0.0], [0.0, 1.57, 0.0], [3.1, -0.7, 0.0]] {
            let n = rotation(&from_euler(&euler))[2];
            let at = |depth: f64| surface.wet(depth, &n, &[0.0; 6]).share;
            let shares: Vec<f64> = (0..=2000).map(|k| at(-1.0 + 0.001 * f64::from(k))).collect();
            // 1e-9: the spline's rounding for a slender hull.
            assert!(shares.windows(2).all(|pair| pair[1] >= pair[0] - 1e-9));
            assert_eq!(shares[0].to_bits(), 0.0f64.to_bits());
            assert_eq!(shares[2000].to_bits(), 1.0f64.to_bits());
        }
    }
}

#[test]
fn law_a_hull_floats_at_its_weight_over_its_waterplane() {
    let [length, width, height] = BOX;
    for weight in [0.3, 0.6, 0.9, 0.98] {
        let description = boxed(weight, "");
        let volume = 30.0 / description.file.environment.rho_kg_m3;
        // The part of the box that displaces: a frame is mostly water.
        let plane = volume / height;
        let draught = 30.0 * weight / (description.file.environment.rho_kg_m3 * plane);
        let depth = description.floating_depth(description.file.environment);
        let found = depth + CENTRE[2] + 0.5 * height;
        assert!((found - draught).abs() < 0.011 * height, "{found} {draught}");
        assert!(length * width > plane);
    }
    // What sinks begins just under water, where the surface is not felt.
    let heavy = boxed(1.01, "");
    let depth = heavy.floating_depth(heavy.file.environment);
    assert!((depth + CENTRE[2] - 0.5 * height).abs() < 0.01 * height);
    assert_eq!(surface(&heavy).wet(depth, &[0.0, 0.0, 1.0], &[0.0; 6]).share.to_bits(), 1.0f64.to_bits());
}

/// Kinetic and potential energy of a hull at the surface, J; that of the buoyancy by summing the share over the depth.
fn energy(description: &Description, state: &State<f64>) -> f64 {
    let (surface, n) = (surface(description), rotation(&state.attitude)[2]);
    let share = |depth: f64| surface.wet(depth, &n, &[0.0; 6]).share;
    let vehicle = Vehicle::nominal(description);
    let (rigid, added) = (vehicle.rigid_body.mass_matrix(), vehicle.added_mass.matrix());
    let wet = share(state.position[2]);
    let mut kinetic = 0.0;
    for i in 0..6 {
        for j in 0..6 {
            kinetic += 0.5 * state.nu[i] * (rigid[i][j] + wet * added[i][j]) * state.nu[j];
        }
    }
    const PANELS: usize = 4000;
    let from = -1.5;
    let width = (state.position[2] - from) / PANELS as f64;
    let middle = |k: usize| from + (k as f64 + 0.5) * width;
    let lifted: f64 = (0..PANELS).map(|k| share(middle(k)) * width).sum();
    let weight = value(description, "m") * GRAVITY;
    let of_g: Vec3<f64> = ["x_g", "y_g", "z_g"].map(|name| value(description, name));
    kinetic + value(description, "B") * lifted - weight * (state.position[2] + dot(&n, &of_g))
}

/// The energies of a hull that is let go at the surface, and of the run's sizes the largest.
fn energies(description: &Description, attitude: Quaternion<f64>, height: f64) -> (Vec<f64>, f64) {
    let inputs = Inputs { t: times(121, 0.05), surface: Some(0.0), ..Inputs::default() };
    let start = State { position: [0.0, 0.0, -height], attitude, nu: [0.2, 0.1, 0.0, 0.1, -0.1, 0.1] };
    let run = fly(description, &inputs, start, "XYZKMN", 50);
    let all: Vec<f64> = run.states.iter().map(|state| energy(description, state)).collect();
    (all, value(description, "m") * GRAVITY * 0.1)
}

properties! {
    #![cases(6)]

    #[test]
    fn law_a_bobbing_hull_keeps_its_energy_without_damping(q in attitude(), height in -0.2..0.3) {
        let upright = from_euler(&[0.4 * q[1], 0.4 * q[2], q[3]]);
        for shaped in [boxed, torpedo] {
            let description = shaped(0.9, &format!("{ADDED}{NO_DRAG}"));
            let (all, size) = energies(&description, upright, height);
            let off = all.iter().map(|e| (e - all[0]).abs()).fold(0.0, f64::max);
            // The sum of panels and the corners of the spline that a step of 1 ms meets.
            prop_assert!(off < 2e-3 * size, "{off} of {size}");
        }
    }

    #[test]
    fn law_a_falling_hull_never_gains_energy_with_damping(q in attitude(), height in -0.2..1.0) {
        let upright = from_euler(&[0.4 * q[1], 0.4 * q[2], q[3]]);
        for shaped in [boxed, torpedo] {
            let description = shaped(0.95, &format!("{ADDED}{DRAG}"));
            let (all, size) = energies(&description, upright, height);
            for pair in all.windows(2) {
                prop_assert!(pair[1] < pair[0] + 5e-4 * size, "{} -> {} of {size}", pair[0], pair[1]);
            }
        }
    }

    #[test]
    fn law_under_water_the_surface_changes_no_bit(q in attitude(), nu in velocity(1.0, 0.8), more in 0.0..0.2) {
        for description in [load("cwolf"), load("bluerov2-heavy"), load("remus100")] {
            let vehicle = Vehicle::nominal(&description).beneath(&description, GRAVITY, Some(0.0));
            let reach = vehicle.surface.as_ref().expect("a surface").reach;
            let run = |surface: Option<f64>| {
                let commands = description.actuators.iter().map(|a| (a.name.clone(), vec![a.command(0.2); 11]));
                let voltage = vec![16.0; 11];
                let inputs = Inputs { t: times(11, 0.1), commands: commands.collect(), voltage, surface, ..Inputs::default() };
                let start = State { position: [0.0, 0.0, 1.6 + reach + more], attitude: q, nu };
                fly(&description, &inputs, start, "XYZKMN", 5)
            };
            let (with, without) = (run(Some(0.0)), run(None));
            for (a, b) in with.states.iter().zip(&without.states) {
                for i in 0..6 {
                    prop_assert_eq!(a.nu[i].to_bits(), b.nu[i].to_bits());
                }
            }
            // Beside the surface, with all of the hull and its actuators just under it.
            let n = rotation(&q)[2];
            let surface = vehicle.surface.as_ref().expect("a surface");
            let mut depth = -reach;
            while surface.wet(depth, &n, &nu).share < 1.0 || !all_fins_and_propellers_deep(&description, depth, &n) {
                depth += 0.005;
            }
            let instant = seatrial::model::vehicle::Instant::default();
            let place = [3.0, -2.0, depth];
            let near = vehicle.acceleration((Some(&place), &rotation(&q)), &nu, &instant);
            let far = vehicle.acceleration((None, &rotation(&q)), &nu, &instant);
            prop_assert_eq!(near.map(f64::to_bits), far.map(f64::to_bits));
        }
    }
}

fn all_fins_and_propellers_deep(description: &Description, depth: f64, n: &Vec3<f64>) -> bool {
    // Half a metre is more than any of these is wide.
    description.actuators.iter().filter_map(|a| a.position).all(|p| depth + dot(n, &p) > 0.1)
}

#[test]
fn law_a_candidate_at_the_surface_is_alone_in_its_result() {
    // Eight masses abreast, of which some float and some sink, against each by itself.
    let description = boxed(0.9, &format!("{ADDED}{DRAG}"));
    let inputs = Inputs { t: times(41, 0.1), surface: Some(0.0), ..Inputs::default() };
    let start = State { position: [0.0, 0.0, 0.1], ..moving([0.3, 0.0, 0.2, 0.1, 0.1, 0.0]) };
    let record = inputs.record(&description, false, 5).unwrap();
    let segment = Segment {
        record: 0,
        start: 0,
        stop: 41,
        state: start,
        current: [0.0; 3],
        motors: MotorStart::Held(vec![]),
    };
    let batch = Batch {
        description: &description,
        records: &[record],
        segments: &[segment],
        modes: modes("XYZKMN", "").unwrap(),
        substeps: 5,
    };
    let values: Vec<f64> = (0..8).map(|k| 20.0 + 2.0 * f64::from(k)).collect();
    let stop = AtomicBool::new(false);
    let mass = description.layout.find("m").unwrap();
    let together = batch.tracks(Candidates { sought: &[mass], values: &values, count: 8 }, &stop).unwrap();
    for (run, &m) in together.iter().zip(&values) {
        let own = description.with_coefficients(&[("m".to_owned(), m)]).unwrap();
        let alone = fly(&own, &inputs, start, "XYZKMN", 5);
        // Lanes fuse multiplication and addition; the corners of the spline amplify that little.
        assert!(distance(&run.states[40].position, &alone.states[40].position) < 1e-9);
        assert!(distance(&run.states[40].nu, &alone.states[40].nu) < 1e-9);
    }
}

#[test]
fn lit_minsaas_a_propeller_loses_thrust_as_its_disc_emerges() {
    let law = |h: f64| match h {
        _ if h < -0.48 => 0.0,
        _ if h > 1.3 => 1.0,
        _ => 1.0 - 0.675 * (1.0 - 0.769 * h).powf(1.258),
    };
    for k in -20..=20 {
        let h = 0.1 * f64::from(k);
        assert!((propeller_share(h) - law(h)).abs() < 0.16, "{h}: {} {}", propeller_share(h), law(h));
    }
    assert_eq!(propeller_share(1.0).to_bits(), 1.0f64.to_bits());
    assert_eq!(propeller_share(-0.5).to_bits(), 0.0f64.to_bits());
}
