//! The equation of motion, for one number type:
//!
//! `(M_RB + M_A) ν' = τ − C_RB(ν) ν − C_A(ν_r) ν_r − D(ν_r) ν_r + τ_L(ν_r) − g(η) + M_A ν_c'`
//!
//! Each term has its own file. A degree of freedom is free, frozen (keeps its velocity) or measured
//! (replayed from a log); `M` is factored once for the free ones, so that
//! `ν'_F = M_FF⁻¹ (f_F − M_FC ν'_C)`: nothing leaks from a locked axis, and no added mass is ever lagged.
//!
//! Source: Fossen (2011), equation 7.9 with 8.3; Taubert et al. (2014), equation 6, corrected.
//! Tests: `tests/laws.rs`, `tests/golden.rs`, `tests/test_scalar_textbook.py`.

use crate::actuator::Actuator;
use crate::actuator::characteristic::{Characteristic, Shape, Thrust};
use crate::actuator::motor::Motor;
use crate::added_mass::AddedMass;
use crate::algebra::{Mat3, Mat6, Vec6, dot, product, restricted_inverse};
use crate::coefficients::{self as names, added_mass, linear, quadratic};
use crate::current::Current;
use crate::damping::Damping;
use crate::description::Description;
use crate::lift::Lift;
use crate::real::Real;
use crate::restoring::Restoring;
use crate::rigid_body::RigidBody;
use crate::vehicle_file::Environment;

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

/// Which terms are there: zero ones are left out, unless a coefficient of theirs is sought.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Structure {
    general_body: bool,
    full_added_mass: bool,
    full_damping: bool,
    lift: bool,
    bias: bool,
    inflow: Vec<bool>,
    torque: Vec<bool>,
}

