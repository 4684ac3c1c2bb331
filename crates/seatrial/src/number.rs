//! The numbers with which everything after this is written.
//!
//! [`real`] says what a number can do; `f64` is one. [`dual`] is a value with its partial derivatives;
//! [`elementary`] has sine, arctangent and exponential for eight numbers side by side, and [`lanes`] makes those
//! eight a number. [`plain`] has them for one `f64`, with the same bits on every machine. [`algebra`] has vectors of three and six and their matrices; [`random`] draws numbers that depend
//! on seed and index alone. [`traced`] records what is done with a number, [`slopes`] differentiates the record, and [`memory`] names the numbers that a part
//! of the loop remembers.

pub mod algebra;
pub mod dual;
pub mod elementary;
pub mod jet;
pub mod lanes;
pub mod memory;
pub mod plain;
pub mod random;
pub mod real;
pub mod slopes;
pub mod traced;
