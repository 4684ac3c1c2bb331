//! Waves: the orbital motion of the water at the vehicle, from a JONSWAP spectrum in deep water.
//!
//! The sea is a sum of [`COMPONENTS`] harmonics with random phases (linear theory, long-crested or spread about a mean
//! direction). Component i of amplitude a, frequency ω and direction β moves the water at the place (x, y, z) by
//!
//! ```text
//! θ = ω t − k (x cos β + y sin β) + ε,   k = ω²/g,   ζ = a cos θ (up)
//! along β:  a ω e^(−kz) cos θ            down:  a ω e^(−kz) sin θ
//! ```
//!
//! and accelerates it at a fixed place by the derivative of these in t. The place is the vehicle's, so that it meets the
//! waves at the frequency of encounter, and a dive damps the short ones first. Nothing has a state: the motion is a
//! function of seed, place and time. A sum of harmonics serves here better than a shaping filter, whose one second-order
//! section per axis knows neither the decay of each frequency with depth nor the encounter.
//!
//! ```text
//! S(ω) ∝ ω⁻⁵ exp(−5/4 (ω_p/ω)⁴) γ^exp(−(ω/ω_p − 1)²/(2 s²)),   s = 0.07 below ω_p and 0.09 above,   ∫ S dω = (H_s/4)²
//! ```
//!
//! γ = 1 is Pierson and Moskowitz's. The spectrum from ω_p/2 to 3 ω_p is cut into strata of equal ∫ √S dω, narrow at the
//! peak and not wide at the ends, where a deep vehicle feels most. A component carries the energy of its stratum, at a
//! frequency drawn in it from S: every seed has exactly the significant height, and over seeds the spectrum at any depth is
//! the theory's. Frequencies are no multiples of each other: the sea does not repeat itself.
//!
//! Limits: first order; water deeper than half a wave length; a vehicle that is short beside the waves (no gradient
//! along the hull); no surface effects. Above the mean surface the water moves as at it.
//!
//! Source: Fossen (2021), sections 10.2.1–10.2.5; DNV-RP-C205 (2010), sections 3.3.2 (Airy waves) and 3.5.5 (JONSWAP);
//! acceleration at a fixed place for a body small beside the waves: Auton, Hunt and Prud'homme (1988).
//! Tests: `tests/closed_loop/waves.rs`, `tests/flight/test_waves.py` (against plain NumPy).

use crate::filter::swell::Swell;
use crate::model::current::Current;
use crate::number::algebra::Vec3;
use crate::number::plain;
use crate::number::random::{ONCE, gaussian, uniform};
use crate::number::real::Real;
use std::f64::consts::TAU;

/// Harmonics of a sea.
pub const COMPONENTS: usize = 20;

/// The places of the random numbers, beyond those of turbulence and drift; each kind takes [`COMPONENTS`] of them.
const PLACE: usize = 128;

/// Ends of the spectrum, in peak frequencies.
const ENDS: [f64; 2] = [0.5, 3.0];

/// Steps of the sums over it.
const STEPS: usize = 500;

/// The state of the sea.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sea {
    /// Significant height H_s, m; 0 for none.
    pub height: f64,
    /// Peak period, s.
    pub period: f64,
    /// Where the waves go, from north over east, rad.
    pub toward: f64,
    /// Standard deviation of the directions of the components about it, rad.
    pub spreading: f64,
    /// γ of the JONSWAP spectrum, 1 to 7.
    pub peakedness: f64,
}

impl Sea {
    /// No waves.
    pub const CALM: Self = Self { height: 0.0, period: 8.0, toward: 0.0, spreading: 0.0, peakedness: 3.3 };

    /// Of its five numbers, in the order of the fields.
    pub fn of_row([height, period, toward, spreading, peakedness]: [f64; 5]) -> Self {
        Self { height, period, toward, spreading, peakedness }
    }

