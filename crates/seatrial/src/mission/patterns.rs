//! Survey patterns: parallel lines over a rectangle, and the Archimedean spiral in chords.
//!
//! * Lines: `⌈width/spacing⌉` equal gaps between the first and the last edge, so that no place of the rectangle is
//!   farther than half the spacing from a line.
//! * Spiral `r = r_0 + b θ`, b the spacing of the arms over 2π. A chord over Δθ stays within
//!   `Δθ² √(r² + 4b²)/8` of the curve, r the larger radius: the bound of linear interpolation, since
//!   `|γ''| = √(r² + 4b²)`. Δθ follows from the tolerance and is never above an eighth of a turn.
//!
//! Source: Archimedes' spiral; error of linear interpolation, e.g. Quarteroni, Sacco, Saleri, *Numerical Mathematics*,
//! section 8.1.
//! Tests: `tests/mission/patterns.rs` (coverage, order, spacing of the arms, deviation of the chords).

use super::plane::{Place, towards};
use crate::number::plain;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

/// So much of a gap or a turn is rounding of what was typed.
const ROUNDING: f64 = 1e-9;

/// A rectangle to cover with lines.
#[derive(Clone, Copy, Debug)]
pub struct Rectangle {
    /// Where the first line begins.
    pub corner: Place,
    /// Bearing of the first line, rad.
    pub bearing: f64,
    /// Length of the lines, m.
    pub length: f64,
    /// Width across the lines, m.
    pub width: f64,
    /// Largest distance between neighbouring lines, m.
    pub spacing: f64,
    /// 1 where the other lines follow to starboard of the first, −1 to port.
    pub side: f64,
    /// How far each line runs beyond the rectangle, m.
    pub overshoot: f64,
}

impl Rectangle {
    /// How many lines cover it.
    pub fn count(&self) -> f64 {
        (self.width / self.spacing - ROUNDING).ceil().max(1.0) + 1.0
    }

    /// The lines as flown, from beginning to end, every other one back.
    pub fn lines(&self) -> Vec<[Place; 2]> {
        let gaps = self.count() - 1.0;
        (0..=gaps as usize)
            .map(|i| {
                let across = self.side * self.width * i as f64 / gaps;
                let foot = towards(self.corner, self.bearing + FRAC_PI_2, across);
                let ends = [-self.overshoot, self.length + self.overshoot];
                let [near, far] = ends.map(|along| towards(foot, self.bearing, along));
                if i % 2 == 0 { [near, far] } else { [far, near] }
            })
            .collect()
    }
}

/// A spiral about a centre.
#[derive(Clone, Copy, Debug)]
pub struct Coil {
    /// Its centre.
    pub centre: Place,
    /// Radius where it begins and where it ends, m.
    pub radii: [f64; 2],
    /// Turns in between.
    pub turns: f64,
    /// Bearing from the centre to the beginning, rad.
    pub bearing: f64,
    /// 1 to starboard (clockwise), −1 to port.
    pub side: f64,
    /// Largest distance between curve and chord, m.
    pub tolerance: f64,
}

impl Coil {
    /// The angles turned so far, rad, from 0 to the whole, in steps that keep the tolerance; none when that takes more
    /// than `most` steps.
    ///
    /// The steps are laid from the larger radius inwards, because a step that is short enough at its outer end is
    /// short enough everywhere; the last two share what is left.
    fn angles(&self, most: usize) -> Option<Vec<f64>> {
        let whole = self.turns * TAU;
        let [large, small] = [self.radii[0].max(self.radii[1]), self.radii[0].min(self.radii[1])];
        let rate = (large - small) / whole;
        let mut angles = vec![0.0];
        let mut here = 0.0;
        while whole - here > ROUNDING {
            let radius = large - rate * here;
            let step = (8.0 * self.tolerance / plain::hypot(radius, 2.0 * rate)).sqrt().min(FRAC_PI_4);
            let rest = whole - here;
            here = if rest <= step {
                whole
            } else if rest < 2.0 * step {
                here + 0.5 * rest
            } else {
                here + step
            };
            angles.push(here);
            if angles.len() > most {
                return None;
            }
        }
        if self.radii[1] > self.radii[0] {
            angles.reverse();
            angles.iter_mut().for_each(|angle| *angle = whole - *angle);
        }
        Some(angles)
    }

    /// The points of the chords, each with the share of the turns behind it, 0 to 1; none when there are more than
    /// `most`.
    pub fn points(&self, most: usize) -> Option<Vec<(f64, Place)>> {
        let whole = self.turns * TAU;
        let point = |angle: f64| {
            let share = angle / whole;
            let radius = self.radii[0] + share * (self.radii[1] - self.radii[0]);
            (share, towards(self.centre, self.bearing + self.side * angle, radius))
        };
        Some(self.angles(most)?.into_iter().map(point).collect())
    }
}
