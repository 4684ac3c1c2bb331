//! Flights to test with, and what every flight obeys.

use crate::vehicles::load;
use seatrial::control::autopilot::settings::{Settings, built_in};
use seatrial::control::navigation::{Seabed, Sensors};
use seatrial::description::Description;
use seatrial::flight::Flight;
use seatrial::flight::acoustics::Acoustics;
use seatrial::flight::batch::{Case, Cases, Outcome};
use seatrial::flight::case::SURFACE;
use seatrial::flight::faults::ActuatorFault;
use seatrial::flight::log::columns;
use seatrial::flight::trial::Trial;
use seatrial::flight::waves::Sea;
use seatrial::mission::{Mission, Obstacle};
use seatrial::model::integrate::State;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A dive of 10 m on 120 m, then a turn to starboard.
pub const DIVE: &str = "format = 1\nname = \"dive\"\nspeed_m_s = 1.5\nacceptance_radius_m = 5.0\n\
    [[legs]]\nnorth_m = 120.0\neast_m = 0.0\ndepth_m = 10.0\n\
    [[legs]]\nnorth_m = 120.0\neast_m = 120.0\ndepth_m = 10.0\n";

/// CWolf with plain gains.
pub const AUTOPILOT: &str = include_str!("../support/autopilot.toml");

/// What a flight is made of.
pub struct Trip {
    pub description: Description,
    pub settings: Arc<Settings>,
    pub mission: Arc<Mission>,
    pub sensors: Sensors,
    pub seabed: Option<Seabed>,
    pub obstacles: Vec<Obstacle>,
    pub trial: Trial,
    pub seconds: f64,
    pub substeps: usize,
}

impl Trip {
    /// CWolf with plain gains and perfect sensors.
    pub fn cwolf(mission: &str) -> Self {
        Self::of("cwolf", AUTOPILOT, mission)
    }

    /// A built-in vehicle with the autopilot of a text.
    pub fn of(vehicle: &str, autopilot: &str, mission: &str) -> Self {
        Self {
            description: load(vehicle),
            settings: Arc::new(Settings::from_toml(autopilot, "test").expect("a valid autopilot")),
            mission: Arc::new(Mission::from_toml(mission, "test").expect("a valid mission")),
            sensors: Sensors::default(),
            seabed: None,
            obstacles: Vec::new(),
            trial: Trial::default(),
            seconds: 300.0,
            substeps: 2,
        }
    }

    /// The flight of cases.
    pub fn fly(&self, cases: &[Case]) -> Vec<Outcome> {
        self.fly_with(cases, &[], &[])
    }

    /// The flight of cases that differ in coefficients and tunable numbers.
    pub fn fly_with(&self, cases: &[Case], coefficients: &[usize], tunables: &[usize]) -> Vec<Outcome> {
        let flight = Flight {
            description: &self.description,
            model: &self.description,
            settings: &self.settings,
            mission: &self.mission,
            sensors: &self.sensors,
            navigation: None,
            acoustics: &Acoustics::default(),
            feedback: true,
            seabed: self.seabed,
            environment: self.description.file.environment,
            surface: SURFACE,
            voltage: f64::NAN,
            substeps: self.substeps,
            obstacles: &self.obstacles,
            trial: &self.trial,
            turbulence_times: [60.0, 2.0],
            periods: (self.seconds / self.settings.file.period_s).round() as usize,
        };
        let cases = Cases { coefficients, tunables, cases };
        flight.fly(&cases, true, &AtomicBool::new(false)).expect("a flight")
    }

    /// One flight as it is.
    pub fn one(&self, case: Case) -> Outcome {
        self.fly(&[case]).remove(0)
    }
}

/// A case from rest at the origin, in a current.
pub fn case(current: [f64; 3]) -> Case {
    Case {
        coefficients: Vec::new(),
        tunables: Vec::new(),
        state: State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] },
        current,
        turbulence: [0.0; 3],
        current_trend: [0.0; 3],
        current_walk: [0.0; 3],
        offsets: None,
        sea: Sea::CALM,
        seed: 1,
        faults: Vec::new(),
        outages: Vec::new(),
        set_points: Vec::new(),
        scales: Vec::new(),
    }
}

/// A failure of an actuator by its name.
pub fn fault(trip: &Trip, name: &str, from: f64, signal: Option<f64>) -> ActuatorFault {
    let actuator = trip.description.actuators.iter().position(|a| a.name == name).expect("a known actuator");
    ActuatorFault { actuator, from, signal }
}

/// A column of a log.
pub fn column(trip: &Trip, outcome: &Outcome, name: &str) -> Vec<f64> {
    let names = || trip.description.actuators.iter().map(|a| a.name.clone());
    let commands = names().map(|n| format!("cmd.{n}"));
    let all: Vec<String> =
        columns().into_iter().chain(commands).chain(names().map(|n| format!("act.{n}"))).collect();
    let index = all.iter().position(|known| known == name).expect("a known column");
    outcome.log.values.chunks_exact(all.len()).map(|row| row[index]).collect()
}

