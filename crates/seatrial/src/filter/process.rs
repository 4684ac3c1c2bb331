//! The process model: the identified vehicle over one step, and its exact Jacobian.
//!
//! `[p, q, ν_r] ← RK4(p, q, ν_r; τ + τ_u)`, then `p ← p + v_c h`: the equation of motion in the velocity through the
//! water, which a constant current leaves as it is. The motion goes first; what its stages show goes into the derivatives
//! ([`super::tangent`]). The equation of motion is differentiated once per stage and by the velocity alone ([`Jet`]). What
//! the inflow does to a thrust is linear in the velocity, `F = F_0 + F_V u_a`: its derivative is that of an instant.
//!
//! Source: Fossen (2011), section 8.3 and equation 7.9.
//! Tests: `tests/filter/process.rs` (difference quotients of the plain step; a current changes nothing but the track).

use super::estimate::Estimate;
use super::tangent::{Length, Tangent, weighed};
use super::transition::Block;
use crate::description::Description;
use crate::model::integrate::{STAGES, State};
use crate::model::kinematics::{quaternion_rate, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, each, product, restricted_inverse};
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

/// The moment about O per newton of the unmodelled force, which acts at the centre of gravity: `S(r_g)`. There the water
/// pulls that leaves the hull behind, and there is most of what a payload or a tether weighs.
pub fn lever(description: &Description) -> Mat3<f64> {
    let rigid = Vehicle::nominal(description).rigid_body.mass_matrix();
    std::array::from_fn(|i| std::array::from_fn(|j| rigid[3 + i][j] / rigid[0][0]))
}

/// The derivatives of the acceleration by the unmodelled force.
pub fn by_unmodelled(description: &Description) -> Mat6<f64> {
    let (by_force, _) = linear_parts(description);
    let lever = lever(description);
    by_force.map(|row| {
        std::array::from_fn(|j| {
            row[j] + if j < 3 { (0..3).map(|i| row[3 + i] * lever[i][j]).sum() } else { 0.0 }
        })
    })
}

/// A thruster whose thrust the inflow changes.
struct Flowing {
    thruster: usize,
    /// Acceleration per newton of thrust and per newton metre of reaction torque.
    per_force: Vec6<f64>,
    per_torque: Vec6<f64>,
    /// Inflow per velocity.
    inflow: Vec6<f64>,
}

/// What the actuators do at an instant of a step, and the unmodelled force.
struct Acting<T> {
    /// Without the thrusters that the inflow changes.
    instant: Instant<Carried<T>>,
    /// The acceleration by these without inflow, and its derivatives by the velocity.
    acceleration: Vec6<T>,
    by_velocity: Mat6<T>,
}

/// The vehicle as the filter's process model; of several vehicles abreast the same.
pub struct Process<T = f64> {
    vehicle: Vehicle<Carried<T>>,
    flowing: Vec<Flowing>,
    instants: [Acting<T>; 3],
    tangent: Tangent<T>,
    lever: Mat3<f64>,
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
        let instants = std::array::from_fn(|_| Acting {
            instant: Instant { deflections: Vec::with_capacity(vehicle.fins.len()), ..Instant::default() },
            acceleration: [zero; 6],
            by_velocity: [[zero; 6]; 6],
        });
        let (plain, linear) = (Vehicle::nominal(description), linear_parts(description));
        let flowing = plain.actuators.iter().enumerate().filter(|(_, a)| a.characteristic.has_inflow());
        let flowing = flowing.map(|(thruster, actuator)| Flowing {
            thruster,
            per_force: product(&linear.0, &actuator.wrench),
            per_torque: product(&linear.0, &actuator.torque.unwrap_or([0.0; 6])),
            inflow: actuator.inflow,
        });
        let flowing = flowing.collect();
        let tangent = Tangent::new((by_unmodelled(description), linear.1), zero);
        Self { vehicle, flowing, instants, tangent, lever: lever(description) }
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
        let mut start = Some(estimate.motion.attitude);
        let mut force = estimate.force;
        for i in 0..3 {
            for j in 0..3 {
                force[3 + i] += estimate.force[j] * self.lever[i][j];
            }
        }
        for three in nodes.windows(3).step_by(2) {
            for k in 0..3 {
                self.instants[k].see(&self.flowing, &three[k], &force);
            }
            let length = self.step(&mut estimate.motion, h);
            self.tangent.carry(start.take().as_ref(), h, &length);
        }
        self.tangent.write(&estimate.motion.attitude, block);
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
            let by_velocity = self.tangent.see(stage, (&attitude, &r), &nu);
            let acting = (&self.vehicle, &self.instants[instant]);
            let acceleration = accelerate(acting, (&[x, y, z], &r), &nu, by_velocity);
            slope[..3].copy_from_slice(&product(&r, &[u, v, w]));
            slope[3..7].copy_from_slice(&quaternion_rate(&attitude, &[p, q, s]));
            slope[7..].copy_from_slice(&acceleration);
            for i in 0..13 {
                end[i] = slope[i].mul_add(weight, end[i]);
            }
        }
        let [x, y, z, a, b, c, d, nu @ ..] = each(&end, Real::flush);
        let length = Length::of([a, b, c, d]);
        *motion = State { position: [x, y, z], attitude: each(&[a, b, c, d], |q| q * length.scale), nu };
        length
    }
}

