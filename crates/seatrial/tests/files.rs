//! Vehicle files: what is wrong is refused with its place and a way out; what is right survives a round
//! trip.

use crate::vehicles::{load, value, with};
use proptest::prelude::*;
use seatrial::description::coefficients::{HULL, PER_ACTUATOR};
use seatrial::description::{Description, built_in, built_in_names};
use std::collections::BTreeMap;

/// A small vehicle with one thruster.
const FILE: &str = r#"
format = 1
name = "test"
controllable = ["X", "N"]

[environment]
rho_kg_m3 = 1000.0

[coefficients]
m = 30.0
I_x = 1.0
I_y = 2.0
I_z = 2.0
X_udot = -5.0

[motors.drive]
maximum_ahead = 100.0
T_1_s = 0.1

[characteristics.thrust]
kind = "direct"

[[thrusters]]
name = "bow"
command = "N"
position_m = [0.5, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
motor = "drive"
characteristic = "thrust"
"#;

/// The message about the file when `old` is replaced by `new`.
fn complaint(old: &str, new: &str) -> String {
    assert_eq!(FILE.matches(old).count(), 1, "{old:?} must stand once in the file");
    match Description::from_toml(&FILE.replace(old, new), "boat.toml") {
        Err(error) => error.to_string(),
        Ok(_) => panic!("{new:?} was accepted"),
    }
}

/// Checks that the message names the file and every part.
fn says(message: &str, parts: &[&str]) {
    for part in [&["boat.toml"], parts].concat() {
        assert!(message.contains(part), "expected {part:?} in {message:?}");
    }
}

#[test]
fn the_test_file_is_valid() {
    let description = Description::from_toml(FILE, "boat.toml").unwrap();
    assert_eq!(description.actuators.len(), 1);
    assert_eq!(value(&description, "X_udot"), -5.0);
    // Neutrally buoyant where B is missing: exact, one product.
    assert_eq!(value(&description, "B"), 30.0 * 9.81);
}

#[test]
fn misspelt_keys_are_refused_with_the_nearest_name() {
    for (old, new, parts) in [
        ("controllable =", "controlable =", ["controlable", "did you mean \"controllable\"", "line 4"]),
        ("rho_kg_m3", "rho_kg_m", ["rho_kg_m", "did you mean \"rho_kg_m3\"", "line 7"]),
        ("maximum_ahead", "max_ahead", ["max_ahead", "did you mean \"maximum_ahead\"", "line 17"]),
        ("T_1_s", "T1_s", ["T1_s", "did you mean \"T_1_s\"", "line 18"]),
        ("position_m", "position", ["position", "did you mean \"position_m\"", "line 26"]),
        ("X_udot", "X_udt", ["coefficients", "X_udt", "did you mean \"X_udot\""]),
        ("\"direct\"", "\"dirct\"", ["dirct", "did you mean \"direct\"", "line"]),
        ("\"N\"\nposition", "\"kN\"\nposition", ["kN", "did you mean \"N\"", "line 25"]),
    ] {
        says(&complaint(old, new), &parts);
    }
}

#[test]
fn unknown_keys_of_a_characteristic_are_refused() {
    let message = complaint("kind = \"direct\"", "kind = \"quadratic\"\nalpha1_ahed = 0.3");
    says(&message, &["alpha1_ahed", "did you mean \"alpha1_ahead\""]);
    let message = complaint("kind = \"direct\"", "kind = \"table\"\nsignals = [0, 1]\nforce_n = [[0, 1]]");
    says(&message, &["signals", "did you mean \"signal\""]);
}

#[test]
fn missing_keys_are_named() {
    says(&complaint("name = \"test\"\n", ""), &["name"]);
    says(&complaint("characteristic = \"thrust\"", ""), &["characteristic"]);
    says(&complaint("m = 30.0\n", ""), &["coefficients.m", "missing", "weigh"]);
    says(&complaint("I_y = 2.0\n", ""), &["missing coefficients.I_y", "moment of inertia", "geometry"]);
}

#[test]
fn values_of_the_wrong_type_are_refused_with_their_line() {
    says(
        &complaint("m = 30.0", "m = \"heavy\""),
        &["line 10", "m: expected a number, without its unit, found the text"],
    );
    says(&complaint("position_m = [0.5, 0.0, 0.0]", "position_m = [0.5, 0.0]"), &["line"]);
    says(&complaint("format = 1", "format = "), &["line 2"]);
}

#[test]
fn another_format_is_refused() {
    says(&complaint("format = 1", "format = 2"), &["format = 1", "found 2"]);
    // Also where the other format has keys that this one does not know.
    says(&complaint("format = 1", "format = 2\nrudders = 4"), &["format = 1", "found 2"]);
}

#[test]
fn impossible_masses_are_refused() {
    says(&complaint("m = 30.0", "m = -30.0"), &["coefficients.m", "positive", "-30"]);
    says(&complaint("m = 30.0", "m = 0.0"), &["coefficients.m", "positive", "found 0"]);
    says(&complaint("I_z = 2.0", "I_z = -2.0"), &["I_z", "positive", "-2"]);
    says(&complaint("I_z = 2.0", "I_z = 2.0\nI_xz = 1.5"), &["positive definite", "axis N"]);
    says(&complaint("X_udot = -5.0", "X_udot = 35.0"), &["positive definite", "axis X", "negative"]);
    says(&complaint("X_udot = -5.0", "Y_rdot = 8.0"), &["positive definite", "axis N"]);
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for text in ["nan", "inf", "-inf"] {
        says(&complaint("m = 30.0", &format!("m = {text}")), &["coefficients.m", "expected a", "found"]);
        says(&complaint("X_udot = -5.0", &format!("N_r = {text}")), &["N_r", "finite"]);
        says(&complaint("rho_kg_m3 = 1000.0", &format!("rho_kg_m3 = {text}")), &["rho_kg_m3", "positive"]);
        says(&complaint("T_1_s = 0.1", &format!("T_1_s = {text}")), &["motors.drive.T_1_s", "found"]);
        says(&complaint("T_1_s = 0.1", &format!("K_V = {text}")), &["motors.drive.K_V", "found"]);
        says(
            &complaint("direction = [1.0", &format!("direction = [{text}")),
            &["bow", "direction", "finite"],
        );
        says(&complaint("position_m = [0.5", &format!("position_m = [{text}")), &["bow", "finite"]);
        let polynomial = format!("kind = \"polynomial\"\nahead = [0, {text}, 0]\nastern = [0, 1, 0]");
        says(&complaint("kind = \"direct\"", &polynomial), &["characteristics.thrust.ahead", "finite"]);
    }
    says(&complaint("maximum_ahead = 100.0", "maximum_ahead = nan"), &["motors.drive.maximum_ahead", "NaN"]);
}

#[test]
fn motors_must_be_possible() {
    says(&complaint("T_1_s = 0.1", "T_1_s = -0.1"), &["drive.T_1_s", "zero or a positive", "-0.1"]);
    says(&complaint("T_1_s = 0.1", "T_t_s = -0.1"), &["drive.T_t_s", "zero or a positive", "-0.1"]);
    says(&complaint("T_1_s = 0.1", "K_V = 0.0"), &["drive.K_V", "a positive number", "found 0"]);
    says(&complaint("T_1_s = 0.1", "n_acc_per_s = 0.0"), &["drive.n_acc_per_s", "a positive number"]);
    says(&complaint("maximum_ahead = 100.0", "maximum_ahead = -100.0"), &["drive", "positive magnitude"]);
}

#[test]
fn thruster_names_are_unique() {
    let twice = "characteristic = \"thrust\"\n[[thrusters]]\nname = \"bow\"\ncommand = \"N\"\n\
                 wrench_per_newton = [1, 0, 0, 0, 0, 0]\ncharacteristic = \"thrust\"";
    says(&complaint("characteristic = \"thrust\"", twice), &["thrusters[1].name", "unique", "bow"]);
    says(&complaint("name = \"bow\"", "name = \"bow.1\""), &["thrusters[0].name", "without a dot"]);
    says(&complaint("name = \"bow\"", "name = \"\""), &["thrusters[0].name"]);
}

#[test]
fn a_thruster_has_one_place() {
    let either = ["bow", "either position_m and direction, or wrench_per_newton"];
    let both = "direction = [1.0, 0.0, 0.0]\nwrench_per_newton = [1, 0, 0, 0, 0, 0]";
    says(&complaint("direction = [1.0, 0.0, 0.0]", both), &either);
    says(&complaint("direction = [1.0, 0.0, 0.0]\n", ""), &["missing thrusters[0].direction", "thrust"]);
    says(&complaint("direction = [1.0, 0.0, 0.0]", "direction = [0.0, 0.0, 0.0]"), &["bow", "no length"]);
}

#[test]
fn references_must_exist() {
    says(&complaint("motor = \"drive\"", "motor = \"drve\""), &["bow", "drve", "did you mean \"drive\""]);
    says(
        &complaint("characteristic = \"thrust\"", "characteristic = \"thrst\""),
        &["bow", "thrst", "did you mean \"thrust\""],
    );
    says(&complaint("[\"X\", \"N\"]", "[\"X\", \"R\"]"), &["controllable", "\"R\""]);
}

#[test]
fn characteristics_must_be_possible() {
    for (lines, parts) in [
        ("kind = \"quadratic\"\np1_ahead = 0.1", ["bow", "rpm"]),
        ("kind = \"table\"\nsignal = [0, 1, 1]\nforce_n = [[0, 1, 2]]", ["bow", "increasing"]),
        ("kind = \"table\"\nsignal = [0, 1]\nforce_n = [[0, 1, 2]]", ["bow", "1 rows of 2 numbers"]),
        ("kind = \"table\"\nsignal = [0, 1]\nforce_n = [[0, nan]]", ["thrust.force_n", "finite"]),
        (
            "kind = \"table\"\nsignal = [0, 1]\nvoltage_v = [2, 1]\nforce_n = [[0, 1], [0, 1]]",
            ["bow", "voltage"],
        ),
    ] {
        says(&complaint("kind = \"direct\"", lines), &parts);
    }
    let cwolf = built_in("cwolf").unwrap();
    for (old, new) in
        [("alpha1_ahead = 0.35", "p1_ahead = 0.1\nalpha1_ahead = 0.35"), ("diameter_m = 0.12", "")]
    {
        let error = Description::from_toml(&cwolf.replace(old, new), "boat.toml").unwrap_err().to_string();
        says(&error, &["SbU", "either p1_ahead", "diameter_m"]);
    }
}

#[test]
fn the_two_names_of_an_added_mass_must_agree() {
    let message = complaint("X_udot = -5.0", "Y_rdot = 0.5\nN_vdot = 0.4");
    says(&message, &["Y_rdot: found 0.5", "N_vdot = 0.4", "symmetric", "one of the two"]);
    let same = FILE.replace("X_udot = -5.0", "Y_rdot = 0.5\nN_vdot = 0.5");
    assert_eq!(value(&Description::from_toml(&same, "boat.toml").unwrap(), "N_vdot"), 0.5);
    let changes = [("Y_rdot", 0.5), ("N_vdot", 0.4)].map(|(name, x)| (name.to_owned(), x));
    let error = load("cwolf").with_coefficients(&changes).unwrap_err().to_string();
    assert!(error.contains("symmetric") && error.contains("N_vdot"), "{error}");
}

#[test]
fn wrong_geometry_is_refused() {
    for (geometry, parts) in [
        ("length_m = 0.2\ndiameter_m = 0.3", ["longer than wide", "box"]),
        ("length_m = 2.0\ndiameter_m = -0.3", ["geometry.diameter_m", "-0.3"]),
        ("length_m = nan\ndiameter_m = 0.3", ["geometry.length_m", "NaN"]),
        ("length_m = 2.0\ndiameter_m = 0.3\nshape = \"ball\"", ["ball", "spheroid"]),
        (
            "length_m = 2.0\ndiameter_m = 0.3\nappendages = [{ area_m2 = nan, arm_m = 0.1 }]",
            ["geometry.appendages[0].area_m2", "found NaN"],
        ),
    ] {
        says(&complaint("[coefficients]", &format!("[geometry]\n{geometry}\n[coefficients]")), &parts);
    }
}

#[test]
fn geometry_fills_what_is_missing_and_nothing_else() {
    let lines = "[geometry]\nlength_m = 2.0\ndiameter_m = 0.3\n[coefficients]";
    let text = FILE.replace("[coefficients]", lines).replace("I_x = 1.0\nI_y = 2.0\n", "");
    let filled = Description::from_toml(&text, "boat.toml").unwrap();
    assert_eq!((value(&filled, "X_udot"), value(&filled, "I_z")), (-5.0, 2.0));
    // A cylinder of 30 kg, to rounding.
    assert!((value(&filled, "I_x") - 0.5 * 30.0 * 0.15 * 0.15).abs() < 1e-15);
    assert!((value(&filled, "I_y") - 30.0 * (4.0 + 3.0 * 0.0225) / 12.0).abs() < 1e-14);
    for name in ["Y_vdot", "Z_wdot", "K_pdot", "M_qdot", "N_rdot", "X_uu", "Y_vv", "Z_ww", "M_qq", "N_rr"] {
        assert!(value(&filled, name) < 0.0, "{name}");
    }
    // No formula gives linear damping or lift.
    assert_eq!((value(&filled, "X_u"), value(&filled, "Y_uv")), (0.0, 0.0));
    let box_text = text.replace("[geometry]", "[geometry]\nshape = \"box\"");
    let message = Description::from_toml(&box_text, "boat.toml").unwrap_err().to_string();
    says(&message, &["3 facts are missing", "geometry.height_m", "coefficients.B", "coefficients.z_b"]);
}

#[test]
fn a_box_and_a_frame_are_filled_from_three_measures() {
    let lines = "[geometry]\nshape = \"box\"\nlength_m = 0.6\nwidth_m = 0.4\nheight_m = 0.3\n[trim]\nweight_in_water_kg = -0.5\nrighting_arm_m = 0.02\n[coefficients]";
    let text = FILE.replace("[coefficients]", lines).replace("I_x = 1.0\nI_y = 2.0\n", "");
    let closed = Description::from_toml(&text, "boat.toml").unwrap();
    let open = Description::from_toml(&text.replace("\"box\"", "\"frame\""), "boat.toml").unwrap();
    // A homogeneous box of 30 kg, to rounding.
    assert!((value(&closed, "I_x") - 30.0 * (0.16 + 0.09) / 12.0).abs() < 1e-14);
    // DNV-RP-H103: plate of 0.3 m by 0.4 m, C_A = 0.658 between 0.642 and 0.690, sides 0.6 m deep.
    let lambda = 0.12_f64.sqrt() / (0.12_f64.sqrt() + 0.6);
    let sides = 1.0 + ((1.0 - lambda * lambda) / (2.0 * (1.0 + lambda * lambda))).sqrt();
    let ahead = 1000.0 * 0.658 * std::f64::consts::FRAC_PI_4 * 0.09 * 0.4 * sides;
    // What the file gives stays: X_udot. The same plate moves in no other axis.
    assert_eq!(value(&closed, "X_udot"), -5.0);
    let formula = |d: &Description, name: &str| d.start_values[d.layout.index(name).unwrap()].unwrap();
    assert!((formula(&closed, "X_udot").value + ahead).abs() < 1e-10);
    assert!((formula(&open, "X_udot").value + 0.343 * ahead).abs() < 1e-10);
    for d in [&closed, &open] {
        for (name, expected) in [("B", 30.5 * 9.81), ("z_b", -0.02)] {
            assert!((value(d, name) - expected).abs() < 1e-12, "{name}");
        }
        for name in ["Y_vdot", "K_pdot", "X_uu", "K_pp", "X_u", "K_p", "N_r"] {
            assert!(value(d, name) < 0.0, "{name}");
            let [low, high] = formula(d, name).interval();
            assert!(low < value(d, name) && value(d, name) < high, "{name}");
        }
    }
    // Written and read again it is the same, a zero in the place of a start value too.
    let still = with(&open, &[("Y_v", 0.0)]);
    assert_eq!(again(&still).coefficients, still.coefficients);
}

#[test]
fn the_environment_is_checked_and_has_defaults() {
    let description = Description::from_toml(&FILE.replace("rho_kg_m3 = 1000.0", ""), "boat.toml");
    let message = description.unwrap_err().to_string();
    says(&message, &["rho_kg_m3"]);
    let plain = FILE.replace("[environment]\nrho_kg_m3 = 1000.0\n", "");
    let environment = Description::from_toml(&plain, "boat.toml").unwrap().file.environment;
    assert_eq!((environment.rho_kg_m3, environment.g_m_s2), (1025.0, 9.81));
}

/// The vehicle written as a file and read again.
fn again(description: &Description) -> Description {
    let text = description.filled_file().to_toml();
    Description::from_toml(&text, "again").unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn built_in_vehicles_survive_a_round_trip() {
    for name in built_in_names() {
        let description = load(name);
        let copy = again(&description);
        assert_eq!(copy.coefficients, description.coefficients, "{name}");
        for (a, b) in copy.actuators.iter().zip(&description.actuators) {
            assert_eq!((a.limits, a.wrench, a.table()), (b.limits, b.wrench, b.table()), "{name}");
        }
        assert_eq!(again(&copy).filled_file(), copy.filled_file());
    }
}

#[test]
fn zeros_survive_a_round_trip() {
    // A zero in place of what the geometry or the file would fill.
    let bare =
        with(&load("cwolf"), &[("B", 0.0), ("X_uu", 0.0), ("z_b", 0.0), ("SbU.gain", 0.0), ("Y_uv", 0.0)]);
    assert_eq!(again(&bare).coefficients, bare.coefficients);
}

#[test]
fn a_vehicle_of_another_water_survives_a_round_trip() {
    let text = built_in("cwolf").unwrap().replace("rho_kg_m3 = 1025.0", "rho_kg_m3 = 998.2");
    let description = Description::from_toml(&text, "fresh").unwrap();
    assert_eq!(again(&description).coefficients, description.coefficients);
}

properties! {
    #![cases(64)]

    #[test]
    fn changed_coefficients_survive_a_round_trip(
        which in proptest::collection::vec((0_usize..HULL + 6 * PER_ACTUATOR, 0.5_f64..1.5), 1..20),
        tiny in -1e12_f64..1e12,
        beluga in any::<bool>(),
    ) {
        let description = load(if beluga { "beluga" } else { "cwolf" });
        let changes: BTreeMap<String, f64> = which
            .iter()
            .filter(|(index, _)| description.uses(*index))
            .map(|(index, factor)| (description.layout.name(*index), factor * description.coefficients[*index]))
            .chain([("Y_r".to_owned(), tiny), ("N_vv".to_owned(), -tiny)])
            .collect();
        // Exact: the file writes the shortest decimals that read back as the same number.
        let changes: Vec<(String, f64)> = changes.into_iter().collect();
        let changed = description.with_coefficients(&changes).unwrap();
        prop_assert_eq!(again(&changed).coefficients, changed.coefficients);
    }
}

/// A fourth number of a place is refused, not passed over.
#[test]
fn rows_of_numbers_have_their_length() {
    let text = built_in("cwolf").unwrap();
    let place = text.lines().find(|line| line.starts_with("position_m = [")).unwrap();
    let longer = text.replacen(place, &place.replacen('[', "[0.0, ", 1), 1);
    let message = Description::from_toml(&longer, "long.toml").expect_err("four numbers").to_string();
    assert!(
        message.contains("long.toml: line ") && message.contains("expected 3 numbers, found 4"),
        "{message}"
    );
}

#[test]
fn what_is_no_number_is_named_with_its_key() {
    let unfilled = complaint("m = 30.0", "m = \"FILL IN: mass in air with the water inside, kg\"");
    says(&unfilled, &["line 10: m is still to be filled in: mass in air with the water inside, kg"]);
    let unit = complaint("m = 30.0", "m = \"31 kg\"");
    says(&unit, &["m: expected a number, without its unit, found the text \"31 kg\""]);
    says(&complaint("m = 30.0", "m = 31,03"), &["line 10: m: expected a number, found 31,03; write 31.03"]);
}

#[test]
fn letters_that_changed_places_are_the_nearest_name() {
    says(&complaint("X_udot = -5.0", "Y_vu = -5.0"), &["did you mean \"Y_uv\"?"]);
}

#[test]
fn letters_without_their_underscore_are_the_nearest_name() {
    says(&complaint("X_udot = -5.0", "Xuu = -5.0"), &["did you mean \"X_uu\"?"]);
    says(&complaint("X_udot = -5.0", "Nrr = -5.0"), &["did you mean \"N_rr\"?"]);
}

#[test]
fn a_key_that_is_given_twice_is_named() {
    says(&complaint("m = 30.0", "m = 30.0\nm = 31.0"), &["line 11: m stands there for the second time"]);
}
