//! Laws of mechanics and of the model's own design that hold for every vehicle (property tests).

#[path = "laws/characteristic.rs"]
mod characteristic;
#[path = "laws/current.rs"]
mod current;
#[path = "laws/energy.rs"]
mod energy;
#[path = "laws/fin.rs"]
mod fin;
#[path = "laws/integration.rs"]
mod integration;
#[path = "laws/kinematics.rs"]
mod kinematics;
#[path = "laws/locked_axes.rs"]
mod locked_axes;
#[path = "laws/motor.rs"]
mod motor;
#[path = "laws/response.rs"]
mod response;
#[path = "laws/structure.rs"]
mod structure;
#[path = "support/vehicles.rs"]
mod vehicles;
