//! Singular values and left singular vectors of up to six rows, by one-sided Jacobi rotations: small values are
//! as accurate as large ones, relative to their rows.
//!
//! Source: Golub and Van Loan (2013), section 8.6.3. Tests: in this file.

use crate::number::algebra::{Mat6, Vec6};

/// The singular values of the rows, descending, and as columns the directions that belong to them.
pub(super) fn singular_values(rows: &[Vec<f64>; 6]) -> (Vec6<f64>, Mat6<f64>) {
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
                let t = 1.0_f64.copysign(zeta) / (zeta.abs() + zeta.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_vectors_rebuild_the_gram_matrix() {
        let rows: [Vec<f64>; 6] =
            std::array::from_fn(|i| (0..8).map(|k| ((3 * i + 7 * k * (i + 1)) % 11) as f64 - 5.0).collect());
        let (sigma, u) = singular_values(&rows);
        for i in 0..6 {
            for j in 0..6 {
                let gram: f64 = rows[i].iter().zip(&rows[j]).map(|(x, y)| x * y).sum();
                let rebuilt: f64 = (0..6).map(|k| u[i][k] * sigma[k] * sigma[k] * u[j][k]).sum();
                // Rounding of sums of up to 200.
                assert!((gram - rebuilt).abs() < 1e-11, "{i} {j}: {gram} {rebuilt}");
            }
        }
        assert!(sigma.windows(2).all(|pair| pair[0] >= pair[1]));
    }

    #[test]
    fn a_repeated_row_is_one_direction() {
        let row = vec![1.0, 2.0, -1.0];
        let mut rows: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; 3]);
        (rows[1], rows[4]) = (row.clone(), row.iter().map(|x| 2.0 * x).collect());
        let (sigma, u) = singular_values(&rows);
        // Rounding.
        assert!((sigma[0] - 30.0_f64.sqrt()).abs() < 1e-14 && sigma[1] < 1e-15, "{sigma:?}");
        assert!((u[4][0].abs() - (0.8_f64).sqrt()).abs() < 1e-14);
    }
}
