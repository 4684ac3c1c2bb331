//! A path, straight or round, where the vehicle is.

use crate::number::real::Real;

/// A path at the point nearest to the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Path<T> {
    /// Course `π_p`, rad.
    pub course: T,
    /// To starboard of it, north and east.
    pub starboard: [T; 2],
    /// Cross-track error `y_e`, m.
    pub cross: T,
    /// Slope `γ_p`, rad.
    pub slope: T,
    /// Vertical error `z_e`, m.
    pub vertical: T,
    /// Depth of the path, m.
    pub depth: T,
    /// 1 on a circle.
    pub circling: T,
    /// 1 beyond the end of a line.
    pub direct: T,
    /// 1 where a depth is set in place of the plan's.
    pub set: T,
}

impl<T: Real> Path<T> {
    /// `other` where the mask holds, this path elsewhere.
    #[inline(always)]
    pub fn select(&self, mask: T::Mask, other: &Self) -> Self {
        let f = |mine: T, others: T| T::select(mask, others, mine);
        Self {
            course: f(self.course, other.course),
            starboard: [f(self.starboard[0], other.starboard[0]), f(self.starboard[1], other.starboard[1])],
            cross: f(self.cross, other.cross),
            slope: f(self.slope, other.slope),
            vertical: f(self.vertical, other.vertical),
            depth: f(self.depth, other.depth),
            circling: f(self.circling, other.circling),
            direct: f(self.direct, other.direct),
            set: f(self.set, other.set),
        }
    }

    /// The same path, level at another depth, for a vehicle at the depth `z`, m.
    #[inline(always)]
    pub fn level_at(&self, depth: T, z: T) -> Self {
        Self { slope: z.zero(), vertical: z - depth, depth, set: z.splat(1.0), ..*self }
    }
}
