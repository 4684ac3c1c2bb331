//! Singular values and left singular vectors of up to six rows, by one-sided Jacobi rotations: small values are
//! as accurate as large ones, relative to their rows.
//!
//! Source: Golub and Van Loan (2013), section 8.6.3. Tests: `tests/allocation/singular_values.rs`.

use crate::number::algebra::{Mat6, Vec6};
use crate::number::plain;

/// The singular values of the rows, descending, and as columns the directions that belong to them.
pub fn singular_values(rows: &[Vec<f64>; 6]) -> (Vec6<f64>, Mat6<f64>) {
    let mut rows = rows.clone();
    let mut turned: Mat6<f64> = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    for _ in 0..30 {
        let mut largest = 0.0_f64;
        for p in 0..5 {
            for q in p + 1..6 {
                let (a, b) = (product(&rows[p], &rows[p]), product(&rows[q], &rows[q]));
                let c = product(&rows[p], &rows[q]);
                if c == 0.0 || c.abs() <= 1e-16 * (a * b).sqrt() {
                    continue;
                }
                largest = largest.max(c.abs() / (a * b).sqrt());
                let zeta = (b - a) / (2.0 * c);
                let t = 1.0_f64.copysign(zeta) / (zeta.abs() + plain::hypot(zeta, 1.0));
                let cos = 1.0 / plain::hypot(t, 1.0);
                let sin = cos * t;
                for k in 0..rows[p].len() {
                    let (x, y) = (rows[p][k], rows[q][k]);
                    (rows[p][k], rows[q][k]) = (cos * x - sin * y, sin * x + cos * y);
                }
                for row in &mut turned {
                    (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
                }
            }
        }
        if largest < 1e-15 {
            break;
        }
    }
    let mut order = [0, 1, 2, 3, 4, 5];
    let size = rows.each_ref().map(|row| product(row, row).sqrt());
    order.sort_by(|&i, &j| size[j].total_cmp(&size[i]));
    (order.map(|i| size[i]), turned.map(|row| order.map(|i| row[i])))
}
