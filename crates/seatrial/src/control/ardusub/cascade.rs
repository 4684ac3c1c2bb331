//! ArduSub's controllers one behind the other, once per control period: from targets to six demands on the mixer.
//!
//! ```text
//! depth  -> velocity -> acceleration -> throttle         place -> velocity -> acceleration -> lean -> forward, lateral
//! attitude asked for -> target -> turn rates -> roll, pitch, yaw
//! ```
//!
//! At the limits: roll, pitch and yaw integrate on, whatever load they put on the motors, because ArduSub's mixer reports
//! no limit of theirs. It reports the throttle at exactly full, up or down: then the integral part of the vertical
//! acceleration goes towards zero only, and that of the vertical velocity away from the stop. Those of the plane stop
//! growing where the lean angle bounds the acceleration.
//!
//! Targets are those of a log or of a mission, the same for all cases of a batch; gains and measurements are each case's
//! own. Without depth control the throttle is the pilot's, without position control forward and lateral are; a
//! controller that begins to work starts at rest.
//!
//! Source: ArduPilot, "Attitude control", "Position controllers", `AC_PosControl`, `AP_Motors6DOF` (limit flags; structure
//! as facts). Tests: `tests/ardusub.rs`.

use super::attitude::{AngleGains, rates_wanted};
use super::parameters::{
    ACCELERATION, ANGLE, DEPTH, HOVER, INPUT, LEAN, LIFT, PARAMETERS, PLANE, RATE, RATES,
};
use super::pid::{Gains, State, free, off_its_stops, towards_zero};
use super::position::{
    demands, forward_and_lateral, limited_acceleration, plane_integrals, throttle, velocity_wanted,
};
use super::shaping::{Shaping, Target};
use crate::model::kinematics::{Quaternion, from_euler, rotation};
use crate::number::algebra::{Vec3, transposed_product};
use crate::number::real::Real;

/// The controllers of a vehicle.
#[derive(Clone)]
pub struct Cascade<T> {
    shaping: Shaping<T>,
    angle: AngleGains<T>,
    rate: [Gains<T>; 3],
    depth: T,
    sink: Gains<T>,
    lift: Gains<T>,
    place: T,
    plane: Gains<T>,
    lean: f64,
    hover: T,
}

/// Targets of one control period, as `[f64; WANTED]` in [`Wanted::of`]'s order.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Roll, pitch and yaw, rad.
    pub attitude: Vec3<f64>,
    /// Rate of the yaw wanted, rad/s.
    pub turning: f64,
    /// North, east and down, m.
    pub position: Vec3<f64>,
    /// Velocity of the target, m/s.
    pub velocity: Vec3<f64>,
    /// Acceleration of the target, m/s².
    pub acceleration: Vec3<f64>,
    /// The pilot's throttle (0 to 1), forward and lateral (−1 to 1).
    pub pilot: Vec3<f64>,
    /// Whether depth and place are controlled.
    pub controlled: [bool; 2],
    /// Supply voltage, V.
    pub voltage: f64,
    /// Whether the attitude is asked for and its target moves there; else it is the target, as logs have it.
    pub shaped: bool,
}

/// Numbers of a row of targets.
pub const WANTED: usize = 20;

impl Wanted {
    /// From attitude, turning, position, velocity, acceleration, pilot, depth and place controlled (0 or 1), voltage, and
    /// whether the attitude is to be shaped (0 or 1).
    pub fn of(row: &[f64; WANTED]) -> Self {
        let three = |at: usize| [row[at], row[at + 1], row[at + 2]];
        Self {
            attitude: three(0),
            turning: row[3],
            position: three(4),
            velocity: three(7),
            acceleration: three(10),
            pilot: three(13),
            controlled: [row[16] > 0.5, row[17] > 0.5],
            voltage: row[18],
            shaped: row[19] > 0.5,
        }
    }
}

/// What the controllers are told of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Told<T> {
    /// Body to NED.
    pub attitude: Quaternion<T>,
    /// Yaw, rad.
    pub heading: T,
    /// Turn rates of the body, rad/s.
    pub gyro: Vec3<T>,
    /// NED, m.
    pub position: Vec3<T>,
    /// NED, m/s.
    pub velocity: Vec3<T>,
    /// Downward acceleration, m/s².
    pub sinking: T,
}

