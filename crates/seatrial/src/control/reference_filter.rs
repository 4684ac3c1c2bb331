//! The reference filter: a critically damped third-order lag that turns a jump of the reference into a course which
//! the vehicle can follow, with its rate and acceleration for the feed-forward. Neither of them jumps.
//!
//! `(d/dt + ω)³ e = 0` with `e = x − r`, solved exactly over a step with r held: `e(h) = (c_0 + c_1 h + c_2 h²) e^(−ω h)`,
//! `c_0 = e`, `c_1 = v + ω e`, `c_2 = ½ (a + 2 ω v + ω² e)`. A step is followed 3/ω late.
//!
//! Source: Fossen (2011), section 10.2.1, with three equal poles. Tests: `tests/control.rs::law_reference_filter_…`.

use crate::number::real::Real;

/// Where the filtered reference is.
#[derive(Clone, Copy, Debug)]
pub struct Reference<T> {
    /// Filtered reference.
    pub value: T,
    /// Its rate, per s.
    pub rate: T,
    /// Its acceleration, per s².
    pub acceleration: T,
}

crate::memory!(Reference: value, rate, acceleration;);

impl<T: Real> Reference<T> {
    /// A reference that rests at `value`.
    #[inline(always)]
    pub fn at(value: T) -> Self {
        Self { value, rate: value.zero(), acceleration: value.zero() }
    }

    /// The filter of natural frequency `omega` (rad/s) one step of `h` seconds later, towards `wanted`; of an
    /// `angle` the shortest way.
    #[inline(always)]
    pub fn follow(&self, wanted: T, omega: T, h: f64, angle: bool) -> Self {
        let offset = self.value - wanted;
        let c_0 = if angle { offset.wrap() } else { offset };
        let c_1 = omega.mul_add(c_0, self.rate);
        let c_2 = (omega.mul_add(self.rate + c_1, self.acceleration)) * 0.5;
        let decay = (-(omega * h)).exp();
        // The polynomial and its derivatives at h.
        let p = (c_2 * h + c_1) * h + c_0;
        let p_1 = c_2 * (2.0 * h) + c_1;
        let slope = omega.neg_mul_add(p, p_1);
        let bend = omega.neg_mul_add(p_1 + slope, c_2 * 2.0);
        let value = p.mul_add(decay, wanted);
        Self {
            value: if angle { value.wrap() } else { value },
            rate: slope * decay,
            acceleration: bend * decay,
        }
    }
}
