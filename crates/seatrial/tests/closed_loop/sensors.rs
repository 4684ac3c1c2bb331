//! The sensors of a simulated vehicle.

use seatrial::control::navigation::{
    CHANNELS, ChannelErrors, GroupTiming, Navigation, Outage, Sensors, truth,
};
use seatrial::model::current::Current;
use seatrial::model::integrate::State;

const DT: f64 = 0.1;

fn ramp(k: usize) -> [f64; CHANNELS] {
    std::array::from_fn(|c| {
        if c == 5 {
            (0.05 * k as f64 + 3.1).rem_euclid(std::f64::consts::TAU)
        } else {
            k as f64 + 100.0 * c as f64
        }
    })
}

#[test]
fn law_sensors_sample_late_and_seldom_as_they_are_told() {
    let mut sensors = Sensors::default();
    sensors.timing[0] = GroupTiming { every: 5, latency: 3, ..GroupTiming::default() };
    let mut navigation = Navigation::new(&sensors, 0.0, &[]);
    for k in 0..40 {
        let shown = navigation.sample(ramp(k), (k, DT));
        assert_eq!(shown.channels[2], ramp(k)[2], "depth is sampled at once");
        match k {
            0..3 => assert_eq!(shown.channels[0], 0.0, "the place of the launch is known"),
            _ => {
                let sampled = (k - 3) / 5 * 5;
                assert_eq!(shown.channels[0], ramp(sampled)[0], "step {k}");
                assert!((shown.age[0] - (k - sampled) as f64 * DT).abs() < 1e-12, "step {k}"); // sums of 0.1
            }
        }
    }
}

#[test]
fn law_sensors_are_silent_in_an_outage_and_grow_old() {
    let outages = vec![Outage { group: 3, from: 1.0, until: 2.0 }];
    let sensors = Sensors { outages, ..Sensors::default() };
    let mut navigation = Navigation::new(&sensors, 0.0, &[]);
    for k in 0..30 {
        let shown = navigation.sample(ramp(k), (k, DT));
        let out = (10..20).contains(&k);
        assert_eq!(shown.age[7] > 0.0, out, "step {k}");
        if out {
            assert_eq!(shown.channels[7], ramp(9)[7], "held at step {k}");
        }
    }
}

#[test]
fn law_sensors_drop_out_as_often_and_as_long_as_they_are_told() {
    let mut sensors = Sensors::default();
    sensors.timing[3] = GroupTiming { dropout_every: 20.0, dropout: 2.0, ..GroupTiming::default() };
    let mut navigation = Navigation::new(&sensors, 5.0, &[]);
    let steps = 200_000;
    let silent = (0..steps).filter(|&k| navigation.sample(ramp(k), (k, DT)).age[7] > 0.0).count();
    // Drop-outs that begin at the rate 1/20 s and last 2 s on average cover 1 − exp(−0.1) of the time, those of a
    // period or less round up or down; 1000 drop-outs tell the share to 3 %.
    let share = silent as f64 / steps as f64;
    assert!((share - (1.0 - (-0.1f64).exp())).abs() < 0.012, "{share}");
}

#[test]
fn law_sensors_noise_bias_and_digits_have_their_size() {
    let mut sensors = Sensors::default();
    sensors.errors[6] = ChannelErrors { noise: 0.2, ..ChannelErrors::default() };
    sensors.errors[7] = ChannelErrors { bias: 0.3, ..ChannelErrors::default() };
    sensors.errors[8] = ChannelErrors { quantum: 0.25, ..ChannelErrors::default() };
    sensors.errors[0] = ChannelErrors { drift: 0.1, ..ChannelErrors::default() };
    let flat = [0.4; CHANNELS];
    let n = 20_000;
    let mut navigation = Navigation::new(&sensors, 3.0, &[]);
    let (mut sum, mut square) = (0.0, 0.0);
    for k in 0..n {
        let shown = navigation.sample(flat, (k, DT));
        sum += shown.channels[6] - 0.4;
        square += (shown.channels[6] - 0.4).powi(2);
        assert_eq!(shown.channels[8], 0.5);
        assert_eq!(shown.channels[1], 0.4, "no error was asked for");
    }
    assert!((sum / n as f64).abs() < 5.0 * 0.2 / (n as f64).sqrt());
    assert!(((square / n as f64).sqrt() - 0.2).abs() < 5.0 * 0.2 / (2.0 * n as f64).sqrt());
    let runs = 2_000;
    let of = |channel: usize, steps: usize| -> f64 {
        let squares = (0..runs).map(|seed| {
            let mut navigation = Navigation::new(&sensors, f64::from(seed), &[]);
            let mut last = 0.0;
            for k in 0..steps {
                last = navigation.sample(flat, (k, DT)).channels[channel];
            }
            (last - 0.4).powi(2)
        });
        (squares.sum::<f64>() / f64::from(runs)).sqrt()
    };
    // One offset per run; a walk of 0.1 per root second over 10 s.
    assert!((of(7, 2) - 0.3).abs() < 5.0 * 0.3 / (2.0 * f64::from(runs)).sqrt());
    assert!((of(0, 100) - 0.1 * 10f64.sqrt()).abs() < 5.0 * 0.32 / (2.0 * f64::from(runs)).sqrt());
}

