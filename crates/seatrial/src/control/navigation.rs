//! What the autopilot is told of the motion, and what the sensors of a simulated vehicle make of the truth.
//!
//! Sixteen channels in seven groups. Every channel has its own age; the sensors of a simulated vehicle sample a group
//! together, so that there it grows old together. Sensor errors: white noise per
//! sample, an offset drawn once per run, a random walk (the drift of dead reckoning), a sampling interval, a
//! latency in whole control periods, and drop-outs that begin at random. Each number that is drawn is a function of
//! seed, sample and channel alone ([`crate::number::random`]). At the start of a run every sensor shows a first sample: the
//! vehicle knows where it is launched.
//!
//! Tests: `tests/closed_loop.rs`.

use crate::model::current::Current;
use crate::model::integrate::State;
use crate::model::kinematics::{rotation, to_euler};
use crate::number::algebra::{Vec3, each, transposed_product};
use crate::number::random::{Noise, ONCE, Seed};
use crate::number::real::Real;

/// The number of channels.
pub const CHANNELS: usize = 16;

/// The channels: position N E D, m; roll, pitch, yaw, rad; velocity over ground in the body frame, m/s; rates, rad/s;
/// altitude above the bottom, m; velocity through the water in the body frame, m/s.
pub const CHANNEL_NAMES: [&str; CHANNELS] = [
    "x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r", "altitude", "u_water", "v_water",
    "w_water",
];

/// The number of groups.
pub const GROUPS: usize = 7;

/// The groups that are sampled together.
pub const GROUP_NAMES: [&str; GROUPS] =
    ["position", "depth", "attitude", "velocity", "rates", "altitude", "water"];

/// The group of each channel.
pub const GROUP: [usize; CHANNELS] = [0, 0, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 6, 6, 6];

/// What the autopilot is told at one step.
#[derive(Clone, Copy, Debug)]
pub struct Measurement<T> {
    /// The channels in the order of [`CHANNEL_NAMES`].
    pub channels: [T; CHANNELS],
    /// Seconds since each channel was last true; infinite before its first sample.
    pub age: [T; CHANNELS],
    /// Share of the battery that is left.
    pub battery: T,
    /// Supply voltage, V; not a number where it is not known.
    pub voltage: f64,
}

crate::memory!(Measurement: channels, age, battery; voltage);

impl<T: Real> Measurement<T> {
    /// Nothing known yet.
    pub fn nothing(unit: T) -> Self {
        let mut channels = [unit.zero(); CHANNELS];
        channels[ALTITUDE] = unit.splat(f64::INFINITY);
        Self {
            channels,
            age: [unit.splat(f64::INFINITY); CHANNELS],
            battery: unit.splat(1.0),
            voltage: f64::NAN,
        }
    }

    /// Position N E D, m.
    #[inline(always)]
    pub fn position(&self) -> Vec3<T> {
        self.three(0)
    }

    /// Roll, pitch and yaw, rad.
    #[inline(always)]
    pub fn attitude(&self) -> Vec3<T> {
        self.three(3)
    }

    /// Velocity over ground, body frame, m/s.
    #[inline(always)]
    pub fn velocity(&self) -> Vec3<T> {
        self.three(6)
    }

    /// Altitude above the bottom, m; infinite without a fresh one: what was measured does not rule what follows.
    #[inline(always)]
    pub fn altitude(&self) -> T {
        let age = self.age[ALTITUDE];
        let fresh = age.lt(age.splat(ALTITUDE_IS_OLD_S));
        T::select(fresh, self.channels[ALTITUDE], age.splat(f64::INFINITY))
    }

    /// p, q, r, rad/s.
    #[inline(always)]
    pub fn rates(&self) -> Vec3<T> {
        self.three(9)
    }

    /// Velocity through the water, body frame, m/s; over ground in the components that no sensor tells.
    #[inline(always)]
    pub fn water(&self) -> Vec3<T> {
        let mut velocity = self.velocity();
        for (i, component) in velocity.iter_mut().enumerate() {
            let (age, water) = (self.age[WATER + i], self.channels[WATER + i]);
            *component = T::select(age.lt(age.splat(WATER_IS_OLD_S)), water, *component);
        }
        velocity
    }

    #[inline(always)]
    fn three(&self, first: usize) -> Vec3<T> {
        [self.channels[first], self.channels[first + 1], self.channels[first + 2]]
    }
}

/// The channel of the depth.
pub const DEPTH: usize = 2;

/// The channel of the yaw.
pub const YAW: usize = 5;

/// The first channel of the velocity over ground.
pub const VELOCITY: usize = 6;

/// The first channel of the turn rates.
pub const RATES: usize = 9;

/// The channel of the altitude; those before it are always finite.
pub const ALTITUDE: usize = 12;

/// The first channel of the velocity through the water.
pub const WATER: usize = 13;

