//! One step of the classical Runge–Kutta method (RK4) for the state of a vehicle.
//!
//! The step is fixed: a candidate's result must not depend on its neighbours. The attitude is
//! normalised after every step. RK4 keeps its fourth order because thrust, current and measured
//! velocities are given at the start, the middle and the end of the step.
//!
//! Source: Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, section II.1.
//! Tests: `tests/laws.rs` (energy drift falls 16-fold when the step is halved).

use crate::model::kinematics::{Quaternion, quaternion_rate, renormalised, rotation};
use crate::model::vehicle::{Instant, Mode, Vehicle};
use crate::number::algebra::{Vec3, Vec6, each, product};
use crate::number::real::Real;

/// Position (NED, m), attitude (body → NED) and velocity (body, m/s and rad/s).
#[derive(Clone, Copy, Debug)]
pub struct State<T> {
    /// Position of O, north, east, down, m.
    pub position: Vec3<T>,
    /// Unit quaternion `[w x y z]`, body → NED.
    pub attitude: Quaternion<T>,
    /// `[u v w p q r]`, m/s and rad/s.
    pub nu: Vec6<T>,
}

crate::memory!(State: position, attitude, nu;);

impl<T: Real> State<T> {
    /// The numbers in one row, position first.
    #[inline(always)]
    pub(crate) fn row(&self) -> [T; 13] {
        let ([x, y, z], [a, b, c, d], [u, v, w, p, q, r]) = (self.position, self.attitude, self.nu);
        [x, y, z, a, b, c, d, u, v, w, p, q, r]
    }

    /// The state of a row.
    #[inline(always)]
    pub(crate) fn from_row(row: &[T; 13]) -> Self {
        let [x, y, z, a, b, c, d, u, v, w, p, q, r] = *row;
        Self { position: [x, y, z], attitude: [a, b, c, d], nu: [u, v, w, p, q, r] }
    }

    /// The measured axes set to the log.
    #[inline(always)]
    pub fn replay(&mut self, vehicle: &Vehicle<T>, instant: &Instant<T>) {
        for i in 0..6 {
            if vehicle.modes[i] == Mode::Measured {
                self.nu[i] = self.nu[i].splat(instant.measured[0][i]);
            }
        }
    }

    #[inline(always)]
    fn rate(&self, vehicle: &Vehicle<T>, instant: &Instant<T>) -> [T; 13] {
        let r = rotation(&self.attitude);
        let [u, v, w, p, q, s] = self.nu;
        let position = product(&r, &[u, v, w]);
        let attitude = quaternion_rate(&self.attitude, &[p, q, s]);
        State { position, attitude, nu: vehicle.acceleration((Some(&self.position), &r), &self.nu, instant) }
            .row()
    }
}

/// Where in the step each stage stands, its weight in the sum, and which of three instants it reads.
pub(crate) const STAGES: [(f64, f64, usize); 4] =
    [(0.0, 1.0 / 6.0, 0), (0.5, 1.0 / 3.0, 1), (0.5, 1.0 / 3.0, 1), (1.0, 1.0 / 6.0, 2)];

/// The state a step of `h` seconds later; `instants` at its start, middle and end.
#[inline(always)]
pub fn step<T: Real>(vehicle: &Vehicle<T>, state: &State<T>, h: f64, instants: &[Instant<T>; 3]) -> State<T> {
    let start = state.row();
    let mut sum = start;
    let mut slope = [start[0].zero(); 13];
    for (node, weight, instant) in STAGES {
        // Keeps the compiler from lifting a hundred constants out of the loop, only to spill them.
        let vehicle = std::hint::black_box(vehicle);
        let mut row = start;
        let node = start[0].splat(node * h);
        for i in 0..13 {
            row[i] = slope[i].mul_add(node, row[i]);
        }
        let mut at = State::from_row(&row);
        at.replay(vehicle, &instants[instant]);
        slope = at.rate(vehicle, &instants[instant]);
        let weight = start[0].splat(weight * h);
        for i in 0..13 {
            sum[i] = slope[i].mul_add(weight, sum[i]);
        }
    }
    let mut next = State::from_row(&each(&sum, Real::flush));
    next.attitude = renormalised(&next.attitude);
    next.replay(vehicle, &instants[2]);
    next
}
