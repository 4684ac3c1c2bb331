//! What is wrong is refused in one sentence with file, leg and key.

use crate::mission::read;
use seatrial::mission::Mission;

/// A good leg to stand before a bad one.
const FIRST: &str = "[[legs]]\nnorth_m = 20\neast_m = 0\ndepth_m = 2\n";

fn refused(legs: &str) -> String {
    let message = read(legs).map(|m| m.waypoints.len()).expect_err(legs);
    assert!(message.starts_with("test.toml: "), "{message}");
    assert!(!message.contains('\n'), "one sentence: {message}");
    message
}

/// `keys` of the second leg are refused with `sentence`.
fn leg(keys: &str, sentence: &str) {
    let message = refused(&format!("{FIRST}[[legs]]\n{}", keys.replace("; ", "\n")));
    assert!(message.contains(&format!("leg 2: {sentence}")), "{keys}\n{message}");
}

/// The file is refused with `sentence`.
fn file(text: &str, sentence: &str) {
    let message = refused(&text.replace("; ", "\n"));
    assert!(message.contains(sentence), "{text}\n{message}");
}

#[test]
fn numbers_without_meaning_are_refused_by_their_key() {
    for (keys, sentence) in [
        ("north_m = nan; east_m = 0", "north_m: expected a finite number, found NaN"),
        ("north_m = 0; east_m = -inf", "east_m: expected a finite number, found -inf"),
        ("north_m = 0; east_m = 0; depth_m = -1", "depth_m: expected zero or a positive number, found -1"),
        ("north_m = 0; east_m = 0; depth_m = inf", "depth_m: expected zero"),
        ("north_m = 0; east_m = 0; altitude_m = 0", "altitude_m: expected a positive number, found 0"),
        ("north_m = 0; east_m = 0; speed_m_s = 0", "speed_m_s: expected a positive number, found 0"),
        ("north_m = 0; east_m = 0; speed_m_s = nan", "speed_m_s: expected a positive"),
        (
            "north_m = 0; east_m = 0; acceptance_radius_m = -2",
            "acceptance_radius_m: expected a positive number",
        ),
        ("north_m = 0; east_m = 0; hold_s = -1", "hold_s: expected a positive number, found -1"),
        ("north_m = 0; east_m = 0; hold_s = 1; heading_deg = inf", "heading_deg: expected a finite"),
        ("north_m = 0; east_m = 0; circle_radius_m = 0; turns = 1", "circle_radius_m: expected a positive"),
        ("north_m = 0; east_m = 0; circle_radius_m = 5; turns = 0", "turns: expected a positive"),
    ] {
        leg(keys, sentence);
    }
}

#[test]
fn keys_that_contradict_each_other_are_refused() {
    for (keys, sentence) in [
        ("depth_m = 1; altitude_m = 1", "depth_m and altitude_m: expected one of the two, found both"),
        ("hold_s = 5; circle_radius_m = 5; turns = 1", "hold_s and circle_radius_m: expected one of the two"),
        ("circle_radius_m = 5", "turns: expected the number of turns"),
        ("turns = 5", "circle_radius_m: expected the radius"),
        ("direction = 'port'", "direction: expected only with circle_radius_m"),
        ("heading_deg = 5", "heading_deg: expected only with hold_s"),
    ] {
        leg(&format!("north_m = 0; east_m = 0; {keys}"), sentence);
    }
}

