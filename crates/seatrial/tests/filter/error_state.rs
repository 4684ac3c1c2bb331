//! Prediction and scalar update against dense matrix algebra, and a covariance that stays one for days.

use seatrial::filter::error_state::ErrorState;
use seatrial::filter::estimate::{ATTITUDE, CURRENT, GYRO_BIAS, POSITION, STATES, VELOCITY};
use seatrial::filter::row::Row;
use seatrial::filter::transition::{COLUMNS, MOTION, Transition};

type Matrix = Vec<Vec<f64>>;

/// A number in [-1, 1] that looks random.
pub fn noise(seed: usize) -> f64 {
    let x = (12.9898 * seed as f64 + 0.5).sin() * 43_758.547;
    2.0 * (x - x.floor()) - 1.0
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    let entry = |i: usize, j: usize| (0..b.len()).map(|k| a[i][k] * b[k][j]).sum();
    (0..a.len()).map(|i| (0..b[0].len()).map(|j| entry(i, j)).collect()).collect()
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len()).map(|j| a.iter().map(|row| row[j]).collect()).collect()
}

fn of<const N: usize>(rows: &[[f64; N]; N]) -> Matrix {
    rows.iter().map(|row| row.to_vec()).collect()
}

/// A covariance with every entry at work.
fn full(seed: usize) -> [[f64; STATES]; STATES] {
    let root: Matrix =
        (0..STATES).map(|i| (0..STATES).map(|j| noise(seed + i * STATES + j)).collect()).collect();
    let product = times(&root, &transposed(&root));
    std::array::from_fn(|i| std::array::from_fn(|j| product[i][j]))
}

fn transition(seed: usize) -> Transition {
    let mut step = Transition::identity(0.0);
    for i in 0..MOTION {
        for k in 0..COLUMNS {
            step.block[i][k] += 0.2 * noise(seed + 31 * i + k);
        }
    }
    step.drift = 0.1;
    for i in MOTION..STATES {
        step.decay[i] = 0.9 + 0.1 * noise(seed + i).abs();
    }
    step.noise = std::array::from_fn(|i| 0.1 + noise(seed + 77 * i).abs());
    step.gusts = seed.is_multiple_of(2);
    step.water = std::array::from_fn(|k| std::array::from_fn(|j| 0.1 * noise(seed + 5 * k + j)));
    step
}

/// Largest difference over the largest entry.
fn apart(a: &Matrix, b: &Matrix) -> f64 {
    let all = || a.iter().flatten().zip(b.iter().flatten());
    let largest = all().fold(0.0, |most: f64, (x, _)| most.max(x.abs()));
    all().fold(0.0, |most: f64, (x, y)| most.max((x - y).abs())) / largest
}

#[test]
fn law_a_prediction_is_the_dense_product() {
    for seed in [1, 500, 9000] {
        let step = transition(seed);
        let mut state = ErrorState::of(full(seed));
        let f = of(&step.dense());
        let mut expected = times(&times(&f, &of(&state.dense())), &transposed(&f));
        for i in 0..STATES {
            expected[i][i] += step.noise[i];
        }
        state.predict(&step);
        // Rounding of sums of 24 terms.
        assert!(apart(&expected, &of(&state.dense())) < 1e-14);
    }
}

#[test]
fn law_an_update_is_the_dense_joseph_form() {
    let row = Row::of([
        (POSITION, [0.3, -0.2, 0.9]),
        (ATTITUDE, [1.0, 0.4, -0.7]),
        (VELOCITY + 3, [0.2, 0.0, 0.1]),
        (CURRENT, [0.5, 0.5, 0.1]),
    ]);
    let dense = vec![row.derivatives().to_vec()];
    for seed in [3, 77] {
        let mut state = ErrorState::of(full(seed));
        state.error = std::array::from_fn(|i| 0.1 * noise(seed + 5 * i));
        let (p, before) = (of(&state.dense()), state.error);
        let (residual, variance) = (0.7, 0.25);
        let ph = times(&p, &transposed(&dense));
        let spread = times(&dense, &ph)[0][0] + variance;
        let innovation = state.innovation(&row, residual, variance);
        assert!((innovation.variance / spread - 1.0).abs() < 1e-14);
        assert!((innovation.value - (residual - row.times(&before))).abs() < 1e-14);
        let gain: Vec<f64> = ph.iter().map(|x| x[0] / spread).collect();
        let mut shrink: Matrix =
            (0..STATES).map(|i| (0..STATES).map(|j| -gain[i] * dense[0][j]).collect()).collect();
        for i in 0..STATES {
            shrink[i][i] += 1.0;
        }
        let mut expected = times(&times(&shrink, &p), &transposed(&shrink));
        for i in 0..STATES {
            for j in 0..STATES {
                expected[i][j] += gain[i] * variance * gain[j];
            }
        }
        state.update(&innovation, true);
        // Rounding of sums of 24 terms.
        assert!(apart(&expected, &of(&state.dense())) < 1e-14);
        for i in 0..STATES {
            assert!((state.error[i] - before[i] - gain[i] * innovation.value).abs() < 1e-14);
        }
    }
}

