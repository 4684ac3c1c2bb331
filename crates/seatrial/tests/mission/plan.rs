//! Length, time, course and slope.

use crate::mission::mission;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Rounding of sums of some hundred metres.
const ROUNDING: f64 = 1e-9;

#[test]
fn law_plan_sums_straight_ways_in_space_at_their_speeds() {
    let m = mission(
        "[[legs]]\nnorth_m = 30\neast_m = 40\ndepth_m = 0\nspeed_m_s = 2\n[[legs]]\nnorth_m = 30\neast_m = 28\ndepth_m = 5\nhold_s = 60\n",
    );
    // 50 m at 2 m/s, then 12 and 5: 13 m at 1 m/s, then a minute.
    assert!((m.path_length() - 63.0).abs() < ROUNDING);
    assert!((m.planned_time() - (25.0 + 13.0 + 60.0)).abs() < ROUNDING);
    assert!((m.courses()[0] - 40.0_f64.atan2(30.0)).abs() < 1e-15);
    assert!((m.courses()[1] + FRAC_PI_2).abs() < 1e-15);
    assert_eq!(m.slopes()[0], 0.0);
    // The platform's own arc tangent may differ from the core's by an ulp.
    let (leg, slope) = m.steepest();
    assert_eq!(leg, 1);
    assert!((slope + 5.0_f64.atan2(12.0)).abs() < 1e-15);
    assert_eq!(m.start_heading(), m.courses()[0]);
}

#[test]
fn law_plan_joins_a_circle_at_its_near_side_and_leaves_it_after_its_turns() {
    // From the south to a circle of 10 m about (50, 0): joined at (40, 0). A quarter to starboard leads over west
    // of the centre, (50, -10); to port over east.
    for (direction, east) in [("starboard", -10.0), ("port", 10.0)] {
        let m = mission(&format!(
            "[[legs]]\nnorth_m = 50\neast_m = 0\ndepth_m = 0\ncircle_radius_m = 10\nturns = 1.25\ndirection = '{direction}'\nspeed_m_s = 2\n[[legs]]\nnorth_m = 50\neast_m = 100\n"
        ));
        let circle = TAU * 10.0 * 1.25;
        assert!((m.path_length() - (40.0 + circle + 100.0 - east)).abs() < ROUNDING);
        assert!((m.planned_time() - ((40.0 + circle) / 2.0 + 100.0 - east)).abs() < ROUNDING);
    }
}

#[test]
fn law_plan_climbs_between_altitudes_and_knows_nothing_between_depth_and_altitude() {
    let m = mission(
        "[start]\ndepth_m = 7\nheading_deg = 135\n[[legs]]\nnorth_m = 10\neast_m = 0\naltitude_m = 3\n[[legs]]\nnorth_m = 10\neast_m = 10\naltitude_m = 13\n",
    );
    assert_eq!(m.slopes()[0], 0.0);
    assert!((m.slopes()[1] - FRAC_PI_4).abs() < 1e-15);
    assert_eq!(m.start_heading(), 0.75 * PI);
}

#[test]
fn law_plan_keeps_the_course_on_a_vertical_way() {
    let m = mission(
        "[[legs]]\nnorth_m = 0\neast_m = 10\ndepth_m = 2\n[[legs]]\nnorth_m = 0\neast_m = 10\ndepth_m = 9\n[[legs]]\nnorth_m = 0\neast_m = 0\n",
    );
    assert_eq!(m.courses()[..2], [FRAC_PI_2, FRAC_PI_2]);
    assert_eq!(m.steepest(), (1, -FRAC_PI_2));
    assert!((m.path_length() - (10.0_f64.hypot(2.0) + 7.0 + 10.0)).abs() < ROUNDING);
}
