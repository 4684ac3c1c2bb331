//! The legs of a mission file: a waypoint and the three patterns, key by key.
//!
//! Every kind names its places `north_m` and `east_m`, so that geographic places are converted alike.
//!
//! Tests: `tests/mission.rs`.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// A place to go to, and what to do there.
#[derive(Clone, Debug, Default, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct WaypointLeg {
    /// North of the origin, m.
    pub north_m: f64,
    /// East of the origin, m.
    pub east_m: f64,
    /// Depth, m; as the leg before when altitude is missing too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_m: Option<f64>,
    /// Altitude above the bottom, m, instead of a depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub altitude_m: Option<f64>,
    /// Speed over ground on the way there, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Radius of acceptance, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_radius_m: Option<f64>,
    /// Time of station-keeping, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hold_s: Option<f64>,
    /// Heading while station-keeping, degrees; free when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
    /// Radius of the circle to fly about the place, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub circle_radius_m: Option<f64>,
    /// Turns of that circle; may be fractional.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turns: Option<f64>,
    /// Side to which the circle turns; starboard when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<Side>,
    /// Name in reports; `waypoint` and the number of the leg when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// Parallel lines over a rectangle, flown to and fro.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Lawnmower {
    /// The corner where the first line begins: north of the origin, m.
    pub north_m: f64,
    /// The corner where the first line begins: east of the origin, m.
    pub east_m: f64,
    /// Direction of the first line, degrees.
    pub heading_deg: f64,
    /// Length of the lines, m.
    pub length_m: f64,
    /// Width of the rectangle, m.
    pub width_m: f64,
    /// Largest distance between neighbouring lines, m.
    pub spacing_m: f64,
    /// Side of the first line on which the others follow.
    #[serde(default)]
    pub side: Side,
    /// How far each line runs beyond the rectangle at both ends, m.
    #[serde(default)]
    pub overshoot_m: f64,
    /// Depth, m; as the leg before when altitude is missing too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_m: Option<f64>,
    /// Altitude above the bottom, m, instead of a depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub altitude_m: Option<f64>,
    /// Speed over ground, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Radius of acceptance, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_radius_m: Option<f64>,
    /// Begins the labels; `lawnmower` when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// An Archimedean spiral about a place, inwards or outwards; a helix when both radii are equal.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Spiral {
    /// The centre: north of the origin, m.
    pub north_m: f64,
    /// The centre: east of the origin, m.
    pub east_m: f64,
    /// Radius where it begins, m.
    pub start_radius_m: f64,
    /// Radius where it ends, m.
    pub end_radius_m: f64,
    /// Distance between neighbouring arms, m; or give `turns`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spacing_m: Option<f64>,
    /// Number of turns, may be fractional; or give `spacing_m`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turns: Option<f64>,
    /// Bearing from the centre to the beginning, degrees.
    #[serde(default)]
    pub start_bearing_deg: f64,
    /// Side to which it turns.
    #[serde(default)]
    pub direction: Side,
    /// Largest distance between the curve and the chords that are flown, m.
    #[serde(default = "tolerance")]
    pub tolerance_m: f64,
    /// Depth where it begins, m; as the leg before when altitude is missing too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_m: Option<f64>,
    /// Depth where it ends, m; as it began when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end_depth_m: Option<f64>,
    /// Altitude above the bottom, m, instead of a depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub altitude_m: Option<f64>,
    /// Speed over ground, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Radius of acceptance, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_radius_m: Option<f64>,
    /// Begins the labels; `spiral` when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// Rounds about a fish farm, with stops for water samples.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Perimeter {
    /// Centre of a circular farm: north of the origin, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub north_m: Option<f64>,
    /// Centre of a circular farm: east of the origin, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub east_m: Option<f64>,
    /// Radius of a circular farm, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Corners of a convex farm in order, north and east, m, instead of centre and radius.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "corners")]
    pub corners_m: Vec<[f64; 2]>,
    /// Smallest distance of the hull from the farm that the mission promises, m.
    pub distance_m: f64,
    /// How much farther out the way is laid, m: room for turns, current and errors of the sensors.
    #[serde(default)]
    pub margin_m: f64,
    /// Depths of the rounds in turn, m; one round as the leg before when missing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub depths_m: Vec<f64>,
    /// Stops per round, equally spaced.
    #[serde(default)]
    pub stops: u32,
    /// Time of station-keeping at each stop, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_s: Option<f64>,
    /// Bearing from the farm's centre to where every round begins, degrees.
    #[serde(default)]
    pub start_bearing_deg: f64,
    /// Side on which the farm lies.
    #[serde(default)]
    pub direction: Side,
    /// Largest excess over `distance_m + margin_m` along the way, m.
    #[serde(default = "tolerance")]
    pub tolerance_m: f64,
    /// Speed over ground, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_m_s: Option<f64>,
    /// Radius of acceptance, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_radius_m: Option<f64>,
    /// Begins the labels; `farm` when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// What stands in the water from the surface to the bottom.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ObstacleTable {
    /// Centre of a round one: north of the origin, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub north_m: Option<f64>,
    /// Centre of a round one: east of the origin, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub east_m: Option<f64>,
    /// Radius of a round one, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Corners of a convex one in order, north and east, m, instead of centre and radius.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "corners")]
    pub corners_m: Vec<[f64; 2]>,
    /// Smallest distance of the hull from it that the mission promises, m.
    #[serde(default)]
    pub distance_m: f64,
}

/// A side of the vehicle.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// To the right; a turn is clockwise seen from above.
    #[default]
    Starboard,
    /// To the left; a turn is anticlockwise seen from above.
    Port,
}

impl Side {
    /// 1 to starboard, −1 to port: the sign of a change of heading.
    pub fn sign(self) -> f64 {
        match self {
            Self::Starboard => 1.0,
            Self::Port => -1.0,
        }
    }
}

/// A quarter of a metre: below what a vehicle under way can follow.
fn tolerance() -> f64 {
    0.25
}

/// Corners of two numbers each: a third, perhaps a depth, is no corner and must not be passed over.
pub(super) fn corners<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[f64; 2]>, D::Error> {
    let pair = |row: Vec<f64>| {
        <[f64; 2]>::try_from(row).map_err(|row| {
            D::Error::custom(format!("expected corners [north, east], found {} numbers", row.len()))
        })
    };
    Vec::<Vec<f64>>::deserialize(deserializer)?.into_iter().map(pair).collect()
}
