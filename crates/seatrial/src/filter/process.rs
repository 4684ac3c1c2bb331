//! The process model: the identified vehicle over one step, and its exact Jacobian.
//!
//! `[p, q, ν_r] ← RK4(p, q, ν_r; τ + τ_u)`, then `p ← p + v_c h`: the equation of motion in the velocity through the
//! water, which a constant current leaves as it is. The derivatives by attitude, velocity and force are carried through
//! the step itself by dual numbers, eight at a time, so that they are those of the discrete step and not of a series.
//! The attitude is perturbed in the body frame: `q = q̂ ⊗ [1, ½ δ]` before, `δ = 2 vec(q̂⁻¹ ⊗ ∂q)` after.
//!
//! Source: Fossen (2011), section 8.3 and equation 7.9; Solà (2017), section 5.4.
//! Tests: `tests/filter/process.rs` (difference quotients of the plain step; a current changes nothing but the track).

use super::error_state::{Block, COLUMNS, MOTION};
use super::estimate::Estimate;
use crate::actuator::characteristic::Thrust;
use crate::description::Description;
use crate::error::Error;
use crate::model::integrate::{State, step};
use crate::model::kinematics::quaternion_product;
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::dual::Dual;
use crate::number::lanes::{LANES, Lanes, level};
use crate::number::real::Real;
#[cfg(target_arch = "aarch64")]
use fearless_simd::Neon;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::x86::{Avx2, Avx512};
use fearless_simd::{Simd, SimdBase, f64x8};

/// The vehicle as the filter's process model.
pub struct Process(Carriers);

/// One carrier per wide instruction set; where there is none, derivatives are carried one by one. On the heap by itself:
/// vectors ask for an alignment that not every owner of a process gives.
enum Carriers {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx512(Avx512, Box<Carrier<Lanes<Avx512>>>),
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx2(Avx2, Box<Carrier<Lanes<Avx2>>>),
    #[cfg(target_arch = "aarch64")]
    Neon(Neon, Box<Carrier<Lanes<Neon>>>),
    Plain(Box<Carrier<f64>>),
}

impl Process {
    /// The model of a described vehicle in its own environment, on the instruction set in use.
    ///
    /// # Errors
    /// A forced instruction set that is not there.
    pub fn new(description: &Description) -> Result<Self, Error> {
        let (name, level) = level()?;
        let _ = (name, level);
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            if let Some(simd) = level.as_avx512().filter(|_| name == "avx512") {
                return Ok(Self(Carriers::Avx512(simd, boxed(description, simd.splat_f64x8(0.0)))));
            }
            if let Some(simd) = level.as_avx2().filter(|_| name == "avx2") {
                return Ok(Self(Carriers::Avx2(simd, boxed(description, simd.splat_f64x8(0.0)))));
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(simd) = level.as_neon().filter(|_| name == "neon") {
            return Ok(Self(Carriers::Neon(simd, boxed(description, simd.splat_f64x8(0.0)))));
        }
        Ok(Self(Carriers::Plain(boxed(description, 0.0))))
    }

    /// Moves an estimate by steps of `h` seconds and returns the Jacobian of its motion.
    ///
    /// `nodes` are what the actuators do at the start, the middle and the end of each step, one more than two per step,
    /// with their sum formed ([`crate::model::drive::act`]).
    pub fn advance(&mut self, estimate: &mut Estimate, nodes: &[Instant<f64>], h: f64) -> Block {
        match &mut self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx512(simd, carrier) => {
                let simd = *simd;
                simd.vectorize(
                    #[inline(always)]
                    || eight_by_eight(simd, carrier, estimate, (nodes, h)),
                )
            }
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx2(simd, carrier) => {
                let simd = *simd;
                simd.vectorize(
                    #[inline(always)]
                    || eight_by_eight(simd, carrier, estimate, (nodes, h)),
                )
            }
            #[cfg(target_arch = "aarch64")]
            Carriers::Neon(simd, carrier) => {
                let simd = *simd;
                simd.vectorize(
                    #[inline(always)]
                    || eight_by_eight(simd, carrier, estimate, (nodes, h)),
                )
            }
            Carriers::Plain(carrier) => {
                let unit = |seed: usize, column: usize| f64::from(u8::from(seed == column));
                carrier.advance::<1>(estimate, (nodes, h), (0.0, unit), |x| [x])
            }
        }
    }
}

impl Process {
    /// The result of `work`, compiled for the instruction set in use.
    #[inline(always)]
    pub fn wide<R>(&self, work: impl FnOnce() -> R) -> R {
        match &self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx512(simd, _) => simd.vectorize(work),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx2(simd, _) => simd.vectorize(work),
            #[cfg(target_arch = "aarch64")]
            Carriers::Neon(simd, _) => simd.vectorize(work),
            Carriers::Plain(_) => work(),
        }
    }
}

fn boxed<P: Real>(description: &Description, none: P) -> Box<Carrier<P>> {
    Box::new(Carrier::new(description, none))
}

