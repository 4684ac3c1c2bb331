//! Autopilot and navigation filter step in fixed memory: what a vehicle at sea runs takes nothing from the heap once it has begun.

use seatrial::control::allocation::Allocator;
use seatrial::control::autopilot::Autopilot;
use seatrial::control::autopilot::settings::{Settings, built_in};
use seatrial::control::navigation::{CHANNELS, Measurement};
use seatrial::control::navigation_filter::{Fitting, Instrument, KINDS, NavigationFilter};
use seatrial::description::{Description, built_in as vehicle};
use seatrial::filter::innovation::Gate;
use seatrial::mission::Mission;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::sync::Arc;

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const MISSION: &str = "format = 1\nname = \"m\"\nspeed_m_s = 0.6\nacceptance_radius_m = 2.0\n\
    [limits]\nfence_m = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]]\n\
    [[legs]]\nnorth_m = 20.0\neast_m = 0.0\ndepth_m = 3.0\n\
    [[legs]]\nnorth_m = 20.0\neast_m = 20.0\naltitude_m = 4.0\n\
    [[legs]]\nnorth_m = 0.0\neast_m = 20.0\ndepth_m = 3.0\ncircle_radius_m = 8.0\nturns = 1.0\n";

/// How often `steps` steps of a built-in autopilot took memory; a point that follows its desired values.
fn allocations(name: &str, steps: usize) -> usize {
    let description = Description::from_toml(vehicle(name).expect("built in"), name).expect("valid");
    let settings = Arc::new(Settings::from_toml(built_in(name).expect("built in"), name).expect("valid"));
    let mission = Arc::new(Mission::from_toml(MISSION, "m").expect("valid"));
    let autopilot =
        Autopilot::<f64>::new(&settings, &description, &mission, &settings.tunables).expect("fits");
    let allocation = &settings.file.allocation;
    let allocator = Allocator::single(&description, autopilot.model(), allocation).expect("fits");
    let mut state = autopilot.begin(allocator);
    let mut measured = Measurement::nothing(0.0);
    measured.age = [0.0; CHANNELS];
    measured.channels[12] = 10.0;
    measured.voltage = 14.8;
    let mut feedback = vec![0.0; description.actuators.len()];
    let (mut velocity, mut fastest) = (0.0, 0.0_f64);
    let region = Region::new(HEAP);
    for k in 0..steps {
        let thought = autopilot.step(&mut state, &measured, Some(&feedback));
        feedback.copy_from_slice(&state.signals);
        if k == steps / 2 {
            autopilot.declare_failed(&mut state, 0, 1.0);
        }
        let dt = autopilot.period();
        let desired = &thought.desired;
        let heading = &mut measured.channels[5];
        *heading += 0.2 * (desired.heading - *heading);
        velocity += 0.2 * (desired.speed - velocity);
        fastest = fastest.max(velocity);
        let (sine, cosine) = heading.sin_cos();
        measured.channels[0] += dt * velocity * cosine;
        measured.channels[1] += dt * velocity * sine;
        measured.channels[2] += 0.1 * (desired.depth - measured.channels[2]);
        measured.channels[12] = 10.0 - measured.channels[2];
        (measured.channels[6], measured.channels[13]) = (velocity, velocity);
    }
    assert!(fastest > 0.3, "{name} must have sailed");
    region.change().allocations
}

fn law_autopilot_steps_take_no_memory() {
    for name in ["cwolf", "remus100", "bluerov2-heavy", "beluga", "lauv"] {
        assert_eq!(allocations(name, 3000), 0, "{name}");
    }
}

/// Samples of a vehicle that stands still, some of them late, and a gap that the filter does not survive.
fn law_navigation_filter_steps_take_no_memory() {
    for name in ["cwolf", "remus100", "bluerov2-heavy"] {
        let description = Description::from_toml(vehicle(name).expect("built in"), name).expect("valid");
        let mut instruments = [Some(Instrument::of(0.05)); KINDS.len()];
        instruments[5].as_mut().expect("a Doppler log").latency = 0.3;
        let fitting = Fitting {
            instruments,
            landmarks: Vec::new(),
            bottom: None,
            noise: Fitting::noise_of(&description, &instruments, false),
            swell: None,
            gate: Gate::default(),
            start: ([0.0; 3], 1.0),
            period: 0.1,
            longest_age: 0.5,
        };
        let mut filter = NavigationFilter::new(&description, fitting);
        let commands = vec![0.0; description.actuators.len()];
        let samples: Vec<(usize, f64, f64)> = (0..12).map(|c| (c, 0.0, 0.0)).collect();
        let region = Region::new(HEAP);
        for k in 0..1000 {
            let elapsed = if k == 700 { 100.0 } else { 0.1 };
            filter.step(&samples, (&commands, None), (14.8, elapsed));
            assert!(filter.tracker().state().deviation(0) < 5.0);
        }
        assert_eq!(filter.restarts, 1.0, "{name}");
        assert_eq!(region.change().allocations, 0, "{name}");
    }
}

/// Without the test harness, whose own thread takes memory now and then.
fn main() {
    law_autopilot_steps_take_no_memory();
    law_navigation_filter_steps_take_no_memory();
}
