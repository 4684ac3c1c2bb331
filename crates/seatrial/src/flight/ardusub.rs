//! A vehicle under ArduSub's cascade along targets over time: a log's own mission flown again, or one that is made.
//!
//! ```text
//! targets -> cascade -> mixer -> pulses -> motors -> equation of motion -> what the cascade is told
//! ```
//!
//! Once per control period, which is ArduSub's own loop. What the model does not know acts as a wrench in the body
//! frame, one Ornstein–Uhlenbeck process per axis; a tether pulls at a point of the hull with a constant force, NED; the
//! supply sags from its beginning on, with time and with load, and thrust with it.
//!
//! Cases side by side fly in lanes, as in [`super::batch`]. Source of the process: Gillespie (1996), *Exact numerical
//! simulation of the Ornstein-Uhlenbeck process*. Tests: `tests/ardusub.rs`, `tests/ardusub/test_reflight.py`.

use super::Motors;
use super::faults::Faults;
use crate::actuator::motor::Limits;
use crate::control::ardusub::cascade::{Cascade, INTEGRALS, Memory, Told, Wanted};
use crate::control::ardusub::mixer::{MOTORS, Mixer, NEUTRAL};
use crate::control::ardusub::parameters::defaults;
use crate::description::Description;
use crate::description::assembly::Structure;
use crate::error::Error;
use crate::model::current::Current;
use crate::model::drive::act;
use crate::model::integrate::{State, step};
use crate::model::kinematics::{rotation, to_euler};
use crate::model::vehicle::{Instant, Mode, Vehicle};
use crate::number::algebra::{Vec3, Vec6, cross, product, transposed_product};
use crate::number::lanes::{LANES, Lanes, level};
use crate::number::plain;
use crate::number::random::Noise;
use crate::number::real::Real;
use fearless_simd::{Level, Simd, SimdBase, f64x8};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Columns of a row of what is kept: place (m, NED), roll, pitch and yaw (rad), velocity (body), six demands and the two loads.
pub const COLUMNS: usize = 20;

/// Control periods between two draws of the wrench that the model does not know.
const EVERY: usize = 5;

/// Places of the random numbers.
const PLACE: usize = 160;

/// What all cases share.
pub struct Course<'a> {
    /// The vehicle.
    pub description: &'a Description,
    /// Its motors, in the order of its thrusters.
    pub mixer: &'a Mixer,
    /// A row of targets per control period.
    pub wanted: &'a [Wanted],
    /// Control period, s.
    pub period: f64,
    /// A row is kept every so many periods.
    pub every: usize,
    /// Standard deviation of the noise on gyro (rad/s) and velocity (m/s).
    pub noise: [f64; 2],
    /// Time constant of the wrench that the model does not know, s.
    pub wander_s: f64,
    /// Where the tether pulls, body frame, m.
    pub tether_at: Vec3<f64>,
    /// Indices of the vehicle's coefficients that differ between cases.
    pub coefficients: &'a [usize],
    /// Indices of the parameters that are given.
    pub parameters: &'a [usize],
}

/// What differs between cases.
#[derive(Clone, Debug)]
pub struct Case {
    /// Values of the coefficients that differ.
    pub coefficients: Vec<f64>,
    /// Values of the parameters that are given, in ArduSub's units.
    pub parameters: Vec<f64>,
    /// Where the flight begins.
    pub state: State<f64>,
    /// Integral parts with which the controllers begin.
    pub integrals: [f64; INTEGRALS],
    /// Current, NED, m/s.
    pub current: [f64; 3],
    /// Standard deviation of the wrench that the model does not know, N and N m.
    pub wander: [f64; 6],
    /// Force of the tether, NED, N.
    pub tether: [f64; 3],
    /// Thrust over what the voltage of the targets gives: at the beginning, its fall per s, and its fall at full load.
    pub supply: [f64; 3],
    /// Seed of noise and wrench, a whole number below 2⁵³.
    pub seed: u64,
}

/// A case in the number type of a run.
struct Setting<T> {
    values: Vec<T>,
    parameters: Vec<T>,
    state: State<T>,
    integrals: [T; INTEGRALS],
    current: Vec3<T>,
    wander: Vec6<T>,
    tether: Vec3<T>,
    supply: Vec3<T>,
    seed: T,
}

