//! The evidence of the core in one binary: the physics in lanes, dual numbers and plain numbers is compiled once for all.

#![cfg(test)]

#[macro_use]
#[path = "support/property.rs"]
mod property;

mod allocation;
mod ardusub;
mod closed_loop;
mod control;
mod cwolf;
mod export;
mod files;
mod filter;
mod golden;
mod guidance;
mod laws;
mod literature;
mod lqr;
mod mission;
mod order;
#[path = "support/processor.rs"]
mod processor;
mod ranges;
mod scalars;
#[path = "support/vehicles.rs"]
mod vehicles;
