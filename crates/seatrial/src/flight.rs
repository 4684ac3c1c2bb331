//! Closed loop: vehicle, sensors, autopilot, mission and current together; one flight, or cases side by side.
//!
//! In reading order: [`acoustics`], what only a filter reads; [`aboard`], the navigation filters; [`obstacle`], [`faults`], [`turbulence`], [`drift`], [`waves`] and their sum [`water`], what the world
//! adds; [`motors`], what the actuators really do; [`energy`], what is used up; [`trial`], set points in place of guidance; [`case`], what a flight and its cases are; `legs`, [`exceedance`] and
//! [`summary`], the figures, which `tally` sums up under way; [`log`](mod@log), every period of it; [`reached`], which waypoints a log reached; [`fly`], one case;
//! [`batch`], many; [`ardusub`], a vehicle under ArduSub's cascade along targets over time.
//!
//! Once per control period the sensors are read, the autopilot steps and its commands are held; the motors and
//! the equation of motion advance by `substeps` equal steps. The vehicle that flies and the model inside
//! the autopilot are two: what the autopilot does not know is tested here.
//!
//! Tests: `tests/closed_loop.rs`, `tests/flight/test_fly.py`.

pub mod aboard;
pub mod acoustics;
pub mod ardusub;
pub mod batch;
pub mod case;
pub mod drift;
pub mod energy;
pub mod exceedance;
pub mod faults;
mod legs;
pub mod log;
pub mod motors;
pub mod obstacle;
pub mod reached;
pub mod summary;
mod tally;
pub mod trial;
pub mod turbulence;
pub mod water;
pub mod waves;

use crate::actuator::motor::Limits;
use crate::control::allocation::Allocator;
use crate::control::autopilot::Autopilot;
use crate::control::navigation::{DEPTH, Navigation, truth};
use crate::control::safety::Sounded;
use crate::error::Error;
use crate::model::integrate::State;
use crate::model::vehicle::{Instant, Vehicle, hand_on};
use crate::number::real::Real;
use aboard::{Aboard, Split};
pub use case::{Flight, Setting, whole_steps};
use energy::Energy;
use log::{Log, Row};
use motors::Motors;
use std::sync::atomic::{AtomicBool, Ordering};
use summary::Summary;
use tally::Tally;
use water::Water;

/// Flies one case; the autopilot begins at the first sample.
///
/// # Errors
/// [`Error::Interrupted`] when `stop` is set, or what the autopilot cannot do on this vehicle.
#[inline(always)]
pub fn fly<T: Split>(
    flight: &Flight<'_>,
    vehicle: &Vehicle<T>,
    autopilot: &Autopilot<T>,
    (setting, allocator, mut log): (&Setting<T>, Allocator<T>, Option<&mut Log<T>>),
    stop: &AtomicBool,
) -> Result<Summary<T>, Error> {
    let unit = setting.seed.zero();
    let dt = flight.settings.file.period_s;
    let h = dt / flight.substeps as f64;
    let limits: Vec<Limits> = flight.description.actuators.iter().map(|a| a.limits).collect();
    let mut pilot = autopilot.begin(allocator);
    let mut navigation = Navigation::new(flight.sensors, setting.seed, &setting.outages)
        .with_offsets(setting.offsets.as_ref());
    let mut aboard = flight.navigation.map(|fitting| Aboard::new(flight, fitting, setting));
    let mut motors = Motors::new(vehicle, &limits, h, unit);
    let mut energy = Energy::new(flight.description, unit);
    let mut state = launched(vehicle, setting.state, flight.environment.g_m_s2);
    let mut tally = Tally::new(flight, unit, &limits);
    let mut instants: [Instant<T>; 3] = Default::default();
    let mut water = Water::new(flight, setting, dt);
    for instant in &mut instants {
        instant.current = water.at(0.0);
    }
    for k in 0..=flight.periods {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        let flow = water.begin(k, &state);
        let shown = truth(&state, flow.as_ref(), flight.seabed.as_ref());
        let measured = navigation.sample(shown, (k, dt));
        measured.voltage = flight.voltage;
        measured.battery = energy.left();
        let feedback = flight.feedback.then_some(&motors.signals[..]);
        let estimate = aboard.as_mut().map(|filters| {
            let elapsed = if k == 0 { 0.0 } else { dt };
            let flying = (!flight.is_trial()).then(|| tally.flying());
            filters.tell((&shown, measured), (&pilot.signals, feedback), (elapsed, dt), flying)
        });
        if estimate.is_some() {
            pilot.sounded = Some(Sounded { depth: measured.channels[DEPTH], age: measured.age[DEPTH] });
        }
        let measured = estimate.as_ref().unwrap_or(measured);
        let set_point = flight.trial.set_point(unit, &setting.set_points, k as f64 * dt);
        flight.trial.dither.write(&mut pilot.dither, k as f64 * dt);
        let thought = autopilot.step_to(&mut pilot, measured, feedback, set_point.as_ref());
        let power = energy.power(&motors.signals);
        if let Some(log) = &mut log {
            let row = Row { truth: &shown, measured, thought: &thought, power };
            log.add(&row, &pilot.signals, &motors.signals);
        }
        tally.add(flight, &shown, &thought, (k, &pilot.signals, energy.used, &setting.scales));
        if (!flight.is_trial() && !tally.any_flying()) || k == flight.periods {
            break;
        }
        motors.command(vehicle, &pilot.signals, &limits);
        for s in 0..flight.substeps {
            let time = (k * flight.substeps + s) as f64 * h;
            if water.varies() {
                for (half, instant) in instants.iter_mut().enumerate() {
                    instant.current = water.at((s as f64 + 0.5 * half as f64) * h);
                }
            }
            let anew = s == 0 || motors.any_ideal;
            let around = (&setting.faults, flight.voltage);
            state = motors.substep(vehicle, &state, &mut instants, (anew, time, h), around);
            hand_on(&mut instants);
        }
        energy.use_up(power, dt);
    }
    let mut summary = tally.finish();
    if let Some(filters) = &aboard {
        summary.consistency = filters.consistency();
    }
    Ok(summary)
}

/// Where a flight really begins: a vehicle that is launched higher than it floats has come to rest before.
#[inline(always)]
fn launched<T: Real>(vehicle: &Vehicle<T>, mut state: State<T>, g: f64) -> State<T> {
    let Some(surface) = &vehicle.surface else { return state };
    let depth = state.position[2] - surface.level;
    if T::any(depth.lt(surface.reach)) {
        let weight = vehicle.restoring.net_weight + vehicle.restoring.displaced * g;
        state.position[2] = depth.max(surface.afloat(weight)) + surface.level;
    }
    state
}
