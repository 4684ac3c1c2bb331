//! Characteristic of a thruster: from the signal (and the inflow, and the supply) to its thrust.
//!
//! * Quadratic: `F = p1 |n| n + p2 |n| V_a`, n in rev/s, `V_a = (1 − w) u_a`, `p1 = α1 ρ d⁴` (different
//!   ahead and astern), `p2 = α2 ρ d³`; reaction torque `Q = q1 |n| n + q2 |n| V_a`.
//! * Polynomial: `F = a0 + a1 s + a11 s²` of the signal's magnitude per direction, no thrust at zero: the
//!   second-order regression of a bollard test; with the inflow term and the torque of the quadratic one,
//!   which no bollard test measures, where the signal is in rpm.
//! * Table: measured thrust over signal and supply voltage, bilinear.
//! * Direct: the signal is the thrust in newtons.
//!
//! All are affine in the inflow, `F = F_0 + F_V u_a`. `gain` multiplies them, thrust deduction `1 − t`
//! the thrust.
//!
//! Source: Taubert et al. (2014), equations 35–38; Fossen (1994), section 4.1.
//! Tests: `tests/laws.rs`, `tests/core/test_scalar_textbook.py`. The way back, from thrust to signal:
//! [`Characteristic::signal`].

mod inverse;

use crate::number::real::Real;
pub use inverse::Bias;
use std::sync::Arc;

/// Thrust and reaction torque, each affine in the inflow velocity u_a.
#[derive(Clone, Copy)]
pub struct Thrust<T> {
    /// Thrust without inflow, N.
    pub force: T,
    /// Thrust per inflow velocity, N s/m.
    pub force_per_inflow: T,
    /// Reaction torque without inflow, N m.
    pub torque: T,
    /// Reaction torque per inflow velocity, N s.
    pub torque_per_inflow: T,
}

impl Thrust<f64> {
    /// The same thrust in the kind of `unit`.
    #[inline(always)]
    pub(crate) fn in_kind_of<T: Real>(&self, unit: T) -> Thrust<T> {
        Thrust {
            force: unit.splat(self.force),
            force_per_inflow: unit.splat(self.force_per_inflow),
            torque: unit.splat(self.torque),
            torque_per_inflow: unit.splat(self.torque_per_inflow),
        }
    }
}

impl<T: Real> Thrust<T> {
    /// Thrust and torque times a factor.
    #[inline(always)]
    pub fn times(&self, factor: T) -> Self {
        Self {
            force: self.force * factor,
            force_per_inflow: self.force_per_inflow * factor,
            torque: self.torque * factor,
            torque_per_inflow: self.torque_per_inflow * factor,
        }
    }
}

/// The shape of a characteristic.
#[derive(Clone)]
pub enum Shape<T> {
    /// `F = p1 |n| n + p2 |n| V_a`; the signal is in rpm.
    Quadratic {
        /// p1 (1 − t) ahead and astern, N s².
        p1: [T; 2],
        /// What depends on the water that flows past.
        flow: FlowTerms<T>,
    },
    /// `F = a0 + a1 s + a11 s² + p2 |n| V_a`, s the signal's magnitude.
    Polynomial {
        /// a0, a1, a11 times (1 − t) ahead.
        ahead: [T; 3],
        /// a0, a1, a11 times (1 − t) astern.
        astern: [T; 3],
        /// What depends on the water that flows past; the signal is then in rpm.
        flow: FlowTerms<T>,
    },
    /// Measured.
    Table(Arc<Table>),
    /// The signal is the thrust.
    Direct,
}

/// The terms of a propeller that a bollard test does not measure.
#[derive(Clone, Copy)]
pub struct FlowTerms<T> {
    /// p2 (1 − w)(1 − t), N s²/m.
    pub p2: T,
    /// q1, N m s², and q2 (1 − w), N s², where there is a reaction torque.
    pub torque: Option<[T; 2]>,
    /// Any of p2, q2 given or sought.
    pub inflow: bool,
}

