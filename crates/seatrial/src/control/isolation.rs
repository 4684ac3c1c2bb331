//! Which actuator does something else than it is commanded, told by the motion: what the forces that are known leave
//! unexplained is held against what each actuator could do instead.
//!
//! Momentum and known forces pass the same two lags τ, so that no velocity is differentiated:
//!
//! ```text
//! r = (p₁ − p₂)/τ − f₂,   p = M ν,   f = τ(n) − C(ν) ν − D(ν_r) ν_r − g,   x₁' = (x − x₁)/τ,   x₂' = (x₁ − x₂)/τ
//! ```
//!
//! An actuator with the wrench b per newton whose force is δ beyond the expected one leaves `r = b δ`; all of them dead
//! leave the negative sum of their wrenches. What else may leave something is the covariance
//!
//! ```text
//! S = diag[½ V + (ρ d₂)² + (ρ M ν')² + (2 % of what the actuators can do)²] + Σ (ρ F)² b bᵀ + Σ_xy j jᵀ
//! ```
//!
//! with V the variance of the unexplained force after one lag about that after two (waves, noise), d₂ the hydrodynamic
//! force and F those of the actuators (errors of the model, ρ), j what a current of 0.25 m/s changes. Twice the logarithm of
//! the generalised likelihood ratio is `Λ = 2 δ bᵀS⁻¹r − δ² bᵀS⁻¹b` at the best δ within the actuator's reach. The actuator
//! with the largest Λ is suspected where that exceeds 20 for six seconds, or 35 for 2.4, and explains most of `rᵀS⁻¹r`: a
//! collision, a tether or the bottom push as no actuator does. It is given up after six, where the others can do without
//! it and its signal is not measured; from then on it counts as standing at the force that was found, and is looked at
//! again.
//!
//! Nothing of this changes faster than the lags: motion, attitude and signals are averaged over 0.25 s, and a batch pays
//! for lags and ratios at their ends alone. With `S = L Lᵀ` the ratios are products of `L⁻¹ r` and `L⁻¹ b`. What a current
//! changes is found for one from ahead and one from the side in turn.
//!
//! Source: Willsky and Jones (1976), generalised likelihood ratio; De Luca and Mattone (2003), momentum in place of
//! acceleration. Constants: this project, by simulation, docs/validation.md.
//! Tests: `tests/core/test_helm_actuators.py`, `tests/export/test_c_faults.py`.

use crate::control::allocation::Allocator;
use crate::control::allocation::reach::column;
use crate::control::navigation::{ALTITUDE, DEPTH, Measurement};
use crate::model::drive::act;
use crate::model::kinematics::{from_euler, rotation};
use crate::model::vehicle::{Instant, Vehicle};
use crate::number::algebra::{Mat6, Vec3, Vec6, cross, dot, each, product};
use crate::number::real::Real;

/// Time constant τ of each lag, s: between a motor's and a wave's.
const LAG_S: f64 = 2.0;

/// Memory of the variance V, s: a dozen waves.
const MEMORY_S: f64 = 60.0;

/// Share of V that is left after the second lag: of waves of 9 s a third.
const LEFT: f64 = 0.5;

/// Share by which hydrodynamic forces and inertia, and the force of one actuator, may be wrong.
const MODEL_ERROR: f64 = 0.15;
const THRUST_ERROR: f64 = 0.12;

/// Share of the actuators' reach that trim and ballast may leave in a row.
const TRIM_ERROR: f64 = 0.02;

/// Acceleration that no model explains, m/s² and rad/s².
const LEAST: f64 = 2e-3;

/// A current that no sensor tells, m/s: the standard deviation of each component.
const CURRENT_M_S: f64 = 0.25;

/// Λ from which time counts against an actuator, and the share of the unexplained that it must explain.
const SUSPECT: f64 = 20.0;
const EXPLAINS: f64 = 0.6;

/// Each second counts (Λ − 10)/10 of them, at most 2.5: waves push hard for a moment, a failure lasts.
const UNTOLD: f64 = 10.0;
const MOST: f64 = 2.5;

/// So much counted time, s, makes a suspect: two seconds at Λ > 20 raised eight false alarms of a torpedo in 320 h.
const SUSPECTED_S: f64 = 6.0;

/// The same actuator for so long, s, is given up.
const CERTAIN_S: f64 = 6.0;

/// Means are looked at when there are more than so many seconds of them: an eighth of a lag.
const LOOK_S: f64 = 0.25;

/// A signal at which a propeller pulls and turns; the ratio of both hardly depends on it.
const AHEAD: f64 = 1000.0;

