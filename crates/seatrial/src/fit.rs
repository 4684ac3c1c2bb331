//! What an identification asks of the model: recorded commands in, distance from the measurements out.
//!
//! In reading order: [`record`], a trial as the model sees it, and [`inputs`], how it is made of what users give;
//! [`motors`], the actuators on a record; [`observation`], what instruments show of a motion; [`criterion`], the
//! distance from what was measured; [`open_loop`], one vehicle through one segment; [`divergence`], why a run is none; [`batch`], candidates × segments ×
//! threads; [`sensitivities`], the same with exact derivatives; [`innovations`], what a filter predicts with a noise model.

pub mod batch;
pub mod criterion;
pub mod divergence;
pub mod innovations;
pub mod inputs;
pub mod motors;
pub mod observation;
pub mod open_loop;
pub mod record;
pub mod sensitivities;
mod variations;