#[test]
fn patterns_without_meaning_are_refused_by_their_key() {
    let lawnmower = "kind = 'lawnmower'; north_m = 0; east_m = 0; heading_deg = 0; length_m = 50; width_m = 20; spacing_m = 5";
    let spiral =
        "kind = 'spiral'; north_m = 0; east_m = 0; start_radius_m = 5; end_radius_m = 20; spacing_m = 5";
    let perimeter = "kind = 'perimeter'; north_m = 80; east_m = 0; radius_m = 20; distance_m = 5; start_bearing_deg = 180";
    for (pattern, from, to, sentence) in [
        (lawnmower, "spacing_m = 5", "spacing_m = 0", "spacing_m: expected a positive number, found 0"),
        (lawnmower, "width_m = 20", "width_m = -1", "width_m: expected a positive number"),
        (lawnmower, "length_m = 50", "length_m = nan", "length_m: expected a positive number"),
        (lawnmower, "spacing_m = 5", "spacing_m = 1e-9", "expected at most 10000 waypoints"),
        (lawnmower, "spacing_m = 5", "spacing_m = 5; overshoot_m = -1", "overshoot_m: expected zero"),
        (spiral, "spacing_m = 5", "spacing_m = 5; turns = 2", "spacing_m and turns: expected one"),
        (spiral, "; spacing_m = 5", "", "spacing_m: expected the distance between arms"),
        (spiral, "start_radius_m = 5", "start_radius_m = 20", "turns: expected a number for equal radii"),
        (spiral, "start_radius_m = 5", "start_radius_m = -5", "start_radius_m: expected zero"),
        (
            spiral,
            "start_radius_m = 5; end_radius_m = 20; spacing_m = 5",
            "start_radius_m = 0; end_radius_m = 0; turns = 1",
            "end_radius_m: expected a radius",
        ),
        (spiral, "spacing_m = 5", "spacing_m = 5; tolerance_m = 0", "tolerance_m: expected a positive"),
        (spiral, "spacing_m = 5", "spacing_m = 1e-7", "expected at most 10000 waypoints"),
        (
            spiral,
            "spacing_m = 5",
            "spacing_m = 5; altitude_m = 3; end_depth_m = 4",
            "end_depth_m: expected a depth",
        ),
        (perimeter, "radius_m = 20", "radius_m = 0", "radius_m: expected a positive"),
        (perimeter, "distance_m = 5", "distance_m = 0", "distance_m: expected a positive"),
        (
            perimeter,
            "distance_m = 5",
            "distance_m = 5; tolerance_m = 1e-12",
            "expected at most 10000 waypoints",
        ),
        (perimeter, "distance_m = 5", "distance_m = 5; stops = 3", "stop_s: expected the time at each stop"),
        (perimeter, "distance_m = 5", "distance_m = 5; stop_s = 3", "stop_s: expected only with stops"),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[90, -9], [90, 9], [105, 9]]; stop_s = 3; stops = 700",
            "stops: expected stops more than twice",
        ),
        (perimeter, "distance_m = 5", "distance_m = 5; depths_m = [3, -3]", "depths_m: expected zero"),
        (perimeter, "radius_m = 20", "corners_m = [[0, 0]]", "expected either north_m, east_m and radius_m"),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[0, 0], [1, nan], [2, 0]]",
            "corners_m: expected a finite",
        ),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[0, 0], [1, 1]]",
            "corners_m: expected at least three corners, found 2",
        ),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[0, 0], [9, 0], [9, 0], [9, 9]]",
            "corners_m: corners 2 and 3 are the same",
        ),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[0, 0], [9, 0], [3, 3], [0, 9]]",
            "corners_m: expected a convex polygon, but corner 3 turns inwards",
        ),
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[0, 0], [9, 0], [18, 0]]",
            "corners_m: expected corners that enclose an area, but all lie on one line",
        ),
        // A pentagram turns the same way at every corner, twice round.
        (
            perimeter,
            "north_m = 80; east_m = 0; radius_m = 20",
            "corners_m = [[10, 0], [-8, 6], [3, -9.5], [3, 9.5], [-8, -6]]",
            "corners_m: expected a convex polygon, but the corners go round more than once",
        ),
    ] {
        assert!(pattern.contains(from));
        leg(&pattern.replace(from, to), sentence);
    }
}

#[test]
fn places_beyond_the_limits_are_refused() {
    let fence = "[limits]; fence_m = [[-10, -10], [-10, 10], [40, 10], [40, 30], [-10, 30], [-10, 50], [60, 50], [60, -10]]";
    let legs = FIRST.replace('\n', "; ");
    for (text, sentence) in [
        (
            format!("[limits]; max_depth_m = 5; {legs}[[legs]]; north_m = 0; east_m = 0; depth_m = 6"),
            "leg 2: \"waypoint 2\": depth_m: expected at most limits.max_depth_m = 5, found 6",
        ),
        (
            format!("[limits]; min_altitude_m = 5; {legs}[[legs]]; north_m = 0; east_m = 0; altitude_m = 4"),
            "leg 2: \"waypoint 2\": altitude_m: expected at least limits.min_altitude_m = 5, found 4",
        ),
        (
            format!("[start]; depth_m = 6; [limits]; max_depth_m = 5; {legs}"),
            "start.depth_m: expected at most limits.max_depth_m = 5, found 6",
        ),
        (
            format!("[limits]; max_time_s = 10; {legs}"),
            "limits.max_time_s: expected more than the planned 20.1 s, found 10",
        ),
        (
            format!("{fence}; {legs}[[legs]]; north_m = 20; east_m = 20"),
            "leg 2: \"waypoint 2\": north_m and east_m: expected a place inside limits.fence_m, found north 20, east 20",
        ),
        (
            format!("{fence}; {legs}[[legs]]; north_m = 20; east_m = 40"),
            "leg 2: \"waypoint 2\": expected a path inside limits.fence_m",
        ),
        (
            format!("{fence}; {legs}[[legs]]; north_m = 0; east_m = 0; circle_radius_m = 11; turns = 1"),
            "leg 2: \"waypoint 2\": circle_radius_m: expected a circle inside limits.fence_m, found radius 11",
        ),
        (
            format!("{fence}; [start]; north_m = -11; {legs}"),
            "start: expected a place inside limits.fence_m, found north -11, east 0",
        ),
        (
            format!("[limits]; fence_m = [[0, 0], [1, 1]]; {legs}"),
            "limits.fence_m: expected at least three corners, found 2",
        ),
        (
            format!("[limits]; fence_m = [[-20, -20], [80, 80], [80, -20], [-20, 80]]; {legs}"),
            "limits.fence_m: expected edges that do not cross, but those behind corners 1 and 3 do",
        ),
        (
            format!("[limits]; fence_m = [[0, 0], [1, nan], [2, 2]]; {legs}"),
            "limits.fence_m: expected a finite",
        ),
        (format!("[limits]; max_depth_m = 0; {legs}"), "limits.max_depth_m: expected a positive"),
        (format!("[limits]; max_time_s = nan; {legs}"), "limits.max_time_s: expected a positive"),
        (format!("[limits]; min_altitude_m = -1; {legs}"), "limits.min_altitude_m: expected zero"),
        (format!("[start]; north_m = inf; {legs}"), "start.north_m: expected a finite"),
        (format!("[start]; depth_m = -1; {legs}"), "start.depth_m: expected zero"),
        (format!("[start]; heading_deg = nan; {legs}"), "start.heading_deg: expected a finite"),
        (
            format!("[origin]; latitude_deg = 91; longitude_deg = 5; {legs}"),
            "origin.latitude_deg: expected a number from -90.0 to 90.0, found 91",
        ),
    ] {
        file(&text, sentence);
    }
}

