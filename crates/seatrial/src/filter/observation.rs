//! What a sensor shows of a state, and the row of its Jacobian.
//!
//! A sensor sits at its lever arm r (body frame, from O) and looks along a unit vector of the body frame; a tilted sensor
//! has tilted axes. With `p_r = p + R r` and `f = Rᵀ v_c`:
//!
//! | observation | expected | by δ (body frame) | by the rest |
//! |---|---|---|---|
//! | place along e (NED) | `e·p_r` | `r × Rᵀe` | p: e |
//! | velocity along a over ground | `a·(v + ω × r + f)` | `a × f` | v: a, ω: `r × a`, v_c: `R a` |
//! | velocity along a through the water | `a·(v + ω × r)` | | v: a, ω: `r × a` |
//! | roll, pitch, yaw | Euler angles of `R R_s` | row of `T(φ, θ) R_sᵀ` | |
//! | rate about a | `a·(ω + b_g)` | | ω: a, b_g: a |
//! | range to b | `\|p_r − b\|`, `e = (p_r − b)/\|p_r − b\|` | `r × Rᵀe` | p: e |
//! | bearing of b | `atan2(d_y, d_x)`, `d = Rᵀ(b − p) − r` | `a × Rᵀ(b − p)` | p: `−R a`, `a = [−d_y, d_x, 0]/(d_x² + d_y²)` |
//! | echo along a of a plane `n·x = d` | `ρ = (d − n·p_r)/(n·R a)` | `−[(r + ρ a) × Rᵀn]/(n·R a)` | p: `−n/(n·R a)` |
//!
//! A round net is the plane that touches it where the beam meets it.
//!
//! Source: Farrell (2008), chapter 11 (aiding); Solà (2017), section 6.1. Tests: `tests/filter/observation.rs` (every
//! row against difference quotients).

use super::error_state::Row;
use super::estimate::{ATTITUDE, CURRENT, Estimate, GYRO_BIAS, POSITION, VELOCITY};
use crate::model::kinematics::{Quaternion, cosine_of_pitch, euler_angle, quaternion_product, rotation};
use crate::number::algebra::{Vec3, cross, dot, product, transposed_product};
use crate::number::real::Real;

/// A known surface that throws back an echo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    /// The points x (NED, m) with `normal·x = offset`; a wall, a flat net, the bottom.
    Plane {
        /// Unit vector, NED.
        normal: Vec3<f64>,
        /// Distance from the origin along it, m.
        offset: f64,
    },
    /// A vertical cylinder: the net of a round pen, a pile.
    Cylinder {
        /// North and east of its axis, m.
        centre: [f64; 2],
        /// Radius, m.
        radius: f64,
    },
}

/// One scalar that a sensor shows.
#[derive(Clone, Copy, Debug)]
pub enum Observation {
    /// Position of the point `arm` (body, m) along the unit vector `along` (NED), m.
    Place {
        /// Direction, NED.
        along: Vec3<f64>,
        /// Lever arm, m.
        arm: Vec3<f64>,
    },
    /// Velocity of the point `arm` along the unit vector `along` (body), m/s.
    Velocity {
        /// Direction, body frame.
        along: Vec3<f64>,
        /// Lever arm, m.
        arm: Vec3<f64>,
        /// Over ground, or else through the water.
        over_ground: bool,
    },
    /// Roll (0), pitch (1) or yaw (2) of a sensor that is mounted at the attitude `mount`, rad.
    Angle {
        /// Which.
        axis: usize,
        /// Sensor → body.
        mount: Quaternion<f64>,
    },
    /// Turn rate about the unit vector `about` (body), rad/s.
    Rate {
        /// Axis, body frame.
        about: Vec3<f64>,
    },
    /// Distance of the point `arm` from a beacon, m.
    Range {
        /// Beacon, NED, m.
        beacon: Vec3<f64>,
        /// Lever arm, m.
        arm: Vec3<f64>,
    },
    /// Bearing of a beacon from the point `arm` about the body's down axis, from forward to starboard, rad.
    Bearing {
        /// Beacon, NED, m.
        beacon: Vec3<f64>,
        /// Lever arm, m.
        arm: Vec3<f64>,
    },
    /// Distance of a surface from the point `arm` along the unit vector `along` (body), m.
    Echo {
        /// Direction of the beam, body frame.
        along: Vec3<f64>,
        /// Lever arm, m.
        arm: Vec3<f64>,
        /// What it meets.
        surface: Surface,
    },
}

/// Below this cosine of pitch, or of the angle between beam and normal, a derivative is none.
const GRAZING: f64 = 0.05;

