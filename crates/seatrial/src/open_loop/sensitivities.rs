//! What the channels of every segment show, and its exact derivatives by any coefficient, nuisance
//! parameter and initial condition: eight unknowns to a flight.
//!
//! Every (segment, eight unknowns) pair is a task of its own, so that threads never change a result.
//!
//! Tests: `tests/scalars/dual.rs`, `tests/test_sensitivities.py` (finite differences, CasADi).

use super::batch::Batch;
use super::{Observer, Start, Track, fly};
use crate::criterion::{CHANNELS, Criterion, Loss, channels};
use crate::error::Error;
use crate::observation::{INITIALS, NUISANCES, Nuisance};
use crate::real::Real;
use crate::real::dual::Dual;
use crate::real::lanes::{LANES, level};
use crate::vehicle::{Structure, Vehicle};
use fearless_simd::{Level, Simd, SimdBase, f64x8};
use rayon::prelude::*;
use std::sync::atomic::AtomicBool;

/// One number whose change is of interest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// A row of [`Point::directions`]: coefficients that move together.
    Direction(usize),
    /// A nuisance parameter, by its place among [`crate::observation::nuisance_names`].
    Nuisance(usize),
    /// An initial condition of the segment, by its place among [`crate::observation::INITIAL_NAMES`].
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

/// Shown channels of one flight with the derivatives by up to eight unknowns each.
struct Shown {
    rows: Vec<[f64; CHANNELS]>,
    /// `[sample][channel][unknown of the group]`; the sums of a criterion when there is a loss.
    partials: Vec<[[f64; LANES]; CHANNELS]>,
}

struct Work<'a> {
    point: Point<'a>,
    structure: Structure,
    loss: Option<Loss>,
    stop: &'a AtomicBool,
}