impl Structure {
    /// The terms of a vehicle when the coefficients at the indices `sought` may differ from its own.
    pub fn new(description: &Description, sought: &[usize]) -> Self {
        let present = |i: usize| description.coefficients[i] != 0.0 || sought.contains(&i);
        let off_diagonal = |index: &dyn Fn(usize, usize) -> usize| {
            (0..6).any(|i| (0..6).any(|j| i != j && present(index(i, j))))
        };
        let actuators = 0..description.actuators.len();
        let any =
            |k: usize, offsets: &[usize]| offsets.iter().any(|o| present(description.layout.actuator(k) + o));
        let products = (names::INERTIA + 3)..names::CENTRE_OF_GRAVITY;
        let arms = names::CENTRE_OF_GRAVITY..names::CENTRE_OF_BUOYANCY;
        Self {
            general_body: products.chain(arms).any(present),
            full_added_mass: off_diagonal(&added_mass),
            full_damping: off_diagonal(&linear) || off_diagonal(&quadratic),
            lift: (names::LIFT..names::BIAS).any(present),
            bias: (names::BIAS..names::HULL).any(present),
            inflow: actuators.clone().map(|k| any(k, &[3, 7])).collect(),
            torque: actuators.map(|k| any(k, &[6, 7])).collect(),
        }
    }
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
    /// Lift of hull and fixed fins.
    pub lift: Option<Lift<T>>,
    /// Weight and buoyancy.
    pub restoring: Restoring<T>,
    /// Constant wrench in the body frame.
    pub bias: Option<Vec6<T>>,
    /// Thrusters.
    pub actuators: Vec<Actuator<T>>,
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

/// What acts on the vehicle at one instant.
#[derive(Clone)]
pub struct Instant<T> {
    /// Thrust of each actuator.
    pub thrusts: Vec<Thrust<T>>,
    /// Wrench of the thrusts that no inflow changes, once it is summed ([`Vehicle::settle`]).
    pub settled: Option<Vec6<T>>,
    /// Wrench from outside the actuators, N and N m.
    pub tau: Vec6<f64>,
    /// Ocean current; `None` in still water.
    pub current: Option<Current>,
    /// `ν` and `ν'` from the log, read on measured axes.
    pub measured: [Vec6<f64>; 2],
}

impl<T> Default for Instant<T> {
    fn default() -> Self {
        Self { thrusts: Vec::new(), settled: None, tau: [0.0; 6], current: None, measured: [[0.0; 6]; 2] }
    }
}

/// The terms of the equation of motion, each as force on the vehicle, N and N m.
#[derive(Clone, Copy, Debug)]
pub struct Forces<T> {
    /// `−C_RB(ν) ν`.
    pub rigid_body: Vec6<T>,
    /// `−C_A(ν_r) ν_r + M_A ν_c'`.
    pub added_mass: Vec6<T>,
    /// `−D(ν_r) ν_r`.
    pub damping: Vec6<T>,
    /// `τ_L(ν_r)`.
    pub lift: Vec6<T>,
    /// `−g(η)`.
    pub restoring: Vec6<T>,
}

impl Vehicle<f64> {
    /// A described vehicle with its own coefficients, in its own environment, free in all axes.
    pub fn nominal(description: &Description) -> Self {
        let structure = Structure::new(description, &[]);
        Self::new(
            description,
            &structure,
            &description.coefficients,
            description.file.environment,
            [Mode::Free; 6],
        )
    }
}

impl<T: Real> Vehicle<T> {
    /// The constants for the coefficients `values` (of the description's layout, for its reference
    /// density and gravity) in an environment.
    #[inline(always)]
    pub fn new(
        description: &Description,
        structure: &Structure,
        values: &[T],
        environment: Environment,
        modes: [Mode; 6],
    ) -> Self {
        let Environment { rho_kg_m3: rho, g_m_s2: g } = environment;
        let zero = values[0].zero();
        let c = |i: usize| values[i] * description.environment_factor(i, rho, g);
        let matrix = |index: &dyn Fn(usize, usize) -> usize, sign: f64| {
            let mut matrix = [[zero; 6]; 6];
            for i in 0..6 {
                for j in 0..6 {
                    matrix[i][j] = c(index(i, j)) * sign;
                }
            }
            matrix
        };
        let diagonal = |index: &dyn Fn(usize, usize) -> usize, sign: f64| {
            let mut diagonal = [zero; 6];
            for i in 0..6 {
                diagonal[i] = c(index(i, i)) * sign;
            }
            diagonal
        };
        let mass = c(names::MASS);
        let at = |first: usize| [c(first), c(first + 1), c(first + 2)];
        let mut inertia = [zero; 6];
        for i in 0..6 {
            inertia[i] = c(names::INERTIA + i);
        }
        let r_g = at(names::CENTRE_OF_GRAVITY);
        let rigid_body = if structure.general_body {
            RigidBody::new(mass, r_g, inertia)
        } else {
            RigidBody::Principal { m: mass, i_o: [inertia[0], inertia[1], inertia[2]] }
        };
        let added = if structure.full_added_mass {
            AddedMass::Full(matrix(&added_mass, -1.0))
        } else {
            AddedMass::Diagonal(diagonal(&added_mass, -1.0))
        };
        let damping = if structure.full_damping {
            Damping::Full { linear: matrix(&linear, 1.0), quadratic: matrix(&quadratic, 1.0) }
        } else {
            Damping::Diagonal { linear: diagonal(&linear, 1.0), quadratic: diagonal(&quadratic, 1.0) }
        };
        let restoring = Restoring::new(mass * g, r_g, c(names::BUOYANCY), at(names::CENTRE_OF_BUOYANCY));
        let mut mass_matrix = added.matrix();
        let rigid = rigid_body.mass_matrix();
        for i in 0..6 {
            for j in 0..6 {
                mass_matrix[i][j] += rigid[i][j];
            }
        }
        let mut lift = [zero; 8];
        for i in 0..8 {
            lift[i] = c(names::LIFT + i);
        }
        let mut bias = [zero; 6];
        for i in 0..6 {
            bias[i] = c(names::BIAS + i);
        }
        let mut actuators = Vec::with_capacity(description.actuators.len());
        for k in 0..description.actuators.len() {
            let base = description.layout.actuator(k);
            let density = rho / description.file.environment.rho_kg_m3;
            actuators.push(actuator(description, structure, k, |i| c(base + i), density));
        }
        Self {
            rigid_body,
            added_mass: added,
            damping,
            lift: structure.lift.then_some(Lift(lift)),
            restoring,
            bias: structure.bias.then_some(bias),
            actuators,
            mass_matrix,
            modes,
            inverse: inverse(structure, &mass_matrix, &modes.map(|mode| mode == Mode::Free)),
            replayed: modes.contains(&Mode::Measured),
        }
    }

