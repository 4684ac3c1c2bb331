//! A file walked through before it is read: every number against its row, every list against what may stand there, every
//! text for characters that no terminal and no file name should meet.

use super::rows::{LENGTHS, TABLES};
use super::{Range, coefficient};
use std::fmt::Write;
use toml::Value;

/// The longest name, in characters.
const LONGEST_NAME: usize = 200;
/// How much of a name a message shows, in characters.
const LONGEST_SHOWN: usize = 80;
/// The longest description, in characters.
const LONGEST_TEXT: usize = 20_000;

/// Where the walk is: as a message says it, and as the rows do.
#[derive(Clone)]
struct Place {
    shown: String,
    key: String,
}

impl Place {
    fn entry(&self, name: &str, rows: &[Range]) -> Self {
        let joined = |before: &str, after: &str| {
            if before.is_empty() { after.to_owned() } else { format!("{before}.{after}") }
        };
        // A name of the user's where the rows have any name: `motors.drive`.
        let own = joined(&self.key, name);
        let any = joined(&self.key, "*");
        let known = rows.iter().any(|row| leads(&own, row.key));
        let key = if !known && rows.iter().any(|row| leads(&any, row.key)) { any } else { own };
        let shown = match name.contains('.') {
            true => joined(&self.shown, &format!("\"{name}\"")),
            false => joined(&self.shown, name),
        };
        Self { shown, key }
    }
}

/// Whether a row is at a key or below it.
fn leads(key: &str, row: &str) -> bool {
    row.strip_prefix(key).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}

/// Refuses what no file of these rows may hold, with its place and what to do. Returns the first number without a row:
/// an unknown key, which the reader of the file refuses by its name.
///
/// # Errors
/// The first thing that is wrong.
pub(crate) fn check(table: &toml::Table, rows: &[Range]) -> Result<Option<String>, String> {
    let mut walk = Walk { rows, without: None };
    walk.table(table, &Place { shown: String::new(), key: String::new() })?;
    Ok(walk.without)
}

struct Walk<'a> {
    rows: &'a [Range],
    without: Option<String>,
}

impl Walk<'_> {
    fn table(&mut self, table: &toml::Table, at: &Place) -> Result<(), String> {
        for (name, value) in table {
            let place = at.entry(name, self.rows);
            text(name, &at.shown, LONGEST_NAME).map_err(|m| format!("{m} in a key"))?;
            self.value(value, &place)?;
        }
        Ok(())
    }

    fn value(&mut self, value: &Value, at: &Place) -> Result<(), String> {
        match value {
            Value::Integer(x) => self.number(*x as f64, at),
            Value::Float(x) => self.number(*x, at),
            Value::String(x) => {
                let most = if at.key.ends_with("description") { LONGEST_TEXT } else { LONGEST_NAME };
                text(x, &at.shown, most)
            }
            Value::Table(table) => self.table(table, at),
            Value::Array(values) => self.list(values, at),
            Value::Boolean(_) | Value::Datetime(_) => Ok(()),
        }
    }

    fn number(&mut self, x: f64, at: &Place) -> Result<(), String> {
        let row = match at.key.as_str() {
            "coefficients.*" => {
                at.shown.strip_prefix("coefficients.").map(|name| coefficient(name.trim_matches('"')))
            }
            key => self.rows.iter().find(|row| row.key == key),
        };
        match row {
            None => self.without = self.without.take().or(Some(at.shown.clone())),
            Some(row) => {
                if let Some(complaint) = row.complaint(x) {
                    return Err(format!("{}: {complaint}", at.shown));
                }
            }
        }
        Ok(())
    }

    fn list(&mut self, values: &[Value], at: &Place) -> Result<(), String> {
        let below =
            |rest: &str| self.rows.iter().any(|row| row.key.starts_with(&format!("{}{rest}", at.key)));
        if below(".") || TABLES.contains(&at.key.as_str()) {
            return Err(format!("{0}: expected a table, found a list; write its keys under [{0}]", at.shown));
        }
        let most = LENGTHS.iter().find(|(key, _)| *key == at.key).map_or(LONGEST_LIST, |(_, most)| *most);
        if values.len() > most {
            return Err(format!("{}: expected at most {most} entries, found {}", at.shown, values.len()));
        }
        let tables = below("[].");
        for (k, value) in values.iter().enumerate() {
            let mut place = at.clone();
            if tables {
                let Value::Table(table) = value else {
                    return Err(format!(
                        "{}[{k}]: expected a table, found {}; write its keys under [[{}]]",
                        at.shown,
                        value.type_str(),
                        at.shown
                    ));
                };
                place.key += "[]";
                // A leg is counted as its messages count it, from one.
                if at.key == "legs" {
                    place.shown = format!("leg {}", k + 1);
                } else {
                    let _ = write!(place.shown, "[{k}]");
                    if let Some(Value::String(name)) = table.get("name") {
                        let short: String = name.chars().take(LONGEST_SHOWN).collect();
                        let _ = write!(place.shown, " {short:?}");
                    }
                }
                self.entry_of(table, &place)?;
            } else {
                self.value(value, &place)?;
            }
        }
        Ok(())
    }

    /// A table of a list; a leg's number is parted from its key as in the other messages of a mission.
    fn entry_of(&mut self, table: &toml::Table, at: &Place) -> Result<(), String> {
        if at.key != "legs[]" {
            return self.table(table, at);
        }
        let inside = Place { shown: String::new(), key: at.key.clone() };
        self.table(table, &inside).map_err(|message| format!("{}: {message}", at.shown))
    }
}

/// The longest list without a length of its own.
const LONGEST_LIST: usize = 10_000;

/// Refuses control characters, and text beyond a length.
fn text(x: &str, at: &str, most: usize) -> Result<(), String> {
    let place = if at.is_empty() { String::new() } else { format!("{at}: ") };
    let plain = |c: char| !c.is_control() || (most > LONGEST_NAME && "\n\r\t".contains(c));
    if let Some(c) = x.chars().find(|c| !plain(*c)) {
        return Err(format!(
            "{place}expected text without control characters, found U+{:04X}; remove it",
            c as u32
        ));
    }
    let length = x.chars().count();
    if length > most {
        return Err(format!("{place}expected at most {most} characters, found {length}"));
    }
    Ok(())
}
