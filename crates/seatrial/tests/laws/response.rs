//! The exact response of a motor against its differential equation and against the chain in steps.

use proptest::prelude::*;
use seatrial::actuator::motor::{Limits, Motor};
use seatrial::actuator::response::{Dynamics, Response};

const FREE: Limits = Limits { maximum: [f64::INFINITY; 2], minimum: [0.0; 2], dead_band: false };

fn both(rate: f64) -> [f64; 2] {
    [rate; 2]
}

fn dynamics() -> impl Strategy<Value = Dynamics> {
    (0.5..1.5, 0.02..0.6, 0.0..0.4, [500.0..6000.0, 500.0..6000.0], [500.0..6000.0, 500.0..6000.0])
        .prop_map(|(k_v, t_1, t_t, growth, shrink)| Dynamics { k_v, t_1, t_t, growth, shrink })
}

properties! {
    #![cases(64)]

    #[test]
    fn law_response_is_where_the_steps_tend_to(
        mut dynamics in dynamics(),
        commands in proptest::collection::vec(-2000.0..2000.0, 8),
        dead_band in any::<bool>(),
    ) {
        (dynamics.t_t, dynamics.growth[1], dynamics.shrink[1]) = (0.0, dynamics.growth[0], dynamics.shrink[0]);
        let limits = Limits { maximum: [1800.0, 1500.0], minimum: [150.0, 200.0], dead_band };
        let t: Vec<f64> = (0..8).map(|k| 0.3 * f64::from(k)).collect();
        let response = Response::new(&t, &commands, &limits, dynamics);
        let apart = |steps: usize| {
            let motor = Motor {
                k_v: dynamics.k_v,
                t_1: dynamics.t_1,
                t_t: 0.0,
                rate: Some([dynamics.growth[0], dynamics.shrink[0]]),
                ideal: false,
            };
            let h = 0.3 / steps as f64;
            let step = motor.step(h);
            let mut state = motor.steady(limits.apply(commands[0]));
            let mut worst = 0.0_f64;
            for (k, command) in commands.iter().enumerate() {
                for s in 0..steps {
                    let exact = response.at(t[k] + s as f64 * h);
                    worst = worst.max((state.signal - exact).abs());
                    state = step.advance(&state, limits.apply(*command));
                }
            }
            worst
        };
        // The kink of a ramp lies within a step: an error of first order there, up to rate × h²/(8 T_1).
        let bound = |steps: f64| dynamics.k_v * 6000.0 * (0.3 / steps) * (0.3 / steps) / (8.0 * dynamics.t_1);
        prop_assert!(apart(60) <= 8.0 * bound(60.0), "{} {}", apart(60), bound(60.0));
        prop_assert!(apart(960) <= 8.0 * bound(960.0), "{} {}", apart(960), bound(960.0));
    }

    #[test]
    fn law_response_obeys_the_lag(dynamics in dynamics(), commands in proptest::collection::vec(-2000.0..2000.0, 6), at in 0.1..2.5) {
        let t: Vec<f64> = (0..6).map(|k| 0.4 * f64::from(k)).collect();
        let lagging = Response::new(&t, &commands, &FREE, dynamics);
        let input = Response::new(&t, &commands, &FREE, Dynamics { k_v: 1.0, t_1: 0.0, ..dynamics });
        let h = 1e-5;
        let kinked = (input.at(at + h) - 2.0 * input.at(at) + input.at(at - h)).abs() > 1e-6;
        prop_assume!(!kinked);
        let slope = (lagging.at(at + h) - lagging.at(at - h)) / (2.0 * h);
        // Central difference of up to 6e3/s over 1e-5 s with third derivatives up to 3e3/T_1³ … 4e8, and rounding.
        prop_assert!((dynamics.t_1 * slope + lagging.at(at) - dynamics.k_v * input.at(at)).abs() < 1e-2);
    }

    #[test]
    fn law_response_dead_time_is_a_shift(dynamics in dynamics(), late in 0.0..0.5, at in 0.6..3.0) {
        let (t, commands) = ([0.0, 0.5, 1.1], [0.0, 1500.0, -900.0]);
        let prompt = Response::new(&t, &commands, &FREE, dynamics);
        let delayed = Response::new(&t, &commands, &FREE, Dynamics { t_t: dynamics.t_t + late, ..dynamics });
        // Rounding of 1500 rpm with slopes up to 6000 rpm/s × 1e-15 s.
        prop_assert!((prompt.at(at - late) - delayed.at(at)).abs() < 1e-9);
    }
}

#[test]
fn law_response_brakes_with_one_direction_and_grows_with_the_other() {
    let dynamics =
        Dynamics { k_v: 1.0, t_1: 0.0, t_t: 0.1, growth: [1000.0, 500.0], shrink: [2000.0, 4000.0] };
    let response = Response::new(&[0.0, 1.0, 3.0], &[1000.0, -600.0, 0.0], &FREE, dynamics);
    let expected = [
        (0.0, 1000.0),   // settled before the record
        (1.1, 1000.0),   // the dead time
        (1.35, 500.0),   // brakes at 2000 rpm/s
        (1.6, 0.0),      // reaches zero after 0.5 s
        (2.6, -500.0),   // grows astern at 500 rpm/s
        (2.9, -600.0),   // is there after 1.2 s
        (3.175, -300.0), // shrinks astern at 4000 rpm/s
        (9.0, 0.0),
    ];
    for (t, n) in expected {
        // Rounding of 1000 rpm.
        assert!((response.at(t) - n).abs() < 1e-9, "{t} s: {} {n}", response.at(t));
    }
}

#[test]
fn law_response_without_limits_is_the_step_response() {
    let free =
        Dynamics { k_v: 0.9, t_1: 0.2, t_t: 0.05, growth: both(f64::INFINITY), shrink: both(f64::INFINITY) };
    let response = Response::new(&[0.0, 1.0], &[0.0, 800.0], &FREE, free);
    for k in 0..40 {
        let t = 1.05 + 0.05 * f64::from(k);
        let expected = 0.9 * 800.0 * (1.0 - (-(t - 1.05) / 0.2).exp());
        // Rounding of 720 rpm.
        assert!((response.at(t) - expected).abs() < 1e-10, "{t}");
    }
    assert!(Response::new(&[], &[], &FREE, free).at(0.0).is_nan());
}
