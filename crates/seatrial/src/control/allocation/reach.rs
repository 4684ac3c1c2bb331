//! One actuator at one instant: the forces it can give, the command that gives one, and what a command gives.
//!
//! The unknown of the allocation is the thrust of a thruster, and of a fin the force along its normal: the fin's
//! drag stays with the hull. Where [`Water::fin_inflow`] is false the force of the undeflected fin stays there too, and
//! the unknown is what the deflection adds.
//!
//! Tests: `tests/allocation.rs`.

use super::minimum::Hold;
use crate::actuator::Actuator;
use crate::actuator::characteristic::{Bias, Thrust};
use crate::actuator::fin::Flow;
use crate::description::{ActuatorDescription, Description, Effect};
use crate::model::vehicle::Vehicle;
use crate::number::algebra::{Vec6, dot, splat};
use crate::number::real::Real;

/// What surrounds the actuators.
#[derive(Clone, Copy)]
pub struct Water<'a, T> {
    /// Velocity relative to the water, m/s and rad/s.
    pub nu_r: &'a Vec6<T>,
    /// Supply voltage, V; the first row of a measured table where it is not a number.
    pub voltage: f64,
    /// Whether fins follow the inflow.
    pub fin_inflow: bool,
}

/// The forces within reach of one actuator, N.
#[derive(Clone, Copy, Debug)]
pub struct Reach<T> {
    /// Smallest force.
    pub lowest: T,
    /// Largest force.
    pub highest: T,
    /// Force at its idle signal; zero without one.
    pub preferred: T,
    /// Inflow along a thruster, m/s.
    inflow: T,
    /// Water at a fin.
    flow: Option<Flow<T>>,
    /// Force of a fin that is left to the hull.
    left_out: T,
}

/// Wrench about O per newton of actuator k: of a fin along its normal.
#[inline(always)]
pub fn column<T: Real>(vehicle: &Vehicle<T>, k: usize) -> Vec6<T> {
    let unit = vehicle.mass_matrix[0][0];
    match vehicle.actuators.get(k) {
        Some(thruster) => thruster.wrench,
        None => {
            let fin = &vehicle.fins[k - vehicle.actuators.len()];
            let [x, y, z] = fin.place;
            let [a, b, c] = fin.normal;
            splat(unit, &[a, b, c, y * c - z * b, z * a - x * c, x * b - y * a])
        }
    }
}

/// Thrust at a command, with the ratio astern.
#[inline(always)]
pub fn thrust<T: Real>(actuator: &Actuator<T>, command: T, voltage: f64) -> Thrust<T> {
    actuator.directed(actuator.characteristic.thrust(actuator.motor.k_v * command, voltage))
}

/// What actuator k can do.
#[inline(always)]
pub fn reach<T: Real>(vehicle: &Vehicle<T>, k: usize, hold: &Hold, water: &Water<'_, T>) -> Reach<T> {
    let zero = water.nu_r[0].zero();
    let [least, most] = splat(zero, &hold.range());
    let Some(thruster) = vehicle.actuators.get(k) else {
        let fin = &vehicle.fins[k - vehicle.actuators.len()];
        let flow = fin.flow(water.nu_r);
        let gain = fin.servo.k_v;
        let [from, to] = fin.working_range([-(least * gain), most * gain], &flow);
        let mut forces = [zero, from, to];
        for force in &mut forces {
            *force = fin.normal_force(*force, &flow);
        }
        let left_out = if water.fin_inflow { zero } else { forces[0] };
        let (a, b) = (forces[1] - left_out, forces[2] - left_out);
        let (lowest, highest) = (a.min(b), a.max(b));
        return Reach { lowest, highest, preferred: zero, inflow: zero, flow: Some(flow), left_out };
    };
    let inflow = dot(&thruster.inflow, water.nu_r);
    let mut forces = [zero.splat(hold.idle), least, most];
    for force in &mut forces {
        let thrust = thrust(thruster, *force, water.voltage);
        *force = thrust.force_per_inflow.mul_add(inflow, thrust.force);
    }
    let [idle, a, b] = forces;
    let (mut lowest, mut highest) = (a.min(b), a.max(b));
    if hold.idle == 0.0 {
        // At rest.
        (lowest, highest) = (lowest.min(zero), highest.max(zero));
    }
    let preferred = if hold.idle == 0.0 { zero } else { idle };
    Reach { lowest, highest, preferred, inflow, flow: None, left_out: zero }
}

impl<T: Real> Reach<T> {
    /// No force.
    pub fn none(zero: T) -> Self {
        Self { lowest: zero, highest: zero, preferred: zero, inflow: zero, flow: None, left_out: zero }
    }

