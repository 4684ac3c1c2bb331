//! What the files of vehicle, autopilot and mission have in common: TOML of `format = 1`, unknown keys refused with the
//! nearest known name, rows of a fixed number of numbers. One too many is as wrong as one too few, and neither is passed
//! over. A file of another kind, which its keys tell, is named before any of its keys is called unknown.
//!
//! Tests: `tests/files.rs`.

use crate::error::{Error, nearest};
use crate::ranges::{self, Range};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};

/// The largest file, bytes: a mission of the most waypoints has a third of it.
const LARGEST_FILE: usize = 8 << 20;

/// Kinds of file with the keys that tell them, the most telling first: one key is enough.
const KINDS: [(&str, &[&str]); 8] = [
    ("a bench file", &["pulls", "steps"]),
    ("the recipe of a generated trial", &["truth"]),
    ("the truth of generated trials", &["factors"]),
    ("a campaign", &["stages", "trials", "tuning", "verification"]),
    ("a mission", &["legs"]),
    ("an autopilot", &["schedule", "modes", "loops"]),
    ("a set of sensors", &["sensors"]),
    ("a vehicle", &["geometry", "coefficients", "thrusters", "motors", "characteristics", "fins"]),
];

/// Kind of the file with these keys at its top: "a mission"; none where no key tells.
pub fn file_kind(keys: &[&str]) -> Option<&'static str> {
    KINDS.iter().find(|(_, telling)| keys.iter().any(|key| telling.contains(key))).map(|(kind, _)| *kind)
}

/// What is wrong with a file of these keys where one of the kind `expected` belongs; nothing where it may be one.
pub fn wrong_kind(expected: &str, keys: &[&str]) -> Option<String> {
    let own = KINDS.iter().find(|(kind, _)| *kind == expected).map_or(&[][..], |(_, telling)| *telling);
    let found = if keys.is_empty() {
        "an empty file"
    } else if keys.iter().any(|key| own.contains(key)) {
        return None;
    } else {
        file_kind(keys).filter(|found| *found != expected)?
    };
    let file = if expected.contains(" of ") || expected.ends_with("file") { "" } else { " file" };
    Some(format!("expected {expected}{file}, found {found}; check which file goes where"))
}

/// Table, key and what to use instead, of keys that earlier files of format 1 may have.
const NO_KEYS: &[(&str, &str, &str)] = &[(
    "feed_forward",
    "disturbance",
    "delete it. Against a lasting force raise K_I_per_s of the loop that keeps an error, or use control = \"lqr\"",
)];

/// A file of format 1 and of the kind `expected`, read, its numbers within the ranges of `rows`; `source_name` stands in
/// messages.
///
/// # Errors
/// When the text is not TOML, the file is of another kind, a key is unknown or missing, or a value has the wrong type or lies beyond its range.
pub(crate) fn parsed<F: DeserializeOwned>(
    expected: &str,
    text: &str,
    source_name: &str,
    rows: &[Range],
) -> Result<F, Error> {
    let refused = |error: toml::de::Error| Error::vehicle(source_name, explain(&error, text));
    if text.len() > LARGEST_FILE {
        return Err(Error::vehicle(
            source_name,
            format!(
                "expected a file of at most {LARGEST_FILE} bytes, found {}; is it the right file?",
                text.len()
            ),
        ));
    }
    let table: toml::Table = toml::from_str(text).map_err(refused)?;
    let keys: Vec<&str> = table.keys().map(String::as_str).collect();
    if let Some(message) = wrong_kind(expected, &keys) {
        return Err(Error::vehicle(source_name, message));
    }
    // The format first: another one may have keys that this one does not know.
    if let Some(found) = table.get("format").and_then(toml::Value::as_integer).filter(|found| *found != 1) {
        let message = format!("format: this version reads format = 1, found {found}");
        return Err(Error::vehicle(source_name, message));
    }
    for (section, key, instead) in NO_KEYS {
        let named =
            table.get(*section).and_then(toml::Value::as_table).is_some_and(|own| own.contains_key(*key));
        if named {
            return Err(Error::vehicle(source_name, format!("{section}.{key}: is not a key; {instead}")));
        }
    }
    let without = ranges::check(&table, rows).map_err(|message| Error::vehicle(source_name, message))?;
    let file = toml::from_str(text).map_err(refused)?;
    debug_assert!(without.is_none(), "{without:?} is read, and src/ranges/rows.rs has no row for it");
    Ok(file)
}

/// The reader's message with its line, and the nearest known name of an unknown key.
pub(crate) fn explain(error: &toml::de::Error, text: &str) -> String {
    let line = error.span().map(|span| 1 + text[..span.start].matches('\n').count());
    let message = error.message().trim();
    let place = line.map(|n| format!("line {n}: ")).unwrap_or_default();
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let written = line.and_then(|n| text.lines().nth(n - 1)).and_then(|row| row.split_once('='));
    if let Some((key, value)) = written.map(|(key, value)| (key.trim(), value.trim())) {
        if let Some((found, expected)) =
            message.strip_prefix("invalid type: string ").and_then(|rest| rest.rsplit_once(", expected "))
        {
            return match found.trim_matches('"').strip_prefix("FILL IN: ") {
                Some(what) => format!("{place}{key} is still to be filled in: {what}"),
                None => format!("{place}{key}: expected {}, found the text {found}", plain(expected)),
            };
        }
        let (whole, after) = value.split_once(',').unwrap_or((value, ""));
        let digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        if digits(whole.trim_start_matches(['+', '-'])) && digits(after) {
            return format!("{place}{key}: expected a number, found {value}; write {whole}.{after}");
        }
    }
    if message == "duplicate key" {
        let row = line.and_then(|n| text.lines().nth(n - 1)).unwrap_or_default();
        let key = row.split_once('=').map_or(row, |(key, _)| key).trim();
        return format!("{place}{key} stands there for the second time; keep one of them");
    }
    match quoted.split_first() {
        Some((unknown, known)) if message.starts_with("unknown") => {
            format!("{place}{message}{}", nearest(unknown, known.iter().copied()))
        }
        _ => format!("{place}{message}"),
    }
}

/// What the reader expected, in words for who writes the file.
fn plain(expected: &str) -> &str {
    match expected {
        "f64" => "a number, without its unit",
        "u32" | "u64" | "usize" | "i64" => "a whole number",
        "a sequence" => "a list in brackets",
        "a boolean" => "true or false",
        other => other,
    }
}

/// Exactly N numbers.
pub(crate) fn exactly<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<[f64; N], D::Error> {
    let row = Vec::<f64>::deserialize(deserializer)?;
    row.try_into()
        .map_err(|row: Vec<f64>| D::Error::custom(format!("expected {N} numbers, found {}", row.len())))
}

/// Exactly N numbers, of a key that may be missing.
pub(crate) fn exactly_if_given<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<Option<[f64; N]>, D::Error> {
    exactly(deserializer).map(Some)
}
