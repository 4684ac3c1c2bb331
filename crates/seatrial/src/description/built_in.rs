//! The vehicles that come with the core.

/// The embedded vehicles.
const BUILT_IN: [(&str, &str); 6] = [
    ("beluga", include_str!("../../vehicles/beluga.toml")),
    ("bluerov2", include_str!("../../vehicles/bluerov2.toml")),
    ("bluerov2-heavy", include_str!("../../vehicles/bluerov2-heavy.toml")),
    ("cwolf", include_str!("../../vehicles/cwolf.toml")),
    ("lauv", include_str!("../../vehicles/lauv.toml")),
    ("remus100", include_str!("../../vehicles/remus100.toml")),
];

/// Names of the built-in vehicles.
pub fn built_in_names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|(name, _)| *name).collect()
}

/// The file of a built-in vehicle.
pub fn built_in(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}
