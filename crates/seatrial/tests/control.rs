//! Laws of the control loops: schedule, reference filter, PID; what becomes of samples.

#[path = "control/pid.rs"]
mod pid;
#[path = "control/reference_filter.rs"]
mod reference_filter;
#[path = "control/samples.rs"]
mod samples;
#[path = "control/schedule.rs"]
mod schedule;
#[path = "support/vehicles.rs"]
mod vehicles;
