//! Recorded steps: what they compute is what the core computes, number by number, along flights.

use crate::closed_loop::flights::DIVE;
use crate::vehicles::load;
use seatrial::actuator::motor::Limits;
use seatrial::control::allocation::Allocator;
use seatrial::control::autopilot::Autopilot;
use seatrial::control::autopilot::settings::{Settings, built_in};
use seatrial::control::navigation::{Measurement, truth};
use seatrial::control::navigation_filter::{Fitting, Instrument, KINDS};
use seatrial::description::Description;
use seatrial::description::vehicle_file::{TetherTable, VehicleFile};
use seatrial::export::autopilot::{AutopilotStep, row};
use seatrial::export::c::Module;
use seatrial::export::filter::FilterStep;
use seatrial::export::program::{Given, Interface, Program, Stage, Symbol};
use seatrial::export::vehicle::VehicleStep;
use seatrial::filter::innovation::Gate;
use seatrial::flight::faults::Faults;
use seatrial::flight::motors::Motors;
use seatrial::mission::Mission;
use seatrial::model::current::Current;
use seatrial::model::integrate::State;
use seatrial::model::vehicle::{Instant, Vehicle};
use seatrial::number::dual::Dual;
use seatrial::number::memory::Memory;
use seatrial::number::real::Real;
use seatrial::number::traced::{Traced, record};
use std::collections::HashMap;
use std::sync::Arc;

const STILL: State<f64> = State { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0], nu: [0.0; 6] };

/// A mission with everything that a leg may be.
const TOUR: &str = "format = 1\nname = \"tour\"\nspeed_m_s = 1.2\nacceptance_radius_m = 4.0\n\
    [limits]\nmax_depth_m = 40.0\nmax_time_s = 600.0\nfence_m = [[-200.0, -200.0], [300.0, -200.0], [300.0, 300.0], [-200.0, 300.0]]\n\
    [[legs]]\nnorth_m = 60.0\neast_m = 0.0\ndepth_m = 8.0\n\
    [[legs]]\nnorth_m = 60.0\neast_m = 40.0\ndepth_m = 8.0\nhold_s = 10.0\n\
    [[legs]]\nnorth_m = 20.0\neast_m = 60.0\ndepth_m = 6.0\ncircle_radius_m = 15.0\nturns = 0.5\n";

fn limits(description: &Description) -> Vec<Limits> {
    description.actuators.iter().map(|a| a.limits).collect()
}

/// The numbers of a memory by name.
fn named(memory: &mut dyn Memory<f64>, under: &str) -> HashMap<String, f64> {
    let mut numbers = HashMap::new();
    memory.visit(under, &mut |name: &str, x: &mut f64| {
        numbers.insert(name.to_owned(), *x);
    });
    numbers
}

fn starts(symbols: &[Symbol]) -> Vec<f64> {
    symbols.iter().map(|symbol| symbol.start).collect()
}

/// The state of a program out of named numbers.
fn picked(program: &Program, numbers: &HashMap<String, f64>) -> Vec<f64> {
    program.interface.state.iter().map(|symbol| numbers[&symbol.known_as]).collect()
}

/// The largest difference over the magnitude, 1 at least; equal infinities differ by nothing.
fn apart(a: &[f64], b: &[f64]) -> (f64, usize) {
    assert_eq!(a.len(), b.len());
    let of = |(x, y): (&f64, &f64)| {
        if x == y || (x.is_nan() && y.is_nan()) { 0.0 } else { (x - y).abs() / x.abs().max(y.abs()).max(1.0) }
    };
    let all = a.iter().zip(b).map(of).enumerate();
    all.fold((0.0, 0), |(most, at), (i, x)| if x > most || x.is_nan() { (x, i) } else { (most, at) })
}

/// A vehicle, its motors and its autopilot, as they fly.
struct Loop {
    description: Description,
    h: f64,
    substeps: usize,
    vehicle: Vehicle<f64>,
    motors: Motors<f64>,
    state: State<f64>,
}

impl Loop {
    fn new(name: &str, period: f64, substeps: usize) -> Self {
        Self::of(load(name), period, substeps)
    }

    fn of(description: Description, period: f64, substeps: usize) -> Self {
        let g = description.file.environment.g_m_s2;
        let vehicle = Vehicle::nominal(&description).beneath(&description, g, Some(0.0));
        let h = period / substeps as f64;
        let motors = Motors::new(&vehicle, &limits(&description), h, 0.0);
        Self { description, h, substeps, vehicle, motors, state: STILL }
    }

    fn step(&self) -> VehicleStep {
        VehicleStep { h: self.h, voltage: 16.0, environment: self.description.file.environment, start: STILL }
    }

