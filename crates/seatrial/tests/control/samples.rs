//! What becomes of samples: ages, jumps, frozen sensors; and an autopilot under arbitrary ones.

use crate::vehicles::load;
use proptest::prelude::*;
use seatrial::control::allocation::Allocator;
use seatrial::control::autopilot::Autopilot;
use seatrial::control::autopilot::channels::Use;
use seatrial::control::autopilot::settings::{Settings, built_in};
use seatrial::control::contradiction::Thresholds;
use seatrial::control::intake::{Intake, Quantity};
use seatrial::control::navigation::{CHANNELS, GROUP, Measurement};
use seatrial::control::screen::Screen;
use seatrial::mission::Mission;
use std::sync::Arc;

const PERIOD: f64 = 0.1;

/// What a screen makes of the values of one channel beside a motion, one each period.
fn looked(motion: &[(usize, f64)], channel: usize, values: &[f64]) -> Vec<Measurement<f64>> {
    let mut screen = Screen::new(0.0);
    let mut measured = Measurement::nothing(0.0);
    measured.age = [0.0; CHANNELS];
    for &(c, value) in motion {
        measured.channels[c] = value;
    }
    let look = |value: &f64| {
        measured.channels[channel] = *value;
        screen.look(&measured, (2.0, 0.0), &Thresholds::default(), PERIOD);
        *screen.believed()
    };
    values.iter().map(look).collect()
}

#[test]
fn law_screen_a_value_that_must_have_changed_is_as_old_as_it_is() {
    // Sinking at 0.5 m/s; a turn of 0.2 rad/s.
    for (rate, moved, channel, seconds) in [(8, 0.5, 2, 2.5), (11, 0.2, 5, 2.3)] {
        let found = looked(&[(rate, moved)], channel, &[3.0; 60]);
        let first = found.iter().position(|m| m.age[channel] > 0.0).expect("found frozen") as f64 * PERIOD;
        assert!((first - seconds).abs() < 1.0, "channel {channel}: {first} s");
        let last = found.last().expect("some").age[channel];
        assert!((last - 5.9).abs() < 0.11, "{last} s since it began to repeat");
        // What moves alone is not frozen, nor what rests.
        assert!(looked(&[], channel, &[3.0; 600]).iter().all(|m| m.age == [0.0; CHANNELS]));
        let moves: Vec<f64> = (0..60).map(|k| 3.0 + moved * PERIOD * f64::from(k)).collect();
        assert!(looked(&[(rate, moved)], channel, &moves).iter().all(|m| m.age == [0.0; CHANNELS]));
    }
}

#[test]
fn law_screen_an_offset_of_the_rate_does_not_freeze_what_is_right() {
    // A mounting error of 1.5 degrees at 1.8 m/s is 0.047 m/s of sinking that is none.
    assert!(looked(&[(8, 0.047)], 2, &[10.0; 3000]).iter().all(|m| m.age[2] == 0.0));
}

#[test]
fn law_screen_jumps_are_held_until_they_stay() {
    let mut values = [3.0; 60];
    values[10] = 43.0;
    values[30..].fill(43.0);
    let found = looked(&[], 2, &values);
    for (k, measured) in found.iter().enumerate() {
        let held = if k < 30 + 10 { 3.0 } else { 43.0 };
        assert_eq!(measured.channels[2], held, "step {k}");
        assert_eq!(measured.age[2] > 0.0, k == 10 || (30..40).contains(&k), "step {k}");
    }
}

/// What a screen believes of the forward speed at 5 Hz: `before`, then a silence of so many seconds, then `after`.
fn after_a_silence(before: f64, seconds: f64, after: &[f64]) -> Vec<Measurement<f64>> {
    let mut screen = Screen::new(0.0);
    let mut measured = Measurement::nothing(0.0);
    measured.age = [0.0; CHANNELS];
    let mut told = |u: Option<f64>, other: f64| {
        measured.channels[8] = other;
        match u {
            Some(u) => (measured.channels[6], measured.age[6]) = (u, 0.0),
            None => measured.age[6] += PERIOD,
        }
        screen.look(&measured, (2.0, 1.5), &Thresholds::default(), PERIOD);
        *screen.believed()
    };
    for k in 0..20 {
        told((k % 2 == 0).then_some(before), 0.001 * f64::from(k));
    }
    for k in 0..(seconds / PERIOD) as usize {
        let age = told(None, 0.001 * k as f64).age[6];
        assert!(
            (age - PERIOD * (k + 2) as f64).abs() < 1e-9,
            "a silent channel grows old by the time that passes"
        );
    }
    after.iter().map(|u| told(Some(*u), *u)).collect()
}