impl<T: Real> FlowTerms<T> {
    /// A thrust without inflow, N, with the terms at `strength` = factor |n| and `n`, rev/s.
    #[inline(always)]
    fn on(&self, force: T, strength: T, n: T) -> Thrust<T> {
        let zero = n.zero();
        let (torque, torque_per_inflow) =
            self.torque.map_or((zero, zero), |[q1, q2]| (q1 * (strength * n), q2 * strength));
        Thrust { force, force_per_inflow: self.p2 * strength, torque, torque_per_inflow }
    }
}

/// Shape and factor: `gain`; `gain (1 − t)` for a measured table and a commanded thrust, for the former times
/// the density ratio.
#[derive(Clone)]
pub struct Characteristic<T> {
    /// Shape of the curve.
    pub shape: Shape<T>,
    /// Factor on thrust and torque.
    pub factor: T,
}

impl<T: Real> Characteristic<T> {
    /// Whether thrust depends on the inflow.
    #[inline(always)]
    pub fn has_inflow(&self) -> bool {
        matches!(&self.shape, Shape::Quadratic { flow, .. } | Shape::Polynomial { flow, .. } if flow.inflow)
    }

    /// Thrust at a signal (in the command's unit) and a supply voltage (V).
    #[inline(always)]
    pub fn thrust(&self, signal: T, voltage: f64) -> Thrust<T> {
        let zero = signal.zero();
        let astern = signal.lt(zero);
        let still = Thrust { force: zero, force_per_inflow: zero, torque: zero, torque_per_inflow: zero };
        match &self.shape {
            Shape::Quadratic { p1, flow } => {
                let n = signal * (1.0 / 60.0);
                let pull = T::select(astern, p1[1], p1[0]);
                let strength = self.factor * n.abs();
                flow.on(pull * (strength * n), strength, n)
            }
            Shape::Polynomial { ahead: f, astern: b, flow } => {
                let pick = |i: usize| T::select(astern, b[i], f[i]);
                let (a0, a1, a11) = (pick(0), pick(1), pick(2));
                let s = signal.abs();
                let magnitude = a11.mul_add(s, a1).mul_add(s, a0);
                let force = T::select(astern, -magnitude, magnitude);
                let force = self.factor * T::select(zero.lt(s), force, zero);
                let n = signal * (1.0 / 60.0);
                flow.on(force, self.factor * n.abs(), n)
            }
            Shape::Table(table) => {
                let row = table.row(voltage);
                self.scaled(signal.along(|| table.knots(&row), |s| table.interpolate(&row, s)))
            }
            Shape::Direct => Thrust { force: self.factor * signal, ..still },
        }
    }
}

impl<T: Real> Characteristic<T> {
    /// The thrust where a measured table says `force`, N.
    #[inline(always)]
    pub fn scaled(&self, force: T) -> Thrust<T> {
        let zero = force.zero();
        Thrust { force: self.factor * force, force_per_inflow: zero, torque: zero, torque_per_inflow: zero }
    }

    /// What the measured table says at a signal and a supply voltage (V), N; nothing without a table.
    pub fn table_force(&self, signal: f64, voltage: f64) -> Option<f64> {
        let Shape::Table(table) = &self.shape else { return None };
        Some(table.interpolate(&table.row(voltage), signal).0)
    }
}

/// Measured thrust over signal (columns) and supply voltage (rows); held constant beyond its edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    signal: Vec<f64>,
    voltage: Vec<f64>,
    force: Vec<Vec<f64>>,
    /// For equal buckets of the signal axis, the interval in which the bucket begins.
    bucket: Vec<usize>,
    buckets_per_unit: f64,
}

/// The two rows of a table around a voltage and the weight of the upper one.
pub struct Row<'a>(&'a [f64], &'a [f64], f64);

