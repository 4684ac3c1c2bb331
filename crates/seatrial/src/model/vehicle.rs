//! The equation of motion, for one number type:
//!
//! `(M_RB + M_A) ν' = τ − C_RB(ν) ν − C_A(ν_r) ν_r − D(ν_r) ν_r + τ_L(ν_r) − g(η) + M_A ν_c' + τ_FK + τ_T(η, ν_r)`
//!
//! Each term has its own file. A degree of freedom is free, frozen (keeps its velocity) or measured
//! (replayed from a log); `M` is factored once for the free ones, so that
//! `ν'_F = M_FF⁻¹ (f_F − M_FC ν'_C)`: nothing leaks from a locked axis, and no added mass is ever lagged.
//!
//! Source: Fossen (2011), equation 7.9 with 8.3; Taubert et al. (2014), equation 6, corrected.
//! Tests: `tests/laws.rs`, `tests/golden.rs`, `tests/core/test_scalar_textbook.py`.

use crate::actuator::Actuator;
use crate::actuator::characteristic::Thrust;
use crate::actuator::fin::{Deflection, Fin};
use crate::actuator::motor::Motor;
use crate::model::added_mass::AddedMass;
use crate::model::cross_flow::CrossFlow;
use crate::model::current::{Current, Relative};
use crate::model::damping::Damping;
use crate::model::lift::Lift;
use crate::model::restoring::Restoring;
use crate::model::rigid_body::RigidBody;
use crate::model::surface::Surface;
use crate::model::tether::Tether;
use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, dot, product, restricted_inverse};
use crate::number::real::Real;

/// What a degree of freedom does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Moves by the equation of motion.
    Free,
    /// Keeps its initial velocity (the paper's V_const = 0).
    Frozen,
    /// Follows the log.
    Measured,
}

/// The constants of the equation of motion.
#[derive(Clone)]
pub struct Vehicle<T> {
    /// Mass and inertia.
    pub rigid_body: RigidBody<T>,
    /// Added mass.
    pub added_mass: AddedMass<T>,
    /// Damping.
    pub damping: Damping<T>,
    /// Cross-flow drag by strips.
    pub cross_flow: Option<CrossFlow<T>>,
    /// Drag and pull of a tether.
    pub tether: Option<Tether<T>>,
    /// Lift of hull and fixed fins.
    pub lift: Option<Lift<T>>,
    /// Weight and buoyancy.
    pub restoring: Restoring<T>,
    /// Constant wrench in the body frame.
    pub bias: Option<Vec6<T>>,
    /// Where the sea ends, if it is known; all is under water otherwise.
    pub surface: Option<Surface<T>>,
    /// Thrusters.
    pub actuators: Vec<Actuator<T>>,
    /// Movable fins, which follow the thrusters in the order of commands and signals.
    pub fins: Vec<Fin<T>>,
    /// `M = M_RB + M_A`.
    pub mass_matrix: Mat6<T>,
    /// Modes of the degrees of freedom.
    pub modes: [Mode; 6],
    inverse: Inverse<T>,
    replayed: bool,
}

/// `M⁻¹` on the free axes.
#[derive(Clone, Copy)]
enum Inverse<T> {
    Diagonal(Vec6<T>),
    Full(Mat6<T>),
}

/// What a vehicle is made of, each term by itself.
#[derive(Clone)]
pub struct Terms<T> {
    /// Mass and inertia.
    pub rigid_body: RigidBody<T>,
    /// Added mass.
    pub added_mass: AddedMass<T>,
    /// Damping.
    pub damping: Damping<T>,
    /// Cross-flow drag by strips; `None` where there is none and none is sought.
    pub cross_flow: Option<CrossFlow<T>>,
    /// Drag and pull of a tether; `None` where there is none and none is sought.
    pub tether: Option<Tether<T>>,
    /// Lift of hull and fixed fins; `None` where there is none and none is sought.
    pub lift: Option<Lift<T>>,
    /// Weight and buoyancy.
    pub restoring: Restoring<T>,
    /// Constant wrench in the body frame; `None` where there is none and none is sought.
    pub bias: Option<Vec6<T>>,
    /// Thrusters.
    pub actuators: Vec<Actuator<T>>,
    /// Movable fins.
    pub fins: Vec<Fin<T>>,
}

