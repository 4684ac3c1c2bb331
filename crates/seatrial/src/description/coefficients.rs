//! The coefficients of a vehicle: flat names, SI, Fossen's signs.
//!
//! | names | meaning |
//! |---|---|
//! | `m`, `I_x I_y I_z I_xy I_xz I_yz`, `x_g y_g z_g`, `x_b y_b z_b`, `B` | rigid body about O, buoyancy |
//! | `X_udot` … `N_rdot`, every off-diagonal `Y_rdot` = `N_vdot` … | added mass (negative on the diagonal) |
//! | `X_u` … `N_r`, every off-diagonal `Y_r` … | linear damping |
//! | `X_uu` … `N_rr`, every off-diagonal `Y_rr` … | quadratic damping, per `|ν_j| ν_j` |
//! | `C_Dy C_Dz` | cross-flow drag of the strips sideways and downwards, positive |
//! | `A_tether k_tether` | drag area and stiffness of a tether, positive |
//! | `Y_uv Y_ur Z_uw Z_uq M_uw M_uq N_uv N_ur` | lift, per `|u| ν_j` |
//! | `Y_uu Z_uu K_uu M_uu N_uu` | among them: trims of an asymmetric hull, nothing at rest |
//! | `X_0` … `N_0` | constant bias wrench in the body frame, also at rest |
//! | `<actuator>.gain`, `.p1_ahead`, `.T_1` … | [`ACTUATOR`] |
//!
//! They stand in one vector, whose layout depends on the actuators' names only. Absent means zero.

use crate::error::nearest;

/// Names of the forces and moments.
pub const FORCES: [&str; 6] = ["X", "Y", "Z", "K", "M", "N"];
/// Names of the velocities.
pub const VELOCITIES: [&str; 6] = ["u", "v", "w", "p", "q", "r"];
/// Names of the lift coefficients, in the order of [`crate::model::lift::Lift`].
pub const LIFT_NAMES: [&str; 8] = ["Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur"];

/// Index of the mass.
pub const MASS: usize = 0;
/// Index of `I_x`; five more follow.
pub const INERTIA: usize = 1;
/// Index of `x_g`; two more follow.
pub const CENTRE_OF_GRAVITY: usize = 7;
/// Index of `x_b`; two more follow.
pub const CENTRE_OF_BUOYANCY: usize = 10;
/// Index of the buoyancy.
pub const BUOYANCY: usize = 13;
/// Index of `X_udot`; the upper triangle of the added mass follows.
pub const ADDED_MASS: usize = 14;
/// Index of `X_u`; the linear damping follows.
pub const LINEAR: usize = 35;
const QUADRATIC: usize = 71;
/// Index of `Y_uv`; seven more follow.
pub const LIFT: usize = 107;
/// Index of `X_0`; five more follow.
pub const BIAS: usize = 115;
/// Index of `C_Dy`; `C_Dz` follows.
pub const CROSS_FLOW: usize = 121;
/// Index of `A_tether`.
pub const TETHER: usize = 123;
/// Index of `k_tether`.
pub const STIFFNESS: usize = 124;
/// Number of coefficients of the hull; the actuators' follow.
pub const HULL: usize = 125;

const RIGID: [(&str, &str, &str); 14] = [
    ("m", "kg", "mass"),
    ("I_x", "kg m2", "moment of inertia about O, roll"),
    ("I_y", "kg m2", "moment of inertia about O, pitch"),
    ("I_z", "kg m2", "moment of inertia about O, yaw"),
    ("I_xy", "kg m2", "product of inertia, integral of x y dm"),
    ("I_xz", "kg m2", "product of inertia, integral of x z dm"),
    ("I_yz", "kg m2", "product of inertia, integral of y z dm"),
    ("x_g", "m", "centre of gravity, forward of O"),
    ("y_g", "m", "centre of gravity, to starboard of O"),
    ("z_g", "m", "centre of gravity, below O"),
    ("x_b", "m", "centre of buoyancy, forward of O"),
    ("y_b", "m", "centre of buoyancy, to starboard of O"),
    ("z_b", "m", "centre of buoyancy, below O"),
    ("B", "N", "buoyancy"),
];

