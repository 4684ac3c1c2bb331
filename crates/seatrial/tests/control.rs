//! Laws of the control loops: schedule, reference filter, PID; what becomes of samples.

mod pid;
mod reference_filter;
mod samples;
mod schedule;
