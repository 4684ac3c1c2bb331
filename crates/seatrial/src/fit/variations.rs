//! Derivatives of a flight by the variational equations: the flight is linearised once per stage of the Runge–Kutta
//! step, and all unknowns follow that one linearisation.
//!
//! For an unknown θ and the state x with `x' = f(x, θ)`, the derivative `s = ∂x/∂θ` follows `s' = (∂f/∂x) s + ∂f/∂θ`.
//! Both are taken stage by stage, so that the result is the exact derivative of the numerical flight, as dual numbers
//! give it, up to rounding. `∂ν'/∂x` is shared: ν' depends on the state through ν, the rotation matrix and, with a
//! tether or a surface, the position, and is differentiated by these in dual numbers. `∂f/∂θ` is summed over the terms alone that
//! an unknown stands in, `∂ν'/∂θ = M⁻¹ (∂F/∂θ − (∂M/∂θ) ν')`.
//!
//! Source: Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, section I.14; Griewank & Walther,
//! *Evaluating Derivatives* (2008), chapter 3.
//! Tests: `tests/scalars/sensitivities.rs`, `tests/scalars/instruction_sets.rs` (against dual numbers).

use crate::error::Error;
use crate::fit::batch::Batch;
use crate::fit::observation::Shown;
use crate::fit::open_loop::{Course, STEPS_BETWEEN_LOOKS};
use crate::fit::record::Start;
use crate::fit::sensitivities::{Group, Prepared, Work, initial, unit_in_lanes};
use crate::model::integrate::{STAGES, State};
use crate::model::kinematics::{quaternion_rate, renormalised, rotation};
use crate::model::vehicle::{Instant, Mode, Summed, Vehicle, hand_on};
use crate::number::algebra::{Mat3, Vec6, each, product};
use crate::number::dual::Dual;
use crate::number::lanes::LANES;
use crate::number::real::Real;
use fearless_simd::{Simd, SimdBase, f64x8};
use std::ops::Range;
use std::sync::atomic::Ordering;

/// What ν' depends on: ν, the rows of the rotation matrix, the position.
const SEEDS: usize = 18;

/// One stage of a step: where it stands and heads, and the derivatives of where it heads.
struct Stage {
    row: [f64; 13],
    rotation: Mat3<f64>,
    slope: [f64; 13],
    /// Of the position's rate by attitude and linear velocity.
    position: [[f64; LANES]; 3],
    /// Of the attitude's rate by attitude and angular velocity.
    attitude: [[f64; LANES]; 4],
    /// Of ν' by [`Seeds::axes`], by the attitude, and by the position.
    by: [[[f64; LANES]; 6]; 3],
}

/// The vehicle of a record in plain numbers, in those of the linearisation, and with the unknowns of every group.
type Parts<'a, P> = (&'a Prepared<f64>, &'a Vehicle<Dual<P>>, &'a [Prepared<Dual<P>>]);

/// How a flight is linearised.
struct Seeds<P> {
    /// The velocities that ν' depends on.
    axes: Vec<usize>,
    /// All seeds of ν' that count, these velocities first.
    which: Vec<usize>,
    /// Per eight of them the seeds of ν, rotation and position, and the terms that depend on these.
    units: Vec<([P; SEEDS], Summed)>,
    /// Unit vectors of seven: the attitude, and a velocity.
    motion: [P; 7],
    /// Whether the position acts on the motion: a tether pulls, or the surface is known.
    placed: bool,
}

/// The derivatives by up to eight unknowns along a flight.
struct Tangent<'a, P> {
    of: Summed,
    vehicle: &'a Vehicle<Dual<P>>,
    /// What acts, where it depends on the unknowns.
    course: Option<Course<'a, Dual<P>>>,
    /// Whether the motors' signals depend on them too.
    motor: bool,
    shown: Shown<'a, Dual<P>>,
    change: [P; 13],
    sum: [P; 13],
    slope: [P; 13],
}

/// Values and derivatives in one row.
#[inline(always)]
fn paired<P: Real>(values: &[f64; 13], partials: &[P; 13]) -> State<Dual<P>> {
    let mut row = [Dual { value: 0.0, partials: partials[0] }; 13];
    for i in 0..13 {
        row[i] = Dual { value: values[i], partials: partials[i] };
    }
    State::from_row(&row)
}

/// The derivatives of a state.
#[inline(always)]
fn partials<P: Real>(state: &State<Dual<P>>) -> [P; 13] {
    let row = state.row();
    let mut partials = [row[0].partials; 13];
    for i in 0..13 {
        partials[i] = row[i].partials;
    }
    partials
}