/// What acts on the vehicle at one instant.
#[derive(Clone)]
pub struct Instant<T> {
    /// Thrust of each thruster.
    pub thrusts: Vec<Thrust<T>>,
    /// Deflection of each fin.
    pub deflections: Vec<Deflection<T>>,
    /// Wrench from outside and of the thrusts that no inflow changes, once summed ([`Vehicle::sum_inflow_free`]).
    pub inflow_free: Option<Vec6<T>>,
    /// Wrench from outside the actuators, N and N m.
    pub tau: Vec6<f64>,
    /// Ocean current; `None` in still water.
    pub current: Option<Current<T>>,
    /// `ν` and `ν'` from the log, read on measured axes.
    pub measured: [Vec6<f64>; 2],
}

/// The end of a step is the start of the next one: hands on what the actuators do there.
#[inline(always)]
pub fn hand_on<T: Copy>(instants: &mut [Instant<T>; 3]) {
    let (first, rest) = instants.split_at_mut(1);
    std::mem::swap(&mut first[0].thrusts, &mut rest[1].thrusts);
    std::mem::swap(&mut first[0].deflections, &mut rest[1].deflections);
    first[0].inflow_free = rest[1].inflow_free;
}

impl<T> Default for Instant<T> {
    fn default() -> Self {
        Self {
            thrusts: Vec::new(),
            deflections: Vec::new(),
            inflow_free: None,
            tau: [0.0; 6],
            current: None,
            measured: [[0.0; 6]; 2],
        }
    }
}

/// The terms of the equation of motion, each as force on the vehicle, N and N m.
#[derive(Clone, Copy, Debug)]
pub struct Forces<T> {
    /// `−C_RB(ν) ν`.
    pub rigid_body: Vec6<T>,
    /// `−C_A(ν_r) ν_r + M_A ν_c'`.
    pub added_mass: Vec6<T>,
    /// `−D(ν_r) ν_r`, the cross-flow drag of the strips and the drag of the tether among it.
    pub damping: Vec6<T>,
    /// `τ_L(ν_r)`.
    pub lift: Vec6<T>,
    /// `−g(η) + τ_FK`.
    pub restoring: Vec6<T>,
}

/// Which terms of the equation of motion are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Summed {
    /// Thrusters and fins, and the wrench from outside.
    pub thrust: bool,
    /// Rigid body and added mass.
    pub mass: bool,
    /// Linear and quadratic damping.
    pub damping: bool,
    /// Cross-flow drag by strips.
    pub cross_flow: bool,
    /// Drag and pull of a tether.
    pub tether: bool,
    /// Lift of hull and fixed fins.
    pub lift: bool,
    /// Weight and buoyancy.
    pub restoring: bool,
    /// Constant wrench in the body frame.
    pub bias: bool,
}

impl Summed {
    /// All of them.
    pub(crate) const ALL: Self = Self {
        thrust: true,
        mass: true,
        damping: true,
        cross_flow: true,
        tether: true,
        lift: true,
        restoring: true,
        bias: true,
    };

    /// The terms of either.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            thrust: self.thrust || other.thrust,
            mass: self.mass || other.mass,
            damping: self.damping || other.damping,
            cross_flow: self.cross_flow || other.cross_flow,
            tether: self.tether || other.tether,
            lift: self.lift || other.lift,
            restoring: self.restoring || other.restoring,
            bias: self.bias || other.bias,
        }
    }
}

