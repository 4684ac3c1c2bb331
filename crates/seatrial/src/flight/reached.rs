//! Which waypoints a flight reached, from its rows: the one judgement for runs and for the page of a report.
//!
//! A waypoint is reached where the autopilot perceived the vehicle within the radius of acceptance R, and the vehicle
//! truly was within 1.5 R: sensors err, and a leg ends as soon as they show R. A turn begins before its waypoint, so
//! that the next leg counts too where the vehicle only passes.
//!
//! Tests: `tests/flight/test_flight.py`, `tests/report/test_page_same_flight.py`.

use super::log::columns;
use crate::control::autopilot::file::DepthBy;
use crate::control::autopilot::settings::Settings;
use crate::control::navigation::{ALTITUDE, CHANNELS};
use crate::mission::{Mission, Task, Vertical, Waypoint};
use crate::number::plain::hypot;

/// Share of the radius of acceptance within which a vehicle must truly be where its sensors show it within the radius.
pub const TRULY: f64 = 1.5;

/// Rounding of a perceived distance, m: guidance goes on at the radius itself.
const ROUNDING_M: f64 = 1e-6;

/// A moment of a flight.
pub struct Moment {
    /// True north, east, depth and altitude, m.
    pub place: [f64; 4],
    /// The same as the autopilot was told.
    pub shown: [f64; 4],
    /// The leg.
    pub leg: usize,
    /// Whether it is on the mission: not complete yet, and without any reaction.
    pub under_way: bool,
}

/// How near a flight came to a waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Smallest true distance, m; infinite where the leg was never begun.
    pub truly: f64,
    /// Smallest perceived distance, m.
    pub perceived: f64,
    /// Whether the waypoint was reached.
    pub reached: bool,
}

/// Radius of the circle that is flown where station cannot be kept, m; 0 for a vehicle that can.
pub fn loiter_radius(settings: &Settings) -> f64 {
    let can_stop = settings.modes.first().is_none_or(|mode| mode.depth_by == DepthBy::Heave);
    if can_stop { 0.0 } else { settings.file.guidance.loiter_radius_m }
}

/// The moments of a log with the columns of [`columns`], `width` numbers a row.
pub fn moments(values: &[f64], width: usize) -> Vec<Moment> {
    let names = columns();
    let column = |name: &str| names.iter().position(|known| known == name).unwrap_or(0);
    let [leg, done, alert] = ["leg", "done", "alert"].map(column);
    let of = |row: &[f64], first: usize| [row[first], row[first + 1], row[first + 2], row[first + ALTITUDE]];
    let moment = |row: &[f64]| Moment {
        place: of(row, 0),
        shown: of(row, CHANNELS),
        leg: row[leg] as usize,
        under_way: row[alert] == 0.0 && row[done] < 0.5 && row[..3].iter().all(|x| x.is_finite()),
    };
    values.chunks_exact(width.max(1)).map(moment).collect()
}

/// How near the moments of a flight came to every waypoint of its mission.
pub fn nearest(mission: &Mission, loiter_radius: f64, moments: &[Moment]) -> Vec<Nearest> {
    let count = mission.waypoints.len();
    let mut spans: Vec<Option<[usize; 2]>> = vec![None; count];
    for (row, moment) in moments.iter().enumerate().filter(|(_, moment)| moment.under_way) {
        if let Some(span) = spans.get_mut(moment.leg) {
            *span = Some([span.map_or(row, |[first, _]| first), row]);
        }
    }
    let of = |k: usize| {
        let Some([first, last]) = spans[k] else {
            return Nearest { truly: f64::INFINITY, perceived: f64::INFINITY, reached: false };
        };
        let waypoint = &mission.waypoints[k];
        let passes = waypoint.task == Task::Pass;
        let after = spans.get(k + 1).copied().flatten().filter(|_| passes);
        // The row in which guidance goes on to the next leg is the one in which it perceived the waypoint reached.
        let end = after.map_or(last, |[_, last]| last).saturating_add(1).min(moments.len() - 1);
        let smallest = |of: fn(&Moment) -> &[f64; 4]| {
            let distances = moments[first..=end].iter().map(|m| distance(waypoint, loiter_radius, of(m)));
            distances.fold(f64::INFINITY, |least, x| if x < least { x } else { least })
        };
        let (truly, perceived) = (smallest(|m| &m.place), smallest(|m| &m.shown));
        let radius = waypoint.acceptance;
        let reached = perceived <= radius + ROUNDING_M && truly <= TRULY * radius;
        Nearest { truly, perceived, reached }
    };
    (0..count).map(of).collect()
}

/// Distance from a waypoint, or from the circle that is flown about it, m.
fn distance(waypoint: &Waypoint, loiter_radius: f64, place: &[f64; 4]) -> f64 {
    let aside = hypot(place[0] - waypoint.position[0], place[1] - waypoint.position[1]);
    let third = if waypoint.vertical == Vertical::Altitude { place[3] } else { place[2] };
    let below = third - waypoint.position[2];
    match waypoint.task {
        Task::Circle { radius, .. } => hypot(aside - radius, below),
        // A vehicle that cannot stop circles the point instead.
        Task::Hold { .. } if loiter_radius > 0.0 => {
            let (point, circle) = (hypot(aside, below), hypot(aside - loiter_radius, below));
            if circle < point { circle } else { point }
        }
        _ => hypot(aside, below),
    }
}
