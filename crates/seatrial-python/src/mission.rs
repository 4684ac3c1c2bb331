//! `Mission`: a mission file, and its waypoints as columns.

use crate::convert::{Array, Fact, Numbers, Table};
use crate::error::{raised, refused};
use crate::pickle::restorer;
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use seatrial::description::facts::Value;
use seatrial::flight::obstacle::{Hull, clearance};
use seatrial::flight::reached::{Moment, Nearest, nearest};
use seatrial::mission::farm::Farm;
use seatrial::mission::{Mission as Core, Obstacle, Task, Vertical, Waypoint};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A column of a table: numbers or words.
#[derive(IntoPyObject)]
pub enum Column {
    /// Numbers.
    Numbers(Array),
    /// Words.
    Words(Vec<String>),
}

/// A mission: waypoints, where it starts and what it may not leave. Immutable.
///
/// Raises
/// ------
/// VehicleError
///     What is wrong with the file, in which leg, at which key, and what to do.
///
/// Examples
/// --------
/// >>> from seatrial._core import Mission
/// >>> head = 'format = 1\nname = "out"\nspeed_m_s = 2.0\nacceptance_radius_m = 3.0\n'
/// >>> mission = Mission.from_toml(head + '[[legs]]\nnorth_m = 30.0\neast_m = 40.0\n')
/// >>> mission.length, mission.planned_time, mission.waypoints["label"]
/// (50.0, 25.0, ['waypoint 1'])
#[pyclass(frozen, module = "seatrial")]
pub struct Mission {
    pub core: Arc<Core>,
}

#[pymethods]
impl Mission {
    /// The mission of the TOML text of a mission file in metres; `source` stands in messages.
    #[staticmethod]
    #[pyo3(signature = (text, source = "<text>"))]
    fn from_toml(text: &str, source: &str) -> PyResult<Self> {
        Core::from_toml(text, source).map(|core| Self { core: Arc::new(core) }).map_err(raised)
    }

    /// The mission file as written, TOML; with `expanded` every pattern as waypoints.
    #[pyo3(signature = (*, expanded = false))]
    fn to_toml(&self, expanded: bool) -> String {
        if expanded { self.core.to_expanded_toml() } else { self.core.to_toml() }
    }

    /// The same as plain data: the tables of the file by name, patterns as written, defaults filled in.
    fn to_dict(&self) -> Table {
        Table::of(&self.core.file)
    }

    /// The legs as the file has them, in order: kind ("waypoint", "lawnmower", "spiral", "perimeter") and its keys, with
    /// their units and defaults; what has no default and is not given is missing.
    #[getter]
    fn legs(&self) -> Vec<Table> {
        self.core.file.legs.iter().map(Table::of).collect()
    }

