//! Vectors of three, matrices of three and six: what the equations of motion need, and no more.
//!
//! Tests: `tests/laws.rs` (the inverse inverts, for every set of free axes).

use crate::number::real::Real;

/// A vector in space.
pub type Vec3<T> = [T; 3];
/// A generalised vector: force and moment, or linear and angular velocity.
pub type Vec6<T> = [T; 6];
/// A 3×3 matrix by rows.
pub type Mat3<T> = [[T; 3]; 3];
/// A 6×6 matrix by rows.
pub type Mat6<T> = [[T; 6]; 6];

/// `a × b`.
#[inline(always)]
pub fn cross<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[1].mul_sub(b[2], a[2] * b[1]), a[2].mul_sub(b[0], a[0] * b[2]), a[0].mul_sub(b[1], a[1] * b[0])]
}

/// `c + a × b`.
#[inline(always)]
pub fn add_cross<T: Real>(a: &Vec3<T>, b: &Vec3<T>, c: &Vec3<T>) -> Vec3<T> {
    [
        a[1].mul_add(b[2], a[2].neg_mul_add(b[1], c[0])),
        a[2].mul_add(b[0], a[0].neg_mul_add(b[2], c[1])),
        a[0].mul_add(b[1], a[1].neg_mul_add(b[0], c[2])),
    ]
}

/// `f` of every component. (The standard `map`, and `clone`, of an array are not inlined for wide numbers, which costs
/// dual numbers and the closed loop a tenth of their speed.)
#[inline(always)]
pub fn each<T: Real, const N: usize>(a: &[T; N], f: impl Fn(T) -> T) -> [T; N] {
    let mut b = *a;
    for i in 0..N {
        b[i] = f(a[i]);
    }
    b
}

/// The numbers in the kind of `unit`.
#[inline(always)]
pub fn splat<T: Real, const N: usize>(unit: T, numbers: &[f64; N]) -> [T; N] {
    let mut all = [unit; N];
    for i in 0..N {
        all[i] = unit.splat(numbers[i]);
    }
    all
}

/// `a · b`.
#[inline(always)]
pub fn dot<T: Real, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    let mut sum = a[0] * b[0];
    for i in 1..N {
        sum = a[i].mul_add(b[i], sum);
    }
    sum
}

/// `A x`.
#[inline(always)]
pub fn product<T: Real, const N: usize, const M: usize>(a: &[[T; M]; N], x: &[T; M]) -> [T; N] {
    let mut y = [x[0]; N];
    for i in 0..N {
        y[i] = dot(&a[i], x);
    }
    y
}

/// `Aᵀ x`.
#[inline(always)]
pub fn transposed_product<T: Real>(a: &Mat3<T>, x: &Vec3<T>) -> Vec3<T> {
    let mut y = [x[0]; 3];
    for i in 0..3 {
        y[i] = a[2][i].mul_add(x[2], a[1][i].mul_add(x[1], a[0][i] * x[0]));
    }
    y
}

/// `S(a)`, with `S(a) b = a × b`.
#[inline(always)]
pub fn skew<T: Real>(a: &Vec3<T>) -> Mat3<T> {
    let o = a[0].zero();
    [[o, -a[2], a[1]], [a[2], o, -a[0]], [-a[1], a[0], o]]
}

/// The inverse of the symmetric positive definite `m` restricted to the `free` axes, zero in the
/// rows and columns of the others, by Cholesky factors.
///
/// Where the restriction is not positive definite the result is not a number: a candidate with
/// such a mass matrix costs infinity.
#[inline(always)]
pub fn restricted_inverse<T: Real>(m: &Mat6<T>, free: &[bool; 6]) -> Mat6<T> {
    let (zero, one) = (m[0][0].zero(), m[0][0].splat(1.0));
    // L of m = L Lᵀ, where the other axes are replaced by the identity.
    let mut l = [[zero; 6]; 6];
    for j in 0..6 {
        for i in j..6 {
            let mut s = match (i == j, free[i] && free[j]) {
                (_, true) => m[i][j],
                (true, false) => one,
                (false, false) => zero,
            };
            for k in 0..j {
                s = l[i][k].neg_mul_add(l[j][k], s);
            }
            l[i][j] = if i == j { s.sqrt() } else { s / l[j][j] };
        }
    }
    // K = L⁻¹, then m⁻¹ = Kᵀ K.
    let mut k = [[zero; 6]; 6];
    for j in 0..6 {
        k[j][j] = one / l[j][j];
        for i in j + 1..6 {
            let mut s = zero;
            for n in j..i {
                s = l[i][n].neg_mul_add(k[n][j], s);
            }
            k[i][j] = s / l[i][i];
        }
    }
    let mut inverse = [[zero; 6]; 6];
    for i in 0..6 {
        for j in 0..6 {
            if free[i] && free[j] {
                let mut s = zero;
                for n in i.max(j)..6 {
                    s = k[n][i].mul_add(k[n][j], s);
                }
                inverse[i][j] = s;
            }
        }
    }
    inverse
}

/// The pivots of the Cholesky factorisation: all positive exactly when `m` is positive definite.
pub fn pivots(m: &Mat6<f64>) -> Vec6<f64> {
    let mut l = [[0.0; 6]; 6];
    let mut pivots = [0.0; 6];
    for j in 0..6 {
        pivots[j] = m[j][j] - (0..j).map(|k| l[j][k] * l[j][k]).sum::<f64>();
        for i in j..6 {
            let s: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = (m[i][j] - s) / pivots[j].abs().sqrt();
        }
    }
    pivots
}
