//! All number types agree: lanes of every instruction set of this processor with `f64`, dual numbers with
//! finite differences, and a candidate's result depends on nothing but the candidate and the trial.

#[path = "scalars/candidates.rs"]
mod candidates;
#[path = "scalars/criterion.rs"]
mod criterion;
#[path = "scalars/dual.rs"]
mod dual;
#[path = "scalars/elementary.rs"]
mod elementary;
#[path = "scalars/flights.rs"]
mod flights;
#[path = "scalars/instruction_sets.rs"]
mod instruction_sets;
#[path = "scalars/model.rs"]
mod model;
#[path = "scalars/nuisances.rs"]
mod nuisances;
#[path = "scalars/played_motors.rs"]
mod played_motors;
#[path = "scalars/population.rs"]
mod population;
#[path = "scalars/sensitivities.rs"]
mod sensitivities;
#[path = "scalars/tangent.rs"]
mod tangent;
#[path = "support/vehicles.rs"]
mod vehicles;
