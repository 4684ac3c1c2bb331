//! Whether the sensors tell of one motion: each coordinate and angle against the rate that the others give for it.
//!
//! From one good sample of a coordinate to the next the rates say how far it should have moved. What it moved otherwise
//! is an innovation, and the innovations are summed, less what an offset of the rates explains (a CUSUM with a dead zone):
//!
//! ```text
//! ν = ∫ η̇ᵢ(Θ, ν) dt − Δηᵢ                between the times at which the two samples were true
//! d ← (d + ν) − clamp(d + ν, ±k dt)      k: the largest offset of the rate, see [`Thresholds`]
//! ```
//!
//! `d` is how far the other sensors would have carried the coordinate beyond what its own sensor shows. So a sensor that is
//! stuck *with its noise*, late, of wrong sign, or that drifts faster than k contradicts its rate whatever values it shows,
//! which a search for repeated values does not see. A contradiction begins at
//!
//! ```text
//! h = max(h₀, min(7 σ, 3 h₀)) + 0.3 s · largest |η̇ᵢ| of late,     σ² = −mean(νₖ νₖ₋₁)
//! ```
//!
//! White noise σ of the coordinate makes successive innovations correlate by −σ², which a sensor that is stuck, drifts or
//! has the wrong sign does not; the second part is what stamps that are wrong by 0.3 s, or rates between two samples, make
//! of a fast motion: waves at the surface throw small vehicles about at 270°/s. While it lasts the sum keeps all it has. It
//! ends when the two are *seen to agree*: they tell of one motion, within h/2, over more than 2 h; or when the sum comes back
//! to h/2 before a reaction is called for, after a glitch. A vehicle at rest says nothing about its sensors: one that is up
//! after an abort by a stuck depth does not dive again by it.
//!
//! Nothing is compared over a time in which a rate was not measured: when it is older than usual for it by half an interval,
//! for a sample that is held through a drop-out would count as the motion meanwhile; nor while a leap of it is doubted
//! ([`crate::control::screen`]): what throws a vehicle about leaps in the gyro first. Nor is a position over a gap of more
//! than ten seconds: a fix after dead reckoning corrects, it does not contradict. A leap of depth or of an angle that is
//! believed ([`crate::control::screen`]) is told for ten seconds, and is no motion. A velocity is *rough* where it changes
//! from sample to sample, on average, by more than any vehicle's velocity does.
//!
//! **False alarms.** White noise of the rate of q² per second (a Doppler log of 8 mm/s at 5 Hz: q² = 1.3e-5 m²/s) takes the
//! sum beyond h about 2 k²/q² exp(−2 k h/q²) times a second (Siegmund 1985): never, at k = 0.04 m/s and h = 0.5 m. What
//! decides are offsets, for which k is sized, and time errors, for which h is. By simulation: docs/validation.md.
//!
//! Tests: `tests/core/test_helm_contradictions.py`, `tests/export/test_c_faults.py`.

use crate::control::navigation::{CHANNELS, DEPTH, Measurement, RATES, VELOCITY};
use crate::model::kinematics::euler_rate;
use crate::number::algebra::Vec6;
use crate::number::plain;
use crate::number::real::Real;
use serde::{Deserialize, Serialize};

/// The coordinates and angles; the rate of each is the channel six places further.
pub const KINEMATIC: usize = 6;

/// Beyond which contradiction the sensors cannot both be right.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Thresholds {
    /// North and east, m: five times what dead reckoning by typical sensors shows in waves.
    pub position_m: f64,
    /// Depth, m: twice what typical sensors show in waves of 1.5 m at the surface.
    pub depth_m: f64,
    /// Roll, pitch and yaw, deg: three times what typical sensors show there.
    pub angle_deg: f64,
    /// Error of the heading, deg, that is no contradiction: a compass that was not calibrated aboard.
    pub heading_off_deg: f64,
    /// The same of the pitch against the path, deg: six times the mounting error of typical sensors.
    pub pitch_off_deg: f64,
    /// Offset of a gyro, deg/s, that is no contradiction: a cheap one when it is cold.
    pub gyro_off_deg_s: f64,
    /// Mean change of a velocity from step to step, m/s: sixty deviations of a Doppler log of 8 mm/s.
    pub roughness_m_s: f64,
    /// A contradiction for so long, s, calls for the reaction of the group's watch: longer than one wild sample lasts.
    pub after_s: f64,
    /// The reaction is left when the contradiction is over for so long, s: longer than a loose plug is quiet.
    pub over_after_s: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self {
            position_m: 1.5,
            depth_m: 0.5,
            angle_deg: 8.0,
            heading_off_deg: 6.0,
            pitch_off_deg: 1.2,
            gyro_off_deg_s: 0.5,
            roughness_m_s: 0.5,
            after_s: 5.0,
            over_after_s: 20.0,
        }
    }
}

