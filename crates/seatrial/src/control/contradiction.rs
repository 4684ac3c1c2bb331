//! Whether the sensors tell of one motion: each coordinate and angle against the rate that the others give for it.
//!
//! From one good sample of a coordinate to the next the rates say how far it should have moved. What it moved otherwise
//! is an innovation, and the innovations are summed with a memory:
//!
//! ```text
//! ν = ∫ η̇ᵢ(Θ, ν) dt − Δηᵢ          between the times at which the two samples were true
//! d ← d · τ/(τ + dt) + ν             τ = 20 s
//! ```
//!
//! `d` is how far the other sensors would have carried the coordinate beyond what its own sensor shows. Noise of a sample
//! enters d once; an offset b of the rate becomes b·τ. So a sensor that is stuck *with its noise*, late, of wrong sign, or that
//! drifts faster than threshold/τ contradicts its rate whatever values it shows, which a search for repeated values
//! does not see. A contradiction begins beyond a threshold and ends below half of it. Nobody can tell which of the two is
//! wrong; depth and fence are therefore held against both ([`Contradiction::other`]).
//!
//! Nothing is compared over a time in which a rate was not measured, nor a position over a gap of more than ten seconds: a
//! fix after dead reckoning corrects, it does not contradict. A leap of depth or of an angle that is believed
//! ([`crate::control::screen`]) is told for ten seconds, and is no motion. A velocity is *rough* where it changes from
//! sample to sample, on average, by more than any vehicle's velocity does.
//!
//! With noise alone d is Gaussian with σ_d² = σ_η² + σ_rate² dt τ/2: for the sensors of `typical.toml` 1.0 m (GPS), 2 cm and
//! 0.1°. A threshold of n σ_d is passed by noise once in about 2πτ_c e^{n²/2} seconds (Rice 1944, τ_c the correlation time,
//! here one sample at least): at n = 7 less than once in 1,000 years at 10 Hz. What decides is therefore offsets, for which
//! the thresholds are sized (see [`Thresholds`]).
//!
//! Tests: `tests/core/test_helm_contradictions.py`, `tests/export/test_c_faults.py`.

use crate::control::navigation::{CHANNELS, DEPTH, Measurement, VELOCITY};
use crate::model::kinematics::euler_rate;
use crate::number::algebra::Vec6;
use crate::number::real::Real;
use serde::{Deserialize, Serialize};

/// The coordinates and angles; the rate of each is the channel six places further.
pub const KINEMATIC: usize = 6;

/// Beyond which contradiction the sensors cannot both be right.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Thresholds {
    /// North and east, m: three deviations of a GPS of 1 m, or 0.15 m/s of offset over τ.
    pub position_m: f64,
    /// Depth, m: 0.05 m/s of offset over τ, as 1.5° of mounting error of the pitch make at 1.8 m/s.
    pub depth_m: f64,
    /// Roll, pitch and yaw, deg: 0.5°/s of offset of a gyro over τ.
    pub angle_deg: f64,
    /// Mean change of a velocity from step to step, m/s: sixty deviations of a Doppler log of 8 mm/s.
    pub roughness_m_s: f64,
    /// A contradiction for so long, s, calls for the reaction of the group's watch: longer than one wild sample lasts.
    pub after_s: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self { position_m: 3.0, depth_m: 1.0, angle_deg: 10.0, roughness_m_s: 0.5, after_s: 5.0 }
    }
}

impl Thresholds {
    /// The thresholds of the coordinates and angles, m and rad.
    fn of(&self, k: usize) -> f64 {
        match k {
            0 | 1 => self.position_m,
            DEPTH => self.depth_m,
            _ => self.angle_deg.to_radians(),
        }
    }
}

/// Memory of the sums, s.
const MEMORY_S: f64 = 20.0;

/// Memory of the roughness, s.
const ROUGH_MEMORY_S: f64 = 3.0;

/// Beyond these ages velocities with angles, and turn rates, say nothing, s: a sample that is held through a drop-out would
/// count as the motion meanwhile, and a turn changes within half a second.
const VELOCITY_IS_OLD_S: f64 = 1.2;
const RATE_IS_OLD_S: f64 = 0.5;

/// Beyond this age a position is silent, and a longer step compares nothing, s.
const SILENT_S: f64 = 2.0;

/// A position after a longer gap is a fix that corrects, s.
const GAP_S: f64 = 10.0;

/// For so long a leap is told, s.
const LEAP_TOLD_S: f64 = 10.0;

/// A contradiction ends at this share of its threshold.
const ENDS_AT: f64 = 0.5;

/// The steepest pitch at which Euler angles are compared, rad.
const STEEPEST: f64 = 1.4;

/// Rounding of sums of periods, s.
const TICK_S: f64 = 1e-9;

/// What is remembered of the comparison.
#[derive(Clone, Debug)]
pub struct Contradiction<T> {
    /// The coordinates at their last samples, how old these are, and what the rates say since.
    last: Vec6<T>,
    age: Vec6<T>,
    since: Vec6<T>,
    /// 1 where a rate was not known at some time since the last sample.
    blind: Vec6<T>,
    /// How far the rates are ahead of the coordinates, m and rad.
    apart: Vec6<T>,
    /// 1 while they contradict each other.
    contrary: Vec6<T>,
    /// For how much longer a leap is told, s.
    leapt: Vec6<T>,
    velocity: [T; 3],
    rough: [T; 3],
}

crate::memory!(Contradiction: last, age, since, blind, apart, contrary, leapt, velocity, rough;);