    /// `ν'` at the rotation `r` (body → NED), the velocity `nu` and what acts at the instant.
    #[inline(always)]
    pub fn acceleration(&self, r: &Mat3<T>, nu: &Vec6<T>, instant: &Instant<T>) -> Vec6<T> {
        let mut f = match &instant.settled {
            Some(wrench) => *wrench,
            None => self.settled(instant, nu[0].zero()),
        };
        let mut nu_r = *nu;
        if let Some(current) = &instant.current {
            let (relative, nu_c_rate) = current.relative(r, nu);
            nu_r = relative;
            f = add(&f, &self.added_mass.momentum(&nu_c_rate));
        }
        f = self.inflow(&instant.thrusts, &nu_r, &f);
        f = self.rigid_body.add_coriolis(nu, &f);
        f = self.added_mass.add_coriolis(&nu_r, &f);
        f = self.damping.add(&nu_r, &f);
        if let Some(lift) = &self.lift {
            f = lift.add(&nu_r, &f);
        }
        f = self.restoring.add(r, &f);
        if let Some(bias) = &self.bias {
            f = add(&f, bias);
        }
        self.solve(&f, &instant.measured[1])
    }

    /// `ν' = M⁻¹ f` on the free axes, zero on frozen and `nu_rate` on measured ones.
    #[inline(always)]
    fn solve(&self, f: &Vec6<T>, nu_rate: &Vec6<f64>) -> Vec6<T> {
        if !self.replayed {
            return self.inverse.times(f);
        }
        let zero = f[0].zero();
        let mut given = [zero; 6];
        for i in 0..6 {
            if self.modes[i] == Mode::Measured {
                given[i] = zero.splat(nu_rate[i]);
            }
        }
        let share = product(&self.mass_matrix, &given);
        let mut rest = *f;
        for i in 0..6 {
            rest[i] -= share[i];
        }
        add(&self.inverse.times(&rest), &given)
    }

    /// The wrench of all thrusts and from outside at the relative velocity `nu_r`, N and N m.
    #[inline(always)]
    pub fn wrench(&self, instant: &Instant<T>, nu_r: &Vec6<T>) -> Vec6<T> {
        self.inflow(&instant.thrusts, nu_r, &self.settled(instant, nu_r[0].zero()))
    }

    /// Sums what no inflow changes: four stages read it, it is worth summing once.
    #[inline(always)]
    pub fn settle(&self, instant: &mut Instant<T>, zero: T) {
        instant.settled = Some(self.settled(instant, zero));
    }

    #[inline(always)]
    fn settled(&self, instant: &Instant<T>, zero: T) -> Vec6<T> {
        let mut sum = [zero; 6];
        for i in 0..6 {
            sum[i] = zero.splat(instant.tau[i]);
        }
        for (actuator, thrust) in self.actuators.iter().zip(&instant.thrusts) {
            if !actuator.characteristic.has_inflow() {
                sum = actuator.add(thrust.force, thrust.torque, &sum);
            }
        }
        sum
    }

