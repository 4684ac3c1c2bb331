//! Motors that are played once per record do what they do in every flight.

use crate::scalars::flights::{Flights, NAMES};
use seatrial::fit::record::MotorStart;

#[test]
fn scalar_motors_played_once_are_the_motors_of_every_flight() {
    for name in NAMES {
        let mut flights = Flights::disturbed(name);
        flights.segments.retain(|segment| matches!(segment.motors, MotorStart::Recorded));
        let motor = |&index: &usize| {
            let name = flights.description.layout.name(index);
            ["K_V", "T_1", "T_t", "n_acc", "n_dec"].iter().any(|of| name.ends_with(&format!(".{of}")))
        };
        let kept: Vec<bool> = flights.sought.iter().map(|index| !motor(index)).collect();
        let mut keep = kept.iter();
        flights.sought.retain(|_| *keep.next().expect("one per coefficient"));
        let mut keep = kept.iter();
        flights.values.retain(|_| *keep.next().expect("one per coefficient"));
        let unknowns = flights.unknowns();
        let bits = |flights: &Flights| -> Vec<u64> {
            let shown = flights.sensitivities(&unknowns, &[0, 5, 9]);
            let numbers = shown.iter().flat_map(|p| p.rows.as_flattened().iter().chain(&p.jacobian));
            numbers.map(|x| x.to_bits()).collect()
        };
        let expected = bits(&flights);
        let mut record = flights.records[0].clone();
        record.play(&flights.description, &flights.sought, 2);
        assert!(record.played.is_some());
        flights.records = vec![record];
        // Bit by bit: the record is shorter than the motors' warm-up, so that both run from its beginning.
        assert_eq!(bits(&flights), expected, "{name}");
    }
}

#[test]
fn scalar_motors_are_not_played_where_their_coefficients_are_sought() {
    let mut flights = Flights::new("cwolf");
    let (description, sought) = (&flights.description, &flights.sought);
    flights.records[0].play(description, sought, 2);
    assert!(flights.records[0].played.is_none());
}