/// The first of the channels that tell a force: attitude, velocity, rates; when older, s, they tell none.
const ATTITUDE: usize = 3;
const BLIND_S: f64 = 1.5;

/// Nothing is judged before the lags have settled, s, and above this depth, m: the model knows no surface.
const SETTLED_S: f64 = 15.0;
const SUBMERGED_M: f64 = 1.5;

/// A number through one lag and through two.
type Lagged<T> = [T; 2];

/// What is remembered of the motion and the forces.
#[derive(Clone)]
pub struct Isolation<T> {
    /// Momentum at the last look, and through the lags.
    last: Vec6<T>,
    momentum: [Lagged<T>; 6],
    /// Known force, and the hydrodynamic part of it, through the lags.
    known: [Lagged<T>; 6],
    flow: [Lagged<T>; 6],
    /// Force of each actuator through the lags, N.
    force: Vec<Lagged<T>>,
    /// What waves and noise leave, squared.
    variance: Vec6<T>,
    /// What a current from ahead and one from the side would change, N and N m; 1 where the side is next.
    drift: [Vec6<T>; 2],
    aside: T,
    /// Velocities and rates, the velocity through the water, the vertical in the body frame, and the signals of the
    /// actuators since the last look, times the time, s, of which there was so much; 1 where something was not seen.
    moved: [T; 9],
    down: Vec3<T>,
    acted: Vec<T>,
    waited: T,
    hidden: T,
    /// For how long it has looked, s; 1 where the last look was blind.
    looked: T,
    blind: T,
    /// The same since the sensors contradicted each other, s.
    settled: T,
    /// The hypothesis that explains best, from 1, and 0 for none; for how long there has been one, weighted, s.
    best: T,
    lasting: T,
    /// For how long it has been the same, s.
    certain: T,
    /// The force that the best actuator gives instead, N.
    instead: T,
    instant: Instant<T>,
    /// Mean signal of each actuator, and its wrench per newton, while they are judged.
    signals: Vec<T>,
    directions: Vec<Vec6<T>>,
}

crate::memory!(Isolation:
    last, momentum, known, flow, force, variance, drift, aside, moved, down, acted, waited, hidden, looked, blind, settled, best, lasting, certain, instead;
    instant, signals, directions);

impl<T: Real> Isolation<T> {
    /// Nothing seen yet of so many actuators.
    pub fn new(actuators: usize, unit: T) -> Self {
        let (zero, lagged) = (unit.zero(), [[unit.zero(); 2]; 6]);
        let mut instant = Instant::default();
        instant.thrusts.reserve_exact(actuators);
        instant.deflections.reserve_exact(actuators);
        Self {
            last: [zero; 6],
            momentum: lagged,
            known: lagged,
            flow: lagged,
            force: vec![[zero; 2]; actuators],
            variance: [zero; 6],
            drift: [[zero; 6]; 2],
            aside: zero,
            moved: [zero; 9],
            down: [zero; 3],
            acted: vec![zero; actuators],
            waited: zero,
            hidden: zero,
            looked: zero,
            blind: zero.splat(1.0),
            settled: zero,
            best: zero,
            lasting: zero,
            certain: zero,
            instead: zero,
            instant,
            signals: vec![zero; actuators],
            directions: vec![[zero; 6]; actuators],
        }
    }

    /// The actuator that is suspected, from 1; one more than there are where all are dead, 0 for none.
    #[inline(always)]
    pub fn suspect(&self) -> T {
        // Half a look earlier it was no less true, in the mean.
        T::select(self.best.splat(SUSPECTED_S - 0.5 * LOOK_S).lt(self.lasting), self.best, self.best.zero())
    }

    /// Where actuator `k` is certain not to do what it is commanded, and the force that it gives instead, N.
    #[inline(always)]
    pub fn certain(&self, k: usize) -> (T::Mask, T) {
        let this = (self.best - (k as f64 + 1.0)).abs().lt(self.best.splat(0.5));
        (T::both(this, self.best.splat(CERTAIN_S).lt(self.certain)), self.instead)
    }

    /// Forgets where `at` holds whom it suspects: an operator has looked at it.
    #[inline(always)]
    pub fn forget(&mut self, at: T::Mask) {
        self.lasting = T::select(at, self.lasting.zero(), self.lasting);
        self.certain = T::select(at, self.lasting.zero(), self.certain);
    }

