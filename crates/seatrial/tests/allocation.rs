//! Control allocation: the inverse of thrust and lift, the distribution of a wrench and its bounds, hysteresis, failures,
//! number types, and the report of what can be commanded.

#[path = "allocation/distribution.rs"]
mod distribution;
#[path = "allocation/failures.rs"]
mod failures;
#[path = "allocation/fins.rs"]
mod fins;
#[path = "allocation/minimum.rs"]
mod minimum;
#[path = "allocation/quadratic.rs"]
mod quadratic;
#[path = "allocation/report.rs"]
mod report;
#[path = "allocation/setup.rs"]
mod setup;
#[path = "allocation/signals.rs"]
mod signals;
#[path = "allocation/table.rs"]
mod table;
#[path = "support/vehicles.rs"]
mod vehicles;
