//! What every number of a vehicle, autopilot or mission file may be: one row per key, with what to do about another value.
//!
//! The bounds are physical ("a battery holds more than nothing") or far beyond any vehicle ("a hull of a kilometre"): they
//! tell a slip of the hand from a number, and keep what they admit computable in double precision. What one number
//! demands of another is checked where both are known.
//!
//! A key stands as it is written; `*` is any name, `[]` an entry of a list of tables. Numbers of a plain list (a place, a
//! row of a table of thrust) stand under the key of the list. The same rows say which keys are tables, so that a list in
//! the place of a table is refused, and how many entries a list may have.
//!
//! Tests: `tests/ranges.rs` (every key has a row; either side of every bound), `tests/check/test_fuzzed_files.py`.

mod rows;
mod walk;

pub use rows::{AUTOPILOT, COEFFICIENTS, MISSION, VEHICLE, WATER};
pub(crate) use walk::check;

/// What the numbers of one key may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The key.
    pub key: &'static str,
    /// The smallest value.
    pub least: f64,
    /// The largest value.
    pub most: f64,
    /// Whether the smallest value itself is too small.
    pub open: bool,
    /// What to do about another value.
    pub remedy: &'static str,
}

impl Range {
    /// From `least` to `most`, both included.
    const fn within(key: &'static str, [least, most]: [f64; 2], remedy: &'static str) -> Self {
        Self { key, least, most, open: false, remedy }
    }

    /// Above zero, up to `most`.
    const fn above(key: &'static str, most: f64, remedy: &'static str) -> Self {
        Self { key, least: 0.0, most, open: true, remedy }
    }

    /// From zero to `most`.
    const fn upto(key: &'static str, most: f64, remedy: &'static str) -> Self {
        Self { key, least: 0.0, most, open: false, remedy }
    }

    /// Of either sign, up to a magnitude.
    const fn sized(key: &'static str, most: f64, remedy: &'static str) -> Self {
        Self { key, least: -most, most, open: false, remedy }
    }

    /// Whether a value lies within; what is not a number does not.
    pub fn contains(&self, x: f64) -> bool {
        (if self.open { x > self.least } else { x >= self.least }) && x <= self.most
    }

    /// What is wrong with a value: what was expected, what was found, what to do; nothing when it lies within.
    pub fn complaint(&self, x: f64) -> Option<String> {
        if self.contains(x) {
            return None;
        }
        let (least, most) = (self.least, self.most);
        let expected = if least < 0.0 && !x.is_finite() {
            "a finite number".to_owned()
        } else if x.is_finite() && x > most && self.open {
            format!("a number above {least} and at most {most:?}")
        } else if x.is_finite() && (x > 0.0 || least < 0.0) {
            format!("a number from {least:?} to {most:?}")
        } else if self.open || least > 0.0 {
            "a positive number".to_owned()
        } else {
            "zero or a positive number".to_owned()
        };
        Some(format!("expected {expected}, found {x}; {}", self.remedy))
    }
}

/// The row of a key.
pub fn row(rows: &'static [Range], key: &str) -> Option<&'static Range> {
    rows.iter().find(|row| row.key == key)
}

/// What a coefficient may be, by its name: of an actuator by the part behind the dot.
pub fn coefficient(name: &str) -> &'static Range {
    let own = name.rsplit_once('.').map_or(name, |(_, own)| own);
    COEFFICIENTS.iter().find(|row| row.key == own).unwrap_or(&rows::ANY_COEFFICIENT)
}
