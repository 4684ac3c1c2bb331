//! The process model: the identified vehicle over one step, and its exact Jacobian.
//!
//! `[p, q, ν_r] ← RK4(p, q, ν_r; τ + τ_u)`, then `p ← p + v_c h`: the equation of motion in the velocity through the
//! water, which a constant current leaves as it is. The derivatives by attitude, velocity and force are carried through
//! the stages of the step itself, so that they are those of the discrete step and not of a series. The equation of motion
//! is differentiated once per stage and by the velocity alone, in dual numbers, its six columns in one vector: by force
//! and by the vertical in the body frame, `e = Rᵀ e_z`, it is linear,
//! `∂ν'/∂τ = M⁻¹`, `∂ν'/∂e = M⁻¹ [(W − B) I; S(r_g W − r_b B)]`. The attitude is perturbed in the body frame: `q = q̂ ⊗ [1, ½ δ]` before, `δ = 2 vec(q̂⁻¹ ⊗ ∂q)` after.
//!
//! Source: Fossen (2011), section 8.3 and equation 7.9; Solà (2017), section 5.4.
//! Tests: `tests/filter/process.rs` (difference quotients of the plain step; a current changes nothing but the track).

use super::error_state::{Block, COLUMNS, MOTION};
use super::estimate::{ATTITUDE, Estimate, FORCE};
use crate::actuator::characteristic::Thrust;
use crate::description::Description;
use crate::error::Error;
use crate::model::integrate::{STAGES, State};
use crate::model::kinematics::{Quaternion, quaternion_product, quaternion_rate, renormalised, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Mat6, Vec3, Vec6, product, restricted_inverse};
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
                carrier.advance::<1, COLUMNS>(estimate, (nodes, h), (0.0, unit), |x| [x])
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
    carrier.advance::<LANES, { COLUMNS / LANES }>(estimate, course, (simd.splat_f64x8(0.0), unit), Into::into)
}

