//! What the channels of every segment show, and its exact derivatives by any coefficient, nuisance
//! parameter and initial condition.
//!
//! In lanes eight unknowns go abreast, by the variational equations ([`super::variations`]); without lanes every
//! unknown has a flight of its own in dual numbers. Segments of one record share its vehicle, short ones a task with
//! some unknowns; each has a result of its own, so that threads never change one.
//!
//! The model has corners, where one of the derivatives beside them counts: a dead time or a latency of whole
//! steps, knots of a measured table, the ends of a rate limit; |x| at zero has derivative zero. Behind a rate
//! limit a dead time matters only near the end of a step: a jump of the command that arrives within one
//! starts the same ramp.
//!
//! Tests: `tests/scalars/sensitivities.rs`, `tests/core/test_sensitivities.py` (finite differences),
//! `tests/core/test_casadi_derivatives.py`.

use crate::description::assembly::Structure;
use crate::description::coefficients as names;
use crate::error::Error;
use crate::fit::batch::Batch;
use crate::fit::criterion::{CHANNELS, Criterion, Loss};
use crate::fit::motors::of_a_motor;
use crate::fit::observation::{FORCE, INITIALS, NUISANCES, Nuisance, Shown};
use crate::fit::open_loop::{Observer, fly};
use crate::fit::record::{Record, Segment, Start};
use crate::model::vehicle::{Summed, Vehicle};
use crate::number::dual::{Dual, Valued};
use crate::number::lanes::{LANES, level};
use crate::number::real::Real;
use fearless_simd::{Level, Simd, SimdBase, f64x8};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

/// One number whose change is of interest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// A row of [`Point::directions`]: coefficients that move together.
    Direction(usize),
    /// A nuisance parameter, by its place among [`crate::fit::observation::nuisance_names`].
    Nuisance(usize),
    /// An initial condition of the segment, by its place among [`crate::fit::observation::INITIAL_NAMES`].
    Initial(usize),
}

/// Where the derivatives are taken.
#[derive(Clone, Copy)]
pub struct Point<'a> {
    /// Indices of the coefficients that are set.
    pub sought: &'a [usize],
    /// Their values.
    pub values: &'a [f64],
    /// Rows of changes of these coefficients, `directions[row * sought.len() + i]`.
    pub directions: &'a [f64],
    /// Per record.
    pub nuisance: &'a [[f64; NUISANCES]],
    /// Per segment.
    pub initial: &'a [[f64; INITIALS]],
}

impl Point<'_> {
    /// The change of the sought coefficient `i` along an unknown.
    fn along(&self, unknown: Unknown, i: usize) -> f64 {
        match unknown {
            Unknown::Direction(row) => self.directions[row * self.sought.len() + i],
            _ => 0.0,
        }
    }
}

/// What a segment shows.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// The channels at every sample.
    pub rows: Vec<[f64; CHANNELS]>,
    /// `[sample][channel among those asked for][unknown]`.
    pub jacobian: Vec<f64>,
}

/// Value and gradient of the criterion on a segment.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// The sum per channel.
    pub sums: [f64; CHANNELS],
    /// `[channel][unknown]`.
    pub slopes: Vec<f64>,
}

pub(super) struct Work<'a> {
    pub point: Point<'a>,
    pub structure: Structure,
    pub asked: &'a [usize],
    /// Per record, whether no unknown and no value of the whole request lies between motion and channels or in
    /// a start: all its groups of eight take the same way, so that grouping never changes a bit.
    plain: Vec<bool>,
    pub stop: &'a AtomicBool,
}

/// A record's vehicle, and what stands between motion and channels.
pub(super) struct Prepared<T> {
    pub vehicle: Vehicle<T>,
    shows: Nuisance<T>,
    plain: bool,
}

impl<T: Real> Prepared<T> {
    /// The start of a segment, moved by its initial conditions.
    #[inline(always)]
    pub fn start(&self, segment: &Segment, initial: &[T; INITIALS]) -> Start<T> {
        // Where nothing stands between motion and channels, they are the plain model's to the last bit.
        let none = initial[0].zero();
        let mut start =
            if self.plain { Start::of(segment, none) } else { self.shows.start(segment, initial) };
        // Still water stays still water.
        start.current = start.current.filter(|current| !current.iter().all(|x| x.equals(none)));
        start
    }