#[test]
fn law_screen_what_was_silent_is_believed_at_its_first_sample() {
    for seconds in [1.0, 5.0, 13.7, 30.0] {
        // A vehicle that stopped, turned back or came up to speed meanwhile, as far as 5 m/s² let it.
        for (before, now) in [(1.5, 1.51), (1.5, 0.0), (2.5, -2.5), (-1.0, 5.0)] {
            let found = after_a_silence(before, seconds, &[now]);
            assert_eq!(
                (found[0].channels[6], found[0].age[6]),
                (now, 0.0),
                "{seconds} s, {before} to {now} m/s"
            );
        }
    }
}

#[test]
fn law_screen_a_wild_sample_after_a_silence_is_refused_and_the_next_good_one_is_not() {
    for seconds in [0.0, 5.0, 13.7, 30.0] {
        for wild in [20.0, -32.768, 49.0] {
            let found = after_a_silence(1.5, seconds, &[wild, 1.4, 1.3]);
            assert_eq!(found[0].channels[6], 1.5, "{wild} m/s after {seconds} s");
            assert!(found[0].age[6] > seconds, "{wild} m/s after {seconds} s");
            for (measured, good) in found[1..].iter().zip([1.4, 1.3]) {
                assert_eq!((measured.channels[6], measured.age[6]), (good, 0.0), "after {wild} m/s");
            }
        }
    }
}

#[test]
fn law_screen_headings_go_the_shorter_way_round() {
    let values: Vec<f64> =
        (0..200).map(|k| (0.03 * f64::from(k)).sin_cos()).map(|(s, c)| s.atan2(c)).collect();
    assert!(looked(&[(11, 0.3)], 5, &values).iter().all(|m| m.age[5] == 0.0));
}

#[test]
fn law_intake_headings_may_be_unwrapped_and_not_in_degrees() {
    let mut intake = Intake::<f64>::new(0.0);
    let yaw = Quantity::Channel(5);
    for k in 0..1000 {
        intake.elapse(PERIOD);
        intake.take(yaw, 0.05 * f64::from(k));
        assert_eq!(intake.measured().age[5], 0.0, "step {k}");
    }
    let mut intake = Intake::<f64>::new(0.0);
    for (value, good) in [(270.0, false), (1.0, true), (90.0, false), (f64::NAN, false), (1.1, true)] {
        intake.elapse(PERIOD);
        intake.take(yaw, value);
        assert_eq!(intake.measured().age[5] == 0.0, good, "{value}");
    }
    assert_eq!(intake.refused().map(|r| (r.count, r.last)).collect::<Vec<_>>(), [(2.0, 90.0)]);
}

/// What becomes of a channel for a while.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Good,
    Lost,
    Shows(f64),
    Frozen,
    OffBy(f64),
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        3 => Just(Fate::Good),
        2 => Just(Fate::Lost),
        1 => any::<f64>().prop_map(Fate::Shows),
        1 => prop_oneof![Just(270.0), Just(1e4), Just(f64::INFINITY), Just(f64::NAN)].prop_map(Fate::Shows),
        1 => Just(Fate::Frozen),
        1 => (-50.0..50.0).prop_map(Fate::OffBy),
    ]
}

/// For how long, with which interval, what happens to which channel, and how the vehicle moves.
type Act = (u8, f64, usize, Fate, f64);

fn act() -> impl Strategy<Value = Act> {
    (1..60u8, prop_oneof![Just(0.1), Just(0.06), Just(0.4), 0.05..200.0], 0..CHANNELS, fate(), -0.3..0.3)
}

const MISSION: &str = "format = 1\nname = \"m\"\nspeed_m_s = 0.6\nacceptance_radius_m = 2.0\n\
    [[legs]]\nnorth_m = 200.0\neast_m = 90.0\ndepth_m = 8.0\n";

