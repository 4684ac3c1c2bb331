//! The autopilot: from a measurement to commands, once per control period, in fixed memory.
//!
//! `guidance → mode → reference filters → control law → allocation → commands`, watched by [`crate::control::safety`].
//!
//! The mode table says which loops and actuators work from which forward speed on (with hysteresis): hover with the
//! depth by vertical thrusters, cruise with the depth by pitch. While station-keeping the first mode works. The
//! heave loop's force is vertical in the earth frame and turned into the body frame, `τ = Jᵀ f`.
//!
//! The same code flies one vehicle in real time (`f64`) and eight candidates side by side ([`crate::number::lanes`]).
//!
//! It must not begin while it waits for a first sample ([`Measurement::waiting_for`]), and no channel may be
//! other than a number, the altitude apart.
//!
//! Source: Taubert et al. (2014), figures 13–15, equations 49–54, corrected; Fossen (2011), chapter 12.
//! Tests: `tests/control.rs`, `tests/closed_loop.rs`, `tests/fixed_memory.rs`.

mod feed_forward;
pub mod file;
mod modes;
mod monitor;
mod rates;
mod reaction;
pub mod set_point;
pub mod settings;
mod situation;
mod wrench;

use crate::control::allocation::Allocator;
use crate::control::control_law::{SWAY, Situation};
use crate::control::guidance::{Desired, Guidance, Progress};
use crate::control::lqr::{Lqr, LqrState};
use crate::control::navigation::Measurement;
use crate::control::pid::{Pid, PidState};
use crate::control::reference_filter::Reference;
use crate::control::safety::{Alert, Approach, Circumstances, watch};
use crate::control::schedule::POINTS;
use crate::description::Description;
use crate::description::coefficients::FORCES;
use crate::error::Error;
use crate::mission::Mission;
use crate::model::vehicle::{Structure, Vehicle};
use crate::number::algebra::Vec6;
use crate::number::real::Real;
use file::{Control, DepthBy};
use monitor::Monitor;
use rates::Rates;
use set_point::SetPoint;
use settings::{PER_LOOP, Settings};
use std::sync::Arc;

/// Weight of a row that the vehicle can command and no loop does.
const IDLE_ROW: f64 = 0.05;

/// A loop: its gains and the frequency of its reference filter.
#[derive(Clone)]
struct Loop<T> {
    pid: Pid<T>,
    reference: Option<T>,
}

/// An autopilot on a vehicle and a mission: what does not change under way.
pub struct Autopilot<T> {
    settings: Arc<Settings>,
    mission: Arc<Mission>,
    /// The autopilot's own model of the vehicle.
    model: Vehicle<T>,
    guidance: Guidance<T>,
    loops: [Option<Loop<T>>; 6],
    lqr: Option<Lqr<T>>,
    /// Per mode, 1 for the actuators at work.
    at_work: Vec<Vec<f64>>,
    limits: Vec<crate::actuator::motor::Limits>,
    /// Weights of the rows that no loop commands.
    idle_rows: Vec6<f64>,
    unit: T,
}

/// What an autopilot remembers from step to step.
pub struct AutopilotState<T> {
    steps: usize,
    progress: Progress<T>,
    /// Per mode above the first, 1 while its speed is reached.
    reached: Vec<T>,
    active: Vec6<T>,
    references: [Reference<T>; 6],
    pid: [PidState<T>; 6],
    lqr: LqrState<T>,
    rates: Rates<T>,
    /// Desired speed (m/s) and depth (m) of the last step.
    speed: T,
    depth: T,
    /// 1 once the vehicle has surfaced under a reaction.
    surfaced: T,
    achieved: Vec6<T>,
    alert: Alert<T>,
    /// Desired pitch, within its rate, rad.
    pitch: T,
    /// Heading that a reaction keeps, rad.
    heading: T,
    allocator: Allocator<T>,
    usable: Vec<T>,
    monitor: Monitor<T>,
    approach: Approach<T>,
    /// Commands as signals: in the unit of the command, from neutral, positive ahead.
    pub signals: Vec<T>,
}

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
    /// Largest of the smallest distances to the waypoints that are done with, m.
    pub missed_by: T,
    /// 1 when there is nothing more to do: the mission is complete, or the vehicle has surfaced.
    pub ended: T,
}

