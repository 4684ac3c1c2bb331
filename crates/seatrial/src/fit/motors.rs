//! The motors of a vehicle at work on a record: from recorded commands to signals at the start, the middle
//! and the end of every step.
//!
//! Dead time: behind a rate limit the ramp is read `T_t` earlier. Without one the record of limited commands is
//! read earlier, and where T_t is no multiple of the step, linearly between the steps around it (the mean of the
//! held command over the step): a pure delay commutes with the lag. Lanes with different T_t read at different
//! times. A run that goes on from an earlier one reads its [`MotorMemory`] where the record has not begun.
//!
//! In open loop a motor does not feel the vehicle. Where no motor coefficient is sought, all candidates
//! share its signals and what a measured table makes of them, and they are [played](crate::fit::record::Record::play) once per
//! record.
//!
//! Tests: `tests/laws/motor.rs`, `tests/scalars.rs`.

use crate::actuator::motor::MotorState;
use crate::description::Description;
use crate::description::assembly::Structure;
use crate::description::coefficients::{HULL, PER_ACTUATOR};
use crate::fit::record::{MotorMemory, MotorStart, Played, Record, Segment};
use crate::model::drive::{Drive, UnlimitedDelay, act};
use crate::model::vehicle::{Instant, Mode, Vehicle};
use crate::number::real::Real;

/// How long before a segment the motors start to run, so that the segment meets them as they were: the same for
/// every candidate, whatever its own and its neighbours' dead times.
const WARM_UP_S: f64 = 4.0;

/// The offsets of the motor's coefficients among an actuator's: K_v, T_1, T_t and the rate limits.
const MOTOR: std::ops::Range<usize> = 14..19;

/// Whether a coefficient is a motor's.
pub(super) fn of_a_motor(index: usize) -> bool {
    index >= HULL && MOTOR.contains(&((index - HULL) % PER_ACTUATOR))
}

impl Record {
    /// Runs the motors once for all candidates, where none of the coefficients `sought` belongs to a motor.
    pub fn play(&mut self, description: &Description, sought: &[usize], substeps: usize) {
        self.played = None;
        if sought.iter().copied().any(of_a_motor) {
            return;
        }
        let structure = Structure::new(description, &[]);
        let vehicle = Vehicle::new(
            description,
            &structure,
            &description.coefficients,
            self.environment,
            [Mode::Frozen; 6],
        );
        let actuators = description.actuators.len();
        let mut signals = Vec::with_capacity(self.len * substeps * 3 * actuators);
        let mut motors = Motors::from_start(&vehicle, self, substeps);
        for k in 0..self.len {
            for s in 0..substeps {
                motors.begin(k, s);
                motors.write(k, &mut signals);
                for half in 1..3 {
                    motors.go_on(k, s, half);
                    motors.write(k, &mut signals);
                }
            }
        }
        self.played = Some(Played { substeps, actuators, signals });
    }
}

/// The motors of a vehicle at work on a record.
pub struct Motors<'a, T> {
    unit: T,
    /// Some motor jumps with its command at the start of a step.
    pub any_ideal: bool,
    /// Signal per actuator.
    pub signals: Vec<T>,
    played: Option<&'a Played>,
    now: &'a [(f64, Option<f64>)],
    vehicle: &'a Vehicle<T>,
    record: &'a Record,
    substeps: usize,
    drive: Drive<T>,
    /// Dead time in steps, where there is no rate limit.
    delays: Vec<T>,
    targets: Vec<T>,
    /// The command before the record where it is not the record's first one.
    before: Vec<T>,
    /// Per motor the commands during the steps before the record, latest first, where an earlier run left them.
    earlier: Vec<Vec<f64>>,
    /// Length of a step, s.
    h: f64,
}

/// The longest dead time that is kept, in steps: what is not a number has a bound too.
const LONGEST_PAST: f64 = 65_536.0;

impl<'a, T: Real> Motors<'a, T> {
    /// The motors as a segment meets them.
    #[inline(always)]
    pub fn new(
        vehicle: &'a Vehicle<T>,
        record: &'a Record,
        segment: &Segment,
        substeps: usize,
        unit: T,
    ) -> Self {
        let mut motors = Self::at_rest(vehicle, record, &segment.motors, substeps, unit);
        motors.played = record
            .played
            .as_ref()
            .filter(|played| played.substeps == substeps && matches!(segment.motors, MotorStart::Recorded));
        if matches!(segment.motors, MotorStart::Recorded) && motors.played.is_none() {
            let warm = segment.start.saturating_sub((WARM_UP_S / record.dt).ceil() as usize);
            motors.settle(warm);
            for k in warm..segment.start {
                for s in 0..substeps {
                    motors.command(k, s);
                    for _half in 0..2 {
                        motors.drive.advance(&motors.targets);
                    }
                }
            }
        }
        motors
    }

