//! Lanes and single vehicles agree, with other failures in every lane.

use crate::allocation::setup::{VOLTAGE, smooth};
use crate::processor::wide;
use crate::vehicles::load;
use fearless_simd::{Simd, SimdFrom, f64x8};
use seatrial::control::allocation::{AllocationTable, Allocator};
use seatrial::description::Description;
use seatrial::description::assembly::Structure;
use seatrial::model::vehicle::{Mode, Vehicle};
use seatrial::number::algebra::Vec6;
use seatrial::number::lanes::LANES;
use seatrial::number::real::Real;

const STEPS: usize = 40;

/// Per lane: which actuator has failed, which is stuck, and a wrench that changes with the step.
fn demand(lane: usize, step: usize) -> Vec6<f64> {
    let wave = |i: usize| f64::sin(0.3 * (step + 3 * lane) as f64 + i as f64);
    [40.0 * wave(0), 10.0 * wave(1), 12.0 * wave(2), 0.3 * wave(3), 4.0 * wave(4), 6.0 * wave(5)]
}

fn velocity(lane: usize, step: usize) -> Vec6<f64> {
    [0.2 * lane as f64 - 0.3, 0.05 * f64::sin(step as f64), 0.02, 0.0, 0.01, 0.05]
}

/// Out of line: the constants are not what is tested.
#[inline(never)]
fn vehicle<T: Real>(description: &Description, unit: T) -> Vehicle<T> {
    let structure = Structure::new(description, &[]);
    let values: Vec<T> = description.coefficients.iter().map(|&x| unit.splat(x)).collect();
    Vehicle::new(description, &structure, &values, description.file.environment, [Mode::Free; 6])
}

/// The signals and wrenches of all steps of a lane or of all lanes, in the order of steps.
#[inline(always)]
fn fly<T: Real>(
    description: &Description,
    table: &AllocationTable,
    unit: T,
    lane: impl Fn(&dyn Fn(usize) -> f64) -> T,
) -> Vec<T> {
    let vehicle = vehicle(description, unit);
    let mut allocator = Allocator::new(description, &vehicle, table).expect("a table that fits");
    let count = description.actuators.len();
    let mut usable = vec![unit; count];
    for (k, usable) in usable.iter_mut().enumerate() {
        *usable = lane(&|l| if l > 0 && l % count == k { 0.0 } else { 1.0 });
    }
    let stuck = lane(&|l| if l == 5 { 1.0 } else { 0.0 });
    allocator.stuck(2, unit.splat(0.05), unit.zero().lt(stuck));
    let mut rows = [unit; 6];
    rows[3] = unit.zero();
    let mut record = Vec::new();
    let mut signals = vec![unit; count];
    for step in 0..STEPS {
        let (mut tau, mut nu_r) = ([unit; 6], [unit; 6]);
        for i in 0..6 {
            tau[i] = lane(&|l| demand(l, step)[i]);
            nu_r[i] = lane(&|l| velocity(l, step)[i]);
        }
        rows[1] = lane(&|l| f64::from(l % 2 == 0 || step > 20));
        allocator.prepare(&vehicle, &rows, &usable, nu_r[0]);
        let reached = allocator.allocate(&vehicle, &tau, &nu_r, VOLTAGE, &mut signals);
        record.extend_from_slice(&signals);
        record.extend_from_slice(&reached);
    }
    record
}

#[inline(always)]
fn in_lanes<S: Simd>(
    simd: S,
    description: &Description,
    table: &AllocationTable,
    order: [usize; LANES],
) -> Vec<[f64; LANES]> {
    let unit = f64x8::simd_from(simd, [1.0; LANES]);
    let record = fly(description, table, unit, |f| f64x8::simd_from(simd, order.map(f)));
    record.into_iter().map(Into::into).collect()
}

/// On one set of vectors alone, the levels' agreement being the concern of `tests/scalars.rs`: the code of a step for all of
/// them takes minutes to compile. Nothing where the processor lacks it.
fn on(description: &Description, table: &AllocationTable, order: [usize; LANES]) -> Vec<[f64; LANES]> {
    let Some(simd) = wide() else { return Vec::new() };
    simd.vectorize(
        #[inline(always)]
        || in_lanes(simd, description, table, order),
    )
}

const FORWARD: [usize; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];
const SHUFFLED: [usize; LANES] = [0, 5, 5, 3, 7, 1, 1, 2];

fn cases() -> Vec<(Description, AllocationTable)> {
    let plain = AllocationTable::default();
    let still = AllocationTable { fin_inflow: false, ..plain.clone() };
    let washed = crate::vehicles::with(&load("cwolf"), &[("VTB.loss", 1e-3), ("SbU.astern_ratio", 0.8)]);
    vec![
        (washed, plain.clone()),
        (smooth("bluerov2-heavy"), plain.clone()),
        (load("beluga"), plain.clone()),
        (load("remus100"), plain.clone()),
        (load("lauv"), still),
    ]
}

#[test]
fn scalar_allocation_in_lanes_is_that_of_single_vehicles() {
    for (description, table) in cases() {
        let single: Vec<Vec<f64>> =
            FORWARD.iter().map(|&l| fly(&description, &table, 1.0, |f| f(l))).collect();
        let lanes = on(&description, &table, FORWARD);
        let mut worst = 0.0_f64;
        for (i, lanes) in lanes.iter().enumerate() {
            for l in 0..LANES {
                let (a, b) = (lanes[l], single[l][i]);
                worst = worst.max(((a - b) / (1.0 + b.abs())).abs());
            }
        }
        let name = &description.file.name;
        println!("{name}: {worst:e}");
        // Fused products: rounding. Where the rows that are left hang together (sway and yaw of CWolf and of fins, any
        // rows of saturated or failed actuators), rounding over lambda = 1e-8.
        let tolerance = if name == "bluerov2-heavy" { 1e-12 } else { 1e-6 };
        assert!(worst < tolerance, "{name}: {worst:e}");
    }
}

#[test]
fn scalar_allocation_does_not_see_its_neighbours() {
    for (description, table) in cases() {
        {
            let one = on(&description, &table, FORWARD);
            let other = on(&description, &table, SHUFFLED);
            for (i, (a, b)) in one.iter().zip(&other).enumerate() {
                for l in 0..LANES {
                    // The same operations on the same numbers.
                    let (a, b) = (a[SHUFFLED[l]], b[l]);
                    let file = &description.file.name;
                    assert!(a.to_bits() == b.to_bits(), "{file} lane {l} number {i}: {a} {b}");
                }
            }
        }
    }
}
