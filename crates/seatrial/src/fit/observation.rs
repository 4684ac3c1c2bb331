//! What the instruments of a trial show of a motion, and what a trial adds to its record: the nuisance
//! parameters, without which the coefficients absorb a current, a tilted frame or a late sensor.
//!
//! * `current_…`: a steady current besides the recorded one, NED, m/s.
//! * `tilt_north`, `tilt_east`: small turns of the recording's earth frame about its own north and east axis,
//!   rad: a motion-capture frame that was not levelled. `R_recorded = R_tilt R`, positions likewise.
//! * `lever_…`: place of the velocity sensor, `v_S = v_O + ω × r_S`, m.
//! * `latency_<channel>`: the channel shows the state that many seconds ago.
//! * `bias_<channel>`: added to the channel, in its unit (m/s, rad/s, m, rad).
//! * `force_X` … `force_N`: a constant wrench in the body frame, N and N m: a tether that pulls, a trim weight that was
//!   moved between trials, a bent fin; beside the bias `X_0` … `N_0` that the vehicle has in all of them.
//!
//! Source: Fossen (2011), sections 2.2 and 8.3; Tischler & Remple, *Aircraft and Rotorcraft System
//! Identification* (2012), chapter 8 (instrument errors as parameters).
//! Tests: `tests/scalars/nuisances.rs` (each against its definition), `tests/core/test_sensitivities.py`.

use crate::description::coefficients::FORCES;
use crate::fit::criterion::{CHANNEL_NAMES, CHANNELS, ROLL};
use crate::fit::record::{Segment, Start};
use crate::model::integrate::State;
use crate::model::kinematics::{
    Quaternion, euler_angle, from_euler, normalised, quaternion_product, rotation, to_euler,
};
use crate::number::algebra::{Vec3, Vec6, cross, product, transposed_product};
use crate::number::dual::Valued;
use crate::number::real::Real;

/// The number of nuisance parameters of a trial.
pub const NUISANCES: usize = 14 + 2 * CHANNELS;

/// Index of `force_X` among them; five more follow.
pub const FORCE: usize = 8 + 2 * CHANNELS;

/// The number of initial conditions of a segment: position (m), attitude (rad about the body axes) and
/// velocity (m/s, rad/s), each added to the segment's own state.
pub const INITIALS: usize = 12;

/// The names of the initial conditions.
pub const INITIAL_NAMES: [&str; INITIALS] = [
    "initial_x",
    "initial_y",
    "initial_z",
    "initial_roll",
    "initial_pitch",
    "initial_yaw",
    "initial_u",
    "initial_v",
    "initial_w",
    "initial_p",
    "initial_q",
    "initial_r",
];

/// The names of the nuisance parameters, in their order.
pub fn nuisance_names() -> Vec<String> {
    let fixed = [
        "current_north",
        "current_east",
        "current_down",
        "tilt_north",
        "tilt_east",
        "lever_x",
        "lever_y",
        "lever_z",
    ];
    let per_channel =
        ["latency", "bias"].into_iter().flat_map(|kind| CHANNEL_NAMES.map(|c| format!("{kind}_{c}")));
    let forces = FORCES.map(|axis| format!("force_{axis}"));
    fixed.into_iter().map(str::to_owned).chain(per_channel).chain(forces).collect()
}

/// The nuisance parameters of one trial.
#[derive(Clone, Debug)]
pub struct Nuisance<T> {
    /// Current besides the recorded one, NED, m/s.
    pub current: Vec3<T>,
    /// Rotation from the true earth frame to the recording's.
    pub tilt: Quaternion<T>,
    /// Place of the velocity sensor, m.
    pub lever: Vec3<T>,
    /// Delay per channel, s.
    pub latency: [T; CHANNELS],
    /// Offset per channel.
    pub bias: [T; CHANNELS],
    /// Constant wrench in the body frame, N and N m.
    pub force: Vec6<T>,
}

impl<T: Real> Nuisance<T> {
    /// From the numbers in the order of [`nuisance_names`].
    #[inline(always)]
    pub fn from_row(row: &[T; NUISANCES]) -> Self {
        let zero = row[0].zero();
        let half = |x: T| x * 0.5;
        Self {
            current: [row[0], row[1], row[2]],
            tilt: normalised(&[zero.splat(1.0), half(row[3]), half(row[4]), zero]),
            lever: [row[5], row[6], row[7]],
            latency: std::array::from_fn(|c| row[8 + c]),
            bias: std::array::from_fn(|c| row[8 + CHANNELS + c]),
            force: std::array::from_fn(|i| row[FORCE + i]),
        }
    }

