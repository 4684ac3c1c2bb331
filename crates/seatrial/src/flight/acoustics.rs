//! GPS, acoustic positioning and sonar of a simulated vehicle: what only its navigation filter reads.
//!
//! A sample is what the filter's own observation shows of the true pose a latency ago, with offset, white noise, digits,
//! and now and then an outlier: a second, much larger error. Beacons and positioning have a reach. A sonar shows
//! the echo of a known surface along the shortest way to it in its own plane. A GPS has a fix while its antenna is above
//! the surface: where its lever arm says, on top of the hull where it says nothing; its offset is that of the fix from which dead reckoning began.
//!
//! Tests: `tests/flight/test_acoustics.py`.

use crate::control::navigation::CHANNELS;
use crate::control::navigation_filter::fitting::{BEARING, GPS, RANGE, USBL};
use crate::control::navigation_filter::{Instrument, KINDS, LANDMARKS, Landmark, Told};
use crate::filter::estimate::Estimate;
use crate::filter::observation::{Observation, Surface};
use crate::mission::landmarks::LandmarkTable;
use crate::model::kinematics::{from_euler, rotation};
use crate::number::algebra::{Vec3, product, transposed_product};
use crate::number::plain;
use crate::number::random::{ONCE, Seed};

/// The kinds, as indices among those of the filter.
pub const DEVICES: [usize; 4] = [GPS, USBL, BEARING, RANGE];

/// The place of the first draw: beyond those of the other sensors and of the water.
const DRAWS: usize = 4096;

/// One device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// Noise, offset, lever arm and mounting.
    pub instrument: Instrument,
    /// Step of its digits; 0 for none.
    pub quantum: f64,
    /// Control periods from sample to sample, to the first one, and the age of a sample when it arrives.
    pub periods: [usize; 3],
    /// Mean time between drop-outs and their mean duration, s; infinite for none.
    pub dropouts: [f64; 2],
    /// Largest distance, m.
    pub reach: f64,
    /// Share of samples that are outliers, and the standard deviation of their further error.
    pub outliers: [f64; 2],
}

/// All devices, in the order of [`DEVICES`], and what they see.
#[derive(Clone, Debug, Default)]
pub struct Acoustics {
    /// The devices.
    pub devices: [Option<Device>; DEVICES.len()],
    /// Where the landmarks truly are, by name.
    pub landmarks: Vec<(String, Landmark)>,
    /// Where the transceiver of the acoustic positioning is, NED, m.
    pub transceiver: Vec3<f64>,
}

/// Longest latency, control periods.
pub const MOST_LATENCY: f64 = 10_000.0;

/// Numbers of a device, see [`Acoustics::of_rows`].
pub const ROW: usize = 17;

impl Acoustics {
    /// Devices by the name of their kind: noise, offset, quantum, control periods between samples, to the first and of
    /// latency, drop-outs every s, for s, reach, share and deviation of outliers, lever arm (3), roll, pitch and yaw of
    /// the mounting; SI and rad.
    ///
    /// # Errors
    /// A kind that is none of these.
    pub fn of_rows(
        rows: &[(String, [f64; ROW])],
        transceiver: Vec3<f64>,
        landmarks: &[LandmarkTable],
    ) -> Result<Self, String> {
        let landmarks = landmarks.iter().map(landmark).collect();
        let mut acoustics = Self { landmarks, transceiver, ..Self::default() };
        for (kind, row) in rows {
            let [
                noise,
                bias,
                quantum,
                every,
                first,
                late,
                gap,
                length,
                reach,
                share,
                size,
                x,
                y,
                z,
                roll,
                pitch,
                yaw,
            ] = *row;
            let index = DEVICES.iter().position(|&device| KINDS[device] == kind).ok_or_else(|| {
                format!("acoustics: expected gps, usbl, range or bearing, found \"{kind}\"")
            })?;
            let mount = from_euler(&[roll, pitch, yaw]);
            acoustics.devices[index] = Some(Device {
                instrument: Instrument { noise, bias, latency: 0.0, arm: [x, y, z], mount },
                quantum,
                periods: [every.max(1.0) as usize, first as usize, late.min(MOST_LATENCY) as usize],
                dropouts: [gap, length],
                reach,
                outliers: [share, size],
            });
        }
        Ok(acoustics)
    }
}