    /// Motors that do not run themselves but [follow](Self::follow) others.
    #[inline(always)]
    pub fn following(
        vehicle: &'a Vehicle<T>,
        record: &'a Record,
        segment: &Segment,
        substeps: usize,
        unit: T,
    ) -> Self {
        Self::at_rest(vehicle, record, &segment.motors, substeps, unit)
    }

    /// Sets the signals to those of the same motors in plain numbers.
    #[inline(always)]
    pub fn follow(&mut self, plain: &Motors<'a, f64>) {
        self.now = plain.now;
        for (to, from) in self.signals.iter_mut().zip(&plain.signals) {
            *to = self.unit.splat(*from);
        }
    }

    #[inline(always)]
    fn at_rest(
        vehicle: &'a Vehicle<T>,
        record: &'a Record,
        start: &MotorStart,
        substeps: usize,
        unit: T,
    ) -> Self {
        let h = record.dt / substeps as f64;
        let count = vehicle.actuators.len() + vehicle.fins.len();
        let at_start = |i: usize| match start {
            MotorStart::Recorded => vehicle.motor(i).steady(unit.splat(record.commands[i][0])),
            MotorStart::Held(signals) => {
                let signal = unit.splat(signals[i]);
                MotorState { ramp: signal / vehicle.motor(i).k_v, signal }
            }
            MotorStart::Carried(memory) => {
                MotorState { ramp: unit.splat(memory[i].ramp), signal: unit.splat(memory[i].signal) }
            }
        };
        let mut drive = Drive::new(vehicle, h, UnlimitedDelay::InTheRecord, at_start);
        let delay = |i: usize| {
            let motor = vehicle.motor(i);
            if motor.rate.is_some() { unit.zero() } else { motor.t_t * (1.0 / h) }
        };
        let held = matches!(start, MotorStart::Held(_));
        let delays: Vec<T> = (0..count).map(delay).collect();
        let mut earlier = Vec::new();
        if let MotorStart::Carried(memory) = start {
            for (i, memory) in memory.iter().enumerate() {
                drive.remember(i, |ago| unit.splat(memory.ramp(0.5 * h * ago as f64)));
                let steps = 0..steps_back(delays[i]);
                earlier.push(steps.map(|step| memory.command((step as f64 + 0.5) * h)).collect());
            }
        }
        Self {
            unit: unit.zero(),
            any_ideal: (0..count).any(|i| vehicle.motor(i).ideal),
            signals: vec![unit.zero(); count],
            played: None,
            now: &[],
            vehicle,
            record,
            substeps,
            delays,
            targets: vec![unit; count],
            before: if held { drive.states.iter().map(|s| s.ramp).collect() } else { Vec::new() },
            earlier,
            h,
            drive,
        }
    }

    /// Sets the motors to the steady state of the command that reaches them at sample `k`; behind a rate limit
    /// the commands before it stand for the ramp.
    #[inline(always)]
    fn settle(&mut self, k: usize) {
        let (unit, half_steps) = (self.unit, 2 * self.substeps);
        for i in 0..self.targets.len() {
            let target = self.target(i, k, 0);
            let commands = &self.record.commands[i];
            let past = |ago: usize| unit.splat(commands[k.saturating_sub(ago.div_ceil(half_steps))]);
            self.drive.settle(self.vehicle, i, target, past);
        }
    }

    /// The command that motor `i` heads for in step `s` of sample `k`.
    #[inline(always)]
    fn target(&self, i: usize, k: usize, s: usize) -> T {
        let commands = &self.record.commands[i];
        let held = |step: f64| match self.earlier.get(i) {
            Some(earlier) if step < 0.0 => {
                earlier.get((-step) as usize - 1).or(earlier.last()).copied().unwrap_or(commands[0])
            }
            _ => commands[(step as usize / self.substeps).min(commands.len() - 1)],
        };
        let delay = self.delays[i];
        let at = delay.splat((k * self.substeps + s) as f64) - delay;
        let recorded = at.tabulated(|x| {
            let whole = x.floor();
            let (from, to) = (held(whole), held(whole + 1.0));
            (from + (x - whole) * (to - from), to - from)
        });
        let Some(&before) = self.before.get(i) else { return recorded };
        // The first step of the record is reached in part where the dead time ends within it.
        let share = (at + 1.0).max(at.zero());
        let earlier = share.mul_add(recorded - before, before);
        T::select(at.lt(at.zero()), earlier, recorded)
    }

