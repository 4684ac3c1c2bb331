//! Waves are those of linear theory: spectrum, decay with depth, dispersion, encounter, and what a vehicle meets of them.

use crate::closed_loop::flights::{Trip, case, column};
use seatrial::flight::waves::{COMPONENTS, Harmonic, Sea, jonswap, orbital};
use seatrial::model::kinematics::{from_euler, rotation};
use std::f64::consts::TAU;

const G: f64 = 9.81;
const SEA: Sea = Sea { height: 0.8, period: 7.0, toward: 0.6, spreading: 0.0, peakedness: 3.3 };

/// Variance of the velocity along the waves at a depth, from the harmonics.
fn variance(waves: &[Harmonic<f64>], depth: f64) -> f64 {
    waves.iter().map(|h| 0.5 * (h.speed * (-h.number * depth).exp()).powi(2)).sum()
}

/// The same of linear theory, by a sum of its own over the spectrum.
fn theory(sea: &Sea, depth: f64) -> f64 {
    let omega_p = TAU / sea.period;
    let (mut energy, mut square) = (0.0, 0.0);
    for i in 0..20_000 {
        let x = 0.5 + 2.5 * (f64::from(i) + 0.5) / 20_000.0;
        let (s, omega) = (jonswap(x, sea.peakedness), x * omega_p);
        energy += s;
        square += s * omega * omega * (-2.0 * omega * omega / G * depth).exp();
    }
    sea.height * sea.height / 16.0 * square / energy
}

#[test]
fn law_waves_have_the_height_of_their_sea_for_every_seed() {
    for (seed, peakedness) in [(0.0, 1.0), (1.0, 3.3), (2.0, 7.0)] {
        let waves = Sea { peakedness, ..SEA }.harmonics(seed, G);
        assert_eq!(waves.len(), COMPONENTS);
        let elevation: f64 = waves.iter().map(|h| 0.5 * (h.speed / h.omega).powi(2)).sum();
        // H_s is four standard deviations; the sum of shares is one but for rounding.
        assert!((4.0 * elevation.sqrt() - SEA.height).abs() < 1e-12, "{}", 4.0 * elevation.sqrt());
        assert!(waves.iter().all(|h| (h.number * G - h.omega * h.omega).abs() < 1e-12), "dispersion");
    }
    assert!(Sea::CALM.harmonics(1.0, G).is_empty());
}