/// Offsets that are given take the place of drawn ones and of nothing else.
#[test]
fn law_sensors_have_the_offsets_that_are_given() {
    let mut sensors = Sensors::default();
    sensors.errors[0] = ChannelErrors { bias: 0.3, noise: 0.01, ..ChannelErrors::default() };
    sensors.errors[7] = ChannelErrors { bias: 0.2, ..ChannelErrors::default() };
    let mut deviations = [0.0; 16];
    (deviations[0], deviations[7]) = (2.0, -1.5);
    let mut drawn = Navigation::new(&sensors, 9.0, &[]);
    let mut given = Navigation::new(&sensors, 9.0, &[]).with_offsets(Some(&deviations));
    let mut none = Navigation::new(&sensors, 9.0, &[]).with_offsets(None);
    for k in 0..20 {
        let [a, b, c] = [&mut drawn, &mut given, &mut none].map(|n| n.sample(ramp(k), (k, 0.1)).channels);
        assert_eq!(a, c, "step {k}");
        assert!((b[7] - ramp(k)[7] + 0.3).abs() < 1e-12, "step {k}"); // rounding
        let noise = b[0] - ramp(k)[0] - 0.6;
        assert!(noise.abs() < 0.05, "step {k}: the noise stays, {noise}"); // five deviations of 0.01
    }
}

#[test]
fn law_sensors_see_ground_and_water_apart() {
    // Heading east: a current to the north comes from starboard to port.
    let turned = seatrial::model::kinematics::from_euler(&[0.0, 0.0, std::f64::consts::FRAC_PI_2]);
    let state = State { position: [1.0, 2.0, 3.0], attitude: turned, nu: [1.5, 0.0, 0.0, 0.0, 0.0, 0.0] };
    let current = Current { velocity: [0.4, 0.0, 0.0], rate: [0.0; 3], pressed: None };
    let shown = truth(&state, Some(&current), Some(&[20.0, 0.5, 0.0]));
    assert!((shown[13] - 1.5).abs() < 1e-12 && (shown[14] - 0.4).abs() < 1e-12, "{shown:?}"); // rounding
    assert!((shown[12] - (20.0 + 0.5 - 3.0)).abs() < 1e-12, "depth 20 m, falling 0.5 m per metre north");
    assert!((shown[5] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
}

/// An outage of all cases is the same as one of a case: from its first period to its last, while the walk goes on.
#[test]
fn law_sensors_outages_of_all_cases_are_those_of_each() {
    // Multiples of 0.03 s come out a rounding below what the outage says.
    let dt = 0.03;
    let (from, until) = (1.11, 5.28);
    let mut sensors = Sensors::default();
    sensors.errors[0] = ChannelErrors { drift: 0.1, ..ChannelErrors::default() };
    let silent = Sensors { outages: vec![Outage { group: 0, from, until }], ..sensors.clone() };
    let own = [(0, [from, until])];
    let mut of_all = Navigation::new(&silent, 4.0, &[]);
    let mut of_each = Navigation::new(&sensors, 4.0, &own);
    let mut without = Navigation::new(&sensors, 4.0, &[]);
    for k in 0..250 {
        let [a, b, c] = [&mut of_all, &mut of_each, &mut without].map(|n| *n.sample(ramp(k), (k, dt)));
        assert_eq!(a.channels[0], b.channels[0], "step {k}");
        assert_eq!(a.age[0], b.age[0], "step {k}");
        let out = (37..176).contains(&k);
        assert_eq!(a.age[0] > 0.0, out, "step {k}");
        assert!(out || a.channels[0] == c.channels[0], "the walk goes on while nobody looks: step {k}");
    }
}

#[test]
fn law_sensors_know_the_place_of_the_launch_whatever_goes_silent_there() {
    let mut sensors = Sensors::default();
    // A drop-out begins in every period.
    sensors.timing[2] = GroupTiming { dropout_every: DT, dropout: 1e3, ..GroupTiming::default() };
    sensors.outages = vec![Outage { group: 0, from: 0.0, until: 1.0 }];
    let own = [(1, [0.0, 2.0])];
    let mut navigation = Navigation::new(&sensors, 1.0, &own);
    let launch = ramp(0);
    for k in 0..8 {
        let shown = *navigation.sample(ramp(k), (k, DT));
        assert!(shown.age.iter().all(|age| age.is_finite()), "step {k}");
        for channel in [0, 2, 5] {
            assert_eq!(shown.channels[channel], launch[channel], "step {k}");
            assert!((shown.age[channel] - k as f64 * DT).abs() < 1e-12, "step {k}"); // sums of 0.1
        }
        assert_eq!(shown.channels[6], ramp(k)[6], "what is not silent goes on");
    }
}
