//! The rows of the ranges, file by file, in the order of the pages `docs/*-file.md`.

use super::Range;

const LENGTH: &str = "give it in metres";
const SHAPE: &str = "give it as a coefficient without a unit";
const COMMAND: &str = "give it in the unit of the command, counted from neutral, as a positive magnitude";
const PLACE: &str = "give metres from the origin, north and east";
const TIME: &str = "give it in seconds";
const SPEED: &str = "give it in m/s";
const DIRECTION: &str = "give a direction in the body frame, of any length";
const THRUST: &str = "check the unit: N, and revolutions per second";
const GAIN: &str = "give it in N or N m per m/s, m or rad; the signs are the autopilot's";
const DEFAULT: &str = "correct it, or leave it out for the default";
const NEVER: &str = "leave it out for the default; the largest value that is admitted switches it off";
const DEPTH: &str = "give metres below the surface";
const BEARING: &str = "give it in degrees, from north over east";

/// Largest size of a place or length, m.
const FAR: f64 = 1e3;
/// Largest magnitude of a command or limit in its own unit.
const COMMANDED: f64 = 1e6;
/// A year, s.
const YEAR: f64 = 31_557_600.0;
/// As far as a mission flies from its origin, m: farther away flat metres mean nothing.
const FARTHEST: f64 = 1e6;
/// The deepest place of the sea and a little more, m.
const DEEPEST: f64 = 12_000.0;
/// Largest magnitude of an angle that a human types, degrees.
const TURNED: f64 = 3_600.0;

/// What a coefficient without a row of its own may be.
pub(super) const ANY_COEFFICIENT: Range =
    Range::sized("*", 1e12, "no vehicle has one of this size; check the unit, coefficients are SI");

/// Coefficients by name, those of an actuator by the part behind the dot.
pub const COEFFICIENTS: [Range; 34] = [
    Range::within("m", [1e-6, 1e9], "give the mass in kg, weighed in air"),
    Range::within("I_x", [1e-12, 1e13], "give it in kg m2, or a [geometry] from which it is filled"),
    Range::within("I_y", [1e-12, 1e13], "give it in kg m2, or a [geometry] from which it is filled"),
    Range::within("I_z", [1e-12, 1e13], "give it in kg m2, or a [geometry] from which it is filled"),
    Range::sized("x_g", FAR, "give metres from O"),
    Range::sized("y_g", FAR, "give metres from O"),
    Range::sized("z_g", FAR, "give metres from O"),
    Range::sized("x_b", FAR, "give metres from O"),
    Range::sized("y_b", FAR, "give metres from O"),
    Range::sized("z_b", FAR, "give metres from O"),
    Range::upto("B", 1e11, "buoyancy in N points up; a vehicle that sinks has one below m g"),
    Range::upto("C_Dy", 100.0, "0.7 to 1.2 of a round hull, up to 2 of a box; 0 for none"),
    Range::upto("C_Dz", 100.0, "0.7 to 1.2 of a round hull, up to 2 of a box; 0 for none"),
    Range::upto(
        "A_tether",
        1e4,
        "the drag coefficient, 1.0 to 1.2, times diameter and length in m; 0 for none",
    ),
    Range::upto("k_tether", 1e9, "N per m of stretch; 0 for none"),
    Range::sized("gain", 1e3, "a factor on the thrust: 1 as the file has it"),
    Range::within("w", [-1.0, 0.99], "a share of the speed: 0 in open water"),
    Range::within("t", [-1.0, 0.99], "a share of the thrust: 0 in open water"),
    Range::above("K_V", 1e3, "the steady signal per command: 1 where the motor reaches it"),
    Range::upto("T_1", 600.0, "the time constant in s; 0 for no lag"),
    Range::upto("T_t", 60.0, "the dead time in s; 0 for none"),
    Range::above("n_acc", 1e9, "in the unit of the command per s; leave it out for no limit"),
    Range::above("n_dec", 1e9, "in the unit of the command per s; leave it out for no limit"),
    Range::sized("lever_K", FAR, "give metres from O"),
    Range::sized("lever_M", FAR, "give metres from O"),
    Range::sized("lever_N", FAR, "give metres from O"),
    Range::within("astern_ratio", [0.0, 1e3], "a factor on the thrust astern: 1 as the file has it"),
    Range::within("loss", [-1.0, 1.0], "a share per newton: 0 for none"),
    Range::upto("C_La", 100.0, SHAPE),
    Range::upto("C_Lmax", 100.0, SHAPE),
    Range::upto("C_D0", 100.0, SHAPE),
    Range::upto("C_D90", 100.0, SHAPE),
    Range::upto("k_i", 1e3, SHAPE),
    Range::sized("offset", 1.571, "give the deflection at neutral in rad"),
];

