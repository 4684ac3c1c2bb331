//! The autopilot: from a measurement to commands, once per control period, in fixed memory.
//!
//! `intake → screen → guidance → mode → reference filters → control law → allocation → commands`, watched by [`crate::control::safety`].
//!
//! The mode table says which loops and actuators work from which forward speed on (with hysteresis): hover with the
//! depth by vertical thrusters, cruise with the depth by pitch. While station-keeping the first mode works. The
//! heave loop's force is vertical in the earth frame and turned into the body frame, `τ = Jᵀ f`.
//!
//! The same code flies one vehicle in real time (`f64`) and eight candidates side by side ([`crate::number::lanes`]).
//!
//! In reading order: [`file`](mod@file), what users write; [`settings`], the same checked and resolved; [`set_point`], steering by
//! hand or by a trial; [`channels`], what of a measurement is in use; `rates`, speeds from what is measured; `monitor`, the actuators watched; [`state`], the
//! [`Autopilot`] and what it remembers; then the steps of a period: `reaction` (guidance, or what stands in for it),
//! `modes`, `situation` (what the laws are told), `feed_forward`, `wrench` (allocation and back); [`Autopilot::step`] last.
//!
//! It must not begin while it waits for a first sample ([`Autopilot::waiting_for`]). Any number may come as a sample: what
//! cannot be true is kept out by [`crate::control::intake`]. Steps that come early or late, or after a pause, tell the time since the last
//! one ([`Autopilot::step_after`]).
//!
//! Source: Taubert et al. (2014), figures 16–18 (control loop, line of sight, PID controller), equations 49–54,
//! corrected; Fossen (2011), chapter 12.
//! Tests: `tests/control.rs`, `tests/closed_loop.rs`, `tests/fixed_memory.rs`.

pub mod channels;
mod feed_forward;
pub mod file;
mod modes;
mod monitor;
mod rates;
mod reaction;
pub mod set_point;
pub mod settings;
mod situation;
pub mod state;
mod wrench;

use crate::control::control_law::Situation;
use crate::control::guidance::Desired;
use crate::control::navigation::Measurement;
use crate::control::safety::{Alert, Circumstances, watch};
use crate::number::algebra::Vec6;
use crate::number::real::Real;
use file::Control;
use set_point::SetPoint;
pub use state::{Autopilot, AutopilotState};

/// The longest step of control, in periods: an integral must not take up a pause at once.
pub const LONGEST_STEP: f64 = 5.0;

/// What an autopilot thinks at one step.
#[derive(Clone, Copy, Debug)]
pub struct Thought<T> {
    /// From guidance, or from the reaction that stands in for it.
    pub desired: Desired<T>,
    /// Index of the mode.
    pub mode: T,
    /// Safety.
    pub alert: Alert<T>,
    /// Demands of the loops, N and N m.
    pub demanded: Vec6<T>,
    /// What the allocation reaches of them.
    pub achieved: Vec6<T>,
    /// The actuators that have been given up: the sum of 2^i over them.
    pub given_up: T,
    /// The actuator that does something else than commanded, by the motion: see [`crate::control::isolation`].
    pub suspect: T,
    /// Largest of the smallest distances to the waypoints that are done with, m.
    pub missed_by: T,
    /// 1 when there is nothing more to do: the mission is complete, or the vehicle has surfaced.
    pub ended: T,
}

impl<T: Real> Autopilot<T> {
    /// Commands for the next period, into `state.signals`; `feedback` are the measured signals of the actuators.
    #[inline(always)]
    pub fn step(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        feedback: Option<&[T]>,
    ) -> Thought<T> {
        self.step_to(state, measured, feedback, None)
    }

    /// As [`step`](Self::step), with set points that stand in for guidance or move its plan.
    #[inline(always)]
    pub fn step_to(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        feedback: Option<&[T]>,
        set_point: Option<&SetPoint<T>>,
    ) -> Thought<T> {
        self.step_after(state, measured, feedback, (set_point, self.period()))
    }

    /// As [`step_to`](Self::step_to), `elapsed` seconds after the last step. Ages and the clock of the mission count
    /// all of it; after a pause, control goes on as if [`LONGEST_STEP`] periods had passed.
    #[inline(always)]
    pub fn step_after(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        feedback: Option<&[T]>,
        (set_point, elapsed): (Option<&SetPoint<T>>, f64),
    ) -> Thought<T> {
        state.intake.take_all(measured, elapsed);
        self.decide(state, feedback, (set_point, elapsed))
    }

