//! Wild samples are refused, and a filter that is wrong finds back.

use seatrial::filter::error_state::ErrorState;
use seatrial::filter::estimate::{POSITION, STATES};
use seatrial::filter::innovation::{FEWEST, Gate, Verdict, Watch};
use seatrial::filter::row::Row;
use seatrial::filter::transition::Transition;

const NORTH: [(usize, [f64; 3]); 1] = [(POSITION, [1.0, 0.0, 0.0])];

#[test]
fn law_an_outlier_moves_nothing() {
    let mut state = ErrorState::new(&[1.0; STATES]);
    let (before, mut watch, row) = (state.clone(), Watch::default(), Row::of(NORTH));
    for wild in [50.0, -1e300, f64::NAN, f64::INFINITY] {
        assert!(watch.judge(&mut state, &Gate::default(), (&row, wild, 0.01), (1.0, true)).refused);
    }
    assert_eq!(state.dense(), before.dense());
    assert_eq!(state.error, before.error);
    assert_eq!((watch.taken, watch.refused), (0.0, 4.0));
    assert!(watch.judge(&mut state, &Gate::default(), (&row, 0.5, 0.01), (1.1, true)).taken);
}

#[test]
fn a_sensor_that_is_refused_for_long_is_believed_again() {
    let mut state = ErrorState::new(&[0.1; STATES]);
    let (mut watch, row, gate) = (Watch::default(), Row::of(NORTH), Gate::default());
    let mut verdicts = Vec::new();
    for k in 0..100 {
        let time = 0.1 * f64::from(k);
        let residual = 30.0 - state.error[POSITION];
        // The error stays in `state.error`, so that the residual is against the first estimate.
        let residual = residual + state.error[POSITION];
        state.predict(&Transition::identity(0.0));
        verdicts.push(watch.judge(&mut state, &gate, (&row, residual, 0.01), (time, true)));
    }
    let recovered = verdicts.iter().position(|v: &Verdict<f64>| v.recovered).expect("it recovers");
    assert_eq!(recovered, 50, "after five seconds of refusals");
    assert!(verdicts[..recovered].iter().all(|v| v.refused));
    assert!(verdicts[recovered + 1..].iter().all(|v| v.taken));
    assert!((state.error[POSITION] - 30.0).abs() < 0.5, "{}", state.error[POSITION]);
    assert_eq!(watch.recovered, 1.0);
}

#[test]
fn a_good_sample_between_ends_the_wait() {
    let mut state = ErrorState::new(&[0.1; STATES]);
    let (mut watch, row, gate) = (Watch::default(), Row::of(NORTH), Gate::default());
    for k in 0..200 {
        let wild = if k % 10 == 0 { 0.0 } else { 30.0 };
        let residual = wild + state.error[POSITION];
        let verdict = watch.judge(&mut state, &gate, (&row, residual, 0.01), (0.1 * f64::from(k), true));
        assert!(!verdict.recovered);
    }
    assert_eq!(watch.refused, 180.0);
}

#[test]
fn a_slow_sensor_is_not_believed_after_two_wild_samples() {
    let mut state = ErrorState::new(&[0.1; STATES]);
    let (mut watch, row, gate) = (Watch::default(), Row::of(NORTH), Gate::default());
    let mut judged = |k: u32| watch.judge(&mut state, &gate, (&row, 30.0, 0.01), (10.0 * f64::from(k), true));
    assert!((0..FEWEST).all(|k| judged(k).refused));
    assert!(judged(FEWEST).recovered);
}

#[test]
fn silence_is_no_time_of_refusals() {
    let mut state = ErrorState::new(&[0.1; STATES]);
    let (mut watch, row, gate) = (Watch::default(), Row::of(NORTH), Gate::default());
    let mut judged = |time: f64| watch.judge(&mut state, &gate, (&row, 30.0, 0.01), (time, true));
    // A second of wild samples, a minute of nothing, and wild samples again: patience has four seconds left, less the two
    // periods of the silence that count.
    assert!((1..=10).all(|k| judged(0.1 * f64::from(k)).refused));
    let recovered = (0..100).find(|k| judged(61.0 + 0.1 * f64::from(*k)).recovered);
    assert_eq!(recovered, Some(39));
}
