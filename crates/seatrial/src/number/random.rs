//! Random numbers that are functions of a seed, a step and a place, without a state: a candidate's noise depends on
//! nothing but its own seed, whatever its lane, thread and neighbours, and equal seeds share their numbers.
//!
//! Source: Steele, Lea and Flood, *Fast splittable pseudorandom number generators* (2014), the finaliser
//! "variant 13"; Box and Muller (1958). Tests: `tests/closed_loop.rs::law_random_…` (moments, independence).

/// 64 well-mixed bits of a seed (a whole number below 2⁵³), a step and a place.
fn bits(seed: f64, step: usize, place: usize) -> u64 {
    let mut x = seed as u64;
    for word in [step as u64, place as u64] {
        x = mixed(x.wrapping_add(0x9e37_79b9_7f4a_7c15)) ^ word;
    }
    mixed(x.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

fn mixed(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A number evenly distributed over (0, 1).
pub fn uniform(seed: f64, step: usize, place: usize) -> f64 {
    ((bits(seed, step, place) >> 11) as f64 + 0.5) * 2f64.powi(-53)
}

/// A standard normal number.
pub fn gaussian(seed: f64, step: usize, place: usize) -> f64 {
    let bits = bits(seed, step, place);
    let half = |x: u64| (x as u32 as f64 + 0.5) * 2f64.powi(-32);
    let radius = (-2.0 * half(bits).ln()).sqrt();
    radius * (std::f64::consts::TAU * half(bits >> 32)).cos()
}
