//! The mode table at work.

use crate::closed_loop::flights::{AUTOPILOT, DIVE, Trip, case, column};
use seatrial::control::autopilot::settings::Settings;

/// From rest the vehicle hovers, then cruises, and switches once.
#[test]
fn law_modes_change_at_their_speed_and_do_not_chatter() {
    let mut trip = Trip::cwolf(DIVE);
    for channel in &mut trip.sensors.errors[6..9] {
        channel.noise = 0.03; // a Doppler log: more than the speed rises in a period
    }
    let outcome = trip.one(case([0.0, 0.3, 0.0]));
    let (mode, speed) = (column(&trip, &outcome, "mode"), column(&trip, &outcome, "measured_u_water"));
    // The mission complete, it holds its last waypoint and so hovers.
    let under_way = column(&trip, &outcome, "done").iter().filter(|done| **done == 0.0).count();
    let changes: Vec<usize> = (1..under_way).filter(|&k| mode[k] != mode[k - 1]).collect();
    assert_eq!(changes.len(), 1, "{changes:?}");
    assert_eq!((mode[0], mode[under_way - 1]), (0.0, 1.0));
    assert!(speed[changes[0]] >= 0.8, "{}", speed[changes[0]]);
}

/// What the actuators reach does not jump when the depth passes from the vertical thrusters to the pitch angle.
#[test]
fn law_modes_switch_without_a_bump() {
    let trip = Trip::cwolf(DIVE);
    let outcome = trip.one(case([0.0; 3]));
    let mode = column(&trip, &outcome, "mode");
    let k = (1..mode.len()).find(|&k| mode[k] != mode[k - 1]).expect("a change of mode");
    for (row, tau_max) in [("demanded_X", 250.0), ("demanded_M", 40.0), ("demanded_N", 60.0)] {
        let demand = column(&trip, &outcome, row);
        let usual = (k - 10..k - 1).map(|i| (demand[i + 1] - demand[i]).abs()).fold(0.0, f64::max);
        let jump = (demand[k] - demand[k - 1]).abs();
        // What it moves anyway, and 3 % of what the loop may ask for.
        assert!(jump <= usual + 0.03 * tau_max, "{row}: {jump:.3} against {usual:.3} before");
    }
}

fn refused(from: &str, to: &str) -> String {
    let text = AUTOPILOT;
    assert!(text.contains(from), "the file has no {from:?}");
    Settings::from_toml(&text.replacen(from, to, 1), "a.toml").expect_err("must be refused").to_string()
}

#[test]
fn law_autopilot_files_are_refused_with_their_key() {
    for (from, to, says) in [
        ("period_s = 0.1", "period_s = 0.0", "a.toml: period_s: expected a positive number"),
        ("[-5.0, -3.0,", "[-5.0, -5.0,", "schedule.speeds_m_s: expected 6 strictly increasing"),
        (
            "\"surge\", \"heave\"",
            "\"surge\", \"heve\"",
            "modes[1] \"hover\".loops: unknown loop \"heve\"; did you mean \"heave\"?",
        ),
        ("depth_by = \"pitch\"", "depth_by = \"heave\"", "modes[2] \"cruise\".depth_by"),
        (
            "from_speed_m_s = 0.8",
            "from_speed_m_s = -0.8",
            "from_speed_m_s: expected zero or a positive number",
        ),
        ("hysteresis_m_s = 0.2", "hysteresis_m_s = 0.9", "hysteresis_m_s: expected from zero to below"),
        ("K_P = 23.7", "K_P = -23.7", "loops.heave.K_P: expected zero or a positive number"),
        ("K_P = 23.7", "K_P = [1.0, 2.0]", "expected one number, or six"),
        ("K_P = 23.7", "K_P = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]", "expected one number, or six"),
        ("3.0, 5.0]", "3.0, 5.0, 7.0]", "expected 6 numbers, found 7"),
        ("tau_max = 50.0", "tau_max = 0.0", "loops.heave.tau_max: expected a positive number"),
        ("[loops.heave]", "[loops.heav]", "did you mean \"heave\"?"),
        ("format = 1", "format = 2", "this version reads format = 1"),
    ] {
        let message = refused(from, to);
        assert!(message.contains(says), "{message}\nexpected: {says}");
    }
}

#[test]
fn law_autopilots_go_round_through_their_file() {
    let text = AUTOPILOT;
    let settings = Settings::from_toml(text, "cwolf").expect("valid");
    let again = Settings::from_toml(&settings.file.to_toml(), "again").expect("valid");
    assert_eq!(settings.file, again.file);
    let changed = settings
        .with_tunables(&[("heading.K_P.3".into(), 40.0), ("guidance.lookahead_m".into(), 12.0)])
        .expect("valid");
    assert_eq!(changed.file.loops.heading.as_ref().expect("a loop").k_p.points()[2], 40.0);
    assert_eq!(changed.file.guidance.lookahead_m, 12.0);
    let message =
        settings.with_tunables(&[("sway.K_P.1".into(), 1.0)]).expect_err("no sway loop").to_string();
    assert!(message.contains("no such loop"), "{message}");
}
