//! The autopilot: from a measurement to commands, once per control period, in fixed memory.
//!
//! `guidance → mode → reference filters → control law → allocation → commands`, watched by [`crate::safety`].
//!
//! The mode table says which loops and actuators work from which forward speed on (with hysteresis): hover with the
//! depth by vertical thrusters, cruise with the depth by pitch. While station-keeping the first mode works. The
//! heave loop's force is vertical in the earth frame and turned into the body frame, `τ = Jᵀ f`.
//!
//! The same code flies one vehicle in real time (`f64`) and eight candidates side by side ([`crate::real::lanes`]).
//!
//! Source: Taubert et al. (2014), figures 13–15, equations 49–54, corrected; Fossen (2011), chapter 12.
//! Tests: `tests/control.rs`, `tests/closed_loop.rs`.

pub mod file;
mod monitor;
pub mod settings;

use crate::algebra::{Vec6, dot};
use crate::allocation::Allocator;
use crate::control_law::{HEAVE, PITCH, ROLL, SURGE, SWAY, Situation};
use crate::description::Description;
use crate::error::Error;
use crate::guidance::{Desired, Fix, Guidance, Progress};
use crate::kinematics::{from_euler, rotation};
use crate::lqr::{Lqr, LqrState};
use crate::mission::{Mission, Vertical};
use crate::navigation::Measurement;
use crate::pid::{Pid, PidState};
use crate::real::Real;
use crate::reference_filter::Reference;
use crate::safety::{Alert, Approach, Circumstances, Reaction, watch};
use crate::schedule::POINTS;
use crate::vehicle::{Structure, Vehicle};
use file::{Control, DepthBy};
use monitor::Monitor;
use settings::{PER_LOOP, Settings};
use std::sync::Arc;

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
    last_velocity: [T; 2],
    demanded: Vec6<T>,
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
    /// An autopilot that takes the vehicle `description` for its model, with the tunable numbers `tunables`.
    ///
    /// # Errors
    /// The autopilot does not fit the vehicle: unknown actuators, a row that it cannot command.
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
        let free = [crate::vehicle::Mode::Free; 6];
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
            last_velocity: [unit; 2],
            demanded: zeros,
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
                altitude_leg: self.altitude_leg(state),
                failed: state.monitor.any_failed(),
                stalled: state.approach.stalled,
            },
        );
        let mut desired = self.guide(state, measured, was.level);
        state.approach.see((desired.leg, desired.distance), state.progress.busy(), dt);
        let [roll, pitch, yaw] = measured.attitude();
        let surfaced = self.react(state, measured, &mut desired);

        let mode = self.mode(state, measured, desired.holding);
        let (active, by_pitch) = self.at_work(mode);
        // Hover wants no pitch; what guidance has in mind meanwhile is reached at its own rate.
        let pitch_wanted = T::select(half.lt(by_pitch), desired.pitch, zero);
        let most = self.guidance.pitch_rate_max * dt;
        let from = if state.steps > 0 { state.pitch } else { measured.attitude()[1] };
        state.pitch = from + (pitch_wanted - from).clamped(-most, most);
        let wanted = [desired.speed, desired.lateral, desired.depth, zero, state.pitch, desired.heading];
        let [u, v, _] = measured.velocity();
        let shown = [u, v, measured.channels[2], roll, pitch, yaw];
        let rate = self.rates(state, measured);
        let mut situation = Situation {
            dt,
            speed: desired.speed,
            error: [zero; 6],
            rate,
            reference_rate: [zero; 6],
            velocity: velocity(measured),
            attitude: [roll, pitch, yaw],
            feed_forward: [zero; 6],
            demanded: state.demanded,
            achieved: state.achieved,
            active,
            entered: [zero; 6],
        };
        let mut acceleration = [zero; 6];
        for i in 0..6 {
            let was_active = half.lt(state.active[i]);
            if state.steps > 0 {
                situation.entered[i] = T::select(was_active, zero, active[i]);
            }
            let angle = i >= ROLL;
            let mut followed = wanted[i];
            if let Some(omega) = self.loops[i].as_ref().and_then(|l| l.reference) {
                let before = &state.references[i];
                let moving = if i >= HEAVE { rate[i] } else { zero };
                let from = Reference {
                    value: T::select(was_active, before.value, shown[i]),
                    rate: T::select(was_active, before.rate, moving),
                    acceleration: zero,
                };
                let after = from.follow(wanted[i], omega, dt, angle);
                followed = after.value;
                situation.reference_rate[i] = after.rate;
                acceleration[i] = if i >= HEAVE { after.acceleration } else { after.rate };
                state.references[i] = after;
            }
            let error = followed - shown[i];
            situation.error[i] = if angle { error.wrap() } else { error };
        }
        // Without a velocity the feed-forward alone drives.
        let blind = zero.splat(self.settings.file.safety.stale_velocity.after_s).lt(measured.age[3]);
        for i in [SURGE, SWAY] {
            situation.error[i] = T::select(blind, zero, situation.error[i]);
        }
        situation.feed_forward = self.known(&situation, &desired, &acceleration);
        let demanded = self.law(state, &situation, mode);
        let stopped = T::either(surfaced, zero.splat(2.5).lt(state.alert.level));
        self.allocate(state, measured, &situation, (&demanded, mode, stopped));
        state.active = active;
        state.demanded = demanded;
        state.last_velocity = [u, v];
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

    #[inline(always)]
    fn altitude_leg(&self, state: &AutopilotState<T>) -> T {
        let waypoints = &self.mission.waypoints;
        if waypoints.iter().all(|w| w.vertical == Vertical::Depth) {
            return self.unit;
        }
        let follows = |leg: f64| {
            let waypoint = &waypoints[(leg.max(0.0) as usize).min(waypoints.len() - 1)];
            (f64::from(u8::from(waypoint.vertical == Vertical::Altitude)), 0.0)
        };
        state.progress.leg().tabulated(follows)
    }

    /// Guidance, stopped at the present place where a reaction begins.
    #[inline(always)]
    fn guide(&self, state: &mut AutopilotState<T>, measured: &Measurement<T>, before: T) -> Desired<T> {
        let half = before.splat(0.5);
        let begins = T::both(before.lt(half), half.lt(state.alert.level));
        let fix = Fix {
            position: measured.position(),
            altitude: measured.channels[12],
            attitude: measured.attitude(),
            velocity: measured.velocity(),
        };
        if T::any(begins) {
            self.guidance.stop_here(&mut state.progress, &fix, begins);
            state.heading = T::select(begins, fix.attitude[2], state.heading);
        }
        let dt = self.settings.file.period_s;
        self.guidance.step(&self.mission.waypoints, &mut state.progress, &fix, dt)
    }

    /// Puts what the reaction asks for over the desired values; where the vehicle has surfaced.
    #[inline(always)]
    fn react(
        &self,
        state: &AutopilotState<T>,
        measured: &Measurement<T>,
        desired: &mut Desired<T>,
    ) -> T::Mask {
        let (zero, level) = (self.unit, state.alert.level);
        let safety = &self.settings.file.safety;
        let depth = measured.channels[2];
        let surface = zero.splat(f64::from(Reaction::Surface as u8) - 0.5).lt(level);
        if T::any(surface) {
            let still = self.settings.modes[0].depth_by == DepthBy::Heave;
            let speed = if still { 0.0 } else { safety.surface_speed_m_s };
            let up = self.guidance.pitch_towards(depth);
            let pick = |to: &mut T, from: T| *to = T::select(surface, from, *to);
            pick(&mut desired.speed, zero.splat(speed));
            pick(&mut desired.lateral, zero);
            pick(&mut desired.heading, state.heading);
            pick(&mut desired.pitch, up);
            pick(&mut desired.depth, zero);
            pick(&mut desired.holding, zero.splat(f64::from(u8::from(still))));
        }
        T::both(surface, depth.lt(zero.splat(safety.surfaced_above_m)))
    }

    /// Index of the mode at the measured forward speed through the water.
    #[inline(always)]
    fn mode(&self, state: &mut AutopilotState<T>, measured: &Measurement<T>, holding: T) -> T {
        let (zero, one) = (self.unit, self.unit.splat(1.0));
        let speed = measured.water()[0];
        let mut index = zero;
        for (reached, mode) in state.reached.iter_mut().zip(&self.settings.modes[1..]) {
            let above = T::select(speed.lt(zero.splat(mode.from_speed)), *reached, one);
            *reached = T::select(speed.lt(zero.splat(mode.from_speed - mode.hysteresis)), zero, above);
            index += *reached;
        }
        T::select(zero.splat(0.5).lt(holding), zero, index)
    }

    /// The loops at work in a mode, and 1 where the depth is by pitch.
    #[inline(always)]
    fn at_work(&self, mode: T) -> (Vec6<T>, T) {
        let zero = self.unit;
        let (mut active, mut by_pitch) = ([zero; 6], zero);
        for (m, row) in self.settings.modes.iter().enumerate() {
            let this = (mode - zero.splat(m as f64)).abs().lt(zero.splat(0.5));
            for i in 0..6 {
                active[i] = T::select(this, zero.splat(f64::from(u8::from(row.active[i]))), active[i]);
            }
            let pitch = zero.splat(f64::from(u8::from(row.depth_by == DepthBy::Pitch)));
            by_pitch = T::select(this, pitch, by_pitch);
        }
        (active, by_pitch)
    }

    /// The rates of what the loops control: accelerations by differences, the others from the sensors.
    #[inline(always)]
    fn rates(&self, state: &AutopilotState<T>, measured: &Measurement<T>) -> Vec6<T> {
        let zero = self.unit;
        let [roll, pitch, _] = measured.attitude();
        let ([p, q, r], [u, v, w]) = (measured.rates(), measured.velocity());
        let ((s_roll, c_roll), (s_pitch, c_pitch)) = (roll.sin_cos(), pitch.sin_cos());
        let about_z = q.mul_add(s_roll, r * c_roll);
        let yaw = about_z / c_pitch.max(zero.splat(0.1));
        let sink = (v * s_roll + w * c_roll).mul_add(c_pitch, -(u * s_pitch));
        let begun = f64::from(u8::from(state.steps > 0)) / self.settings.file.period_s;
        let [u_before, v_before] = state.last_velocity;
        [
            (u - u_before) * begun,
            (v - v_before) * begun,
            sink,
            s_pitch.mul_add(yaw, p),
            q.mul_sub(c_roll, r * s_roll),
            yaw,
        ]
    }

    /// What the model knows to be needed: against weight and buoyancy, against drag, for acceleration.
    #[inline(always)]
    fn known(&self, s: &Situation<T>, desired: &Desired<T>, acceleration: &Vec6<T>) -> Vec6<T> {
        let table = &self.settings.file.feed_forward;
        let zero = self.unit;
        let mut known = [zero; 6];
        if table.restoring {
            let r = rotation(&from_euler(&s.attitude));
            let [x, y, z, k, m, n] = self.model.restoring.add(&r, &[zero; 6]);
            let heave = zero.splat(0.5).lt(s.active[HEAVE]);
            let sink = dot(&r[2], &[x, y, z]);
            known = [T::select(heave, zero, -x), T::select(heave, zero, -y), -sink, -k, -m, -n];
        }
        if table.drag {
            let drag =
                self.model.damping.add(&[desired.speed, desired.lateral, zero, zero, zero, zero], &[zero; 6]);
            for i in [SURGE, SWAY] {
                known[i] -= drag[i];
            }
        }
        if table.acceleration {
            for i in 0..6 {
                known[i] = self.model.mass_matrix[i][i].mul_add(acceleration[i], known[i]);
            }
        }
        known
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

    #[inline(always)]
    fn allocate(
        &self,
        state: &mut AutopilotState<T>,
        measured: &Measurement<T>,
        situation: &Situation<T>,
        (demanded, mode, stopped): (&Vec6<T>, T, T::Mask),
    ) {
        let zero = self.unit;
        let ((s_roll, c_roll), (s_pitch, c_pitch)) =
            (situation.attitude[ROLL - 3].sin_cos(), situation.attitude[PITCH - 3].sin_cos());
        // The earth's vertical in the body frame.
        let vertical = [-s_pitch, c_pitch * s_roll, c_pitch * c_roll];
        let mut tau = *demanded;
        tau[HEAVE] = zero;
        for i in 0..3 {
            tau[i] = vertical[i].mul_add(demanded[HEAVE], tau[i]);
        }
        for i in 0..state.usable.len() {
            let mut usable = zero;
            for (m, at_work) in self.at_work.iter().enumerate() {
                let this = (mode - zero.splat(m as f64)).abs().lt(zero.splat(0.5));
                usable = T::select(this, zero.splat(at_work[i]), usable);
            }
            state.usable[i] = usable;
        }
        state.monitor.exclude(&mut state.usable, &mut state.allocator);
        let [u, v, w] = measured.water();
        let [p, q, r] = measured.rates();
        let rows = situation.active;
        state.allocator.prepare(&self.model, &rows, &state.usable, u);
        let nu_r = [u, v, w, p, q, r];
        let reached =
            state.allocator.allocate(&self.model, &tau, &nu_r, measured.voltage, &mut state.signals);
        for signal in &mut state.signals {
            *signal = T::select(stopped, zero, *signal);
        }
        state.monitor.expect(&state.signals, &self.limits);
        let mut short = [zero; 6];
        for i in 0..6 {
            short[i] = (T::select(stopped, zero, reached[i]) - tau[i]) * rows[i];
        }
        let sink = dot(&vertical, &[short[0], short[1], short[2]]);
        for i in 0..6 {
            let missed = if i == HEAVE { sink } else { short[i] };
            state.achieved[i] = demanded[i] + missed;
        }
    }
}

/// The measured ν.
#[inline(always)]
fn velocity<T: Real>(measured: &Measurement<T>) -> Vec6<T> {
    let ([u, v, w], [p, q, r]) = (measured.velocity(), measured.rates());
    [u, v, w, p, q, r]
}