impl<T: Real> Vehicle<T> {
    /// The vehicle made of these terms: `M = M_RB + M_A`, factored once for the axes that are free.
    #[inline(always)]
    pub fn of(terms: Terms<T>, modes: [Mode; 6]) -> Self {
        let Terms {
            rigid_body,
            added_mass,
            damping,
            cross_flow,
            tether,
            lift,
            restoring,
            bias,
            actuators,
            fins,
        } = terms;
        let one = added_mass.matrix()[0][0].splat(1.0);
        let mass_matrix = mass(&rigid_body, &added_mass, one);
        let diagonal = is_diagonal(&rigid_body, &added_mass);
        Self {
            rigid_body,
            added_mass,
            damping,
            cross_flow,
            tether,
            lift,
            restoring,
            bias,
            surface: None,
            actuators,
            fins,
            mass_matrix,
            modes,
            inverse: inverse(diagonal, &mass_matrix, &modes.map(|mode| mode == Mode::Free)),
            replayed: modes.contains(&Mode::Measured),
        }
    }

    /// Adds a constant wrench in the body frame (N, N m) to the bias.
    #[inline(always)]
    pub fn push(&mut self, wrench: &Vec6<T>) {
        self.bias = Some(self.bias.map_or(*wrench, |bias| add(&bias, wrench)));
    }

    /// `ν'` at the rotation `r` (body → NED), the velocity `nu` and what acts at the instant; a tether pulls and a surface
    /// counts only where the position (NED, m) is told.
    #[inline(always)]
    pub fn acceleration(
        &self,
        (position, r): (Option<&Vec3<T>>, &Mat3<T>),
        nu: &Vec6<T>,
        instant: &Instant<T>,
    ) -> Vec6<T> {
        self.solve(&self.force(Summed::ALL, (position, r), nu, instant), &instant.measured[1])
    }

    /// The force of some terms where and when [`Vehicle::acceleration`] sums them all, N and N m.
    #[inline(always)]
    pub(crate) fn force(
        &self,
        of: Summed,
        (position, r): (Option<&Vec3<T>>, &Mat3<T>),
        nu: &Vec6<T>,
        instant: &Instant<T>,
    ) -> Vec6<T> {
        let mut f = match of.thrust {
            true => self.still_wrench(instant, nu[0].zero()),
            false => [nu[0].zero(); 6],
        };
        let mut nu_r = *nu;
        if let Some(current) = &instant.current {
            let relative = current.relative(r, nu);
            nu_r = relative.nu;
            if of.mass {
                f = add(&f, &self.added_mass.momentum(&relative.current_rate));
            }
            if let Some(pressed) = relative.pressed.as_ref().filter(|_| of.restoring) {
                f = self.restoring.add_pressure(pressed, &f);
            }
        }
        if of.thrust {
            f = self.inflow(instant, &nu_r, &f);
        }
        if of.mass {
            f = self.rigid_body.add_coriolis(nu, &f);
            f = self.added_mass.add_coriolis(&nu_r, &f);
        }
        if of.damping {
            f = self.damping.add(&nu_r, &f);
        }
        if let Some(cross_flow) = self.cross_flow.as_ref().filter(|_| of.cross_flow) {
            f = cross_flow.add(&nu_r, &f);
        }
        if let Some(tether) = self.tether.as_ref().filter(|_| of.tether) {
            f = tether.add((position, r), &nu_r, &f);
        }
        if let Some(lift) = self.lift.as_ref().filter(|_| of.lift) {
            f = lift.add(&nu_r, &f);
        }
        if of.restoring {
            f = self.restoring.add(r, &f);
        }
        if let Some(bias) = self.bias.as_ref().filter(|_| of.bias) {
            f = add(&f, bias);
        }
        match position {
            Some(position) if of == Summed::ALL => self.near_surface((position, r), nu, instant, &f),
            _ => f,
        }
    }

    /// `ν' = M⁻¹ f` on the free axes, zero on frozen and `nu_rate` on measured ones.
    #[inline(always)]
    pub(crate) fn solve(&self, f: &Vec6<T>, nu_rate: &Vec6<f64>) -> Vec6<T> {
        self.solved((&self.inverse, &self.mass_matrix), f, nu_rate)
    }

