//! Laws of mechanics and of the model's own design that hold for every vehicle (property tests).

mod characteristic;
mod cross_flow;
mod current;
mod energy;
mod fin;
mod integration;
mod kinematics;
mod locked_axes;
mod motor;
mod response;
mod structure;
mod surface;
mod tether;