/// A flight in a cross current is completed, on the line with integral guidance.
#[test]
fn law_closed_loop_completes_a_mission_in_a_cross_current() {
    let trip = Trip::cwolf(DIVE);
    let outcome = trip.one(case([0.0, 0.3, 0.0]));
    let summary = &outcome.summary;
    assert_eq!(summary.ending, 1.0, "{summary:?}");
    assert_eq!(summary.waypoints, 2.0);
    assert!(summary.missed_by <= 5.0, "{}", summary.missed_by); // the radius of acceptance
    let energy: f64 = column(&trip, &outcome, "power").iter().sum::<f64>() * 0.1;
    let last = column(&trip, &outcome, "power").last().copied().unwrap_or_default() * 0.1;
    assert!((summary.energy - (energy - last)).abs() < 1e-6 * energy); // the last row begins no further period
}

/// The result converges with the step of the equation of motion.
#[test]
fn law_closed_loop_does_not_depend_on_the_step() {
    let mut trip = Trip::cwolf(DIVE);
    trip.seconds = 60.0;
    let end = |trip: &Trip| {
        let outcome = trip.one(case([0.0, 0.3, 0.0]));
        ["x", "y", "z"].map(|c| *column(trip, &outcome, c).last().expect("rows"))
    };
    let coarse = end(&trip);
    trip.substeps = 8;
    let fine = end(&trip);
    for i in 0..3 {
        // Dead time is linear between half steps: an error of first order in the step, millimetres after 60 s.
        assert!((coarse[i] - fine[i]).abs() < 0.02, "{coarse:?} against {fine:?}");
    }
}

/// A dead actuator stands still, a stuck one stays where it was or where it is put.
#[test]
fn law_closed_loop_faults_act_from_their_time() {
    let mut trip = Trip::cwolf(DIVE);
    trip.seconds = 60.0;
    let mut broken = case([0.0; 3]);
    broken.faults = vec![
        fault(&trip, "SbU", 30.0, Some(0.0)),
        fault(&trip, "PL", 40.0, None),
        fault(&trip, "PU", 50.0, Some(-300.0)),
    ];
    let outcome = trip.one(broken);
    let [dead, stuck, put] = ["act.SbU", "act.PL", "act.PU"].map(|c| column(&trip, &outcome, c));
    assert!(dead[299] > 500.0 && dead[301..].iter().all(|n| *n == 0.0));
    assert!(stuck[401..].iter().all(|n| *n == stuck[401]), "{:?}", &stuck[395..420]);
    assert!(stuck[401].abs() > 100.0, "{}", stuck[401]);
    assert!(put[501..].iter().all(|n| *n == -300.0));
}

/// Of two failures of an actuator the first one lasts, whichever was told first.
#[test]
fn law_closed_loop_the_first_failure_of_an_actuator_lasts() {
    let mut trip = Trip::cwolf(DIVE);
    trip.seconds = 40.0;
    let [first, second] = [(10.0, 300.0), (20.0, -300.0)].map(|(at, n)| fault(&trip, "PU", at, Some(n)));
    for faults in [vec![first, second], vec![second, first]] {
        let outcome = trip.one(Case { faults, ..case([0.0; 3]) });
        assert!(column(&trip, &outcome, "act.PU")[101..].iter().all(|n| *n == 300.0));
    }
}

/// A vehicle that hovers looks two ways from one place, and then the mission is complete.
#[test]
fn law_closed_loop_turns_on_the_spot() {
    let hold = |heading: f64| {
        format!(
            "[[legs]]\nnorth_m = 15.0\neast_m = 0.0\ndepth_m = 5.0\nhold_s = 40.0\nheading_deg = {heading}\n"
        )
    };
    let mission = format!(
        "format = 1\nname = \"look\"\nspeed_m_s = 0.5\nacceptance_radius_m = 1.0\n{}{}",
        hold(0.0),
        hold(90.0)
    );
    let trip = Trip::of("bluerov2-heavy", built_in("bluerov2-heavy").expect("built in"), &mission);
    let outcome = trip.one(case([0.0, 0.1, 0.0]));
    assert_eq!(outcome.summary.ending, 1.0, "{:?}", outcome.summary);
    let (leg, yaw) = (column(&trip, &outcome, "leg"), column(&trip, &outcome, "yaw"));
    let first = leg.iter().filter(|leg| **leg == 0.0).count();
    assert!(yaw[first - 1].abs() < 0.05, "{}", yaw[first - 1]);
    let last = yaw[yaw.len() - 1];
    assert!((last - std::f64::consts::FRAC_PI_2).abs() < 0.05, "{last}");
    let (x, y) = (column(&trip, &outcome, "x"), column(&trip, &outcome, "y"));
    let away = (x[x.len() - 1] - 15.0).hypot(y[y.len() - 1]);
    assert!(away < 0.3, "{away}");
}
