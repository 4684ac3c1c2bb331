//! The control law of ArduSub: what the autopilot that most underwater robots of the world carry does with a target.
//!
//! In the order of the signal: [`shaping`], from an attitude asked for to a target that moves there; [`attitude`], from
//! a target to turn rates; [`position`], from a depth or place
//! wanted to an acceleration, and from there to throttle, forward and lateral; [`pid`], the controllers of both;
//! [`mixer`], from six demands to pulse widths; [`parameters`], their names, units and defaults; [`cascade`], all of it
//! together, once per control period. Names of parameters, their units and what they do are ArduSub's own.
//!
//! Source: structure, formulas and parameter names as facts from ArduPilot's documentation ("Attitude control",
//! "Position controllers", "Sub frame configurations", complete parameter list); every line is written here. What it
//! is held against are logs: a recorded dive gives targets, measurements, terms and pulses of every controller.
//! Tests: `tests/ardusub.rs` (laws), `tests/ardusub/test_replay.py` (a recorded dive).

pub mod attitude;
pub mod cascade;
pub mod mixer;
pub mod parameters;
pub mod pid;
pub mod position;
pub mod shaping;
