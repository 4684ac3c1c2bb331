//! What an identification asks of the model: recorded commands in, distance from the measurements out.
//!
//! [`observation`] says what instruments show of a motion; [`criterion`] compares it with what was measured;
//! [`open_loop`] runs the model through a record, alone, for many candidates or with exact sensitivities.

pub mod criterion;
pub mod observation;
pub mod open_loop;