impl Thresholds {
    /// The least thresholds of the coordinates and angles, m and rad.
    fn of(&self, k: usize) -> f64 {
        match k {
            0 | 1 => self.position_m,
            DEPTH => self.depth_m,
            _ => self.angle_deg.to_radians(),
        }
    }

    /// Offset of a rate, m/s and rad/s, that is none by itself, and per m/s of speed.
    fn offset(&self, k: usize) -> (f64, f64) {
        match k {
            0 | 1 => (LOG_OFF_M_S, plain::sin(self.heading_off_deg.to_radians())),
            DEPTH => (SINKING_OFF_M_S, plain::sin(self.pitch_off_deg.to_radians())),
            _ => (self.gyro_off_deg_s.to_radians(), 0.0),
        }
    }
}

/// Offsets of velocities, m/s: scale errors of a Doppler log of 2 % at 2.5 m/s; five times its offset in w.
const LOG_OFF_M_S: f64 = 0.05;
const SINKING_OFF_M_S: f64 = 0.01;

/// Deviations of a coordinate's noise that count as none, and up to which multiple of the least threshold.
const DEVIATIONS: f64 = 7.0;
const NOISIEST: f64 = 3.0;

/// Share of a new sample in the mean that tells the noise: a memory of thirty samples.
const NOISE_SHARE: f64 = 0.03;

/// By so much stamps may be wrong, s: a serial line and a filter that tell no age.
const SKEW_S: f64 = 0.3;

/// Memory of the largest rate, s: as long as what it left in the sum takes to fade.
const BRISK_MEMORY_S: f64 = 20.0;

/// Memory of the roughness, s.
const ROUGH_MEMORY_S: f64 = 3.0;

/// A rate or angle is overdue when it is older than usual by this factor and a control period; share of a new
/// sample in what is usual, which begins at [`SILENT_S`].
const OVERDUE: f64 = 1.5;
const USUAL_SHARE: f64 = 0.1;

/// Beyond this age a position is silent, no rate is known, and a longer step compares nothing, s.
const SILENT_S: f64 = 2.0;

/// A position after a longer gap is a fix that corrects, s.
const GAP_S: f64 = 10.0;

/// For so long a leap is told, s.
const LEAP_TOLD_S: f64 = 10.0;

/// Who agrees stays within this share of the threshold, over a motion of so many.
const AGREES_WITHIN: f64 = 0.5;
const AGREES_OVER: f64 = 2.0;

/// The steepest pitch at which Euler angles are compared, rad.
const STEEPEST: f64 = 1.4;

/// Rounding of sums of periods, s.
const TICK_S: f64 = 1e-9;

/// The channels that are looked at: coordinates, angles, velocities and turn rates.
const LOOKED_AT: usize = 12;

/// What is remembered of the comparison.
#[derive(Clone, Debug)]
pub struct Contradiction<T> {
    /// The channels at their last samples, how old these are, and how old they usually become.
    last: [T; LOOKED_AT],
    age: [T; LOOKED_AT],
    usual: [T; LOOKED_AT],
    /// What the rates say since the last sample of a coordinate.
    since: Vec6<T>,
    /// 1 where a rate was not known at some time since then.
    blind: Vec6<T>,
    /// How far the rates are ahead of the coordinates, m and rad.
    apart: Vec6<T>,
    /// The last innovation, the variance of the noise that the innovations tell of, and the largest rate of late.
    innovation: Vec6<T>,
    variance: Vec6<T>,
    brisk: Vec6<T>,
    /// For how long they have contradicted each other, s.
    contrary: Vec6<T>,
    /// While they do: how far the rates have come, and how far apart, since they last disagreed.
    shift: Vec6<T>,
    astray: Vec6<T>,
    /// For how much longer a leap is told, s.
    leapt: Vec6<T>,
    rough: [T; 3],
}

crate::memory!(Contradiction:
    last, age, usual, since, blind, apart, innovation, variance, brisk, contrary, shift, astray, leapt, rough;);

