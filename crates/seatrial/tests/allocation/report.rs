//! What the built-in vehicles can command.

use crate::vehicles::load;
use seatrial::control::allocation::authority;

#[test]
fn cwolf_cannot_command_roll_and_has_rank_four_in_practice() {
    let cwolf = authority(&load("cwolf"), 0.0);
    assert_eq!((cwolf.rank, cwolf.numerical_rank), (4, 5));
    assert_eq!(cwolf.commanded(), ["X", "Z", "M", "N"]);
    let roll = &cwolf.rows[3];
    assert!(roll.size > 1e-3 && roll.size < 4e-3, "0.002 of the largest: {}", roll.size);
    // All from assumed cant, places and propellers (vehicles/cwolf.toml). 0.00118 m times what each stern propeller gives in the roll's direction: two ahead 82.7, two astern 59.0 N.
    assert!((roll.reach[0] - 0.00118 * 2.0 * (82.7 + 59.0)).abs() < 2e-3, "{:?}", roll.reach);
    let said = cwolf.sentences().join(" ");
    assert!(said.contains("K cannot be commanded: singular value 0.00"), "{said}");
    assert!(said.contains("All of surge, heave, pitch and yaw remain after the loss of SbU."), "{said}");
    assert!(said.contains("Y cannot be commanded by itself"), "{said}");
    // One pair of propellers gives surge and yaw: 2 × 82.7 × 0.933 N ahead each side.
    assert!((cwolf.rows[0].reach[0] - 4.0 * 82.7 * 0.933).abs() < 0.5, "{:?}", cwolf.rows[0]);
    assert!((cwolf.losses[0].reach[0][0] - 3.0 * 82.7 * 0.933).abs() < 0.5);
}

#[test]
fn golden_hovering_vehicles_command_six_rows_without_any_one_thruster() {
    for name in ["beluga", "bluerov2-heavy"] {
        let report = authority(&load(name), 0.0);
        assert_eq!(report.commanded(), ["X", "Y", "Z", "K", "M", "N"], "{name}");
        assert_eq!(report.rank, 6);
        for loss in &report.losses {
            assert!(loss.share.iter().all(|share| *share > 0.999), "{name}: {loss:?}");
        }
        assert_eq!(report.sentences().len(), 9, "{:?}", report.sentences());
    }
}

#[test]
fn golden_vehicles_with_fins_steer_under_way_only() {
    for name in ["remus100", "lauv"] {
        let description = load(name);
        let (rest, under_way) = (authority(&description, 0.0), authority(&description, 1.5));
        assert_eq!(rest.commanded(), ["X"], "{name}");
        assert_eq!(rest.rank, 1);
        let said = rest.sentences().join(" ");
        assert!(said.contains("N cannot be commanded"), "{said}");
        assert!(under_way.rows[5].reach[0] > 0.5, "{name}: {under_way:?}");
        // Twice the speed, four times the moment: the square.
        let faster = authority(&description, 3.0);
        let ratio = faster.rows[5].reach[0] / under_way.rows[5].reach[0];
        assert!((ratio - 4.0).abs() < 1e-6, "{ratio}");
        println!("{name}: {:#?}", under_way.sentences());
    }
}
