//! What a vehicle file lacks, all at once: keys that its reader needs, and facts that its physics needs.
//!
//! Tests: `tests/files.rs`.

use std::fmt::Write;
use toml::{Table, Value};

const LENGTH: &str = "length over all, m";
const WIDTH: &str = "width over all, m (of a round hull diameter_m, its largest diameter)";
const HEIGHT: &str = "height over all, m";
const MASS: &str = "mass in kg; weigh the vehicle in air";
const INERTIA: &str = "moment of inertia, kg m2; or give [geometry] with length_m, width_m, height_m and shape, from which it is filled";
const TRIM: &str = "how heavy it is in water: trim.weight_in_water_kg, the reading of a hanging scale with the vehicle under water (negative where it floats: the lead that just sinks it), or B in N";
const RIGHTING: &str = "how far buoyancy is above gravity: trim.righting_arm_m, from the angle by which a known weight heels it, or z_b";
const PLACE: &str = "place in m: forward, starboard, down of O";
const DIRECTION: &str = "direction of positive thrust: [1, 0, 0] ahead, [0, 0, -1] up";

/// One sentence per missing key with what it is; none where nothing is missing, or where the text is no TOML.
pub(super) fn complaint(text: &str) -> Option<String> {
    let file: Table = toml::from_str(text).ok()?;
    let mut lines = Vec::new();
    missing(&file, &mut |place: String, what: &str| lines.push(format!("{place}: {what}")));
    match lines.as_slice() {
        [] => None,
        [only] => Some(format!("missing {only}")),
        _ => {
            let mut message = format!("{} facts are missing, give them:", lines.len());
            for line in lines {
                let _ = write!(message, "\n- {line}");
            }
            Some(message)
        }
    }
}

fn missing(file: &Table, report: &mut dyn FnMut(String, &str)) {
    let none = Table::new();
    let table = |name: &str| file.get(name).and_then(Value::as_table);
    let mut need = |own: &Table, at: &str, names: &[&str], what: &str| {
        if !names.iter().any(|name| own.contains_key(*name)) {
            let point = if at.is_empty() { "" } else { "." };
            report(format!("{at}{point}{}", names[0]), what);
        }
    };
    need(file, "", &["format"], "1");
    need(file, "", &["name"], "a name of the vehicle");
    if let Some(environment) = table("environment") {
        need(environment, "environment", &["rho_kg_m3"], "density: 1025 in the sea, 1000 in a lake");
    }
    let [coefficients, trim] = ["coefficients", "trim"].map(|name| table(name).unwrap_or(&none));
    need(coefficients, "coefficients", &["m"], MASS);
    if let Some(geometry) = table("geometry") {
        need(geometry, "geometry", &["length_m"], LENGTH);
        need(geometry, "geometry", &["width_m", "diameter_m"], WIDTH);
        if matches!(geometry.get("shape").and_then(Value::as_str), Some("box" | "frame")) {
            need(geometry, "geometry", &["height_m"], HEIGHT);
            if !trim.contains_key("weight_in_water_kg") {
                need(coefficients, "coefficients", &["B"], TRIM);
            }
            if !trim.contains_key("righting_arm_m") {
                need(coefficients, "coefficients", &["z_b", "z_g"], RIGHTING);
            }
        }
    } else {
        for name in ["I_x", "I_y", "I_z"] {
            need(coefficients, "coefficients", &[name], INERTIA);
        }
    }
    for (name, kind) in table("characteristics").unwrap_or(&none) {
        if let Some(kind) = kind.as_table() {
            let at = format!("characteristics.{name}");
            need(kind, &at, &["kind"], "\"quadratic\", \"polynomial\", \"table\" or \"direct\"");
        }
    }
    for list in ["thrusters", "fins"] {
        for (k, entry) in file.get(list).and_then(Value::as_array).into_iter().flatten().enumerate() {
            let Some(own) = entry.as_table() else { continue };
            let at = format!("{list}[{k}]");
            need(own, &at, &["name"], "a unique name");
            if list == "fins" {
                need(own, &at, &["position_m"], PLACE);
                need(own, &at, &["normal"], "direction across the fin: [0, 1, 0] of a rudder");
                need(own, &at, &["area_m2"], "area of one side, m2");
                need(
                    own,
                    &at,
                    &["aspect_ratio"],
                    "span over mean chord, doubled where the hull stands at the root",
                );
                continue;
            }
            need(own, &at, &["command"], "unit of the command: \"rpm\", \"us\" or \"N\"");
            need(own, &at, &["characteristic"], "name of its thrust under [characteristics]");
            need(own, &at, &["position_m", "wrench_per_newton"], PLACE);
            need(own, &at, &["direction", "wrench_per_newton"], DIRECTION);
        }
    }
}
