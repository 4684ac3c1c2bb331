//! The equation of motion, `M ν' + C(ν) ν + D(ν) ν + g(η) = τ`, one term a file.
//!
//! In reading order: [`kinematics`] (attitude, rotation, `η' = J(η) ν`); the terms [`rigid_body`], [`added_mass`],
//! [`damping`], [`cross_flow`], [`tether`], [`lift`] and [`restoring`]; [`current`], the water that moves, and [`surface`], where it ends; [`vehicle`], where they meet the wrench
//! of the actuators; [`integrate`], one step of time; [`drive`], the motors over that step; [`linearize`], the
//! tangent.

pub mod added_mass;
pub mod cross_flow;
pub mod current;
pub mod damping;
pub mod drive;
pub mod integrate;
pub mod kinematics;
pub mod lift;
pub mod linearize;
pub mod restoring;
pub mod rigid_body;
pub mod surface;
pub mod tether;
pub mod vehicle;