impl Course<'_> {
    /// Rows kept of a flight.
    pub fn rows(&self) -> usize {
        self.wanted.len().div_ceil(self.every)
    }

    /// Flies all cases: `[case][row][column]`.
    ///
    /// # Errors
    /// [`Error::Interrupted`], or a forced instruction set that is not there.
    pub fn fly(&self, cases: &[Case], stop: &AtomicBool) -> Result<Vec<f64>, Error> {
        let (name, level) = level()?;
        let structure = Structure::new(self.description, self.coefficients);
        let alone = !["avx512", "avx2", "neon"].contains(&name) || cases.len() == 1;
        let groups: Vec<Vec<f64>> = cases
            .chunks(if alone { 1 } else { LANES })
            .collect::<Vec<_>>()
            .par_iter()
            .map(|group| match alone {
                true => self.run(&structure, &self.setting(0.0, |read| read(&group[0])), stop),
                false => on_level(level, self, &structure, group, stop),
            })
            .collect::<Result<_, Error>>()?;
        Ok(groups.concat())
    }

    /// The cases in the kind of `unit`, each number read from a case.
    #[inline(always)]
    fn setting<T: Real>(&self, unit: T, read: impl Fn(&dyn Fn(&Case) -> f64) -> T) -> Setting<T> {
        let mut values: Vec<T> = self.description.coefficients.iter().map(|&x| unit.splat(x)).collect();
        for (i, &index) in self.coefficients.iter().enumerate() {
            values[index] = read(&|case| case.coefficients[i]);
        }
        let mut parameters: Vec<T> = defaults().iter().map(|&x| unit.splat(x)).collect();
        for (i, &index) in self.parameters.iter().enumerate() {
            parameters[index] = read(&|case| case.parameters[i]);
        }
        Setting {
            values,
            parameters,
            state: State {
                position: std::array::from_fn(|i| read(&|case| case.state.position[i])),
                attitude: std::array::from_fn(|i| read(&|case| case.state.attitude[i])),
                nu: std::array::from_fn(|i| read(&|case| case.state.nu[i])),
            },
            integrals: std::array::from_fn(|i| read(&|case| case.integrals[i])),
            current: std::array::from_fn(|i| read(&|case| case.current[i])),
            wander: std::array::from_fn(|i| read(&|case| case.wander[i])),
            tether: std::array::from_fn(|i| read(&|case| case.tether[i])),
            supply: std::array::from_fn(|i| read(&|case| case.supply[i])),
            seed: read(&|case| case.seed as f64),
        }
    }

    /// Eight cases abreast, `[case][row][column]`; a last group may hold fewer.
    #[inline(always)]
    fn eight<S: Simd>(
        &self,
        simd: S,
        structure: &Structure,
        group: &[Case],
        stop: &AtomicBool,
    ) -> Result<Vec<f64>, Error> {
        let case = |lane: usize| &group[lane.min(group.len() - 1)];
        let unit: Lanes<S> = simd.splat_f64x8(0.0);
        let setting = self.setting(unit, |read| f64x8::from_fn(simd, |lane| read(case(lane))));
        let kept = self.run(structure, &setting, stop)?;
        Ok((0..group.len()).flat_map(|lane| kept.iter().map(move |x| x[lane])).collect())
    }

    #[inline(always)]
    fn run<T: Real>(
        &self,
        structure: &Structure,
        setting: &Setting<T>,
        stop: &AtomicBool,
    ) -> Result<Vec<T>, Error> {
        let (unit, dt) = (setting.seed.zero(), self.period);
        let environment = self.description.file.environment;
        let mut vehicle =
            Vehicle::new(self.description, structure, &setting.values, environment, [Mode::Free; 6]);
        let cascade = Cascade::new(&setting.parameters);
        let mut memory = Memory::new(&setting.integrals);
        let actuators = &self.description.actuators;
        let limits: Vec<Limits> = actuators.iter().map(|a| a.limits).collect();
        let mut motors = Motors::new(&vehicle, &limits, dt, unit);
        let mut signals = vec![unit; actuators.len()];
        let faults = Faults::new(Vec::new(), Vec::new(), false);
        let mut state = setting.state;
        let mut instants: [Instant<T>; 3] = Default::default();
        for instant in &mut instants {
            instant.current = Some(Current { velocity: setting.current, rate: [unit; 3], pressed: None });
        }
        let steady = vehicle.bias.unwrap_or([unit; 6]);
        let decay = plain::exp(-dt * EVERY as f64 / self.wander_s);
        let fresh = (1.0 - decay * decay).sqrt();
        let mut noise = Noise::<T, 12>::new(setting.seed, PLACE);
        let mut wander = [unit; 6];
        let mut sinking = Sinking { before: unit, begun: false };
        let mut kept = Vec::with_capacity(self.rows() * COLUMNS);
        for (k, wanted) in self.wanted.iter().enumerate() {
            if k % 64 == 0 && stop.load(Ordering::Relaxed) {
                return Err(Error::Interrupted);
            }
            let r = rotation(&state.attitude);
            let euler = to_euler(&state.attitude);
            let [u, v, w, p, q, s] = state.nu;
            let mut told = Told {
                attitude: state.attitude,
                heading: euler[2],
                gyro: [p, q, s],
                position: state.position,
                velocity: product(&r, &[u, v, w]),
                sinking: unit,
            };
            told.sinking = sinking.see(told.velocity[2], dt);
            for axis in 0..3 {
                if self.noise[0] > 0.0 {
                    told.gyro[axis] += noise.next(6 + axis, k) * self.noise[0];
                }
                if self.noise[1] > 0.0 {
                    told.velocity[axis] += noise.next(9 + axis, k) * self.noise[1];
                }
            }
            let demands = cascade.step(&mut memory, wanted, &told, dt);
            let (thrusts, load) = self.mixer.loaded_thrusts(&demands);
            if k % self.every == 0 {
                kept.extend_from_slice(&state.position);
                kept.extend_from_slice(&euler);
                kept.extend_from_slice(&state.nu);
                kept.extend_from_slice(&demands);
                kept.extend_from_slice(&load);
            }
            let effort = self.command(&mut signals, &thrusts, unit);
            motors.command(&vehicle, &signals, &limits);
            let [begins, falls, sags] = setting.supply;
            let left = begins - falls * (k as f64 * dt) - sags * effort;
            if k % EVERY == 0 {
                for axis in 0..6 {
                    let drawn = noise.next(axis, k / EVERY);
                    let share = if k == 0 { 1.0 } else { fresh };
                    wander[axis] = wander[axis] * decay + drawn * setting.wander[axis] * share;
                }
            }
            let pull = transposed_product(&r, &setting.tether);
            let moment = cross(&self.tether_at.map(|x| unit.splat(x)), &pull);
            let mut bias = steady;
            for axis in 0..3 {
                bias[axis] += wander[axis] + pull[axis];
                bias[axis + 3] += wander[axis + 3] + moment[axis];
            }
            vehicle.bias = Some(bias);
            let drive = |motors: &mut Motors<T>, instant: &mut Instant<T>| {
                motors.show(&faults, 0.0);
                act(&vehicle, &motors.signals, wanted.voltage, |_| None, instant);
                for thrust in &mut instant.thrusts {
                    *thrust = thrust.times(left);
                }
                vehicle.sum_inflow_free(instant, unit);
            };
            drive(&mut motors, &mut instants[0]);
            for instant in &mut instants[1..] {
                motors.advance();
                drive(&mut motors, instant);
            }
            state = step(&vehicle, &state, dt, &instants);
        }
        Ok(kept)
    }

    /// Commands of the motors for thrusts, and the mean of their size.
    #[inline(always)]
    fn command<T: Real>(&self, signals: &mut [T], thrusts: &[T; MOTORS], unit: T) -> T {
        let mut effort = unit;
        let count = self.mixer.motors.len();
        for (i, actuator) in self.description.actuators.iter().enumerate().take(count) {
            let (at_neutral, per_us) =
                (actuator.signal(NEUTRAL), actuator.signal(NEUTRAL + 1.0) - actuator.signal(NEUTRAL));
            signals[i] = (self.mixer.pulse(thrusts[i]) - NEUTRAL) * per_us + at_neutral;
            effort += thrusts[i].abs() * (1.0 / count as f64);
        }
        effort
    }
}

/// Downward acceleration from the velocity of two periods.
struct Sinking<T> {
    before: T,
    begun: bool,
}

impl<T: Real> Sinking<T> {
    #[inline(always)]
    fn see(&mut self, velocity: T, dt: f64) -> T {
        let change = if self.begun { (velocity - self.before) * (1.0 / dt) } else { velocity.zero() };
        (self.before, self.begun) = (velocity, true);
        change
    }
}

/// Compiles the loop once per wide instruction set.
fn on_level(
    level: Level,
    course: &Course<'_>,
    structure: &Structure,
    group: &[Case],
    stop: &AtomicBool,
) -> Result<Vec<f64>, Error> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || course.eight(simd, structure, group, stop),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || course.eight(simd, structure, group, stop),
            );
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(
            #[inline(always)]
            || course.eight(simd, structure, group, stop),
        );
    }
    Err(Error::simulation(format!("{level:?}: no lanes for this instruction set")))
}
