//! The sea's surface: buoyancy, added mass, damping, lift and thrust fade with the part of the hull that is under water.
//!
//! The hull is a volume about the centre of buoyancy, given by the vehicle file: a round cylinder of length and diameter,
//! a box of length, width and height, or, where the file says nothing of the shape, a cube of the displaced volume. With
//! `n` the downward unit vector in the body frame and `d` the depth of the centre, the volume at depth `d + x` has the
//! density of a sum of uniform distributions in `x`, one per body axis and half as wide as the hull's half-extent along
//! `n`. A box is exactly that; a disc is a mixture of such layers ([`DISC`], same area and second moment). With the half
//! widths `h_j(n)` the potential of the buoyancy is a spline in closed form,
//!
//! ```text
//! V_B = B Σ_k w_k Q(d; h_k),   Q = Σ_± (Π ±) (d ± h_0 ± h_1 ± h_2)₊⁴ / (192 h_0 h_1 h_2)
//! submerged share  s = ∂V_B/∂d / B,   submerged first moment  m = s r_b + Σ_k w_k Σ_j ∂Q/∂h_j ∂h_j/∂n
//! −g(η) = [(W − s B) n;  (r_g W − B m) × n]
//! ```
//!
//! so that weight and buoyancy conserve energy at any attitude, whatever the shape. Each width is rounded at zero by
//! [`ROUNDING`]; `s` is then three times and the moment twice continuously differentiable in the depth, and the share is
//! exactly 1 where the hull is wholly under water.
//!
//! * `M(η) = M_RB + s M_A`, solved anew at each instant. The entrained water takes and gives its momentum by
//!   `−½ s' M_A ν_r`, which neither makes nor loses energy; the jet of a slam, which takes as much again, is left out.
//! * Damping, cross-flow, lift, `C_A(ν_r) ν_r` and the constant wrench times `s`.
//! * A propeller's thrust and torque by [`propeller_share`] of its own depth, a fin's forces by its submerged share.
//!
//! Limits: the surface is level, at one depth, and has no waves of its own, even where waves move the water; no
//! radiation damping, no slamming, no spray, no drag of the air; one share for the whole hull's added mass and damping,
//! whatever part of the hull emerges; water that a free-flooding hull holds counts as its mass; a hull in the air whose
//! `M_RB` alone is not positive definite keeps its added mass. A tether acts as it does under water.
//!
//! Source: Newman, *Marine Hydrodynamics* (1977), chapters 4 (energy of the fluid) and 6 (hydrostatics); the
//! momentum of a body that enters: von Kármán (1929), NACA TN 321. Propeller: see [`propeller_share`].
//! Tests: `tests/laws/surface.rs` (against clipped volumes, energy, lanes), `tests/flight/test_surface.py`.

use crate::model::current::{Current, Relative};
use crate::model::restoring::Restoring;
use crate::model::vehicle::{Forces, Instant, Vehicle};
use crate::number::algebra::{Mat3, Vec3, Vec6, add_cross, cross, dot};
use crate::number::plain;
use crate::number::real::Real;

/// Rounding of the half widths at zero, as a share of the hull's smallest half-extent: a level box enters over ±2 % of
/// its half height instead of all at once, and floats within 1 % of its draught.
const ROUNDING: f64 = 0.01;

/// How much smaller the half-extents are, in roundings: rounding may widen none beyond the hull that the file gives, or
/// a hull just under water would feel the surface. A level hull is widened by two roundings and their second order.
const SHRINK: f64 = 2.1;

/// Weights and half widths of the layers of a disc of radius 1: Gauss's rule of two nodes for the mixture of uniform
/// distributions that a disc seen edge-on is. Area, centre and second moment of the disc are exact.
const DISC: [[f64; 2]; 2] =
    [[0.853_553_390_593_273_7, 0.923_879_532_511_286_7], [0.146_446_609_406_726_24, 0.382_683_432_365_089_8]];

/// Rounding of a cylinder, as a share of its radius: the outer layer of [`DISC`] and two roundings stay inside.
const ROUND_ROUNDING: f64 = 0.036;

/// One layer of the hull.
#[derive(Clone, Copy, Debug)]
struct Layer {
    weight: f64,
    /// Squared half width per squared component of `n`, by width and body axis, m².
    squares: Mat3<f64>,
}

/// A propeller or fin: where it is, and its radius, m.
pub type Place = (Vec3<f64>, f64);

