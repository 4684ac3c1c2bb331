//! Control allocation: the inverse of thrust and lift, the distribution of a wrench and its bounds, hysteresis, failures,
//! number types, and the report of what can be commanded.

mod distribution;
mod failures;
mod fins;
mod lanes;
mod minimum;
mod quadratic;
mod report;
mod setup;
mod signals;
mod singular_values;
mod table;
