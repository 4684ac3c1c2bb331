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

use super::estimate::{ATTITUDE, CURRENT, Estimate, GYRO_BIAS, POSITION, VELOCITY};
use super::row::Row;
use crate::model::kinematics::{Quaternion, cosine_of_pitch, euler_angle, quaternion_product, rotation};
use crate::number::algebra::{Vec3, cross, dot, each, product, splat, transposed_product};
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
pub enum Observation<T = f64> {
    /// Position of the point `arm` (body, m) along the unit vector `along` (NED), m.
    Place {
        /// Direction, NED.
        along: Vec3<T>,
        /// Lever arm, m.
        arm: Vec3<T>,
    },
    /// Velocity of the point `arm` along the unit vector `along` (body), m/s.
    Velocity {
        /// Direction, body frame.
        along: Vec3<T>,
        /// Lever arm, m.
        arm: Vec3<T>,
        /// Over ground, or else through the water.
        over_ground: bool,
    },
    /// Roll (0), pitch (1) or yaw (2) of a sensor that is mounted at the attitude `mount`, rad.
    Angle {
        /// Which.
        axis: usize,
        /// Sensor → body.
        mount: Quaternion<T>,
    },
    /// Turn rate about the unit vector `about` (body), rad/s.
    Rate {
        /// Axis, body frame.
        about: Vec3<T>,
    },
    /// Distance of the point `arm` from a beacon, m.
    Range {
        /// Beacon, NED, m.
        beacon: Vec3<T>,
        /// Lever arm, m.
        arm: Vec3<T>,
    },
    /// Bearing of a beacon from the point `arm` about the body's down axis, from forward to starboard, rad.
    Bearing {
        /// Beacon, NED, m.
        beacon: Vec3<T>,
        /// Lever arm, m.
        arm: Vec3<T>,
    },
    /// Distance of a surface from the point `arm` along the unit vector `along` (body), m.
    Echo {
        /// Direction of the beam, body frame.
        along: Vec3<T>,
        /// Lever arm, m.
        arm: Vec3<T>,
        /// What it meets.
        surface: Surface,
    },
}

/// What is expected of a sensor.
#[derive(Clone, Copy, Debug)]
pub struct Expected<T: Real> {
    /// The value.
    pub value: T,
    /// The row of its Jacobian.
    pub row: Row<T>,
    /// Whether the sensor shows anything: not on top of a beacon, past a surface, at a pitch where roll and yaw are one.
    pub seen: T::Mask,
}

/// Below this cosine of pitch, or of the angle between beam and normal, a derivative is none.
const GRAZING: f64 = 0.05;

impl Observation {
    /// Value and row at an estimate; nothing where the sensor shows nothing.
    pub fn expect(&self, at: &Estimate) -> Option<(f64, Row)> {
        let Expected { value, row, seen } = self.expected(at);
        seen.then_some((value, row))
    }
}