/// The first channel of each group.
const FIRST: [usize; GROUPS] = [0, DEPTH, 3, VELOCITY, RATES, ALTITUDE, WATER];

/// Beyond this age an altitude is none, s: at a metre per second the bottom is elsewhere.
const ALTITUDE_IS_OLD_S: f64 = 2.0;

/// Beyond this age the velocity through the water is taken for the one over ground, s.
const WATER_IS_OLD_S: f64 = 5.0;

/// The errors of one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChannelErrors {
    /// Standard deviation of a sample's noise.
    pub noise: f64,
    /// Standard deviation of the offset of a run.
    pub bias: f64,
    /// Standard deviation of the random walk after one second, per √s.
    pub drift: f64,
    /// Step of its digits; 0 for none.
    pub quantum: f64,
}

/// When a group is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroupTiming {
    /// Whether the vehicle has such a sensor.
    pub present: bool,
    /// Control periods from sample to sample, at least 1.
    pub every: usize,
    /// Age of a sample when it arrives, in control periods.
    pub latency: usize,
    /// Mean time from drop-out to drop-out, s; infinite for none.
    pub dropout_every: f64,
    /// Mean duration of a drop-out, s.
    pub dropout: f64,
}

impl Default for GroupTiming {
    fn default() -> Self {
        Self { present: true, every: 1, latency: 0, dropout_every: f64::INFINITY, dropout: 0.0 }
    }
}

/// A time without samples of a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outage {
    /// Index of the group.
    pub group: usize,
    /// From this time on, s.
    pub from: f64,
    /// Until this time, s.
    pub until: f64,
}

/// A time without samples of one group in one case, s: from, until.
pub type GroupOutage<T> = (usize, [T; 2]);

/// The sensors of a simulated vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensors {
    /// Errors per channel.
    pub errors: [ChannelErrors; CHANNELS],
    /// Timing per group.
    pub timing: [GroupTiming; GROUPS],
    /// Times without samples.
    pub outages: Vec<Outage>,
}

impl Sensors {
    /// Sensors of rows of numbers: noise, bias, drift and quantum per channel; present, every, latency, drop-outs
    /// every s, for s, per group.
    pub fn of_rows(errors: [[f64; 4]; CHANNELS], timing: [[f64; 5]; GROUPS], outages: Vec<Outage>) -> Self {
        let of = |[noise, bias, drift, quantum]: [f64; 4]| ChannelErrors { noise, bias, drift, quantum };
        let when = |[present, every, latency, dropout_every, dropout]: [f64; 5]| GroupTiming {
            present: present > 0.5,
            every: every.max(1.0) as usize,
            latency: latency.max(0.0) as usize,
            dropout_every,
            dropout,
        };
        Self { errors: errors.map(of), timing: timing.map(when), outages }
    }

    /// The longest latency, in control periods.
    fn longest(&self) -> usize {
        self.timing.iter().map(|t| t.latency).max().unwrap_or(0)
    }
}

/// The bottom: depth below the origin, m, and its slopes north and east.
pub type Seabed = [f64; 3];

/// The sensors at work.
#[derive(Clone)]
pub struct Navigation<'a, T: Real> {
    sensors: &'a Sensors,
    outages: &'a [GroupOutage<T>],
    zero: T,
    seed: Seed<T>,
    noise: Noise<T, CHANNELS>,
    steps: Noise<T, CHANNELS>,
    bias: [T; CHANNELS],
    walk: [T; CHANNELS],
    /// Samples of each group so far.
    count: [usize; GROUPS],
    silent: [T; GROUPS],
    past: Vec<[T; CHANNELS]>,
    measurement: Measurement<T>,
}

impl<'a, T: Real> Navigation<'a, T> {
    /// The sensors before their first sample; `seed` is a whole number below 2⁵³ per lane, `outages` are the case's
    /// own besides those of all.
    #[inline(always)]
    pub fn new(sensors: &'a Sensors, seed: T, outages: &'a [GroupOutage<T>]) -> Self {
        let (zero, drawn) = (seed.zero(), Seed::new(seed));
        Self {
            sensors,
            outages,
            zero,
            seed: drawn,
            noise: Noise::new(seed, 0),
            steps: Noise::new(seed, CHANNELS),
            bias: std::array::from_fn(|c| match sensors.errors[c].bias {
                size if size > 0.0 => drawn.gaussians(ONCE, c).0 * size,
                _ => zero,
            }),
            walk: [zero; CHANNELS],
            count: [0; GROUPS],
            silent: [zero; GROUPS],
            past: vec![[zero; CHANNELS]; (sensors.longest() + 1).next_power_of_two()],
            measurement: Measurement::nothing(seed),
        }
    }