impl<T: Real> Contradiction<T> {
    /// Nothing seen yet.
    pub fn new(unit: T) -> Self {
        let zeros = [unit.zero(); KINEMATIC];
        // The noise is the largest that is allowed for until it has been seen.
        let noisy: Vec6<f64> = std::array::from_fn(|k| Thresholds::default().of(k) * NOISIEST / DEVIATIONS);
        Self {
            last: [unit.zero(); LOOKED_AT],
            age: [unit.splat(f64::INFINITY); LOOKED_AT],
            usual: [unit.splat(SILENT_S); LOOKED_AT],
            since: zeros,
            blind: [unit.splat(1.0); KINEMATIC],
            apart: zeros,
            innovation: zeros,
            variance: std::array::from_fn(|k| unit.splat(noisy[k] * noisy[k])),
            brisk: zeros,
            contrary: zeros,
            shift: zeros,
            astray: zeros,
            leapt: zeros,
            rough: [unit.zero(); 3],
        }
    }

    /// Takes what is believed `dt` seconds after the last look, what `moved` by a leap, and for how long each channel has
    /// been `doubted`, s, negative where it is not: a rate that is doubted holds its last value, and is not known.
    #[inline(always)]
    pub fn see(
        &mut self,
        believed: &Measurement<T>,
        (moved, doubted): (&[T; CHANNELS], &[T; CHANNELS]),
        table: &Thresholds,
        dt: f64,
    ) {
        let zero = believed.battery.zero();
        let one = zero.splat(1.0);
        let before = (self.last, self.age);
        let fresh: [T::Mask; LOOKED_AT] = std::array::from_fn(|c| self.arrives(believed, c, dt));
        let goes_on = zero.splat(dt).lt(zero.splat(SILENT_S));
        let young = |c: usize| T::both(believed.age[c].lt(self.usual[c] * OVERDUE + dt), doubted[c].lt(zero));
        let three = |c: usize| T::both(young(c), T::both(young(c + 1), young(c + 2)));
        let upright = T::both(three(3), goes_on);
        let known = [T::both(three(VELOCITY), upright), T::both(three(RATES), upright)];
        let (rates, [u, v, _]) = (rates(believed), believed.velocity());
        let speed = u.mul_add(u, v * v).sqrt();
        let fading = BRISK_MEMORY_S / (BRISK_MEMORY_S + dt);
        for k in 0..KINEMATIC {
            let (value, age, rate) = (believed.channels[k], believed.age[k], rates[k]);
            self.blind[k] = T::select(known[k / 3], self.blind[k], one);
            self.since[k] += rate * dt;
            self.brisk[k] = T::select(known[k / 3], rate.abs(), zero).max(self.brisk[k] * fading);
            let change = value - before.0[k];
            let change = if k == 3 || k == 5 { change.wrap() } else { change };
            let foretold = self.since[k] - rate * age;
            let gap = if k > 1 { f64::INFINITY } else { GAP_S };
            let older = before.1[k] + dt;
            let compared = T::both(older.lt(zero.splat(gap)), self.blind[k].lt(zero.splat(0.5)));
            let counts = T::both(fresh[k], compared);
            // A leap that the rates foretold is a motion: a wave threw the vehicle about.
            let innovation = foretold - change;
            let leaps = T::both(zero.lt(moved[k].abs()), foretold.abs().lt(innovation.abs()));
            let innovation = if k > 1 { T::select(leaps, zero, innovation) } else { innovation };
            let innovation = T::select(counts, innovation, zero);
            self.since[k] = T::select(fresh[k], rate * age, self.since[k]);
            self.blind[k] = T::select(fresh[k], flag_not(known[k / 3], one), self.blind[k]);
            let (fixed, per_speed) = table.offset(k);
            let offset = speed.mul_add(zero.splat(per_speed * dt), zero.splat(fixed * dt));
            let bare = |sum: T| sum - sum.clamped(-offset, offset);
            let least = table.of(k);
            let noise = (self.variance[k].max(zero).sqrt() * DEVIATIONS).min(zero.splat(NOISIEST * least));
            let most = self.brisk[k].mul_add(zero.splat(SKEW_S), noise.max(zero.splat(least)));

            // While they contradict each other the sum keeps all it has, and another one tells whether they still do.
            let contrary = zero.lt(self.contrary[k]);
            let apart = self.apart[k] + innovation;
            let apart = T::select(contrary, apart, bare(apart));
            let astray = bare(self.astray[k] + innovation);
            let shift = self.shift[k] + T::select(counts, foretold, zero);
            let agrees = T::both(contrary, astray.abs().lt(most * AGREES_WITHIN));
            let over = T::both(agrees, (most * AGREES_OVER).lt(shift.abs()));
            // What is gone before it calls for anything was a glitch.
            let early = T::both(contrary, self.contrary[k].lt(zero.splat(table.after_s)));
            let over = T::either(over, T::both(early, apart.abs().lt(most * AGREES_WITHIN)));
            self.astray[k] = T::select(agrees, astray, zero);
            self.shift[k] = T::select(agrees, shift, zero);
            let goes_on = T::either(contrary, most.lt(apart.abs()));
            let lasting = T::select(goes_on, self.contrary[k] + dt, zero);
            self.contrary[k] = T::select(over, zero, lasting);
            self.apart[k] = T::select(over, zero, apart);

            let product = -(innovation * self.innovation[k]) - self.variance[k];
            self.variance[k] += T::select(counts, product * NOISE_SHARE, zero);
            self.innovation[k] = T::select(counts, innovation, self.innovation[k]);
            self.leapt[k] = T::select(leaps, zero.splat(LEAP_TOLD_S), (self.leapt[k] - dt).max(zero));
        }
        let rough = dt / (ROUGH_MEMORY_S + dt);
        for i in 0..3 {
            let c = VELOCITY + i;
            let (value, age, was) = (believed.channels[c], believed.age[c], before.0[c]);
            let first = T::both(age.lt(zero.splat(f64::INFINITY)), zero.lt(was.abs()));
            let change = T::select(first, (value - was).abs(), zero);
            self.rough[i] += (change - self.rough[i]) * rough;
        }
        self.remember(believed, &fresh, dt);
    }

