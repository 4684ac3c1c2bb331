//! Lanes against `f64`: each lane has its own guidance and its own place in the mission.

use crate::guidance::vessel::{DT, Kind, Vessel, go_on, guidance, pass, start, table, waypoint};
use crate::processor::wide;
use fearless_simd::{Simd, SimdFrom, f64x8};
use seatrial::control::guidance::{Desired, Fix, Guidance, GuidanceTable, Method};
use seatrial::mission::{Task, Vertical, Waypoint};
use seatrial::number::lanes::LANES;
use seatrial::number::real::Real;

/// Every kind of task; each lane has left the first waypoints behind at another time.
fn mission() -> Vec<Waypoint> {
    vec![
        pass([40.0, 5.0, 12.0]),
        waypoint([60.0, 40.0, 15.0], Task::Hold { seconds: 20.0, heading: Some(2.0) }),
        Waypoint { vertical: Vertical::Altitude, ..pass([20.0, 60.0, 80.0]) },
        waypoint([-20.0, 20.0, 14.0], Task::Circle { radius: 12.0, clockwise: false, turns: 1.2 }),
        waypoint([-25.0, -30.0, 16.0], Task::Hold { seconds: 15.0, heading: None }),
        pass([-25.0, -30.0, 25.0]),
        pass([10.0, -20.0, 20.0]),
    ]
}

/// Fixes and what was desired at them.
type Flight = Vec<(Fix<f64>, [f64; 11])>;

fn numbers(d: &Desired<f64>) -> [f64; 11] {
    [
        d.speed,
        d.lateral,
        d.heading,
        d.pitch,
        d.depth,
        d.holding,
        d.cross_track,
        d.vertical_error,
        d.distance,
        d.leg,
        d.done,
    ]
}

/// The flights of eight tables: the fixes and what was desired.
fn flights(tables: &[GuidanceTable; LANES], kind: Kind) -> Vec<Flight> {
    let waypoints = mission();
    let one = |(lane, table): (usize, &GuidanceTable)| {
        let guidance = guidance(table, kind);
        let mut vessel = Vessel::new(kind, 0.3 * lane as f64, 1.0).in_current([
            0.03 * lane as f64,
            0.1,
            0.01 * lane as f64,
        ]);
        let mut progress = guidance.begin(&start(vessel.position), &waypoints);
        let points = go_on(&guidance, &waypoints, &mut progress, &mut vessel, 600.0);
        points.iter().map(|p| (p.vessel.fix(), numbers(&p.desired))).collect()
    };
    tables.iter().enumerate().map(one).collect()
}

/// The same fixes in eight lanes; the largest difference of a number.
#[inline(always)]
fn differences<S: Simd>(simd: S, (tables, kind): (&[GuidanceTable; LANES], Kind), flights: &[Flight]) -> f64 {
    let waypoints = mission();
    let lanes = |f: &dyn Fn(usize) -> f64| f64x8::simd_from(simd, std::array::from_fn::<f64, LANES, _>(f));
    let zero = lanes(&|_| 0.0);
    let mut guidance = Guidance::new(&tables[0], zero, kind == Kind::Sway, kind != Kind::Torpedo);
    for i in 0..tables[0].tunable().len() {
        guidance.set(i, lanes(&|lane| tables[lane].tunable()[i]));
    }
    let mut progress = guidance.begin(&start([0.0, 0.0, 10.0]), &waypoints);
    let mut worst = 0.0_f64;
    for k in 0..flights[0].len() {
        let of = |f: &dyn Fn(&Fix<f64>) -> f64| lanes(&|lane| f(&flights[lane][k].0));
        let fix = Fix {
            position: std::array::from_fn(|i| of(&|fix| fix.position[i])),
            altitude: of(&|fix| fix.altitude),
            attitude: std::array::from_fn(|i| of(&|fix| fix.attitude[i])),
            velocity: std::array::from_fn(|i| of(&|fix| fix.velocity[i])),
        };
        let d = guidance.step(&waypoints, &mut progress, &fix, DT);
        let found: [[f64; LANES]; 11] = [
            d.speed,
            d.lateral,
            d.heading,
            d.pitch,
            d.depth,
            d.holding,
            d.cross_track,
            d.vertical_error,
            d.distance,
            d.leg,
            d.done,
        ]
        .map(Into::into);
        for lane in 0..LANES {
            for (i, expected) in flights[lane][k].1.into_iter().enumerate() {
                let off = found[i][lane] - expected;
                // On either side of ±π the heading is the same.
                let off = if i == 2 { Real::wrap(off) } else { off };
                worst = worst.max(off.abs() / expected.abs().max(1.0));
            }
        }
    }
    worst
}

/// The same on one instruction set, where this processor has it: compiled once.
fn on_processor(tables: (&[GuidanceTable; LANES], Kind), flights: &[Flight]) -> Option<f64> {
    let simd = wide()?;
    Some(simd.vectorize(
        #[inline(always)]
        || differences(simd, tables, flights),
    ))
}

#[test]
fn scalar_guidance_in_lanes_agrees() {
    for kind in [Kind::Torpedo, Kind::Hover, Kind::Sway] {
        for method in [Method::Pursuit, Method::Lookahead, Method::Integral] {
            let tables: [GuidanceTable; LANES] = std::array::from_fn(|lane| GuidanceTable {
                lookahead_m: 6.0 + lane as f64,
                integral_gain_m_s: 0.1 + 0.05 * lane as f64,
                turn_speed_share: 1.0 - 0.1 * lane as f64,
                loiter_radius_m: 10.0 + lane as f64,
                ..table(method)
            });
            let flights = flights(&tables, kind);
            let complete = flights.iter().filter(|flight| flight[flight.len() - 1].1[10] == 1.0).count();
            assert!(complete == LANES, "{kind:?} {method:?}: {complete} missions are complete");
            let Some(worst) = on_processor((&tables, kind), &flights) else { continue };
            // The bound of all number types, relative to numbers above one.
            assert!(worst < 1e-12, "{kind:?}, {method:?}: {worst:e}");
        }
    }
}
