//! From a description to the constants of the equation of motion, for one number type, set of
//! coefficients, environment and modes of the axes.
//!
//! Terms that are zero and not sought are left out, once, here: the hot loop only looks whether a term
//! is there.

use super::placement::{ActuatorDescription, Effect};
use super::values::Description;
use crate::actuator::Actuator;
use crate::actuator::characteristic::{Characteristic, FlowTerms, Shape, Table};
use crate::actuator::fin::Fin;
use crate::actuator::motor::Motor;
use crate::description::coefficients::{self as names, added_mass, linear, quadratic};
use crate::description::vehicle_file::{CharacteristicTable as Kind, Environment, FinTable};
use crate::model::added_mass::AddedMass;
use crate::model::cross_flow::CrossFlow;
use crate::model::damping::Damping;
use crate::model::lift::Lift;
use crate::model::restoring::Restoring;
use crate::model::rigid_body::RigidBody;
use crate::model::tether::{Spring, Tether};
use crate::model::vehicle::{Mode, Terms, Vehicle};
use crate::number::real::Real;
use std::sync::Arc;

/// Which terms are there: zero ones are left out, unless a coefficient of theirs is sought.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Structure {
    general_body: bool,
    full_added_mass: bool,
    full_damping: bool,
    lift: bool,
    cross_flow: bool,
    tether: bool,
    spring: bool,
    bias: bool,
    inflow: Vec<bool>,
    torque: Vec<bool>,
    lag: Vec<bool>,
    astern_ratio: Vec<bool>,
    loss: Vec<bool>,
    offset: Vec<bool>,
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
            cross_flow: (names::CROSS_FLOW..names::TETHER).any(present),
            tether: (names::TETHER..names::HULL).any(present),
            spring: present(names::STIFFNESS),
            bias: (names::BIAS..names::CROSS_FLOW).any(present),
            inflow: actuators.clone().map(|k| any(k, &[3, 7])).collect(),
            torque: actuators.clone().map(|k| any(k, &[6, 7])).collect(),
            lag: actuators.clone().map(|k| any(k, &[15])).collect(),
            astern_ratio: actuators
                .clone()
                .map(|k| description.layout.actuator(k) + names::ASTERN_RATIO)
                .map(|i| description.coefficients[i] != 1.0 || sought.contains(&i))
                .collect(),
            loss: actuators.clone().map(|k| any(k, &[names::LOSS])).collect(),
            offset: actuators.map(|k| any(k, &[names::FIN + 5])).collect(),
        }
    }
}

impl Vehicle<f64> {
    /// A described vehicle with its own coefficients, in its own environment, free in all axes.
    pub fn nominal(description: &Description) -> Self {
        Self::nominal_in(description, 0.0)
    }
}

impl<T: Real> Vehicle<T> {
    /// The [`nominal`](Vehicle::nominal) vehicle in the kind of `unit`.
    pub fn nominal_in(description: &Description, unit: T) -> Self {
        let structure = Structure::new(description, &[]);
        let values: Vec<T> = description.coefficients.iter().map(|&x| unit.splat(x)).collect();
        Self::new(description, &structure, &values, description.file.environment, [Mode::Free; 6])
    }

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
        let restoring =
            Restoring::new((mass * g, r_g), (c(names::BUOYANCY), at(names::CENTRE_OF_BUOYANCY)), g);
        let mut lift = [zero; 8];
        for i in 0..8 {
            lift[i] = c(names::LIFT + i);
        }
        let mut bias = [zero; 6];
        for i in 0..6 {
            bias[i] = c(names::BIAS + i);
        }
        let pressure = [c(names::CROSS_FLOW), c(names::CROSS_FLOW + 1)].map(|c_d| c_d * (0.5 * rho));
        let mut actuators = Vec::with_capacity(description.file.thrusters.len());
        let mut fins = Vec::with_capacity(description.file.fins.len());
        for (k, described) in description.actuators.iter().enumerate() {
            let base = description.layout.actuator(k);
            let density = rho / description.file.environment.rho_kg_m3;
            match &described.effect {
                Effect::Thrust(characteristic, table) => {
                    let shape = (characteristic, table.as_ref());
                    actuators.push(actuator(description, structure, k, shape, |i| c(base + i), density));
                }
                Effect::Fin(table) => fins.push(fin(structure, k, described, table, |i| c(base + i), rho)),
            }
        }
        let tether = description.file.tether.as_ref().filter(|_| structure.tether).map(|table| {
            let stiffness = c(names::STIFFNESS);
            let spring = table.spring().filter(|_| structure.spring);
            Tether {
                place: table.position_m,
                drag: c(names::TETHER) * (0.5 * rho),
                spring: spring.map(|(anchor, slack)| Spring { stiffness, anchor, slack }),
            }
        });
        let terms = Terms {
            rigid_body,
            added_mass: added,
            damping,
            cross_flow: description
                .strips
                .filter(|_| structure.cross_flow)
                .map(|strips| CrossFlow { strips, pressure }),
            tether,
            lift: structure.lift.then_some(Lift(lift)),
            restoring,
            bias: structure.bias.then_some(bias),
            actuators,
            fins,
        };
        Self::of(terms, modes)
    }
}

