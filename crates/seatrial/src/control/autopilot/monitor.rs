//! What the autopilot expects of its actuators, and which of them it has given up.
//!
//! The model's motors follow the commands; a measured signal that stays away from the expected one by more than a
//! share of the largest signal, for longer than a time, declares the actuator failed. From then on it gets no command,
//! the others are allocated without it, and what it still does (a stuck fin, a motor that runs on) is
//! taken off the demand at its measured signal.
//!
//! Without a measured signal the motion tells ([`crate::control::isolation`]).
//!
//! Tests: `tests/closed_loop/safety.rs`.

use crate::actuator::motor::Limits;
use crate::control::allocation::Allocator;
use crate::control::safety::ActuatorWatch;
use crate::model::drive::{Drive, UnlimitedDelay};
use crate::model::vehicle::Vehicle;
use crate::number::real::Real;

/// Expected and measured signals of the actuators.
#[derive(Clone)]
pub struct Monitor<T> {
    drive: Drive<T>,
    targets: Vec<T>,
    /// Largest signal; actuators without a limit are not watched.
    largest: Vec<f64>,
    /// How long each has been off, s.
    off: Vec<T>,
    /// 1 for those given up.
    failed: Vec<T>,
    /// 1 for those given up by the motion alone.
    inferred: Vec<T>,
    /// The last measured signals; 1 for those that count: measured at the last look, or given up.
    shown: Vec<T>,
    known: Vec<T>,
    /// What the actuators do, as far as it is known.
    acting: Vec<T>,
    any: bool,
    /// Control period, s, of which the drive moves by halves.
    period: f64,
    /// Share of a half period that the drive is behind the time.
    rest: f64,
}

/// A measured signal beyond this multiple of the largest one is none: no motor turns twice as fast as it can.
const READABLE: f64 = 2.0;

/// Every motor has reached its target after so long, s.
const SETTLED_S: f64 = 60.0;

crate::memory!(Monitor: drive, targets, off, failed, inferred, shown, known; acting, largest, any, period, rest);

impl<T: Real> Monitor<T> {
    /// All actuators at rest and trusted.
    #[inline(always)]
    pub fn new(model: &Vehicle<T>, limits: &[Limits], period: f64, unit: T) -> Self {
        let at_rest = |i: usize| model.motor(i).steady(unit.zero());
        let zeros = vec![unit.zero(); limits.len()];
        Self {
            drive: Drive::new(model, period, UnlimitedDelay::InTheDrive, at_rest),
            targets: zeros.clone(),
            largest: limits.iter().map(|l| l.maximum[0].max(l.maximum[1])).collect(),
            off: zeros.clone(),
            failed: zeros.clone(),
            inferred: zeros.clone(),
            shown: zeros.clone(),
            known: zeros.clone(),
            acting: zeros,
            any: false,
            period,
            rest: 0.0,
        }
    }

    /// Takes the commands that are given from here on.
    #[inline(always)]
    pub fn expect(&mut self, signals: &[T], limits: &[Limits]) {
        for i in 0..signals.len() {
            self.targets[i] = limits[i].apply(signals[i]);
        }
    }

    /// Moves the expected signals on by the time, s, for which the commands were held.
    #[inline(always)]
    pub fn elapse(&mut self, time: f64) {
        let halves = 2.0 * time.min(SETTLED_S) / self.period + self.rest;
        // A regular period is two halves, whatever it is rounded to.
        let whole = (halves + 1e-6).floor();
        self.rest = halves - whole;
        for _half in 0..whole as usize {
            self.drive.advance(&self.targets);
        }
    }

