//! Measures of a hull along its length, from which the cross-flow drag by strips is computed.
//!
//! Tests: `tests/laws/cross_flow.rs`.

use crate::description::geometry::Geometry;
use crate::model::cross_flow::Strips;
use serde::{Deserialize, Serialize};

/// Places and measures, linear between them.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct CrossFlowTable {
    /// Places, m ahead of O, increasing: the first is the tail, the last the nose.
    pub x_m: Vec<f64>,
    /// Diameter there, m; of a box-shaped hull its width.
    pub diameter_m: Vec<f64>,
    /// Height there, m, where it differs from the diameter.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub height_m: Vec<f64>,
}

impl CrossFlowTable {
    /// What is wrong with the table, if anything.
    pub fn complaint(&self) -> Option<String> {
        if self.x_m.len() < 2 || self.x_m.windows(2).any(|pair| pair[1] <= pair[0]) {
            return Some(format!(
                "cross_flow.x_m: expected two increasing places or more, from tail to nose in metres ahead of O, found {:?}",
                self.x_m
            ));
        }
        [("diameter_m", &self.diameter_m, false), ("height_m", &self.height_m, true)]
            .into_iter()
            .find(|(_, values, optional)| values.len() != self.x_m.len() && !(*optional && values.is_empty()))
            .map(|(key, values, _)| {
                format!(
                    "cross_flow.{key}: expected {} numbers, one per place in x_m, found {}",
                    self.x_m.len(),
                    values.len()
                )
            })
    }

    /// The hull in strips.
    pub fn strips(&self) -> Strips {
        let upright = if self.height_m.is_empty() { &self.diameter_m } else { &self.height_m };
        Strips::new(self.x_m[0], self.x_m[self.x_m.len() - 1], |x| {
            let upper = self.x_m.partition_point(|place| *place < x).clamp(1, self.x_m.len() - 1);
            let share = (x - self.x_m[upper - 1]) / (self.x_m[upper] - self.x_m[upper - 1]);
            [upright, &self.diameter_m].map(|y| y[upper - 1] + share * (y[upper] - y[upper - 1]))
        })
    }
}

impl Geometry {
    /// The hull in strips of one diameter and height, O in its middle.
    pub fn strips(&self) -> Strips {
        let measures = [self.height_m.unwrap_or(self.diameter_m), self.diameter_m];
        Strips::new(-0.5 * self.length_m, 0.5 * self.length_m, |_| measures)
    }
}
