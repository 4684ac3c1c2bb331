//! The process model: the identified vehicle over one step, and its exact Jacobian.
//!
//! `[p, q, ν_r] ← RK4(p, q, ν_r; τ + τ_u)`, then `p ← p + v_c h`: the equation of motion in the velocity through the
//! water, which a constant current leaves as it is. The derivatives by attitude, velocity and force are carried through
//! the stages of the step itself, so that they are those of the discrete step and not of a series. The equation of motion
//! is differentiated once per stage and by the velocity alone ([`Jet`]): by force and by the vertical in the body frame,
//! `e = Rᵀ e_z`, it is linear, `∂ν'/∂τ = M⁻¹`, `∂ν'/∂e = M⁻¹ [(W − B) I; S(r_g W − r_b B)]`. The motion goes first, and
//! every column of derivatives then goes through its four stages by itself. The attitude is perturbed in the body frame:
//! `q = q̂ ⊗ [1, ½ δ]` before, `δ = 2 vec(q̂⁻¹ ⊗ ∂q)` after.
//!
//! Source: Fossen (2011), section 8.3 and equation 7.9; Solà (2017), section 5.4.
//! Tests: `tests/filter/process.rs` (difference quotients of the plain step; a current changes nothing but the track).

use super::error_state::{Block, COLUMNS};
use super::estimate::{ATTITUDE, Estimate, FORCE};
use crate::actuator::characteristic::Thrust;
use crate::description::Description;
use crate::model::integrate::{STAGES, State};
use crate::model::kinematics::{Quaternion, quaternion_product, quaternion_rate, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, dot, each, product, restricted_inverse};
use crate::number::jet::Jet;
use crate::number::real::Real;

/// So many derivatives by the velocity are carried in one evaluation of the equation of motion: with all six fewer numbers
/// stay in registers, and a step takes longer.
const ABREAST: usize = 3;

/// A number of the equation of motion.
type Carried<T> = Jet<T, ABREAST>;

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

/// The vehicle as the filter's process model; of several vehicles abreast the same.
pub struct Process<T = f64> {
    vehicle: Vehicle<Carried<T>>,
    instants: [Instant<Carried<T>>; 3],
    stages: [Stage<T>; 4],
    /// Derivatives of the acceleration by force and by the vertical in the body frame, which are constant.
    by_force: Mat6<f64>,
    by_vertical: [Vec3<f64>; 6],
}

/// What the derivatives read of a stage of a step.
#[derive(Clone, Copy)]
struct Stage<T> {
    attitude: Quaternion<T>,
    rates: Vec3<T>,
    rotation: Mat3<T>,
    /// `∂(R(q) v)/∂q`.
    track: [[T; 4]; 3],
    /// Derivatives of the acceleration by q and by the velocity.
    by_attitude: [[T; 4]; 6],
    by_velocity: Mat6<T>,
}

impl Process {
    /// The model of a described vehicle in its own environment.
    pub fn new(description: &Description) -> Self {
        Self::new_in(description, 0.0)
    }
}

impl<T: Real> Process<T> {
    /// [`Process::new`] in the kind of `unit`.
    pub fn new_in(description: &Description, unit: T) -> Self {
        let zero = unit.zero();
        let vehicle = Vehicle::nominal_in(description, Jet::constant(zero));
        let (thrusters, fins) = (vehicle.actuators.len(), vehicle.fins.len());
        let instants = std::array::from_fn(|_| Instant {
            thrusts: Vec::with_capacity(thrusters),
            deflections: Vec::with_capacity(fins),
            ..Instant::default()
        });
        let none = Stage {
            attitude: [zero; 4],
            rates: [zero; 3],
            rotation: [[zero; 3]; 3],
            track: [[zero; 4]; 3],
            by_attitude: [[zero; 4]; 6],
            by_velocity: [[zero; 6]; 6],
        };
        let (by_force, by_vertical) = linear_parts(description);
        Self { vehicle, instants, stages: [none; 4], by_force, by_vertical }
    }