    /// The true state behind a segment's recorded one, moved by the initial conditions, and the current.
    #[inline(always)]
    pub fn start(&self, segment: &Segment, initial: &[T; INITIALS]) -> Start<T> {
        let (zero, recorded) = (initial[0].zero(), &segment.state);
        let bias = &self.bias;
        // The recorded attitude turned from its Euler angles to those without bias: at a pitch of ±90° the
        // angles alone would not give it back.
        let euler = to_euler(&recorded.attitude);
        let [w, x, y, z] = from_euler(&euler);
        let back = quaternion_product(&recorded.attitude, &[w, -x, -y, -z]);
        let unbiased: Quaternion<T> = from_euler(&std::array::from_fn(|i| -bias[9 + i] + euler[i]));
        let shown = quaternion_product(&back.map(|c| zero.splat(c)), &unbiased);
        let [w, x, y, z] = self.tilt;
        let level = quaternion_product(&[w, -x, -y, -z], &shown);
        let turn = [zero.splat(1.0), initial[3] * 0.5, initial[4] * 0.5, initial[5] * 0.5];
        let attitude = normalised(&quaternion_product(&level, &normalised(&turn)));
        let place: Vec3<T> = std::array::from_fn(|i| -bias[6 + i] + recorded.position[i]);
        let place = transposed_product(&rotation(&self.tilt), &place);
        let mut nu: [T; 6] = std::array::from_fn(|i| -bias[i] + recorded.nu[i]);
        let swept = cross(&[nu[3], nu[4], nu[5]], &self.lever);
        for i in 0..3 {
            nu[i] -= swept[i];
        }
        for i in 0..6 {
            nu[i] += initial[6 + i];
        }
        let position = std::array::from_fn(|i| place[i] + initial[i]);
        let current = std::array::from_fn(|i| self.current[i] + segment.current[i]);
        Start { state: State { position, attitude, nu }, current: Some(current) }
    }

    /// What the channels would show without latency and bias.
    #[inline(always)]
    fn prompt(&self, state: &State<T>) -> State<T> {
        let omega = [state.nu[3], state.nu[4], state.nu[5]];
        let swept = cross(&omega, &self.lever);
        let mut nu = state.nu;
        for i in 0..3 {
            nu[i] += swept[i];
        }
        let position = product(&rotation(&self.tilt), &state.position);
        State { position, attitude: quaternion_product(&self.tilt, &state.attitude), nu }
    }
}

/// What some channels show of a flight, kept sample by sample.
pub struct Shown<'a, T> {
    /// Between motion and channels; nothing when absent.
    nuisance: Option<&'a Nuisance<T>>,
    /// Whether it is more than offsets and delays: where it is not, the motion itself is shown.
    turned: bool,
    asked: &'a [usize],
    angles: bool,
    /// `[sample][channel among those asked for]`.
    rows: Vec<T>,
}

impl<'a, T: Real> Shown<'a, T> {
    /// Nothing yet, of the channels `asked`, for so many samples.
    #[inline(always)]
    pub fn new(nuisance: Option<&'a Nuisance<T>>, asked: &'a [usize], samples: usize) -> Self {
        let angles = asked.iter().any(|&c| c >= ROLL);
        let turned = nuisance.is_some_and(|one| {
            let [_, x, y, z] = one.tilt;
            [x, y, z].iter().chain(&one.lever).any(|part| !part.equals(part.zero()))
        });
        Self { nuisance, turned, asked, angles, rows: Vec::with_capacity(samples * asked.len()) }
    }

    /// The next sample.
    #[inline(always)]
    pub fn add(&mut self, state: &State<T>) {
        let state = match self.nuisance {
            Some(nuisance) if self.turned => nuisance.prompt(state),
            _ => *state,
        };
        let turn = self.angles.then(|| rotation(&state.attitude));
        for &c in self.asked {
            self.rows.push(match c {
                0..6 => state.nu[c],
                6..ROLL => state.position[c - 6],
                _ => turn.as_ref().map_or(state.nu[0], |turn| euler_angle(turn, c - ROLL)),
            });
        }
    }

    /// `[sample][channel among those asked for]`, samples `dt` seconds apart.
    #[inline(always)]
    pub fn finish(mut self, dt: f64) -> Vec<T>
    where
        T: Valued,
    {
        let Some(nuisance) = self.nuisance else { return self.rows };
        if self.asked.iter().all(|&c| nuisance.latency[c].equals(nuisance.latency[c].zero())) {
            for row in self.rows.chunks_exact_mut(self.asked.len().max(1)) {
                for (shown, &c) in row.iter_mut().zip(self.asked) {
                    *shown += nuisance.bias[c];
                }
            }
            return self.rows;
        }
        let (prompt, width) = (&self.rows, self.asked.len());
        let samples = prompt.len() / width.max(1);
        let mut rows = Vec::with_capacity(prompt.len());
        for k in 0..samples {
            for (i, &c) in self.asked.iter().enumerate() {
                let latency = nuisance.latency[c];
                let mut shown = prompt[k * width + i];
                if !latency.equals(latency.zero()) && samples > 1 {
                    // Linear between samples, and beyond the first and the last; from the nearest sample, so
                    // that no latency leaves it as it is to the last bit.
                    let at = latency.splat(k as f64) - latency * (1.0 / dt);
                    let j = at.value().floor().clamp(0.0, (samples - 2) as f64);
                    let near = at.value().round().clamp(j, j + 1.0);
                    let sample = |j: f64| prompt[j as usize * width + i];
                    let rise = sample(j + 1.0) - sample(j);
                    let rise = if c < ROLL { rise } else { rise.wrap() };
                    shown = (at - near).mul_add(rise, sample(near));
                }
                rows.push(shown + nuisance.bias[c]);
            }
        }
        rows
    }
}