    /// Nothing yet of what a segment shows.
    #[inline(always)]
    pub fn shown<'a>(&'a self, asked: &'a [usize], segment: &Segment) -> Shown<'a, T> {
        Shown::new((!self.plain).then_some(&self.shows), asked, segment.stop - segment.start)
    }
}

/// Up to eight unknowns that go abreast.
pub(super) struct Group {
    /// Their places among all.
    pub places: Vec<usize>,
    pub unknowns: Vec<Unknown>,
    /// The terms of the equation of motion that they stand in themselves.
    pub of: Summed,
    /// Whether the current is among them.
    pub current: bool,
    /// Whether a motor's coefficient is among them.
    pub motor: bool,
    /// Whether something among them moves a start.
    pub start: bool,
}

/// Groups to a task: they share the flight and its linearisation.
const ABREAST: usize = 16;

/// Samples of the segments to a task.
const TOGETHER: usize = 64;

const ALL: [usize; CHANNELS] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

impl Batch<'_> {
    /// What every segment shows, and the derivatives of the channels `asked` for.
    ///
    /// # Errors
    /// [`Error::Interrupted`], or a forced instruction set that is not there.
    pub fn sensitivities(
        &self,
        point: Point<'_>,
        unknowns: &[Unknown],
        asked: &[usize],
        stop: &AtomicBool,
    ) -> Result<Vec<Prediction>, Error> {
        let rows = self.predictions(point, stop)?;
        let coefficients_only = unknowns.iter().all(|unknown| matches!(unknown, Unknown::Direction(_)));
        let work = self.work(point, asked, coefficients_only, stop);
        let groups = self.groups(point, unknowns);
        let partials = self.differentiate(&work, &groups)?;
        Ok((0..self.segments.len())
            .into_par_iter()
            .zip(rows)
            .map(|(s, rows)| {
                let mut jacobian = vec![0.0; rows.len() * asked.len() * unknowns.len()];
                for (place, row) in jacobian.chunks_exact_mut(unknowns.len().max(1)).enumerate() {
                    for (group, partials) in groups.iter().zip(&partials[s * groups.len()..]) {
                        for (&to, from) in group.places.iter().zip(&partials[place]) {
                            row[to] = from + 0.0; // no zero is negative for its neighbours' sake
                        }
                    }
                }
                Prediction { rows, jacobian }
            })
            .collect())
    }

    /// The criterion of every segment on what its channels show, infinite where the model diverged, and its
    /// gradient.
    ///
    /// # Errors
    /// [`Error::Interrupted`], or a forced instruction set that is not there.
    pub fn gradient(
        &self,
        point: Point<'_>,
        unknowns: &[Unknown],
        loss: Loss,
        stop: &AtomicBool,
    ) -> Result<Vec<Gradient>, Error> {
        self.check_observed()?;
        let shown = self.sensitivities(point, unknowns, &ALL, stop)?;
        let one = |(segment, prediction): (&Segment, &Prediction)| {
            let record = &self.records[segment.record];
            let width = unknowns.len();
            let mut sums = [0.0; CHANNELS];
            let mut slopes = vec![0.0; CHANNELS * width];
            // The slope of the loss by what a channel shows, times what that is by the unknown.
            for (k, row) in prediction.rows.iter().enumerate().skip(1) {
                let (row, at) = (row.map(|value| Dual { value, partials: 1.0 }), segment.start + k);
                let (observed, weight) = (&record.observed, &record.weight);
                let mut criterion = Criterion::new(observed, weight, at..at + 1, loss, row[0].zero());
                criterion.compare(at, &row);
                for c in 0..CHANNELS {
                    sums[c] += criterion.sums[c].value;
                    let slope = criterion.sums[c].partials;
                    let partials = &prediction.jacobian[(k * CHANNELS + c) * width..][..width];
                    for (to, partial) in slopes[c * width..][..width].iter_mut().zip(partials) {
                        *to += slope * partial;
                    }
                }
            }
            let sums = sums.map(|sum| if sum.is_finite() { sum } else { f64::INFINITY });
            Gradient { sums, slopes }
        };
        Ok(self.segments.par_iter().zip(&shown).map(one).collect())
    }

    /// What every segment shows, in plain `f64`.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn predictions(
        &self,
        point: Point<'_>,
        stop: &AtomicBool,
    ) -> Result<Vec<Vec<[f64; CHANNELS]>>, Error> {
        let work = self.work(point, &ALL, true, stop);
        let found = self
            .together()
            .into_par_iter()
            .map(|segments| {
                let place = self.segments[segments.start].record;
                let (record, prepared) = (&self.records[place], self.unseeded(&work, place));
                segments
                    .map(|s| {
                        let segment = &self.segments[s];
                        let start = prepared.start(segment, &point.initial[s]);
                        let mut observer = Observer::Shown(prepared.shown(work.asked, segment));
                        fly(
                            &prepared.vehicle,
                            record,
                            segment,
                            (self.substeps, &start),
                            &mut observer,
                            stop,
                        )?;
                        Ok(finished(observer, record.dt).as_chunks().0.to_vec())
                    })
                    .collect()
            })
            .collect::<Result<Vec<Vec<_>>, Error>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    fn work<'a>(
        &self,
        point: Point<'a>,
        asked: &'a [usize],
        coefficients_only: bool,
        stop: &'a AtomicBool,
    ) -> Work<'a> {
        let still = |row: &[f64]| row.iter().all(|&x| x == 0.0);
        let mut plain: Vec<bool> = point.nuisance.iter().map(|row| coefficients_only && still(row)).collect();
        for (segment, row) in self.segments.iter().zip(point.initial) {
            plain[segment.record] &= still(row);
        }
        Work { point, structure: Structure::new(self.description, point.sought), asked, plain, stop }
    }

    /// The segments by tasks: neighbours of one record, short ones together.
    fn together(&self) -> Vec<Range<usize>> {
        let mut tasks: Vec<Range<usize>> = Vec::new();
        let mut samples = 0;
        for (s, segment) in self.segments.iter().enumerate() {
            let own = segment.stop - segment.start;
            match tasks.last_mut() {
                Some(task)
                    if self.segments[task.start].record == segment.record && samples + own <= TOGETHER =>
                {
                    task.end += 1;
                    samples += own;
                }
                _ => {
                    tasks.push(s..s + 1);
                    samples = own;
                }
            }
        }
        tasks
    }

    /// The unknowns by eight, those of the same terms together.
    fn groups(&self, point: Point<'_>, unknowns: &[Unknown]) -> Vec<Group> {
        let current = |unknown| matches!(unknown, Unknown::Nuisance(0..3));
        // At a surface the terms are no sum: the mass that they accelerate changes with the place.
        let surfaced = self.records.iter().any(|record| record.surface.is_some());
        let of = |&place: &usize| match unknowns[place] {
            _ if surfaced => Summed::ALL,
            Unknown::Direction(_) => {
                point.sought.iter().enumerate().fold(Summed::default(), |all, (i, &index)| {
                    if point.along(unknowns[place], i) == 0.0 { all } else { all.and(summed(index)) }
                })
            }
            Unknown::Nuisance(0..3) => Summed::ALL,
            Unknown::Nuisance(FORCE..) => Summed { bias: true, ..Summed::default() },
            Unknown::Nuisance(_) | Unknown::Initial(_) => Summed::default(),
        };
        let motor = |&place: &usize| {
            let mut moved = point.sought.iter().enumerate();
            moved.any(|(i, &index)| of_a_motor(index) && point.along(unknowns[place], i) != 0.0)
        };
        let mut places: Vec<usize> = (0..unknowns.len()).collect();
        places.sort_by_cached_key(|place| (of(place), motor(place)));
        let group = |places: &[usize]| Group {
            places: places.to_vec(),
            unknowns: places.iter().map(|&place| unknowns[place]).collect(),
            of: places.iter().fold(Summed::default(), |all, place| all.and(of(place))),
            current: places.iter().any(|&place| current(unknowns[place])),
            motor: places.iter().any(motor),
            start: places.iter().any(|&place| !matches!(unknowns[place], Unknown::Direction(_))),
        };
        places.chunks(LANES).map(group).collect()
    }

    /// The partials of every segment by every group of unknowns, `[segment][group]` in one row, each
    /// `[sample, channel asked for][unknown of the group]`.
    fn differentiate(&self, work: &Work<'_>, groups: &[Group]) -> Result<Vec<Vec<[f64; LANES]>>, Error> {
        let (name, level) = level()?;
        let tasks: Vec<(Range<usize>, usize, &[Group])> = self
            .together()
            .into_iter()
            .flat_map(|segments| {
                let chunks = groups.chunks(ABREAST).enumerate();
                chunks.map(move |(chunk, some)| (segments.clone(), chunk * ABREAST, some))
            })
            .collect();
        let partials = tasks
            .par_iter()
            .map(|(segments, _, some)| {
                if name == "fallback" {
                    self.one_by_one(work, some, segments.clone())
                } else {
                    on_level(level, self, work, some, segments.clone())
                }
            })
            .collect::<Result<Vec<Vec<_>>, Error>>()?;
        let mut found = vec![Vec::new(); self.segments.len() * groups.len()];
        for ((segments, first, some), partials) in tasks.into_iter().zip(partials) {
            for (i, one) in partials.into_iter().enumerate() {
                let (s, group) = (segments.start + i / some.len(), first + i % some.len());
                found[s * groups.len() + group] = one;
            }
        }
        Ok(found)
    }

    /// The derivatives by one unknown after the other, where there are no lanes: per segment and group.
    fn one_by_one(
        &self,
        work: &Work<'_>,
        groups: &[Group],
        segments: Range<usize>,
    ) -> Result<Vec<Vec<[f64; LANES]>>, Error> {
        let mut found = vec![Vec::new(); segments.len() * groups.len()];
        let place = self.segments[segments.start].record;
        let record = &self.records[place];
        for (i, group) in groups.iter().enumerate() {
            for (lane, &seed) in group.unknowns.iter().enumerate() {
                let unit = |wanted: Unknown| if seed == wanted { 1.0 } else { 0.0 };
                let along = |i: usize| work.point.along(seed, i);
                let seeded = self.seeded(work, 0.0, (unit, along), &group.unknowns, place);
                for (j, s) in segments.clone().enumerate() {
                    let segment = &self.segments[s];
                    let start = seeded.start(segment, &initial(work, 0.0, unit, &group.unknowns, s));
                    let mut observer = Observer::Shown(seeded.shown(work.asked, segment));
                    fly(&seeded.vehicle, record, segment, (self.substeps, &start), &mut observer, work.stop)?;
                    let shown = finished(observer, record.dt);
                    let all = &mut found[j * groups.len() + i];
                    all.resize(shown.len(), [0.0; LANES]);
                    for (to, from) in all.iter_mut().zip(&shown) {
                        to[lane] = from.partials;
                    }
                }
            }
        }
        Ok(found)
    }

    /// The vehicle of a record with up to eight unknowns, each in a lane of its own.
    #[inline(always)]
    pub(super) fn seeded_in_lanes<S: Simd>(
        &self,
        simd: S,
        work: &Work<'_>,
        unknowns: &[Unknown],
        record: usize,
    ) -> Prepared<Dual<f64x8<S>>> {
        let unit = |wanted: Unknown| unit_in_lanes(simd, unknowns, wanted);
        let along = |i: usize| {
            f64x8::from_fn(simd, |lane| {
                unknowns.get(lane).map_or(0.0, |&unknown| work.point.along(unknown, i))
            })
        };
        self.seeded(work, simd.splat_f64x8(0.0), (unit, along), unknowns, record)
    }

    /// The vehicle of a record, every unknown seeded with its `unit`; `along(i)` is the seed of the sought
    /// coefficient `i`.
    #[inline(always)]
    fn seeded<P: Real>(
        &self,
        work: &Work<'_>,
        none: P,
        (unit, along): (impl Fn(Unknown) -> P, impl Fn(usize) -> P),
        unknowns: &[Unknown],
        record: usize,
    ) -> Prepared<Dual<P>> {
        let constant = |value: f64| Dual { value, partials: none };
        let mut values: Vec<Dual<P>> = self.description.coefficients.iter().map(|&x| constant(x)).collect();
        for (i, (&index, &value)) in work.point.sought.iter().zip(work.point.values).enumerate() {
            values[index] = Dual { value, partials: along(i) };
        }
        let mut nuisance = work.point.nuisance[record].map(constant);
        for &unknown in unknowns {
            if let Unknown::Nuisance(i) = unknown {
                nuisance[i].partials = unit(unknown);
            }
        }
        self.prepared(work, &values, &nuisance, record)
    }

    /// The vehicle of a record at the point itself.
    #[inline(always)]
    pub(super) fn unseeded(&self, work: &Work<'_>, record: usize) -> Prepared<f64> {
        let mut values = self.description.coefficients.clone();
        for (&index, &value) in work.point.sought.iter().zip(work.point.values) {
            values[index] = value;
        }
        self.prepared(work, &values, &work.point.nuisance[record], record)
    }

    /// The vehicle of a record with these coefficients and nuisance parameters.
    #[inline(always)]
    fn prepared<T: Valued>(
        &self,
        work: &Work<'_>,
        values: &[T],
        nuisance: &[T; NUISANCES],
        record: usize,
    ) -> Prepared<T> {
        let Record { environment, surface, .. } = self.records[record];
        let mut vehicle = Vehicle::new(self.description, &work.structure, values, environment, self.modes)
            .beneath(self.description, environment.g_m_s2, surface);
        let (shows, plain) = (Nuisance::from_row(nuisance), work.plain[record]);
        if !plain {
            vehicle.push(&shows.force);
        }
        Prepared { vehicle, shows, plain }
    }
}

