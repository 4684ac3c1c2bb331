//! What the autopilot watches, and what it does then: go on, hold, surface or abort.
//!
//! | watch | true when |
//! |---|---|
//! | `stale_position` … `stale_altitude` | no good sample for so many seconds of one of the group's channels in use |
//! | `depth`, `altitude`, `fence`, `time` | a limit of the mission is passed |
//! | `battery` | less than the share is left |
//! | `actuator` | an actuator does not follow its command, by its signal or by the motion ([`crate::control::isolation`]) |
//! | `progress` | the active waypoint has come no nearer for so many seconds |
//! | `contradicted_position` … `contradicted_velocity` | the sensors tell of two motions ([`crate::control::contradiction`]) |
//! | `speed` | the measured forward speed has stayed away from the desired one |
//! | `unread` | a channel that nothing reads, or the battery, has fallen silent |
//! | `ascent` | the reaction *surface* has brought the vehicle no higher |
//!
//! The reactions are ordered, hold < surface < abort. The strongest that was called for stays: a vehicle that turns
//! back at a limit must not take up its mission again. What a contradiction called for is left when that is over
//! ([`Thresholds::over_after_s`]), unless the vehicle has surfaced, and the operator's reset leaves everything
//! ([`Alert::reset`]): the mission goes on where it was interrupted. *Hold* keeps the station, or circles where the vehicle cannot;
//! *surface* comes up under control; *abort* stops all actuators and lets buoyancy bring the vehicle up.
//!
//! A watch that calls for nothing, or does not yet, is told all the same: as a cause without a reaction, for as long as it
//! is true. Stale channels are told after [`TOLD_S`] at the latest, contradictions at once. The reaction to a contradiction is that of the stale
//! group: a depth that cannot be right is no depth. Depth and fence are held against both that contradict each other, and
//! the worse counts. Who surfaces by a depth that is contradicted goes up whatever it shows. Where *surface* does not work,
//! the vehicle aborts, if that is what its file lets it do without a depth: one that is heavier than water would sink.
//!
//! Every channel grows old by itself: yaw that is lost while roll and pitch arrive is stale attitude. Which channels are
//! in use says [`crate::control::autopilot::channels`]. Samples that jump and
//! sensors that repeat one value grow old too ([`crate::control::screen`]). A limit must be passed for a second, since one
//! sample may be wrong.
//!
//! Where a navigation filter tells the depth, the limit is held against the depth sensor's own sample as well, and the
//! deeper of the two counts: to a filter that knows of a sea the waves are noise, and the vehicle still goes that deep.
//! The altitude is the sensor's own in any case.
//!
//! In reading order: [`table`], what users set; [`watches`], which of them are true; [`reactions`], what follows;
//! [`watch`], one look.
//!
//! Tests: `tests/closed_loop/safety.rs` (each watch, each reaction).
pub mod reactions;
pub mod table;
pub mod watches;

use crate::control::navigation::Measurement;
use crate::number::real::Real;
pub use reactions::Alert;
use serde::{Deserialize, Serialize};
pub use table::{ActuatorWatch, Battery, SafetyTable, SpeedWatch, Stale};
pub use watches::{Approach, Circumstances, Sounded};

/// What is done when a watch is true, in rising order.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, PartialEq, Eq, PartialOrd, Ord)]
#[serde(rename_all = "lowercase")]
pub enum Reaction {
    /// The mission goes on.
    #[default]
    Continue,
    /// Station-keeping, or a circle.
    Hold,
    /// Up to the surface under control.
    Surface,
    /// All actuators stop.
    Abort,
}

/// The names of the reactions by their level.
pub const REACTIONS: [&str; 4] = ["continue", "hold", "surface", "abort"];

/// The number of watches.
pub const WATCHES: usize = 20;

/// The number of watches over the age of a group's channels, which are the first.
const STALE: usize = 6;

/// The names of the watches; cause `i + 1` is watch `i`, cause 0 is none.
pub const WATCH_NAMES: [&str; WATCHES] = [
    "stale_position",
    "stale_depth",
    "stale_attitude",
    "stale_velocity",
    "stale_rates",
    "stale_altitude",
    "depth",
    "altitude",
    "fence",
    "time",
    "battery",
    "actuator",
    "progress",
    "contradicted_position",
    "contradicted_depth",
    "contradicted_attitude",
    "contradicted_velocity",
    "speed",
    "unread",
    "ascent",
];

/// The first watch over contradictions, and the channels of each of the four.
const CONTRADICTED: usize = 13;
const OF_CONTRADICTED: [std::ops::Range<usize>; 4] = [0..2, 2..3, 3..6, 6..9];

/// The watches behind them.
const SPEED: usize = 17;
const UNREAD: usize = 18;
const ASCENT: usize = 19;

/// The number that stands for a contradicted depth as the cause of an alert.
pub const CONTRADICTED_DEPTH: f64 = (CONTRADICTED + 2) as f64;

/// The alert after one more look.
#[inline(always)]
pub fn watch<T: Real>(
    table: &SafetyTable,
    alert: &Alert<T>,
    measured: &Measurement<T>,
    around: &Circumstances<'_, T>,
) -> Alert<T> {
    let seen = watches::look(table, alert, measured, around);
    alert.after(table, seen, around)
}