impl<S: Simd> Seeds<f64x8<S>> {
    /// Those that count: an axis that follows the log does not, and the rotation counts by its last row alone where
    /// the water stands still and the position does not act.
    fn new(simd: S, modes: &[Mode; 6], current: bool, placed: bool) -> Self {
        let counts = |seed: &usize| match seed {
            0..6 => modes[*seed] != Mode::Measured,
            6..12 => current || placed,
            12..15 => true,
            _ => placed,
        };
        let which: Vec<usize> = (0..SEEDS).filter(counts).collect();
        let unit = |is: &dyn Fn(usize) -> bool| f64x8::from_fn(simd, |lane| if is(lane) { 1.0 } else { 0.0 });
        // In still water, where the position does not act, the rotation turns weight and buoyancy alone.
        let restoring = Summed { restoring: true, ..Summed::default() };
        let of = |some: &[usize]| match some.iter().all(|seed| (12..15).contains(seed)) {
            true if !current && !placed => restoring,
            _ => Summed::ALL,
        };
        let units = which
            .chunks(LANES)
            .map(|some| (std::array::from_fn(|seed| unit(&|lane| some.get(lane) == Some(&seed))), of(some)));
        let motion = std::array::from_fn(|seed| unit(&|lane| lane == seed));
        let axes = which.iter().copied().filter(|&seed| seed < 6).collect();
        Self { units: units.collect(), axes, which, motion, placed }
    }
}

impl Stage {
    /// Moves the stage to a row.
    #[inline(always)]
    fn take<S: Simd>(
        &mut self,
        (plain, frame): (&Vehicle<f64>, &Vehicle<Dual<f64x8<S>>>),
        row: &[f64; 13],
        seeds: &Seeds<f64x8<S>>,
        instant: &Instant<Dual<f64x8<S>>>,
    ) {
        let mut at = State::from_row(row);
        for i in 0..6 {
            if plain.modes[i] == Mode::Measured {
                at.nu[i] = instant.measured[0][i];
            }
        }
        self.row = at.row();
        let seeded = |value: f64, partials: f64x8<S>| Dual { value, partials };
        let motion = &seeds.motion;
        let mut attitude = [seeded(0.0, motion[0]); 4];
        for i in 0..4 {
            attitude[i] = seeded(at.attitude[i], motion[i]);
        }
        let (mut v, mut omega) = ([attitude[0]; 3], [attitude[0]; 3]);
        for i in 0..3 {
            v[i] = seeded(at.nu[i], motion[4 + i]);
            omega[i] = seeded(at.nu[3 + i], motion[4 + i]);
        }
        let r = rotation(&attitude);
        for i in 0..3 {
            for j in 0..3 {
                self.rotation[i][j] = r[i][j].value;
            }
        }
        let moved = product(&r, &v);
        for i in 0..3 {
            self.slope[i] = moved[i].value;
            self.position[i] = moved[i].partials.into();
        }
        let turned = quaternion_rate(&attitude, &omega);
        for i in 0..4 {
            self.slope[3 + i] = turned[i].value;
            self.attitude[i] = turned[i].partials.into();
        }
        // By the attitude through the rotation.
        let mut through = [motion[0].zero(); 6];
        for (first, (units, of)) in seeds.units.iter().enumerate() {
            let (mut nu, mut turn) = ([attitude[0]; 6], [[attitude[0]; 3]; 3]);
            let mut place = [attitude[0]; 3];
            for i in 0..6 {
                nu[i] = seeded(at.nu[i], units[i]);
            }
            for i in 0..3 {
                place[i] = seeded(at.position[i], units[15 + i]);
                for j in 0..3 {
                    turn[i][j] = seeded(r[i][j].value, units[6 + 3 * i + j]);
                }
            }
            let frame = std::hint::black_box(frame);
            let force = frame.force(*of, (Some(&place), &turn), &nu, instant);
            let (mut values, mut slopes) = ([0.0; 6], [motion[0]; 6]);
            for i in 0..6 {
                values[i] = force[i].value;
                slopes[i] = force[i].partials;
            }
            let slopes = plain.accelerated(&slopes);
            if first == 0 {
                let rate = plain.solve(&values, &instant.measured[1]);
                for i in 0..6 {
                    self.slope[7 + i] = rate[i];
                    self.by[0][i] = slopes[i].into();
                }
            }
            let others = if first == 0 { seeds.axes.len() } else { 0 };
            let some = &seeds.which[first * LANES..seeds.which.len().min((first + 1) * LANES)];
            for (lane, &seed) in some.iter().enumerate().skip(others) {
                for i in 0..6 {
                    let by: [f64; LANES] = slopes[i].into();
                    if seed < 15 {
                        let turned = r[(seed - 6) / 3][(seed - 6) % 3].partials;
                        through[i] = turned.mul_add(turned.splat(by[lane]), through[i]);
                    } else {
                        self.by[2][i][seed - 15] = by[lane];
                    }
                }
            }
        }
        for i in 0..6 {
            self.by[1][i] = through[i].into();
        }
    }
}

