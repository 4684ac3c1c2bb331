//! What an autopilot is made of: constants that do not change under way, and what is remembered from step to step.

use super::channels::Uses;
use super::file::DepthBy;
use super::monitor::Monitor;
use super::rates::Rates;
use super::settings::{PER_LOOP, Settings};
use crate::actuator::motor::Limits;
use crate::control::allocation::{Allocator, replaceable};
use crate::control::contradiction::Thresholds;
use crate::control::control_law::{HEADING, HEAVE, PITCH, SWAY};
use crate::control::guidance::{Guidance, Progress};
use crate::control::intake::Intake;
use crate::control::isolation::Isolation;
use crate::control::lqr::{Lqr, LqrState};
use crate::control::pid::{Pid, PidState};
use crate::control::reference_filter::Reference;
use crate::control::safety::{Alert, Approach, Sounded};
use crate::control::schedule::POINTS;
use crate::control::screen::{Leap, Screen};
use crate::description::Description;
use crate::description::assembly::Structure;
use crate::description::coefficients::FORCES;
use crate::error::Error;
use crate::mission::Mission;
use crate::model::vehicle::{Mode, Vehicle};
use crate::number::algebra::Vec6;
use crate::number::real::Real;
use std::sync::Arc;

/// Weight of a row that the vehicle can command and no loop does.
const IDLE_ROW: f64 = 0.05;

/// A loop: its gains and the frequency of its reference filter.
#[derive(Clone)]
pub(super) struct Loop<T> {
    pub(super) pid: Pid<T>,
    pub(super) reference: Option<T>,
}

/// An autopilot on a vehicle and a mission: what does not change under way.
pub struct Autopilot<T> {
    pub(super) settings: Arc<Settings>,
    pub(super) mission: Arc<Mission>,
    /// The autopilot's own model of the vehicle.
    pub(super) model: Vehicle<T>,
    pub(super) guidance: Guidance<T>,
    pub(super) loops: [Option<Loop<T>>; 6],
    pub(super) lqr: Option<Lqr<T>>,
    /// Per mode, 1 for the actuators at work.
    pub(super) at_work: Vec<Vec<f64>>,
    pub(super) limits: Vec<Limits>,
    /// Weights of the rows that no loop commands.
    pub(super) idle_rows: Vec6<f64>,
    pub(super) uses: Uses,
    /// The actuators without which the others command the same rows.
    pub(super) replaceable: Vec<bool>,
    /// Beyond which contradiction sensors cannot both be right.
    pub(super) thresholds: Thresholds,
    pub(super) unit: T,
}

/// What an autopilot remembers from step to step.
pub struct AutopilotState<T> {
    /// Steps taken so far, a whole number in every lane.
    pub(super) count: T,
    /// How much longer the steps have taken than the control period, s.
    pub(super) late: f64,
    /// Time over which this step integrates and moves limited values, s.
    pub(super) dt: f64,
    pub(super) intake: Intake<T>,
    pub(super) screen: Screen<T>,
    pub(super) progress: Progress<T>,
    /// Per mode above the first, 1 while its speed is reached.
    pub(super) reached: Vec<T>,
    pub(super) active: Vec6<T>,
    pub(super) references: [Reference<T>; 6],
    pub(super) pid: [PidState<T>; 6],
    pub(super) lqr: LqrState<T>,
    pub(super) rates: Rates<T>,
    /// Desired speed (m/s) and depth (m) of the last step.
    pub(super) speed: T,
    pub(super) depth: T,
    /// 1 once the vehicle has surfaced under a reaction.
    pub(super) surfaced: T,
    pub(super) achieved: Vec6<T>,
    pub(super) alert: Alert<T>,
    /// Desired pitch, within its rate, rad.
    pub(super) pitch: T,
    /// Heading that a reaction keeps, rad.
    pub(super) heading: T,
    pub(super) allocator: Allocator<T>,
    pub(super) usable: Vec<T>,
    pub(super) monitor: Monitor<T>,
    pub(super) isolation: Isolation<T>,
    pub(super) approach: Approach<T>,
    /// Commands as signals: in the unit of the command, from neutral, positive ahead.
    pub signals: Vec<T>,
    /// What is added to the commands while the vehicle is not stopped, as signals: the dither of a trial that identifies it.
    pub dither: Vec<T>,
    /// What the depth sensor itself shows, for the watch of the depth, where an estimate stands in for the measurement.
    pub sounded: Option<Sounded<T>>,
}

crate::memory!(AutopilotState:
    count, intake, screen, progress, reached, active, references, pid, lqr, rates, speed, depth, surfaced, achieved, alert,
    pitch, heading, allocator, monitor, isolation, approach;
    late, dt, usable, signals, dither, sounded);

impl<T: Real> AutopilotState<T> {
    /// What has arrived, and what of it was possible.
    pub fn intake(&self) -> &Intake<T> {
        &self.intake
    }

    /// Where samples are put that come one by one, for [`Autopilot::decide`].
    pub fn intake_mut(&mut self) -> &mut Intake<T> {
        &mut self.intake
    }

    /// Which samples are believed.
    pub fn screen(&self) -> &Screen<T> {
        &self.screen
    }

    /// The operator's reset where `at` holds: whatever was called for is left, and the mission goes on where it was
    /// interrupted. What is still true calls again after its time.
    #[inline(always)]
    pub fn reset(&mut self, at: T::Mask) {
        self.alert.reset(at);
        self.screen.forget(at);
        self.isolation.forget(at);
        self.approach.restart(at);
        self.surfaced = T::select(at, self.surfaced.zero(), self.surfaced);
    }

    /// Moves what is desired along with a jump of depth, pitch and yaw that is believed: the errors of the loops do not
    /// jump, and guidance goes from here to where it wants to be at its own rates.
    #[inline(always)]
    pub(super) fn follow(&mut self, [depth, pitch, yaw]: Leap<T>) {
        self.progress.moved_by(depth, pitch, yaw);
        self.rates.moved_by(depth);
        self.depth += depth;
        self.pitch += pitch;
        self.heading = (self.heading + yaw).wrap();
        self.references[HEAVE].value += depth;
        self.references[PITCH].value += pitch;
        self.references[HEADING].value = (self.references[HEADING].value + yaw).wrap();
    }
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
        let free = [Mode::Free; 6];
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
            uses: settings.uses(description),
            replaceable: replaceable(description),
            thresholds: file.safety.contradiction,
            model,
            unit,
        })
    }

    /// The same, told the estimate of a navigation filter: a fix corrects that after dead reckoning, and contradicts no
    /// velocity. The filter itself compares the instruments.
    #[inline(always)]
    pub fn by_estimate(mut self, estimated: bool) -> Self {
        self.thresholds.position_m = if estimated { f64::INFINITY } else { self.thresholds.position_m };
        self
    }

    /// The memory of an autopilot that has not begun; `allocator` distributes to the actuators of [`Self::model`].
    #[inline(always)]
    pub fn begin(&self, allocator: Allocator<T>) -> AutopilotState<T> {
        let (unit, zeros) = (self.unit, [self.unit; 6]);
        let count = self.limits.len();
        AutopilotState {
            count: unit,
            late: 0.0,
            dt: self.settings.file.period_s,
            intake: Intake::new(unit),
            screen: Screen::new(unit),
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
            isolation: Isolation::new(count, unit),
            approach: Approach::new(unit),
            signals: vec![unit; count],
            dither: vec![unit; count],
            sounded: None,
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
}