    /// The same where only a share of the added mass acts.
    #[inline(always)]
    pub(super) fn solve_with(&self, share: T, f: &Vec6<T>, nu_rate: &Vec6<f64>) -> Vec6<T> {
        let matrix = mass(&self.rigid_body, &self.added_mass, share);
        let diagonal = is_diagonal(&self.rigid_body, &self.added_mass);
        let inverse = inverse(diagonal, &matrix, &self.modes.map(|mode| mode == Mode::Free));
        self.solved((&inverse, &matrix), f, nu_rate)
    }

    #[inline(always)]
    fn solved(
        &self,
        (inverse, mass_matrix): (&Inverse<T>, &Mat6<T>),
        f: &Vec6<T>,
        nu_rate: &Vec6<f64>,
    ) -> Vec6<T> {
        if !self.replayed {
            return inverse.times(f);
        }
        let zero = f[0].zero();
        let mut given = [zero; 6];
        for i in 0..6 {
            if self.modes[i] == Mode::Measured {
                given[i] = zero.splat(nu_rate[i]);
            }
        }
        let share = product(mass_matrix, &given);
        let mut rest = *f;
        for i in 0..6 {
            rest[i] -= share[i];
        }
        add(&inverse.times(&rest), &given)
    }

    /// `M ν'`, N and N m.
    #[inline(always)]
    pub(crate) fn inertia(&self, rate: &Vec6<T>) -> Vec6<T> {
        match &self.inverse {
            Inverse::Full(_) => product(&self.mass_matrix, rate),
            Inverse::Diagonal(_) => {
                let mut inertia = *rate;
                for i in 0..6 {
                    inertia[i] = self.mass_matrix[i][i] * rate[i];
                }
                inertia
            }
        }
    }

    /// The motor or servo of actuator `i`, thrusters first.
    #[inline(always)]
    pub fn motor(&self, i: usize) -> &Motor<T> {
        match self.actuators.get(i) {
            Some(thruster) => &thruster.motor,
            None => &self.fins[i - self.actuators.len()].servo,
        }
    }

    /// The wrench of all actuators and from outside at the relative velocity `nu_r`, N and N m.
    #[inline(always)]
    pub fn wrench(&self, instant: &Instant<T>, nu_r: &Vec6<T>) -> Vec6<T> {
        self.inflow(instant, nu_r, &self.inflow_free(instant, nu_r[0].zero()))
    }

    /// Sums what no inflow changes: four stages read it, it is worth summing once.
    #[inline(always)]
    pub fn sum_inflow_free(&self, instant: &mut Instant<T>, zero: T) {
        instant.inflow_free = Some(self.inflow_free(instant, zero));
    }

    /// What [`Vehicle::sum_inflow_free`] sums, from there or anew.
    #[inline(always)]
    pub(super) fn still_wrench(&self, instant: &Instant<T>, zero: T) -> Vec6<T> {
        match &instant.inflow_free {
            Some(wrench) => *wrench,
            None => self.inflow_free(instant, zero),
        }
    }

    #[inline(always)]
    fn inflow_free(&self, instant: &Instant<T>, zero: T) -> Vec6<T> {
        let mut sum = [zero; 6];
        for i in 0..6 {
            sum[i] = zero.splat(instant.tau[i]);
        }
        for i in 0..instant.thrusts.len() {
            let (actuator, thrust) = (&self.actuators[i], &instant.thrusts[i]);
            if !actuator.characteristic.has_inflow() {
                sum = actuator.add(thrust.force, thrust.torque, &sum);
            }
        }
        sum
    }

    /// `tau` + wrench of the fins and of the thrusts that the inflow changes.
    #[inline(always)]
    fn inflow(&self, instant: &Instant<T>, nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        for i in 0..instant.deflections.len() {
            sum = self.fins[i].add(instant.deflections[i], nu_r, &sum);
        }
        for i in 0..instant.thrusts.len() {
            let (actuator, thrust) = (&self.actuators[i], &instant.thrusts[i]);
            if actuator.characteristic.has_inflow() {
                let u_a = dot(&actuator.inflow, nu_r);
                let force = thrust.force_per_inflow.mul_add(u_a, thrust.force);
                sum = actuator.add(force, thrust.torque_per_inflow.mul_add(u_a, thrust.torque), &sum);
            }
        }
        sum
    }