    /// Moves an estimate by steps of `h` seconds and writes the Jacobian of its motion.
    ///
    /// `nodes` are what the actuators do at the start, the middle and the end of each step, one more than two per step,
    /// with their sum formed ([`crate::model::drive::act`]).
    #[inline(always)]
    pub fn advance(
        &mut self,
        estimate: &mut Estimate<T>,
        nodes: &[Instant<T>],
        h: f64,
        block: &mut Block<T>,
    ) {
        let zero = estimate.force[0].zero();
        let mut columns = [[zero; 13]; COLUMNS];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = seeded(&estimate.motion.attitude, k);
        }
        for three in nodes.windows(3).step_by(2) {
            for k in 0..3 {
                lift(&mut self.instants[k], &three[k], &estimate.force);
            }
            let length = self.step(&mut estimate.motion, h);
            for (k, column) in columns.iter_mut().enumerate() {
                self.carry(column, k.checked_sub(FORCE - ATTITUDE), h);
                length.divide(column);
            }
        }
        let [w, x, y, z] = estimate.motion.attitude;
        for k in 0..COLUMNS {
            let end = &columns[k];
            let turned = quaternion_product(&[w, -x, -y, -z], &[end[3], end[4], end[5], end[6]]);
            for i in 0..3 {
                block[i][k] = end[i];
                block[3 + i][k] = turned[1 + i] * 2.0;
            }
            for i in 0..6 {
                block[6 + i][k] = end[7 + i];
            }
        }
        let time = h * (nodes.len() / 2) as f64;
        for i in 0..3 {
            estimate.motion.position[i] += estimate.current[i] * time;
        }
    }

    /// A step of the motion; what its stages show is kept for the derivatives.
    #[inline(always)]
    fn step(&mut self, motion: &mut State<T>, h: f64) -> Length<T> {
        let start = motion.row();
        let zero = start[0].zero();
        let (mut end, mut slope) = (start, [zero; 13]);
        for (stage, (node, weight, instant)) in STAGES.into_iter().enumerate() {
            let (node, weight) = (zero.splat(node * h), zero.splat(weight * h));
            let mut at = start;
            for i in 0..13 {
                at[i] = slope[i].mul_add(node, start[i]);
            }
            let [x, y, z, a, b, c, d, nu @ ..] = at;
            let (attitude, [u, v, w, p, q, s]) = ([a, b, c, d], nu);
            let r = rotation(&attitude);
            let (acceleration, by_velocity) = self.accelerate((&[x, y, z], &r), &nu, instant);
            slope[..3].copy_from_slice(&product(&r, &[u, v, w]));
            slope[3..7].copy_from_slice(&quaternion_rate(&attitude, &[p, q, s]));
            slope[7..].copy_from_slice(&acceleration);
            for i in 0..13 {
                end[i] = slope[i].mul_add(weight, end[i]);
            }
            let by_attitude = heavy(&self.by_vertical, &attitude);
            let track = track_by_attitude(&attitude, &[u, v, w]);
            self.stages[stage] =
                Stage { attitude, rates: [p, q, s], rotation: r, track, by_attitude, by_velocity };
        }
        let [x, y, z, a, b, c, d, nu @ ..] = each(&end, Real::flush);
        let length = Length::of([a, b, c, d]);
        *motion = State { position: [x, y, z], attitude: each(&[a, b, c, d], |q| q * length.scale), nu };
        length
    }

    /// The acceleration at an instant, and its derivatives by the velocity.
    #[inline(always)]
    fn accelerate(
        &self,
        (place, r): (&Vec3<T>, &Mat3<T>),
        nu: &Vec6<T>,
        instant: usize,
    ) -> (Vec6<T>, Mat6<T>) {
        // Keeps the compiler from lifting a hundred constants out of the loop over the stages, only to spill them.
        let vehicle = std::hint::black_box(&self.vehicle);
        let zero = nu[0].zero();
        let one = zero.splat(1.0);
        let none = Jet::constant(zero);
        let mut turned = [[none; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                turned[i][j].value = r[i][j];
            }
        }
        let mut placed = [none; 3];
        for i in 0..3 {
            placed[i].value = place[i];
        }
        let (mut value, mut slopes) = ([zero; 6], [[zero; 6]; 6]);
        for first in (0..6).step_by(ABREAST) {
            let mut moving = [none; 6];
            for i in 0..6 {
                moving[i].value = nu[i];
                for k in 0..ABREAST {
                    moving[i].slopes[k] = if first + k == i { one } else { zero };
                }
            }
            let found = vehicle.acceleration((Some(&placed), &turned), &moving, &self.instants[instant]);
            for i in 0..6 {
                value[i] = found[i].value;
                slopes[i][first..first + ABREAST].copy_from_slice(&found[i].slopes);
            }
        }
        (value, slopes)
    }

    /// One column of derivatives over a step whose stages are known: rows as [`State::row`] has them, `force` is the
    /// component of the force that it is by. The kinematics are differentiated by hand, because the derivatives of R
    /// itself are not asked for.
    #[inline(always)]
    fn carry(&self, column: &mut [T; 13], force: Option<usize>, h: f64) {
        let zero = column[0].zero();
        let (start, mut slope) = (*column, [zero; 13]);
        let mut pushed = [zero; 6];
        if let Some(force) = force {
            for i in 0..6 {
                pushed[i] = zero.splat(self.by_force[i][force]);
            }
        }
        for (stage, (node, weight, _)) in self.stages.iter().zip(STAGES) {
            let (node, weight) = (zero.splat(node * h), zero.splat(weight * h));
            let mut near = start;
            // Nothing depends on the place.
            for i in 3..13 {
                near[i] = slope[i].mul_add(node, start[i]);
            }
            let [_, _, _, dw, dx, dy, dz, moving @ ..] = near;
            let ([du, dv, dr, dp, dq, ds], turned) = (moving, [dw, dx, dy, dz]);
            let along = product(&stage.rotation, &[du, dv, dr]);
            slope[..3].copy_from_slice(&weighed(&stage.track, &turned, &along));
            let (spun, quarter) =
                (quaternion_rate(&turned, &stage.rates), quaternion_rate(&stage.attitude, &[dp, dq, ds]));
            for i in 0..4 {
                slope[3 + i] = spun[i] + quarter[i];
            }
            let weighty = weighed(&stage.by_attitude, &turned, &pushed);
            slope[7..].copy_from_slice(&weighed(&stage.by_velocity, &moving, &weighty));
            for i in 0..13 {
                column[i] = slope[i].mul_add(weight, column[i]);
            }
        }
    }
}