#[test]
fn law_orbital_velocity_fades_with_depth_as_the_spectrum_says() {
    for (period, peakedness) in [(5.0, 3.3), (7.0, 3.3), (10.0, 1.0)] {
        let sea = Sea { period, peakedness, ..SEA };
        let seas: Vec<_> = (0..400).map(|seed| sea.harmonics(f64::from(seed), G)).collect();
        for depth in [0.0, 2.0, 5.0, 15.0] {
            let found = seas.iter().map(|w| variance(w, depth)).sum::<f64>() / 400.0;
            let wanted = theory(&sea, depth);
            // The frequency within a stratum is drawn: 400 seeds leave less than a per cent.
            assert!((found / wanted - 1.0).abs() < 0.01, "{period} s, {depth} m: {found} {wanted}");
            // A single seed is no more than a third off, also where the shortest waves have gone.
            let worst = seas.iter().map(|w| (variance(w, depth) / wanted - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < 0.4, "{period} s, {depth} m: {worst}");
        }
    }
}

#[test]
fn law_waves_are_water_without_sources_or_whirls() {
    let waves = Sea { spreading: 0.4, ..SEA }.harmonics(3.0, G);
    let (place, time, h) = ([12.0, -7.0, 3.0], 41.0, 1e-4);
    let slope = |axis: usize| -> [f64; 3] {
        let at = |step: f64| {
            let mut moved = place;
            moved[axis] += step;
            orbital(&waves, &moved, time).velocity
        };
        let (ahead, behind) = (at(h), at(-h));
        std::array::from_fn(|i| (ahead[i] - behind[i]) / (2.0 * h))
    };
    let [by_x, by_y, by_z] = [slope(0), slope(1), slope(2)];
    // Central differences of a velocity of 0.3 m/s over 0.1 mm are good to 1e-8.
    assert!((by_x[0] + by_y[1] + by_z[2]).abs() < 1e-7, "divergence");
    for whirl in [by_y[2] - by_z[1], by_z[0] - by_x[2], by_x[1] - by_y[0]] {
        assert!(whirl.abs() < 1e-7, "{whirl}");
    }
    let at = |t: f64| orbital(&waves, &place, t);
    for i in 0..3 {
        let rate = (at(time + h).velocity[i] - at(time - h).velocity[i]) / (2.0 * h);
        assert!((rate - at(time).rate[i]).abs() < 1e-7, "the rate of axis {i}");
    }
}

#[test]
fn law_a_vehicle_meets_waves_at_the_frequency_of_encounter() {
    let wave = Harmonic { omega: 1.0, number: 1.0 / G, direction: [1.0, 0.0], phase: 0.3, speed: 0.2 };
    for speed in [-2.0, 0.0, 1.5] {
        let met = wave.omega - wave.number * speed;
        for k in 0..200 {
            let t = 0.5 * f64::from(k);
            let found = orbital(&[wave], &[speed * t, 5.0, 4.0], t).velocity;
            let (sin, cos) = (met * t + wave.phase).sin_cos();
            let size = 0.2 * (-4.0 / G).exp();
            assert!((found[0] - size * cos).abs() + (found[2] - size * sin).abs() < 1e-12, "{speed} {t}");
        }
    }
}

#[test]
fn law_seas_of_other_seeds_are_other_seas() {
    let at = |seed: f64| orbital(&SEA.harmonics(seed, G), &[0.0, 0.0, 1.0], 0.0).velocity;
    assert_eq!(at(5.0), at(5.0));
    // Means of products of 3000 seeds: five standard errors.
    let values: Vec<[f64; 3]> = (0..3000).map(|seed| at(f64::from(seed))).collect();
    let mean = |of: &dyn Fn(usize) -> f64| (0..3000).map(of).sum::<f64>() / 3000.0;
    let size = theory(&SEA, 1.0);
    let ahead = |s: usize| values[s][0] / SEA.toward.cos();
    for (what, found) in [
        ("mean", mean(&ahead) / size.sqrt()),
        ("next seed", mean(&|s| ahead(s) * ahead((s + 1) % 3000)) / size),
        ("quadrature", mean(&|s| ahead(s) * values[s][2]) / size),
        ("variance ahead", mean(&|s| ahead(s).powi(2)) / size - 1.0),
        ("variance down", mean(&|s| values[s][2].powi(2)) / size - 1.0),
    ] {
        assert!(found.abs() < 5.0 * (2.0f64 / 3000.0).sqrt(), "{what}: {found}");
    }
}

#[test]
fn law_a_flight_meets_the_waves_of_its_seed_where_it_is() {
    let mut trip = Trip::cwolf(crate::closed_loop::flights::DIVE);
    trip.seconds = 60.0;
    let mut rough = case([0.2, -0.1, 0.0]);
    rough.sea = SEA;
    // Below the surface, where a hull does not bob faster than the waves.
    rough.state.position[2] = 3.0;
    // A calm neighbour, so that eight lanes fly.
    let flown = trip.fly(&[rough, case([0.0; 3])]).remove(0);
    let of = |names: [&str; 3]| names.map(|name| column(&trip, &flown, name));
    let [ground, water, angles, places] =
        [["u", "v", "w"], ["u_water", "v_water", "w_water"], ["roll", "pitch", "yaw"], ["x", "y", "z"]]
            .map(of);
    let waves = SEA.harmonics(1.0, trip.description.file.environment.g_m_s2);
    for k in 0..ground[0].len() {
        let wanted = orbital(&waves, &places.each_ref().map(|x| x[k]), 0.1 * k as f64).velocity;
        let r = rotation(&from_euler(&angles.each_ref().map(|a| a[k])));
        let drift: [f64; 3] = std::array::from_fn(|i| ground[i][k] - water[i][k]);
        for axis in 0..3 {
            let found: f64 = r[axis].iter().zip(drift).map(|(a, b)| a * b).sum::<f64>();
            // The sea is looked up a period ahead: 0.5 m/s² over 0.1 s is 3 mm, on waves of 0.1 rad/m.
            let apart = (found - [0.2, -0.1, 0.0][axis] - wanted[axis]).abs();
            assert!(apart < 3e-4, "axis {axis}, {k}: {apart}");
        }
    }
}