properties! {
    #![cases(60)]

    /// Commands stay possible, and what is in use is not silent for longer than its watch without a reaction.
    #[test]
    fn law_autopilot_bears_any_samples(
        name in prop_oneof![Just("cwolf"), Just("remus100"), Just("bluerov2-heavy"), Just("lauv")],
        acts in proptest::collection::vec(act(), 1..20),
    ) {
        let description = load(name);
        let settings = Arc::new(Settings::from_toml(built_in(name).expect("built in"), name).expect("valid"));
        let mission = Arc::new(Mission::from_toml(MISSION, "m").expect("valid"));
        let autopilot =
            Autopilot::<f64>::new(&settings, &description, &mission, &settings.tunables).expect("fits");
        let allocator =
            Allocator::single(&description, autopilot.model(), &settings.file.allocation).expect("fits");
        let mut state = autopilot.begin(allocator);
        let table = &settings.file.safety;
        let after = [
            table.stale_position, table.stale_depth, table.stale_attitude, table.stale_velocity, table.stale_rates,
        ].map(|stale| stale.after_s);
        let (mut intake, mut fates) = (Intake::<f64>::new(0.0), [Fate::Good; CHANNELS]);
        intake.take(Quantity::Voltage, 14.8);
        let mut truth = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.5, 0.0, 0.0];
        let (mut silent, mut steps) = ([0.0; CHANNELS], 0_u32);
        for (count, dt, channel, fate, turn) in [(1, 0.1, 0, Fate::Good, 0.0)].into_iter().chain(acts) {
            fates[channel] = if let Fate::Frozen = fate { Fate::Shows(truth[channel]) } else { fate };
            for _ in 0..count {
                steps += 1;
                truth[11] = turn;
                truth[5] = (truth[5] + dt * turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                    - std::f64::consts::PI;
                truth[0] += dt * truth[6];
                intake.elapse(dt);
                for c in 0..CHANNELS {
                    silent[c] += dt;
                    // No sensor shows a value twice.
                    let noisy = truth[c] + 1e-4 * f64::from((steps * 7919 + c as u32) % 101);
                    let shown = match fates[c] {
                        Fate::Good => noisy,
                        Fate::OffBy(error) => noisy + error,
                        Fate::Shows(value) => value,
                        Fate::Lost | Fate::Frozen => continue,
                    };
                    if intake.possible(Quantity::Channel(c), shown) {
                        silent[c] = 0.0;
                    }
                    intake.take(Quantity::Channel(c), shown);
                }
                let thought = autopilot.step_after(&mut state, intake.measured(), None, (None, dt));
                for (signal, actuator) in state.signals.iter().zip(&description.actuators) {
                    let [ahead, astern] = actuator.limits.maximum;
                    prop_assert!((-astern - 1e-9..=ahead + 1e-9).contains(signal), "{}: {signal}", actuator.name);
                }
                if thought.alert.level > 0.0 {
                    continue;
                }
                for c in (0..12).filter(|&c| autopilot.uses()[c] != Use::Idle) {
                    prop_assert!(silent[c] <= after[GROUP[c]] + dt, "channel {c}: {} s", silent[c]);
                }
            }
        }
    }
}

/// A reading of the battery that cannot be true is no silence, and none that lasts beyond the next possible one.
#[test]
fn law_samples_an_impossible_battery_is_no_silent_one() {
    for (value, wrong_s) in [(f64::NAN, 0.0), (-1.0, 9.9), (5.0, 9.9)] {
        let mut intake = Intake::new(0.0);
        intake.take(Quantity::Battery, 0.8);
        for _ in 0..100 {
            intake.elapse(0.1);
            intake.take(Quantity::Battery, value);
        }
        assert!((intake.battery_wrong() - wrong_s).abs() < 1e-9, "{value}: {} s", intake.battery_wrong());
        assert!((intake.battery_age() - 10.0).abs() < 1e-9);
        intake.take(Quantity::Battery, 0.7);
        intake.elapse(1.0);
        assert_eq!((intake.battery_wrong(), intake.battery_age()), (0.0, 1.0));
    }
}