    /// The command of actuator k that gives `force`, of which `left` remains after the other groups' wash; `turning`
    /// is −1, 0 or 1.
    #[inline(always)]
    pub fn command(
        &self,
        vehicle: &Vehicle<T>,
        k: usize,
        (force, left): (T, T),
        (turning, voltage): (T, f64),
    ) -> T {
        let gain = vehicle.motor(k).k_v;
        let signal = match (vehicle.actuators.get(k), &self.flow) {
            (None, Some(flow)) => {
                vehicle.fins[k - vehicle.actuators.len()].signal(force + self.left_out, flow)
            }
            (Some(thruster), _) => {
                let astern_ratio = thruster.astern_ratio.unwrap_or(force.splat(1.0));
                let bias = Bias { turning, astern_ratio };
                thruster.characteristic.signal_near(force / left, self.inflow, voltage, &bias)
            }
            (None, None) => force.zero(),
        };
        signal / gain
    }

    /// The force of actuator k at a signal, N: of a fin along its normal, without what is left to the hull.
    #[inline(always)]
    pub fn force(&self, vehicle: &Vehicle<T>, k: usize, signal: T, voltage: f64) -> T {
        if let Some(thruster) = vehicle.actuators.get(k) {
            let thrust = thruster.directed(thruster.characteristic.thrust(signal, voltage));
            return thrust.force_per_inflow.mul_add(self.inflow, thrust.force);
        }
        let fin = &vehicle.fins[k - vehicle.actuators.len()];
        self.flow.as_ref().map_or(signal.zero(), |flow| fin.normal_force(signal, flow) - self.left_out)
    }

    /// `tau` + wrench of actuator k at a command, its thrust reduced to the share `left`.
    #[inline(always)]
    pub fn add(
        &self,
        vehicle: &Vehicle<T>,
        k: usize,
        (command, left): (T, T),
        (tau, voltage): (&Vec6<T>, f64),
    ) -> Vec6<T> {
        if let Some(thruster) = vehicle.actuators.get(k) {
            let thrust = thrust(thruster, command, voltage).times(left);
            let force = thrust.force_per_inflow.mul_add(self.inflow, thrust.force);
            return thruster.add(force, thrust.torque_per_inflow.mul_add(self.inflow, thrust.torque), tau);
        }
        let mut sum = *tau;
        let force = self.force(vehicle, k, vehicle.motor(k).k_v * command, voltage);
        let b = column(vehicle, k);
        for i in 0..6 {
            sum[i] = b[i].mul_add(force, sum[i]);
        }
        sum
    }
}

/// The largest force of actuator k in both directions at bollard, of a fin at 1 m/s, N: the smaller of the two, the
/// other where there is only one.
pub fn capability<T: Real>(vehicle: &Vehicle<T>, k: usize, hold: &Hold) -> T {
    let zero = vehicle.mass_matrix[0][0].zero();
    let mut nu_r = [zero; 6];
    if k >= vehicle.actuators.len() {
        let chord = &vehicle.fins[k - vehicle.actuators.len()].chord;
        for i in 0..3 {
            nu_r[i] = zero.splat(chord[i]);
        }
    }
    let whole = Hold { idle: 0.0, ..*hold };
    let water = Water { nu_r: &nu_r, voltage: f64::NAN, fin_inflow: true };
    let reach = reach(vehicle, k, &whole, &water);
    let (one, other) = (reach.highest.abs(), reach.lowest.abs());
    let smaller = one.min(other);
    T::select(zero.splat(1e-9).lt(smaller), smaller, one.max(other))
}

/// The capability of every actuator, N; an unlimited thruster is as strong as the strongest limited one, or 1 N.
pub(super) fn capabilities<T: Real>(
    description: &Description,
    vehicle: &Vehicle<T>,
    holds: &[Hold],
) -> Vec<T> {
    let zero = vehicle.mass_matrix[0][0].zero();
    let mut capability: Vec<T> =
        holds.iter().enumerate().map(|(k, hold)| capability(vehicle, k, hold)).collect();
    let thrusters = 0..vehicle.actuators.len();
    let mut strongest = zero;
    for k in thrusters.clone().filter(|&k| !is_unlimited(&description.actuators[k])) {
        strongest = strongest.max(capability[k]);
    }
    let stand_in = T::select(zero.lt(strongest), strongest, zero.splat(1.0));
    thrusters.filter(|&k| is_unlimited(&description.actuators[k])).for_each(|k| capability[k] = stand_in);
    capability
}

/// Whether neither limits nor a measured table bound the force.
pub(super) fn is_unlimited(actuator: &ActuatorDescription) -> bool {
    matches!(actuator.effect, Effect::Thrust(_, None))
        && actuator.limits.maximum.iter().any(|maximum| maximum.is_infinite())
}