    /// The signals at the start of step `s` of sample `k`; ideal motors obey at once.
    #[inline(always)]
    pub fn begin(&mut self, k: usize, s: usize) {
        if self.played.is_none() {
            self.command(k, s);
        }
        self.show(k, s, 0);
    }

    /// The signals in the middle (`half` = 1) or at the end (2) of step `s` of sample `k`.
    #[inline(always)]
    pub fn go_on(&mut self, k: usize, s: usize, half: usize) {
        if self.played.is_none() {
            self.drive.advance(&self.targets);
        }
        self.show(k, s, half);
    }

    /// Sets the signals to the motors', or to the measured ones where they replace a motor.
    #[inline(always)]
    fn show(&mut self, k: usize, s: usize, half: usize) {
        if let Some(played) = self.played {
            self.now = played.at(k, s, half);
            for i in 0..self.signals.len() {
                self.signals[i] = self.unit.splat(self.now[i].0);
            }
            return;
        }
        let fraction = (s as f64 + 0.5 * half as f64) / self.substeps as f64;
        for (i, measured) in self.record.signals.iter().enumerate() {
            self.signals[i] = match measured {
                None => self.drive.states[i].signal,
                Some(signal) => {
                    let next = signal[(k + 1).min(signal.len() - 1)];
                    self.unit.splat(signal[k] + fraction * (next - signal[k]))
                }
            };
        }
    }

    #[inline(always)]
    fn command(&mut self, k: usize, s: usize) {
        for i in 0..self.targets.len() {
            self.targets[i] = self.target(i, k, s);
            let motor = self.vehicle.motor(i);
            if motor.ideal {
                self.drive.states[i] = motor.steady(self.targets[i]);
            }
        }
    }

    #[inline(always)]
    fn voltage(&self, k: usize) -> f64 {
        self.record.voltage.get(k).copied().unwrap_or(f64::NAN)
    }

    /// The thrusts and deflections at the present signals.
    #[inline(always)]
    pub fn thrust(&self, k: usize, instant: &mut Instant<T>) {
        let table = |i: usize| self.now.get(i).and_then(|(_, force)| force.map(|f| self.unit.splat(f)));
        act(self.vehicle, &self.signals, self.voltage(k), table, instant);
    }
}

impl<T: Real> Motors<'_, T> {
    /// What a run that goes on at sample `k` must know of the motors; nothing where the record replaces them.
    pub fn memory(&self, k: usize) -> Vec<MotorMemory<T>> {
        if self.played.is_some() || self.record.signals.iter().any(Option::is_some) {
            return Vec::new();
        }
        let memory = |i: usize| {
            let state = self.drive.states[i];
            let (spacing, past) = if self.vehicle.motor(i).rate.is_some() {
                (0.5 * self.h, self.drive.past(i))
            } else {
                let back = 1..=steps_back(self.delays[i]);
                (self.h, back.map(|steps| self.before(i, k * self.substeps, steps)).collect())
            };
            MotorMemory { ramp: state.ramp, signal: state.signal, spacing, past }
        };
        (0..self.drive.states.len()).map(memory).collect()
    }

    /// The command of motor `i` during the step that begins `steps` before step `now` of the record.
    fn before(&self, i: usize, now: usize, steps: usize) -> T {
        let commands = &self.record.commands[i];
        match (now.checked_sub(steps), self.earlier.get(i), self.before.get(i)) {
            (Some(step), _, _) => self.unit.splat(commands[(step / self.substeps).min(commands.len() - 1)]),
            (None, Some(earlier), _) => self.unit.splat(earlier[steps - now - 1]),
            (None, None, Some(&before)) => before,
            (None, None, None) => self.unit.splat(commands[0]),
        }
    }
}

/// How many steps back a dead time of `delay` steps reads.
fn steps_back<T: Real>(delay: T) -> usize {
    match delay.largest().clamp(0.0, LONGEST_PAST) {
        delay if delay > 0.0 => delay.ceil() as usize + 1,
        _ => 0,
    }
}

impl<'a> Motors<'a, f64> {
    /// Appends what the motors do at sample `k`.
    fn write(&self, k: usize, signals: &mut Vec<(f64, Option<f64>)>) {
        for (i, &signal) in self.signals.iter().enumerate() {
            let thruster = self.vehicle.actuators.get(i);
            let table = thruster.and_then(|t| t.characteristic.table_force(signal, self.voltage(k)));
            signals.push((signal, table));
        }
    }

    /// The motors at the beginning of a record.
    fn from_start(vehicle: &'a Vehicle<f64>, record: &'a Record, substeps: usize) -> Self {
        let mut motors = Self::at_rest(vehicle, record, &MotorStart::Recorded, substeps, 0.0);
        motors.settle(0);
        motors
    }
}