/// What of a vehicle a surface acts on.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Half its length, width and height, m.
    pub half: Vec3<f64>,
    /// Whether it is a cylinder about its length; else a box.
    pub round: bool,
    /// Per thruster; without a place the hull's share counts.
    pub propellers: Vec<Option<Place>>,
    /// Per fin.
    pub fins: Vec<Place>,
    /// Whether the added mass may fade: `M_RB` alone can be inverted.
    pub fades_mass: bool,
}

/// Where the surface is, and what of a vehicle feels it.
#[derive(Clone)]
pub struct Surface<T> {
    /// Its coordinate down, m: 0 in the frame of a mission.
    pub level: f64,
    /// Buoyancy of the whole hull, N.
    buoyancy: T,
    /// Its centre, m.
    centre: Vec3<T>,
    layers: Vec<Layer>,
    /// m.
    rounding: f64,
    /// Deeper than this all of the vehicle is under water, however it lies, m.
    pub reach: T,
    /// Per thruster; without a place the hull's share counts.
    propellers: Vec<Option<Place>>,
    fins: Vec<Place>,
    /// Whether the added mass may fade: `M_RB` alone can be inverted.
    fades_mass: bool,
}

/// How much of a hull is under water.
#[derive(Clone, Copy, Debug)]
pub struct Wet<T> {
    /// Submerged share of the displaced volume.
    pub share: T,
    /// Its first moment over the whole volume, m: share times centre.
    pub moment: Vec3<T>,
    /// Rate of the share, 1/s.
    pub rate: T,
}

impl<T: Real> Surface<T> {
    /// The surface at a coordinate down, m, over a hull of this weight and buoyancy under gravity `g`, m/s².
    #[inline(always)]
    pub fn new(hull: Hull, whole: &Restoring<T>, g: f64, level: f64) -> Self {
        let (layers, rounding) = layers(&hull);
        let buoyancy = whole.displaced * g;
        // No number where there is no buoyancy, and nothing reads it there.
        let some = buoyancy.zero().lt(whole.displaced);
        let centre =
            [0, 1, 2].map(|i| T::select(some, whole.displaced_moment[i] / whole.displaced, buoyancy.zero()));
        let places = hull.propellers.iter().flatten().chain(&hull.fins);
        let farthest = places.map(|(p, radius)| dot(p, p).sqrt() + radius).fold(0.0, f64::max);
        let aside = dot(&centre, &centre).sqrt() + dot(&hull.half, &hull.half).sqrt();
        Self {
            level,
            buoyancy,
            centre,
            layers,
            rounding,
            reach: aside.max(aside.splat(farthest)),
            propellers: hull.propellers,
            fins: hull.fins,
            fades_mass: hull.fades_mass,
        }
    }

    /// How much of the hull is under water at a depth of O below the surface, m, with `n` down and the velocity `nu`.
    #[inline(always)]
    pub fn wet(&self, depth: T, n: &Vec3<T>, nu: &Vec6<T>) -> Wet<T> {
        let (zero, one) = (depth.zero(), depth.splat(1.0));
        let middle = depth + dot(n, &self.centre);
        let turning = cross(n, &[nu[3], nu[4], nu[5]]);
        let sinking = dot(n, &[nu[0], nu[1], nu[2]]) + dot(&turning, &self.centre);
        let square = [n[0] * n[0], n[1] * n[1], n[2] * n[2]];
        let [mut share, mut density, mut support] = [zero; 3];
        let (mut by_n, mut share_by_n) = ([zero; 3], [zero; 3]);
        for Layer { weight, squares } in &self.layers {
            let mut half = [zero; 3];
            for j in 0..3 {
                let mut sum = zero.splat(self.rounding * self.rounding);
                for i in 0..3 {
                    if squares[j][i] != 0.0 {
                        sum += square[i] * squares[j][i];
                    }
                }
                half[j] = sum.sqrt();
            }
            support = support.max(half[0] + half[1] + half[2]);
            let spline = spline(middle, &half);
            share += spline.slope * *weight;
            density += spline.curvature * *weight;
            for j in 0..3 {
                for i in 0..3 {
                    if squares[j][i] != 0.0 {
                        let widening = n[i] * (squares[j][i] * weight) / half[j];
                        by_n[i] = spline.by_width[j].mul_add(widening, by_n[i]);
                        share_by_n[i] = spline.slope_by_width[j].mul_add(widening, share_by_n[i]);
                    }
                }
            }
        }
        // Beyond the support the spline is 1 and its slopes 0 but for rounding.
        let partly = middle.lt(support);
        let rate = density.mul_add(sinking, dot(&share_by_n, &turning));
        let share = T::select(partly, share.clamped(zero, one), one);
        let mut moment = self.centre;
        for i in 0..3 {
            let own = self.centre[i].mul_add(share, by_n[i]);
            moment[i] = T::select(partly, own, self.centre[i]);
        }
        Wet { share, moment, rate: T::select(partly, rate, zero) }
    }

