//! The autopilot and its parts.
//!
//! In the order of the signal: [`navigation`], what the autopilot is told of the motion; [`navigation_filter`], which
//! makes an estimate of it; [`intake`], the samples of a vehicle at sea; [`screen`], which of them are believed;
//! [`contradiction`], whether these tell of one motion; [`isolation`], which actuator does not do what it is told; [`guidance`], from the plan
//! to desired speed, heading, pitch and depth; [`reference_filter`], which makes them smooth; [`schedule`],
//! interpolation of gains over the speed; [`control_law`], what both laws share; [`pid`] and [`lqr`], the laws;
//! [`allocation`], from the demanded wrench to commands; [`safety`], what is watched meanwhile; [`autopilot`], which
//! runs all of it once per control period. [`ardusub`] is another autopilot's law, as its logs show it.

pub mod allocation;
pub mod ardusub;
pub mod autopilot;
pub mod contradiction;
pub mod control_law;
pub mod guidance;
pub mod intake;
pub mod isolation;
pub mod lqr;
pub mod navigation;
pub mod navigation_filter;
pub mod pid;
pub mod reference_filter;
pub mod safety;
pub mod schedule;
pub mod screen;