/// The density of the water that is given for a simulation or a flight: a specific gravity is none.
pub const WATER: Range =
    Range::within("rho", [500.0, 2e3], "the density in kg/m3: 1025 in the sea, 1000 in a lake");

/// The vehicle file.
pub const VEHICLE: &[Range] = &[
    Range::within("format", [1.0, 1.0], "this version reads format = 1"),
    Range::above("environment.rho_kg_m3", 2e4, "the density in kg/m3: 1025 in the sea, 1000 in a lake"),
    Range::above("environment.g_m_s2", 100.0, "gravity in m/s2: 9.81"),
    Range::above("geometry.length_m", FAR, LENGTH),
    Range::above("geometry.diameter_m", FAR, LENGTH),
    Range::above("geometry.width_m", FAR, LENGTH),
    Range::above("geometry.height_m", FAR, LENGTH),
    Range::above("geometry.design_speed_m_s", 100.0, SPEED),
    Range::above("geometry.kinematic_viscosity_m2_s", 1.0, "1.19e-6 m2/s in the sea at 15 degrees"),
    Range::upto("geometry.appendages[].area_m2", 1e4, "give it in m2"),
    Range::upto("geometry.appendages[].arm_m", FAR, "give metres from the roll axis"),
    Range::sized("trim.weight_in_water_kg", 1e6, "give kg; negative where the vehicle floats"),
    Range::sized("trim.righting_arm_m", FAR, "give metres; positive where buoyancy is above gravity"),
    Range::sized("cross_flow.x_m", FAR, "give metres from O"),
    Range::upto("cross_flow.diameter_m", FAR, LENGTH),
    Range::upto("cross_flow.height_m", FAR, LENGTH),
    Range::sized("tether.position_m", FAR, "give metres from O"),
    Range::sized("tether.anchor_m", 2e7, "give metres north, east and down"),
    Range::upto("tether.slack_m", 1e5, LENGTH),
    Range::upto(
        "power.hotel_w",
        1e7,
        "the load without propulsion in W; leave [power] out where it is not known",
    ),
    Range::above(
        "power.battery_wh",
        1e10,
        "the usable energy in W h; leave [power] out where it is not known",
    ),
    Range::upto("model_error.force", 1e9, "a standard deviation in N and N m, as identify writes it"),
    Range::within("model_error.force_time_s", [0.1, 1e5], "the time constant of the force in s"),
    Range::upto("model_error.acceleration", 100.0, "a standard deviation in m/s and rad/s after a second"),
    Range::sized(
        "coefficients.*",
        1e12,
        "no vehicle has one of this size; check the unit, coefficients are SI",
    ),
    Range::upto("motors.*.maximum_ahead", COMMANDED, COMMAND),
    Range::upto("motors.*.maximum_astern", COMMANDED, COMMAND),
    Range::upto("motors.*.minimum_ahead", COMMANDED, COMMAND),
    Range::upto("motors.*.minimum_astern", COMMANDED, COMMAND),
    Range::above("motors.*.n_acc_per_s", 1e9, "in the unit of the command per s; leave it out for no limit"),
    Range::above("motors.*.n_dec_per_s", 1e9, "in the unit of the command per s; leave it out for no limit"),
    Range::above("motors.*.K_V", 1e3, "the steady signal per command: 1 where the motor reaches it"),
    Range::upto("motors.*.T_1_s", 600.0, "the time constant in s; 0 for no lag"),
    Range::upto("motors.*.T_t_s", 60.0, "the dead time in s; 0 for none"),
    Range::upto("characteristics.*.p1_ahead", 1e9, THRUST),
    Range::upto("characteristics.*.p1_astern", 1e9, THRUST),
    Range::sized("characteristics.*.p2", 1e9, THRUST),
    Range::upto("characteristics.*.alpha1_ahead", 100.0, SHAPE),
    Range::upto("characteristics.*.alpha1_astern", 100.0, SHAPE),
    Range::sized("characteristics.*.alpha2", 100.0, SHAPE),
    Range::above("characteristics.*.diameter_m", 100.0, LENGTH),
    Range::within("characteristics.*.wake", [-1.0, 0.99], "a share of the speed: 0 in open water"),
    Range::within(
        "characteristics.*.thrust_deduction",
        [-1.0, 0.99],
        "a share of the thrust: 0 in open water",
    ),
    Range::sized("characteristics.*.q1", 1e9, THRUST),
    Range::sized("characteristics.*.q2", 1e9, THRUST),
    Range::upto("characteristics.*.power_w_s3", 1e9, "give it in W per (rev/s)3"),
    Range::sized("characteristics.*.ahead", 1e9, "give a0, a1 and a11 in N per power of the command"),
    Range::sized("characteristics.*.astern", 1e9, "give a0, a1 and a11 in N per power of the command"),
    Range::sized("characteristics.*.signal", COMMANDED, "give it in the unit of the command, from neutral"),
    Range::above("characteristics.*.voltage_v", 1e5, "give it in V"),
    Range::sized("characteristics.*.force_n", 1e9, "give it in N"),
    Range::sized("thrusters[].neutral", COMMANDED, "give it in the unit of the command"),
    Range::sized("thrusters[].position_m", FAR, "give metres from O, forward, starboard, down"),
    Range::sized("thrusters[].direction", COMMANDED, DIRECTION),
    Range::sized("thrusters[].wrench_per_newton", FAR, "give it per newton, levers in metres"),
    Range::sized("fins[].neutral", 7.0, "give it in rad"),
    Range::within("fins[].offset_deg", [-90.0, 90.0], "give the deflection at neutral in degrees"),
    Range::sized("fins[].position_m", FAR, "give metres from O, forward, starboard, down"),
    Range::sized("fins[].chord", COMMANDED, DIRECTION),
    Range::sized("fins[].normal", COMMANDED, DIRECTION),
    Range::above("fins[].area_m2", 1e4, "give it in m2"),
    Range::within(
        "fins[].aspect_ratio",
        [1e-3, 1e3],
        "span over mean chord, doubled where the hull stands at the root",
    ),
    Range::within("fins[].oswald", [0.01, 2.0], "0.7 to 0.95 of most fins"),
    Range::upto("fins[].C_L_alpha", 100.0, SHAPE),
    Range::above("fins[].C_L_max", 100.0, SHAPE),
    Range::upto("fins[].C_D_0", 100.0, SHAPE),
    Range::upto("fins[].C_D_90", 100.0, SHAPE),
];