/// `sum` and the changes times their factors.
#[inline(always)]
fn carried<P: Real>(changes: &[P], factors: &[f64], sum: P) -> P {
    let mut sum = sum;
    for i in 0..changes.len().min(factors.len()) {
        sum = changes[i].mul_add(sum.splat(factors[i]), sum);
    }
    sum
}

impl<S: Simd> Tangent<'_, f64x8<S>> {
    /// The derivative of the slope at a stage, at the change `row` of where it stands.
    #[inline(always)]
    fn slope_at(
        &self,
        plain: &Vehicle<f64>,
        stage: &Stage,
        seeds: &Seeds<f64x8<S>>,
        row: &[f64x8<S>; 13],
        instant: &Instant<Dual<f64x8<S>>>,
    ) -> [f64x8<S>; 13] {
        let none = row[0].zero();
        let mut row = *row;
        for i in 0..6 {
            if plain.modes[i] == Mode::Measured {
                row[7 + i] = none;
            }
        }
        let mut slope = [none; 13];
        if self.of != Summed::default() {
            let own = plain.accelerated(&self.own_force(stage, none, instant));
            slope[7..].copy_from_slice(&own);
        }
        for i in 0..3 {
            slope[i] = carried(&row[3..10], &stage.position[i], slope[i]);
        }
        for i in 0..4 {
            slope[3 + i] = carried(&row[3..7], &stage.attitude[i], slope[3 + i]);
            slope[3 + i] = carried(&row[10..13], &stage.attitude[i][4..], slope[3 + i]);
        }
        let mut nu = [none; 6];
        for i in 0..seeds.axes.len() {
            nu[i] = row[7 + seeds.axes[i]];
        }
        for i in 0..6 {
            if plain.modes[i] == Mode::Free {
                slope[7 + i] = carried(&row[3..7], &stage.by[1][i], slope[7 + i]);
                slope[7 + i] = carried(&nu, &stage.by[0][i], slope[7 + i]);
                if seeds.placed {
                    slope[7 + i] = carried(&row[..3], &stage.by[2][i], slope[7 + i]);
                }
            }
        }
        slope
    }

    /// `∂F/∂θ − (∂M/∂θ) ν'` at the state of a stage.
    #[inline(always)]
    fn own_force(&self, stage: &Stage, none: f64x8<S>, instant: &Instant<Dual<f64x8<S>>>) -> Vec6<f64x8<S>> {
        let at = paired(&stage.row, &[none; 13]);
        let vehicle = std::hint::black_box(self.vehicle);
        let mut r = [[Dual { value: 0.0, partials: none }; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                r[i][j].value = stage.rotation[i][j];
            }
        }
        let mut force = vehicle.force(self.of, (Some(&at.position), &r), &at.nu, instant);
        if self.of.mass {
            let inertia = vehicle.inertia(&paired(&stage.slope, &[none; 13]).nu);
            for i in 0..6 {
                force[i] -= inertia[i];
            }
        }
        let mut partials = [none; 6];
        for i in 0..6 {
            partials[i] = force[i].partials;
        }
        partials
    }
}

/// A start in the number type of the derivatives.
#[inline(always)]
fn lifted<P: Real>(start: &Start<f64>, unit: Dual<P>) -> Start<Dual<P>> {
    let mut row = [unit; 13];
    for (to, from) in row.iter_mut().zip(start.state.row()) {
        *to = unit.splat(from);
    }
    let current = start.current.map(|current| current.map(|x| unit.splat(x)));
    Start { state: State::from_row(&row), current }
}

