//! The navigation filter: its algebra against dense matrices, its Jacobians against difference quotients, and what its
//! covariance says against what its errors are.

mod consistency;
mod error_state;
mod innovation;
mod observation;
mod process;
mod tracker;
