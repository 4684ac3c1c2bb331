//! The linear-quadratic regulator: number types, bumpless switching, anti-windup, a closed loop, its table.

use crate::processor::wide;
use fearless_simd::{Simd, SimdFrom, f64x8};
use proptest::array::{uniform6, uniform8, uniform15};
use proptest::prelude::*;
use seatrial::control::control_law::{HEADING, HEAVE, ROLL, SURGE, Situation};
use seatrial::control::lqr::{Gain, Lqr, LqrState, LqrTable, STATES};
use seatrial::control::schedule::{POINTS, Schedule};
use seatrial::number::lanes::{LANES, Lanes};
use seatrial::number::real::Real;

const SPEEDS: [f64; POINTS] = [-1.0, 0.0, 0.5, 1.0, 1.5, 2.0];
const PERIOD: f64 = 0.1;

fn weights<T: Real>(speed: T) -> [T; POINTS] {
    Schedule::new(SPEEDS).expect("increasing speeds").weights(speed)
}

/// A situation in which nothing happens and all loops are at work.
fn calm<T: Real>(unit: T) -> Situation<T> {
    let (zero, all) = ([unit.zero(); 6], [unit.splat(1.0); 6]);
    Situation {
        dt: PERIOD,
        speed: unit.zero(),
        error: zero,
        rate: zero,
        reference_rate: zero,
        velocity: zero,
        attitude: [unit.zero(); 3],
        feed_forward: zero,
        achieved: zero,
        active: all,
        entered: zero,
    }
}

/// A regulator of one mode with the same gain at all speeds.
fn constant(gain: Gain<f64>, tau_max: f64) -> Lqr<f64> {
    let tables = [table("cruise", vec![gain])];
    Lqr::new(&tables, &["cruise"], &[tau_max; 6], "test").expect("a valid table")
}

fn table(mode: &str, gains: Vec<Gain<f64>>) -> LqrTable {
    let rows = |gain: Gain<f64>| gain.map(|row| row.to_vec()).to_vec();
    LqrTable { mode: mode.to_owned(), tracking_s: 2.0, gain: gains.into_iter().map(rows).collect() }
}

/// Gains that differ in every entry, mode and point.
fn uneven(seed: f64) -> Gain<f64> {
    std::array::from_fn(|i| std::array::from_fn(|j| (seed + 7.0 * i as f64 + 1.3 * j as f64).sin() * 20.0))
}

fn two_modes<T: Real>(unit: T) -> Lqr<T> {
    let points = |seed: f64| (0..POINTS).map(|k| uneven(seed + k as f64)).collect();
    let tables = [table("hover", points(0.0)), table("cruise", points(50.0))];
    Lqr::new(&tables, &["hover", "cruise"], &[unit.splat(30.0); 6], "test").expect("valid tables")
}

/// One random step: plain numbers that become a situation, a speed and a mode.
#[derive(Clone, Copy, Debug)]
struct Step {
    error: [f64; 6],
    velocity: [f64; 6],
    forces: [f64; 6],
    speed: f64,
    /// Which loops are at work, as bits.
    loops: u8,
    cruise: bool,
}

impl Step {
    fn active(&self, i: usize) -> bool {
        self.loops >> i & 1 == 1
    }
}

fn step() -> impl Strategy<Value = Step> {
    let numbers = (uniform6(-2.0..2.0), uniform6(-1.0..1.0), uniform6(-20.0..20.0), -1.5..2.5_f64);
    (numbers, any::<u8>(), any::<bool>()).prop_map(|((error, velocity, forces, speed), loops, cruise)| Step {
        error,
        velocity,
        forces,
        speed,
        loops,
        cruise,
    })
}

/// The demands over some steps, the actuators reaching three quarters; the loops enter as the steps say.
#[inline(always)]
fn flown<T: Real>(
    unit: T,
    lift: impl Fn(&dyn Fn(usize) -> f64) -> T,
    steps: &[[Step; LANES]],
) -> Vec<[T; 6]> {
    let lqr = two_modes(unit);
    let mut state = LqrState::at_rest(unit);
    let (mut achieved, mut active) = ([unit.zero(); 6], [unit.zero(); 6]);
    let mut demands = Vec::new();
    for steps in steps {
        let now: [T; 6] =
            std::array::from_fn(|i| lift(&|lane| if steps[lane].active(i) { 1.0 } else { 0.0 }));
        let speed = lift(&|lane| steps[lane].speed);
        let situation = Situation {
            speed,
            error: std::array::from_fn(|i| lift(&|lane| steps[lane].error[i])),
            velocity: std::array::from_fn(|i| lift(&|lane| steps[lane].velocity[i])),
            rate: std::array::from_fn(|i| lift(&|lane| steps[lane].velocity[i])),
            attitude: std::array::from_fn(|i| lift(&|lane| steps[lane].velocity[3 + i] * 0.3)),
            feed_forward: std::array::from_fn(|i| lift(&|lane| steps[lane].forces[i])),
            achieved,
            active: now,
            entered: std::array::from_fn(|i| now[i] * (-active[i] + 1.0)),
            ..calm(unit)
        };
        let mode = lift(&|lane| if steps[lane].cruise { 1.0 } else { 0.0 });
        let demand = lqr.step(&mut state, &situation, &weights(speed), mode);
        achieved = demand.map(|x| x * 0.75);
        active = now;
        demands.push(demand);
    }
    demands
}