#[test]
fn legs_without_length_are_refused() {
    file(
        "[[legs]]; north_m = 0.5; east_m = 0",
        "leg 1: \"waypoint 1\": acceptance_radius_m: expected less than the 0.500 m from the start, found 1",
    );
    leg(
        "north_m = 20; east_m = 0",
        "\"waypoint 2\": expected another place than that of \"waypoint 1\" before it",
    );
    file("legs = []", "legs: expected at least one [[legs]] table, found none");
    file("", "legs: expected at least one");
}

#[test]
fn keys_are_refused_with_their_leg_or_line_and_the_nearest_name() {
    leg("north_m = 20; east_m = 0; dept_m = 5", "unknown field `dept_m`");
    file("[[legs]]; north_m = 20; east_m = 0; dept_m = 5", "did you mean \"depth_m\"?");
    leg("north_m = 20", "missing field `east_m`");
    leg("north_m = 'x'; east_m = 0", "north_m: invalid type: string \"x\"");
    leg("kind = 'perimeter'; distance_m = 5; direction = 'left'", "direction: unknown variant `left`");
    let corners = "expected corners [north, east], found 3 numbers";
    leg("kind = 'perimeter'; distance_m = 5; corners_m = [[0, 0, 5]]", &format!("corners_m: {corners}"));
    let kinds = "kind: expected waypoint, lawnmower, spiral, perimeter, found";
    leg("kind = 'lawnmow'; north_m = 20", &format!("{kinds} \"lawnmow\"; did you mean \"lawnmower\"?"));
    leg("kind = 3", "kind: expected text, found 3");
    leg(
        "latitude_deg = 60.1; longitude_deg = 5",
        "latitude_deg: expected metres north and east of the origin, found a geographic place",
    );
    file("[limits]; fence_m = [[0, 0, 1], [5, 5, 1], [5, 0, 1]]", corners);
    file("[start]; heading = 4", "line 6: unknown field `heading`");
    file("[limit]; max_depth_m = 4", "did you mean \"limits\"?");
    let no_speed =
        Mission::from_toml("format = 1\nname = 'x'\n[[legs]]\nnorth_m = 9\neast_m = 0\n", "x.toml");
    let message = no_speed.expect_err("no speed anywhere").to_string();
    assert!(
        message.contains("leg 1: speed_m_s: expected a number here or at the top of the file"),
        "{message}"
    );
    let future =
        Mission::from_toml("format = 2\nspeed_kn = 3\n", "x.toml").expect_err("a later format").to_string();
    assert!(future.contains("format: this version reads format = 1, found 2"), "{future}");
}

/// Looking round from one place is a mission: holds may follow each other there, plain waypoints may not.
#[test]
fn law_holds_may_follow_each_other_at_one_place() {
    let leg = |extra: &str| format!("[[legs]]\nnorth_m = 10.0\neast_m = 0.0\ndepth_m = 2.0\n{extra}\n");
    let mission = |second: &str| {
        let head = "format = 1\nname = \"look\"\nspeed_m_s = 0.5\nacceptance_radius_m = 1.0\n";
        let first = leg("hold_s = 5.0\nheading_deg = 0.0");
        seatrial::mission::Mission::from_toml(&format!("{head}{first}{}", leg(second)), "look.toml")
    };
    let looking = mission("hold_s = 5.0\nheading_deg = 90.0").expect("a turn on the spot");
    assert_eq!(looking.waypoints.len(), 2);
    let message = mission("").expect_err("nothing to do there").to_string();
    assert!(message.contains("expected another place"), "{message}");
}