    /// `tau` + wrench of the thrusts that the inflow changes.
    #[inline(always)]
    fn inflow(&self, thrusts: &[Thrust<T>], nu_r: &Vec6<T>, tau: &Vec6<T>) -> Vec6<T> {
        let mut sum = *tau;
        for (actuator, thrust) in self.actuators.iter().zip(thrusts) {
            if actuator.characteristic.has_inflow() {
                let u_a = dot(&actuator.inflow, nu_r);
                let force = thrust.force_per_inflow.mul_add(u_a, thrust.force);
                sum = actuator.add(force, thrust.torque_per_inflow.mul_add(u_a, thrust.torque), &sum);
            }
        }
        sum
    }

    /// Every term by itself, at the rotation `r`, without thrust and bias.
    pub fn forces(&self, r: &Mat3<T>, nu: &Vec6<T>, current: Option<&Current>) -> Forces<T> {
        let none = [nu[0].zero(); 6];
        let (nu_r, nu_c_rate) = current.map_or((*nu, none), |current| current.relative(r, nu));
        Forces {
            rigid_body: self.rigid_body.add_coriolis(nu, &none),
            added_mass: self.added_mass.add_coriolis(&nu_r, &self.added_mass.momentum(&nu_c_rate)),
            damping: self.damping.add(&nu_r, &none),
            lift: self.lift.map_or(none, |lift| lift.add(&nu_r, &none)),
            restoring: self.restoring.add(r, &none),
        }
    }
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

/// `M⁻¹` on the free axes; diagonal where body and added mass are.
#[inline(always)]
fn inverse<T: Real>(structure: &Structure, m: &Mat6<T>, free: &[bool; 6]) -> Inverse<T> {
    if structure.general_body || structure.full_added_mass {
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

#[inline(always)]
fn add<T: Real>(a: &Vec6<T>, b: &Vec6<T>) -> Vec6<T> {
    let mut sum = *a;
    for i in 0..6 {
        sum[i] += b[i];
    }
    sum
}

/// The constants of actuator `k`; `c` reads its coefficients by their offset.
#[inline(always)]
fn actuator<T: Real>(
    description: &Description,
    structure: &Structure,
    k: usize,
    c: impl Fn(usize) -> T,
    density: f64,
) -> Actuator<T> {
    let one = c(0).splat(1.0);
    let described = &description.actuators[k];
    let splat = |x: f64| one.splat(x);
    let [dx, dy, dz] = described.direction;
    // By virtual power the inflow along the thrust is the unit-force wrench times ν_r.
    let length = crate::algebra::dot(
        &described.direction,
        &[described.wrench[0], described.wrench[1], described.wrench[2]],
    );
    let inflow = described.wrench.map(|x| splat(if length > 0.0 { x / length } else { 0.0 }));
    let inside = one - c(4);
    // Thrust deduction is a pressure on the hull: the propeller's torque does not feel it.
    let (gain, deduction) = (c(0), one - c(5));
    let factor = gain * deduction;
    use crate::vehicle_file::CharacteristicTable as Kind;
    let (shape, factor) = match (&described.characteristic, &described.table) {
        (Kind::Quadratic(_), _) => (
            Shape::Quadratic {
                p1: [c(1) * deduction, c(2) * deduction],
                p2: c(3) * inside * deduction,
                q1: c(6),
                q2: c(7) * inside,
                inflow: structure.inflow[k],
            },
            gain,
        ),
        (Kind::Polynomial { .. }, _) => {
            (Shape::Polynomial([[c(8), c(9), c(10)], [c(11), c(12), c(13)]]), factor)
        }
        (_, Some(table)) => (Shape::Table(table.clone()), factor * density),
        _ => (Shape::Direct, factor),
    };
    Actuator {
        motor: Motor {
            k_v: c(14),
            t_1: c(15),
            t_t: c(16),
            rate: described.rate_limited.then(|| [c(17), c(18)]),
        },
        characteristic: Characteristic { shape, factor },
        wrench: described.wrench.map(splat),
        torque: structure.torque[k].then(|| [0.0, 0.0, 0.0, dx, dy, dz].map(splat)),
        inflow,
    }
}
