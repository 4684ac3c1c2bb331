//! All number types agree: lanes of every instruction set of this processor with `f64`, dual numbers with
//! finite differences, and a candidate's result depends on nothing but the candidate and the trial.

mod candidates;
mod criterion;
mod dual;
mod elementary;
pub mod flights;
mod instruction_sets;
mod jet;
mod model;
mod nuisances;
mod plain;
mod played_motors;
mod population;
mod sensitivities;
mod tangent;