impl Batch<'_> {
    /// What every segment shows, and the derivatives of some of its channels.
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
        let work = self.work(point, None, stop);
        if unknowns.is_empty() {
            let one = |s| Ok(Prediction { rows: self.shown(&work, s)?, jacobian: Vec::new() });
            return (0..self.segments.len()).into_par_iter().map(one).collect();
        }
        let shown = self.differentiate(&work, unknowns)?;
        let groups = unknowns.len().div_ceil(LANES);
        Ok(shown
            .par_chunks(groups)
            .map(|of_segment| {
                let rows = of_segment[0].rows.clone();
                let mut jacobian = vec![0.0; rows.len() * asked.len() * unknowns.len()];
                for (at, place) in jacobian.chunks_exact_mut(unknowns.len()).enumerate() {
                    let (k, c) = (at / asked.len(), asked[at % asked.len()]);
                    for (group, chunk) in of_segment.iter().zip(place.chunks_mut(LANES)) {
                        chunk.copy_from_slice(&group.partials[k][c][..chunk.len()]);
                    }
                }
                Prediction { rows, jacobian }
            })
            .collect())
    }

    /// The criterion of every segment on what its channels show, and its gradient.
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
        let shown = self.differentiate(&self.work(point, Some(loss), stop), unknowns)?;
        let groups = unknowns.len().div_ceil(LANES).max(1);
        let of_segment = |parts: &[Shown]| {
            let mut slopes = vec![0.0; CHANNELS * unknowns.len()];
            for (c, row) in slopes.chunks_exact_mut(unknowns.len().max(1)).enumerate() {
                for (part, chunk) in parts.iter().zip(row.chunks_mut(LANES)) {
                    chunk.copy_from_slice(&part.partials[0][c][..chunk.len()]);
                }
            }
            Gradient { sums: parts[0].rows[0], slopes }
        };
        Ok(shown.chunks(groups).map(of_segment).collect())
    }

    fn work<'a>(&self, point: Point<'a>, loss: Option<Loss>, stop: &'a AtomicBool) -> Work<'a> {
        Work { point, structure: Structure::new(self.description, point.sought), loss, stop }
    }

    /// What segment `s` shows, in plain `f64`.
    fn shown(&self, work: &Work<'_>, s: usize) -> Result<Vec<[f64; CHANNELS]>, Error> {
        let mut values = self.description.coefficients.clone();
        for (&index, &value) in work.point.sought.iter().zip(work.point.values) {
            values[index] = value;
        }
        let nuisance = work.point.nuisance[self.segments[s].record];
        self.observe(work, &values, &nuisance, &work.point.initial[s], s)
    }

    /// Every segment for every eight unknowns, `[segment][group]` in one row.
    fn differentiate(&self, work: &Work<'_>, unknowns: &[Unknown]) -> Result<Vec<Shown>, Error> {
        let (name, level) = level()?;
        let groups: Vec<&[Unknown]> =
            if unknowns.is_empty() { vec![&[]] } else { unknowns.chunks(LANES).collect() };
        (0..self.segments.len() * groups.len())
            .into_par_iter()
            .map(|task| {
                let (s, group) = (task / groups.len(), groups[task % groups.len()]);
                if name == "fallback" {
                    return self.one_by_one(work, group, s);
                }
                on_level(level, self, work, group, s)
            })
            .collect()
    }

    /// The derivatives by one unknown after the other: where there are no lanes.
    fn one_by_one(&self, work: &Work<'_>, unknowns: &[Unknown], s: usize) -> Result<Shown, Error> {
        let mut all: Option<Shown> = None;
        for lane in 0..unknowns.len().max(1) {
            let unit = |wanted: Unknown| if unknowns.get(lane) == Some(&wanted) { 1.0 } else { 0.0 };
            let along = |row: usize, i: usize| {
                unit(Unknown::Direction(row)) * work.point.directions[row * work.point.sought.len() + i]
            };
            let rows = self.seeded(work, 0.0, (unit, along), unknowns, s)?;
            let one = gather(&rows, |partials, place| place[0] = *partials);
            match &mut all {
                None => all = Some(one),
                Some(all) => {
                    for (to, from) in all.partials.iter_mut().zip(&one.partials) {
                        for c in 0..CHANNELS {
                            to[c][lane] = from[c][0];
                        }
                    }
                }
            }
        }
        all.ok_or_else(|| Error::simulation("no flight".to_owned()))
    }

    /// The derivatives by up to eight unknowns at once.
    #[inline(always)]
    fn eight_unknowns<S: Simd>(
        &self,
        simd: S,
        work: &Work<'_>,
        unknowns: &[Unknown],
        s: usize,
    ) -> Result<Shown, Error> {
        let unit = |wanted: Unknown| {
            f64x8::from_fn(simd, |lane| if unknowns.get(lane) == Some(&wanted) { 1.0 } else { 0.0 })
        };
        let width = work.point.sought.len();
        let along = |row: usize, i: usize| {
            unit(Unknown::Direction(row)) * work.point.directions[row * width + i]
        };
        let rows = self.seeded(work, simd.splat_f64x8(0.0), (unit, along), unknowns, s)?;
        Ok(gather(&rows, |partials, place| *place = (*partials).into()))
    }

    /// What segment `s` shows, every unknown seeded with its `unit`; `along(row, i)` is the seed of the
    /// coefficient `i` by a direction.
    #[inline(always)]
    fn seeded<P: Real>(
        &self,
        work: &Work<'_>,
        none: P,
        (unit, along): (impl Fn(Unknown) -> P, impl Fn(usize, usize) -> P),
        unknowns: &[Unknown],
        s: usize,
    ) -> Result<Vec<[Dual<P>; CHANNELS]>, Error> {
        let constant = |value: f64| Dual { value, partials: none };
        let mut values: Vec<Dual<P>> = self.description.coefficients.iter().map(|&x| constant(x)).collect();
        for (i, (&index, &value)) in work.point.sought.iter().zip(work.point.values).enumerate() {
            values[index] = constant(value);
            for unknown in unknowns {
                if let Unknown::Direction(row) = *unknown {
                    values[index].partials += along(row, i);
                }
            }
        }
        let mut nuisance = work.point.nuisance[self.segments[s].record].map(constant);
        let mut initial = work.point.initial[s].map(constant);
        for &unknown in unknowns {
            match unknown {
                Unknown::Direction(_) => {}
                Unknown::Nuisance(i) => nuisance[i].partials = unit(unknown),
                Unknown::Initial(i) => initial[i].partials = unit(unknown),
            }
        }
        self.observe(work, &values, &nuisance, &initial, s)
    }

    /// The channels of segment `s`, or the sums of the criterion in their place.
    #[inline(always)]
    fn observe<T: Real>(
        &self,
        work: &Work<'_>,
        values: &[T],
        nuisance: &[T; NUISANCES],
        initial: &[T; INITIALS],
        s: usize,
    ) -> Result<Vec<[T; CHANNELS]>, Error> {
        let segment = &self.segments[s];
        let record = &self.records[segment.record];
        let vehicle =
            Vehicle::new(self.description, &work.structure, values, record.environment, self.modes);
        // Where nothing stands between motion and channels, they are the plain model's to the last bit.
        let none = initial[0].zero();
        let plain = nuisance.iter().chain(initial).all(|x| x.equals(none));
        let shows = Nuisance::from_row(nuisance);
        let start = if plain { Start::of(segment, none) } else { shows.start(&segment.state, initial) };
        let mut observer = Observer::Track(Track::default());
        fly(&vehicle, record, segment, (self.substeps, &start), &mut observer, work.stop)?;
        let Observer::Track(track) = observer else { return Ok(Vec::new()) };
        let rows = if plain {
            track.states.iter().map(channels).collect()
        } else {
            shows.shown(&track.states, record.dt)
        };
        let Some(loss) = work.loss else { return Ok(rows) };
        let samples = segment.start..segment.stop;
        let mut criterion = Criterion::new(&record.observed, &record.weight, samples, loss, none);
        for (k, row) in rows.iter().enumerate().skip(1) {
            criterion.compare(segment.start + k, row);
        }
        Ok(vec![criterion.sums])
    }
}

/// Values and partials apart.
#[inline(always)]
fn gather<P: Copy>(rows: &[[Dual<P>; CHANNELS]], lay: impl Fn(&P, &mut [f64; LANES])) -> Shown {
    let partials = rows.iter().map(|row| {
        let mut laid = [[0.0; LANES]; CHANNELS];
        for c in 0..CHANNELS {
            lay(&row[c].partials, &mut laid[c]);
        }
        laid
    });
    Shown { rows: rows.iter().map(|row| row.map(|x| x.value)).collect(), partials: partials.collect() }
}

/// Compiles the differentiated flight once per instruction set.
fn on_level(
    level: Level,
    batch: &Batch<'_>,
    work: &Work<'_>,
    unknowns: &[Unknown],
    s: usize,
) -> Result<Shown, Error> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || batch.eight_unknowns(simd, work, unknowns, s),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || batch.eight_unknowns(simd, work, unknowns, s),
            );
        }
    }
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return simd.vectorize(
            #[inline(always)]
            || batch.eight_unknowns(simd, work, unknowns, s),
        );
    }
    // Older instruction sets have no fused product; plain numbers serve them as well.
    let _ = level;
    batch.one_by_one(work, unknowns, s)
}
