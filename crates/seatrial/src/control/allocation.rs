//! Control allocation: from a demanded wrench to the actuators' commands.
//!
//! ```text
//! τ − stuck actuators' → f = weighted pseudo-inverse on the controlled rows, or a bounded quadratic programme
//!   → within the forces that limits, inflow and supply allow; saturation is redistributed
//!   → signal by the inverse characteristic → hysteresis around the minimum, limits
//!   → the wrench that this reaches in the steady state
//! ```
//!
//! In reading order: [`table`], the settings; [`minimum`], the band that a motor cannot hold; [`reach`](mod@reach), the
//! forces within reach; [`pseudo_inverse`], [`redistribution`] and [`quadratic_programme`], from wrench to forces;
//! [`state`], the [`Allocator`]; `commands`, from forces to signals; [`report`], which rows a vehicle can command at all,
//! by its `singular_values`.
//!
//! An actuator that has failed is left out and the others take over; one that is [stuck](Allocator::stuck) is reckoned
//! with. Fins are allocated by the force along their normal; below a least speed they are held at zero. All memory is
//! taken once; a step does not allocate and cannot fail.
//!
//! Source: Fossen (2011), section 12.3; Härkegård (2002); Johansen and Fossen (2013); Taubert et al. (2014),
//! equations 39–50. Tests: `tests/allocation.rs`.

mod commands;
pub mod minimum;
pub mod pseudo_inverse;
pub mod quadratic_programme;
pub mod reach;
pub mod redistribution;
pub mod report;
pub mod singular_values;
pub mod state;
pub mod table;

use crate::model::vehicle::Vehicle;
use crate::number::algebra::{Vec6, dot};
use crate::number::real::Real;
use reach::{Water, column, reach};
pub use report::{Authority, authority, replaceable};
pub use state::Allocator;
pub use table::{AllocationTable, Method};

impl<T: Real> Allocator<T> {
    /// Says where (by the mask) an actuator stands at a signal whatever is commanded; elsewhere it obeys. The others
    /// make up for it from the next [`Self::prepare`] on.
    #[inline(always)]
    pub fn stuck(&mut self, actuator: usize, signal: T, mask: T::Mask) {
        self.stuck[actuator] = T::select(mask, signal.splat(1.0), signal.zero());
        self.stuck_signal[actuator] = T::select(mask, signal, signal.zero());
    }

    /// The share of the work: for the weights of the rows (1 controlled; a small one for a row that is to stay at zero
    /// where the others allow it; 0 free), the usable actuators (0 or 1) and the forward speed
    /// through the water, m/s. Cheap where nothing has changed.
    #[inline(always)]
    pub fn prepare(&mut self, vehicle: &Vehicle<T>, rows: &Vec6<T>, usable: &[T], speed: T) {
        let (zero, one) = (speed.zero(), speed.splat(1.0));
        let way = speed.abs();
        let moving = T::select(way.lt(one.splat(self.settings.fin_least_speed)), zero, one);
        let mut active = zero;
        let mut same = self.prepared && (!self.shared || speed.equals(self.speed));
        for i in 0..6 {
            active = active.max(rows[i]);
            same &= rows[i].equals(self.rows[i]);
        }
        for k in 0..self.usable.len() {
            let obeys = usable[k] * (one - self.stuck[k]) * active;
            let obeys = if k < self.thrusters { obeys } else { obeys * moving };
            same &= obeys.equals(self.usable[k]);
            self.usable[k] = obeys;
        }
        if same {
            return;
        }
        (self.rows, self.speed, self.prepared) = (*rows, speed, true);
        // Where fins are among themselves, the speed is the same factor for all.
        let pressure = if self.shared { way * way } else { one };
        for k in 0..self.usable.len() {
            let strength = self.capability[k] * self.settings.ease[k];
            let strength = if k < self.thrusters { strength } else { strength * pressure };
            self.pseudo_inverse.effort[k] = self.usable[k] * strength;
        }
        self.pseudo_inverse.update(rows, &self.settings.priority, |k| column(vehicle, k));
    }

    /// Commands as signals (unit of the command, from neutral, positive ahead) for a wrench `tau` (N, N m) at the
    /// relative velocity `nu_r` and a supply voltage (V), and the wrench that they reach in the steady state.
    #[inline(always)]
    pub fn allocate(
        &mut self,
        vehicle: &Vehicle<T>,
        tau: &Vec6<T>,
        nu_r: &Vec6<T>,
        voltage: f64,
        signals: &mut [T],
    ) -> Vec6<T> {
        self.survey(vehicle, nu_r, voltage);
        self.allocate_surveyed(vehicle, tau, voltage, signals)
    }

