//! A tether: by hand, without gain of energy, in equilibrium with a current, with exact derivatives, as the file has it.

use crate::vehicles::{attitude, distance, load, velocity};
use proptest::prelude::*;
use seatrial::description::Description;
use seatrial::description::vehicle_file::TetherTable;
use seatrial::model::current::Current;
use seatrial::model::kinematics::rotation;
use seatrial::model::tether::{Spring, Tether};
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::dual::Dual;

const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

fn spring(stiffness: f64) -> Option<Spring<f64>> {
    Some(Spring { stiffness, anchor: [0.0, 0.0, 2.0], slack: 10.0 })
}

/// CWolf with a tether at its stern.
fn tethered(coefficients: &[(&str, f64)], anchor: Option<[f64; 3]>) -> Description {
    let mut file = load("cwolf").file;
    let slack_m = anchor.map(|_| 30.0);
    file.tether = Some(TetherTable { position_m: [-1.2, 0.0, -0.1], anchor_m: anchor, slack_m });
    file.coefficients.extend(coefficients.iter().map(|(name, value)| ((*name).to_owned(), *value)));
    Description::new(file, "tethered").expect("a vehicle")
}

#[test]
fn golden_tether_by_hand() {
    let tether = Tether { place: [-1.0, 0.0, 0.0], drag: 50.0, spring: spring(4.0) };
    let r = rotation(&UPRIGHT);
    // 50 kg/m · (2 m/s)² = 200 N against the motion; turning alone: 1 m · 0.5 rad/s, 12.5 N at 1 m.
    let ahead = tether.add((None, &r), &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], &[1.0; 6]);
    assert!(distance(&ahead, &[-199.0, 1.0, 1.0, 1.0, 1.0, 1.0]) < 1e-9, "{ahead:?}");
    let turning = tether.add((None, &r), &[0.0, 0.0, 0.0, 0.0, 0.0, 0.5], &[0.0; 6]);
    assert!(distance(&turning, &[0.0, 12.5, 0.0, 0.0, 0.0, -12.5]) < 1e-9, "{turning:?}");
    // The stern at 13 m north and 2 m down is 13 m from the anchor: 3 m beyond the slack length pull with 12 N.
    let taut = tether.add((Some(&[14.0, 0.0, 2.0]), &r), &[0.0; 6], &[0.0; 6]);
    assert!(distance(&taut, &[-12.0, 0.0, 0.0, 0.0, 0.0, 0.0]) < 1e-9, "{taut:?}");
    let slack = tether.add((Some(&[10.5, 0.0, 2.0]), &r), &[0.0; 6], &[0.0; 6]);
    assert!(distance(&slack, &[0.0; 6]) < 1e-9, "{slack:?}");
}

properties! {
    #![cases(256)]

    #[test]
    fn law_tether_drag_never_adds_energy(nu in velocity(3.0, 2.0), x in -2.0..2.0, y in -1.0..1.0, z in -1.0..1.0) {
        let tether = Tether { place: [x, y, z], drag: 40.0, spring: None };
        let force = tether.add((None, &rotation(&UPRIGHT)), &nu, &[0.0; 6]);
        let power: f64 = (0..6).map(|i| nu[i] * force[i]).sum();
        let size: f64 = (0..6).map(|i| (nu[i] * force[i]).abs()).sum();
        // −c |v_p|³, to the rounding of six products.
        prop_assert!(power <= 1e-14 * size, "{power:e} of {size:e}");
    }

    #[test]
    fn law_tether_derivatives_are_difference_quotients(
        nu in velocity(3.0, 2.0), q in attitude(), north in 12.0..40.0, east in -20.0..20.0, column in 0_usize..9,
    ) {
        let position = [north, east, 5.0];
        let force = |change: f64| {
            let tether = Tether { place: [-1.0, 0.1, -0.2], drag: 40.0, spring: spring(3.0) };
            let (mut place, mut moving) = (position, nu);
            if column < 3 { place[column] += change } else { moving[column - 3] += change }
            tether.add((Some(&place), &rotation(&q)), &moving, &[0.0; 6])
        };
        let seed = |i: usize, value: f64| Dual { value, partials: if i == column { 1.0 } else { 0.0 } };
        let still = |value: f64| Dual { value, partials: 0.0 };
        let own = Spring { stiffness: still(3.0), anchor: [0.0, 0.0, 2.0], slack: 10.0 };
        let tether = Tether { place: [-1.0, 0.1, -0.2], drag: still(40.0), spring: Some(own) };
        let place = std::array::from_fn(|i| seed(i, position[i]));
        let moving = std::array::from_fn(|i| seed(3 + i, nu[i]));
        let r = rotation(&q.map(still));
        let exact = tether.add((Some(&place), &r), &moving, &[still(0.0); 6]).map(|x| x.partials);
        let (more, less) = (force(1e-5), force(-1e-5));
        let quotient: [f64; 6] = std::array::from_fn(|i| (more[i] - less[i]) / 2e-5);
        // Central differences: rounding of 1e3 N over the step.
        prop_assert!(distance(&exact, &quotient) < 1e-5, "{exact:?} against {quotient:?}");
    }
}

