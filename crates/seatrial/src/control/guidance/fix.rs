//! What guidance is told of the vehicle.

use crate::number::algebra::Vec3;

/// Where the vehicle is and how it moves, as the navigation says.
#[derive(Clone, Copy, Debug)]
pub struct Fix<T> {
    /// North, east, depth, m.
    pub position: Vec3<T>,
    /// Altitude above the bottom, m; not a number or infinite without bottom lock.
    pub altitude: T,
    /// Roll, pitch, yaw, rad.
    pub attitude: Vec3<T>,
    /// Velocity over ground in the body frame, m/s.
    pub velocity: Vec3<T>,
}