    /// The depth of O, m, at which the vehicle of this weight, N, floats upright; just under water where it sinks.
    #[inline(always)]
    pub fn afloat(&self, weight: T) -> T {
        let (zero, one) = (weight.zero(), weight.splat(1.0));
        let (n, still) = ([zero, zero, one], [zero; 6]);
        let (mut low, mut high) = (-self.reach, self.reach);
        // Halved to 1e-15 of the vehicle's size.
        for _ in 0..50 {
            let middle = (low + high) * 0.5;
            let carried = self.wet(middle, &n, &still).share;
            let sinks = T::both((carried * self.buoyancy).lt(weight), carried.lt(one));
            low = T::select(sinks, middle, low);
            high = T::select(sinks, high, middle);
        }
        high
    }

    /// The share of the added mass that acts where this share of the hull is under water.
    #[inline(always)]
    fn added_share(&self, wet: T) -> T {
        if self.fades_mass { wet } else { wet.splat(1.0) }
    }

    /// `−g(η)` of a hull that is partly under water, N and N m.
    #[inline(always)]
    fn restoring(&self, whole: &Restoring<T>, wet: &Wet<T>, n: &Vec3<T>) -> Vec6<T> {
        let lost = wet.share.neg_mul_add(self.buoyancy, self.buoyancy);
        let net = whole.net_weight + lost;
        let mut arm = whole.moment;
        for i in 0..3 {
            arm[i] = self.buoyancy.mul_add(self.centre[i] - wet.moment[i], arm[i]);
        }
        let moment = cross(&arm, n);
        [net * n[0], net * n[1], net * n[2], moment[0], moment[1], moment[2]]
    }

    /// The share of the thrust of thruster `i`.
    #[inline(always)]
    fn thrust_share(&self, i: usize, (depth, n): (T, &Vec3<T>), hull: T) -> T {
        match self.propellers.get(i) {
            Some(Some((place, radius))) => propeller_share(below(depth, n, place) / *radius),
            _ => hull,
        }
    }

    /// The share of the forces of fin `i`.
    #[inline(always)]
    fn fin_share(&self, i: usize, (depth, n): (T, &Vec3<T>)) -> T {
        let (place, radius) = &self.fins[i];
        smooth((below(depth, n, place) / *radius + 1.0) * 0.5)
    }
}

/// The depth of a place of the body below the surface, m.
#[inline(always)]
fn below<T: Real>(depth: T, n: &Vec3<T>, place: &Vec3<f64>) -> T {
    depth + n[0] * place[0] + n[1] * place[1] + n[2] * place[2]
}

/// A smooth step from 0 at `t` = 0 to 1 at `t` = 1.
#[inline(always)]
fn smooth<T: Real>(t: T) -> T {
    let t = t.clamped(t.zero(), t.splat(1.0));
    t * t * (t * -2.0 + 3.0)
}

/// The share of its thrust that a propeller keeps, by the depth of its hub in radii.
///
/// All of it while the disc is under water, a quarter at half a disc, none from half a radius above the surface on: the
/// loss of disc and the air that the blades draw, in still conditions. Minsaas, Thon and Kauczynski (1986), *Influence
/// of ocean environment on thruster performance*, as Smogeli (2006), *Control of marine propellers*, quotes it, have
/// `1 − 0.675 (1 − 0.769 h/R)^1.258` between −0.48 and 1.3 radii: this smooth step is within 0.16 of it.
#[inline(always)]
pub fn propeller_share<T: Real>(radii: T) -> T {
    smooth((radii + 0.5) * (1.0 / 1.5))
}

/// `Q` of a layer, see the head of this file: slopes by the depth and by the three half widths.
struct Spline<T> {
    slope: T,
    curvature: T,
    by_width: Vec3<T>,
    slope_by_width: Vec3<T>,
}

