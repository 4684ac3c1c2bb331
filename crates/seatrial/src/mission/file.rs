//! The mission file: TOML, owned by these structs; unknown keys are refused with the nearest known name.
//!
//! A key carries its unit (`speed_m_s`, `heading_deg`). Places are metres north and east of the origin; latitude
//! and longitude become metres before the text comes here, because the core has no datum.
//!
//! Tests: `tests/mission.rs`.

use super::landmarks::LandmarkTable;
use super::legs::{Lawnmower, ObstacleTable, Perimeter, Spiral, WaypointLeg, corners};
use crate::error::{Error, nearest};
use crate::ranges;
use crate::toml_file::{explain, parsed};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// A mission as written in its file.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct MissionFile {
    /// Version of the format: 1.
    pub format: u32,
    /// Name of the mission.
    pub name: String,
    /// What it is for, in a sentence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Speed over ground of the legs that give none, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Radius of acceptance of the legs that give none, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_radius_m: Option<f64>,
    /// Where the origin lies on the Earth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Where the first leg begins.
    #[serde(default)]
    pub start: StartTable,
    /// What the mission may not leave.
    #[serde(default)]
    pub limits: LimitsTable,
    /// What stands in the water besides the farms of the legs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<ObstacleTable>,
    /// Known places that acoustic sensors see.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub landmarks: Vec<LandmarkTable>,
    /// The legs, in order.
    #[serde(default, deserialize_with = "legs")]
    pub legs: Vec<Leg>,
}

/// Where north = east = 0 lies; read by those who convert geographic places, not by the core.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f64,
}

/// Where the first leg begins.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct StartTable {
    /// North of the origin, m.
    pub north_m: f64,
    /// East of the origin, m.
    pub east_m: f64,
    /// Depth, m.
    pub depth_m: f64,
    /// Heading, degrees; towards the first waypoint when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
}

/// What the mission may not leave.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsTable {
    /// Largest depth, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_depth_m: Option<f64>,
    /// Smallest altitude above the bottom, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_altitude_m: Option<f64>,
    /// Longest time, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_time_s: Option<f64>,
    /// Corners of the fence, north and east, m.
    #[serde(skip_serializing_if = "Vec::is_empty", deserialize_with = "corners")]
    pub fence_m: Vec<[f64; 2]>,
}

/// One leg: a place or a pattern.
#[derive(Clone, Debug, Serialize, PartialEq)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Leg {
    /// A place to go to.
    Waypoint(WaypointLeg),
    /// Parallel lines over a rectangle.
    Lawnmower(Lawnmower),
    /// An Archimedean spiral, or a helix.
    Spiral(Spiral),
    /// Rounds about a fish farm.
    Perimeter(Perimeter),
}

/// The names of the kinds.
const KINDS: [&str; 4] = ["waypoint", "lawnmower", "spiral", "perimeter"];

/// The legs of a file; a message names the leg by its number, because a leg that is read by hand has lost its line.
fn legs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Leg>, D::Error> {
    let tables = Vec::<toml::Table>::deserialize(deserializer)?;
    let numbered = tables.into_iter().enumerate().map(|(k, table)| {
        leg(table).map_err(|message| D::Error::custom(format!("{LEG}{}: {message}", k + 1)))
    });
    numbered.collect()
}

/// Begins the messages about a leg.
const LEG: &str = "leg ";

/// One leg: by hand, because the kind has a default and a geographic place deserves its own sentence.
fn leg(mut table: toml::Table) -> Result<Leg, String> {
    let kind = match table.remove("kind") {
        None => "waypoint".to_owned(),
        Some(toml::Value::String(kind)) => kind,
        Some(other) => return Err(format!("kind: expected text, found {other}")),
    };
    if let Some(key) =
        ["latitude_deg", "longitude_deg", "corners_deg"].iter().find(|k| table.contains_key(**k))
    {
        return Err(format!(
            "{key}: expected metres north and east of the origin, found a geographic place; load the file with seatrial's Mission.load, which converts it about [origin]"
        ));
    }
    let read = match kind.as_str() {
        "waypoint" => table.try_into().map(Leg::Waypoint),
        "lawnmower" => table.try_into().map(Leg::Lawnmower),
        "spiral" => table.try_into().map(Leg::Spiral),
        "perimeter" => table.try_into().map(Leg::Perimeter),
        _ => {
            let known = KINDS.join(", ");
            return Err(format!("kind: expected {known}, found \"{kind}\"{}", nearest(&kind, KINDS)));
        }
    };
    read.map_err(|error: toml::de::Error| {
        // The reader names the key on a line of its own: in `key`.
        let shown = error.to_string();
        let key = shown.lines().find_map(|line| line.strip_prefix("in `")?.strip_suffix('`'));
        format!("{}{}", key.map(|key| format!("{key}: ")).unwrap_or_default(), explain(&error, ""))
    })
}

impl MissionFile {
    /// Reads a mission file; `source_name` stands in messages.
    ///
    /// # Errors
    /// When the text is not TOML, a key is unknown or missing, or a value has the wrong type.
    pub fn parse(text: &str, source_name: &str) -> Result<Self, Error> {
        parsed("a mission", text, source_name, ranges::MISSION)
    }

    /// The file as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a mission file holds plain numbers, text and tables")
    }
}
