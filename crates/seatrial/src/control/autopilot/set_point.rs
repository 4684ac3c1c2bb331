//! Set points in place of guidance: a trial of the loops, or steering by hand.
//!
//! What is given replaces what guidance asks for; the rest stays with guidance. A depth is a level path to guidance, so
//! that it acts over pitch as well as by heave; a pitch that is given beside it counts instead. A `shift` moves the whole
//! plan: a step of the path, which guidance and the loops answer together. Limits, modes, safety and reactions are those
//! of a mission, but for the watch over progress: who is steered need not come nearer to a waypoint. From a reaction on,
//! set points are not heeded: the vehicle holds where it is, or comes up.
//!
//! Source: Taubert et al. (2014), section "Constraint Criteria Optimization" (set-point responses).
//! Tests: `tests/closed_loop/set_points.rs`.

use crate::control::guidance::Desired;
use crate::number::algebra::{Vec3, each};
use crate::number::real::Real;

/// The names of what may be set, in the order of [`SetPoint::of`].
pub const SET_POINTS: [&str; 8] = ["speed", "lateral", "heading", "pitch", "depth", "north", "east", "down"];

/// The place of the heading among them; any angle may be given, and is wrapped.
const HEADING: usize = 2;

/// The place of the depth.
const DEPTH: usize = 4;

/// Set points of one control period.
#[derive(Clone, Copy, Debug)]
pub struct SetPoint<T> {
    /// Surge and sway speed, m/s; heading and pitch, rad; depth, m: instead of guidance's where given.
    pub given: [Option<T>; 5],
    /// How far the plan is moved: north, east, down, m.
    pub shift: Vec3<T>,
}

impl<T: Real> SetPoint<T> {
    /// From the values in the order of [`SET_POINTS`]; a place that is not `named` is left to guidance.
    #[inline(always)]
    pub fn of(unit: T, values: impl IntoIterator<Item = (usize, T)>) -> Self {
        let mut set = Self { given: [None; 5], shift: [unit.zero(); 3] };
        for (named, value) in values {
            let value = if named == HEADING { value.wrap() } else { value };
            match set.given.get_mut(named) {
                Some(place) => *place = Some(value),
                None => set.shift[named - 5] = value,
            }
        }
        set
    }

    /// The depth that is set, m.
    #[inline(always)]
    pub(super) fn depth(&self) -> Option<T> {
        self.given[DEPTH]
    }

    /// The same, with the plan moved only where the mask holds.
    #[inline(always)]
    pub(super) fn moved_only(&self, mask: T::Mask) -> Self {
        Self { shift: each(&self.shift, |x| T::select(mask, x, x.zero())), ..*self }
    }

    /// Puts what is given over what guidance asks for, which it did in the frame of the moved plan, where the mask
    /// holds.
    #[inline(always)]
    pub(super) fn over(&self, desired: &mut Desired<T>, mask: T::Mask) {
        desired.depth += self.shift[2];
        let places = [
            &mut desired.speed,
            &mut desired.lateral,
            &mut desired.heading,
            &mut desired.pitch,
            &mut desired.depth,
        ];
        for (place, given) in places.into_iter().zip(self.given) {
            if let Some(value) = given {
                *place = T::select(mask, value, *place);
            }
        }
    }
}