#[inline(always)]
fn spline<T: Real>(depth: T, half: &Vec3<T>) -> Spline<T> {
    let zero = depth.zero();
    let [mut second, mut third, mut fourth] = [zero; 3];
    let (mut second_by, mut third_by) = ([zero; 3], [zero; 3]);
    for corner in 0..8_u32 {
        let signs = [0, 1, 2].map(|j| if corner >> j & 1 == 0 { 1.0 } else { -1.0 });
        let mut at = depth;
        for j in 0..3 {
            at += half[j] * signs[j];
        }
        let at = at.max(zero);
        let square = at * at * (signs[0] * signs[1] * signs[2]);
        let cube = square * at;
        second += square;
        third += cube;
        fourth = cube.mul_add(at, fourth);
        for j in 0..3 {
            second_by[j] += square * signs[j];
            third_by[j] += cube * signs[j];
        }
    }
    let size = zero.splat(1.0) / (half[0] * half[1] * half[2] * 8.0);
    let (value, slope, curvature) =
        (fourth * size * (1.0 / 24.0), third * size * (1.0 / 6.0), second * size * 0.5);
    let (mut by_width, mut slope_by_width) = ([zero; 3], [zero; 3]);
    for j in 0..3 {
        by_width[j] = third_by[j] * size * (1.0 / 6.0) - value / half[j];
        slope_by_width[j] = second_by[j] * size * 0.5 - slope / half[j];
    }
    Spline { slope, curvature, by_width, slope_by_width }
}

/// The layers of a hull, and their rounding, m.
fn layers(hull: &Hull) -> (Vec<Layer>, f64) {
    let half = hull.half;
    let least = half.iter().copied().fold(f64::INFINITY, f64::min);
    if hull.round {
        let (radius, rounding) = (half[1], ROUND_ROUNDING * least);
        let along = plain::powi(half[0] - SHRINK * rounding, 2);
        let layer = |[weight, width]: [f64; 2]| {
            let round = plain::powi(width * radius, 2);
            Layer { weight, squares: [[along, 0.0, 0.0], [0.0, round, round], [0.0; 3]] }
        };
        return (DISC.map(layer).to_vec(), rounding);
    }
    let rounding = ROUNDING * least;
    let squares = std::array::from_fn(|j| {
        std::array::from_fn(|i| if i == j { plain::powi(half[i] - SHRINK * rounding, 2) } else { 0.0 })
    });
    (vec![Layer { weight: 1.0, squares }], rounding)
}

/// Terms times a factor.
#[inline(always)]
fn times<T: Real>(a: &Vec6<T>, factor: T) -> Vec6<T> {
    let mut b = *a;
    for i in 0..6 {
        b[i] = a[i] * factor;
    }
    b
}

#[inline(always)]
fn plus<T: Real>(a: &Vec6<T>, b: &Vec6<T>) -> Vec6<T> {
    let mut sum = *a;
    for i in 0..6 {
        sum[i] += b[i];
    }
    sum
}

impl<T: Real> Vehicle<T> {
    /// The force that accelerates the vehicle as it is accelerated at the surface, in the lanes that feel it; in the
    /// others `under`, the force under water. It meets the whole `M`: what solves for ν' need not know of the surface.
    #[inline(always)]
    pub(super) fn near_surface(
        &self,
        (position, r): (&Vec3<T>, &Mat3<T>),
        nu: &Vec6<T>,
        instant: &Instant<T>,
        under: &Vec6<T>,
    ) -> Vec6<T> {
        let Some(surface) = &self.surface else { return *under };
        let depth = position[2] - surface.level;
        if !T::any(depth.lt(surface.reach)) {
            return *under;
        }
        depth.apart(
            #[inline(always)]
            || {
                let wet = surface.wet(depth, &r[2], nu);
                let (terms, nu_r) =
                    self.terms_at_surface(surface, (Some(position), r), &wet, nu, instant.current.as_ref());
                let (thrust, whole) =
                    self.thrust_at_surface(surface, (depth, &r[2]), (wet.share, &nu_r), instant);
                let mut force = thrust;
                for term in
                    [&terms.rigid_body, &terms.added_mass, &terms.damping, &terms.lift, &terms.restoring]
                {
                    force = plus(&force, term);
                }
                if let Some(bias) = &self.bias {
                    force = plus(&force, &times(bias, wet.share));
                }
                let rate = self.solve_with(surface.added_share(wet.share), &force, &instant.measured[1]);
                let equal = self.inertia(&rate);
                let one = depth.splat(1.0);
                let feels = T::either(wet.share.lt(one), whole.lt(one));
                let mut all = *under;
                for i in 0..6 {
                    all[i] = T::select(feels, equal[i], under[i]);
                }
                all
            },
        )
    }