    /// One period at these signals in a current; every substep is held against the program.
    fn advance(&mut self, signals: &[f64], water: [f64; 3], program: &Program) -> f64 {
        let count = signals.len();
        let none = Faults::new(vec![0.0; count], vec![0.0; count], false);
        let mut worst = 0.0_f64;
        self.motors.command(&self.vehicle, signals, &limits(&self.description));
        let current = Current { velocity: water, rate: [0.0; 3], pressed: None };
        for _ in 0..self.substeps {
            let mut instants: [Instant<f64>; 3] = Default::default();
            for instant in &mut instants {
                instant.current = Some(current);
            }
            let commands = self.description.actuators.iter().zip(signals).map(|(a, &s)| a.command(s));
            let inputs: Vec<f64> = commands.chain(water).chain([f64::INFINITY]).collect();
            let mut all = named(&mut self.motors, "motor");
            all.extend(named(&mut self.state, ""));
            let (next, shown) =
                program.run(&starts(&program.interface.parameters), &picked(program, &all), &inputs);
            let truth = truth(&self.state, Some(&current), None);
            worst = worst.max(apart(&truth, &shown[..truth.len()]).0);
            self.state = self.motors.substep(
                &self.vehicle,
                &self.state,
                &mut instants,
                (true, 0.0, self.h),
                (&none, 16.0),
            );
            let mut all = named(&mut self.motors, "motor");
            all.extend(named(&mut self.state, ""));
            worst = worst.max(apart(&picked(program, &all), &next).0);
        }
        worst
    }
}

/// What a broken sensor or bus may tell: no number, an infinite one, one that cannot be true, an age that is none.
fn garble(measured: &mut Measurement<f64>, k: usize) {
    let wild = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e6, -1e300];
    let began = (300..860).step_by(20).rev().find(|&from| from <= k);
    measured.battery = 1.0;
    if let Some(from) = began.filter(|from| k < from + 8) {
        let turn = (from - 300) / 20;
        measured.channels[turn % 12] = wild[turn % wild.len()];
        if turn % 7 == 6 {
            measured.age[turn % 12] = f64::NAN;
        }
        measured.battery = wild[(turn + 3) % wild.len()];
    }
}

/// Flies a mission in the core and holds every step of vehicle and autopilot against their programs.
fn flown(name: &str, text: &str, mission: &str, periods: usize, feedback: bool) -> [f64; 2] {
    let settings = Arc::new(Settings::from_toml(text, name).expect("a valid autopilot"));
    let mission = Arc::new(Mission::from_toml(mission, "test").expect("a valid mission"));
    let mut world = Loop::new(name, settings.file.period_s, 2);
    let of_vehicle = world.step().record(&world.description).expect("a vehicle that can be recorded");
    let step = AutopilotStep {
        settings: &settings,
        model: &world.description,
        mission: &mission,
        feedback,
        voltage: 16.0,
    };
    let program = step.record().expect("an autopilot that can be recorded");
    let autopilot =
        Autopilot::new(&settings, &world.description, &mission, &settings.tunables).expect("it fits");
    let table = &settings.file.allocation;
    let allocator = Allocator::single(&world.description, autopilot.model(), table).expect("it fits");
    let mut pilot = autopilot.begin(allocator);
    let mut worst = [0.0_f64; 2];
    let mut measured = Measurement::nothing(0.0);
    measured.voltage = 16.0;
    for k in 0..periods {
        let water = [0.15, -0.1, 0.0];
        let current = Current { velocity: water, rate: [0.0; 3], pressed: None };
        measured.channels = truth(&world.state, Some(&current), None);
        measured.age = [0.0; 16];
        // A sensor that falls silent, an outlier, one that repeats itself.
        if (120..160).contains(&k) {
            measured.age[6..9].fill((k - 119) as f64 * settings.file.period_s);
        }
        if k == 200 {
            measured.channels[0] += 300.0;
        }
        if (220..260).contains(&k) {
            measured.channels[5] = 0.3;
        }
        garble(&mut measured, k);
        let shown = world.motors.signals.clone();
        let all = named(&mut pilot, "");
        let commands = world.description.actuators.iter().zip(&shown).map(|(a, &s)| a.command(s));
        let told = measured.channels.iter().chain(&measured.age).copied().chain([measured.battery, 0.0]);
        let inputs: Vec<f64> = told.chain(commands.filter(|_| feedback)).collect();
        let (next, results) =
            program.run(&starts(&program.interface.parameters), &picked(&program, &all), &inputs);
        let thought = autopilot.step(&mut pilot, &measured, feedback.then_some(&shown[..]));
        let commands = world.description.actuators.iter().zip(&pilot.signals).map(|(a, &s)| a.command(s));
        let expected: Vec<f64> = commands.chain(row(&thought)).collect();
        let after = named(&mut pilot, "");
        assert!(results.iter().chain(&next).all(|x| !x.is_nan()), "{name}, period {k}");
        let of_results = apart(&expected, &results);
        let of_state = apart(&picked(&program, &after), &next);
        for (most, at, symbols) in [
            (of_results.0, of_results.1, &program.interface.outputs),
            (of_state.0, of_state.1, &program.interface.state),
        ] {
            assert!(most < 1e-9, "{name}, period {k}: {} is off by {most}", symbols[at].name);
            worst[1] = worst[1].max(most);
        }
        let signals = pilot.signals.clone();
        worst[0] = worst[0].max(world.advance(&signals, water, &of_vehicle));
    }
    worst
}

