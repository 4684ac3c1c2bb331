//! Guidance on a kinematic vehicle: paths, switching, circles, station-keeping, limits, and lanes against `f64`.

mod altitude;
mod circle;
mod hold;
mod integral;
mod limits;
mod line;
mod scalar;
mod switching;
mod table;
mod turn;
mod vessel;
