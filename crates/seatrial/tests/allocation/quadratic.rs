//! The bounded quadratic programme against its conditions of optimality.

use crate::allocation::setup::Setup;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use seatrial::control::allocation::pseudo_inverse::{LAMBDA, PseudoInverse};
use seatrial::control::allocation::quadratic_programme::QuadraticProgramme;
use seatrial::control::allocation::redistribution::Shares;
use seatrial::number::algebra::Vec6;

/// The gradient of ½ |H g − t|² + ½ λ |g|².
fn gradient(p: &PseudoInverse<f64>, target: &Vec6<f64>, g: &[f64]) -> Vec<f64> {
    let mut miss = target.map(|t| -t);
    for (column, g) in p.columns.iter().zip(g) {
        (0..6).for_each(|i| miss[i] += column[i] * g);
    }
    let each = p.columns.iter().zip(g);
    each.map(|(column, g)| LAMBDA * g + (0..6).map(|i| column[i] * miss[i]).sum::<f64>()).collect()
}

prop_compose! {
    fn problem()(
        count in 3_usize..=12,
        columns in proptest::collection::vec(proptest::array::uniform6(-1.0..1.0_f64), 12),
        bounds in proptest::collection::vec((-1.0..0.0_f64, 0.0..1.0_f64), 12),
        tau in proptest::array::uniform6(-6.0..6.0_f64),
        rows in proptest::array::uniform6(prop_oneof![Just(1.0), Just(1.0), Just(0.0)]),
    ) -> (PseudoInverse<f64>, Vec6<f64>, Shares<f64>) {
        let mut p = PseudoInverse::new(count, 0.0);
        p.effort.fill(1.0);
        p.update(&rows, &[1.0; 6], |k| columns[k]);
        let target = p.scaled(&tau);
        let y = p.solve(&target);
        let mut shares = Shares::new(count, 0.0);
        for k in 0..count {
            shares.share[k] = p.share(k, &y);
            (shares.lowest[k], shares.highest[k]) = bounds[k];
        }
        (p, target, shares)
    }
}

properties! {
    #![cases(512)]

    #[test]
    fn law_quadratic_programme_is_optimal((p, target, mut shares) in problem()) {
        let start = shares.clone();
        let mut programme = QuadraticProgramme::default();
        programme.solve(&p, &target, &mut shares);
        let g = &shares.share;
        if start.outside(0.0) == 0.0 {
            prop_assert_eq!(g, &start.share);
            return Ok(());
        }
        let slope = gradient(&p, &target, g);
        for k in 0..g.len() {
            prop_assert!(shares.lowest[k] <= g[k] && g[k] <= shares.highest[k]);
            // The multipliers are known to rounding, 2e-16, over λ = 1e-8 of sums of up to 100: some 1e-6.
            let least = 1e-5 * slope.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
            prop_assert!(slope[k] > -least || g[k] == shares.highest[k], "{k}: {slope:?}");
            prop_assert!(slope[k] < least || g[k] == shares.lowest[k], "{k}: {slope:?}");
        }
        // The same again: the active set is known.
        let answer = shares.share.clone();
        let mut again = start.clone();
        programme.solve(&p, &target, &mut again);
        prop_assert_eq!(programme.iterations(), 1);
        for (a, b) in answer.iter().zip(&again.share) {
            // The condition of the equations, 1/lambda at worst.
            prop_assert!((a - b).abs() < 1e-6, "{answer:?} {:?}", again.share);
        }
    }

    #[test]
    fn law_quadratic_programme_never_misses_more_than_clipping((p, target, mut shares) in problem()) {
        let value = |g: &[f64]| {
            let mut miss = target;
            for (column, g) in p.columns.iter().zip(g) {
                (0..6).for_each(|i| miss[i] -= column[i] * g);
            }
            miss.iter().map(|x| x * x).sum::<f64>() + LAMBDA * g.iter().map(|x| x * x).sum::<f64>()
        };
        let mut clipped = shares.clone();
        clipped.clip();
        let mut redistributed = shares.clone();
        redistributed.redistribute(&p, &target, 2);
        QuadraticProgramme::default().solve(&p, &target, &mut shares);
        // Rounding of values of up to 100.
        prop_assert!(value(&shares.share) <= value(&redistributed.share) + 1e-12);
        prop_assert!(value(&shares.share) <= value(&clipped.share) + 1e-12);
    }
}

#[test]
fn law_quadratic_programme_is_the_pseudo_inverse_within_the_bounds() {
    let mut one = Setup::smooth("cwolf", "");
    let mut other = Setup::smooth("cwolf", "method = \"quadratic\"");
    let tau = [60.0, 0.0, 5.0, 0.0, -3.0, 8.0];
    let nu_r = [1.2, 0.0, 0.05, 0.0, 0.0, 0.0];
    assert_eq!(one.allocate(&tau, &nu_r), other.allocate(&tau, &nu_r));
    assert_eq!(one.signals, other.signals);
}

#[test]
fn law_quadratic_programme_keeps_to_its_iterations() {
    let mut worst = 0;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    for _ in 0..2000 {
        let (p, target, mut shares) = problem().new_tree(&mut runner).unwrap().current();
        let mut programme = QuadraticProgramme::default();
        programme.solve(&p, &target, &mut shares);
        worst = worst.max(programme.iterations());
        assert!(programme.iterations() < 4 * shares.share.len(), "{}", programme.iterations());
    }
    println!("most equations solved: {worst}");
}