    /// As [`step_after`](Self::step_after), by the samples that [`AutopilotState::intake_mut`] has taken.
    #[inline(always)]
    pub fn decide(
        &self,
        state: &mut AutopilotState<T>,
        feedback: Option<&[T]>,
        (set_point, elapsed): (Option<&SetPoint<T>>, f64),
    ) -> Thought<T> {
        let (zero, one, half) = (self.unit, self.unit.splat(1.0), self.unit.splat(0.5));
        let flag = |mask: T::Mask| T::select(mask, one, zero);
        let dt = self.pass(state, elapsed);
        let patience = self.settings.file.safety.frozen_after_s;
        let told = state.intake.measured();
        if let Some(leap) = state.screen.look(told, (patience, state.speed), &self.thresholds, elapsed) {
            state.follow(leap);
        }
        let measured = &{ *state.screen.believed() };
        if let Some(signals) = feedback {
            state.monitor.compare(signals, &self.settings.file.safety.actuator, dt);
        }
        self.isolate(state, measured, dt);
        let was = state.alert;
        state.alert = watch(
            &self.settings.file.safety,
            &was,
            measured,
            &Circumstances {
                limits: &self.mission.limits,
                uses: &self.uses,
                time: state.count * self.period() + state.late,
                dt,
                needs_altitude: self.needs_altitude(state),
                failed: state.monitor.any_failed(&self.replaceable, &self.settings.file.safety.actuator),
                distrusted: state.monitor.given_up().max(state.isolation.suspect()),
                stalled: state.approach.stalled,
                sounded: state.sounded,
                contradiction: Some(state.screen.contradiction()),
                speed: state.speed,
                battery_age: state.intake.battery_age(),
                battery_wrong: state.intake.battery_wrong(),
                surfaced: state.surfaced,
            },
        );
        let mut desired = self.guide(state, measured, was.level, set_point);
        if set_point.is_none() {
            state.approach.see((desired.leg, desired.distance), state.progress.busy(), dt);
        }
        let surfaced = self.react(state, measured, &mut desired);

        let mode = self.mode(state, measured, desired.holding);
        let (active, by_pitch) = self.at_work(mode);
        let (mut situation, acceleration) = self.situation(state, measured, &desired, (active, by_pitch));
        situation.feed_forward = self.known(&situation, &desired, &acceleration);
        let demanded = self.law(state, &situation, mode);
        let stopped = T::either(surfaced, zero.splat(2.5).lt(state.alert.level));
        self.allocate(state, measured, &situation, (&demanded, mode, stopped));
        state.active = active;
        state.count += one;
        Thought {
            desired,
            mode,
            alert: state.alert,
            demanded,
            achieved: state.achieved,
            given_up: state.monitor.given_up(),
            suspect: state.isolation.suspect(),
            missed_by: state.progress.farthest_miss(),
            ended: flag(T::either(surfaced, T::both(state.alert.level.lt(half), half.lt(desired.done)))),
        }
    }

    /// Lets `elapsed` seconds pass; those over which control integrates.
    #[inline(always)]
    fn pass(&self, state: &mut AutopilotState<T>, elapsed: f64) -> f64 {
        let period = self.period();
        let longest = LONGEST_STEP * period;
        // Before the first step nothing was commanded, and no time counts.
        if T::any(state.count.zero().lt(state.count)) {
            state.late += elapsed - period;
            state.monitor.elapse(elapsed);
        }
        if elapsed > longest {
            state.rates.restart();
        }
        state.dt = elapsed.min(longest);
        state.dt
    }

    /// Looks for an actuator that does not do what it is commanded, and gives it up where the others can do without it.
    #[inline(always)]
    fn isolate(&self, state: &mut AutopilotState<T>, measured: &Measurement<T>, dt: f64) {
        let agree = state.screen.contradiction().agree(&self.thresholds);
        let ([u, v, w], [p, q, r]) = (measured.water(), measured.rates());
        state.allocator.survey(&self.model, &[u, v, w, p, q, r], measured.voltage);
        let known = (&self.model, &state.allocator);
        state.isolation.see(known, (measured, agree), state.monitor.acting(), dt);
        for k in (0..state.signals.len()).filter(|&k| self.replaceable[k]) {
            let (certain, force) = state.isolation.certain(k);
            if T::any(certain) {
                let signal = state.allocator.signal_of(&self.model, k, force, measured.voltage);
                state.monitor.give_up(k, signal, certain);
            }
        }
    }

    /// Declares an actuator failed (`failed` 1), from outside.
    pub fn declare_failed(&self, state: &mut AutopilotState<T>, actuator: usize, failed: T) {
        state.monitor.declare(actuator, failed);
    }

    /// The demands of the loops, N and N m.
    #[inline(always)]
    fn law(&self, state: &mut AutopilotState<T>, situation: &Situation<T>, mode: T) -> Vec6<T> {
        let weights = self.settings.schedule.weights(situation.speed);
        let zero = self.unit;
        let mut demanded = [zero; 6];
        match self.settings.file.control {
            Control::Pid => {
                for i in 0..6 {
                    if let Some(this) = &self.loops[i] {
                        demanded[i] = this.pid.step(&mut state.pid[i], situation, &weights, i);
                    }
                }
            }
            Control::Lqr => {
                if let Some(lqr) = &self.lqr {
                    demanded = lqr.step(&mut state.lqr, situation, &weights, mode);
                }
            }
        }
        demanded
    }
}
