//! What each sensor of a filter shows, and where the filter begins with it, as C.

use super::{FilterStep, SENSORS, mark_name};
use crate::control::navigation_filter::fitting::{
    ATTITUDE_SENSOR, DEPTH, DVL, DVL_WATER, ECHO_SOUNDER, GPS, GYRO, POSITION_FIX, USBL,
};
use crate::control::navigation_filter::{KINDS, LANDMARKS, Landmark};
use crate::filter::observation::Surface;
use std::fmt::Write;

impl FilterStep<'_> {
    /// The cases of what each channel shows.
    pub(super) fn expected(&self) -> String {
        let mut text = String::new();
        let mut case = |channel: usize, lines: &[String]| {
            let _ = writeln!(text, "    case {channel}:");
            lines.iter().for_each(|line| {
                let _ = writeln!(text, "        {line}");
            });
            text += "        break;\n";
        };
        for (kind, _) in self.kinds().filter(|(kind, _)| *kind < SENSORS.len()) {
            let (first, count, ..) = SENSORS[kind];
            let name = KINDS[kind];
            for i in 0..count {
                let axis = if kind == DEPTH { 2 } else { i };
                let tilted = format!("axis_of(k, MOUNT_{name}, {i}, along);");
                match kind {
                    ATTITUDE_SENSOR => {
                        case(first + i, &[format!("shown = angle(at, k, {i}, expected, row);")])
                    }
                    DVL => case(
                        first + i,
                        &[
                            tilted,
                            "*expected = velocity(at, along, p->dvl.arm, row);".to_owned(),
                            "*expected += flow(at, along, row);".to_owned(),
                        ],
                    ),
                    DVL_WATER => case(
                        first + i,
                        &[tilted, "*expected = velocity(at, along, p->dvl_water.arm, row);".to_owned()],
                    ),
                    GYRO => case(first + i, &[tilted, "*expected = rate(at, along, row);".to_owned()]),
                    ECHO_SOUNDER => case(
                        first,
                        &[
                            "axis_of(k, MOUNT_altitude, 2, along);".to_owned(),
                            "shown = echo(at, along, p->altitude.arm, p->bottom, expected, row);".to_owned(),
                        ],
                    ),
                    _ => case(
                        first + i,
                        &[format!("*expected = place(at, unit[{axis}], p->{name}.arm, row);")],
                    ),
                }
            }
        }
        let [ranges, bearings] = ["range", "bearing"].map(|name| {
            KINDS.iter().position(|kind| *kind == name).is_some_and(|kind| self.instrument(kind).is_some())
        });
        for (i, (name, mark)) in self.fitting.landmarks.iter().enumerate() {
            let (channel, name) = (LANDMARKS + 2 * i, mark_name(name));
            let looked = format!("beam_at(k, s->beam[{i}], along);");
            match mark {
                Landmark::Beacon(_) => {
                    if ranges {
                        case(
                            channel,
                            &[format!("shown = range(at, p->{name}, p->range.arm, expected, row);")],
                        );
                    }
                    if bearings {
                        case(
                            channel + 1,
                            &[format!("shown = bearing(at, p->{name}, p->bearing.arm, expected, row);")],
                        );
                    }
                }
                Landmark::Surface(surface) if ranges => {
                    let of = if matches!(surface, Surface::Plane { .. }) { "echo" } else { "net" };
                    case(
                        channel,
                        &[
                            looked,
                            format!("shown = {of}(at, along, p->range.arm, p->{name}, expected, row);"),
                        ],
                    );
                }
                Landmark::Surface(_) => {}
            }
        }
        text
    }

    /// The cases of fixes whose constant offset may count.
    pub(super) fn shifted(&self) -> String {
        let mut text = String::new();
        for (kind, _) in self.kinds().filter(|(kind, _)| [POSITION_FIX, GPS, USBL].contains(kind)) {
            let (first, count, ..) = SENSORS[kind];
            for channel in first..first + count {
                let _ = writeln!(text, "    case {channel}:");
            }
            let _ = writeln!(
                text,
                "        axis = channel - {first};\n        bias = p->{}.bias;\n        break;",
                KINDS[kind]
            );
        }
        text
    }

    /// Where the filter begins: the first fix of these kinds.
    pub(super) fn fixed(&self, depth: bool) -> String {
        let kinds: &[usize] = if depth { &[DEPTH, USBL] } else { &[POSITION_FIX, GPS, USBL] };
        let mut text = String::new();
        for &kind in kinds.iter().filter(|&&kind| self.instrument(kind).is_some()) {
            let channel = match (kind == DEPTH, depth) {
                (true, _) => "2".to_owned(),
                (_, true) => (SENSORS[kind].0 + 2).to_string(),
                _ => format!("{} + i", SENSORS[kind].0),
            };
            let _ = writeln!(
                text,
                "            known = (known != 0) || (fixed(s, &p->{}, {channel}, i, r, &at, &far) != 0);",
                KINDS[kind]
            );
        }
        text
    }

    /// The rotations of the mountings.
    pub(super) fn mounted(&self) -> String {
        let line = |kind: usize| {
            let name = KINDS[kind];
            format!("    from_euler(p->{name}.mount, q);\n    rotation(q, k->mount[MOUNT_{name}]);\n")
        };
        self.mounts().into_iter().map(line).collect()
    }

    /// The functions of the sensors: declared and defined.
    pub(super) fn functions(&self) -> (String, String) {
        let (mut declared, mut defined) = (String::new(), String::new());
        let mut add = |about: &str, name: &str, values: &str, body: &str| {
            let signature = format!(
                "void FILTER_{name}(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s,\n    {values}, \
                 FILTER_real age)"
            );
            let _ = write!(declared, "/* {about} */\n{signature};\n\n");
            let _ = write!(defined, "{signature}\n{{\n{body}}}\n\n");
        };
        for (kind, _) in self.kinds() {
            let name = KINDS[kind];
            if let Some(&(first, count, unit, about)) = SENSORS.get(kind) {
                let about = format!(
                    "A sample of the {about}, {unit}; NAN where there is none. Its age beyond its sensor's latency is `age`, s."
                );
                let (values, passed) = match count {
                    1 => ("FILTER_real value".to_owned(), "&value"),
                    _ => (format!("const FILTER_real values[{count}]"), "values"),
                };
                add(
                    &about,
                    name,
                    &values,
                    &format!("    sense(p, k, s, &p->{name}, {first}, {count}, {passed}, age);\n"),
                );
                continue;
            }
            let first = LANDMARKS + usize::from(name == "bearing");
            let body = format!("    sense(p, k, s, &p->{name}, {first} + (2 * mark), 1, &value, age);\n");
            let about = match name {
                "range" => "A distance of a landmark (its MARK), m; that of a surface where the sonar looks.",
                _ => "A bearing of a beacon (its MARK), rad.",
            };
            add(about, name, "int mark, FILTER_real value", &body);
        }
        if self.holds(false).contains(&"surface") {
            let about = "/* Where the sonar looks for a surface (its MARK), rad; before its range. */\n";
            let signature = "void FILTER_look(FILTER_state *s, int mark, FILTER_real bearing)";
            let _ = write!(declared, "{about}{signature};\n\n");
            let _ = write!(
                defined,
                "{signature}\n{{\n    if (is_number(bearing))\n    {{\n        s->beam[mark] = bearing;\n    }}\n}}\n\n"
            );
        }
        (declared, defined)
    }
}
