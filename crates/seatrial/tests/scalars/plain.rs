//! The elementary functions of one `f64`: near the platform's, and the same bits on every machine.

use proptest::prelude::*;
use seatrial::number::plain;
use seatrial::number::real::Real;

/// Units in the last place between two finite numbers.
fn ulp(a: f64, b: f64) -> u64 {
    let ordered = |x: f64| {
        let bits = x.to_bits().cast_signed();
        if bits < 0 { i64::MIN - bits } else { bits }
    };
    ordered(a).abs_diff(ordered(b))
}

properties! {
    #![cases(20_000)]

    // Both are below 1 unit in the last place of the true value, so that one lies between them at most.
    #[test]
    fn law_plain_functions_are_those_of_the_platform_but_for_a_bit(
        angle in -1e5..1e5_f64,
        small in -1.5..1.5_f64,
        power in -700.0..700.0_f64,
        positive in 1e-300..1e3_f64,
        other in -50.0..50.0_f64,
    ) {
        let pairs = [
            (plain::sin(angle), angle.sin()),
            (plain::cos(angle), angle.cos()),
            (plain::sin(small), small.sin()),
            (plain::cos(small), small.cos()),
            (plain::acos(small / 1.5), (small / 1.5).acos()),
            (plain::atan2(small, other), small.atan2(other)),
            (plain::atan2(angle, other), angle.atan2(other)),
            (plain::exp(power), power.exp()),
            (plain::exp(small), small.exp()),
            (plain::ln(positive), positive.ln()),
            (plain::ln(1.0 + 1e-3 * small), (1.0 + 1e-3 * small).ln()),
            (plain::log10(positive), positive.log10()),
            (plain::hypot(small, other), small.hypot(other)),
            (plain::powf(positive, small), positive.powf(small)),
            (plain::tan(small), small.tan()),
        ];
        for (k, (found, expected)) in pairs.into_iter().enumerate() {
            // The arctangent of two numbers rounds their quotient first.
            let most = if k == 5 || k == 6 || k == 11 { 2 } else { 1 };
            prop_assert!(ulp(found, expected) <= most, "function {k}: {found:e} against {expected:e}");
        }
    }

    #[test]
    fn law_whole_powers_are_products(x in -30.0..30.0_f64) {
        prop_assert_eq!(plain::powi(x, 0), 1.0);
        prop_assert_eq!(plain::powi(x, 2), x * x);
        prop_assert_eq!(plain::powi(x, 3), x * (x * x));
        prop_assert_eq!(plain::powi(x, -4), 1.0 / ((x * x) * (x * x)));
    }
}

#[test]
fn law_extremes_have_a_sign_of_zero_and_leave_out_what_is_no_number() {
    for (a, b) in [(0.0, -0.0), (-0.0, 0.0)] {
        assert_eq!(Real::min(a, b).to_bits(), f64::to_bits(a));
        assert_eq!(Real::max(a, b).to_bits(), f64::to_bits(a));
    }
    assert_eq!((Real::min(f64::NAN, 2.0), Real::min(2.0, f64::NAN)), (2.0, 2.0));
    assert_eq!((Real::max(f64::NAN, 2.0), Real::max(2.0, f64::NAN)), (2.0, 2.0));
    assert_eq!((Real::min(3.0, 2.0), Real::max(3.0, 2.0)), (2.0, 3.0));
}

/// The bits of a function at 100,000 places, folded into a word.
fn folded(f: impl Fn(f64) -> f64, from: f64, to: f64) -> u64 {
    let count = 100_000;
    let at = |k: i32| f(from + (to - from) * (f64::from(k) + 0.5) / f64::from(count));
    // The hash of Fowler, Noll and Vo, a word at a time.
    (0..count).fold(0xcbf2_9ce4_8422_2325, |sum, k| (sum ^ at(k).to_bits()).wrapping_mul(0x0100_0000_01b3))
}

/// Frozen on x86-64: another processor or compiler that differs in one bit of any of them fails here.
#[test]
fn golden_plain_functions_have_the_same_bits_on_every_machine() {
    let found = [
        folded(plain::sin, -400.0, 400.0),
        folded(plain::cos, -400.0, 400.0),
        folded(plain::acos, -1.0, 1.0),
        folded(|x| plain::atan2(x, 0.7), -30.0, 30.0),
        folded(|x| plain::atan2(0.7, x), -30.0, 30.0),
        folded(plain::exp, -40.0, 40.0),
        folded(plain::ln, 0.0, 50.0),
        folded(plain::log10, 0.0, 1e7),
        folded(|x| plain::hypot(x, 0.7), -30.0, 30.0),
        folded(|x| plain::powf(x, 1.3), 0.0, 30.0),
        folded(|x| plain::powi(x, -5), 0.1, 3.0),
    ];
    let words = found.map(|word| format!("{word:016x}"));
    assert_eq!(words, GOLDEN);
}

const GOLDEN: [&str; 11] = [
    "dc329aac11a2fede",
    "561a19bc2ec59241",
    "722d8a400103a35d",
    "9230d9159253fde4",
    "f225204cda2b4b58",
    "e496e069da91ffc7",
    "ab3229d0be02f053",
    "61a0522134046ccc",
    "de647272ee63a77c",
    "7ab9349cc3e196c5",
    "f8bac3e8936c3960",
];
