//! The deflection gives the force along the normal that is asked for.

use crate::allocation::setup::Setup;
use crate::vehicles::{load, with};
use proptest::prelude::*;
use seatrial::model::vehicle::Vehicle;
use seatrial::number::algebra::dot;

properties! {
    #![cases(256)]

    #[test]
    fn law_fin_deflection_gives_the_force(
        u in prop_oneof![-2.5..-0.5_f64, 0.5..3.0_f64],
        across in proptest::array::uniform2(-0.15..0.15_f64),
        turns in proptest::array::uniform3(-0.1..0.1_f64),
        share in 0.0..1.0_f64,
        offset in -0.15..0.15_f64,
    ) {
        for name in ["remus100", "lauv"] {
            let nu_r = [1.0, across[0], across[1], turns[0], turns[1], turns[2]].map(|share| share * u);
            let fins = load(name).file.fins;
            let offsets: Vec<String> = fins.iter().map(|fin| format!("{}.offset", fin.name)).collect();
            let offsets: Vec<(&str, f64)> = offsets.iter().map(|name| (name.as_str(), offset)).collect();
            let description = with(&load(name), &offsets);
            let [limit, _] = description.actuators[1].limits.maximum;
            for fin in &Vehicle::nominal(&description).fins {
                let flow = fin.flow(&nu_r);
                // The same deflections, whatever the offset: Newton's steps converge there.
                let ends = fin.working_range([limit + offset, limit - offset], &flow);
                let [one, other] = ends.map(|angle| fin.normal_force(angle, &flow));
                let wanted = one + share * (other - one);
                let signal = fin.signal(wanted, &flow);
                prop_assert!((signal + offset).abs() <= limit + 1e-9, "{name}: {signal}");
                let found = fin.normal_force(signal, &flow);
                // Rounding of up to 50 N; Newton's steps have converged at these inflow angles.
                prop_assert!((found - wanted).abs() < 1e-9, "{name}: {found} {wanted} at {signal}");
                let whole = fin.add((signal + offset).sin_cos(), &nu_r, &[0.0; 6]);
                let along = dot(&[whole[0], whole[1], whole[2]], &fin.normal);
                prop_assert!((found - along).abs() < 1e-12 * (1.0 + along.abs()), "{found} {along}");
            }
        }
    }

    #[test]
    fn law_fins_reach_the_wrench_under_way(
        (m, n) in (-1.0..1.0_f64, -1.0..1.0_f64),
        u in 1.0..2.5_f64,
        across in proptest::array::uniform2(-0.05..0.05_f64),
        follow in any::<bool>(),
    ) {
        for name in ["remus100", "lauv"] {
            let mut setup = Setup::new(load(name), &format!("fin_inflow = {follow}"));
            setup.rows = [1.0, 0.0, 0.0, 0.0, 1.0, 1.0];
            setup.prepare(&[1.0; 5], u);
            let nu_r = [u, across[0] * u, across[1] * u, 0.0, 0.0, 0.0];
            let tau = [4.0, 0.0, 0.0, 0.0, m * u * u, n * u * u];
            let reached = setup.allocate(&tau, &nu_r);
            // Rounding of a few newtons, and of 1/(sigma² + lambda) with sigma² > 1e-3.
            prop_assert!(setup.miss(&tau, &reached) < 1e-7, "{name}: {reached:?}");
            // A pair shares the work where it meets the same water.
            if across == [0.0; 2] {
                prop_assert!((setup.signals[1] - setup.signals[2]).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn law_fins_are_held_at_zero_without_way() {
    let mut setup = Setup::new(load("remus100"), "fin_least_speed_m_s = 0.4");
    let tau = [2.0, 0.0, 0.0, 0.0, 1.0, 1.0];
    for (speed, held) in [(0.0, true), (0.39, true), (0.41, false), (-1.0, false)] {
        setup.prepare(&[1.0; 5], speed);
        let reached = setup.allocate(&tau, &[speed, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(setup.signals[1..].iter().all(|x| *x == 0.0), held, "{speed}: {:?}", setup.signals);
        // Rounding.
        assert!(reached[0] > 1.9 && (!held || (reached[0] - 2.0).abs() < 1e-9), "{reached:?}");
        assert!(setup.signals[1..].iter().all(|x| x.abs() <= 0.2374));
    }
}

#[test]
fn law_fins_that_do_not_follow_the_inflow_leave_the_hull_its_stability() {
    let nu_r = [1.5, 0.1, 0.0, 0.0, 0.0, 0.0];
    for (follow, at_rest) in [("true", false), ("false", true)] {
        let mut setup = Setup::new(load("remus100"), &format!("fin_inflow = {follow}"));
        setup.prepare(&[1.0; 5], 1.5);
        let reached = setup.allocate(&[0.0; 6], &nu_r);
        // Rounding.
        assert!(reached.iter().all(|x| x.abs() < 1e-9), "{reached:?}");
        assert_eq!(setup.signals[1].abs() < 1e-12, at_rest, "{:?}", setup.signals);
    }
}
