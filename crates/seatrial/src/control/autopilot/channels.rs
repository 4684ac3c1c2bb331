//! Which channels an autopilot uses: those that a loop, guidance or a watch reads.
//!
//! | channel | used by |
//! |---|---|
//! | x y z | guidance, limits and fence; z by the depth loop too |
//! | roll pitch yaw | every loop of an angle, its rate, the vertical in the body frame, guidance |
//! | u | the surge loop |
//! | v | the sway loop; besides it station-keeping and the rate of the depth |
//! | w | the rate of the depth, where a heave loop is at work |
//! | p | the roll loop; besides it the inflow of fins |
//! | q r | the pitch and heading loops |
//! | altitude | legs that follow the bottom, and missions with a least altitude |
//!
//! The linear-quadratic regulator reads all velocities and rates. The velocity through the water has a substitute, the
//! one over ground, and no watch.
//!
//! Tests: `tests/closed_loop/safety.rs`.

use super::settings::Settings;
use super::state::Autopilot;
use crate::control::autopilot::file::Control;
use crate::control::control_law::{HEADING, HEAVE, PITCH, ROLL, SURGE, SWAY};
use crate::control::navigation::{ALTITUDE, CHANNELS, GROUP, GROUP_NAMES, Measurement, RATES, VELOCITY};
use crate::description::{Description, Effect};
use crate::number::real::Real;

/// How a channel is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Nothing that steers reads it.
    Idle,
    /// It is read, and something stands in for it: a vehicle may lack the sensor, but a sensor that falls silent is missed.
    Replaceable,
    /// It is read, and nothing stands in for it.
    Needed,
}

/// The use of every channel.
pub type Uses = [Use; CHANNELS];

/// The groups without which an autopilot does not begin: position, depth, attitude and rates.
const BEGINNING: [usize; 4] = [0, 1, 2, 4];

impl Settings {
    /// What the loops of all modes, guidance and the watches read.
    pub fn uses(&self, vehicle: &Description) -> Uses {
        let regulator = self.file.control == Control::Lqr;
        let at_work = |i: usize| self.modes.iter().any(|mode| mode.active[i]);
        let needed_where = |yes: bool, else_read: bool| match (yes, else_read) {
            (true, _) => Use::Needed,
            (false, true) => Use::Replaceable,
            (false, false) => Use::Idle,
        };
        let fins = vehicle.actuators.iter().any(|a| matches!(a.effect, Effect::Fin(_)));
        let angles = at_work(PITCH) || at_work(HEADING) || regulator;
        let mut uses = [Use::Needed; CHANNELS];
        uses[VELOCITY] = needed_where(at_work(SURGE), true);
        uses[VELOCITY + 1] = needed_where(at_work(SWAY), at_work(HEAVE) || regulator);
        uses[VELOCITY + 2] = needed_where(false, at_work(HEAVE) || regulator);
        uses[RATES] = needed_where(at_work(ROLL) || regulator, fins && self.file.allocation.fin_inflow);
        uses[RATES + 1] = needed_where(angles, false);
        uses[RATES + 2] = needed_where(angles, false);
        uses[ALTITUDE + 1..].fill(Use::Idle);
        uses
    }
}

impl<T: Real> Autopilot<T> {
    /// How the channels are used.
    pub fn uses(&self) -> &Uses {
        &self.uses
    }

    /// Whether a channel must be measured once, in every lane, before the autopilot begins, and was not.
    pub fn waits_for(&self, measured: &Measurement<T>, channel: usize) -> bool {
        BEGINNING.contains(&GROUP[channel])
            && self.uses[channel] == Use::Needed
            && measured.age[channel].largest() == f64::INFINITY
    }

    /// The groups that an autopilot waits for: of position, depth, attitude and rates every channel that it needs must
    /// have been measured before it begins.
    pub fn waiting_for(&self, measured: &Measurement<T>) -> impl Iterator<Item = &'static str> {
        let lacks = |g: usize| (0..CHANNELS).any(|c| GROUP[c] == g && self.waits_for(measured, c));
        BEGINNING.into_iter().filter(move |&g| lacks(g)).map(|g| GROUP_NAMES[g])
    }
}
