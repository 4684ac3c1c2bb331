//! Many cases: a case is a function of itself alone, and lanes fly as plain numbers do.

use crate::closed_loop::flights::{DIVE, Trip, case, column, fault};
use seatrial::control::autopilot::settings::tunable_index;
use seatrial::control::navigation::{ChannelErrors, GroupTiming, Outage};
use seatrial::flight::batch::{Case, Outcome};
use seatrial::flight::waves::Sea;

/// CWolf with sensors that err, are late and drop out.
pub fn trip() -> Trip {
    let mut trip = Trip::cwolf(DIVE);
    trip.seconds = 120.0;
    for channel in &mut trip.sensors.errors[..12] {
        *channel = ChannelErrors { noise: 0.005, bias: 0.002, ..ChannelErrors::default() };
    }
    trip.sensors.timing[0] = GroupTiming { every: 10, latency: 3, ..GroupTiming::default() };
    trip.sensors.timing[3] = GroupTiming { dropout_every: 30.0, dropout: 2.0, ..GroupTiming::default() };
    trip
}

/// Cases that differ in everything, so that every lane takes its own branches.
pub fn cases(trip: &Trip) -> (Vec<Case>, Vec<usize>, Vec<usize>) {
    let drag = trip.description.layout.find("X_uu").expect("known");
    let gain = tunable_index("heading.K_P.4").expect("known");
    let cases = (0..11).map(|k| {
        let share = f64::from(k) / 10.0;
        let mut one = case([0.1 * share, 0.4 * share - 0.2, 0.0]);
        one.coefficients = vec![-9.781 * (0.8 + 0.4 * share)];
        one.tunables = vec![25.0 + 15.0 * share];
        one.seed = k as u64;
        one.turbulence = [0.05 * share, 0.05 * share, 0.01 * share];
        if k % 3 == 2 {
            one.sea = Sea { height: 0.5, period: 5.0 + share, toward: share, ..Sea::CALM };
            one.current_walk = [0.002, 0.001, 0.0];
            one.current_trend = [1e-4, 0.0, 0.0];
        }
        if k % 4 == 2 {
            let from = 10.0 * f64::from(k);
            one.outages = vec![Outage { group: 3, from, until: from + 5.0 }];
        }
        one.state.nu[0] = share;
        if k % 3 == 1 {
            one.faults = vec![fault(trip, "SbU", 20.0 + 5.0 * f64::from(k), Some(0.0))];
        }
        one
    });
    (cases.collect(), vec![drag], vec![gain])
}

/// Position and heading of a flight in one row.
pub fn course(trip: &Trip, outcome: &Outcome) -> Vec<f64> {
    ["x", "y", "z", "yaw"].into_iter().flat_map(|c| column(trip, outcome, c)).collect()
}

#[test]
fn scalar_closed_loop_cases_do_not_know_their_neighbours() {
    let trip = trip();
    let (all, coefficients, tunables) = cases(&trip);
    let together = trip.fly_with(&all, &coefficients, &tunables);
    // Another batch, other lanes: bit for bit the same.
    let others = trip.fly_with(&all[3..], &coefficients, &tunables);
    for (a, b) in together[3..].iter().zip(&others) {
        assert_eq!(course(&trip, a), course(&trip, b));
        assert_eq!(a.summary.cross_track, b.summary.cross_track);
    }
}

#[test]
fn scalar_closed_loop_lanes_fly_as_plain_numbers() {
    let trip = trip();
    let (all, coefficients, tunables) = cases(&trip);
    let together = trip.fly_with(&all, &coefficients, &tunables);
    for (k, lane) in together.iter().enumerate() {
        let alone = trip.fly_with(&all[k..=k], &coefficients, &tunables).remove(0);
        let (a, b) = (course(&trip, lane), course(&trip, &alone));
        assert_eq!(a.len(), b.len());
        let apart = a.iter().zip(&b).fold(0.0, |worst: f64, (x, y)| worst.max((x - y).abs()));
        // Lanes fuse operations; the closed loop damps what that changes.
        assert!(apart < 1e-7, "case {k}: {apart:.1e}");
        let energy = (lane.summary.energy / alone.summary.energy - 1.0).abs();
        assert!(energy < 1e-7, "case {k}: {energy:.1e} of {} J", alone.summary.energy);
        assert_eq!(lane.summary.ending, alone.summary.ending);
    }
}

/// A lane without dead time obeys at once, also beside one that waits.
#[test]
fn scalar_closed_loop_dead_times_do_not_know_their_neighbours() {
    let autopilot = seatrial::control::autopilot::settings::built_in("bluerov2-heavy").expect("built in");
    let mut trip =
        Trip::of("bluerov2-heavy", autopilot, &DIVE.replace("1.5", "0.5").replace("120.0", "10.0"));
    trip.seconds = 30.0;
    let late: Vec<usize> = (0..trip.description.actuators.len())
        .map(|k| {
            trip.description
                .layout
                .find(&format!("{}.T_t", trip.description.actuators[k].name))
                .expect("known")
        })
        .collect();
    let one = |t_t: f64| Case { coefficients: vec![t_t; late.len()], ..case([0.0, 0.1, 0.0]) };
    let among_equals = trip.fly_with(&[one(0.0), one(0.0)], &late, &[]);
    let beside_late = trip.fly_with(&[one(0.0), one(0.1)], &late, &[]);
    assert_eq!(course(&trip, &among_equals[0]), course(&trip, &beside_late[0]));
    assert_ne!(course(&trip, &beside_late[0]), course(&trip, &beside_late[1]), "the dead time acts");
}

/// A case that diverges is not a number in its figures, ends its log there, and leaves its neighbours alone.
#[test]
fn law_closed_loop_divergence_is_not_a_number() {
    let trip = trip();
    let drag = trip.description.layout.find("N_rr").expect("known");
    let one = |n_rr: f64| Case { coefficients: vec![n_rr], ..case([0.0; 3]) };
    let usual = trip.fly_with(&[one(-150.0), one(-150.0)], &[drag], &[]);
    let mixed = trip.fly_with(&[one(-150.0), one(1e9)], &[drag], &[]);
    let summary = &mixed[1].summary;
    let none = [summary.ending, summary.duration, summary.switches];
    assert!(none.iter().all(|x| x.is_nan()), "{summary:?}");
    assert_eq!(summary.waypoints, 0.0);
    assert!(mixed[1].log.rows < usual[1].log.rows);
    assert!(column(&trip, &mixed[1], "x").iter().all(|x| x.is_finite()));
    assert_eq!(course(&trip, &mixed[0]), course(&trip, &usual[0]));
}

/// The log of what diverged has sound rows alone, abreast and by itself.
#[test]
fn law_closed_loop_logs_of_what_diverged_end_alike() {
    let trip = trip();
    let drag = trip.description.layout.find("N_rr").expect("known");
    let one = Case { coefficients: vec![1e9], ..case([0.0; 3]) };
    let abreast = trip.fly_with(&[one.clone(), one.clone()], &[drag], &[]).remove(0);
    let alone = trip.fly_with(&[one], &[drag], &[]).remove(0);
    assert_eq!(alone.log.rows, abreast.log.rows);
    for outcome in [abreast, alone] {
        assert!(outcome.summary.duration.is_nan());
        assert!(column(&trip, &outcome, "yaw").iter().all(|x| x.is_finite()));
    }
}