    /// What stands in the water: the farms that the mission goes about, then its obstacles. Per thing north_m, east_m and
    /// radius_m, or corners_m [[north, east], …]; distance_m, how near the hull may come as the mission promises; and leg,
    /// the number of the leg that goes about it, 0 without.
    #[getter]
    fn obstacles(&self) -> Vec<BTreeMap<&'static str, Fact>> {
        let shown = |obstacle: &Obstacle| {
            let number = |x: f64| Fact::of(Value::Number(x));
            let mut facts = match &obstacle.shape {
                Farm::Circle { centre: [north, east], radius } => BTreeMap::from([
                    ("north_m", number(*north)),
                    ("east_m", number(*east)),
                    ("radius_m", number(*radius)),
                ]),
                Farm::Polygon(corners) => {
                    let corners = corners.iter().map(|corner| Value::Vector(corner.to_vec()));
                    BTreeMap::from([("corners_m", Fact::of(Value::List(corners.collect())))])
                }
            };
            facts.insert("distance_m", number(obstacle.distance));
            facts.insert("leg", number(obstacle.leg.unwrap_or(0) as f64));
            facts
        };
        self.core.obstacles.iter().map(shown).collect()
    }

    /// How near a flight came to every waypoint: the smallest true and perceived distance in m (infinite where the leg was
    /// never begun), and 1.0 where it was reached, shape (waypoints, 3). `place` and `shown` (n, 4) are true and perceived
    /// north, east, depth and altitude in m, `leg` and `under_way` (n,) the leg and whether the row is on the mission;
    /// `loiter_radius` is that of a vehicle that cannot stop, else 0.
    fn reached(
        &self,
        place: Numbers,
        shown: Numbers,
        leg: Vec<usize>,
        under_way: Vec<bool>,
        loiter_radius: f64,
    ) -> PyResult<Array> {
        let (place, shown) = (place.rows::<4>("place")?, shown.rows::<4>("shown")?);
        for (name, rows) in [("shown", shown.len()), ("leg", leg.len()), ("under_way", under_way.len())] {
            if rows != place.len() {
                return Err(refused(format!("{name}: expected {} rows as place, found {rows}", place.len())));
            }
        }
        let moment = |row: usize| Moment {
            place: place[row],
            shown: shown[row],
            leg: leg[row],
            under_way: under_way[row],
        };
        let moments: Vec<Moment> = (0..place.len()).map(moment).collect();
        let row = |n: &Nearest| [n.truly, n.perceived, f64::from(u8::from(n.reached))];
        let rows: Vec<[f64; 3]> = nearest(&self.core, loiter_radius, &moments).iter().map(row).collect();
        Ok(Array::rows(&rows, false))
    }

    /// Horizontal distance in m of the hull of a vehicle, without one of its origin, from the nearest of what stands in the water, and the smallest one
    /// beyond what the mission promises, shape (n, 2), at positions (n, 3) and attitudes (n, 3), roll, pitch, yaw in rad;
    /// infinite where there is none. `obstacles` are further cylinders: north, east and radius in m.
    #[pyo3(signature = (vehicle, position, euler, *, obstacles = Vec::new()))]
    fn clearance(
        &self,
        vehicle: Option<PyRef<'_, Vehicle>>,
        position: Numbers,
        euler: Numbers,
        obstacles: Vec<(f64, f64, f64)>,
    ) -> PyResult<Array> {
        let (position, euler) = (position.rows::<3>("position")?, euler.rows::<3>("euler")?);
        if position.len() != euler.len() {
            return Err(refused(format!(
                "euler: expected {} rows as position, found {}",
                position.len(),
                euler.len()
            )));
        }
        let standing = self.core.with_cylinders(&obstacles);
        let hull = vehicle.map_or(Hull::default(), |vehicle| Hull::of(&vehicle.description));
        let rows = position.iter().zip(&euler).map(|([x, y, z], [roll, pitch, yaw])| {
            clearance(&standing, hull, &[*x, *y, *z, *roll, *pitch, *yaw])
        });
        Ok(Array::rows(&rows.collect::<Vec<_>>(), false))
    }

    /// Known places that acoustic sensors see: name, kind ("beacon", "wall", "pen"), north_m, east_m, and depth_m, facing_deg
    /// or radius_m.
    #[getter]
    fn landmarks(&self) -> Vec<Table> {
        self.core.file.landmarks.iter().map(Table::of).collect()
    }

    /// Number of the leg in the file, from 1, that each waypoint belongs to.
    #[getter]
    fn leg_numbers(&self) -> Vec<usize> {
        self.core.legs.clone()
    }

    /// Name of the mission.
    #[getter]
    fn name(&self) -> &str {
        &self.core.file.name
    }

    /// What the mission is for, in a sentence.
    #[getter]
    fn description(&self) -> &str {
        &self.core.file.description
    }

    /// Latitude and longitude of the origin in degrees; none where the file has none.
    #[getter]
    fn origin(&self) -> Option<(f64, f64)> {
        self.core.file.origin.map(|origin| (origin.latitude_deg, origin.longitude_deg))
    }

    /// The waypoints as columns of equal length, in the order of travel.
    ///
    /// Places `north_m`, `east_m`, `depth_m`, `altitude_m` (NaN in the one of the last two that `vertical` does not
    /// name); `speed_m_s` on the way there; `acceptance_radius_m`; `hold_s` (0 without) with `heading` in rad (NaN where
    /// free); `circle_radius_m` (0 without) with `turns`, positive to starboard; `course` and `slope` of the straight
    /// way there in rad, the slope positive upwards; `label`.
    #[getter]
    fn waypoints(&self) -> BTreeMap<&'static str, Column> {
        let points = &self.core.waypoints;
        let numbers = |values: Vec<f64>| Column::Numbers(Array::new(&[values.len()], values));
        let column = |value: &dyn Fn(&Waypoint) -> f64| numbers(points.iter().map(value).collect());
        let words = |word: &dyn Fn(&Waypoint) -> String| Column::Words(points.iter().map(word).collect());
        let level = |of: Vertical| {
            column(&move |w: &Waypoint| if w.vertical == of { w.position[2] } else { f64::NAN })
        };
        let hold = |w: &Waypoint| match w.task {
            Task::Hold { seconds, heading } => (seconds, heading.unwrap_or(f64::NAN)),
            _ => (0.0, f64::NAN),
        };
        let circle = |w: &Waypoint| match w.task {
            Task::Circle { radius, clockwise, turns } => (radius, if clockwise { turns } else { -turns }),
            _ => (0.0, 0.0),
        };
        BTreeMap::from([
            ("north_m", column(&|w| w.position[0])),
            ("east_m", column(&|w| w.position[1])),
            ("depth_m", level(Vertical::Depth)),
            ("altitude_m", level(Vertical::Altitude)),
            (
                "vertical",
                words(&|w| if w.vertical == Vertical::Depth { "depth" } else { "altitude" }.to_owned()),
            ),
            ("speed_m_s", column(&|w| w.speed)),
            ("acceptance_radius_m", column(&|w| w.acceptance)),
            ("hold_s", column(&|w| hold(w).0)),
            ("heading", column(&|w| hold(w).1)),
            ("circle_radius_m", column(&|w| circle(w).0)),
            ("turns", column(&|w| circle(w).1)),
            ("course", numbers(self.core.courses())),
            ("slope", numbers(self.core.slopes())),
            ("label", words(&|w| w.label.clone())),
        ])
    }

    /// Where the first leg begins: `north_m`, `east_m`, `depth_m`, and `heading` in rad.
    #[getter]
    fn start(&self) -> BTreeMap<&'static str, f64> {
        let [north, east, depth] = self.core.start.position;
        let heading = self.core.start_heading();
        BTreeMap::from([("north_m", north), ("east_m", east), ("depth_m", depth), ("heading", heading)])
    }

    /// What the mission may not leave: `max_depth_m` and `max_time_s` (infinite without a limit), `min_altitude_m` (0
    /// without).
    #[getter]
    fn limits(&self) -> BTreeMap<&'static str, f64> {
        let limits = &self.core.limits;
        BTreeMap::from([
            ("max_depth_m", limits.depth),
            ("min_altitude_m", limits.altitude),
            ("max_time_s", limits.time),
        ])
    }

    /// Corners (n, 2) of the fence, north and east in m; no row without one.
    #[getter]
    fn fence(&self) -> Array {
        Array::rows(&self.core.limits.fence, false)
    }

    /// Length of the path in m, from the start to the last waypoint, circles included.
    #[getter]
    fn length(&self) -> f64 {
        self.core.path_length()
    }

    /// Time for the path in s at the speeds of its legs, with station-keeping and circles.
    #[getter]
    fn planned_time(&self) -> f64 {
        self.core.planned_time()
    }

    /// Index of the waypoint with the steepest way to it, and that slope in rad, positive upwards.
    #[getter]
    fn steepest(&self) -> (usize, f64) {
        self.core.steepest()
    }

    /// Itself: nothing of it can change.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    /// Itself: nothing of it can change.
    #[expect(unused_variables, reason = "the name is Python's")]
    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((restorer(py, "_restored_mission")?, (self.core.to_toml(),)))
    }
}

/// The mission of the text of its file: how a pickled one comes back.
#[pyfunction]
#[pyo3(name = "_restored_mission")]
pub fn restored_mission(text: &str) -> PyResult<Mission> {
    Mission::from_toml(text, "<pickle>")
}