impl<T: Real> Autopilot<T> {
    /// An autopilot that takes the vehicle `description`, which it [fits](Settings::fits), for its model, with the
    /// tunable numbers `tunables`.
    ///
    /// # Errors
    /// A mode names actuators that the vehicle does not have, or the regulator's tables do not fit the modes.
    #[inline(always)]
    pub fn new(
        settings: &Arc<Settings>,
        description: &Description,
        mission: &Arc<Mission>,
        tunables: &[T],
    ) -> Result<Self, Error> {
        let unit = tunables[0].zero();
        let file = &settings.file;
        let structure = Structure::new(description, &[]);
        let values: Vec<T> = description.coefficients.iter().map(|&x| unit.splat(x)).collect();
        let free = [crate::model::vehicle::Mode::Free; 6];
        let model = Vehicle::new(description, &structure, &values, description.file.environment, free);
        let tables = file.loops.in_order();
        let loops = std::array::from_fn(|i| {
            let (table, row) = (tables[i]?, &tunables[i * PER_LOOP..(i + 1) * PER_LOOP]);
            let gain = |k: usize| std::array::from_fn(|p| row[k * POINTS + p]);
            let pid = Pid {
                k_p: gain(0),
                k_i: gain(1),
                k_d: gain(2),
                tau_max: unit.splat(table.tau_max),
                anti_windup: table.anti_windup,
            };
            Some(Loop { pid, reference: table.reference_rad_s.map(|_| row[3 * POINTS]) })
        });
        let slowest = &settings.modes[0];
        let hover = slowest.depth_by == DepthBy::Heave;
        let mut guidance = Guidance::new(&file.guidance, unit, slowest.active[SWAY], hover);
        guidance.tune(&tunables[6 * PER_LOOP..]);
        Ok(Self {
            settings: settings.clone(),
            mission: mission.clone(),
            guidance,
            loops,
            lqr: settings.regulator(unit)?,
            at_work: settings.actuators_at_work(description)?,
            limits: description.actuators.iter().map(|a| a.limits).collect(),
            idle_rows: FORCES.map(|row| {
                let commanded = description.file.controllable.iter().any(|known| known == row);
                if commanded { IDLE_ROW } else { 0.0 }
            }),
            model,
            unit,
        })
    }

    /// The memory of an autopilot that has not begun; `allocator` distributes to the actuators of [`Self::model`].
    #[inline(always)]
    pub fn begin(&self, allocator: Allocator<T>) -> AutopilotState<T> {
        let (unit, zeros) = (self.unit, [self.unit; 6]);
        let count = self.limits.len();
        AutopilotState {
            steps: 0,
            progress: self.guidance.begin(&self.mission.start, &self.mission.waypoints),
            reached: vec![unit; self.settings.modes.len() - 1],
            active: zeros,
            references: [Reference::at(unit); 6],
            pid: [PidState::at_rest(unit); 6],
            lqr: LqrState::at_rest(unit),
            rates: Rates::new(unit),
            speed: unit,
            depth: unit,
            surfaced: unit,
            achieved: zeros,
            alert: Alert::none(unit),
            pitch: unit,
            heading: unit,
            allocator,
            usable: vec![unit; count],
            monitor: Monitor::new(&self.model, &self.limits, self.settings.file.period_s, unit),
            approach: Approach::new(unit),
            signals: vec![unit; count],
        }
    }

    /// The autopilot's model of the vehicle.
    pub fn model(&self) -> &Vehicle<T> {
        &self.model
    }

    /// The name of a mode.
    pub fn mode_name(&self, mode: usize) -> &str {
        self.settings.modes.get(mode).map_or("", |mode| &mode.name)
    }

    /// The control period, s.
    pub fn period(&self) -> f64 {
        self.settings.file.period_s
    }

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
        let (zero, one, half) = (self.unit, self.unit.splat(1.0), self.unit.splat(0.5));
        let flag = |mask: T::Mask| T::select(mask, one, zero);
        let dt = self.settings.file.period_s;
        if let Some(signals) = feedback {
            state.monitor.compare(signals, &self.settings.file.safety.actuator, dt);
        }
        let was = state.alert;
        state.alert = watch(
            &self.settings.file.safety,
            &was,
            measured,
            &Circumstances {
                limits: &self.mission.limits,
                time: state.steps as f64 * dt,
                dt,
                needs_altitude: self.needs_altitude(state),
                failed: state.monitor.any_failed(),
                stalled: state.approach.stalled,
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
        state.steps += 1;
        Thought {
            desired,
            mode,
            alert: state.alert,
            demanded,
            achieved: state.achieved,
            given_up: state.monitor.given_up(),
            missed_by: state.progress.farthest_miss(),
            ended: flag(T::either(surfaced, T::both(state.alert.level.lt(half), half.lt(desired.done)))),
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