/// The autopilot file.
pub const AUTOPILOT: &[Range] = &[
    Range::within("format", [1.0, 1.0], "this version reads format = 1"),
    Range::within("period_s", [1e-4, 10.0], "the control period in s: 0.02 to 0.2 for most vehicles"),
    Range::sized("schedule.speeds_m_s", 100.0, SPEED),
    Range::upto("modes[].from_speed_m_s", 100.0, SPEED),
    Range::upto("modes[].hysteresis_m_s", 100.0, SPEED),
    Range::upto("loops.*.K_P", 1e12, GAIN),
    Range::upto("loops.*.K_I_per_s", 1e12, GAIN),
    Range::upto("loops.*.K_D_s", 1e12, GAIN),
    Range::above("loops.*.tau_max", 1e12, "the largest demand in N or N m"),
    Range::above(
        "loops.*.reference_rad_s",
        1e3,
        "the natural frequency in rad/s; leave it out for no filter",
    ),
    Range::above("guidance.lookahead_m", 1e5, DEFAULT),
    Range::above("guidance.lookahead_vertical_m", 1e5, DEFAULT),
    Range::upto("guidance.lookahead_speed_m_s", 100.0, DEFAULT),
    Range::upto("guidance.integral_gain_m_s", 100.0, DEFAULT),
    Range::upto("guidance.integral_gain_vertical_m_s", 100.0, DEFAULT),
    Range::above("guidance.pitch_max_deg", 85.0, DEFAULT),
    Range::upto("guidance.turn_radius_m", 1e5, DEFAULT),
    Range::upto("guidance.turn_delay_s", 600.0, DEFAULT),
    Range::above("guidance.turn_rate_max_deg_s", 1e4, DEFAULT),
    Range::above("guidance.pitch_rate_max_deg_s", 1e4, DEFAULT),
    Range::above("guidance.depth_rate_max_m_s", 100.0, DEFAULT),
    Range::above("guidance.speed_max_m_s", 100.0, DEFAULT),
    Range::above("guidance.acceleration_max_m_s2", 1e3, DEFAULT),
    Range::upto("guidance.turn_speed_share", 1.0, DEFAULT),
    Range::above("guidance.hold_gain_per_s", 100.0, DEFAULT),
    Range::above("guidance.hold_radius_m", 1e5, DEFAULT),
    Range::above("guidance.watch_radius_m", 1e5, DEFAULT),
    Range::upto("guidance.weathervane_gain_rad_m", 1e3, DEFAULT),
    Range::above("guidance.loiter_radius_m", 1e5, DEFAULT),
    Range::above("allocation.weights.*", 1e12, "a factor on the cost of an actuator's force: 1 as it is"),
    Range::within("allocation.priority.*", [1e-3, 1e3], "X and Y 1, Z 3, K, M and N 10 by default"),
    Range::upto("allocation.start_share", 10.0, "a share of the smallest signal: 1 starts there"),
    Range::upto("allocation.stop_share", 10.0, "a share of the smallest signal, at most start_share"),
    Range::sized("allocation.idle.*", COMMANDED, "give it in the unit of the command, from neutral"),
    Range::upto(
        "allocation.redistribution_passes",
        16.0,
        "each pass hands on what saturated actuators leave",
    ),
    Range::upto("allocation.fin_least_speed_m_s", 100.0, SPEED),
    Range::above("safety.surface_speed_m_s", 100.0, SPEED),
    Range::above("safety.surfaced_above_m", FAR, LENGTH),
    Range::above("safety.frozen_after_s", YEAR, "give it in seconds; a year is never"),
    Range::above(
        "safety.*.after_s",
        YEAR,
        "give it in seconds; reaction = \"continue\" watches without a reaction",
    ),
    Range::within("safety.battery.below", [0.0, 0.999], "a share of the charge, 0.1 for a tenth"),
    Range::above("safety.contradiction.position_m", FARTHEST, NEVER),
    Range::above("safety.contradiction.depth_m", DEEPEST, NEVER),
    Range::above("safety.contradiction.angle_deg", TURNED, NEVER),
    Range::above("safety.contradiction.heading_off_deg", TURNED, NEVER),
    Range::above("safety.contradiction.pitch_off_deg", TURNED, NEVER),
    Range::above("safety.contradiction.gyro_off_deg_s", 1e4, NEVER),
    Range::above("safety.contradiction.roughness_m_s", 100.0, NEVER),
    Range::above("safety.contradiction.after_s", YEAR, NEVER),
    Range::above("safety.contradiction.over_after_s", YEAR, NEVER),
    Range::above("safety.speed.off_m_s", 100.0, NEVER),
    Range::above("safety.speed.after_s", YEAR, NEVER),
    Range::above("safety.ascent_after_s", YEAR, NEVER),
    Range::above("safety.actuator.after_s", YEAR, TIME),
    Range::above("safety.actuator.deviation", 1e3, "a share of the largest signal"),
    Range::above("lqr[].tracking_s", 1e6, TIME),
    Range::sized("lqr[].gain", 1e12, "design the gains again"),
];