/// A landmark of a mission file.
fn landmark(table: &LandmarkTable) -> (String, Landmark) {
    let mark = match *table {
        LandmarkTable::Beacon { north_m, east_m, depth_m, .. } => {
            Landmark::Beacon([north_m, east_m, depth_m])
        }
        LandmarkTable::Wall { north_m, east_m, facing_deg, .. } => {
            let (sine, cosine) = plain::sin_cos(facing_deg.to_radians());
            let offset = north_m * cosine + east_m * sine;
            Landmark::Surface(Surface::Plane { normal: [cosine, sine, 0.0], offset })
        }
        LandmarkTable::Pen { north_m, east_m, radius_m, .. } => {
            Landmark::Surface(Surface::Cylinder { centre: [north_m, east_m], radius: radius_m })
        }
    };
    (table.name().to_owned(), mark)
}

/// The devices of one case at work.
pub struct Soundings {
    acoustics: Acoustics,
    /// The channels of each landmark's range and bearing in the filter; none where the filter does not know it.
    marks: Vec<Option<usize>>,
    /// The antenna of the GPS, body frame, m.
    antenna: Vec3<f64>,
    seed: Seed<f64>,
    /// Offset of the position that the vehicle began with, north and east, m.
    begun: [f64; 2],
    past: Vec<[f64; CHANNELS]>,
    count: usize,
    silent: [f64; DEVICES.len()],
}

impl Soundings {
    /// The devices before their first sample; `known` are the landmarks of the filter, `begun` deviations of the offset of
    /// the position at the start, where they are given, and `top` is where a GPS has its antenna unless it says.
    pub fn new(
        acoustics: &Acoustics,
        known: &[(String, Landmark)],
        top: &Vec3<f64>,
        (seed, begun): (f64, Option<[f64; 2]>),
    ) -> Self {
        let seed = Seed::new(seed);
        let latest = acoustics.devices.iter().flatten().map(|d| d.periods[2]).max().unwrap_or(0);
        let gps = acoustics.devices.iter().zip(DEVICES).find(|(_, kind)| *kind == GPS);
        let placed = gps.and_then(|(device, _)| *device).map(|device| device.instrument.arm);
        let place = |name: &String| known.iter().position(|(other, _)| other == name);
        Self {
            marks: acoustics
                .landmarks
                .iter()
                .map(|(name, _)| place(name).map(|k| LANDMARKS + 2 * k))
                .collect(),
            acoustics: acoustics.clone(),
            antenna: placed.filter(|arm| *arm != [0.0; 3]).unwrap_or(*top),
            begun: begun.unwrap_or_else(|| [0, 1].map(|c| seed.gaussians(ONCE, c).0)),
            seed,
            past: vec![[0.0; CHANNELS]; (latest + 1).next_power_of_two()],
            count: 0,
            silent: [0.0; DEVICES.len()],
        }
    }

    /// Adds what arrives at the next control step of `dt` seconds, at which the true channels are these.
    pub fn listen(&mut self, truth: &[f64; CHANNELS], dt: f64, heard: &mut Vec<Told>) {
        let (k, mask) = (self.count, self.past.len() - 1);
        self.past[k & mask] = *truth;
        self.count += 1;
        for index in 0..DEVICES.len() {
            let Some(device) = self.acoustics.devices[index] else { continue };
            if self.is_silent(index, &device, (k, dt)) {
                continue;
            }
            let [every, first, latency] = device.periods;
            if k < first + latency || (k - first - latency) % every != 0 {
                continue;
            }
            let at = pose(&self.past[(k - latency) & mask]);
            self.sample(index, &device, (&at, k), heard);
        }
    }

    fn is_silent(&mut self, index: usize, device: &Device, (k, dt): (usize, f64)) -> bool {
        let [every, length] = device.dropouts;
        if !every.is_finite() {
            return false;
        }
        let (chance, share) = self.seed.two_uniforms(k, DRAWS - 1 - index);
        let left = (self.silent[index] - dt).max(0.0);
        self.silent[index] = if chance < dt / every { left.max(-plain::ln(share) * length) } else { left };
        self.silent[index] > 0.5 * dt
    }