#[inline(always)]
fn in_lanes<S: Simd>(simd: S, steps: &[[Step; LANES]]) -> Vec<[[f64; LANES]; 6]> {
    let lift = |f: &dyn Fn(usize) -> f64| -> Lanes<S> { f64x8::simd_from(simd, std::array::from_fn(f)) };
    flown(f64x8::simd_from(simd, [0.0; LANES]), lift, steps).into_iter().map(|d| d.map(Into::into)).collect()
}

/// The same on one instruction set, where this processor has it: compiled once.
fn on_processor(steps: &[[Step; LANES]]) -> Option<Vec<[[f64; LANES]; 6]>> {
    let simd = wide()?;
    Some(simd.vectorize(
        #[inline(always)]
        || in_lanes(simd, steps),
    ))
}

properties! {
    #![cases(64)]

    #[test]
    fn scalar_lanes_demand_what_each_candidate_demands_alone(
        steps in proptest::collection::vec(uniform8(step()), 1..12),
    ) {
        let Some(lanes) = on_processor(&steps) else { return Ok(()) };
        for lane in 0..LANES {
            let alone = flown(0.0, |f| f(lane), &steps);
            for (k, demand) in alone.iter().enumerate() {
                for i in 0..6 {
                    // Sums of sixteen products of about 40 N, whose rounding the lanes do once.
                    prop_assert!((demand[i] - lanes[k][i][lane]).abs() < 1e-10, "lane {lane} step {k} row {i}");
                }
            }
        }
    }

    #[test]
    fn law_switching_is_bumpless(step in step(), before in uniform6(-25.0..25.0), rows in uniform6(uniform15(-5.0..5.0))) {
        // What the preset may need stays below this limit: the demand continues exactly.
        let lqr = constant(rows, 1e6);
        let mut state = LqrState::at_rest(0.0);
        let active: [f64; 6] = std::array::from_fn(|i| if step.active(i) { 1.0 } else { 0.0 });
        let situation = Situation {
            error: step.error,
            velocity: step.velocity,
            rate: step.velocity,
            feed_forward: step.forces,
            achieved: before,
            active,
            entered: active,
            ..calm(0.0)
        };
        let demand = lqr.step(&mut state, &situation, &weights(step.speed), 0.0);
        for i in 0..6 {
            let expected = before[i] * active[i];
            // Sums of some hundred newtons.
            prop_assert!((demand[i] - expected).abs() < 1e-11, "row {i}: {} instead of {expected}", demand[i]);
        }
    }

    #[test]
    fn law_a_change_of_mode_or_gain_makes_no_jump(first in step(), second in step()) {
        // Nothing is limited, so that the actuators reach what was demanded.
        let mut lqr = two_modes(0.0_f64);
        lqr.tau_max = [f64::INFINITY; 6];
        let mut state = LqrState::at_rest(0.0);
        let at = |step: &Step, error: [f64; 6], achieved, entered| Situation {
            speed: step.speed,
            error,
            velocity: step.velocity,
            rate: step.velocity,
            feed_forward: step.forces,
            achieved,
            entered,
            ..calm(0.0)
        };
        let mode = |step: &Step| f64::from(u8::from(step.cruise));
        let mut demand = [0.0; 6];
        for _ in 0..3 {
            demand = lqr.step(&mut state, &at(&first, first.error, demand, [0.0; 6]), &weights(first.speed), mode(&first));
        }
        let other = at(&second, second.error, demand, [0.0; 6]);
        let switched = !first.cruise;
        let after = lqr.step(&mut state, &other, &weights(second.speed), f64::from(u8::from(switched)));
        for i in 0..6 {
            // Sums of some thousand newtons.
            prop_assert!((after[i] - demand[i]).abs() < 1e-9, "row {i}");
        }
        // With the mode kept and no deviation, another speed changes the gains and not the demand.
        let still = Situation { feed_forward: [0.0; 6], velocity: [0.0; 6], rate: [0.0; 6], ..at(&second, [0.0; 6], after, [0.0; 6]) };
        let kept = mode_kept(&lqr, &mut state, &still, f64::from(u8::from(switched)));
        for i in 0..6 {
            if i != ROLL {
                prop_assert!((kept[0][i] - kept[1][i]).abs() < 1e-9, "row {i}");
            }
        }
    }
}