    /// Where a channel has a sample that it had not at the last look.
    #[inline(always)]
    fn arrives(&self, believed: &Measurement<T>, c: usize, dt: f64) -> T::Mask {
        let other = believed.battery.zero().lt((believed.channels[c] - self.last[c]).abs());
        T::either(other, (believed.age[c] + TICK_S).lt(self.age[c] + dt))
    }

    /// Keeps the samples, their ages, and how old they usually become before the next.
    #[inline(always)]
    fn remember(&mut self, believed: &Measurement<T>, fresh: &[T::Mask; LOOKED_AT], dt: f64) {
        let longest = believed.battery.splat(SILENT_S);
        for c in 0..LOOKED_AT {
            let usual = self.usual[c];
            let older = (self.age[c] + dt).min(usual * 2.0).min(longest);
            self.usual[c] = T::select(fresh[c], usual + (older - usual) * USUAL_SHARE, usual);
            self.last[c] = T::select(fresh[c], believed.channels[c], self.last[c]);
            self.age[c] = believed.age[c];
        }
    }

    /// Forgets where `at` holds what contradicted: an operator has looked at it.
    #[inline(always)]
    pub fn forget(&mut self, at: T::Mask) {
        for k in 0..KINEMATIC {
            let zero = self.apart[k].zero();
            for x in [
                &mut self.apart[k],
                &mut self.contrary[k],
                &mut self.shift[k],
                &mut self.astray[k],
                &mut self.leapt[k],
            ] {
                *x = T::select(at, zero, *x);
            }
        }
    }

    /// 1 where a coordinate or angle and its rate contradict each other.
    #[inline(always)]
    pub fn contrary(&self, k: usize) -> T {
        let zero = self.apart[k].zero();
        T::select(zero.lt(self.contrary[k]), zero.splat(1.0), zero)
    }

    /// 1 while a contradiction, a leap that was believed, or a rough velocity is to be told of a channel.
    #[inline(always)]
    pub fn noticed(&self, c: usize, table: &Thresholds) -> T {
        let zero = self.apart[0].zero();
        match c {
            0..KINEMATIC => self.contrary(c).max(T::select(zero.lt(self.leapt[c]), zero.splat(1.0), zero)),
            VELOCITY..9 => {
                let rough = zero.splat(table.roughness_m_s).lt(self.rough[c - VELOCITY]);
                T::select(rough, zero.splat(1.0), zero)
            }
            _ => zero,
        }
    }

    /// Where nothing is to be told of any channel.
    #[inline(always)]
    pub fn agree(&self, table: &Thresholds) -> T::Mask {
        let zero = self.apart[0].zero();
        let any = (0..LOOKED_AT).fold(zero, |any, c| any.max(self.noticed(c, table)));
        any.lt(zero.splat(0.5))
    }

    /// Where the other sensors would have carried a coordinate, m, while they contradict it or it is silent; else the
    /// coordinate.
    #[inline(always)]
    pub fn other(&self, k: usize, value: T) -> T {
        let zero = value.zero();
        let silent = T::both(zero.splat(SILENT_S).lt(self.age[k]), self.blind[k].lt(zero.splat(0.5)));
        value + self.contrary(k) * self.apart[k] + T::select(silent, self.since[k], zero)
    }
}

/// 1 where a mask does not hold.
#[inline(always)]
fn flag_not<T: Real>(mask: T::Mask, one: T) -> T {
    T::select(mask, one.zero(), one)
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