    fn sample(&self, index: usize, device: &Device, (at, k): (&Estimate, usize), heard: &mut Vec<Told>) {
        let Instrument { arm, mount, .. } = device.instrument;
        let lever = product(&at.rotation(), &arm);
        let head: Vec3<f64> = std::array::from_fn(|i| at.motion.position[i] + lever[i]);
        let distance =
            |place: &Vec3<f64>| (0..3).map(|i| plain::powi(head[i] - place[i], 2)).sum::<f64>().sqrt();
        match DEVICES[index] {
            GPS if at.motion.position[2] + product(&at.rotation(), &self.antenna)[2] < 0.0 => {
                for axis in 0..2 {
                    let offset = self.begun[axis] * device.instrument.bias;
                    let value = self.wrong(device, head[axis] + offset, (16 + axis, k));
                    heard.push((16 + axis, value, 0.0));
                }
            }
            USBL if distance(&self.acoustics.transceiver) <= device.reach => {
                for axis in 0..3 {
                    heard.push((18 + axis, self.off(device, head[axis], (18 + axis, k)), 0.0));
                }
            }
            GPS | USBL => {}
            kind => {
                for (mark, (_, place)) in self.acoustics.landmarks.iter().enumerate() {
                    let Some(channel) = self.marks[mark] else { continue };
                    let bearing = kind == BEARING;
                    let channel = channel + usize::from(bearing);
                    let beam = match place {
                        Landmark::Beacon(_) => 0.0,
                        Landmark::Surface(surface) => {
                            let seen = transposed_product(&at.rotation(), &nearest(surface, &head));
                            let [x, y, _] = transposed_product(&rotation(&mount), &seen);
                            plain::atan2(y, x)
                        }
                    };
                    let echo = place.observed(false, &device.instrument, beam);
                    let Some((range, _)) = echo.expect(at) else { continue };
                    if range > device.reach {
                        continue;
                    }
                    let shown = match (bearing, place) {
                        (false, _) => Some(range),
                        (true, Landmark::Surface(_)) => Some(beam),
                        (true, Landmark::Beacon(beacon)) => {
                            Observation::Bearing { beacon: *beacon, arm }.expect(at).map(|(value, _)| value)
                        }
                    };
                    if let Some(value) = shown {
                        heard.push((channel, self.off(device, value, (channel, k)), 0.0));
                    }
                }
            }
        }
    }

    /// The value with the offset of its channel and the error of a sample.
    fn off(&self, device: &Device, value: f64, (channel, k): (usize, usize)) -> f64 {
        let offset = self.seed.gaussians(ONCE, DRAWS + 2 * channel).0 * device.instrument.bias;
        self.wrong(device, value + offset, (channel, k))
    }

    /// The value with noise, perhaps an outlier's error, and digits.
    fn wrong(&self, device: &Device, value: f64, (channel, k): (usize, usize)) -> f64 {
        let (noise, wild) = self.seed.gaussians(k, DRAWS + 2 * channel);
        let mut shown = value + noise * device.instrument.noise;
        let [share, size] = device.outliers;
        if share > 0.0 && self.seed.two_uniforms(k, DRAWS + 2 * channel + 1).0 < share {
            shown += wild * size;
        }
        if device.quantum > 0.0 {
            shown = (shown / device.quantum).round() * device.quantum;
        }
        shown
    }
}

/// A pose from the true channels.
fn pose(truth: &[f64; CHANNELS]) -> Estimate {
    let mut at = Estimate::at_rest();
    at.motion.position = [truth[0], truth[1], truth[2]];
    at.motion.attitude = from_euler(&[truth[3], truth[4], truth[5]]);
    at
}

/// The shortest horizontal way to a surface, as a unit vector, NED.
fn nearest(surface: &Surface, from: &Vec3<f64>) -> Vec3<f64> {
    match *surface {
        Surface::Plane { normal, offset } => {
            let ahead = offset - (0..3).map(|i| normal[i] * from[i]).sum::<f64>();
            normal.map(|x| x * ahead.signum())
        }
        Surface::Cylinder { centre, radius } => {
            let (x, y) = (from[0] - centre[0], from[1] - centre[1]);
            let away = plain::hypot(x, y).max(1e-9);
            let outward = if away < radius { 1.0 } else { -1.0 };
            [outward * x / away, outward * y / away, 0.0]
        }
    }
}
