//! The derivatives of a step of the process by attitude, velocity and force, column by column.
//!
//! They are carried through the stages of the Runge–Kutta step itself, so that they are those of the discrete step and not
//! of a series. The motion goes first, and every column of derivatives then goes through its four stages by itself. By
//! force and by the vertical in the body frame, `e = Rᵀ e_z`, the equation of motion is linear, `∂ν'/∂τ = M⁻¹`,
//! `∂ν'/∂e = M⁻¹ [(W − B) I; S(r_g W − r_b B)]`. The kinematics are differentiated by hand, because the derivatives of R
//! itself are not asked for. The attitude is perturbed in the body frame: `q = q̂ ⊗ [1, ½ δ]` before,
//! `δ = 2 vec(q̂⁻¹ ⊗ ∂q)` after.
//!
//! A first step begins at derivatives that are one or none, and what they make zero is left out: at its first stage a turn
//! does not move, a velocity does not turn, and a force does neither, nor has it turned at the second.
//!
//! Source: Fossen (2011), section 8.3 and equation 7.9; Solà (2017), section 5.4.
//! Tests: `tests/filter/process.rs` (difference quotients of the plain step).

use super::estimate::{ATTITUDE, FORCE, VELOCITY};
use super::transition::{Block, COLUMNS};
use crate::model::integrate::STAGES;
use crate::model::kinematics::{Quaternion, quaternion_product, quaternion_rate};
use crate::number::algebra::{Mat3, Mat6, Vec3, Vec6, dot, each, product};
use crate::number::real::Real;

/// The derivatives of a motion by one unknown: of position, attitude and velocity, as [`State::row`] has them.
///
/// [`State::row`]: crate::model::integrate::State
type Column<T> = [T; 13];

/// The columns by the velocity, and those by the force, come after those by the attitude.
const MOVING: usize = VELOCITY - ATTITUDE;
/// See [`MOVING`].
const PUSHED: usize = FORCE - ATTITUDE;

/// The derivatives of a step.
pub(super) struct Tangent<T> {
    stages: [Stage<T>; 4],
    columns: Box<[Column<T>; COLUMNS]>,
    /// Derivatives of the acceleration by force and by the vertical in the body frame, which are constant.
    by_force: Mat6<f64>,
    by_vertical: [Vec3<f64>; 6],
}

/// What the derivatives read of a stage of a step.
#[derive(Clone, Copy)]
struct Stage<T> {
    attitude: Quaternion<T>,
    rates: Vec3<T>,
    rotation: Mat3<T>,
    /// `∂(R(q) v)/∂q`.
    track: [[T; 4]; 3],
    /// Derivatives of the acceleration by q and by the velocity.
    by_attitude: [[T; 4]; 6],
    by_velocity: Mat6<T>,
}

impl<T: Real> Tangent<T> {
    /// No step yet; the derivatives of the acceleration by force and by the vertical are constant.
    pub(super) fn new((by_force, by_vertical): (Mat6<f64>, [Vec3<f64>; 6]), zero: T) -> Self {
        let none = Stage {
            attitude: [zero; 4],
            rates: [zero; 3],
            rotation: [[zero; 3]; 3],
            track: [[zero; 4]; 3],
            by_attitude: [[zero; 4]; 6],
            by_velocity: [[zero; 6]; 6],
        };
        Self { stages: [none; 4], columns: Box::new([[zero; 13]; COLUMNS]), by_force, by_vertical }
    }

    /// Sees a stage of a step: its attitude with the rotation, and its velocity. Returns where the derivatives of the
    /// acceleration by the velocity go.
    #[inline(always)]
    pub(super) fn see(
        &mut self,
        stage: usize,
        (attitude, rotation): (&Quaternion<T>, &Mat3<T>),
        nu: &Vec6<T>,
    ) -> &mut Mat6<T> {
        let [u, v, w, p, q, r] = *nu;
        let by_attitude = heavy(&self.by_vertical, attitude);
        let stage = &mut self.stages[stage];
        (stage.attitude, stage.rates, stage.rotation) = (*attitude, [p, q, r], *rotation);
        stage.track = track_by_attitude(attitude, &[u, v, w]);
        stage.by_attitude = by_attitude;
        &mut stage.by_velocity
    }

