//! What is known of a vehicle, and the constants of the equation of motion that follow from it.
//!
//! In reading order: [`coefficients`], the names and their places in one vector; [`geometry`], start values from the
//! shape of the hull, of a box in `box_hull`; [`vehicle_file`], the file as users write it, and [`built_in`](mod@built_in), the files that come with the core;
//! [`placement`], a thruster or fin put in its place; [`values`], the [`Description`] that all of this makes, and
//! [`bounds`] on its coefficients; [`assembly`], from a description to the [`model`](crate::model) for one number type;
//! [`hull`], what of it a surface acts on; [`reading`], where a file is filled and checked, with `missing`, what it lacks; [`facts`], what reports say of a vehicle.

pub mod assembly;
pub mod bounds;
mod box_hull;
pub mod built_in;
pub mod coefficients;
pub mod facts;
pub mod geometry;
pub mod hull;
mod missing;
pub mod placement;
pub mod reading;
pub mod values;
pub mod vehicle_file;

pub use assembly::Structure;
pub use built_in::{built_in, built_in_names};
pub use placement::{ActuatorDescription, Effect};
pub use values::Description;