/// The initial conditions of a segment, each unknown among them seeded with its `unit`.
#[inline(always)]
pub(super) fn initial<P: Real>(
    work: &Work<'_>,
    none: P,
    unit: impl Fn(Unknown) -> P,
    unknowns: &[Unknown],
    s: usize,
) -> [Dual<P>; INITIALS] {
    let mut initial = work.point.initial[s].map(|value| Dual { value, partials: none });
    for &unknown in unknowns {
        if let Unknown::Initial(i) = unknown {
            initial[i].partials = unit(unknown);
        }
    }
    initial
}

/// One in the lane of the unknown that is wanted.
#[inline(always)]
pub(super) fn unit_in_lanes<S: Simd>(simd: S, unknowns: &[Unknown], wanted: Unknown) -> f64x8<S> {
    f64x8::from_fn(simd, |lane| if unknowns.get(lane) == Some(&wanted) { 1.0 } else { 0.0 })
}

/// What was shown, sample by sample.
#[inline(always)]
fn finished<T: Valued>(observer: Observer<'_, T>, dt: f64) -> Vec<T> {
    if let Observer::Shown(shown) = observer { shown.finish(dt) } else { Vec::new() }
}

/// The terms of the equation of motion that a coefficient stands in.
fn summed(index: usize) -> Summed {
    let none = Summed::default();
    match index {
        ..names::CENTRE_OF_BUOYANCY => Summed { mass: true, restoring: true, ..none },
        names::CENTRE_OF_BUOYANCY..=names::BUOYANCY => Summed { restoring: true, ..none },
        names::ADDED_MASS..names::LINEAR => Summed { mass: true, ..none },
        names::LINEAR..names::LIFT => Summed { damping: true, ..none },
        names::LIFT..names::BIAS => Summed { lift: true, ..none },
        names::BIAS..names::CROSS_FLOW => Summed { bias: true, ..none },
        names::CROSS_FLOW..names::TETHER => Summed { cross_flow: true, ..none },
        names::TETHER..names::HULL => Summed { tether: true, ..none },
        _ => Summed { thrust: true, ..none },
    }
}

/// Compiles the differentiated flight once per instruction set.
fn on_level(
    level: Level,
    batch: &Batch<'_>,
    work: &Work<'_>,
    groups: &[Group],
    segments: Range<usize>,
) -> Result<Vec<Vec<[f64; LANES]>>, Error> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || batch.varied(simd, work, groups, segments),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || batch.varied(simd, work, groups, segments),
            );
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(
            #[inline(always)]
            || batch.varied(simd, work, groups, segments),
        );
    }
    // Older instruction sets have no fused product; plain numbers serve them as well.
    let _ = level;
    batch.one_by_one(work, groups, segments)
}