    /// Carries the derivatives over a step of `h` seconds whose stages were seen, the first of several at the attitude
    /// `start`.
    #[inline(always)]
    pub(super) fn carry(&mut self, start: Option<&Quaternion<T>>, h: f64, length: &Length<T>) {
        let stages = &self.stages;
        let zero = stages[0].rates[0].zero();
        let (none, still) = ([zero; 6], [zero; 13]);
        let Some(attitude) = start else {
            for (k, column) in self.columns.iter_mut().enumerate() {
                let push = k.checked_sub(PUSHED).map_or(none, |k| constant(&self.by_force, k, zero));
                *column = through(stages, 0, (&*column, still, *column), &push, h);
                length.divide(column);
            }
            return;
        };
        for k in 0..MOVING {
            let begun = turned(attitude, k);
            let slope = stages[0].turn(&[begun[3], begun[4], begun[5], begun[6]]);
            self.columns[k] =
                through(stages, 1, (&begun, slope, moved(&begun, &slope, STAGES[0].1 * h)), &none, h);
        }
        for k in 0..PUSHED - MOVING {
            let (mut begun, slope) = (still, stages[0].move_one(k));
            begun[7 + k] = zero.splat(1.0);
            let end = moved(&begun, &slope, STAGES[0].1 * h);
            self.columns[MOVING + k] = through(stages, 1, (&begun, slope, end), &none, h);
        }
        for k in 0..COLUMNS - PUSHED {
            let push = constant(&self.by_force, k, zero);
            let mut slope = still;
            slope[7..].copy_from_slice(&push);
            let end = moved(&still, &slope, STAGES[0].1 * h);
            let slope = stages[1].move_by(&each(&push, |x| x * (STAGES[1].0 * h)), &push);
            let end = moved(&end, &slope, STAGES[1].1 * h);
            self.columns[PUSHED + k] = through(stages, 2, (&still, slope, end), &push, h);
        }
        for column in self.columns.iter_mut() {
            length.divide(column);
        }
    }

    /// Writes the derivatives of position, attitude and velocity, after steps that led to an attitude.
    #[inline(always)]
    pub(super) fn write(&self, attitude: &Quaternion<T>, block: &mut Block<T>) {
        let [w, x, y, z] = *attitude;
        for (k, end) in self.columns.iter().enumerate() {
            let turned = quaternion_product(&[w, -x, -y, -z], &[end[3], end[4], end[5], end[6]]);
            for i in 0..3 {
                block[i][k] = end[i];
                block[3 + i][k] = turned[1 + i] * 2.0;
            }
            for i in 0..6 {
                block[6 + i][k] = end[7 + i];
            }
        }
    }
}

impl<T: Real> Stage<T> {
    /// The derivatives of the rates of position, attitude and velocity where those of attitude and velocity are these.
    #[inline(always)]
    fn slope(&self, turned: &Quaternion<T>, moving: &Vec6<T>, push: &Vec6<T>) -> Column<T> {
        let [du, dv, dw, dp, dq, dr] = *moving;
        let [x, y, z] = weighed(&self.track, turned, &product(&self.rotation, &[du, dv, dw]));
        let (spun, more) =
            (quaternion_rate(turned, &self.rates), quaternion_rate(&self.attitude, &[dp, dq, dr]));
        let attitude = |i: usize| spun[i] + more[i];
        let weighty = weighed(&self.by_attitude, turned, push);
        let [u, v, w, p, q, r] = weighed(&self.by_velocity, moving, &weighty);
        [x, y, z, attitude(0), attitude(1), attitude(2), attitude(3), u, v, w, p, q, r]
    }

    /// [`Self::slope`] where only the attitude differs.
    #[inline(always)]
    fn turn(&self, turned: &Quaternion<T>) -> Column<T> {
        let [x, y, z] = product(&self.track, turned);
        let [a, b, c, d] = quaternion_rate(turned, &self.rates);
        let [u, v, w, p, q, r] = product(&self.by_attitude, turned);
        [x, y, z, a, b, c, d, u, v, w, p, q, r]
    }

    /// [`Self::slope`] where only the velocity differs.
    #[inline(always)]
    fn move_by(&self, moving: &Vec6<T>, push: &Vec6<T>) -> Column<T> {
        let [du, dv, dw, dp, dq, dr] = *moving;
        let [x, y, z] = product(&self.rotation, &[du, dv, dw]);
        let [a, b, c, d] = quaternion_rate(&self.attitude, &[dp, dq, dr]);
        let [u, v, w, p, q, r] = weighed(&self.by_velocity, moving, push);
        [x, y, z, a, b, c, d, u, v, w, p, q, r]
    }

    /// [`Self::slope`] where only the component `k` of the velocity differs, by one.
    #[inline(always)]
    fn move_one(&self, k: usize) -> Column<T> {
        let mut slope = [self.rates[0].zero(); 13];
        if k < 3 {
            for i in 0..3 {
                slope[i] = self.rotation[i][k];
            }
        } else {
            let mut about = [slope[0]; 3];
            about[k - 3] = slope[0].splat(1.0);
            slope[3..7].copy_from_slice(&quaternion_rate(&self.attitude, &about));
        }
        for i in 0..6 {
            slope[7 + i] = self.by_velocity[i][k];
        }
        slope
    }
}

