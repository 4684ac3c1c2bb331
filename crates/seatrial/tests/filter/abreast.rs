//! Filters of eight vehicles abreast are eight filters: each with samples, gaps, wild points and a start of its own.

use super::error_state::noise;
use crate::vehicles::load;
use fearless_simd::{Simd, SimdFrom, dispatch, f64x8};
use seatrial::control::navigation::Measurement;
use seatrial::control::navigation_filter::{Fitting, Instrument, KINDS, NavigationFilter, Told};
use seatrial::description::Description;
use seatrial::filter::estimate::STATES;
use seatrial::filter::innovation::Gate;
use seatrial::number::lanes::{LANES, available_levels};

const STEPS: usize = 260;
const ATTITUDE: usize = 4;
const DVL: usize = 5;

fn fitting(description: &Description) -> Fitting {
    let mut instruments = [Some(Instrument::of(0.02)); KINDS.len()];
    for late in [DVL, 7] {
        instruments[late].as_mut().expect("one of each kind").latency = 0.1;
    }
    instruments[ATTITUDE].as_mut().expect("one of each kind").bias = 0.004;
    Fitting {
        instruments,
        landmarks: Vec::new(),
        bottom: None,
        swell: None,
        noise: Fitting::noise_of(description, &instruments, false),
        gate: Gate { threshold: 25.0, patience: 2.0 },
        start: ([0.0; 3], 1.0),
        period: 0.1,
        longest_age: 0.0,
    }
}

/// What a vehicle measures of a channel at a step; not a number where it does not.
fn shown(lane: usize, k: usize, channel: usize) -> f64 {
    // It is switched on at a time of its own, and its Doppler log goes silent now and then.
    let silent = (6..9).contains(&channel) && (k / 10 + lane).is_multiple_of(5);
    if k < 3 * lane || silent {
        return f64::NAN;
    }
    // One sees wild points, one an attitude that jumps for good, and one is lost.
    let wild = if lane == 3 && channel == 6 && k.is_multiple_of(17) { 5.0 } else { 0.0 };
    let jump = if lane == 5 && channel == 5 && k > 120 { 1.0 } else { 0.0 };
    let lost = if lane == 6 && channel == 11 && k == 150 { 1e200 } else { 0.0 };
    0.02 * noise(1000 * lane + 16 * k + channel) + wild + jump + lost
}

/// The channels that arrive at a step.
fn channels(k: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (3..6).chain(9..12).collect();
    if k.is_multiple_of(2) {
        all.extend([2, 6, 7, 8]);
    }
    if k.is_multiple_of(10) {
        all.extend([0, 1, 13, 14, 15]);
    }
    all
}

/// Told channels, deviations, and per watch taken, refused and recovered, at the end.
type End = (Vec<f64>, Vec<f64>, Vec<[f64; 3]>);

fn alone(description: &Description, lane: usize) -> End {
    let mut filter = NavigationFilter::new(description, fitting(description));
    let commands: Vec<f64> = description.actuators.iter().map(|a| 0.02 * a.limits.maximum[0]).collect();
    for k in 0..STEPS {
        let samples: Vec<Told> = channels(k).into_iter().map(|c| (c, shown(lane, k, c), 0.0)).collect();
        filter.step(&samples, (&commands, None), (14.8, 0.1));
    }
    let told = filter.told(&Measurement::nothing(0.0));
    let deviations = (0..STATES).map(|i| filter.tracker().state().deviation(i)).collect();
    let counts = filter.watches().iter().map(|w| [w.taken, w.refused, w.recovered]).collect();
    (told.channels.into(), deviations, counts)
}

#[inline(always)]
fn abreast<S: Simd>(simd: S, description: &Description) -> Vec<End> {
    let of = |read: &dyn Fn(usize) -> f64| f64x8::simd_from(simd, std::array::from_fn::<f64, LANES, _>(read));
    let unit = simd.splat_f64x8(0.0);
    let mut filter = NavigationFilter::new_in(description, fitting(description), unit);
    let commands: Vec<_> =
        description.actuators.iter().map(|a| simd.splat_f64x8(0.02 * a.limits.maximum[0])).collect();
    for k in 0..STEPS {
        let samples: Vec<_> =
            channels(k).into_iter().map(|c| (c, of(&|lane| shown(lane, k, c)), 0.0)).collect();
        filter.step(&samples, (&commands, None), (14.8, 0.1));
    }
    let told = filter.told(&Measurement::nothing(unit));
    (0..LANES)
        .map(|lane| {
            let deviations = (0..STATES).map(|i| filter.tracker().state().deviation(i)[lane]).collect();
            let counts = filter
                .watches()
                .iter()
                .map(|w| [w.taken[lane], w.refused[lane], w.recovered[lane]])
                .collect();
            (told.channels.iter().map(|x| x[lane]).collect(), deviations, counts)
        })
        .collect()
}

#[test]
fn law_filters_abreast_are_filters_of_their_own() {
    let description = load("cwolf");
    let single: Vec<End> = (0..LANES).map(|lane| alone(&description, lane)).collect();
    let (_, level) = available_levels()[0];
    let eight = dispatch!(level, simd => abreast(simd, &description));
    for lane in 0..LANES {
        assert_eq!(eight[lane].2, single[lane].2, "vehicle {lane}: what was taken");
        for (found, expected) in [(&eight[lane].0, &single[lane].0), (&eight[lane].1, &single[lane].1)] {
            for (i, (x, y)) in found.iter().zip(expected).enumerate() {
                // Fused products over 260 steps.
                assert!(x == y || (x - y).abs() < 1e-9 * (1.0 + y.abs()), "vehicle {lane}, {i}: {x} {y}");
            }
        }
    }
    let refused = |lane: usize, channel: usize| single[lane].2[channel][1];
    assert!(refused(3, 6) > 0.0, "wild points are refused");
    assert!(single[5].2[5][2] > 0.0, "a lasting jump is believed in the end");
    assert!(refused(0, 6) == 0.0, "and nothing else is");
}
