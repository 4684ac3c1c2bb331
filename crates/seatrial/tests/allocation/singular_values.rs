//! Singular values and directions of the rows of an allocation.

use seatrial::control::allocation::singular_values::singular_values;

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