const OF_STRIPS: [(&str, &str); 2] = [
    ("C_Dy", "cross-flow drag coefficient of the strips seen from the side, sway and yaw"),
    ("C_Dz", "cross-flow drag coefficient of the strips seen from above, heave and pitch"),
];

const OF_TETHER: [(&str, &str, &str); 2] = [
    ("A_tether", "m2", "drag area of the tether: drag coefficient times the area that is dragged along"),
    ("k_tether", "N/m", "stiffness of the tether beyond its slack length"),
];

/// Coefficients of an actuator: name, unit, meaning. `<c>` is the command's unit. The last six are a fin's.
pub const ACTUATOR: [(&str, &str, &str); 30] = [
    ("gain", "1", "factor on the thrust, of a fin on lift and drag"),
    ("p1_ahead", "N s2", "thrust per |n| n ahead, n in rev/s"),
    ("p1_astern", "N s2", "thrust per |n| n astern, n in rev/s"),
    ("p2", "N s2/m", "thrust per |n| V_a"),
    ("w", "1", "wake fraction, V_a = (1 - w) u_a"),
    ("t", "1", "thrust deduction fraction"),
    ("q1", "N m s2", "reaction torque per |n| n"),
    ("q2", "N s2", "reaction torque per |n| V_a"),
    ("a0_ahead", "N", "second-order regression ahead, constant"),
    ("a1_ahead", "N/<c>", "second-order regression ahead, linear"),
    ("a11_ahead", "N/<c>2", "second-order regression ahead, quadratic"),
    ("a0_astern", "N", "second-order regression astern, constant"),
    ("a1_astern", "N/<c>", "second-order regression astern, linear"),
    ("a11_astern", "N/<c>2", "second-order regression astern, quadratic"),
    ("K_V", "1", "static gain of the motor's lag"),
    ("T_1", "s", "time constant of the motor's lag"),
    ("T_t", "s", "dead time"),
    ("n_acc", "<c>/s", "rate limit while the magnitude grows"),
    ("n_dec", "<c>/s", "rate limit while the magnitude shrinks"),
    ("lever_K", "m", "roll moment about O per newton of thrust"),
    ("lever_M", "m", "pitch moment about O per newton of thrust"),
    ("lever_N", "m", "yaw moment about O per newton of thrust"),
    ("astern_ratio", "1", "further factor on the thrust astern"),
    ("loss", "1/N", "share of the thrust lost per newton of the other groups' thrust"),
    ("C_La", "1/rad", "slope of the fin's lift coefficient"),
    ("C_Lmax", "1", "largest lift coefficient of the fin"),
    ("C_D0", "1", "drag coefficient of the fin in line with the flow"),
    ("C_D90", "1", "further drag coefficient of the fin across the flow"),
    ("k_i", "1", "induced drag of the fin per squared lift coefficient, 1/(pi e aspect ratio)"),
    ("offset", "rad", "deflection of the fin where its servo stands at zero"),
];

/// Offset of `lever_K` in [`ACTUATOR`]; two more follow.
pub const LEVERS: usize = 19;

/// Offset of `astern_ratio` in [`ACTUATOR`].
pub const ASTERN_RATIO: usize = 22;

/// Offset of `loss` in [`ACTUATOR`].
pub const LOSS: usize = 23;

/// Offset of `C_La` in [`ACTUATOR`]; five more follow.
pub const FIN: usize = 24;

/// Number of coefficients per actuator.
pub const PER_ACTUATOR: usize = ACTUATOR.len();

/// Index of `M_A,ij`'s derivative (the matrix is symmetric: `ij` and `ji` share it).
pub const fn added_mass(i: usize, j: usize) -> usize {
    let (row, column) = if i < j { (i, j) } else { (j, i) };
    ADDED_MASS + row * 6 - row * (row + 1) / 2 + column
}