    /// The same sea as a navigation filter is told of it, at gravity `g`; none for a calm one.
    pub fn swell(&self, g: f64) -> Option<Swell> {
        let omega_p = TAU / self.period;
        let component = |stratum: &Stratum| {
            let omega = omega_p * stratum.frequency(0.5);
            [omega, omega * omega / g, stratum.energy * self.height * self.height / 16.0]
        };
        let (sine, cosine) = plain::sin_cos(self.toward);
        (self.height > 0.0).then(|| Swell {
            components: strata(self.peakedness).iter().map(component).collect(),
            toward: [cosine, sine],
            spreading: self.spreading,
        })
    }

    /// The harmonics of this sea for a seed, in deep water at gravity `g`; none for a calm one.
    pub fn harmonics(&self, seed: f64, g: f64) -> Vec<Harmonic<f64>> {
        if self.height == 0.0 {
            return Vec::new();
        }
        let omega_p = TAU / self.period;
        let strata = strata(self.peakedness);
        let drawn = |kind: usize, i: usize| uniform(seed, ONCE, PLACE + kind * COMPONENTS + i);
        (0..COMPONENTS)
            .map(|i| {
                let (energy, omega) = (strata[i].energy, omega_p * strata[i].frequency(drawn(0, i)));
                let turn = gaussian(seed, ONCE, PLACE + 2 * COMPONENTS + i) * self.spreading;
                let (sin, cos) = plain::sin_cos(self.toward + turn);
                Harmonic {
                    omega,
                    number: omega * omega / g,
                    direction: [cos, sin],
                    phase: TAU * drawn(1, i),
                    speed: omega * self.height * (0.125 * energy).sqrt(),
                }
            })
            .collect()
    }
}

/// One harmonic of the sea.
#[derive(Clone, Copy, Debug)]
pub struct Harmonic<T> {
    /// Frequency, rad/s.
    pub omega: T,
    /// Wave number, rad/m.
    pub number: T,
    /// Cosine and sine of where it goes.
    pub direction: [T; 2],
    /// Phase at the origin at the beginning, rad.
    pub phase: T,
    /// Amplitude of the water's velocity at the surface, m/s.
    pub speed: T,
}

impl Harmonic<f64> {
    /// Without any motion: fills the lanes of calm cases.
    pub const STILL: Self = Self { omega: 1.0, number: 0.1, direction: [1.0, 0.0], phase: 0.0, speed: 0.0 };
}

/// A part of the spectrum.
struct Stratum {
    /// Share of the variance.
    energy: f64,
    /// Frequencies over that of the peak, and the share of the stratum's energy below each.
    below: Vec<(f64, f64)>,
}

impl Stratum {
    /// The frequency, in peak frequencies, below which a share of the energy lies.
    fn frequency(&self, share: f64) -> f64 {
        let after = self.below.partition_point(|&(_, below)| below < share).clamp(1, self.below.len() - 1);
        let ((x, from), (x_2, to)) = (self.below[after - 1], self.below[after]);
        x + (x_2 - x) * ((share - from) / (to - from)).clamp(0.0, 1.0)
    }
}

/// The JONSWAP spectrum over x = ω/ω_p, of any size.
pub fn jonswap(x: f64, peakedness: f64) -> f64 {
    let width = if x <= 1.0 { 0.07 } else { 0.09 };
    let peak = plain::exp(-0.5 * plain::powi((x - 1.0) / width, 2));
    plain::powi(x, -5) * plain::exp(-1.25 * plain::powi(x, -4)) * plain::powf(peakedness, peak)
}

/// The strata of the spectrum, of equal ∫ √S.
fn strata(peakedness: f64) -> Vec<Stratum> {
    let [first, last] = ENDS;
    let step = (last - first) / STEPS as f64;
    let middle = |i: usize| first + (i as f64 + 0.5) * step;
    let energies: Vec<f64> = (0..STEPS).map(|i| jonswap(middle(i), peakedness)).collect();
    let (sum, roots): (f64, f64) = (energies.iter().sum(), energies.iter().map(|e| e.sqrt()).sum());
    let mut strata: Vec<Stratum> = Vec::with_capacity(COMPONENTS);
    let (mut root, mut begins) = (0.0, 0);
    for i in 0..STEPS {
        root += energies[i].sqrt();
        if root < (strata.len() + 1) as f64 / COMPONENTS as f64 * roots && i + 1 < STEPS {
            continue;
        }
        // The cell that passes the mark ends the stratum.
        let energy: f64 = energies[begins..=i].iter().sum();
        let mut share = 0.0;
        let mut below = vec![(first + begins as f64 * step, 0.0)];
        for (cell, cell_energy) in energies.iter().enumerate().take(i + 1).skip(begins) {
            share += cell_energy / energy;
            below.push((first + (cell + 1) as f64 * step, share));
        }
        strata.push(Stratum { energy: energy / sum, below });
        begins = i + 1;
    }
    strata
}