/// Integral parts with which a flight begins: roll, pitch, yaw; vertical velocity and acceleration; north and east.
pub const INTEGRALS: usize = 7;

/// What the controllers remember.
#[derive(Clone)]
pub struct Memory<T> {
    rate: [State<T>; 3],
    sink: State<T>,
    lift: State<T>,
    plane: [State<T>; 2],
    /// The acceleration in the plane that could not be had, zero where all could.
    beyond: [T; 2],
    /// The throttle demand, −1 to 1.
    up: T,
    target: Option<Target<T>>,
    was: [bool; 2],
}

impl<T: Real> Memory<T> {
    /// Controllers that begin with these integral parts; what is not controlled at first begins without.
    #[inline(always)]
    pub fn new(integrals: &[T; INTEGRALS]) -> Self {
        let unit = integrals[0].zero();
        let with = |i: usize| State::at_rest(unit).with_integrator(integrals[i]);
        Self {
            rate: [with(0), with(1), with(2)],
            sink: with(3),
            lift: with(4),
            plane: [with(5), with(6)],
            beyond: [unit; 2],
            up: unit,
            target: None,
            was: [true; 2],
        }
    }
}

impl<T: Copy> Memory<T> {
    /// The attitude of a shaped target, body of the target to NED; none before the first shaped row.
    pub fn target(&self) -> Option<Quaternion<T>> {
        self.target.as_ref().map(|target| target.attitude)
    }
}

/// A PID's gains from P, I, D, FF and IMAX, with its cut-offs, Hz.
#[inline(always)]
fn pid<T: Real>(own: &[T], target: Option<usize>, error: usize, derivative: usize) -> Gains<T> {
    Gains {
        p: own[0],
        i: own[1],
        d: own[2],
        ff: own[3],
        d_ff: own[0].zero(),
        i_max: own[4],
        target_hz: target.map_or(0.0, |k| own[k].largest()),
        error_hz: own[error].largest(),
        derivative_hz: own[derivative].largest(),
    }
}

impl<T: Real> Cascade<T> {
    /// The controllers with the values of [`PARAMETERS`], in ArduSub's units. Cut-offs and the largest lean angle are
    /// those of the first case where cases differ.
    #[inline(always)]
    pub fn new(values: &[T]) -> Self {
        let si = |k: usize| values[k] * PARAMETERS[k].2;
        let three = |k: usize| [si(k), si(k + 1), si(k + 2)];
        let rate = |axis: usize| pid(&values[RATES + 8 * axis..RATES + 8 * (axis + 1)], Some(5), 6, 7);
        let mut lift = pid(&values[LIFT..PLANE], Some(5), 6, 7);
        // ArduPilot lets the integral part reach what hovers, whatever IMAX says.
        lift.i_max = lift.i_max.max(values[HOVER]);
        let (acceleration, rates) = (three(ACCELERATION), three(RATE));
        Self {
            shaping: Shaping {
                time: values[INPUT],
                slew: si(INPUT + 1),
                acceleration,
                rate: rates,
                fed_forward: values[INPUT + 2].largest() > 0.5,
            },
            angle: AngleGains { p: three(ANGLE), acceleration, rate: rates, yaw_rate_p: values[RATES + 16] },
            rate: [rate(0), rate(1), rate(2)],
            depth: values[DEPTH],
            sink: pid(&values[DEPTH + 1..LIFT], None, 5, 6),
            lift,
            place: values[PLANE],
            plane: pid(&values[PLANE + 1..LEAN], None, 5, 6),
            lean: si(LEAN).largest(),
            hover: values[HOVER],
        }
    }

