//! The navigation filter: an error-state extended Kalman filter whose process model is the identified vehicle.
//!
//! In reading order: [`estimate`], the state and its small error; [`transition`], how a step moves that error, and
//! the way back; [`row`](mod@row), how an observation depends on it; [`error_state`], its covariance, with prediction and scalar updates; [`process`], one step of the vehicle with its exact Jacobian, of which
//! `tangent` has the columns; [`observation`], what a sensor shows of a state, with the row of its Jacobian; [`swell`], what waves add to it; [`innovation`], whether a sample is believed; `past`,
//! for samples that come late; [`tracker`], which does all of it step by step.
//!
//! Source: Solà, *Quaternion kinematics for the error-state Kalman filter* (2017), chapters 5 and 6; Farrell, *Aided
//! Navigation* (2008), chapter 5; Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control* (2021),
//! chapter 13.
//! Tests: `tests/filter.rs`.

pub mod error_state;
pub mod estimate;
pub mod innovation;
pub mod observation;
mod past;
pub mod process;
pub mod row;
pub mod swell;
mod tangent;
pub mod tracker;
pub mod transition;