impl Observation {
    /// What is expected of the sensor at an estimate and the row of its Jacobian; nothing where it shows nothing: on top
    /// of a beacon, past a surface, at a pitch where roll and yaw are one.
    #[inline(always)]
    pub fn expect(&self, at: &Estimate) -> Option<(f64, Row)> {
        let r = at.rotation();
        let [u, v, w, p, q, s] = at.motion.nu;
        match *self {
            Self::Place { along, arm } => Some(place(at, &along, &arm)),
            Self::Velocity { along, arm, over_ground } => {
                let turning = cross(&[p, q, s], &arm);
                let lever = cross(&arm, &along);
                let through = dot(&along, &[u + turning[0], v + turning[1], w + turning[2]]);
                if !over_ground {
                    return Some((through, Row::of([(VELOCITY, along), (VELOCITY + 3, lever)])));
                }
                let flow = transposed_product(&r, &at.current);
                let row = Row::of([
                    (ATTITUDE, cross(&along, &flow)),
                    (VELOCITY, along),
                    (VELOCITY + 3, lever),
                    (CURRENT, product(&r, &along)),
                ]);
                Some((through + dot(&along, &flow), row))
            }
            Self::Angle { axis, mount } => {
                let seen = rotation(&quaternion_product(&at.motion.attitude, &mount));
                let cp = cosine_of_pitch(&seen);
                if axis != 1 && cp < GRAZING {
                    return None;
                }
                let sp = -seen[2][0];
                let (sr, cr) = if cp > 0.0 { (seen[2][1] / cp, seen[2][2] / cp) } else { (0.0, 1.0) };
                let rates = match axis {
                    0 => [1.0, sr * sp / cp, cr * sp / cp],
                    1 => [0.0, cr, -sr],
                    _ => [0.0, sr / cp, cr / cp],
                };
                Some((euler_angle(&seen, axis), Row::of([(ATTITUDE, product(&rotation(&mount), &rates))])))
            }
            Self::Rate { about } => {
                let [bp, bq, br] = at.gyro_bias;
                let shown = dot(&about, &[p + bp, q + bq, s + br]);
                Some((shown, Row::of([(VELOCITY + 3, about), (GYRO_BIAS, about)])))
            }
            Self::Range { beacon, arm } => {
                let away = minus(&point(at, &arm), &beacon);
                let range = dot(&away, &away).sqrt();
                (range > 1e-3).then(|| (range, place(at, &away.map(|x| x / range), &arm).1))
            }
            Self::Bearing { beacon, arm } => {
                let seen = transposed_product(&r, &minus(&beacon, &at.motion.position));
                let [x, y, _] = minus(&seen, &arm);
                let square = x * x + y * y;
                let across = [-y / square, x / square, 0.0];
                let row = Row::of([
                    (POSITION, product(&r, &across).map(|x| -x)),
                    (ATTITUDE, cross(&across, &seen)),
                ]);
                (square > 1e-6).then(|| (y.atan2(x), row))
            }
            Self::Echo { along, arm, surface } => {
                let (beam, from) = (product(&r, &along), point(at, &arm));
                let (normal, offset) = match surface {
                    Surface::Plane { normal, offset } => (normal, offset),
                    Surface::Cylinder { centre, radius } => touching(&from, &beam, (centre, radius))?,
                };
                let slope = dot(&normal, &beam);
                let range = (offset - dot(&normal, &from)) / slope;
                let seen = transposed_product(&r, &normal);
                let reach: Vec3<f64> = std::array::from_fn(|i| arm[i] + range * along[i]);
                let row = Row::of([
                    (POSITION, normal.map(|x| -x / slope)),
                    (ATTITUDE, cross(&reach, &seen).map(|x| -x / slope)),
                ]);
                (slope.abs() > GRAZING && range > 0.0).then_some((range, row))
            }
        }
    }

    /// Measured minus expected: the short way round where it is an angle.
    #[inline(always)]
    pub fn residual(&self, measured: f64, expected: f64) -> f64 {
        match self {
            Self::Angle { .. } | Self::Bearing { .. } => (measured - expected).wrap(),
            _ => measured - expected,
        }
    }
}

#[inline(always)]
fn minus(a: &Vec3<f64>, b: &Vec3<f64>) -> Vec3<f64> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The place of a lever arm, NED, m.
#[inline(always)]
fn point(at: &Estimate, arm: &Vec3<f64>) -> Vec3<f64> {
    let lever = product(&at.rotation(), arm);
    std::array::from_fn(|i| at.motion.position[i] + lever[i])
}

#[inline(always)]
fn place(at: &Estimate, along: &Vec3<f64>, arm: &Vec3<f64>) -> (f64, Row) {
    let turned = cross(arm, &transposed_product(&at.rotation(), along));
    (dot(along, &point(at, arm)), Row::of([(POSITION, *along), (ATTITUDE, turned)]))
}

/// The plane that touches a vertical cylinder where a beam from a point first meets it.
#[inline(always)]
fn touching(
    from: &Vec3<f64>,
    beam: &Vec3<f64>,
    (centre, radius): ([f64; 2], f64),
) -> Option<(Vec3<f64>, f64)> {
    let (x, y) = (from[0] - centre[0], from[1] - centre[1]);
    let (a, b) = (beam[0] * beam[0] + beam[1] * beam[1], x * beam[0] + y * beam[1]);
    let c = x * x + y * y - radius * radius;
    let root = (b * b - a * c).sqrt();
    // From inside the far crossing is the net, from outside the near one.
    let range = if c < 0.0 { (root - b) / a } else { (-root - b) / a };
    let normal = [(x + range * beam[0]) / radius, (y + range * beam[1]) / radius, 0.0];
    (range.is_finite() && range > 0.0)
        .then(|| (normal, radius + normal[0] * centre[0] + normal[1] * centre[1]))
}
