//! Missions: the geometry of patterns and fences, what a file means, and what is refused.

mod expansion;
mod fence;
mod patterns;
mod perimeter;
mod plan;
mod refusals;

use seatrial::mission::plane::Place;
use seatrial::mission::{Mission, Waypoint};

/// A mission of these legs, at 1 m/s with an acceptance of 1 m.
fn mission(legs: &str) -> Mission {
    read(legs).expect("a valid mission")
}

/// The same, or its message.
fn read(legs: &str) -> Result<Mission, String> {
    let top = "format = 1\nname = \"test\"\nspeed_m_s = 1.0\nacceptance_radius_m = 1.0\n";
    Mission::from_toml(&format!("{top}{legs}"), "test.toml").map_err(|error| error.to_string())
}

/// Places of waypoints as seen from above.
fn places(waypoints: &[Waypoint]) -> Vec<Place> {
    waypoints.iter().map(|w| [w.position[0], w.position[1]]).collect()
}