    /// Takes what is believed `dt` seconds after the last step, while the actuators stand at `signals`, as they are
    /// measured or else expected, and looks at the means when they are due; where the sensors do not `agree` nothing is
    /// judged for a time.
    #[inline(always)]
    pub fn see(
        &mut self,
        known: (&Vehicle<T>, &Allocator<T>),
        (measured, agree): (&Measurement<T>, T::Mask),
        signals: &[T],
        dt: f64,
    ) {
        let zero = self.looked.zero();
        let ([u, v, w], [p, q, r]) = (measured.velocity(), measured.rates());
        let [u_r, v_r, w_r] = measured.water();
        let time = zero.splat(dt);
        let moving = [u, v, w, p, q, r, u_r, v_r, w_r];
        for (sum, x) in self.moved.iter_mut().zip(moving) {
            *sum = x.mul_add(time, *sum);
        }
        // The latest attitude alone would bring the noise of one sample in three.
        let [_, _, down] = rotation(&from_euler(&measured.attitude()));
        for (sum, x) in self.down.iter_mut().zip(down) {
            *sum = x.mul_add(time, *sum);
        }
        for (sum, &signal) in self.acted.iter_mut().zip(signals) {
            *sum = signal.mul_add(time, *sum);
        }
        let oldest = measured.age[ATTITUDE..ALTITUDE].iter().fold(zero, |oldest, &age| oldest.max(age));
        let blind = T::select(zero.splat(BLIND_S).lt(oldest), zero.splat(1.0), zero);
        self.hidden = self.hidden.max(blind);
        self.settled = T::select(agree, self.settled, zero);
        self.waited += time;
        let due = zero.splat(LOOK_S).lt(self.waited);
        if T::any(due) {
            zero.apart(
                #[inline(always)]
                || self.look(known, measured, due),
            );
        }
    }

    /// Where it is `due`, looks at the means since the last look.
    #[inline(always)]
    fn look(
        &mut self,
        (model, allocator): (&Vehicle<T>, &Allocator<T>),
        measured: &Measurement<T>,
        due: T::Mask,
    ) {
        let zero = self.looked.zero();
        let (half, waited) = (zero.splat(0.5), self.waited);
        let mean = zero.splat(1.0) / waited;
        let [u, v, w, p, q, r, u_r, v_r, w_r] = each(&self.moved, |sum| sum * mean);
        let (nu, nu_r) = ([u, v, w, p, q, r], [u_r, v_r, w_r, p, q, r]);
        for (signal, &sum) in self.signals.iter_mut().zip(&self.acted) {
            *signal = sum * mean;
        }
        // What was not seen is no force: the momentum goes on from where it is.
        let unseen = T::both(due, half.lt(self.hidden.max(self.blind)));
        self.blind = T::select(due, self.hidden, self.blind);
        let share = T::select(unseen, zero, waited / (waited + LAG_S));
        let share = T::select(due, share, zero);
        let submerged = T::both(zero.splat(SUBMERGED_M).lt(measured.channels[DEPTH]), zero.lt(share));
        let memory = (waited / (self.looked + waited)).max(waited * (1.0 / MEMORY_S));
        let memory = T::select(submerged, memory, zero);
        let seen = T::select(submerged, waited, zero);
        self.looked += seen;
        self.settled += seen;

        act(model, &self.signals, measured.voltage, |_| None, &mut self.instant);
        let (flow, acting) = (hydrodynamic(model, &nu_r), model.wrench(&self.instant, &nu_r));
        let mut known = model.bias.unwrap_or([zero; 6]);
        for i in 0..6 {
            known[i] += flow[i] + acting[i];
        }
        let known = model.rigid_body.add_coriolis(&nu, &known);
        let known = model.restoring.add_weight(&each(&self.down, |sum| sum * mean), &known);
        let momentum = product(&model.mass_matrix, &nu);
        for i in 0..6 {
            let leap = T::select(unseen, momentum[i] - self.last[i], zero);
            let [once, twice] = self.momentum[i];
            self.momentum[i] = lag([once + leap, twice + leap], momentum[i], share);
            self.known[i] = lag(self.known[i], known[i], share);
            self.flow[i] = lag(self.flow[i], flow[i], share);
            let [once, twice] = self.momentum[i];
            let quick = (momentum[i] - once) * (1.0 / LAG_S) - self.known[i][0];
            let wave = quick - ((once - twice) * (1.0 / LAG_S) - self.known[i][1]);
            self.variance[i] += memory * wave.mul_sub(wave, self.variance[i]);
            self.last[i] = T::select(due, momentum[i], self.last[i]);
        }
        for k in 0..self.acted.len() {
            let force = match (model.actuators.get(k), self.instant.thrusts.get(k)) {
                (Some(thruster), Some(thrust)) => {
                    thrust.force_per_inflow.mul_add(dot(&thruster.inflow, &nu_r), thrust.force)
                }
                _ => allocator.force(model, k, self.signals[k], measured.voltage),
            };
            self.force[k] = lag(self.force[k], force, share);
        }
        let ready = T::both(submerged, zero.splat(SETTLED_S).lt(self.settled));
        self.drift_on(model, (&nu_r, &flow, &acting), due);
        self.judge((model, allocator), (due, ready), measured.voltage);
        // The next means begin.
        self.moved = each(&self.moved, |sum| T::select(due, zero, sum));
        self.down = each(&self.down, |sum| T::select(due, zero, sum));
        self.acted.iter_mut().for_each(|sum| *sum = T::select(due, zero, *sum));
        self.hidden = T::select(due, zero, self.hidden);
        self.waited = T::select(due, zero, waited);
    }