/// Index of the linear damping of force `i` by velocity `j`.
pub const fn linear(i: usize, j: usize) -> usize {
    LINEAR + 6 * i + j
}

/// Index of the quadratic damping of force `i` by velocity `j`.
pub const fn quadratic(i: usize, j: usize) -> usize {
    QUADRATIC + 6 * i + j
}

/// How a coefficient follows the environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaling {
    /// Not at all.
    None,
    /// With the density of the water.
    Density,
    /// With density and gravity: buoyancy.
    Weight,
}

/// The layout of the coefficient vector: hull first, then the actuators in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    actuators: Vec<String>,
}

impl Layout {
    /// The layout for actuators of these names.
    pub fn new(actuators: Vec<String>) -> Self {
        Self { actuators }
    }

    /// The number of coefficients.
    pub fn len(&self) -> usize {
        HULL + PER_ACTUATOR * self.actuators.len()
    }

    /// The number of actuators.
    pub fn actuators(&self) -> usize {
        self.actuators.len()
    }

    /// Never: the hull is always there.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Index of the first coefficient of actuator `k`.
    pub fn actuator(&self, k: usize) -> usize {
        HULL + PER_ACTUATOR * k
    }

    /// The canonical name at an index.
    pub fn name(&self, index: usize) -> String {
        let pair = |offset: usize| (offset / 6, offset % 6);
        match index {
            0..ADDED_MASS => RIGID[index].0.to_owned(),
            ADDED_MASS..LINEAR => {
                let (i, j) = triangle(index);
                format!("{}_{}dot", FORCES[i], VELOCITIES[j])
            }
            LINEAR..QUADRATIC => {
                let (i, j) = pair(index - LINEAR);
                format!("{}_{}", FORCES[i], VELOCITIES[j])
            }
            QUADRATIC..LIFT => {
                let (i, j) = pair(index - QUADRATIC);
                format!("{}_{1}{1}", FORCES[i], VELOCITIES[j])
            }
            LIFT..BIAS => LIFT_NAMES[index - LIFT].to_owned(),
            BIAS..CROSS_FLOW => format!("{}_0", FORCES[index - BIAS]),
            CROSS_FLOW..TETHER => OF_STRIPS[index - CROSS_FLOW].0.to_owned(),
            TETHER..HULL => OF_TETHER[index - TETHER].0.to_owned(),
            _ => {
                let (k, offset) = ((index - HULL) / PER_ACTUATOR, (index - HULL) % PER_ACTUATOR);
                format!("{}.{}", self.actuators[k], ACTUATOR[offset].0)
            }
        }
    }

    /// The index of a name; both names of a symmetric added-mass pair are known.
    pub fn index(&self, name: &str) -> Option<usize> {
        if let Some((actuator, coefficient)) = name.rsplit_once('.') {
            let k = self.actuators.iter().position(|a| a == actuator)?;
            let offset = ACTUATOR.iter().position(|(n, _, _)| *n == coefficient)?;
            return Some(self.actuator(k) + offset);
        }
        if let Some((force, velocity)) = name.strip_suffix("dot").and_then(|s| s.split_once('_')) {
            let i = FORCES.iter().position(|f| *f == force)?;
            let j = VELOCITIES.iter().position(|v| *v == velocity)?;
            return Some(added_mass(i, j));
        }
        (0..HULL).find(|&i| self.name(i) == name)
    }

    /// The index of a name, or a message that names the nearest known one.
    ///
    /// # Errors
    /// When no coefficient has the name.
    pub fn find(&self, name: &str) -> Result<usize, String> {
        self.index(name).ok_or_else(|| {
            let names: Vec<String> = (0..self.len()).map(|i| self.name(i)).collect();
            format!("unknown coefficient \"{name}\"{}", nearest(name, names.iter().map(String::as_str)))
        })
    }