    /// Every term by itself, at the rotation `r`, without thrust, bias and the pull of a tether.
    pub fn forces(&self, r: &Mat3<T>, nu: &Vec6<T>, current: Option<&Current<T>>) -> Forces<T> {
        let none = [nu[0].zero(); 6];
        let still = Relative { nu: *nu, current_rate: none, pressed: None };
        let Relative { nu: nu_r, current_rate, pressed } =
            current.map_or(still, |current| current.relative(r, nu));
        Forces {
            rigid_body: self.rigid_body.add_coriolis(nu, &none),
            added_mass: self.added_mass.add_coriolis(&nu_r, &self.added_mass.momentum(&current_rate)),
            damping: self.damping.add(&nu_r, &{
                let strips = self.cross_flow.map_or(none, |drag| drag.add(&nu_r, &none));
                self.tether.map_or(strips, |tether| tether.add((None, r), &nu_r, &strips))
            }),
            lift: self.lift.map_or(none, |lift| lift.add(&nu_r, &none)),
            restoring: self
                .restoring
                .add(r, &pressed.map_or(none, |a| self.restoring.add_pressure(&a, &none))),
        }
    }
}

impl Vehicle<f64> {
    /// `M⁻¹ f` on the free axes, of a force in any number type.
    #[inline(always)]
    pub(crate) fn accelerated<P: Real>(&self, f: &Vec6<P>) -> Vec6<P> {
        let mut rate = [f[0].zero(); 6];
        match &self.inverse {
            Inverse::Diagonal(d) => {
                for i in 0..6 {
                    rate[i] = f[i] * d[i];
                }
            }
            Inverse::Full(matrix) => {
                for i in 0..6 {
                    if self.modes[i] == Mode::Free {
                        for j in 0..6 {
                            rate[i] = f[j].mul_add(f[j].splat(matrix[i][j]), rate[i]);
                        }
                    }
                }
            }
        }
        rate
    }
}

/// `M_RB` + a share of `M_A`.
#[inline(always)]
fn mass<T: Real>(rigid_body: &RigidBody<T>, added_mass: &AddedMass<T>, share: T) -> Mat6<T> {
    let (mut matrix, added) = (rigid_body.mass_matrix(), added_mass.matrix());
    for i in 0..6 {
        for j in 0..6 {
            matrix[i][j] += added[i][j] * share;
        }
    }
    matrix
}

/// Whether `M` is diagonal for these.
#[inline(always)]
fn is_diagonal<T>(rigid_body: &RigidBody<T>, added_mass: &AddedMass<T>) -> bool {
    matches!((rigid_body, added_mass), (RigidBody::Principal { .. }, AddedMass::Diagonal(_)))
}

/// `M⁻¹` on the free axes.
#[inline(always)]
fn inverse<T: Real>(diagonal: bool, m: &Mat6<T>, free: &[bool; 6]) -> Inverse<T> {
    if !diagonal {
        return Inverse::Full(restricted_inverse(m, free));
    }
    let (zero, one) = (m[0][0].zero(), m[0][0].splat(1.0));
    let mut d = [zero; 6];
    for i in 0..6 {
        if free[i] {
            // As the Cholesky factors do: no number where the mass is not positive.
            d[i] = one / (m[i][i].sqrt() * m[i][i].sqrt());
        }
    }
    Inverse::Diagonal(d)
}

impl<T: Real> Inverse<T> {
    #[inline(always)]
    fn times(&self, f: &Vec6<T>) -> Vec6<T> {
        match self {
            Self::Full(matrix) => product(matrix, f),
            Self::Diagonal(d) => {
                let mut x = *f;
                for i in 0..6 {
                    x[i] = d[i] * f[i];
                }
                x
            }
        }
    }
}

#[inline(always)]
fn add<T: Real>(a: &Vec6<T>, b: &Vec6<T>) -> Vec6<T> {
    let mut sum = *a;
    for i in 0..6 {
        sum[i] += b[i];
    }
    sum
}