    /// Demands of roll, pitch, yaw, throttle, forward and lateral, −1 to 1, `dt` seconds after the last ones.
    #[inline(always)]
    pub fn step(&self, memory: &mut Memory<T>, wanted: &Wanted, told: &Told<T>, dt: f64) -> [T; 6] {
        let (zero, one) = (self.hover.zero(), self.hover.splat(1.0));
        let fixed = |values: &Vec3<f64>| values.map(|x| zero.splat(x));
        let [depth, place] = wanted.controlled;
        // The throttle of the last period: the mixer has not seen that of this one.
        let at_least_one = |x: T| zero.lt(T::select(x.lt(one), zero, one));
        let (full_up, full_down) = (at_least_one(memory.up), at_least_one(-memory.up));
        let up = if depth {
            if !memory.was[0] {
                (memory.sink, memory.lift) = (State::at_rest(zero), State::at_rest(zero));
            }
            let error = zero.splat(wanted.position[2]) - told.position[2];
            let moving = zero.splat(wanted.velocity[2]);
            let velocity = velocity_wanted(error, moving, self.depth, zero, dt);
            // Down is positive here: full throttle upwards is the lower stop.
            let stops = off_its_stops(full_up, full_down);
            let sink = memory.sink.step(&self.sink, velocity, told.velocity[2], dt, stops);
            let acceleration = sink.output() + wanted.acceleration[2];
            let full = towards_zero(T::either(full_up, full_down));
            let lift = memory.lift.step(&self.lift, acceleration, told.sinking, dt, full);
            throttle(lift.output(), self.hover)
        } else {
            zero.splat(wanted.pilot[0])
        };
        let [forward, lateral] = if place {
            if !memory.was[1] {
                (memory.plane, memory.beyond) = ([State::at_rest(zero); 2], [zero; 2]);
            }
            let asked = self.plane_acceleration(memory, wanted, told, dt);
            let moving = [wanted.velocity[0], wanted.velocity[1]];
            let (acceleration, limited) = limited_acceleration(&asked, &moving, self.lean);
            memory.beyond = asked.map(|a| T::select(limited, a, zero));
            forward_and_lateral(&acceleration, told.heading, self.lean)
        } else {
            [zero.splat(wanted.pilot[1]), zero.splat(wanted.pilot[2])]
        };
        memory.was = wanted.controlled;
        let asked = fixed(&wanted.attitude);
        let (target, turning) = if wanted.shaped {
            let moves = memory.target.get_or_insert_with(|| Target::at(&told.attitude));
            self.shaping.step(moves, &asked, dt);
            (moves.attitude, moves.turning)
        } else {
            memory.target = None;
            let target = from_euler(&asked);
            // The rate of a heading turns about the earth's vertical.
            let turning = transposed_product(&rotation(&target), &[zero, zero, zero.splat(wanted.turning)]);
            (target, turning)
        };
        let turn = rates_wanted(&self.angle, &target, &turning, &told.attitude, &told.gyro, dt);
        if let Some(moves) = &mut memory.target {
            moves.attitude = turn.target;
        }
        let mut turned = [zero; 3];
        for axis in 0..3 {
            let terms = memory.rate[axis].step(&self.rate[axis], turn.rates[axis], told.gyro[axis], dt, free);
            turned[axis] = terms.output().clamped(-one, one);
        }
        let all = demands(&turned, up, forward, lateral);
        memory.up = all[3];
        all
    }

    /// The acceleration in the plane that the controllers of north and east ask for, m/s².
    #[inline(always)]
    fn plane_acceleration(&self, memory: &mut Memory<T>, wanted: &Wanted, told: &Told<T>, dt: f64) -> [T; 2] {
        let zero = self.hover.zero();
        let before = memory.plane.map(|state| state.integrator);
        let mut rest = [zero; 2];
        for axis in 0..2 {
            let error = zero.splat(wanted.position[axis]) - told.position[axis];
            let moving = zero.splat(wanted.velocity[axis]);
            let velocity = velocity_wanted(error, moving, self.place, zero, dt);
            let terms = memory.plane[axis].step(&self.plane, velocity, told.velocity[axis], dt, free);
            rest[axis] = terms.output() - terms.i + wanted.acceleration[axis];
        }
        let after = memory.plane.map(|state| state.integrator);
        let integrals = plane_integrals(&before, &after, &memory.beyond, self.plane.i_max);
        for axis in 0..2 {
            memory.plane[axis].integrator = integrals[axis];
        }
        [rest[0] + integrals[0], rest[1] + integrals[1]]
    }
}