    /// The sensors with given offsets in place of drawn ones, in standard deviations of each channel's.
    #[inline(always)]
    pub fn with_offsets(mut self, deviations: Option<&[T; CHANNELS]>) -> Self {
        if let Some(deviations) = deviations {
            self.bias = std::array::from_fn(|c| deviations[c] * self.sensors.errors[c].bias);
        }
        self
    }

    /// What the sensors show at control step `k` of `dt` seconds.
    #[inline(always)]
    pub fn sample(&mut self, truth: [T; CHANNELS], (k, dt): (usize, f64)) -> &mut Measurement<T> {
        let (sensors, zero) = (self.sensors, self.zero);
        let mask = self.past.len() - 1;
        self.past[k & mask] = truth;
        let mut fresh = [false; GROUPS];
        let mut heard = [zero.lt(zero); GROUPS];
        for (g, timing) in sensors.timing.iter().enumerate() {
            let time = k as f64 * dt;
            let due = k >= timing.latency && (k - timing.latency) % timing.every == 0;
            fresh[g] = timing.present && (due || k == 0);
            let older = self.measurement.age[FIRST[g]] + dt;
            let mut age = older;
            if timing.dropout_every.is_finite() {
                let (chance, length) = self.seed.two_uniforms(k, 2 * CHANNELS + g);
                let begins = chance.lt(zero.splat(dt / timing.dropout_every));
                let left = (self.silent[g] - dt).max(zero);
                self.silent[g] = left;
                if T::any(begins) {
                    let lasting = left.max(length.ln() * -timing.dropout);
                    self.silent[g] = T::select(begins, lasting, left);
                }
            }
            let mut silent = self.silent[g];
            let of_all = sensors.outages.iter().filter(|o| o.group == g);
            let of_all = of_all.map(|o| [zero.splat(o.from), zero.splat(o.until)]);
            let own = self.outages.iter().filter(|(group, _)| *group == g).map(|(_, times)| *times);
            for [from, until] in of_all.chain(own) {
                let begun = from.lt(zero.splat(time + 1e-9));
                let over = until.lt(zero.splat(time + 1e-9));
                let rest = T::select(over, zero, zero.splat(dt));
                silent = silent.max(T::select(begun, rest, zero));
            }
            if k == 0 {
                // The place of the launch is known, whatever goes silent there.
                silent = zero;
            }
            heard[g] = silent.lt(zero.splat(0.5 * dt));
            if fresh[g] {
                let new = zero.splat(timing.latency.min(k) as f64 * dt);
                age = T::select(heard[g], new, older);
            }
            for c in (FIRST[g]..CHANNELS).take_while(|&c| GROUP[c] == g) {
                self.measurement.age[c] = age;
            }
        }
        for c in 0..CHANNELS {
            let (errors, g) = (&sensors.errors[c], GROUP[c]);
            if !fresh[g] {
                continue;
            }
            let timing = &sensors.timing[g];
            let mut shown = self.past[(k - timing.latency.min(k)) & mask][c];
            let sample = self.count[g];
            if errors.drift > 0.0 {
                let step = errors.drift * (timing.every as f64 * dt).sqrt();
                self.walk[c] += self.steps.next(c, sample) * step;
                shown += self.walk[c];
            }
            if errors.bias > 0.0 {
                shown += self.bias[c];
            }
            if errors.noise > 0.0 {
                shown += self.noise.next(c, sample) * errors.noise;
            }
            if errors.quantum > 0.0 {
                shown = (shown * (1.0 / errors.quantum) + 0.5).floor() * errors.quantum;
            }
            if (3..6).contains(&c) {
                shown = shown.wrap();
            }
            self.measurement.channels[c] = T::select(heard[g], shown, self.measurement.channels[c]);
        }
        for g in 0..GROUPS {
            self.count[g] += usize::from(fresh[g]);
        }
        &mut self.measurement
    }
}

/// The true channels of a state over a seabed in a current.
#[inline(always)]
pub fn truth<T: Real>(
    state: &State<T>,
    current: Option<&Current<T>>,
    seabed: Option<&Seabed>,
) -> [T; CHANNELS] {
    let [x, y, z] = state.position;
    let [roll, pitch, yaw] = to_euler(&state.attitude);
    let [u, v, w, p, q, r] = state.nu;
    let mut water = [u, v, w];
    if let Some(current) = current {
        let drift = transposed_product(&rotation(&state.attitude), &current.velocity);
        for i in 0..3 {
            water[i] -= drift[i];
        }
    }
    let altitude = match seabed {
        None => x.splat(f64::INFINITY),
        Some([depth, north, east]) => x.splat(*depth) + x * *north + y * *east - z,
    };
    let [u_w, v_w, w_w] = each(&water, |x| x);
    [x, y, z, roll, pitch, yaw, u, v, w, p, q, r, altitude, u_w, v_w, w_w]
}