#[test]
fn law_tether_holds_a_vehicle_in_a_current_where_its_stretch_bears_the_drag() {
    let (area, stiffness, speed) = (0.08, 15.0, 0.6);
    let description = tethered(&[("A_tether", area), ("k_tether", stiffness)], Some([0.0, 0.0, 2.0]));
    let vehicle = Vehicle::nominal(&description);
    let rho = description.file.environment.rho_kg_m3;
    // Stern towards the anchor, heading with the current: the hull and the tether's part drag it along.
    let current = Current { velocity: [speed, 0.0, 0.0], rate: [0.0; 3], pressed: None };
    let r = rotation(&UPRIGHT);
    let plain = Vehicle::nominal(&tethered(&[], None));
    let hull = plain.forces(&r, &[0.0; 6], Some(&current)).damping[0];
    let stretch = (hull + 0.5 * rho * area * speed * speed) / stiffness;
    let surge = |north: f64| {
        let instant = Instant { current: Some(current), ..Instant::default() };
        vehicle.acceleration((Some(&[north, 0.0, 2.1]), &r), &[0.0; 6], &instant)[0]
    };
    let at_rest = 30.0 + stretch + 1.2;
    let scale = (surge(at_rest + stretch)).abs();
    assert!(stretch > 0.5, "{stretch} m");
    assert!(surge(at_rest).abs() < 1e-9 * scale, "{:e}", surge(at_rest));
    assert!(surge(at_rest + 0.1) < 0.0 && surge(at_rest - 0.1) > 0.0, "it is stable");
}

#[test]
fn a_tether_is_read_written_and_refused() {
    let description = tethered(&[("A_tether", 0.08), ("k_tether", 15.0)], Some([0.0, 5.0, 0.0]));
    let text = description.filled_file().to_toml();
    let again = Description::from_toml(&text, "again").expect("reads back");
    assert_eq!(
        (&again.coefficients, &again.file.tether),
        (&description.coefficients, &description.file.tether)
    );
    let index = |name: &str| description.layout.index(name).expect("known");
    assert_eq!(description.layout.unit(index("A_tether"), ""), "m2");
    assert!(description.uses(index("k_tether")) && !tethered(&[], None).uses(index("k_tether")));
    let bare = load("cwolf");
    for (name, part) in [("A_tether", "[tether] with position_m"), ("k_tether", "anchor_m and slack_m")] {
        let message = bare.with_coefficients(&[(name.into(), 0.1)]).expect_err("no tether").to_string();
        assert!(message.contains(name) && message.contains(part), "{message}");
    }
    let half = tethered(&[], None).with_coefficients(&[("k_tether".into(), 1.0)]);
    assert!(half.expect_err("no anchor").to_string().contains("anchor_m"));
    let mut file = bare.file.clone();
    file.tether = Some(TetherTable { position_m: [0.0; 3], anchor_m: Some([0.0; 3]), slack_m: None });
    assert!(
        Description::new(file, "boat.toml").expect_err("no length").to_string().contains("tether.slack_m")
    );
}

#[test]
fn without_a_tether_nothing_changes() {
    let (plain, slack) = (load("cwolf"), tethered(&[], Some([0.0, 0.0, 0.0])));
    let nu = [1.2, 0.1, -0.05, 0.02, 0.1, -0.2];
    let of = |d: &Description| {
        let r = rotation(&UPRIGHT);
        Vehicle::nominal(d).acceleration((Some(&[1e3, 0.0, 3.0]), &r), &nu, &Instant::default())
    };
    assert_eq!(of(&plain), of(&slack), "no area and no stiffness: no tether");
}