#[test]
fn law_scalars_of_one_vector_add_up_to_its_normalised_innovation() {
    let rows = [Row::of([(POSITION, [1.0, 0.2, 0.0])]), Row::of([(POSITION, [0.3, 1.0, 0.5])])];
    let (residual, variance) = ([0.8, -0.4], [0.2, 0.3]);
    let mut state = ErrorState::of(full(11));
    let p = state.dense();
    let spread = |a: &Row, b: &Row| (0..STATES).map(|i| a.derivatives()[i] * b.times(&p[i])).sum();
    let s: [[f64; 2]; 2] = std::array::from_fn(|i| std::array::from_fn(|j| spread(&rows[i], &rows[j])));
    let (a, b, d) = (s[0][0] + variance[0], s[0][1], s[1][1] + variance[1]);
    let [x, y] = residual;
    let whole = (d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b);
    let mut sum = 0.0;
    for i in 0..2 {
        let innovation = state.innovation(&rows[i], residual[i], variance[i]);
        sum += innovation.normalised_squared();
        state.update(&innovation, true);
    }
    assert!((sum / whole - 1.0).abs() < 1e-12, "{sum} {whole}");
}

#[test]
fn law_updates_one_after_the_other_are_those_one_by_one() {
    let mut waiting = ErrorState::of(full(23));
    let mut dense = of(&waiting.dense());
    for k in 0..11 {
        let part = |seed: usize| std::array::from_fn(|i| noise(40 * k + seed + i));
        let row = Row::of([(3 * (k % 4), part(0)), (CURRENT, part(3))]);
        let variance = 0.1 + noise(7 * k).abs();
        let h = vec![row.derivatives().to_vec()];
        let cross = times(&dense, &transposed(&h));
        let spread = times(&h, &cross)[0][0] + variance;
        let innovation = waiting.innovation(&row, 0.3, variance);
        assert!((innovation.variance / spread - 1.0).abs() < 1e-12, "scalar {k}");
        // A scalar that is refused changes nothing.
        waiting.update(&innovation, k != 4);
        for i in (0..STATES).filter(|_| k != 4) {
            for j in 0..STATES {
                dense[i][j] -= cross[i][0] * cross[j][0] / spread;
            }
        }
        assert!(apart(&dense, &of(&waiting.dense())) < 1e-13, "scalar {k}");
    }
}

#[test]
fn law_the_covariance_stays_positive_over_days() {
    // Exact sensors on some components, none on others: the worst case for rounding.
    let mut state = ErrorState::new(&[1e3; STATES]);
    let mut step = Transition::identity(0.0);
    step.drift = 0.1;
    for i in 0..3 {
        step.block[i][ATTITUDE + i] = 0.1;
        step.block[ATTITUDE + i][6 + i] = 0.1;
    }
    step.noise = std::array::from_fn(|i| if i < VELOCITY { 0.0 } else { 1e-9 });
    let rows = [
        (Row::of([(VELOCITY, [1.0, 0.0, 0.0]), (CURRENT, [1.0, 0.0, 0.0])]), 1e-12),
        (Row::of([(ATTITUDE, [0.0, 0.0, 1.0])]), 1e-10),
        (Row::of([(VELOCITY + 3, [0.0, 0.0, 1.0]), (GYRO_BIAS, [0.0, 0.0, 1.0])]), 1e-12),
    ];
    for k in 0..200_000 {
        state.predict(&step);
        let (row, variance) = &rows[k % rows.len()];
        let innovation = state.innovation(row, 0.0, *variance);
        assert!(innovation.variance > 0.0, "step {k}");
        state.update(&innovation, true);
    }
    // Cholesky with pivots relative to the diagonal.
    let (p, n) = (state.dense(), STATES);
    let mut l = [[0.0; STATES]; STATES];
    for j in 0..n {
        let pivot = p[j][j] - (0..j).map(|k| l[j][k] * l[j][k]).sum::<f64>();
        assert!(pivot > -1e-12 * p[j][j], "component {j}: {pivot}");
        l[j][j] = pivot.max(1e-300).sqrt();
        for i in j + 1..n {
            l[i][j] = (p[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>()) / l[j][j];
        }
    }
}