#[test]
fn scalar_recorded_steps_are_those_of_the_core_along_missions() {
    for name in ["cwolf", "bluerov2-heavy", "remus100", "lauv", "beluga"] {
        let text = built_in(name).expect("a built-in autopilot");
        let mission = if name == "cwolf" || name == "bluerov2-heavy" { TOUR } else { DIVE };
        let worst = flown(name, text, mission, 900, true);
        println!("{name}: {worst:?}");
        // Rounding of a step; the state begins each step equal. At the surface powers of depths cancel in the wet share.
        assert!(worst[0] < 1e-10 && worst[1] < 1e-12, "{name}: {worst:?}");
    }
}

#[test]
fn law_a_program_is_reduced() {
    let description = load("cwolf");
    let step =
        VehicleStep { h: 0.02, voltage: f64::NAN, environment: description.file.environment, start: STILL };
    let program = step.record(&description).expect("a vehicle that can be recorded");
    let source = program.to_c(&Module { prefix: "cwolf", about: &[], measured: true });
    println!("{} lines, {:?}", source.source.lines().count(), program.count(&program.needed_for(false)));
    assert!(program.stages().contains(&Stage::Prepared));
    // Every line that names a place reads places before it.
    assert!(!source.source.contains("malloc") && source.header.contains("cwolf_step"));
}

/// What recording says of a step of one number.
fn refusal(step: impl Fn(Traced) -> Traced) -> String {
    let symbol = |name: &str| vec![Symbol::new(name, "1", "", 0.0)];
    let interface = Interface { inputs: symbol("x"), outputs: symbol("y"), ..Interface::default() };
    let recorded = Program::of(interface, |given: &mut Given| Ok(vec![step(given.inputs[0])]));
    recorded.map_or_else(|error| error.to_string(), |_| "recorded".to_owned())
}

#[test]
fn law_what_a_program_cannot_say_is_refused_while_it_is_recorded() {
    assert_eq!(refusal(|x| x * 2.0), "recorded");
    assert!(refusal(|x| x.tabulated(|x| (x.sin(), x.cos()))).contains("point by point"));
    assert!(refusal(|x| x.before(&[x, x], 0)).contains("dead time"));
    assert!(refusal(|x| x.splat(x.largest())).contains("length of a memory"));
    assert!(refusal(|x| x.of_low_half(x.word())).contains("random"));
    // The same with numbers that are known is computed.
    let known = Traced::tabulated;
    assert_eq!(refusal(|x| known(x.splat(2.0), |x| (x * x, 0.0)) + x), "recorded");
}

#[test]
fn law_a_guard_that_may_hold_is_never_decided_while_recording() {
    let (_, answers) = record(|| {
        let (x, zero) = (Traced::given(0), Traced::constant(0.0));
        let open = zero.lt(x);
        [
            Traced::any(open),
            Traced::any(zero.lt(zero)),
            Traced::any(zero.lt(zero.splat(1.0))),
            x.equals(zero),
            x.equals(x),
            zero.equals(zero),
        ]
    })
    .expect("nothing is refused");
    assert_eq!(answers, [true, false, true, false, true, true]);
}

/// A filter with a sensor of these kinds, all in time.
fn fitting(description: &Description, kinds: &[&str]) -> Fitting {
    let of = |kind: &str| kinds.contains(&kind).then(|| Instrument::of(0.01));
    let instruments: [Option<Instrument>; KINDS.len()] = std::array::from_fn(|i| of(KINDS[i]));
    Fitting {
        instruments,
        landmarks: Vec::new(),
        bottom: None,
        swell: None,
        noise: Fitting::noise_of(description, &instruments, false),
        gate: Gate::default(),
        start: ([0.0; 3], 1.0),
        period: 0.1,
        longest_age: 0.0,
    }
}