/// The vehicle in dual numbers of one kind.
struct Carrier<P> {
    vehicle: Vehicle<Dual<P>>,
    instants: [Instant<Dual<P>>; 3],
    /// Derivatives of the acceleration by force and by the vertical in the body frame, which are constant.
    by_force: Mat6<f64>,
    by_vertical: [Vec3<f64>; 6],
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
        let plain = Vehicle::nominal(description);
        let by_force = restricted_inverse(&plain.mass_matrix, &[true; 6]);
        let (net, [x, y, z]) = (plain.restoring.net_weight, plain.restoring.moment);
        let arms =
            [[net, 0.0, 0.0], [0.0, net, 0.0], [0.0, 0.0, net], [0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let by_vertical = by_force.map(|row| {
            std::array::from_fn(|k| row.iter().zip(&arms).map(|(inverse, arm)| inverse * arm[k]).sum())
        });
        Self { vehicle, instants, by_force, by_vertical }
    }

    /// The step and its Jacobian, `L` columns in each of `G` groups; `unit(seed, column)` has a one where the lane that
    /// begins at the column `seed` is the column's.
    #[inline(always)]
    fn advance<const L: usize, const G: usize>(
        &mut self,
        estimate: &mut Estimate,
        (nodes, h): (&[Instant<f64>], f64),
        (none, unit): (P, impl Fn(usize, usize) -> P),
        read: impl Fn(P) -> [f64; L],
    ) -> Block {
        let mut groups = [seeded(&estimate.motion, none, |column| unit(0, column)); G];
        // What a force adds to the derivatives of the acceleration, the same at every stage.
        let mut pushed = [[none; 6]; G];
        for g in 0..G {
            if g > 0 {
                groups[g] = seeded(&estimate.motion, none, |column| unit(L * g, column));
            }
            for i in 0..6 {
                for j in 0..6 {
                    pushed[g][i] += unit(L * g, FORCE - ATTITUDE + j) * self.by_force[i][j];
                }
            }
        }
        for three in nodes.windows(3).step_by(2) {
            for k in 0..3 {
                self.lift(k, &three[k], &estimate.force, none);
            }
            self.step(&mut groups, &pushed, h, (&unit, &read));
        }
        let mut block = [[0.0; COLUMNS]; MOTION];
        let mut after = estimate.motion;
        for g in 0..G {
            let (first, end) = (L * g, &groups[g]);
            for i in 0..3 {
                after.position[i] = end[i].value;
                block[i][first..first + L].copy_from_slice(&read(end[i].partials));
            }
            let [mut back, mut turned] = [[none; 4]; 2];
            for i in 0..4 {
                after.attitude[i] = end[3 + i].value;
                back[i] = none.splat(if i == 0 { end[3].value } else { -end[3 + i].value });
                turned[i] = end[3 + i].partials;
            }
            turned = quaternion_product(&back, &turned);
            for i in 0..3 {
                block[3 + i][first..first + L].copy_from_slice(&read(turned[1 + i] * 2.0));
            }
            for i in 0..6 {
                after.nu[i] = end[7 + i].value;
                block[6 + i][first..first + L].copy_from_slice(&read(end[7 + i].partials));
            }
        }
        let time = h * (nodes.len() / 2) as f64;
        estimate.motion = after;
        for i in 0..3 {
            estimate.motion.position[i] += estimate.current[i] * time;
        }
        block
    }

    /// What the actuators do at an instant of a step, and the unmodelled force, as constants.
    #[inline(always)]
    fn lift(&mut self, k: usize, node: &Instant<f64>, force: &Vec6<f64>, none: P) {
        let constant = |value: f64| Dual { value, partials: none };
        let lifted = &mut self.instants[k];
        let known = node.inflow_free.unwrap_or([0.0; 6]);
        let mut sum = [constant(0.0); 6];
        for i in 0..6 {
            sum[i].value = force[i] + known[i];
        }
        lifted.inflow_free = Some(sum);
        lifted.thrusts.clear();
        for thrust in &node.thrusts {
            lifted.thrusts.push(Thrust {
                force: constant(thrust.force),
                force_per_inflow: constant(thrust.force_per_inflow),
                torque: constant(thrust.torque),
                torque_per_inflow: constant(thrust.torque_per_inflow),
            });
        }
        lifted.deflections.clear();
        for &(sine, cosine) in &node.deflections {
            lifted.deflections.push((constant(sine), constant(cosine)));
        }
    }

    /// A step of all groups, which stand at one motion: rows as [`State::row`] has them.
    #[inline(always)]
    fn step<const L: usize, const G: usize>(
        &self,
        groups: &mut [[Dual<P>; 13]; G],
        pushed: &[Vec6<P>; G],
        h: f64,
        (unit, read): (&impl Fn(usize, usize) -> P, &impl Fn(P) -> [f64; L]),
    ) {
        let start = *groups;
        let mut slope = start;
        for (stage, (node, weight, instant)) in STAGES.into_iter().enumerate() {
            let mut acceleration = [0.0; 6];
            let mut by_velocity = [[0.0; LANES]; 6];
            for g in 0..G {
                let mut at = start[g];
                if stage > 0 {
                    for i in 0..13 {
                        at[i] = ahead(slope[g][i], node * h, at[i]);
                    }
                }
                let [_, _, _, a, b, c, d, u, v, w, p, q, s] = at;
                if g == 0 {
                    (acceleration, by_velocity) =
                        self.accelerate(&[a, b, c, d], &[u, v, w, p, q, s], instant, (unit, read));
                }
                let r = rotation(&[a, b, c, d]);
                let position = product(&r, &[u, v, w]);
                let attitude = quaternion_rate(&[a, b, c, d], &[p, q, s]);
                slope[g][..3].copy_from_slice(&position);
                slope[g][3..7].copy_from_slice(&attitude);
                for i in 0..6 {
                    let mut partials = pushed[g][i];
                    for j in 0..6 {
                        partials = at[7 + j].partials.mul_add(partials.splat(by_velocity[i][j]), partials);
                    }
                    for j in 0..3 {
                        partials = r[2][j].partials.mul_add(partials.splat(self.by_vertical[i][j]), partials);
                    }
                    slope[g][7 + i] = Dual { value: acceleration[i], partials };
                }
                for i in 0..13 {
                    groups[g][i] = ahead(slope[g][i], weight * h, groups[g][i]);
                }
            }
        }
        for g in 0..G {
            for i in 0..13 {
                groups[g][i] = groups[g][i].flush();
            }
            let [_, _, _, a, b, c, d, ..] = groups[g];
            groups[g][3..7].copy_from_slice(&renormalised(&[a, b, c, d]));
        }
    }

    /// The acceleration at an instant, and its derivatives by the velocity.
    #[inline(always)]
    fn accelerate<const L: usize>(
        &self,
        attitude: &Quaternion<Dual<P>>,
        nu: &Vec6<Dual<P>>,
        instant: usize,
        (unit, read): (&impl Fn(usize, usize) -> P, &impl Fn(P) -> [f64; L]),
    ) -> (Vec6<f64>, [[f64; LANES]; 6]) {
        // Keeps the compiler from lifting a hundred constants out of the loop over the stages, only to spill them.
        let vehicle = std::hint::black_box(&self.vehicle);
        let (mut attitude, mut nu) = (*attitude, *nu);
        for i in 0..4 {
            attitude[i].partials = attitude[i].partials.zero();
        }
        let r = rotation(&attitude);
        let (mut value, mut slopes) = ([0.0; 6], [[0.0; LANES]; 6]);
        for first in (0..6).step_by(L) {
            for i in 0..6 {
                nu[i].partials = unit(first, i);
            }
            let found = vehicle.acceleration(&r, &nu, &self.instants[instant]);
            for i in 0..6 {
                value[i] = found[i].value;
                slopes[i][first..first + L].copy_from_slice(&read(found[i].partials));
            }
        }
        (value, slopes)
    }
}

/// `x h + y`, with the derivatives.
#[inline(always)]
fn ahead<P: Real>(x: Dual<P>, h: f64, y: Dual<P>) -> Dual<P> {
    Dual { value: x.value * h + y.value, partials: x.partials.mul_add(x.partials.splat(h), y.partials) }
}

/// A motion with the derivatives by a small turn in the body frame and by the velocity that `unit` has, in one row.
#[inline(always)]
fn seeded<P: Real>(motion: &State<f64>, none: P, unit: impl Fn(usize) -> P) -> [Dual<P>; 13] {
    let values = motion.row();
    let mut row = [Dual { value: 0.0, partials: none }; 13];
    for i in 0..13 {
        row[i].value = values[i];
    }
    let [_, _, _, a, b, c, d, ..] = row;
    let mut small = [row[0]; 4];
    for i in 0..4 {
        small[i].value = if i == 0 { 1.0 } else { 0.0 };
        small[i].partials = if i == 0 { none } else { unit(i - 1) * 0.5 };
    }
    row[3..7].copy_from_slice(&quaternion_product(&[a, b, c, d], &small));
    for i in 0..6 {
        row[7 + i].partials = unit(3 + i);
    }
    row
}