    /// Every term of a hull that is partly under water, as force on the vehicle, and the velocity through the water.
    #[inline(always)]
    fn terms_at_surface(
        &self,
        surface: &Surface<T>,
        (position, r): (Option<&Vec3<T>>, &Mat3<T>),
        wet: &Wet<T>,
        nu: &Vec6<T>,
        current: Option<&Current<T>>,
    ) -> (Forces<T>, Vec6<T>) {
        let none = [nu[0].zero(); 6];
        let still = Relative { nu: *nu, current_rate: none, pressed: None };
        let Relative { nu: nu_r, current_rate, pressed } = match current {
            Some(current) => current.relative(r, nu),
            None => still,
        };
        let Wet { share, moment, rate } = *wet;
        let added = self.added_mass.add_coriolis(&nu_r, &self.added_mass.momentum(&current_rate));
        let entering = match surface.fades_mass {
            true => times(&self.added_mass.momentum(&nu_r), rate * -0.5),
            false => none,
        };
        let mut damping = self.damping.add(&nu_r, &none);
        if let Some(drag) = &self.cross_flow {
            damping = drag.add(&nu_r, &damping);
        }
        damping = times(&damping, share);
        if let Some(tether) = &self.tether {
            damping = tether.add((position, r), &nu_r, &damping);
        }
        let lift = self.lift.as_ref().map_or(none, |lift| times(&lift.add(&nu_r, &none), share));
        let mut restoring = surface.restoring(&self.restoring, wet, &r[2]);
        if let Some(a) = &pressed {
            let displaced = self.restoring.displaced;
            let arm = moment.map(|x| x * displaced);
            let turned = add_cross(&arm, a, &[restoring[3], restoring[4], restoring[5]]);
            for i in 0..3 {
                restoring[i] = (displaced * share).mul_add(a[i], restoring[i]);
                restoring[3 + i] = turned[i];
            }
        }
        let forces = Forces {
            rigid_body: self.rigid_body.add_coriolis(nu, &none),
            added_mass: plus(&times(&added, surface.added_share(share)), &entering),
            damping,
            lift,
            restoring,
        };
        (forces, nu_r)
    }

    /// The wrench of actuators and from outside where some of them may be out of the water, and the smallest share that
    /// any of them keeps.
    #[inline(always)]
    fn thrust_at_surface(
        &self,
        surface: &Surface<T>,
        (depth, n): (T, &Vec3<T>),
        (hull, nu_r): (T, &Vec6<T>),
        instant: &Instant<T>,
    ) -> (Vec6<T>, T) {
        let one = depth.splat(1.0);
        let (mut force, mut least) = (self.still_wrench(instant, depth.zero()), one);
        for i in 0..instant.thrusts.len() {
            let (actuator, thrust) = (&self.actuators[i], &instant.thrusts[i]);
            let share = surface.thrust_share(i, (depth, n), hull);
            least = least.min(share);
            let (pull, torque, part) = if actuator.characteristic.has_inflow() {
                let u_a = dot(&actuator.inflow, nu_r);
                let pull = thrust.force_per_inflow.mul_add(u_a, thrust.force);
                (pull, thrust.torque_per_inflow.mul_add(u_a, thrust.torque), share)
            } else {
                // The sum holds all of it already.
                (thrust.force, thrust.torque, share - 1.0)
            };
            force = actuator.add(pull * part, torque * part, &force);
        }
        for i in 0..instant.deflections.len() {
            let share = surface.fin_share(i, (depth, n));
            least = least.min(share);
            let wrench = self.fins[i].add(instant.deflections[i], nu_r, &[depth.zero(); 6]);
            force = plus(&force, &times(&wrench, share));
        }
        (force, least)
    }

    /// The wrench of actuators and from outside at the velocity `nu_r` through the water, where the vehicle is.
    #[inline(always)]
    pub fn wrench_at(
        &self,
        (position, r): (&Vec3<T>, &Mat3<T>),
        (nu, nu_r): (&Vec6<T>, &Vec6<T>),
        instant: &Instant<T>,
    ) -> Vec6<T> {
        let under = self.wrench(instant, nu_r);
        let Some(surface) = &self.surface else { return under };
        let depth = position[2] - surface.level;
        if !T::any(depth.lt(surface.reach)) {
            return under;
        }
        let hull = surface.wet(depth, &r[2], nu).share;
        let (partly, least) = self.thrust_at_surface(surface, (depth, &r[2]), (hull, nu_r), instant);
        let mut all = under;
        for i in 0..6 {
            all[i] = T::select(least.lt(depth.splat(1.0)), partly[i], under[i]);
        }
        all
    }

    /// Every term by itself at a depth of O below the surface, m, without thrust, bias and the pull of a tether.
    pub fn forces_at(
        &self,
        surface: &Surface<T>,
        depth: T,
        (r, nu): (&Mat3<T>, &Vec6<T>),
        current: Option<&Current<T>>,
    ) -> (Forces<T>, Wet<T>) {
        let wet = surface.wet(depth, &r[2], nu);
        (self.terms_at_surface(surface, (None, r), &wet, nu, current).0, wet)
    }
}