/// What the actuators do at an instant of a step, and the unmodelled force, as constants.
#[inline(always)]
fn lift<T: Real>(lifted: &mut Instant<Carried<T>>, node: &Instant<T>, force: &Vec6<T>) {
    let mut sum = [Jet::constant(force[0].zero()); 6];
    for i in 0..6 {
        sum[i].value = node.inflow_free.map_or(force[i], |known| force[i] + known[i]);
    }
    lifted.inflow_free = Some(sum);
    lifted.thrusts.clear();
    for thrust in &node.thrusts {
        lifted.thrusts.push(Thrust {
            force: Jet::constant(thrust.force),
            force_per_inflow: Jet::constant(thrust.force_per_inflow),
            torque: Jet::constant(thrust.torque),
            torque_per_inflow: Jet::constant(thrust.torque_per_inflow),
        });
    }
    lifted.deflections.clear();
    for &(sine, cosine) in &node.deflections {
        lifted.deflections.push((Jet::constant(sine), Jet::constant(cosine)));
    }
}

/// What brings a quaternion back to the length 1 after a step, as [`crate::model::kinematics::renormalised`] does: the
/// quaternion, the factor, and the derivative of the factor by half the square of the length.
struct Length<T> {
    q: Quaternion<T>,
    scale: T,
    slope: T,
}

impl<T: Real> Length<T> {
    #[inline(always)]
    fn of(q: Quaternion<T>) -> Self {
        let half_square = dot(&q, &q) * 0.5;
        let first = half_square.splat(1.5) - half_square;
        let second = (half_square * first).neg_mul_add(first, first.splat(1.5));
        // first' = −1, second' = −first² + 2 half_square first.
        let slope = first * (half_square * 2.0 * first - first * first) - second;
        Self { q, scale: first * second, slope }
    }

    /// The derivatives of a motion after it.
    #[inline(always)]
    fn divide(&self, column: &mut [T; 13]) {
        let grown = dot(&self.q, &[column[3], column[4], column[5], column[6]]) * self.slope;
        for i in 0..4 {
            column[3 + i] = self.q[i].mul_add(grown, column[3 + i] * self.scale);
        }
    }
}

/// `A x + y`.
#[inline(always)]
fn weighed<T: Real, const N: usize, const M: usize>(a: &[[T; M]; N], x: &[T; M], y: &[T; N]) -> [T; N] {
    let mut sum = *y;
    for i in 0..N {
        for j in 0..M {
            sum[i] = a[i][j].mul_add(x[j], sum[i]);
        }
    }
    sum
}

/// `∂(R(q) v)/∂q`.
#[inline(always)]
fn track_by_attitude<T: Real>(q: &Quaternion<T>, v: &Vec3<T>) -> [[T; 4]; 3] {
    let ([w, x, y, z], [a, b, c]) = (each(q, |part| part * 2.0), *v);
    [
        [y * c - z * b, y * b + z * c, x * b + w * c - y * a * 2.0, x * c - w * b - z * a * 2.0],
        [z * a - x * c, y * a - w * c - x * b * 2.0, x * a + z * c, w * a + y * c - z * b * 2.0],
        [x * b - y * a, z * a + w * b - x * c * 2.0, z * b - w * a - y * c * 2.0, x * a + y * b],
    ]
}

/// The derivative of the acceleration by q: through the vertical in the body frame, `e = R(q)ᵀ e_z`.
#[inline(always)]
fn heavy<T: Real>(by_vertical: &[Vec3<f64>; 6], q: &Quaternion<T>) -> [[T; 4]; 6] {
    let [w, x, y, z] = each(q, |part| part * 2.0);
    let vertical = [[-y, z, -w, x], [x, w, z, y], [w.zero(), x * -2.0, y * -2.0, w.zero()]];
    let mut by_attitude = [[w.zero(); 4]; 6];
    for i in 0..6 {
        for j in 0..4 {
            for k in 0..3 {
                let factor = w.splat(by_vertical[i][k]);
                by_attitude[i][j] = vertical[k][j].mul_add(factor, by_attitude[i][j]);
            }
        }
    }
    by_attitude
}

/// The derivatives of a motion by the component `k` of a small turn in the body frame, then of the velocity, then of the
/// force: none yet.
#[inline(always)]
fn seeded<T: Real>(attitude: &Quaternion<T>, k: usize) -> [T; 13] {
    let zero = attitude[0].zero();
    let mut row = [zero; 13];
    let mut unit = [zero; 9];
    if k < unit.len() {
        unit[k] = zero.splat(1.0);
    }
    let [x, y, z, moving @ ..] = unit;
    // The turn [1, ½ δ].
    row[3..7].copy_from_slice(&quaternion_rate(attitude, &[x, y, z]));
    row[7..].copy_from_slice(&moving);
    row
}