impl<T: Real> Observation<T> {
    /// What is expected of the sensor at an estimate.
    #[inline(always)]
    pub fn expected(&self, at: &Estimate<T>) -> Expected<T> {
        let r = at.rotation();
        let [u, v, w, p, q, s] = at.motion.nu;
        let (zero, one) = (u.zero(), u.splat(1.0));
        let always = zero.lt(one);
        match *self {
            Self::Place { along, arm } => {
                let (value, row) = place(at, &along, &arm);
                Expected { value, row, seen: always }
            }
            Self::Velocity { along, arm, over_ground } => {
                let turning = cross(&[p, q, s], &arm);
                let lever = cross(&arm, &along);
                let value = dot(&along, &[u + turning[0], v + turning[1], w + turning[2]]);
                if !over_ground {
                    let row = Row::of([(VELOCITY, along), (VELOCITY + 3, lever)]);
                    return Expected { value, row, seen: always };
                }
                let flow = transposed_product(&r, &at.current);
                let row = Row::of([
                    (ATTITUDE, cross(&along, &flow)),
                    (VELOCITY, along),
                    (VELOCITY + 3, lever),
                    (CURRENT, product(&r, &along)),
                ]);
                Expected { value: value + dot(&along, &flow), row, seen: always }
            }
            Self::Angle { axis, mount } => {
                let seen = rotation(&quaternion_product(&at.motion.attitude, &mount));
                let cp = cosine_of_pitch(&seen);
                let upright = zero.lt(cp);
                let (sp, scale) = (-seen[2][0], one / T::select(upright, cp, one));
                let (sr, cr) = (seen[2][1] * scale, T::select(upright, seen[2][2] * scale, one));
                let rates = match axis {
                    0 => [one, sr * sp * scale, cr * sp * scale],
                    1 => [zero, cr, -sr],
                    _ => [zero, sr * scale, cr * scale],
                };
                let row = Row::of([(ATTITUDE, product(&rotation(&mount), &rates))]);
                let clear = if axis == 1 { always } else { zero.splat(GRAZING).lt(cp) };
                Expected { value: euler_angle(&seen, axis), row, seen: clear }
            }
            Self::Rate { about } => {
                let [bp, bq, br] = at.gyro_bias;
                let value = dot(&about, &[p + bp, q + bq, s + br]);
                Expected { value, row: Row::of([(VELOCITY + 3, about), (GYRO_BIAS, about)]), seen: always }
            }
            Self::Range { beacon, arm } => {
                let away = minus(&point(at, &arm), &beacon);
                let value = dot(&away, &away).sqrt();
                let scale = one / value;
                let (_, row) = place(at, &each(&away, |x| x * scale), &arm);
                Expected { value, row, seen: zero.splat(1e-3).lt(value) }
            }
            Self::Bearing { beacon, arm } => {
                let sight = transposed_product(&r, &minus(&beacon, &at.motion.position));
                let [x, y, _] = minus(&sight, &arm);
                let square = x * x + y * y;
                let scale = one / square;
                let across = [-y * scale, x * scale, zero];
                let row = Row::of([
                    (POSITION, each(&product(&r, &across), |x| -x)),
                    (ATTITUDE, cross(&across, &sight)),
                ]);
                Expected { value: y.atan2(x), row, seen: zero.splat(1e-6).lt(square) }
            }
            Self::Echo { along, arm, surface } => {
                let (beam, from) = (product(&r, &along), point(at, &arm));
                let (normal, offset, met) = match surface {
                    Surface::Plane { normal, offset } => (splat(zero, &normal), zero.splat(offset), always),
                    Surface::Cylinder { centre, radius } => touching(&from, &beam, (centre, radius)),
                };
                let slope = dot(&normal, &beam);
                let scale = one / slope;
                let range = (offset - dot(&normal, &from)) * scale;
                let sight = transposed_product(&r, &normal);
                let mut reach = arm;
                for i in 0..3 {
                    reach[i] += range * along[i];
                }
                let row = Row::of([
                    (POSITION, each(&normal, |x| -x * scale)),
                    (ATTITUDE, each(&cross(&reach, &sight), |x| -x * scale)),
                ]);
                let ahead = T::both(zero.splat(GRAZING).lt(slope.abs()), zero.lt(range));
                Expected { value: range, row, seen: T::both(met, ahead) }
            }
        }
    }

    /// Measured minus expected: the short way round where it is an angle.
    #[inline(always)]
    pub fn residual(&self, measured: T, expected: T) -> T {
        match self {
            Self::Angle { .. } | Self::Bearing { .. } => (measured - expected).wrap(),
            _ => measured - expected,
        }
    }
}

#[inline(always)]
fn minus<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The place of a lever arm, NED, m.
#[inline(always)]
fn point<T: Real>(at: &Estimate<T>, arm: &Vec3<T>) -> Vec3<T> {
    let mut place = product(&at.rotation(), arm);
    for i in 0..3 {
        place[i] += at.motion.position[i];
    }
    place
}

#[inline(always)]
fn place<T: Real>(at: &Estimate<T>, along: &Vec3<T>, arm: &Vec3<T>) -> (T, Row<T>) {
    let turned = cross(arm, &transposed_product(&at.rotation(), along));
    (dot(along, &point(at, arm)), Row::of([(POSITION, *along), (ATTITUDE, turned)]))
}

/// The plane that touches a vertical cylinder where a beam from a point first meets it, and whether it does.
#[inline(always)]
fn touching<T: Real>(
    from: &Vec3<T>,
    beam: &Vec3<T>,
    (centre, radius): ([f64; 2], f64),
) -> (Vec3<T>, T, T::Mask) {
    let zero = from[0].zero();
    let (x, y) = (from[0] - centre[0], from[1] - centre[1]);
    let (a, b) = (beam[0] * beam[0] + beam[1] * beam[1], x * beam[0] + y * beam[1]);
    let c = x * x + y * y - radius * radius;
    let square = b * b - a * c;
    let root = square.max(zero).sqrt();
    // From inside the far crossing is the net, from outside the near one.
    let range = (T::select(c.lt(zero), root, -root) - b) / a;
    let normal = [(x + range * beam[0]) / radius, (y + range * beam[1]) / radius, zero];
    let offset = normal[0] * centre[0] + normal[1] * centre[1] + radius;
    let ahead = T::both(zero.lt(range), range.lt(zero.splat(f64::INFINITY)));
    (normal, offset, T::both(ahead, (-square).lt(zero.splat(f64::MIN_POSITIVE))))
}