/// The rest of a step from the stage `from` on: the derivatives at its beginning, their slope at the stage before, and what
/// the stages so far have made of them.
#[inline(always)]
fn through<T: Real>(
    stages: &[Stage<T>; 4],
    from: usize,
    (start, mut slope, mut end): (&Column<T>, Column<T>, Column<T>),
    push: &Vec6<T>,
    h: f64,
) -> Column<T> {
    for i in from..4 {
        let (node, weight, _) = STAGES[i];
        // Nothing depends on the place.
        let [_, _, _, a, b, c, d, nu @ ..] = moved(start, &slope, node * h);
        slope = stages[i].slope(&[a, b, c, d], &nu, push);
        end = moved(&end, &slope, weight * h);
    }
    end
}

/// `x + ẋ t`.
#[inline(always)]
fn moved<T: Real>(x: &Column<T>, slope: &Column<T>, time: f64) -> Column<T> {
    let (mut sum, time) = (*x, x[0].splat(time));
    for i in 0..13 {
        sum[i] = slope[i].mul_add(time, x[i]);
    }
    sum
}

/// The column `k` of a matrix of constants.
#[inline(always)]
fn constant<T: Real>(matrix: &Mat6<f64>, k: usize, zero: T) -> Vec6<T> {
    let mut column = [zero; 6];
    for i in 0..6 {
        column[i] = zero.splat(matrix[i][k]);
    }
    column
}

/// What brings a quaternion back to the length 1 after a step, as [`crate::model::kinematics::renormalised`] does: the
/// quaternion, the factor, and the derivative of the factor by half the square of the length.
pub(super) struct Length<T> {
    q: Quaternion<T>,
    pub(super) scale: T,
    slope: T,
}

impl<T: Real> Length<T> {
    #[inline(always)]
    pub(super) fn of(q: Quaternion<T>) -> Self {
        let half_square = dot(&q, &q) * 0.5;
        let first = half_square.splat(1.5) - half_square;
        let second = (half_square * first).neg_mul_add(first, first.splat(1.5));
        // first' = −1, second' = −first² + 2 half_square first.
        let slope = first * (half_square * 2.0 * first - first * first) - second;
        Self { q, scale: first * second, slope }
    }

    /// The derivatives of a motion after it.
    #[inline(always)]
    fn divide(&self, column: &mut [T; 13]) {
        let grown = dot(&self.q, &[column[3], column[4], column[5], column[6]]) * self.slope;
        for i in 0..4 {
            column[3 + i] = self.q[i].mul_add(grown, column[3 + i] * self.scale);
        }
    }
}

/// `A x + y`.
#[inline(always)]
pub(super) fn weighed<T: Real, const N: usize, const M: usize>(
    a: &[[T; M]; N],
    x: &[T; M],
    y: &[T; N],
) -> [T; N] {
    let mut sum = *y;
    for i in 0..N {
        for j in 0..M {
            sum[i] = a[i][j].mul_add(x[j], sum[i]);
        }
    }
    sum
}

/// `∂(R(q) v)/∂q`.
#[inline(always)]
fn track_by_attitude<T: Real>(q: &Quaternion<T>, v: &Vec3<T>) -> [[T; 4]; 3] {
    let ([w, x, y, z], [a, b, c]) = (each(q, |part| part * 2.0), *v);
    [
        [y * c - z * b, y * b + z * c, x * b + w * c - y * a * 2.0, x * c - w * b - z * a * 2.0],
        [z * a - x * c, y * a - w * c - x * b * 2.0, x * a + z * c, w * a + y * c - z * b * 2.0],
        [x * b - y * a, z * a + w * b - x * c * 2.0, z * b - w * a - y * c * 2.0, x * a + y * b],
    ]
}

/// The derivative of the acceleration by q: through the vertical in the body frame, `e = R(q)ᵀ e_z`.
#[inline(always)]
fn heavy<T: Real>(by_vertical: &[Vec3<f64>; 6], q: &Quaternion<T>) -> [[T; 4]; 6] {
    let [w, x, y, z] = each(q, |part| part * 2.0);
    let vertical = [[-y, z, -w, x], [x, w, z, y], [w.zero(), x * -2.0, y * -2.0, w.zero()]];
    let mut by_attitude = [[w.zero(); 4]; 6];
    for i in 0..6 {
        for j in 0..4 {
            for k in 0..3 {
                let factor = w.splat(by_vertical[i][k]);
                by_attitude[i][j] = vertical[k][j].mul_add(factor, by_attitude[i][j]);
            }
        }
    }
    by_attitude
}

/// The derivatives of a motion by the component `k` of a small turn in the body frame, `[1, ½ δ]`, before a step.
#[inline(always)]
fn turned<T: Real>(attitude: &Quaternion<T>, k: usize) -> Column<T> {
    let zero = attitude[0].zero();
    let (mut column, mut about) = ([zero; 13], [zero; 3]);
    about[k] = zero.splat(1.0);
    column[3..7].copy_from_slice(&quaternion_rate(attitude, &about));
    column
}