    /// Where it is `due`, finds what explains the unexplained best, and counts for how long it has done so.
    #[inline(always)]
    fn judge(
        &mut self,
        (model, allocator): (&Vehicle<T>, &Allocator<T>),
        (due, ready): (T::Mask, T::Mask),
        voltage: f64,
    ) {
        let zero = self.looked.zero();
        let (mut unexplained, mut able, mut covariance) = ([zero; 6], [zero; 6], [[zero; 6]; 6]);
        for k in 0..self.force.len() {
            let b = direction(model, k, voltage);
            let [lowest, highest] = allocator.within_reach(k);
            for i in 0..6 {
                able[i] = b[i].abs().mul_add((highest - lowest) * (0.5 * TRIM_ERROR), able[i]);
            }
            let error = self.force[k][1] * THRUST_ERROR;
            spread(&mut covariance, &b, error * error);
            self.directions[k] = b;
        }
        for i in 0..6 {
            let [once, twice] = self.momentum[i];
            let inertia = (once - twice) * (1.0 / LAG_S);
            unexplained[i] = inertia - self.known[i][1];
            let least = model.mass_matrix[i][i] * LEAST;
            let error = inertia.mul_add(inertia, self.flow[i][1] * self.flow[i][1]);
            let own = least.mul_add(least, self.variance[i] * LEFT) + error * (MODEL_ERROR * MODEL_ERROR);
            covariance[i][i] += able[i].mul_add(able[i], own);
            for change in &self.drift {
                for j in 0..=i {
                    covariance[i][j] = change[i].mul_add(change[j], covariance[i][j]);
                }
            }
        }

        let whitening = Whitening::of(&covariance);
        let weighed = whitening.apply(&unexplained);
        let explainable = dot(&weighed, &weighed);
        let (mut best, mut largest, mut instead) = (zero, zero, zero);
        let mut take = |k: usize, ratio: T, gives: T| {
            let better = largest.lt(ratio);
            best = T::select(better, zero.splat(k as f64 + 1.0), best);
            instead = T::select(better, gives, instead);
            largest = largest.max(ratio);
        };
        let mut all = [zero; 6];
        for k in 0..self.force.len() {
            let (b, force) = (whitening.apply(&self.directions[k]), self.force[k][1]);
            let (along, across) = (dot(&b, &weighed), dot(&b, &b));
            let [lowest, highest] = allocator.within_reach(k);
            // What the actuator gives beyond the expected, N.
            let more = (along / across).clamped(lowest.min(zero) - force, highest.max(zero) - force);
            take(k, more * (along * 2.0 - more * across), force + more);
            for i in 0..6 {
                all[i] = b[i].mul_add(force, all[i]);
            }
        }
        take(self.force.len(), -(dot(&all, &weighed) * 2.0 + dot(&all, &all)), zero);
        let least = (explainable * EXPLAINS).max(zero.splat(SUSPECT));
        let holds = T::both(ready, least.lt(largest));
        let same = (best - self.best).abs().lt(zero.splat(0.5));
        let weight = (largest - UNTOLD) * (1.0 / (SUSPECT - UNTOLD));
        let weight = weight.clamped(zero.splat(1.0), zero.splat(MOST));
        let lasting = T::select(holds, self.waited.mul_add(weight, self.lasting), zero);
        let certain = T::select(same, self.certain, zero) + self.waited;
        self.lasting = T::select(due, lasting, self.lasting);
        self.certain = T::select(due, T::select(holds, certain, zero), self.certain);
        self.best = T::select(due, T::select(holds, best, zero), self.best);
        self.instead = T::select(due, instead, self.instead);
    }

