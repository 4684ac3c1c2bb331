//! Where a simulated run leaves what an underwater vehicle can do, and why.
//!
//! A run has diverged where a number of its state is not finite, or a velocity is beyond [`FASTEST`]. The cause is told
//! by flying the same run again in shorter steps: what stays sound there was the integration, everything else the
//! vehicle.
//!
//! Tests: `tests/laws/integration.rs`, `tests/flight/test_surface.py`.

use crate::description::Description;
use crate::description::coefficients::{FORCES, linear, quadratic};
use crate::error::Error;
use crate::fit::batch::Batch;
use crate::fit::open_loop::Unsound;
use crate::model::integrate::State;
use crate::model::vehicle::Mode;
use crate::number::real::Real;
use std::sync::atomic::AtomicBool;

/// The speed of sound in water, m/s: the equations are those of an incompressible fluid. The same number bounds the
/// rates, in rad/s: a metre from O it is the same speed.
pub const FASTEST: f64 = 1500.0;

/// By how much the steps of the second and third attempt are shorter.
const SHORTER: [usize; 2] = [4, 16];

/// The most steps of an attempt: some seconds of work.
const MOST_STEPS: usize = 10_000_000;

/// Why a run diverged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// Steps of the first length, s, are too long; those of the second are short enough.
    Step(f64, f64),
    /// This coefficient adds energy.
    Coefficient(usize),
    /// Neither step nor sign of a damping explains it.
    Unknown,
}

/// A run that has diverged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Divergence {
    /// Seconds after the start of the run.
    pub time: f64,
    /// Index of the axis, X to N, whose velocity had grown most.
    pub axis: usize,
    /// The likely cause.
    pub cause: Cause,
}

/// Whether a state is one of an underwater vehicle, in every lane.
#[inline(always)]
pub(super) fn is_sound<T: Real>(state: &State<T>) -> bool {
    let zero = state.nu[0].zero();
    let mut speed = zero;
    for x in state.nu {
        speed += x.abs();
    }
    let [x, y, z] = state.position;
    // What is not a number is not below anything.
    let sound = T::both(speed.lt(zero.splat(FASTEST)), (x + y + z).abs().lt(zero.splat(f64::INFINITY)));
    !T::any(zero.lt(T::select(sound, zero, zero.splat(1.0))))
}

impl Batch<'_> {
    /// What is wrong with the run of segment `s` that became unsound there.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn divergence(
        &self,
        s: usize,
        unsound: &Unsound<f64>,
        stop: &AtomicBool,
    ) -> Result<Divergence, Error> {
        let dt = self.records[self.segments[s].record].dt;
        let h = dt / self.substeps as f64;
        let size = |i: &usize| unsound.last.nu[*i].abs();
        let axis = (0..6).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0);
        let time = unsound.steps as f64 * h;
        let mut cause = self.adding(axis).map_or(Cause::Unknown, Cause::Coefficient);
        let samples = unsound.steps.div_ceil(self.substeps);
        for shorter in SHORTER {
            let substeps = self.substeps * shorter;
            if samples.saturating_mul(substeps) > MOST_STEPS {
                break;
            }
            let mut segment = self.segments[s].clone();
            // Twice as long: an instability that shorter steps only delay would pass for a cure.
            segment.stop = segment.stop.min(segment.start + 2 * samples + 1);
            let segments = std::slice::from_ref(&segment);
            let again = Batch { substeps, segments, ..*self }.track(0, stop)?;
            if again.unsound.is_none() {
                cause = Cause::Step(h, h / shorter as f64);
                break;
            }
        }
        Ok(Divergence { time, axis, cause })
    }

    /// The damping of a free axis that adds energy, that of `axis` first.
    fn adding(&self, axis: usize) -> Option<usize> {
        std::iter::once(axis)
            .chain(0..6)
            .filter(|&i| self.modes[i] == Mode::Free)
            .flat_map(|i| [linear(i, i), quadratic(i, i)])
            .find(|&index| self.description.coefficients[index] > 0.0)
    }
}

impl Divergence {
    /// In words, with what to do.
    pub fn words(&self, description: &Description) -> String {
        const AXES: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];
        let Self { time, axis, cause } = *self;
        let what = format!(
            "{}: the motion diverged {time:.3} s after the start, in {} ({})",
            description.file.name, AXES[axis], FORCES[axis]
        );
        match cause {
            Cause::Step(h, short) => format!(
                "{what}: steps of {h:.4} s are too long for its fastest motion, steps of {short:.4} s are not; give max_step_s = {short:.4} or less, the default is 0.02"
            ),
            Cause::Coefficient(index) => format!(
                "{what}: {} = {} adds energy as the vehicle moves, and shorter steps do not help; damping derivatives are negative, correct its sign",
                description.layout.name(index),
                description.coefficients[index]
            ),
            Cause::Unknown => format!(
                "{what}: no damping has the wrong sign, and shorter steps do not help; check commands and tau, the signs of lift and of off-diagonal coefficients, and the size of the mass and the inertias"
            ),
        }
    }
}
