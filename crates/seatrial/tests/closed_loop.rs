//! Closed loop: flights of whole vehicles, alone and side by side, with sensors, faults and safety.

mod batch;
mod drift;
pub mod flights;
mod instruction_sets;
mod modes;
mod random;
mod safety;
mod sensors;
mod set_points;
mod turbulence;
mod waves;
