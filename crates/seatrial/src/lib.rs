//! seatrial: six-degree-of-freedom model, actuators, autopilot and batch simulation of underwater vehicles.
//!
//! SI and radians throughout; frames n = north-east-down, b = forward-starboard-down with origin O.
//!
//! # Reading order
//! A group uses only groups before it in this list, so it can be read from the top; who knows Fossen begins at
//! [`model`] and looks up the rest as it is used. Each group lists its own files in the same way.
//!
//! | group | what it holds |
//! |---|---|
//! | [`error`] | what may go wrong, as one type |
//! | [`ranges`] | what every number, list and name of a file may be |
//! | [`toml_file`] | how a file of the core is read, and what kind of file one is |
//! | [`number`] | the number types (`f64`, eight lanes, dual numbers), algebra, random numbers |
//! | [`actuator`] | from a command to a force: motor, characteristic of a thruster, fin |
//! | [`model`] | the equation of motion, each term a file; one step of time; the tangent |
//! | [`description`] | where its constants come from: vehicle file, geometry, coefficients, actuators placed |
//! | [`filter`] | the navigation filter: the vehicle as process model, its covariance, what sensors show |
//! | [`fit`] | recorded commands through the model, and the distance from what was measured |
//! | [`mission`] | the mission file and the waypoints that it means |
//! | [`control`] | the autopilot: navigation, guidance, control laws, allocation, safety |
//! | [`flight`] | the loop closed: vehicle, sensors and autopilot fly missions, alone or in batches |
//! | [`export`] | a step of vehicle or autopilot as a straight-line program, written as C |

// Lanes are not compiled there, and much of what feeds them is then unused.
#![cfg_attr(target_arch = "wasm32", allow(dead_code, unused_variables))]

pub mod actuator;
pub mod control;
pub mod description;
pub mod error;
pub mod export;
pub mod filter;
pub mod fit;
pub mod flight;
pub mod mission;
pub mod model;
pub mod number;
pub mod ranges;
pub mod toml_file;

pub use error::Error;