impl<T: Real> Contradiction<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        let zeros = [unit.zero(); KINEMATIC];
        Self {
            last: zeros,
            age: [unit.splat(f64::INFINITY); KINEMATIC],
            since: zeros,
            blind: [unit.splat(1.0); KINEMATIC],
            apart: zeros,
            contrary: zeros,
            leapt: zeros,
            velocity: [unit.zero(); 3],
            rough: [unit.zero(); 3],
        }
    }

    /// Takes what is believed `dt` seconds after the last look, and what `moved` by a leap.
    #[inline(always)]
    pub fn see(&mut self, believed: &Measurement<T>, moved: &[T; CHANNELS], table: &Thresholds, dt: f64) {
        let zero = believed.battery.zero();
        let one = zero.splat(1.0);
        let rates = rates(believed);
        let young = |c: usize| {
            let oldest = if c < 9 { VELOCITY_IS_OLD_S } else { RATE_IS_OLD_S };
            believed.age[c].lt(zero.splat(oldest))
        };
        let linear = T::both(young(VELOCITY), T::both(young(VELOCITY + 1), young(VELOCITY + 2)));
        let turning = T::both(young(9), T::both(young(10), young(11)));
        let upright = T::both(young(3), T::both(young(4), young(5)));
        let goes_on = zero.splat(dt).lt(zero.splat(SILENT_S));
        let upright = T::both(upright, goes_on);
        let known = [T::both(linear, upright), T::both(turning, upright)];
        let share = MEMORY_S / (MEMORY_S + dt);
        for k in 0..KINEMATIC {
            let (value, age, rate) = (believed.channels[k], believed.age[k], rates[k]);
            self.blind[k] = T::select(known[k / 3], self.blind[k], one);
            self.since[k] += rate * dt;
            let older = self.age[k] + dt;
            let change = value - self.last[k];
            let change = if k == 3 || k == 5 { change.wrap() } else { change };
            let other = zero.lt(change.abs());
            let fresh = T::either(other, (age + TICK_S).lt(older));
            let leap = if k > 1 { moved[k] } else { zero };
            let innovation = self.since[k] - rate * age - (change - leap);
            let gap = if k > 1 { f64::INFINITY } else { GAP_S };
            let counts = T::both(older.lt(zero.splat(gap)), self.blind[k].lt(zero.splat(0.5)));
            let added = T::select(T::both(fresh, counts), innovation, zero);
            self.apart[k] = self.apart[k] * share + added;
            self.since[k] = T::select(fresh, rate * age, self.since[k]);
            self.blind[k] = T::select(fresh, T::select(known[k / 3], zero, one), self.blind[k]);
            self.last[k] = T::select(fresh, value, self.last[k]);
            self.age[k] = age;
            let (off, most) = (self.apart[k].abs(), table.of(k));
            let still = T::select(zero.splat(ENDS_AT * most).lt(off), self.contrary[k], zero);
            self.contrary[k] = T::select(zero.splat(most).lt(off), one, still);
            let jumped = zero.lt(moved[k].abs());
            self.leapt[k] = T::select(jumped, zero.splat(LEAP_TOLD_S), (self.leapt[k] - dt).max(zero));
        }
        let rough = dt / (ROUGH_MEMORY_S + dt);
        for i in 0..3 {
            let (value, age) = (believed.channels[VELOCITY + i], believed.age[VELOCITY + i]);
            let first = T::both(age.lt(zero.splat(f64::INFINITY)), zero.lt(self.velocity[i].abs()));
            let change = T::select(first, (value - self.velocity[i]).abs(), zero);
            self.rough[i] += (change - self.rough[i]) * rough;
            self.velocity[i] = value;
        }
    }

    /// 1 where a coordinate or angle and its rate contradict each other.
    #[inline(always)]
    pub fn contrary(&self, k: usize) -> T {
        self.contrary[k]
    }

    /// 1 while a contradiction, a leap that was believed, or a rough velocity is to be told of a channel.
    #[inline(always)]
    pub fn noticed(&self, c: usize, table: &Thresholds) -> T {
        let zero = self.apart[0].zero();
        match c {
            0..KINEMATIC => self.contrary[c].max(T::select(zero.lt(self.leapt[c]), zero.splat(1.0), zero)),
            VELOCITY..9 => {
                let rough = zero.splat(table.roughness_m_s).lt(self.rough[c - VELOCITY]);
                T::select(rough, zero.splat(1.0), zero)
            }
            _ => zero,
        }
    }

    /// Where the other sensors would have carried a coordinate, m, while they contradict it or it is silent; else the
    /// coordinate.
    #[inline(always)]
    pub fn other(&self, k: usize, value: T) -> T {
        let zero = value.zero();
        let silent = T::both(zero.splat(SILENT_S).lt(self.age[k]), self.blind[k].lt(zero.splat(0.5)));
        value + self.contrary[k] * self.apart[k] + T::select(silent, self.since[k], zero)
    }
}

/// The rates of position (m/s) and attitude (rad/s) by velocities and turn rates.
#[inline(always)]
fn rates<T: Real>(believed: &Measurement<T>) -> Vec6<T> {
    let [roll, pitch, yaw] = believed.attitude();
    // Nearer to the vertical, roll and yaw mean nothing.
    let pitch = pitch.clamped(pitch.splat(-STEEPEST), pitch.splat(STEEPEST));
    let ([u, v, w], [p, q, r]) = (believed.velocity(), believed.rates());
    euler_rate(&[roll, pitch, yaw], &[u, v, w, p, q, r])
}