    /// Unit of a coefficient, given the command unit of its actuator.
    pub fn unit(&self, index: usize, command_unit: &str) -> String {
        let angular = |axis: usize| axis >= 3;
        match index {
            0..ADDED_MASS => RIGID[index].1.to_owned(),
            ADDED_MASS..LINEAR => {
                let (i, j) = triangle(index);
                ["kg", "kg m", "kg m2"][usize::from(angular(i)) + usize::from(angular(j))].to_owned()
            }
            LINEAR..QUADRATIC => {
                let (i, j) = ((index - LINEAR) / 6, (index - LINEAR) % 6);
                match (angular(i), angular(j)) {
                    (false, false) => "N s/m",
                    (true, true) => "N m s",
                    _ => "N s",
                }
                .to_owned()
            }
            QUADRATIC..LIFT => {
                let (i, j) = ((index - QUADRATIC) / 6, (index - QUADRATIC) % 6);
                match (angular(i), angular(j)) {
                    (false, false) => "N s2/m2",
                    (false, true) => "N s2",
                    (true, false) => "N s2/m",
                    (true, true) => "N m s2",
                }
                .to_owned()
            }
            LIFT..BIAS => match (index - LIFT < 4, (index - LIFT).is_multiple_of(2)) {
                (true, true) => "N s2/m2",
                (true, false) => "N s2/m",
                (false, true) => "N s2/m",
                (false, false) => "N s2",
            }
            .to_owned(),
            BIAS..CROSS_FLOW => if angular(index - BIAS) { "N m" } else { "N" }.to_owned(),
            CROSS_FLOW..TETHER => "1".to_owned(),
            TETHER..HULL => OF_TETHER[index - TETHER].1.to_owned(),
            _ => ACTUATOR[(index - HULL) % PER_ACTUATOR].1.replace("<c>", command_unit),
        }
    }

    /// What a coefficient means.
    pub fn description(&self, index: usize) -> String {
        let pair = |offset: usize| (FORCES[offset / 6], VELOCITIES[offset % 6]);
        match index {
            0..ADDED_MASS => RIGID[index].2.to_owned(),
            ADDED_MASS..LINEAR => {
                let (i, j) = triangle(index);
                format!("added mass, {} per acceleration of {}", FORCES[i], VELOCITIES[j])
            }
            LINEAR..QUADRATIC => {
                let (force, velocity) = pair(index - LINEAR);
                format!("linear damping, {force} per {velocity}")
            }
            QUADRATIC..LIFT => {
                let (force, velocity) = pair(index - QUADRATIC);
                let what = if index > QUADRATIC && (index - QUADRATIC).is_multiple_of(6) {
                    "trim that grows with the speed, of an asymmetric hull"
                } else {
                    "quadratic damping"
                };
                format!("{what}, {force} per |{velocity}| {velocity}")
            }
            LIFT..BIAS => {
                let name = LIFT_NAMES[index - LIFT];
                format!("lift, {} per |u| {}", &name[..1], &name[3..])
            }
            BIAS..CROSS_FLOW => format!("constant bias {} in the body frame", FORCES[index - BIAS]),
            CROSS_FLOW..TETHER => OF_STRIPS[index - CROSS_FLOW].1.to_owned(),
            TETHER..HULL => OF_TETHER[index - TETHER].2.to_owned(),
            _ => ACTUATOR[(index - HULL) % PER_ACTUATOR].2.to_owned(),
        }
    }

    /// How a coefficient follows the environment.
    pub fn scaling(index: usize) -> Scaling {
        match index {
            BUOYANCY => Scaling::Weight,
            ADDED_MASS..BIAS => Scaling::Density,
            // p1 p2, q1 q2 and the regression; not gain, w, t and the motor.
            _ if index >= HULL && matches!((index - HULL) % PER_ACTUATOR, 1..=3 | 6..=13) => Scaling::Density,
            _ => Scaling::None,
        }
    }
}

/// Row and column (row <= column) of an added-mass index.
fn triangle(index: usize) -> (usize, usize) {
    let mut offset = index - ADDED_MASS;
    let mut row = 0;
    while offset >= 6 - row {
        offset -= 6 - row;
        row += 1;
    }
    (row, row + offset)
}