/// The mission file. Legs have different keys by their kind; a key means the same in all of them.
pub const MISSION: &[Range] = &[
    Range::within("format", [1.0, 1.0], "this version reads format = 1"),
    Range::above("speed_m_s", 100.0, SPEED),
    Range::above("acceptance_radius_m", 1e4, LENGTH),
    Range::within("origin.latitude_deg", [-90.0, 90.0], "give it in degrees, north positive"),
    Range::within("origin.longitude_deg", [-180.0, 180.0], "give it in degrees, east positive"),
    Range::sized("start.north_m", FARTHEST, PLACE),
    Range::sized("start.east_m", FARTHEST, PLACE),
    Range::upto("start.depth_m", DEEPEST, DEPTH),
    Range::sized("start.heading_deg", TURNED, BEARING),
    Range::above("limits.max_depth_m", DEEPEST, DEPTH),
    Range::upto("limits.min_altitude_m", DEEPEST, "give metres above the bottom"),
    Range::above("limits.max_time_s", YEAR, TIME),
    Range::sized("limits.fence_m", FARTHEST, PLACE),
    Range::sized("legs[].north_m", FARTHEST, PLACE),
    Range::sized("legs[].east_m", FARTHEST, PLACE),
    Range::upto("legs[].depth_m", DEEPEST, DEPTH),
    Range::upto("legs[].end_depth_m", DEEPEST, DEPTH),
    Range::upto("legs[].depths_m", DEEPEST, DEPTH),
    Range::above("legs[].altitude_m", DEEPEST, "give metres above the bottom"),
    Range::above("legs[].speed_m_s", 100.0, SPEED),
    Range::above("legs[].acceptance_radius_m", 1e4, LENGTH),
    Range::above("legs[].hold_s", YEAR, TIME),
    Range::above("legs[].stop_s", YEAR, TIME),
    Range::sized("legs[].heading_deg", TURNED, BEARING),
    Range::sized("legs[].start_bearing_deg", TURNED, BEARING),
    Range::above("legs[].circle_radius_m", 1e5, LENGTH),
    Range::above("legs[].turns", 1e4, "give the number of turns; it may be fractional"),
    Range::above("legs[].length_m", 1e5, LENGTH),
    Range::above("legs[].width_m", 1e5, LENGTH),
    Range::above("legs[].spacing_m", 1e5, LENGTH),
    Range::upto("legs[].overshoot_m", 1e5, LENGTH),
    Range::upto("legs[].start_radius_m", 1e5, LENGTH),
    Range::upto("legs[].end_radius_m", 1e5, LENGTH),
    Range::above("legs[].tolerance_m", 1e4, LENGTH),
    Range::above("legs[].radius_m", 1e5, LENGTH),
    Range::sized("legs[].corners_m", FARTHEST, PLACE),
    Range::above("legs[].distance_m", 1e5, LENGTH),
    Range::upto("legs[].margin_m", 1e5, LENGTH),
    Range::upto("legs[].stops", 1e4, "give the number of stops per round"),
    Range::sized("obstacles[].north_m", FARTHEST, PLACE),
    Range::sized("obstacles[].east_m", FARTHEST, PLACE),
    Range::above("obstacles[].radius_m", 1e5, LENGTH),
    Range::sized("obstacles[].corners_m", FARTHEST, PLACE),
    Range::upto("obstacles[].distance_m", 1e5, LENGTH),
    Range::sized("landmarks[].north_m", FARTHEST, PLACE),
    Range::sized("landmarks[].east_m", FARTHEST, PLACE),
    Range::sized("landmarks[].depth_m", 1.2e4, LENGTH),
    Range::sized("landmarks[].facing_deg", TURNED, BEARING),
    Range::above("landmarks[].radius_m", 1e5, LENGTH),
];

/// Tables without a number, and lists of them: a list in the place of one is refused like that of any other table.
pub(super) const TABLES: &[&str] = &["feed_forward"];

/// How many entries a list may have: more is a slip, or a file that no one can check.
pub(super) const LENGTHS: &[(&str, usize)] = &[
    ("controllable", 6),
    ("geometry.appendages", 1_000),
    ("cross_flow.x_m", 1_000),
    ("cross_flow.diameter_m", 1_000),
    ("cross_flow.height_m", 1_000),
    ("thrusters", 100),
    ("fins", 100),
    ("characteristics.*.signal", 10_000),
    ("characteristics.*.voltage_v", 1_000),
    ("characteristics.*.force_n", 10_000),
    ("modes", 100),
    ("modes[].loops", 100),
    ("modes[].actuators", 1_000),
    ("lqr", 100),
    ("limits.fence_m", 1_000),
    ("legs", 10_000),
    ("legs[].corners_m", 1_000),
    ("legs[].depths_m", 1_000),
    ("obstacles", 1_000),
    ("landmarks", 100),
    ("obstacles[].corners_m", 1_000),
];
