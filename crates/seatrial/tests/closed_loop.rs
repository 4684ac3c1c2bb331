//! Closed loop: flights of whole vehicles, alone and side by side, with sensors, faults and safety.

#[path = "closed_loop/batch.rs"]
mod batch;
#[path = "closed_loop/flights.rs"]
mod flights;
#[path = "closed_loop/instruction_sets.rs"]
mod instruction_sets;
#[path = "closed_loop/modes.rs"]
mod modes;
#[path = "closed_loop/random.rs"]
mod random;
#[path = "closed_loop/safety.rs"]
mod safety;
#[path = "closed_loop/sensors.rs"]
mod sensors;
#[path = "closed_loop/set_points.rs"]
mod set_points;
#[path = "closed_loop/turbulence.rs"]
mod turbulence;
#[path = "support/vehicles.rs"]
mod vehicles;
