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

use super::error_state::{Block, COLUMNS, ErrorState, MOTION, Return, Transition};
use super::estimate::{ATTITUDE, Estimate, FORCE, STATES};
use crate::actuator::characteristic::Thrust;
use crate::description::Description;
use crate::error::Error;
use crate::model::integrate::{STAGES, State};
use crate::model::kinematics::{Quaternion, quaternion_product, quaternion_rate, renormalised, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, each, product, restricted_inverse};
use crate::number::dual::Dual;
use crate::number::lanes::{LANES, Lanes, level};
use crate::number::real::Real;
#[cfg(target_arch = "aarch64")]
use fearless_simd::Neon;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::x86::{Avx2, Avx512};
use fearless_simd::{Fallback, Simd, SimdBase, f64x8};

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
    /// The covariance after a step, on the instruction set in use.
    pub fn spread(&self, state: &mut ErrorState<STATES>, step: &Transition<STATES>) {
        match &self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx512(simd, _) => simd.vectorize(
                #[inline(always)]
                || state.predict(*simd, step),
            ),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx2(simd, _) => simd.vectorize(
                #[inline(always)]
                || state.predict(*simd, step),
            ),
            #[cfg(target_arch = "aarch64")]
            Carriers::Neon(simd, _) => simd.vectorize(
                #[inline(always)]
                || state.predict(*simd, step),
            ),
            Carriers::Plain(_) => state.predict(Fallback::new(), step),
        }
    }

    /// The way back over a step, on the instruction set in use.
    pub fn reversed(&self, step: &Transition<STATES>) -> Return {
        match &self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx512(simd, _) => simd.vectorize(
                #[inline(always)]
                || step.reversed(*simd),
            ),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Carriers::Avx2(simd, _) => simd.vectorize(
                #[inline(always)]
                || step.reversed(*simd),
            ),
            #[cfg(target_arch = "aarch64")]
            Carriers::Neon(simd, _) => simd.vectorize(
                #[inline(always)]
                || step.reversed(*simd),
            ),
            Carriers::Plain(_) => step.reversed(Fallback::new()),
        }
    }

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