/// Eight columns in each flight.
#[inline(always)]
fn eight_by_eight<S: Simd>(
    simd: S,
    carrier: &mut Carrier<Lanes<S>>,
    estimate: &mut Estimate,
    course: (&[Instant<f64>], f64),
) -> Block {
    let unit =
        |seed: usize, column: usize| f64x8::from_fn(simd, |lane| f64::from(u8::from(seed + lane == column)));
    carrier.advance::<LANES>(estimate, course, (simd.splat_f64x8(0.0), unit), Into::into)
}

/// The vehicle in dual numbers of one kind.
struct Carrier<P> {
    vehicle: Vehicle<Dual<P>>,
    instants: [Instant<Dual<P>>; 3],
}

impl<P: Real> Carrier<P> {
    fn new(description: &Description, none: P) -> Self {
        let vehicle = Vehicle::nominal_in(description, Dual { value: 0.0, partials: none });
        let (thrusters, fins) = (vehicle.actuators.len(), vehicle.fins.len());
        let instants = std::array::from_fn(|_| Instant {
            thrusts: Vec::with_capacity(thrusters),
            deflections: Vec::with_capacity(fins),
            ..Instant::default()
        });
        Self { vehicle, instants }
    }

    /// The step and its Jacobian, `L` columns to a flight; `unit(seed, column)` has a one where the lane that begins at
    /// the column `seed` is the column's.
    #[inline(always)]
    fn advance<const L: usize>(
        &mut self,
        estimate: &mut Estimate,
        (nodes, h): (&[Instant<f64>], f64),
        (none, unit): (P, impl Fn(usize, usize) -> P),
        read: impl Fn(P) -> [f64; L],
    ) -> Block {
        let mut block = [[0.0; COLUMNS]; MOTION];
        let mut after = estimate.motion;
        for first in (0..COLUMNS).step_by(L) {
            let end = self.fly(estimate, (nodes, h), none, |column| unit(first, column));
            for i in 0..3 {
                after.position[i] = end.position[i].value;
                block[i][first..first + L].copy_from_slice(&read(end.position[i].partials));
            }
            for i in 0..4 {
                after.attitude[i] = end.attitude[i].value;
            }
            let [w, x, y, z] = after.attitude;
            let back = [none.splat(w), none.splat(-x), none.splat(-y), none.splat(-z)];
            let turned = quaternion_product(
                &back,
                &[
                    end.attitude[0].partials,
                    end.attitude[1].partials,
                    end.attitude[2].partials,
                    end.attitude[3].partials,
                ],
            );
            for i in 0..3 {
                block[3 + i][first..first + L].copy_from_slice(&read(turned[1 + i] * 2.0));
            }
            for i in 0..6 {
                after.nu[i] = end.nu[i].value;
                block[6 + i][first..first + L].copy_from_slice(&read(end.nu[i].partials));
            }
        }
        let time = h * (nodes.len() / 2) as f64;
        estimate.motion = after;
        for i in 0..3 {
            estimate.motion.position[i] += estimate.current[i] * time;
        }
        block
    }

    /// The motion at the end, with the derivatives that are seeded.
    #[inline(always)]
    fn fly(
        &mut self,
        estimate: &Estimate,
        (nodes, h): (&[Instant<f64>], f64),
        none: P,
        unit: impl Fn(usize) -> P,
    ) -> State<Dual<P>> {
        let constant = |value: f64| Dual { value, partials: none };
        let at = &estimate.motion;
        let zero = constant(0.0);
        let mut state = State { position: [zero; 3], attitude: [zero; 4], nu: [zero; 6] };
        let mut small = [constant(1.0); 4];
        for i in 0..3 {
            state.position[i] = constant(at.position[i]);
            small[1 + i] = Dual { value: 0.0, partials: unit(i) * 0.5 };
        }
        for i in 0..4 {
            state.attitude[i] = constant(at.attitude[i]);
        }
        state.attitude = quaternion_product(&state.attitude, &small);
        let mut force = [zero; 6];
        for i in 0..6 {
            state.nu[i] = Dual { value: at.nu[i], partials: unit(3 + i) };
            force[i] = Dual { value: estimate.force[i], partials: unit(9 + i) };
        }
        for three in nodes.windows(3).step_by(2) {
            for (lifted, node) in self.instants.iter_mut().zip(three) {
                let known = node.inflow_free.unwrap_or([0.0; 6]);
                let mut sum = force;
                for i in 0..6 {
                    sum[i] = force[i] + known[i];
                }
                lifted.inflow_free = Some(sum);
                lifted.thrusts.clear();
                lifted.thrusts.extend(node.thrusts.iter().map(|t| Thrust {
                    force: constant(t.force),
                    force_per_inflow: constant(t.force_per_inflow),
                    torque: constant(t.torque),
                    torque_per_inflow: constant(t.torque_per_inflow),
                }));
                lifted.deflections.clear();
                lifted.deflections.extend(node.deflections.iter().map(|&(s, c)| (constant(s), constant(c))));
            }
            state = step(&self.vehicle, &state, h, &self.instants);
        }
        state
    }
}
