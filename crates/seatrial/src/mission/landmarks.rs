//! Known places in a mission file that acoustic sensors see: transponders, walls, round nets.
//!
//! They guide nothing and are no obstacles: a navigation filter finds its place by them.
//!
//! Tests: `tests/flight/test_acoustics.py`.

use super::numbers::{finite, positive};
use serde::{Deserialize, Serialize};

/// A known place; its name ends the channels `range.NAME` and `bearing.NAME`.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum LandmarkTable {
    /// A transponder.
    Beacon {
        /// Its name.
        name: String,
        /// North of the origin, m.
        north_m: f64,
        /// East of the origin, m.
        east_m: f64,
        /// Depth, m.
        depth_m: f64,
    },
    /// A vertical plane: a quay, a flat net.
    Wall {
        /// Its name.
        name: String,
        /// North of the origin, m, of a point of it.
        north_m: f64,
        /// East of the origin, m.
        east_m: f64,
        /// Direction of its normal, degrees from north over east.
        facing_deg: f64,
    },
    /// A vertical cylinder: a round net, a pile.
    Pen {
        /// Its name.
        name: String,
        /// North of the origin, m, of its axis.
        north_m: f64,
        /// East of the origin, m.
        east_m: f64,
        /// Radius, m.
        radius_m: f64,
    },
}

impl LandmarkTable {
    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            Self::Beacon { name, .. } | Self::Wall { name, .. } | Self::Pen { name, .. } => name,
        }
    }
}

/// Refuses names that no channel can have, and places that are none.
pub(super) fn check(landmarks: &[LandmarkTable]) -> Result<(), String> {
    for (k, mark) in landmarks.iter().enumerate() {
        let at = |key: &str| format!("landmark {}: {key}", k + 1);
        let name = mark.name();
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c)) {
            return Err(format!(
                "{}: expected letters, digits, _ and -, found \"{name}\"; it ends the channel range.NAME",
                at("name")
            ));
        }
        if landmarks[..k].iter().any(|other| other.name() == name) {
            return Err(format!("{}: expected a name of its own, found \"{name}\" twice", at("name")));
        }
        let ([north, east], (key, third)) = match *mark {
            LandmarkTable::Beacon { north_m, east_m, depth_m, .. } => {
                ([north_m, east_m], ("depth_m", depth_m))
            }
            LandmarkTable::Wall { north_m, east_m, facing_deg, .. } => {
                ([north_m, east_m], ("facing_deg", facing_deg))
            }
            LandmarkTable::Pen { north_m, east_m, radius_m, .. } => {
                positive(&at("radius_m"), radius_m)?;
                ([north_m, east_m], ("radius_m", radius_m))
            }
        };
        for (key, value) in [("north_m", north), ("east_m", east), (key, third)] {
            finite(&at(key), value)?;
        }
    }
    Ok(())
}
