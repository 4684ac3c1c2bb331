//! One step of vehicle or autopilot as a program for elsewhere: recorded, reduced, written as C.
//!
//! In reading order: [`program`], what is recorded with its interface, evaluated and counted; [`vehicle`] and
//! [`autopilot`], whose steps are recorded; [`c`], the program as C99; [`filter`], the navigation filter as C99, whose motors
//! and equation of motion are recorded and whose matrix algebra is loops.
//!
//! The step that is recorded is the one that flies: [`crate::flight`] and [`crate::control::autopilot`] run on
//! [`Traced`](crate::number::traced::Traced) numbers. Tests: `tests/export.rs`, `tests/export/test_c.py`.

pub mod autopilot;
pub mod c;
pub mod filter;
pub mod program;
pub mod vehicle;
