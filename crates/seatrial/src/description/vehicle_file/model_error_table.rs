//! What an identified model left unexplained, as written in the vehicle file: the noise of its navigation filter.
//!
//! Estimated by `seatrial identify` (`python/seatrial/identification/hold_out.py`); read by
//! [`Fitting::noise_of`](crate::control::navigation_filter::Fitting::noise_of).
//!
//! Tests: `tests/files.rs`, `tests/flight/test_navigation.py`.

use crate::toml_file::exactly;
use serde::{Deserialize, Serialize};

/// Two processes: a Gauss–Markov force, and white acceleration.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ModelErrorTable {
    /// Standard deviation of the force in X Y Z and of the moment in K M N, N and N m.
    #[serde(deserialize_with = "exactly")]
    pub force: [f64; 6],
    /// Time constant of the force, s.
    pub force_time_s: f64,
    /// Standard deviation of u v w and p q r after a second of white acceleration, m/s and rad/s.
    #[serde(deserialize_with = "exactly")]
    pub acceleration: [f64; 6],
}