/// Two steps without deviation at speeds far apart.
fn mode_kept(lqr: &Lqr<f64>, state: &mut LqrState<f64>, still: &Situation<f64>, mode: f64) -> [[f64; 6]; 2] {
    // The first takes up what the step before it integrated.
    let slow = lqr.step(state, &Situation { achieved: state.bias, ..*still }, &weights(0.0), mode);
    [slow, lqr.step(state, &Situation { achieved: slow, ..*still }, &weights(2.0), mode)]
}

/// The gain of a depth loop on a double integrator of mass 100 kg: poles of 0.5 rad/s and an integral.
fn depth_gain() -> Gain<f64> {
    let mut gain = [[0.0; STATES]; 6];
    gain[HEAVE][0] = 30.0;
    gain[HEAVE][6] = 95.0;
    gain[HEAVE][12] = 2.5;
    gain
}

/// Depths over some seconds of a mass of 100 kg under a constant load (N), from a depth error of `start` m.
fn depths(lqr: &Lqr<f64>, start: f64, load: f64, reach: f64, seconds: f64) -> Vec<f64> {
    let mut state = LqrState::at_rest(0.0);
    let (mut z, mut w, mut achieved) = (start, 0.0, 0.0_f64);
    let mut only_heave = [0.0; 6];
    only_heave[HEAVE] = 1.0;
    let steps = (seconds / PERIOD) as usize;
    let mut track = Vec::with_capacity(steps);
    for k in 0..steps {
        let row = |x: f64| {
            let mut row = [0.0; 6];
            row[HEAVE] = x;
            row
        };
        let situation = Situation {
            error: row(-z),
            velocity: row(w),
            rate: row(w),
            achieved: row(achieved),
            active: only_heave,
            ..calm(0.0)
        };
        if k == 0 {
            // Under way in the mode already, with nothing integrated: no preset hides the first error.
            lqr.step(&mut state, &Situation { active: only_heave, ..calm(0.0) }, &weights(0.0), 0.0);
        }
        achieved = lqr.step(&mut state, &situation, &weights(0.0), 0.0)[HEAVE].clamp(-reach, reach);
        let acceleration = (achieved + load) / 100.0;
        // Exact for a constant force.
        z += PERIOD * (w + 0.5 * PERIOD * acceleration);
        w += PERIOD * acceleration;
        track.push(z);
    }
    track
}

#[test]
fn law_a_constant_load_is_removed() {
    let track = depths(&constant(depth_gain(), f64::INFINITY), 1.0, 12.0, f64::INFINITY, 300.0);
    // The slowest pole, about -0.12 1/s, leaves e^(-36) of a metre.
    assert!(track[track.len() - 1].abs() < 1e-9, "{}", track[track.len() - 1]);
    assert!(track.iter().all(|z| z.abs() < 1.5));
    // Without the integral the load stays: 12 N over 30 N/m.
    let mut gain = depth_gain();
    gain[HEAVE][12] = 0.0;
    let track = depths(&constant(gain, f64::INFINITY), 1.0, 12.0, f64::INFINITY, 300.0);
    assert!((track[track.len() - 1] - 0.4).abs() < 1e-9);
}

#[test]
fn law_a_limit_does_not_wind_the_integral_up() {
    let beyond = |track: &[f64]| track.iter().fold(0.0_f64, |least, z| least.min(*z)).abs();
    let start = 20.0;
    // 10 N move 100 kg over 20 m in half a minute; unprotected, the integral of that time must be paid back.
    let knows = depths(&constant(depth_gain(), 10.0), start, 0.0, 10.0, 600.0);
    // A regulator that is told of no limit takes the actuators for unlimited: a wound-up integral.
    let wound_up = depths(&constant(depth_gain(), f64::INFINITY), start, 0.0, 10.0, 600.0);
    // What the limit alone costs: the same gain without the integral.
    let mut gain = depth_gain();
    gain[HEAVE][12] = 0.0;
    let without = depths(&constant(gain, 10.0), start, 0.0, 10.0, 600.0);
    assert!(beyond(&knows) < beyond(&without) + 0.05 * start, "{} {}", beyond(&knows), beyond(&without));
    assert!(beyond(&wound_up) > 2.0 * beyond(&knows), "{} {}", beyond(&wound_up), beyond(&knows));
    assert!(knows[knows.len() - 1].abs() < 0.01);
}

