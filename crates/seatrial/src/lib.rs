//! seatrial: six-degree-of-freedom model, actuators and batch simulation of underwater vehicles.
//!
//! Reading order: [`vehicle`] is the equation of motion; each of its terms is a file
//! ([`rigid_body`], [`added_mass`], [`damping`], [`lift`], [`restoring`], [`current`], [`actuator`]);
//! [`integrate`] steps it; [`open_loop`] runs it through recorded commands, alone or in batches;
//! [`criterion`] compares it with what [`observation`] says that instruments show; [`linearize`] is its tangent; [`description`] reads a vehicle from its file.
//!
//! SI and radians throughout; frames n = north-east-down, b = forward-starboard-down with origin O.

pub mod actuator;
pub mod added_mass;
pub mod algebra;
pub mod allocation;
pub mod autopilot;
pub mod closed_loop;
pub mod coefficients;
pub mod control_law;
pub mod criterion;
pub mod current;
pub mod damping;
pub mod description;
pub mod error;
pub mod facts;
pub mod geometry;
pub mod guidance;
pub mod integrate;
pub mod kinematics;
pub mod lift;
pub mod linearize;
pub mod lqr;
pub mod mission;
pub mod navigation;
pub mod observation;
pub mod open_loop;
pub mod pid;
pub mod random;
pub mod real;
pub mod reference_filter;
pub mod restoring;
pub mod rigid_body;
pub mod safety;
pub mod schedule;
pub mod vehicle;
pub mod vehicle_file;

pub use error::Error;