/// The acceleration, and its derivatives by the velocity.
#[inline(always)]
fn accelerate<T: Real>(
    (vehicle, acting): (&Vehicle<Carried<T>>, &Acting<T>),
    (place, r): (&Vec3<T>, &Mat3<T>),
    nu: &Vec6<T>,
    by_velocity: &mut Mat6<T>,
) -> Vec6<T> {
    // Keeps the compiler from lifting a hundred constants out of the loop over the stages, only to spill them.
    let vehicle = std::hint::black_box(vehicle);
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
    let mut value = weighed(&acting.by_velocity, nu, &acting.acceleration);
    for first in (0..6).step_by(ABREAST) {
        let mut moving = [none; 6];
        for i in 0..6 {
            moving[i].value = nu[i];
            for k in 0..ABREAST {
                moving[i].slopes[k] = if first + k == i { one } else { zero };
            }
        }
        let found = vehicle.acceleration((Some(&placed), &turned), &moving, &acting.instant);
        for i in 0..6 {
            if first == 0 {
                value[i] += found[i].value;
            }
            for k in 0..ABREAST {
                by_velocity[i][first + k] = acting.by_velocity[i][first + k] + found[i].slopes[k];
            }
        }
    }
    value
}

impl<T: Real> Acting<T> {
    /// Sees what the actuators do at an instant, beside the unmodelled force.
    #[inline(always)]
    fn see(&mut self, flowing: &[Flowing], node: &Instant<T>, force: &Vec6<T>) {
        let zero = force[0].zero();
        let mut sum = [Jet::constant(zero); 6];
        for i in 0..6 {
            sum[i].value = node.inflow_free.map_or(force[i], |known| force[i] + known[i]);
        }
        self.instant.inflow_free = Some(sum);
        self.instant.deflections.clear();
        for &(sine, cosine) in &node.deflections {
            self.instant.deflections.push((Jet::constant(sine), Jet::constant(cosine)));
        }
        (self.acceleration, self.by_velocity) = ([zero; 6], [[zero; 6]; 6]);
        for Flowing { thruster, per_force, per_torque, inflow } in flowing {
            let thrust = &node.thrusts[*thruster];
            for i in 0..6 {
                let (a, b) = (zero.splat(per_force[i]), zero.splat(per_torque[i]));
                let still = &mut self.acceleration[i];
                *still = thrust.force.mul_add(a, thrust.torque.mul_add(b, *still));
                let slope = thrust.force_per_inflow.mul_add(a, thrust.torque_per_inflow * b);
                for j in 0..6 {
                    self.by_velocity[i][j] = slope.mul_add(zero.splat(inflow[j]), self.by_velocity[i][j]);
                }
            }
        }
    }
}