impl Table {
    /// A table from strictly increasing axes; `force[i][j]` at `voltage[i]`, `signal[j]`, N.
    ///
    /// # Errors
    /// The reason, when the axes do not increase or the sizes do not match.
    pub fn new(signal: Vec<f64>, voltage: Vec<f64>, force: Vec<Vec<f64>>) -> Result<Self, String> {
        let increasing =
            |axis: &[f64]| axis.windows(2).all(|w| w[0] < w[1]) && axis.iter().all(|x| x.is_finite());
        if signal.len() < 2 || !increasing(&signal) {
            return Err("the signal axis needs two or more strictly increasing numbers".into());
        }
        if !increasing(&voltage) {
            return Err("the voltage axis must increase strictly".into());
        }
        let rows = voltage.len().max(1);
        if force.len() != rows || force.iter().any(|row| row.len() != signal.len()) {
            return Err(format!("force_n must have {rows} rows of {} numbers", signal.len()));
        }
        if force.iter().flatten().any(|x| !x.is_finite()) {
            return Err("force_n must hold finite numbers".into());
        }
        let span = signal[signal.len() - 1] - signal[0];
        let finest = signal.windows(2).map(|w| w[1] - w[0]).fold(span, f64::min);
        let buckets = ((span / finest).ceil() as usize).clamp(1, 4096);
        let buckets_per_unit = buckets as f64 / span;
        let bucket = (0..=buckets)
            .map(|i| signal[0] + i as f64 / buckets_per_unit)
            .map(|x| signal.partition_point(|&s| s <= x).clamp(1, signal.len() - 1) - 1)
            .collect();
        Ok(Self { signal, voltage, force, bucket, buckets_per_unit })
    }

    /// Whether thrust depends on the supply voltage.
    pub fn needs_voltage(&self) -> bool {
        self.voltage.len() > 1
    }

    /// The range of the signal axis.
    pub fn range(&self) -> [f64; 2] {
        [self.signal[0], self.signal[self.signal.len() - 1]]
    }

    /// The rows around a voltage; the first row where the voltage is unknown (not a number).
    pub fn row(&self, voltage: f64) -> Row<'_> {
        let last = self.voltage.len().saturating_sub(1);
        let upper = self.voltage.partition_point(|&v| v < voltage).min(last);
        if upper == 0 || voltage.is_nan() {
            return Row(&self.force[0], &self.force[0], 0.0);
        }
        let (low, high) = (self.voltage[upper - 1], self.voltage[upper]);
        Row(&self.force[upper - 1], &self.force[upper], ((voltage - low) / (high - low)).clamp(0.0, 1.0))
    }

    /// Signal and thrust at every knot, for those who interpolate themselves.
    pub fn knots(&self, row: &Row<'_>) -> Vec<[f64; 2]> {
        let force = |j: usize| row.0[j] + (row.1[j] - row.0[j]) * row.2;
        self.signal.iter().enumerate().map(|(j, &signal)| [signal, force(j)]).collect()
    }

    /// Thrust and its slope at a signal.
    #[inline]
    pub fn interpolate(&self, row: &Row<'_>, signal: f64) -> (f64, f64) {
        let [first, last] = self.range();
        if signal.is_nan() {
            return (f64::NAN, f64::NAN);
        }
        let x = signal.clamp(first, last);
        let mut i = self.bucket[((x - first) * self.buckets_per_unit) as usize];
        while i + 2 < self.signal.len() && self.signal[i + 1] < x {
            i += 1;
        }
        let force = |j: usize| row.0[j] + (row.1[j] - row.0[j]) * row.2;
        let (left, right) = (force(i), force(i + 1));
        let slope = (right - left) / (self.signal[i + 1] - self.signal[i]);
        let inside = first <= signal && signal <= last;
        (left + slope * (x - self.signal[i]), if inside { slope } else { 0.0 })
    }
}