    /// What a current from one of two sides would change of the forces, the sides in turn.
    #[inline(always)]
    fn drift_on(
        &mut self,
        model: &Vehicle<T>,
        (nu_r, flow, acting): (&Vec6<T>, &Vec6<T>, &Vec6<T>),
        due: T::Mask,
    ) {
        let zero = self.looked.zero();
        let half = zero.splat(0.5);
        let (ahead, aside) = (self.aside.lt(half), half.lt(self.aside));
        // From the side a slender hull goes with the water.
        let against = T::both(nu_r[1].lt(zero), aside);
        let current = T::select(against, zero.splat(-CURRENT_M_S), zero.splat(CURRENT_M_S));
        let (x, y) = (T::select(aside, zero, current), T::select(aside, current, zero));
        let [u, v, w, p, q, r] = *nu_r;
        let through = [u - x, v - y, w, p, q, r];
        let [x, y, z] = cross(&[x, y, zero], &[p, q, r]);
        let carried = model.added_mass.momentum(&[x, y, z, zero, zero, zero]);
        let (other, pushed) = (hydrodynamic(model, &through), model.wrench(&self.instant, &through));
        for i in 0..6 {
            let change = other[i] - flow[i] + pushed[i] - acting[i] + carried[i];
            for (side, is_it) in [ahead, aside].into_iter().enumerate() {
                self.drift[side][i] = T::select(T::both(due, is_it), change, self.drift[side][i]);
            }
        }
        self.aside = T::select(due, zero.splat(1.0) - self.aside, self.aside);
    }
}

/// `L⁻¹` of `S = L Lᵀ`.
struct Whitening<T> {
    /// `L`, of its diagonal the reciprocals.
    factor: Mat6<T>,
}

impl<T: Real> Whitening<T> {
    /// That of a positive definite matrix of which the lower triangle is known.
    #[inline(always)]
    fn of(covariance: &Mat6<T>) -> Self {
        let mut l = *covariance;
        for j in 0..6 {
            for i in j..6 {
                for k in 0..j {
                    l[i][j] = l[i][k].neg_mul_add(l[j][k], l[i][j]);
                }
                l[i][j] = if i == j { l[i][j].splat(1.0) / l[i][j].sqrt() } else { l[i][j] * l[j][j] };
            }
        }
        Self { factor: l }
    }

    /// `L⁻¹ x`.
    #[inline(always)]
    fn apply(&self, x: &Vec6<T>) -> Vec6<T> {
        let mut y = *x;
        for i in 0..6 {
            for j in 0..i {
                y[i] = self.factor[i][j].neg_mul_add(y[j], y[i]);
            }
            y[i] *= self.factor[i][i];
        }
        y
    }
}

/// A number through both lags, `share` of the way on.
#[inline(always)]
fn lag<T: Real>([once, twice]: Lagged<T>, now: T, share: T) -> Lagged<T> {
    let once = share.mul_add(now - once, once);
    [once, share.mul_add(once - twice, twice)]
}

/// Wrench about O per newton of actuator k, with the reaction torque of a propeller ahead without inflow.
#[inline(always)]
fn direction<T: Real>(model: &Vehicle<T>, k: usize, voltage: f64) -> Vec6<T> {
    let mut b = column(model, k);
    let Some(thruster) = model.actuators.get(k) else { return b };
    if let Some(torque) = &thruster.torque {
        let ahead = thruster.characteristic.thrust(b[0].splat(AHEAD), voltage);
        for i in 3..6 {
            b[i] = torque[i].mul_add(ahead.torque / ahead.force, b[i]);
        }
    }
    b
}

/// Adds what an error with this `variance` along `direction` may leave, to the lower triangle.
#[inline(always)]
fn spread<T: Real>(covariance: &mut Mat6<T>, direction: &Vec6<T>, variance: T) {
    for i in 0..6 {
        for j in 0..=i {
            covariance[i][j] = (direction[i] * direction[j]).mul_add(variance, covariance[i][j]);
        }
    }
}

/// Force of the water on the hull at the relative velocity, N and N m.
#[inline(always)]
fn hydrodynamic<T: Real>(model: &Vehicle<T>, nu_r: &Vec6<T>) -> Vec6<T> {
    let mut force = model.damping.add(nu_r, &model.added_mass.add_coriolis(nu_r, &[nu_r[0].zero(); 6]));
    if let Some(cross_flow) = &model.cross_flow {
        force = cross_flow.add(nu_r, &force);
    }
    if let Some(lift) = &model.lift {
        force = lift.add(nu_r, &force);
    }
    force
}