/// The waves about a vehicle under way.
pub struct Waves<'a, T> {
    harmonics: &'a [Harmonic<T>],
    now: Current<T>,
    next: Current<T>,
    dt: f64,
}

impl<'a, T: Real> Waves<'a, T> {
    /// The sea of these harmonics; control periods last `dt` seconds.
    #[inline(always)]
    pub fn new(harmonics: &'a [Harmonic<T>], zero: T, dt: f64) -> Self {
        let still = Current { velocity: [zero; 3], rate: [zero; 3], pressed: Some([zero; 3]) };
        Self { harmonics, now: still, next: still, dt }
    }

    /// Begins control period `k`, which follows the last one, at a place (NED, m) with a velocity over ground (NED, m/s).
    ///
    /// The sea is looked up once per period, for its end, where the vehicle will be but for centimetres.
    #[inline(always)]
    pub fn begin(&mut self, k: usize, place: &Vec3<T>, velocity: &Vec3<T>) {
        if self.harmonics.is_empty() {
            return;
        }
        self.now = if k == 0 { orbital(self.harmonics, place, 0.0) } else { self.next };
        let mut then = *place;
        for axis in 0..3 {
            then[axis] += velocity[axis] * self.dt;
        }
        self.next = orbital(self.harmonics, &then, (k + 1) as f64 * self.dt);
    }

    /// Adds the motion `time` seconds into the period, straight between its ends.
    #[inline(always)]
    pub fn add(&self, time: f64, current: &mut Current<T>) {
        if self.harmonics.is_empty() {
            return;
        }
        let share = time / self.dt;
        let between = |from: T, to: T| (to - from) * share + from;
        let mut rate = current.rate;
        for axis in 0..3 {
            rate[axis] = between(self.now.rate[axis], self.next.rate[axis]);
            current.velocity[axis] += between(self.now.velocity[axis], self.next.velocity[axis]);
            current.rate[axis] += rate[axis];
        }
        current.pressed = Some(rate);
    }

    /// Whether there are any.
    pub fn any(&self) -> bool {
        !self.harmonics.is_empty()
    }
}

/// Velocity and acceleration of the water at a place (NED, m) and a time (s).
#[inline(always)]
pub fn orbital<T: Real>(harmonics: &[Harmonic<T>], place: &Vec3<T>, time: f64) -> Current<T> {
    let zero = place[0].zero();
    let [mut velocity, mut rate] = [[zero; 3]; 2];
    let depth = place[2].max(zero);
    for wave in harmonics {
        let [cos, sin] = wave.direction;
        let along = place[0].mul_add(cos, place[1] * sin);
        // Wrapped: sine and cosine hold for angles of any day of a mission.
        let angle = wave.number.neg_mul_add(along, wave.omega * time + wave.phase).wrap();
        let (down, ahead) = angle.sin_cos();
        let speed = wave.speed * (-(wave.number * depth)).exp();
        let (down, ahead) = (speed * down, speed * ahead);
        velocity[0] = ahead.mul_add(cos, velocity[0]);
        velocity[1] = ahead.mul_add(sin, velocity[1]);
        velocity[2] += down;
        let slower = -(down * wave.omega);
        rate[0] = slower.mul_add(cos, rate[0]);
        rate[1] = slower.mul_add(sin, rate[1]);
        rate[2] = ahead.mul_add(wave.omega, rate[2]);
    }
    Current { velocity, rate, pressed: Some(rate) }
}