/// What acts at an instant, in the number type of the derivatives.
#[inline(always)]
fn lift<P: Real>(from: &Instant<f64>, to: &mut Instant<Dual<P>>, unit: Dual<P>, inflow: bool) {
    to.tau = from.tau;
    to.measured = from.measured;
    to.inflow_free = from.inflow_free.as_ref().map(|wrench| {
        let mut lifted = [unit; 6];
        for i in 0..6 {
            lifted[i] = unit.splat(wrench[i]);
        }
        lifted
    });
    to.current = from.current.as_ref().map(|current| current.in_kind_of(unit));
    if inflow {
        to.thrusts.clear();
        to.thrusts.extend(from.thrusts.iter().map(|thrust| thrust.in_kind_of(unit)));
        to.deflections.clear();
        to.deflections.extend(from.deflections.iter().map(|(sin, cos)| (unit.splat(*sin), unit.splat(*cos))));
    }
}

impl Batch<'_> {
    /// The derivatives of what segments of one record show by every group of unknowns, per segment and group
    /// `[sample, channel asked for][unknown]`.
    #[inline(always)]
    pub(super) fn varied<S: Simd>(
        &self,
        simd: S,
        work: &Work<'_>,
        groups: &[Group],
        segments: Range<usize>,
    ) -> Result<Vec<Vec<[f64; LANES]>>, Error> {
        let record = self.segments[segments.start].record;
        let plain = self.unseeded(work, record);
        let frame = self.seeded_in_lanes(simd, work, &[], record).vehicle;
        let mut prepared: Vec<Prepared<Dual<f64x8<S>>>> = Vec::with_capacity(groups.len());
        for group in groups {
            prepared.push(self.seeded_in_lanes(simd, work, &group.unknowns, record));
        }
        let mut found = Vec::with_capacity(segments.len() * groups.len());
        for s in segments {
            self.vary(simd, work, groups, (&plain, &frame, &prepared), s, &mut found)?;
        }
        Ok(found)
    }

    /// Those of one segment, appended to `found`.
    #[inline(always)]
    fn vary<S: Simd>(
        &self,
        simd: S,
        work: &Work<'_>,
        groups: &[Group],
        (plain, frame, prepared): Parts<'_, f64x8<S>>,
        s: usize,
        found: &mut Vec<Vec<[f64; LANES]>>,
    ) -> Result<(), Error> {
        let none = simd.splat_f64x8(0.0);
        let unit = Dual { value: 0.0, partials: none };
        let segment = &self.segments[s];
        let record = &self.records[segment.record];
        let start = plain.start(segment, &work.point.initial[s]);
        let mut starts = Vec::with_capacity(groups.len());
        for (group, one) in groups.iter().zip(prepared) {
            let unknowns = &group.unknowns;
            if !group.start {
                starts.push(lifted(&start, unit));
                continue;
            }
            let own = |wanted| unit_in_lanes(simd, unknowns, wanted);
            starts.push(one.start(segment, &initial(work, none, own, unknowns, s)));
        }
        let mut current = start.current;
        if let Some(sought) = starts.iter().find_map(|one| one.current) {
            current = Some([sought[0].value, sought[1].value, sought[2].value]);
        }
        let mut course = Course::new(&plain.vehicle, record, segment, self.substeps, current, 0.0);
        let mut instants: [Instant<Dual<f64x8<S>>>; 3] = Default::default();
        let flowing = current.is_some() || !record.current.is_empty();
        let surfaced = frame.surface.is_some();
        let seeds = Seeds::new(simd, &self.modes, flowing, frame.tether.is_some() || surfaced);
        let inflow = surfaced
            || !frame.fins.is_empty()
            || frame.actuators.iter().any(|a| a.characteristic.has_inflow());
        let mut state = start.state;
        let mut tangents: Vec<Tangent<'_, f64x8<S>>> = Vec::with_capacity(groups.len());
        for ((group, one), start) in groups.iter().zip(prepared).zip(&starts) {
            let own = group.of.thrust || group.current;
            tangents.push(Tangent {
                of: group.of,
                vehicle: &one.vehicle,
                course: own.then(|| {
                    let (vehicle, current) = (&one.vehicle, start.current);
                    if group.motor {
                        Course::new(vehicle, record, segment, self.substeps, current, unit)
                    } else {
                        Course::following(vehicle, record, segment, self.substeps, current, unit)
                    }
                }),
                motor: group.motor,
                shown: one.shown(work.asked, segment),
                change: partials(&start.state),
                sum: [none; 13],
                slope: [none; 13],
            });
        }
        let mut stage = Stage {
            row: [0.0; 13],
            rotation: [[0.0; 3]; 3],
            slope: [0.0; 13],
            position: [[0.0; LANES]; 3],
            attitude: [[0.0; LANES]; 4],
            by: [[[0.0; LANES]; 6]; 3],
        };
        let h = record.dt / self.substeps as f64;
        'flight: for k in segment.start..segment.stop {
            for step in 0..self.substeps {
                if step % STEPS_BETWEEN_LOOKS == 0 && work.stop.load(Ordering::Relaxed) {
                    return Err(Error::Interrupted);
                }
                course.begin(k, step);
                for tangent in &mut tangents {
                    match &mut tangent.course {
                        Some(own) if tangent.motor => own.begin(k, step),
                        Some(own) => own.begin_with(&course, k, step),
                        None => {}
                    }
                }
                if step == 0 {
                    if k == segment.start {
                        state.replay(&plain.vehicle, &course.instants[0]);
                        for tangent in &mut tangents {
                            for i in 0..6 {
                                if self.modes[i] == Mode::Measured {
                                    tangent.change[7 + i] = none;
                                }
                            }
                        }
                    }
                    for tangent in &mut tangents {
                        tangent.shown.add(&paired(&state.row(), &tangent.change));
                    }
                    if k + 1 == segment.stop {
                        break 'flight;
                    }
                }
                for half in 1..3 {
                    course.half(k, step, half);
                    for tangent in &mut tangents {
                        match &mut tangent.course {
                            Some(own) if tangent.motor => own.half(k, step, half),
                            Some(own) => own.half_with(&course, k, half),
                            None => {}
                        }
                    }
                }
                for i in 0..3 {
                    lift(&course.instants[i], &mut instants[i], unit, inflow);
                }
                state = self.varied_step(
                    (&plain.vehicle, frame),
                    &mut stage,
                    &state,
                    h,
                    &instants,
                    &seeds,
                    &mut tangents,
                );
                hand_on(&mut course.instants);
                for tangent in &mut tangents {
                    if let Some(course) = &mut tangent.course {
                        hand_on(&mut course.instants);
                    }
                }
            }
        }
        for tangent in tangents {
            let shown = tangent.shown.finish(record.dt);
            found.push(shown.iter().map(|x| x.partials.into()).collect());
        }
        Ok(())
    }

    /// The state a step later, [`crate::model::integrate::step`], with its derivatives.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the step of one flight")]
    fn varied_step<S: Simd>(
        &self,
        (plain, frame): (&Vehicle<f64>, &Vehicle<Dual<f64x8<S>>>),
        stage: &mut Stage,
        state: &State<f64>,
        h: f64,
        instants: &[Instant<Dual<f64x8<S>>>; 3],
        seeds: &Seeds<f64x8<S>>,
        tangents: &mut [Tangent<'_, f64x8<S>>],
    ) -> State<f64> {
        let none = seeds.motion[0].zero();
        let start = state.row();
        let (mut sum, mut slope) = (start, [0.0; 13]);
        for tangent in tangents.iter_mut() {
            tangent.sum = tangent.change;
            tangent.slope = [none; 13];
        }
        for (node, weight, instant) in STAGES {
            let (node, weight) = (node * h, weight * h);
            let mut row = start;
            for i in 0..13 {
                row[i] = slope[i].mul_add(node, row[i]);
            }
            stage.take((plain, frame), &row, seeds, &instants[instant]);
            slope = stage.slope;
            for i in 0..13 {
                sum[i] = slope[i].mul_add(weight, sum[i]);
            }
            let (node, weight) = (none.splat(node), none.splat(weight));
            for tangent in tangents.iter_mut() {
                let mut row = tangent.change;
                for i in 0..13 {
                    row[i] = tangent.slope[i].mul_add(node, row[i]);
                }
                let acting = match &tangent.course {
                    Some(course) => &course.instants,
                    None => instants,
                };
                let slope = tangent.slope_at(plain, stage, seeds, &row, &acting[instant]);
                tangent.slope = slope;
                for i in 0..13 {
                    tangent.sum[i] = slope[i].mul_add(weight, tangent.sum[i]);
                }
            }
        }
        for tangent in tangents.iter_mut() {
            let ended = paired(&sum, &tangent.sum).row();
            let mut next = State::from_row(&each(&ended, Real::flush));
            next.attitude = renormalised(&next.attitude);
            tangent.change = partials(&next);
            for i in 0..6 {
                if self.modes[i] == Mode::Measured {
                    tangent.change[7 + i] = none;
                }
            }
        }
        let mut next = State::from_row(&each(&sum, Real::flush));
        next.attitude = renormalised(&next.attitude);
        for i in 0..6 {
            if self.modes[i] == Mode::Measured {
                next.nu[i] = instants[2].measured[0][i];
            }
        }
        next
    }
}
