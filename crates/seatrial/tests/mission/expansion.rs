//! What a file means: defaults, order, and the file again.

use crate::mission::mission;
use seatrial::mission::{Mission, MissionFile, Task, Vertical};
use std::f64::consts::PI;

const EXAMPLES: [(&str, &str); 3] = [
    ("farm", include_str!("../../../../examples/missions/farm.toml")),
    ("hover", include_str!("../../../../examples/missions/hover.toml")),
    ("lawnmower", include_str!("../../../../examples/missions/lawnmower.toml")),
];

fn example(k: usize) -> Mission {
    let (name, text) = EXAMPLES[k];
    Mission::from_toml(text, name).expect("a valid example")
}

#[test]
fn examples_are_flights_of_five_to_twenty_minutes_under_their_own_names() {
    for (k, (name, _)) in EXAMPLES.iter().enumerate() {
        let m = example(k);
        assert_eq!(m.file.name, *name);
        let minutes = m.planned_time() / 60.0;
        assert!((5.0..20.0).contains(&minutes), "{name} takes {minutes:.1} minutes");
        assert!(m.path_length() > 50.0);
    }
}

#[test]
fn examples_do_what_they_say() {
    let holds = |m: &Mission| m.waypoints.iter().filter(|w| matches!(w.task, Task::Hold { .. })).count();
    let (farm, hover, lawnmower) = (example(0), example(1), example(2));
    assert_eq!(holds(&farm), 12 + 1);
    assert_eq!(lawnmower.waypoints.len(), 1 + 10 + 1);
    assert_eq!(holds(&hover), 10 + 1);
    // A survey vehicle keeps its slope below what it can pitch, a hovering one moves straight down.
    assert!(
        farm.steepest().1.abs() < 20.0_f64.to_radians()
            && lawnmower.steepest().1.abs() < 10.0_f64.to_radians()
    );
    assert!(hover.steepest().1.abs() > 1.5);
}

#[test]
fn the_example_of_the_page_is_a_mission() {
    let page = include_str!("../../../../docs/mission-file.md");
    let text = page.split("```toml").nth(1).and_then(|rest| rest.split("```").next()).expect("a block");
    let m = Mission::from_toml(text, "mission-file.md").expect("a valid example");
    // Out, eight lines with two ends each, back.
    assert_eq!(m.waypoints.len(), 1 + 16 + 1);
}

#[test]
fn law_file_survives_a_round_trip_as_written_and_expanded() {
    for (k, (name, text)) in EXAMPLES.iter().enumerate() {
        let m = example(k);
        assert_eq!(m.file, MissionFile::parse(text, name).expect("parsed before"));
        assert_eq!(Mission::from_toml(&m.to_toml(), name).expect("as written"), m);
        let expanded = Mission::from_toml(&m.to_expanded_toml(), name).expect("expanded");
        assert_eq!(expanded.waypoints.len(), m.waypoints.len());
        for (a, b) in expanded.waypoints.iter().zip(&m.waypoints) {
            match (a.task, b.task) {
                (Task::Hold { heading: Some(x), .. }, Task::Hold { heading: Some(y), .. }) => {
                    // Degrees and back.
                    assert!((x - y).abs() < 1e-15);
                    assert_eq!((a.position, &a.label), (b.position, &b.label));
                }
                _ => assert_eq!(a, b),
            }
        }
        assert_eq!((expanded.start, expanded.limits.clone()), (m.start, m.limits.clone()));
    }
}

#[test]
fn law_missing_keys_come_from_the_top_and_the_leg_before() {
    let m = mission(
        "[start]\ndepth_m = 2\n[[legs]]\nnorth_m = 10\neast_m = 0\n[[legs]]\nnorth_m = 20\neast_m = 0\naltitude_m = 4\nspeed_m_s = 0.5\n\
         [[legs]]\nkind = 'waypoint'\nnorth_m = 30\neast_m = 0\nacceptance_radius_m = 2\nlabel = 'end'\n",
    );
    let vertical: Vec<_> = m.waypoints.iter().map(|w| (w.vertical, w.position[2])).collect();
    assert_eq!(vertical, [(Vertical::Depth, 2.0), (Vertical::Altitude, 4.0), (Vertical::Altitude, 4.0)]);
    assert_eq!(m.waypoints.iter().map(|w| w.speed).collect::<Vec<_>>(), [1.0, 0.5, 1.0]);
    assert_eq!(m.waypoints.iter().map(|w| w.acceptance).collect::<Vec<_>>(), [1.0, 1.0, 2.0]);
    assert_eq!(
        m.waypoints.iter().map(|w| w.label.as_str()).collect::<Vec<_>>(),
        ["waypoint 1", "waypoint 2", "end"]
    );
    assert_eq!((m.limits.depth, m.limits.altitude, m.limits.time), (f64::INFINITY, 0.0, f64::INFINITY));
    assert!(m.limits.fence.is_empty() && m.start.heading.is_none());
}

#[test]
fn law_tasks_are_read_in_rad_and_m() {
    let m = mission(
        "[[legs]]\nnorth_m = 10\neast_m = 0\nhold_s = 5\nheading_deg = 270\n[[legs]]\nnorth_m = 40\neast_m = 0\ncircle_radius_m = 8\nturns = 0.5\ndirection = 'port'\n\
         [[legs]]\nnorth_m = 60\neast_m = 0\nhold_s = 7\n",
    );
    assert_eq!(m.waypoints[0].task, Task::Hold { seconds: 5.0, heading: Some(-0.5 * PI) });
    assert_eq!(m.waypoints[1].task, Task::Circle { radius: 8.0, clockwise: false, turns: 0.5 });
    assert_eq!(m.waypoints[2].task, Task::Hold { seconds: 7.0, heading: None });
}

#[test]
fn law_depth_goes_on_where_a_pattern_ended() {
    let m = mission(
        "[[legs]]\nkind = 'spiral'\nnorth_m = 30\neast_m = 0\nstart_radius_m = 10\nend_radius_m = 2\nspacing_m = 4\ndepth_m = 2\nend_depth_m = 6\n[[legs]]\nnorth_m = 80\neast_m = 0\n",
    );
    assert_eq!(m.waypoints[m.waypoints.len() - 1].position, [80.0, 0.0, 6.0]);
}