#[test]
fn law_a_dead_band_is_no_limit() {
    // What the actuators miss is 1 % of the limit: the integral goes on until the load is borne.
    let lqr = constant(depth_gain(), 100.0);
    let mut state = LqrState::at_rest(0.0);
    let mut situation = calm(0.0);
    lqr.step(&mut state, &situation, &weights(0.0), 0.0);
    situation.error[HEAVE] = 0.01;
    let before = state.bias[HEAVE];
    for _ in 0..100 {
        let demand = lqr.step(&mut state, &situation, &weights(0.0), 0.0);
        situation.achieved = demand;
        situation.achieved[HEAVE] -= 1.0;
    }
    // 99 increments of K_I e dt.
    assert!((state.bias[HEAVE] - before - 99.0 * 2.5 * 0.01 * PERIOD).abs() < 1e-12);
}

#[test]
fn law_a_row_without_integral_forgets_its_preset() {
    let lqr = constant(depth_gain(), 100.0);
    let mut state = LqrState::at_rest(0.0);
    let mut situation = calm(0.0);
    situation.achieved[ROLL] = 8.0;
    situation.entered[ROLL] = 1.0;
    let first = lqr.step(&mut state, &situation, &weights(0.0), 0.0);
    assert_eq!(first[ROLL], 8.0);
    situation.entered[ROLL] = 0.0;
    let mut last = first;
    for _ in 0..100 {
        situation.achieved = last;
        last = lqr.step(&mut state, &situation, &weights(0.0), 0.0);
    }
    // (1 - 0.1/2) per step.
    assert!((last[ROLL] - 8.0 * 0.95_f64.powi(100)).abs() < 1e-12);
}

#[test]
fn law_loops_that_rest_demand_nothing_and_their_errors_count_for_nothing() {
    let lqr = constant(uneven(3.0), 1e6);
    let mut situation = calm(0.0);
    situation.active[HEAVE] = 0.0;
    situation.active[HEADING] = 0.0;
    let run = |situation: &Situation<f64>| {
        let mut state = LqrState::at_rest(0.0);
        lqr.step(&mut state, &calm(0.0), &weights(0.0), 0.0);
        lqr.step(&mut state, situation, &weights(0.0), 0.0);
        lqr.step(&mut state, situation, &weights(0.0), 0.0)
    };
    let without = run(&situation);
    situation.error[HEAVE] = 5.0;
    situation.error[HEADING] = 1.0;
    assert_eq!(run(&situation), without);
    situation.error[SURGE] = 1.0;
    let with = run(&situation);
    assert_ne!(with, without);
    assert_eq!((with[HEAVE], with[HEADING]), (0.0, 0.0));
}

/// The message with which tables are refused.
fn refusal(tables: &[LqrTable]) -> String {
    Lqr::new(tables, &["hover", "cruise"], &[1.0; 6], "a.toml").expect_err("a table to refuse").to_string()
}

#[test]
fn messages_say_what_is_wrong_with_a_table() {
    let good = |mode: &str| table(mode, vec![uneven(0.0)]);
    assert!(refusal(&[good("hover")]).contains("one table [[lqr]] for the mode \"cruise\", found 0"));
    assert!(refusal(&[good("hover"), good("cruise"), good("hover")]).contains("\"hover\", found 2"));
    assert!(refusal(&[good("hover"), good("cruse")]).contains("did you mean \"cruise\"?"));
    let three = table("cruise", vec![uneven(0.0); 3]);
    assert!(refusal(&[good("hover"), three]).contains("expected 1 matrix or 6"));
    let mut short = good("cruise");
    short.gain[0][2].pop();
    assert!(refusal(&[good("hover"), short]).contains("found rows of [15, 15, 14, 15, 15, 15]"));
    let mut infinite = good("cruise");
    infinite.gain[0][2][1] = f64::NAN;
    assert!(refusal(&[good("hover"), infinite]).contains("expected finite numbers, found NaN"));
    let never = LqrTable { tracking_s: 0.0, ..good("cruise") };
    assert!(refusal(&[good("hover"), never]).contains("tracking_s: expected a positive time"));
}

#[test]
fn file_table_reads_what_it_writes() {
    let table = table("cruise", vec![uneven(1.0); 6]);
    let text = toml::to_string(&table).expect("plain numbers");
    assert_eq!(toml::from_str::<LqrTable>(&text).expect("its own text"), table);
    assert!(toml::from_str::<LqrTable>("mode = \"x\"\ngian = []").is_err());
}
