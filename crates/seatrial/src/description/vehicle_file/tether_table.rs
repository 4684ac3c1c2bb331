//! A tether as written in the vehicle file. Its forces: [`crate::model::tether`].
//!
//! Drag area `A_tether` and stiffness `k_tether` are coefficients, so that they are identified as any other.
//!
//! Tests: `tests/laws/tether.rs`.

use crate::toml_file::{exactly, exactly_if_given};
use serde::{Deserialize, Serialize};

/// Where a tether is made fast, and where it leads to.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct TetherTable {
    /// Point of attachment, m: forward, starboard, down of O.
    #[serde(deserialize_with = "exactly")]
    pub position_m: [f64; 3],
    /// The far end, m: north, east, down.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exactly_if_given")]
    pub anchor_m: Option<[f64; 3]>,
    /// Length that does not pull, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slack_m: Option<f64>,
}

impl TetherTable {
    /// What is wrong with the table, if anything.
    pub fn complaint(&self) -> Option<String> {
        match (self.anchor_m, self.slack_m) {
            (Some(_), None) => Some(
                "tether.slack_m: the length that does not pull is missing beside anchor_m; give it in m"
                    .to_owned(),
            ),
            (None, Some(_)) => Some(
                "tether.anchor_m: the far end is missing beside slack_m; give it as north, east, down in m"
                    .to_owned(),
            ),
            _ => None,
        }
    }

    /// Far end and slack length, where the tether has a spring.
    pub fn spring(&self) -> Option<([f64; 3], f64)> {
        self.anchor_m.zip(self.slack_m)
    }
}
