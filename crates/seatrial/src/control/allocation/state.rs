//! What an allocation is made of: constants, state and workspace of one vehicle, taken once.

use super::pseudo_inverse::PseudoInverse;
use super::quadratic_programme::{CAPACITY, QuadraticProgramme};
use super::reach::{Reach, capabilities};
use super::redistribution::Shares;
use super::table::{AllocationTable, Method, Settings};
use crate::description::Description;
use crate::error::Error;
use crate::model::vehicle::Vehicle;
use crate::number::algebra::Vec6;
use crate::number::real::Real;

/// The bounded programme, for the one number type that has it.
type Programme<T> = fn(&mut QuadraticProgramme, &PseudoInverse<T>, &Vec6<T>, &mut Shares<T>);

/// Distributes wrenches; constants, state and workspace of one vehicle (or of one per lane).
#[derive(Clone)]
pub struct Allocator<T> {
    pub(super) settings: Settings,
    pub(super) thrusters: usize,
    /// Fins and thrusters act in common rows: the share of each depends on the speed.
    pub(super) shared: bool,
    /// F_max, N; of a fin at 1 m/s.
    pub(super) capability: Vec<T>,
    pub(super) programme: Option<(QuadraticProgramme, Programme<T>)>,
    pub(super) rows: Vec6<T>,
    pub(super) usable: Vec<T>,
    pub(super) speed: T,
    pub(super) pseudo_inverse: PseudoInverse<T>,
    pub(super) prepared: bool,
    pub(super) turning: Vec<T>,
    pub(super) stuck: Vec<T>,
    pub(super) stuck_signal: Vec<T>,
    pub(super) shares: Shares<T>,
    pub(super) reach: Vec<Reach<T>>,
    pub(super) force: Vec<T>,
    pub(super) left: Vec<T>,
    pub(super) strength: Vec<T>,
}

crate::memory!(Allocator:
    turning, stuck, stuck_signal;
    settings, thrusters, shared, capability, programme, rows, usable, speed, pseudo_inverse, prepared, shares, reach,
    force, left, strength);

impl Allocator<f64> {
    /// The allocation of a single vehicle, by either method.
    ///
    /// # Errors
    /// As [`Allocator::new`]; more actuators than the quadratic programme takes.
    pub fn single(
        description: &Description,
        vehicle: &Vehicle<f64>,
        table: &AllocationTable,
    ) -> Result<Self, Error> {
        let mut allocator = Self::new(description, vehicle, &table.for_populations())?;
        if table.method == Method::Quadratic {
            let found = description.actuators.len();
            if found > CAPACITY {
                return Err(Error::vehicle(
                    &description.file.name,
                    format!(
                        "allocation.method: \"quadratic\" takes up to {CAPACITY} actuators, found {found}; use \"pseudo-inverse\""
                    ),
                ));
            }
            allocator.programme = Some((QuadraticProgramme::default(), QuadraticProgramme::solve));
        }
        Ok(allocator)
    }
}

impl<T: Real> Allocator<T> {
    /// The allocation of a vehicle by the pseudo-inverse.
    ///
    /// # Errors
    /// A vehicle without actuators; a table that does not fit it, or that asks for the quadratic programme, which only
    /// [`Allocator::single`] has.
    pub fn new(
        description: &Description,
        vehicle: &Vehicle<T>,
        table: &AllocationTable,
    ) -> Result<Self, Error> {
        let fail = |message: &str| Err(Error::vehicle(&description.file.name, message));
        if table.method == Method::Quadratic {
            return fail(
                "allocation.method: populations are allocated by \"pseudo-inverse\", found \"quadratic\"",
            );
        }
        let settings = table.settings(description)?;
        let count = description.actuators.len();
        if count == 0 {
            return fail("allocation: the vehicle has no actuators; add [[thrusters]] or [[fins]]");
        }
        let zero = vehicle.mass_matrix[0][0].zero();
        let thrusters = vehicle.actuators.len();
        let capability = capabilities(description, vehicle, &settings.holds);
        let acts = |range: std::ops::Range<usize>, i: usize| {
            range.into_iter().any(|k| description.wrench(k)[i].abs() > 1e-9)
        };
        let none = vec![zero; count];
        Ok(Self {
            thrusters,
            shared: (0..6).any(|i| acts(0..thrusters, i) && acts(thrusters..count, i)),
            capability,
            programme: None,
            rows: [zero; 6],
            usable: none.clone(),
            speed: zero,
            pseudo_inverse: PseudoInverse::new(count, zero),
            prepared: false,
            turning: none.clone(),
            stuck: none.clone(),
            stuck_signal: none.clone(),
            shares: Shares::new(count, zero),
            reach: vec![Reach::none(zero); count],
            force: none.clone(),
            left: none.clone(),
            strength: none,
            settings,
        })
    }
}