    /// The same in the water of the last [`Self::survey`].
    #[inline(always)]
    pub fn allocate_surveyed(
        &mut self,
        vehicle: &Vehicle<T>,
        tau: &Vec6<T>,
        voltage: f64,
        signals: &mut [T],
    ) -> Vec6<T> {
        let zero = tau[0].zero();
        let mut rest = *tau;
        for k in 0..self.usable.len() {
            let mut known = self.usable[k] * self.reach[k].preferred;
            if T::any(zero.lt(self.stuck[k])) {
                let wrench = self.stuck_wrench(vehicle, k, voltage);
                for i in 0..6 {
                    rest[i] = T::select(zero.lt(self.stuck[k]), rest[i] - wrench[i], rest[i]);
                }
                known = T::select(zero.lt(self.stuck[k]), zero, known);
            }
            let b = column(vehicle, k);
            for i in 0..6 {
                rest[i] = b[i].neg_mul_add(known, rest[i]);
            }
        }
        self.distribute(&rest);
        self.command(vehicle, voltage, signals);
        let mut reached = [zero; 6];
        for k in 0..self.usable.len() {
            reached = self.reach[k].add(vehicle, k, (signals[k], self.left[k]), (&reached, voltage));
        }
        reached
    }

    /// Sees what every actuator can do at the relative velocity `nu_r` and a supply voltage, V.
    #[inline(always)]
    pub fn survey(&mut self, vehicle: &Vehicle<T>, nu_r: &Vec6<T>, voltage: f64) {
        let water = Water { nu_r, voltage, fin_inflow: self.settings.fin_inflow };
        for k in 0..self.usable.len() {
            self.reach[k] = reach(vehicle, k, &self.settings.holds[k], &water);
        }
    }

    /// The force of actuator k at a signal in the water of the last [`Self::survey`], N: of a fin along its normal.
    #[inline(always)]
    pub fn force(&self, vehicle: &Vehicle<T>, k: usize, signal: T, voltage: f64) -> T {
        self.reach[k].force(vehicle, k, signal, voltage)
    }

    /// The signal at which actuator k gives a force there.
    #[inline(always)]
    pub fn signal_of(&self, vehicle: &Vehicle<T>, k: usize, force: T, voltage: f64) -> T {
        let gives = (force, force.splat(1.0));
        self.reach[k].command(vehicle, k, gives, (self.turning[k], voltage)) * vehicle.motor(k).k_v
    }

    /// The smallest and the largest force of actuator k there, N.
    #[inline(always)]
    pub fn within_reach(&self, k: usize) -> [T; 2] {
        [self.reach[k].lowest, self.reach[k].highest]
    }

    /// The wrench of actuator k where it is stuck. Out of line: it is rare, and would double the code of a step.
    #[inline(never)]
    fn stuck_wrench(&self, vehicle: &Vehicle<T>, k: usize, voltage: f64) -> Vec6<T> {
        let zero = self.stuck[k].zero();
        let at = (self.stuck_signal[k] / vehicle.motor(k).k_v, zero.splat(1.0));
        self.reach[k].add(vehicle, k, at, (&[zero; 6], voltage))
    }

    /// How far a reached wrench is from a demanded one in the scaled rows: what the distribution makes small.
    #[inline(always)]
    pub fn miss(&self, demanded: &Vec6<T>, reached: &Vec6<T>) -> T {
        let mut rest = *demanded;
        for i in 0..6 {
            rest[i] -= reached[i];
        }
        let rest = self.pseudo_inverse.scaled(&rest);
        dot(&rest, &rest).sqrt()
    }

    /// The forces for a wrench beyond the idle and the stuck actuators'.
    #[inline(always)]
    fn distribute(&mut self, rest: &Vec6<T>) {
        let zero = rest[0].zero();
        let p = &self.pseudo_inverse;
        let target = p.scaled(rest);
        let solution = p.solve(&target);
        for k in 0..self.usable.len() {
            let (reach, effort) = (&self.reach[k], p.effort[k]);
            let works = zero.lt(effort);
            let per_newton = T::select(works, zero.splat(1.0) / effort, zero);
            self.shares.share[k] = p.share(k, &solution);
            self.shares.lowest[k] = T::select(works, (reach.lowest - reach.preferred) * per_newton, zero);
            self.shares.highest[k] = T::select(works, (reach.highest - reach.preferred) * per_newton, zero);
        }
        if let Some((programme, solve)) = &mut self.programme {
            solve(programme, p, &target, &mut self.shares);
        } else if self.settings.passes > 0 && T::any(zero.lt(self.shares.outside(zero))) {
            self.shares.redistribute(p, &target, self.settings.passes);
        } else {
            self.shares.clip();
        }
        for k in 0..self.usable.len() {
            self.force[k] =
                self.shares.share[k].mul_add(p.effort[k], self.usable[k] * self.reach[k].preferred);
        }
    }
}
