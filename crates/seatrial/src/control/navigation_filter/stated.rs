//! A filter as a caller states it: names and numbers, SI, of which a [`Fitting`] is made.
//!
//! Tests: `tests/flight/test_navigation.py`, `tests/report/test_page_in_browser.py`.

use super::fitting::{Fitting, Instrument, KINDS, Landmark};
use crate::description::Description;
use crate::error::{Error, nearest};
use crate::filter::innovation::Gate;
use crate::filter::observation::Surface;
use crate::filter::swell::Swell;
use crate::model::kinematics::from_euler;
use serde::Deserialize;

/// What a filter is made of; what is missing is that of a good model.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stated {
    /// Per kind of [`KINDS`] noise, offset, latency (s), lever arm (3, m), roll, pitch and yaw of the mounting (rad).
    pub instruments: Vec<(String, [f64; 9])>,
    /// Name and kind with its numbers: "beacon" (north, east, down), "wall" (unit normal and offset), "pen" (north, east,
    /// radius).
    #[serde(default)]
    pub landmarks: Vec<(String, String, Vec<f64>)>,
    /// Unit normal and offset of the bottom.
    pub bottom: Option<[f64; 4]>,
    /// Deviations of the force that the model does not know, N and N m.
    pub force: Option<[f64; 6]>,
    /// Its time constant, s.
    pub force_time_s: Option<f64>,
    /// Velocity that white acceleration makes in a second, m/s and rad/s.
    pub acceleration: Option<[f64; 6]>,
    /// Deviations of the current, m/s.
    pub current: Option<[f64; 3]>,
    /// Its time constant, s.
    pub current_time_s: Option<f64>,
    /// Deviations of its gusts (north, east, down, m/s), their time constant and that of their second lag (s).
    pub gusts: Option<([f64; 3], [f64; 2])>,
    /// Random walk of the gyro's offset, rad/s in a square root of s.
    pub gyro_walk: f64,
    /// Deviations beyond which a sample is refused, and the time of refusals after which it is believed, s.
    pub gate: [f64; 2],
    /// North, east, down at the start and the deviation of that, m.
    pub start: [f64; 4],
    /// How much later than its latency a sample may be, s.
    #[serde(default)]
    pub longest_age_s: f64,
    /// Whether the vehicle is simulated by the model itself.
    #[serde(default)]
    pub exact_model: bool,
}

impl Stated {
    /// The fitting on a model, at a period, s, in waves of a swell.
    ///
    /// # Errors
    /// A kind of sensor or landmark that is not known.
    pub fn fitting(&self, model: &Description, period: f64, swell: Option<Swell>) -> Result<Fitting, Error> {
        let mut instruments = [None; KINDS.len()];
        for (kind, [noise, bias, latency, x, y, z, roll, pitch, yaw]) in &self.instruments {
            let index = KINDS.iter().position(|known| known == kind).ok_or_else(|| {
                Error::simulation(format!("instruments: unknown kind \"{kind}\"{}", nearest(kind, KINDS)))
            })?;
            let mount = from_euler(&[*roll, *pitch, *yaw]);
            let (noise, bias, latency) = (*noise, *bias, *latency);
            instruments[index] = Some(Instrument { noise, bias, latency, arm: [*x, *y, *z], mount });
        }
        let mut noise = Fitting::noise_of(model, &instruments, self.exact_model);
        noise.force = self.force.unwrap_or(noise.force);
        noise.acceleration = self.acceleration.unwrap_or(noise.acceleration);
        noise.current = self.current.unwrap_or(noise.current);
        noise.gyro_walk = self.gyro_walk;
        noise.force_time = self.force_time_s.map_or(noise.force_time, |time| [time; 6]);
        noise.current_time = self.current_time_s.map_or(noise.current_time, |time| [time; 3]);
        if let Some(gusts) = &self.gusts {
            noise = Fitting::in_gusts(model, noise, gusts, self.exact_model);
        }
        let [north, east, down, far] = self.start;
        Ok(Fitting {
            instruments,
            landmarks: self.landmarks.iter().map(landmark).collect::<Result<_, _>>()?,
            bottom: self.bottom.map(plane),
            swell,
            noise,
            gate: Gate { threshold: self.gate[0] * self.gate[0], patience: self.gate[1] },
            start: ([north, east, down], far),
            period,
            longest_age: self.longest_age_s,
        })
    }
}

fn plane([x, y, z, offset]: [f64; 4]) -> Surface {
    Surface::Plane { normal: [x, y, z], offset }
}

fn landmark((name, kind, numbers): &(String, String, Vec<f64>)) -> Result<(String, Landmark), Error> {
    let found = match (kind.as_str(), &numbers[..]) {
        ("beacon", &[north, east, down]) => Landmark::Beacon([north, east, down]),
        ("wall", &[x, y, z, offset]) => Landmark::Surface(plane([x, y, z, offset])),
        ("pen", &[north, east, radius]) => {
            Landmark::Surface(Surface::Cylinder { centre: [north, east], radius })
        }
        _ => {
            return Err(Error::simulation(format!(
                "landmarks: {name}: expected a beacon, wall or pen, found {kind} {numbers:?}"
            )));
        }
    };
    Ok((name.clone(), found))
}
