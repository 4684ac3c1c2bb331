//! Guidance on a kinematic vehicle: paths, switching, circles, station-keeping, limits, and lanes against `f64`.

#[path = "guidance/altitude.rs"]
mod altitude;
#[path = "guidance/circle.rs"]
mod circle;
#[path = "guidance/hold.rs"]
mod hold;
#[path = "guidance/integral.rs"]
mod integral;
#[path = "guidance/limits.rs"]
mod limits;
#[path = "guidance/line.rs"]
mod line;
#[path = "guidance/scalar.rs"]
mod scalar;
#[path = "guidance/switching.rs"]
mod switching;
#[path = "guidance/table.rs"]
mod table;
#[path = "guidance/turn.rs"]
mod turn;
#[path = "guidance/vessel.rs"]
mod vessel;
