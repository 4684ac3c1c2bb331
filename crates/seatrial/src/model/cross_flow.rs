//! Cross-flow drag by strips of the hull: what a single `Y_vv`, `N_rr` and their cross terms stand for.
//!
//! A strip at `x` ahead of O meets the water sideways at `v + x r` and downwards at `w − x q`:
//!
//! * `Y = −½ρ C_Dy ∫ h(x) |v + x r| (v + x r) dx`, `N` likewise with `x h(x)`;
//! * `Z = −½ρ C_Dz ∫ d(x) |w − x q| (w − x q) dx`, `M` likewise with `−x d(x)`;
//!
//! with the hull's height `h` seen from the side, its diameter or width `d` seen from above (m), and one drag coefficient
//! per plane. The integral is the Gauss–Legendre sum over [`STRIPS`] strips: exact to 1e-4 of `½ρ C_D d l v²` where the
//! hull turns about a point of itself, exact to rounding where it does not and `d` is constant. No square root and no
//! division: smooth in the velocities once, as `|x| x` is.
//!
//! Source: Fossen (2011), section 6.4.4; Faltinsen, *Sea Loads on Ships and Offshore Structures* (1990), chapter 6.
//! Tests: `tests/laws/cross_flow.rs`, `tests/core/test_scalar_textbook.py`, `tests/core/test_casadi_derivatives.py`.

use crate::number::algebra::Vec6;
use crate::number::plain;
use crate::number::real::Real;

/// Number of strips.
pub const STRIPS: usize = 16;

/// The hull cut into strips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strips {
    /// Places, m ahead of O.
    pub x: [f64; STRIPS],
    /// Area seen from the side, m².
    pub side: [f64; STRIPS],
    /// Area seen from above, m².
    pub above: [f64; STRIPS],
}

impl Strips {
    /// Strips between `from` and `to` (m ahead of O) of a hull whose height and width at `x` are `measures(x)`, m.
    pub fn new(from: f64, to: f64, measures: impl Fn(f64) -> [f64; 2]) -> Self {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let mut strips = Self { x: [0.0; STRIPS], side: [0.0; STRIPS], above: [0.0; STRIPS] };
        for i in 0..STRIPS {
            let (node, weight) = legendre_node(STRIPS, i);
            let x = middle + half * node;
            let [height, width] = measures(x);
            strips.x[i] = x;
            strips.side[i] = weight * half * height;
            strips.above[i] = weight * half * width;
        }
        strips
    }
}

/// Node `i` of the Gauss–Legendre rule of `n` nodes on [−1, 1], ascending, and its weight.
fn legendre_node(n: usize, i: usize) -> (f64, f64) {
    let mut x = -plain::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5));
    let mut slope = 1.0;
    // Newton from Tricomi's estimate: the digits double each time, so that six rounds reach rounding.
    for _ in 0..6 {
        let (mut before, mut p) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
        }
        slope = n as f64 * (x * p - before) / (x * x - 1.0);
        x -= p / slope;
    }
    (x, 2.0 / ((1.0 - x * x) * slope * slope))
}

/// The drag of the strips.
#[derive(Clone, Copy)]
pub struct CrossFlow<T> {
    /// Where the strips are, and how large.
    pub strips: Strips,
    /// `½ρ C_Dy` and `½ρ C_Dz`, N s²/m⁴.
    pub pressure: [T; 2],
}

impl<T: Real> CrossFlow<T> {
    /// `tau` + the drag at the velocity `nu_r` through the water, N and N m.
    #[inline(always)]
    pub fn add(&self, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let [_, v, w, _, q, r] = *nu_r;
        let Strips { x, side, above } = &self.strips;
        let zero = v.zero();
        let [mut sway, mut yaw, mut heave, mut pitch] = [zero; 4];
        for i in 0..STRIPS {
            let (across, down) = (r * x[i] + v, w - q * x[i]);
            let (from_side, from_above) = (across.abs() * across * side[i], down.abs() * down * above[i]);
            sway += from_side;
            yaw += from_side * x[i];
            heave += from_above;
            pitch -= from_above * x[i];
        }
        let [c_y, c_z] = self.pressure;
        let mut sum = *tau;
        sum[1] -= c_y * sway;
        sum[2] -= c_z * heave;
        sum[4] -= c_z * pitch;
        sum[5] -= c_y * yaw;
        sum
    }
}
