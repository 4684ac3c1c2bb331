//! Control allocation in lanes: apart from `tests/allocation.rs`, because every instruction set is compiled.

#[path = "allocation/lanes.rs"]
mod lanes;
#[path = "allocation/setup.rs"]
mod setup;
#[path = "support/vehicles.rs"]
mod vehicles;