/// The constants of actuator `k`; `c` reads its coefficients by their offset.
#[inline(always)]
fn actuator<T: Real>(
    description: &Description,
    structure: &Structure,
    k: usize,
    (characteristic, table): (&Kind, Option<&Arc<Table>>),
    c: impl Fn(usize) -> T,
    density: f64,
) -> Actuator<T> {
    let one = c(0).splat(1.0);
    let described = &description.actuators[k];
    let splat = |x: f64| one.splat(x);
    let [dx, dy, dz] = described.direction;
    // By virtual power the inflow along the thrust is the unit-force wrench times ν_r.
    let length = crate::number::algebra::dot(
        &described.direction,
        &[described.wrench[0], described.wrench[1], described.wrench[2]],
    );
    let mut wrench = described.wrench.map(splat);
    for i in 0..3 {
        wrench[3 + i] = c(names::LEVERS + i);
    }
    let inflow = wrench.map(|x| x * if length > 0.0 { 1.0 / length } else { 0.0 });
    let inside = one - c(4);
    // Thrust deduction is a pressure on the hull: the propeller's torque does not feel it.
    let (gain, deduction) = (c(0), one - c(5));
    let factor = gain * deduction;
    let flow = FlowTerms {
        p2: c(3) * inside * deduction,
        torque: structure.torque[k].then(|| [c(6), c(7) * inside]),
        inflow: structure.inflow[k],
    };
    let (shape, factor) = match (characteristic, table) {
        (Kind::Quadratic(_), _) => {
            (Shape::Quadratic { p1: [c(1) * deduction, c(2) * deduction], flow }, gain)
        }
        (Kind::Polynomial(_), _) => (
            Shape::Polynomial {
                ahead: [c(8) * deduction, c(9) * deduction, c(10) * deduction],
                astern: [c(11) * deduction, c(12) * deduction, c(13) * deduction],
                flow,
            },
            gain,
        ),
        (_, Some(table)) => (Shape::Table(table.clone()), factor * density),
        _ => (Shape::Direct, factor),
    };
    Actuator {
        motor: motor(structure, k, described, &c),
        characteristic: Characteristic { shape, factor },
        wrench,
        torque: structure.torque[k].then(|| [0.0, 0.0, 0.0, dx, dy, dz].map(splat)),
        inflow,
        astern_ratio: structure.astern_ratio[k].then(|| c(names::ASTERN_RATIO)),
        loss: structure.loss[k].then(|| c(names::LOSS)),
        group: description.group(k),
    }
}

/// The motor of actuator `k`.
#[inline(always)]
fn motor<T: Real>(
    structure: &Structure,
    k: usize,
    described: &ActuatorDescription,
    c: impl Fn(usize) -> T,
) -> Motor<T> {
    Motor {
        k_v: c(14),
        t_1: c(15),
        t_t: c(16),
        rate: described.rate_limited.then(|| [c(17), c(18)]),
        ideal: !(described.rate_limited || structure.lag[k]),
    }
}

/// The constants of fin `k`; `c` reads its coefficients by their offset.
#[inline(always)]
fn fin<T: Real>(
    structure: &Structure,
    k: usize,
    described: &ActuatorDescription,
    table: &FinTable,
    c: impl Fn(usize) -> T,
    rho: f64,
) -> Fin<T> {
    let length = crate::number::algebra::dot(&table.chord, &table.chord).sqrt();
    Fin {
        servo: motor(structure, k, described, &c),
        chord: table.chord.map(|x| x / length),
        normal: described.direction,
        place: table.position_m,
        half_rho_area: c(0) * (0.5 * rho * table.area_m2),
        c_la: c(names::FIN),
        c_lmax: c(names::FIN + 1),
        c_d0: c(names::FIN + 2),
        c_d90: c(names::FIN + 3),
        k_i: c(names::FIN + 4),
        offset: structure.offset[k].then(|| c(names::FIN + 5)),
    }
}
