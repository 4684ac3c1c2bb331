//! Every number of every file has its range, and nothing beyond it is read.

use seatrial::control::autopilot::settings::Settings;
use seatrial::description::Description;
use seatrial::mission::Mission;
use seatrial::ranges::{AUTOPILOT, COEFFICIENTS, MISSION, Range, VEHICLE};

/// A vehicle file with every key; two of them exclude each other, so that there are several motors and characteristics.
const BOAT: &str = r#"
format = 1
name = "boat"
[environment]
rho_kg_m3 = 1000.0
g_m_s2 = 9.81
[geometry]
length_m = 2.0
diameter_m = 0.3
height_m = 0.4
design_speed_m_s = 1.0
kinematic_viscosity_m2_s = 1.2e-6
appendages = [{ area_m2 = 0.1, arm_m = 0.2 }]
[trim]
weight_in_water_kg = 0.1
righting_arm_m = 0.01
[cross_flow]
x_m = [-1.0, 1.0]
diameter_m = [0.3, 0.2]
height_m = [0.4, 0.2]
[tether]
position_m = [-1.0, 0.0, 0.0]
anchor_m = [0.0, 0.0, 0.0]
slack_m = 50.0
[power]
hotel_w = 10.0
battery_wh = 500.0
[model_error]
force = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
force_time_s = 4.0
acceleration = [0.01, 0.01, 0.01, 0.02, 0.02, 0.02]
[coefficients]
m = 30.0
[motors.drive]
maximum_ahead = 100.0
maximum_astern = 90.0
minimum_ahead = 1.0
minimum_astern = 1.0
n_acc_per_s = 100.0
n_dec_per_s = 100.0
K_V = 1.0
T_1_s = 0.1
T_t_s = 0.1
[characteristics.q]
kind = "quadratic"
p1_ahead = 0.1
p1_astern = 0.1
p2 = -0.01
wake = 0.1
thrust_deduction = 0.1
q1 = 0.001
q2 = -0.001
power_w_s3 = 0.1
[characteristics.alpha]
kind = "quadratic"
alpha1_ahead = 0.3
alpha1_astern = 0.3
alpha2 = -0.1
diameter_m = 0.1
[characteristics.p]
kind = "polynomial"
ahead = [0.0, 0.1, 0.01]
astern = [0.0, 0.1, 0.01]
[characteristics.t]
kind = "table"
signal = [-1.0, 1.0]
voltage_v = [14.0, 16.0]
force_n = [[-1.0, 1.0], [-2.0, 2.0]]
[[thrusters]]
name = "bow"
command = "rpm"
neutral = 0.0
position_m = [0.5, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
motor = "drive"
characteristic = "q"
[[thrusters]]
name = "other"
command = "rpm"
wrench_per_newton = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
characteristic = "alpha"
[[fins]]
name = "fin"
neutral = 0.0
offset_deg = 1.0
position_m = [-0.8, 0.0, 0.0]
chord = [1.0, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
area_m2 = 0.01
aspect_ratio = 2.0
oswald = 0.9
C_L_alpha = 3.0
C_L_max = 1.1
C_D_0 = 0.01
C_D_90 = 1.0
"#;

const LEGS: &str = r#"
format = 1
name = "all"
speed_m_s = 1.0
acceptance_radius_m = 2.0
origin = { latitude_deg = 60.0, longitude_deg = 5.0 }
start = { north_m = 0.0, east_m = 0.0, depth_m = 0.0, heading_deg = 0.0 }
limits = { max_depth_m = 50.0, min_altitude_m = 1.0, max_time_s = 1e6, fence_m = [[-500, -500], [-500, 500], [500, 500], [500, -500]] }
[[legs]]
north_m = 10.0
east_m = 0.0
altitude_m = 3.0
speed_m_s = 1.0
acceptance_radius_m = 2.0
hold_s = 5.0
heading_deg = 0.0
[[legs]]
north_m = 40.0
east_m = 0.0
depth_m = 3.0
circle_radius_m = 5.0
turns = 1.0
[[legs]]
kind = "lawnmower"
north_m = 40.0
east_m = 40.0
heading_deg = 0.0
length_m = 20.0
width_m = 20.0
spacing_m = 5.0
overshoot_m = 1.0
[[legs]]
kind = "spiral"
north_m = -40.0
east_m = 40.0
start_radius_m = 5.0
end_radius_m = 20.0
spacing_m = 5.0
start_bearing_deg = 0.0
tolerance_m = 0.2
end_depth_m = 5.0
[[legs]]
kind = "perimeter"
north_m = 200.0
east_m = 200.0
radius_m = 20.0
distance_m = 5.0
margin_m = 1.0
depths_m = [2.0, 4.0]
stops = 2
stop_s = 5.0
start_bearing_deg = 180.0
tolerance_m = 0.2
[[legs]]
kind = "perimeter"
corners_m = [[-180, 60], [-180, 80], [-200, 80], [-200, 60]]
distance_m = 5.0
[[obstacles]]
north_m = 300.0
east_m = -300.0
radius_m = 5.0
distance_m = 5.0
[[obstacles]]
corners_m = [[-380, 60], [-380, 80], [-390, 80]]
[[landmarks]]
kind = "beacon"
name = "A"
north_m = 10.0
east_m = 20.0
depth_m = 15.0
[[landmarks]]
kind = "wall"
name = "quay"
north_m = 60.0
east_m = 0.0
facing_deg = 10.0
[[landmarks]]
kind = "pen"
name = "net"
north_m = 0.0
east_m = 0.0
radius_m = 25.0
"#;

fn autopilot() -> String {
    let file = Settings::from_toml(include_str!("../autopilots/cwolf.toml"), "cwolf").unwrap().file;
    let more = "\n[allocation.idle]\nvertical = 0.0\n[allocation.priority]\nX = 1.0\n";
    let lqr = "[[lqr]]\nmode = \"hover\"\ntracking_s = 5.0\ngain = [[[0.0]]]\n";
    let text = file.to_toml();
    let text = text.replace("[allocation.idle]\n", "").replace("[allocation.priority]\n", "");
    format!("{text}{more}{lqr}")
}

/// The file with the number at a row's key set to `value`; nothing when it has no such key.
fn changed(text: &str, key: &str, value: f64) -> Option<String> {
    let mut table: toml::Table = text.parse().unwrap();
    let mut steps: Vec<&str> = key.split('.').collect();
    let last = steps.pop()?;
    fn set(at: &mut toml::Value, steps: &[&str], last: &str, value: f64) -> bool {
        if let toml::Value::Array(entries) = at {
            return entries.iter_mut().any(|entry| set(entry, steps, last, value));
        }
        let Some(table) = at.as_table_mut() else { return false };
        match steps.split_first() {
            Some((&"*", rest)) => table.iter_mut().any(|(_, entry)| set(entry, rest, last, value)),
            Some((step, rest)) => {
                table.get_mut(step.trim_end_matches("[]")).is_some_and(|entry| set(entry, rest, last, value))
            }
            None => match table.iter_mut().find(|(name, _)| *name == last || last == "*") {
                Some((_, toml::Value::Array(row))) => {
                    let row = match row.first_mut() {
                        Some(toml::Value::Array(inner)) => inner,
                        _ => row,
                    };
                    row[0] = value.into();
                    true
                }
                Some((_, number)) if !number.is_table() => {
                    *number = value.into();
                    true
                }
                _ => false,
            },
        }
    }
    let mut root = toml::Value::Table(std::mem::take(&mut table));
    set(&mut root, &steps, last, value).then(|| toml::to_string(&root).unwrap())
}

/// Every row of `rows` stands in `text`, and values beyond it are refused by the row's own sentence.
fn held(rows: &[Range], text: &str, read: impl Fn(&str) -> Result<(), String>) {
    for row in rows.iter().filter(|row| row.key != "format") {
        assert!(row.least < row.most && row.remedy.len() > 5, "{}", row.key);
        let own = if row.key == "coefficients.*" { seatrial::ranges::coefficient("m") } else { row };
        let tiny = 1e-9 * own.least.abs().max(1e-9);
        let below = if own.open { own.least } else { own.least - tiny.max(own.least.abs() * 1e-9) };
        for value in
            [below, own.most * (1.0 + 1e-9), f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e308, 1e308]
        {
            let file =
                changed(text, row.key, value).unwrap_or_else(|| panic!("{} is not in the file", row.key));
            let message = read(&file).expect_err(&format!("{} = {value}", row.key));
            assert!(message.contains(own.remedy), "{} = {value}: {message}", row.key);
            let last = row.key.rsplit('.').next().unwrap();
            assert!(last == "*" || message.contains(last), "{} = {value}: {message}", row.key);
        }
    }
}

fn no<T, E: ToString>(result: Result<T, E>) -> Result<(), String> {
    result.map(|_| ()).map_err(|error| error.to_string())
}

#[test]
fn law_numbers_beyond_their_range_are_refused_with_the_remedy() {
    no(Description::from_toml(BOAT, "boat")).unwrap();
    no(Mission::from_toml(LEGS, "legs")).unwrap();
    // One of the two names of a measure.
    let (wide, others): (Vec<Range>, Vec<Range>) =
        VEHICLE.iter().partition(|row| row.key == "geometry.width_m");
    held(&others, BOAT, |text| no(Description::from_toml(text, "boat")));
    let named = BOAT.replacen("diameter_m = 0.3\nheight", "width_m = 0.3\nheight", 1);
    held(&wide, &named, |text| no(Description::from_toml(text, "boat")));
    held(AUTOPILOT, &autopilot(), |text| no(Settings::from_toml(text, "pilot")));
    held(MISSION, LEGS, |text| no(Mission::from_toml(text, "legs")));
}

/// The keys of the numbers of a table, as [`changed`] finds them.
fn numbers(table: &toml::Table, before: &str, found: &mut Vec<String>) {
    for (name, value) in table {
        let key = format!("{before}{name}");
        let first = |values: &Vec<toml::Value>| values.first().cloned();
        match value {
            toml::Value::Table(inner) => numbers(inner, &format!("{key}."), found),
            toml::Value::Array(values) => match first(values) {
                Some(toml::Value::Table(_)) => {
                    let entries = values.iter().filter_map(toml::Value::as_table);
                    entries.for_each(|inner| numbers(inner, &format!("{key}[]."), found));
                }
                Some(toml::Value::Array(_) | toml::Value::Float(_) | toml::Value::Integer(_)) => {
                    found.push(key);
                }
                _ => {}
            },
            toml::Value::Float(_) | toml::Value::Integer(_) => found.push(key),
            _ => {}
        }
    }
}

/// Whatever number a file has, an infinite one is refused by a range: the readers' own checks let infinite times pass.
#[test]
fn law_every_number_of_every_file_has_a_range() {
    type Reader = fn(&str) -> Result<(), String>;
    let kinds: [(&str, String, &[Range], Reader); 3] = [
        ("vehicle", BOAT.to_owned(), VEHICLE, |text| no(Description::from_toml(text, "boat"))),
        ("autopilot", autopilot(), AUTOPILOT, |text| no(Settings::from_toml(text, "pilot"))),
        ("mission", LEGS.to_owned(), MISSION, |text| no(Mission::from_toml(text, "legs"))),
    ];
    for (kind, text, rows, read) in kinds {
        let mut keys = Vec::new();
        numbers(&text.parse().unwrap(), "", &mut keys);
        assert!(keys.len() > 30, "{kind}: {}", keys.len());
        for key in keys {
            let file = changed(&text, &key, f64::INFINITY).unwrap();
            let message = read(&file).expect_err(&format!("{kind}: {key} = inf has no row"));
            let coefficient = key.strip_prefix("coefficients.").map(seatrial::ranges::coefficient);
            let by = |row: &Range| message.contains(row.remedy);
            assert!(rows.iter().chain(coefficient).any(by), "{kind}: {key} = inf: {message}");
        }
    }
}

/// A key that is read and has no row stops a debug build; the files above hold every row.
#[test]
fn law_coefficients_keep_their_ranges_in_changes() {
    let boat = Description::from_toml(BOAT, "boat").unwrap();
    for row in &COEFFICIENTS {
        let name = (0..boat.layout.len())
            .map(|i| boat.layout.name(i))
            .find(|name| name == row.key || name.rsplit('.').next() == Some(row.key))
            .unwrap_or_else(|| panic!("no coefficient {}", row.key));
        for value in [row.most * 1.001, if row.open { row.least } else { row.least - 1e-3 }, f64::NAN] {
            let message = boat.with_coefficients(&[(name.clone(), value)]).unwrap_err().to_string();
            assert!(message.contains(row.remedy) && message.contains(&name), "{name} = {value}: {message}");
        }
    }
    for value in [1e13, f64::INFINITY] {
        assert!(boat.with_coefficients(&[("X_uu".to_owned(), value)]).is_err());
    }
}

#[test]
fn lists_do_not_stand_for_tables_and_names_are_plain() {
    for (text, says) in [
        (LEGS.replace("limits = {", "limits = [5.0, 1.0] #"), "limits: expected a table, found a list"),
        (LEGS.replace("start = {", "start = [0.0, 0.0, 0.0] #"), "start: expected a table, found a list"),
        (LEGS.replace("name = \"all\"", "name = \"a\\u001bll\""), "name: expected text without control"),
        (LEGS.replace("name = \"all\"", &format!("name = {:?}", "x".repeat(300))), "at most 200 characters"),
    ] {
        let message = no(Mission::from_toml(&text, "legs.toml")).unwrap_err();
        assert!(message.starts_with("legs.toml: ") && message.contains(says), "{message}");
    }
    let many = format!("{LEGS}{}", "[[legs]]\nnorth_m = 1.0\neast_m = 0.0\n".repeat(10_000));
    assert!(
        no(Mission::from_toml(&many, "legs")).unwrap_err().contains("legs: expected at most 10000 entries")
    );
    for (old, new, says) in [
        ("[power]\nhotel_w = 10.0\nbattery_wh = 500.0", "power = [10.0, 500.0]", "power: expected a table"),
        (
            "appendages = [{ area_m2 = 0.1, arm_m = 0.2 }]",
            "appendages = [[0.1, 0.2]]",
            "appendages[0]: expected a table, found array",
        ),
        (
            "[motors.drive]",
            "[motors.\"dr\\u0007ive\"]",
            "motors: expected text without control characters, found U+0007",
        ),
    ] {
        // Top-level keys stand before the tables.
        let text = match new.split_once(" = [") {
            Some(("power", _)) => {
                BOAT.replacen(old, "", 1).replacen("name = ", &format!("{new}\nname = "), 1)
            }
            _ => BOAT.replacen(old, new, 1),
        };
        let found = no(Description::from_toml(&text, "boat"));
        let message = found.unwrap_err();
        assert!(message.contains(says), "{message}");
    }
    let pilot = autopilot();
    let start = pilot.find("[feed_forward]").unwrap();
    let end = start + pilot[start..].find("\n[").unwrap();
    let flags = format!("feed_forward = [true, true, false]\n{}{}", &pilot[..start], &pilot[end + 1..]);
    let message = no(Settings::from_toml(&flags, "pilot")).unwrap_err();
    assert!(message.contains("feed_forward: expected a table"), "{message}");
}