    /// Compares measured signals with the expected ones; what is not a number, or far beyond the largest signal, was not
    /// measured.
    #[inline(always)]
    pub fn compare(&mut self, signals: &[T], table: &ActuatorWatch, dt: f64) {
        for (i, &signal) in signals.iter().enumerate() {
            let told = signal.abs().lt(signal.splat(READABLE * self.largest[i]));
            self.shown[i] = T::select(told, signal, self.shown[i]);
            self.known[i] = T::select(told, signal.splat(1.0), self.failed[i]);
            if !self.largest[i].is_finite() {
                continue;
            }
            let zero = self.off[i].zero();
            let away = zero
                .splat(table.deviation * self.largest[i])
                .lt((signal - self.drive.states[i].signal).abs());
            let away = T::both(told, away);
            self.off[i] = T::select(away, self.off[i] + dt, zero);
            let lost = zero.splat(table.after_s).lt(self.off[i]);
            self.any |= T::any(lost);
            self.failed[i] = T::select(lost, zero.splat(1.0), self.failed[i]);
        }
    }

    /// What the actuators do: as measured, or where they are given up; else as expected.
    #[inline(always)]
    pub fn acting(&mut self) -> &[T] {
        for i in 0..self.acting.len() {
            let known = self.known[i].splat(0.5).lt(self.known[i]);
            self.acting[i] = T::select(known, self.shown[i], self.drive.states[i].signal);
        }
        &self.acting
    }

    /// Gives an actuator up where `mask` holds and its signal is not measured, and takes it to stand at `signal`.
    #[inline(always)]
    pub fn give_up(&mut self, actuator: usize, signal: T, mask: T::Mask) {
        let (one, half) = (signal.splat(1.0), signal.splat(0.5));
        let unmeasured = T::either(self.known[actuator].lt(half), half.lt(self.inferred[actuator]));
        let mask = T::both(mask, unmeasured);
        self.shown[actuator] = T::select(mask, signal, self.shown[actuator]);
        self.failed[actuator] = T::select(mask, one, self.failed[actuator]);
        self.known[actuator] = T::select(mask, one, self.known[actuator]);
        self.inferred[actuator] = T::select(mask, one, self.inferred[actuator]);
        self.any |= T::any(mask);
    }

    /// Gives an actuator up (1), or trusts it again (0).
    pub fn declare(&mut self, actuator: usize, failed: T) {
        self.failed[actuator] = failed;
        self.off[actuator] = failed.zero();
        self.known[actuator] = failed;
        self.inferred[actuator] = failed.zero();
        self.any = true;
    }

    /// 1 where an actuator is given up by its signal, and stands still or is `replaceable`: to stop the others for one that
    /// runs on and that they cannot replace makes things worse. One that the motion tells of calls for nothing by itself:
    /// where the others do not suffice another watch sees it.
    #[inline(always)]
    pub fn any_failed(&self, replaceable: &[bool], table: &ActuatorWatch) -> T {
        let zero = self.failed[0].zero();
        let mut any = zero;
        if self.any {
            for i in 0..self.failed.len() {
                let measured = self.failed[i] - self.inferred[i];
                let still = self.shown[i].abs().lt(zero.splat(table.deviation * self.largest[i]));
                any = any.max(if replaceable[i] { measured } else { T::select(still, measured, zero) });
            }
        }
        any
    }

    /// Those given up, as the sum of 2^i.
    #[inline(always)]
    pub fn given_up(&self) -> T {
        let mut sum = self.failed[0].zero();
        if self.any {
            let mut place = 1.0;
            for &failed in &self.failed {
                sum += failed * place;
                place *= 2.0;
            }
        }
        sum
    }

    /// Takes the command from those given up: what they still do is no command.
    #[inline(always)]
    pub fn silence(&self, signals: &mut [T]) {
        if !self.any {
            return;
        }
        for (signal, &failed) in signals.iter_mut().zip(&self.failed) {
            *signal = T::select(failed.splat(0.5).lt(failed), failed.zero(), *signal);
        }
    }

    /// Takes those given up out of the usable ones, and tells the allocation what they still do.
    #[inline(always)]
    pub fn exclude(&self, usable: &mut [T], allocator: &mut Allocator<T>) {
        if !self.any {
            return;
        }
        for i in 0..usable.len() {
            let failed = self.failed[i].splat(0.5).lt(self.failed[i]);
            usable[i] = T::select(failed, self.failed[i].zero(), usable[i]);
            allocator.stuck(i, self.shown[i], failed);
        }
    }
}
