//! No chatter about the minimum revolutions.

use crate::allocation::setup::Setup;
use crate::vehicles::load;
use seatrial::actuator::motor::Limits;
use seatrial::control::allocation::minimum::Hold;

fn hold(idle: f64) -> Hold {
    let limits = Limits { maximum: [2000.0, 1500.0], minimum: [150.0, 200.0], dead_band: false };
    Hold::new(&limits, [1.0, 0.5], idle)
}

/// How often a motor starts, stops or reverses.
fn switches(wanted: impl Iterator<Item = f64>, hold: &Hold) -> usize {
    let (mut turning, mut count) = (0.0, 0);
    for wanted in wanted {
        let before = turning;
        let held = hold.hold(wanted, &mut turning);
        count += usize::from(turning != before);
        assert!(
            held == 0.0 || (150.0..=2000.0).contains(&held) || (-1500.0..=-200.0).contains(&held),
            "{held}"
        );
        assert!(held * wanted >= 0.0 || held.abs() <= 200.0);
    }
    count
}

#[test]
fn law_minimum_is_crossed_once_by_a_sweep() {
    let sweep = (-3000..=3000).map(f64::from);
    // Astern turning stops at -100, ahead starts at 150.
    assert_eq!(switches(sweep, &hold(0.0)), 3);
    let back = (-3000..=3000).rev().map(f64::from);
    assert_eq!(switches(back, &hold(0.0)), 3);
}

#[test]
fn law_minimum_does_not_chatter_in_noise() {
    // Uniform noise of ±35 rpm about the threshold on a slow rise: less than the band from 75 to 150 rpm.
    let mut seed = 1_u64;
    let mut noise = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        35.0 * ((seed >> 33) as f64 / f64::from(1_u32 << 30) - 1.0)
    };
    let rise: Vec<f64> = (0..4000).map(|i| 100.0 + 0.025 * f64::from(i) + noise()).collect();
    assert_eq!(switches(rise.iter().copied(), &hold(0.0)), 1);
    let limits = Limits { maximum: [2000.0; 2], minimum: [150.0; 2], dead_band: false };
    let without = Hold::new(&limits, [1.0, 1.0], 0.0);
    assert!(switches(rise.into_iter(), &without) > 100, "without the band the same noise chatters");
}

#[test]
fn law_minimum_states() {
    let hold = hold(0.0);
    let mut turning = 0.0;
    // Wanted, held: rest, start, stay, stop, stay at rest, reverse at once, zero.
    for (wanted, held) in [
        (150.0, 0.0),
        (151.0, 151.0),
        (80.0, 150.0),
        (74.0, 0.0),
        (149.0, 0.0),
        (5000.0, 2000.0),
        (-150.0, 0.0),
        (400.0, 400.0),
        (-201.0, -201.0),
        (-5000.0, -1500.0),
        (-150.0, -200.0),
        (0.0, 0.0),
        (-150.0, 0.0),
    ] {
        assert_eq!(hold.hold(wanted, &mut turning), held, "wanted {wanted}");
    }
}

#[test]
fn law_minimum_an_idling_actuator_never_stops() {
    for (wanted, held) in [(0.0, 150.0), (-900.0, 150.0), (160.0, 160.0), (3000.0, 2000.0)] {
        assert_eq!(hold(300.0).hold(wanted, &mut 0.0), held);
        assert_eq!(hold(-300.0).hold(-wanted, &mut 0.0), -held.clamp(200.0, 1500.0));
    }
}

#[test]
fn law_allocation_does_not_chatter_about_the_minimum_and_says_what_it_reaches() {
    let mut setup = Setup::new(load("cwolf"), "");
    setup.prepare(&[0.0, 0.0, 0.0, 0.0, 1.0, 1.0], 0.0);
    let (mut before, mut switches) = ([0.0; 6], 0);
    for step in 0..2000 {
        // 0.16 N per vertical thruster is 150 rpm: the heave sweeps across it and back, with noise.
        let heave = 0.6 * f64::sin(0.00314 * f64::from(step)) + 0.03 * f64::sin(2.4 * f64::from(step));
        let tau = [0.0, 0.0, heave, 0.0, 0.0, 0.0];
        let reached = setup.allocate(&tau, &[0.0; 6]);
        let signals: [f64; 6] = std::array::from_fn(|k| setup.signals[k]);
        switches += (4..6).filter(|&k| (signals[k] == 0.0) != (before[k] == 0.0)).count();
        before = signals;
        if signals[4] == 0.0 && signals[5] == 0.0 {
            // Nothing turns: nothing is reached.
            assert!(reached[2].abs() < 1e-9);
        } else if signals[4].abs() > 150.0 && signals[5].abs() > 150.0 {
            assert!((reached[2] - heave).abs() < 1e-9, "{reached:?}");
        }
    }
    // Two motors start and stop once in each half of the period, up and down.
    assert_eq!(switches, 8);
}

#[test]
fn law_allocation_about_an_idle_pair() {
    // Two thrusters that oppose each other and never stop: heave and pitch come from their difference.
    let mut file = load("cwolf").file;
    file.thrusters[5].position_m = Some([0.7, 0.0, 0.0]);
    file.thrusters[5].direction = Some([0.0, 0.0, -1.0]);
    let description = seatrial::description::Description::new(file, "opposed").unwrap();
    let mut setup = Setup::new(description, "idle = { VTB = 600.0, VTS = 600.0 }");
    setup.rows = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    setup.prepare(&[0.0, 0.0, 0.0, 0.0, 1.0, 1.0], 0.0);
    for heave in [0.0, 0.5, -0.5, 2.0, -2.0, 4.0] {
        let reached = setup.allocate(&[0.0, 0.0, heave, 0.0, 0.0, 0.0], &[0.0; 6]);
        assert!(setup.signals[4] >= 150.0 && setup.signals[5] >= 150.0, "{:?}", setup.signals);
        // 1e-6: the pair's idle wrench cancels to the written digits. Rounding beyond.
        assert!((reached[2] - heave).abs() < 1e-8, "{heave}: {reached:?}");
    }
    setup.prepare(&[0.0; 6], 0.0);
    setup.allocate(&[0.0; 6], &[0.0; 6]);
    assert_eq!(setup.signals, [0.0; 6]);
}
