//! An actuator: from the command to its wrench, in the order of the real chain
//!
//! `command → static limits → rate limit → dead time → first-order lag → characteristic → wrench`.
//!
//! The [`motor`] moves the *signal* (revolutions, pulse width from neutral, or newtons, in the
//! command's own unit, positive ahead); the [`characteristic`] turns the signal into a thrust that is
//! affine in the inflow velocity, `F = F_0 + F_V V`; the wrench per newton places it on the vehicle.
//! By the principle of virtual power the inflow velocity along the thruster is the same vector
//! product, `u_a = b · ν_r`.
//!
//! Source: Taubert et al. (2014), equations 34, 35, 39–47; Fossen (2011), section 9.
//! Tests: `tests/laws.rs` (chain against its analytic answer), `tests/core/test_scalar_textbook.py`.
//! A [`fin`] turns its signal, a deflection, into lift and drag.
//!
//! In reading order: [`wrench`], `[d; r × d]`; [`motor`], one step of it; [`response`], the same motor in closed form at
//! any time; [`characteristic`] and [`fin`], each with its inverse.

pub mod characteristic;
pub mod fin;
pub mod motor;
pub mod response;
pub mod wrench;

use crate::number::algebra::Vec6;
use crate::number::real::Real;
use characteristic::{Characteristic, Thrust};
use motor::Motor;

/// One thruster.
#[derive(Clone)]
pub struct Actuator<T> {
    /// How the signal follows the command.
    pub motor: Motor<T>,
    /// How thrust follows the signal.
    pub characteristic: Characteristic<T>,
    /// Wrench about O per newton of thrust: `[d; r × d]`, or as given.
    pub wrench: Vec6<T>,
    /// Wrench about O per newton metre of reaction torque: `[0; d]`; absent without torque terms.
    pub torque: Option<Vec6<T>>,
    /// Direction of the inflow, `u_a = inflow · ν_r`.
    pub inflow: Vec6<T>,
    /// Further factor on the thrust astern, where it is not one or is sought.
    pub astern_ratio: Option<T>,
    /// Share of the thrust that is lost per newton of the other groups' thrust, where there is such a loss.
    pub loss: Option<T>,
    /// Index of the group.
    pub group: usize,
}

impl<T: Real> Actuator<T> {
    /// `tau` + wrench of a thrust (N) and a reaction torque (N m).
    #[inline(always)]
    pub fn add(&self, force: T, torque: T, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        for i in 0..6 {
            sum[i] = self.wrench[i].mul_add(force, sum[i]);
        }
        if let Some(direction) = &self.torque {
            for i in 3..6 {
                sum[i] = direction[i].mul_add(torque, sum[i]);
            }
        }
        sum
    }

    /// A thrust with the ratio of its direction.
    #[inline(always)]
    pub fn directed(&self, thrust: Thrust<T>) -> Thrust<T> {
        let Some(ratio) = self.astern_ratio else { return thrust };
        let zero = ratio.zero();
        thrust.times(T::select(thrust.force.lt(zero), ratio, zero.splat(1.0)))
    }
}

/// Takes from each thrust what the wash of the other groups costs it:
/// `F_i (1 − loss_i Σ_j |F_j|)`, j over the actuators of other groups, never below zero.
#[inline(always)]
pub fn interact<T: Real>(actuators: &[Actuator<T>], thrusts: &mut [Thrust<T>]) {
    if actuators.iter().all(|actuator| actuator.loss.is_none()) {
        return;
    }
    let alone: Vec<T> = thrusts.iter().map(|thrust| thrust.force.abs()).collect();
    for (actuator, thrust) in actuators.iter().zip(thrusts) {
        let Some(loss) = actuator.loss else { continue };
        let mut others = loss.zero();
        for (other, force) in actuators.iter().zip(&alone) {
            if other.group != actuator.group {
                others += *force;
            }
        }
        let left = loss.neg_mul_add(others, loss.splat(1.0)).max(loss.zero());
        *thrust = thrust.times(left);
    }
}