#[test]
fn scalar_a_recorded_slope_is_that_of_dual_numbers() {
    for name in ["cwolf", "bluerov2-heavy", "remus100", "lauv", "beluga"] {
        let description = load(name);
        let fitting = fitting(&description, &["attitude", "dvl"]);
        let step = FilterStep { description: &description, fitting: &fitting, voltage: 16.0 };
        let program = step.model().expect("a model that can be recorded");
        let numbers = program.interface.inputs.len();
        // At rest, where |x| and a root have no derivative, and under way.
        for scale in [0.0, 0.7] {
            let inputs: Vec<f64> = (0..numbers).map(|i| scale * (1.0 + 1.7 * i as f64).sin()).collect();
            let (_, results) = program.run(&[], &[], &inputs);
            let lift = |value: f64| Dual { value, partials: 0.0 };
            let vehicle = Vehicle::nominal_in(&description, lift(0.0));
            let mut rest = inputs[6..].iter().copied();
            let mut next = || lift(rest.next().expect("enough inputs"));
            let r: [[Dual<f64>; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
            let wrench: [Dual<f64>; 6] = std::array::from_fn(|_| next());
            let mut instant = Instant { inflow_free: Some(wrench), ..Instant::default() };
            for actuator in &vehicle.actuators {
                let mut thrust = actuator.characteristic.thrust(lift(0.0), 16.0);
                if actuator.characteristic.has_inflow() {
                    (thrust.force, thrust.force_per_inflow) = (next(), next());
                    (thrust.torque, thrust.torque_per_inflow) = (next(), next());
                }
                instant.thrusts.push(thrust);
            }
            instant.deflections = vehicle.fins.iter().map(|_| (next(), next())).collect();
            for column in 0..6 {
                let unit = |i: usize| Dual { value: inputs[i], partials: f64::from(u8::from(i == column)) };
                let found = vehicle.acceleration((None, &r), &std::array::from_fn(unit), &instant);
                for i in 0..6 {
                    for (expected, ours) in
                        [(found[i].value, results[i]), (found[i].partials, results[6 + 6 * i + column])]
                    {
                        let apart = (expected - ours).abs() / expected.abs().max(1.0);
                        assert!(apart < 1e-12, "{name}: row {i} by {column}: {ours}, expected {expected}");
                    }
                }
            }
        }
    }
}

#[test]
fn law_a_filter_that_cannot_begin_is_refused() {
    let description = load("cwolf");
    let fitting = fitting(&description, &["dvl", "depth"]);
    let step = FilterStep { description: &description, fitting: &fitting, voltage: f64::NAN };
    let refused = step.write("it", &[], None).err().expect("a refusal").to_string();
    assert!(refused.contains("expected a sensor of the attitude"), "{refused}");
}

#[test]
fn law_a_filter_of_a_vehicle_on_a_spring_is_refused() {
    let mut file = load("cwolf").file;
    let mut tether = TetherTable { position_m: [0.0; 3], anchor_m: None, slack_m: None };
    file.tether = Some(tether.clone());
    let refusal = |file: &VehicleFile| {
        let description = Description::new(file.clone(), "tethered").expect("a vehicle");
        let fitting = fitting(&description, &["attitude", "dvl"]);
        let step = FilterStep { description: &description, fitting: &fitting, voltage: f64::NAN };
        step.write("it", &[], None).err().map(|refused| refused.to_string())
    };
    assert_eq!(refusal(&file), None);
    (tether.anchor_m, tether.slack_m) = (Some([0.0, 0.0, 1.0]), Some(20.0));
    file.tether = Some(tether);
    let refused = refusal(&file).expect("a refusal");
    assert!(refused.contains("pull of a tether"), "{refused}");
}

#[test]
fn a_recorded_vehicle_drags_its_tether_and_is_pulled_by_it() {
    let mut file = load("cwolf").file;
    file.tether = Some(TetherTable {
        position_m: [-1.2, 0.0, -0.1],
        anchor_m: Some([0.0, 0.0, 1.0]),
        slack_m: Some(20.0),
    });
    file.coefficients.extend([("A_tether".to_owned(), 0.1), ("k_tether".to_owned(), 6.0)]);
    let description = Description::new(file, "tethered").expect("a vehicle");
    let mut world = Loop::of(description, 0.1, 2);
    world.state.position = [22.0, -4.0, 5.0];
    let program = world.step().record(&world.description).expect("a vehicle that can be recorded");
    let names: Vec<&str> = program.interface.parameters.iter().map(|symbol| symbol.name.as_str()).collect();
    assert!(names.contains(&"A_tether") && names.contains(&"k_tether"), "{names:?}");
    let signals = vec![400.0; world.description.actuators.len()];
    for k in 0..200 {
        let worst = world.advance(&signals, [0.15, -0.1, 0.0], &program);
        // The same operations in another order.
        assert!(worst < 1e-11, "period {k}: {worst:e}");
    }
}