/// The derivatives of the acceleration by force and by the vertical in the body frame, which are constant.
pub fn linear_parts(description: &Description) -> (Mat6<f64>, [Vec3<f64>; 6]) {
    let plain = Vehicle::nominal(description);
    let by_force = restricted_inverse(&plain.mass_matrix, &[true; 6]);
    let (net, [x, y, z]) = (plain.restoring.net_weight, plain.restoring.moment);
    let arms = [[net, 0.0, 0.0], [0.0, net, 0.0], [0.0, 0.0, net], [0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let by_vertical = by_force.map(|row| {
        std::array::from_fn(|k| row.iter().zip(&arms).map(|(inverse, arm)| inverse * arm[k]).sum())
    });
    (by_force, by_vertical)
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
        let (by_force, by_vertical) = linear_parts(description);
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
        let mut motion = estimate.motion.row();
        let mut groups = [[none; 13]; G];
        // What a force adds to the derivatives of the acceleration, the same at every stage.
        let mut pushed = [[none; 6]; G];
        for g in 0..G {
            groups[g] = seeded(&estimate.motion.attitude, none, |column| unit(L * g, column));
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
            self.step((&mut motion, &mut groups), &pushed, (h, none), (&unit, &read));
        }
        let [x, y, z, a, b, c, d, nu @ ..] = motion;
        let mut block = [[0.0; COLUMNS]; MOTION];
        for g in 0..G {
            let (first, end) = (L * g, &groups[g]);
            for i in 0..3 {
                block[i][first..first + L].copy_from_slice(&read(end[i]));
            }
            let back = [none.splat(a), none.splat(-b), none.splat(-c), none.splat(-d)];
            let turned = quaternion_product(&back, &[end[3], end[4], end[5], end[6]]);
            for i in 0..3 {
                block[3 + i][first..first + L].copy_from_slice(&read(turned[1 + i] * 2.0));
            }
            for i in 0..6 {
                block[6 + i][first..first + L].copy_from_slice(&read(end[7 + i]));
            }
        }
        let time = h * (nodes.len() / 2) as f64;
        estimate.motion = State { position: [x, y, z], attitude: [a, b, c, d], nu };
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

    /// A step of the motion and of its derivatives in all groups: rows as [`State::row`] has them. The kinematics are
    /// differentiated by hand, because the derivatives of R itself, nine vectors, are not asked for.
    #[inline(always)]
    fn step<const L: usize, const G: usize>(
        &self,
        (motion, groups): (&mut [f64; 13], &mut [[P; 13]; G]),
        pushed: &[Vec6<P>; G],
        (h, none): (f64, P),
        (unit, read): (&impl Fn(usize, usize) -> P, &impl Fn(P) -> [f64; L]),
    ) {
        let (start, begun) = (*motion, *groups);
        let (mut slope, mut slopes) = ([0.0; 13], [[none; 13]; G]);
        for (node, weight, instant) in STAGES {
            let mut at = start;
            for i in 0..13 {
                at[i] += slope[i] * (node * h);
            }
            let [_, _, _, a, b, c, d, nu @ ..] = at;
            let (attitude, [u, v, w, p, q, s]) = ([a, b, c, d], nu);
            let r = rotation(&attitude);
            let place = [at[0], at[1], at[2]];
            let (acceleration, by_velocity) =
                self.accelerate((&place, &r), &nu, (instant, none), (unit, read));
            slope[..3].copy_from_slice(&product(&r, &[u, v, w]));
            slope[3..7].copy_from_slice(&quaternion_rate(&attitude, &[p, q, s]));
            slope[7..].copy_from_slice(&acceleration);
            let track = track_by_attitude(&attitude, &[u, v, w]);
            let vertical = vertical_by_attitude(&attitude);
            let turning = [none.splat(p), none.splat(q), none.splat(s)];
            for g in 0..G {
                let mut near = begun[g];
                for i in 0..13 {
                    near[i] = ahead(slopes[g][i], node * h, near[i]);
                }
                let [_, _, _, dw, dx, dy, dz, du, dv, dr, dp, dq, ds] = near;
                let turned = [dw, dx, dy, dz];
                let along = weighed(&r, &[du, dv, dr], &[none; 3]);
                slopes[g][..3].copy_from_slice(&weighed(&track, &turned, &along));
                let spun = quaternion_rate(&turned, &turning);
                let quarter = spin_by_rate(&attitude);
                slopes[g][3..7].copy_from_slice(&weighed(&quarter, &[dp, dq, ds], &spun));
                let tilted = weighed(&vertical, &turned, &[none; 3]);
                let heavy = weighed(&self.by_vertical, &tilted, &pushed[g]);
                slopes[g][7..].copy_from_slice(&weighed(&by_velocity, &[du, dv, dr, dp, dq, ds], &heavy));
                for i in 0..13 {
                    groups[g][i] = ahead(slopes[g][i], weight * h, groups[g][i]);
                }
            }
            for i in 0..13 {
                motion[i] += slope[i] * (weight * h);
            }
        }
        for x in motion.iter_mut() {
            *x = x.flush();
        }
        let mut value = [0.0; 4];
        for g in 0..G {
            let unit_length = |i: usize| Dual { value: motion[3 + i], partials: groups[g][3 + i].flush() };
            let attitude = renormalised(&[unit_length(0), unit_length(1), unit_length(2), unit_length(3)]);
            for i in 0..13 {
                groups[g][i] = groups[g][i].flush();
            }
            for i in 0..4 {
                (value[i], groups[g][3 + i]) = (attitude[i].value, attitude[i].partials);
            }
        }
        motion[3..7].copy_from_slice(&value);
    }

    /// The acceleration at an instant, and its derivatives by the velocity.
    #[inline(always)]
    fn accelerate<const L: usize>(
        &self,
        (place, r): (&Vec3<f64>, &Mat3<f64>),
        nu: &Vec6<f64>,
        (instant, none): (usize, P),
        (unit, read): (&impl Fn(usize, usize) -> P, &impl Fn(P) -> [f64; L]),
    ) -> (Vec6<f64>, [[f64; LANES]; 6]) {
        // Keeps the compiler from lifting a hundred constants out of the loop over the stages, only to spill them.
        let vehicle = std::hint::black_box(&self.vehicle);
        let constant = |value: f64| Dual { value, partials: none };
        let mut turned = [[constant(0.0); 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                turned[i][j].value = r[i][j];
            }
        }
        let place = place.map(constant);
        let mut moving = [constant(0.0); 6];
        for i in 0..6 {
            moving[i].value = nu[i];
        }
        let (mut value, mut slopes) = ([0.0; 6], [[0.0; LANES]; 6]);
        for first in (0..6).step_by(L) {
            for i in 0..6 {
                moving[i].partials = unit(first, i);
            }
            let found = vehicle.acceleration((Some(&place), &turned), &moving, &self.instants[instant]);
            for i in 0..6 {
                value[i] = found[i].value;
                slopes[i][first..first + L].copy_from_slice(&read(found[i].partials));
            }
        }
        (value, slopes)
    }
}

/// `x h + y`.
#[inline(always)]
fn ahead<P: Real>(x: P, h: f64, y: P) -> P {
    x.mul_add(x.splat(h), y)
}

/// `A x + y`, the first columns of A by as many numbers.
#[inline(always)]
fn weighed<P: Real, const N: usize, const M: usize, const K: usize>(
    a: &[[f64; M]; N],
    x: &[P; K],
    y: &[P; N],
) -> [P; N] {
    let mut sum = *y;
    for i in 0..N {
        for j in 0..K {
            sum[i] = x[j].mul_add(x[j].splat(a[i][j]), sum[i]);
        }
    }
    sum
}

/// `∂(R(q) v)/∂q`.
#[inline(always)]
fn track_by_attitude(q: &Quaternion<f64>, v: &Vec3<f64>) -> [[f64; 4]; 3] {
    let ([w, x, y, z], [a, b, c]) = (each(q, |part| 2.0 * part), *v);
    [
        [y * c - z * b, y * b + z * c, x * b + w * c - 2.0 * y * a, x * c - w * b - 2.0 * z * a],
        [z * a - x * c, y * a - w * c - 2.0 * x * b, x * a + z * c, w * a + y * c - 2.0 * z * b],
        [x * b - y * a, z * a + w * b - 2.0 * x * c, z * b - w * a - 2.0 * y * c, x * a + y * b],
    ]
}

/// `∂e/∂q` of the vertical in the body frame, `e = R(q)ᵀ e_z`.
#[inline(always)]
fn vertical_by_attitude(q: &Quaternion<f64>) -> [[f64; 4]; 3] {
    let [w, x, y, z] = each(q, |part| 2.0 * part);
    [[-y, z, -w, x], [x, w, z, y], [0.0, -2.0 * x, -2.0 * y, 0.0]]
}

/// `∂q'/∂ω`, `q' = ½ q ⊗ [0, ω]`.
#[inline(always)]
fn spin_by_rate(q: &Quaternion<f64>) -> [Vec3<f64>; 4] {
    let [w, x, y, z] = each(q, |part| 0.5 * part);
    [[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]
}

/// The derivatives of a motion by a small turn in the body frame and by the velocity that `unit` has, in one row.
#[inline(always)]
fn seeded<P: Real>(attitude: &Quaternion<f64>, none: P, unit: impl Fn(usize) -> P) -> [P; 13] {
    let mut row = [none; 13];
    // The turn [1, ½ δ].
    let turned = weighed(&spin_by_rate(attitude), &[unit(0), unit(1), unit(2)], &[none; 4]);
    row[3..7].copy_from_slice(&turned);
    for i in 0..6 {
        row[7 + i] = unit(3 + i);
    }
    row
}
