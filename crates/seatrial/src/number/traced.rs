//! A number that records what is done with it: one step of vehicle or autopilot becomes a straight-line program.
//!
//! A [`Traced`] is the name of a place on a tape that belongs to the thread. Operations on constants are carried out,
//! equal operations on equal places are one, and what nothing reads is left out at the end ([`crate::export`]). A
//! comparison is a place, too, and [`Real::select`] keeps both sides: no branch is taken while recording. What cannot
//! be said by selects is refused with a message when the recording ends, never decided for one case:
//!
//! | asked while recording | answer |
//! |---|---|
//! | `any` of a mask that is not constant | true: the guarded work is done, and its own masks decide |
//! | `equals` of numbers that are not constant | false: work that could be left out is done |
//! | `largest` of a number that is not constant | refused |
//! | `before` by a distance that is not constant | refused |
//! | `tabulated` at a number that is not constant | refused; [`Real::listed`] and [`Real::along`] are recorded |
//! | random bits (`word`, `of_low_half`) | refused |
//!
//! `any` and `equals` may be answered so because lanes ask the same: a lane is computed along when any other lane
//! needs the work, and must come out as it would alone.
//!
//! Constants fold as they compute in double precision, but for zero times a number, which is zero whatever the number,
//! and for the sign of a zero. Tests: `tests/export.rs`.

use super::plain;
use super::random::Word;
use super::real::Real;
use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A place on the tape.
pub type Place = u32;

/// What is done at a place; numbers are kept by their bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operation {
    /// A number that is given: of the interface, by its index.
    Given(u32),
    /// A constant.
    Constant(u64),
    /// A constant in double precision, and another where numbers have single precision.
    Guard(u64, u64),
    /// `−a`.
    Negate(Place),
    /// `a + b`.
    Add(Place, Place),
    /// `a − b`.
    Subtract(Place, Place),
    /// `a b`.
    Multiply(Place, Place),
    /// `a / b`.
    Divide(Place, Place),
    /// `|a|`.
    Absolute(Place),
    /// `√a`.
    Root(Place),
    /// The smaller one.
    Minimum(Place, Place),
    /// The larger one.
    Maximum(Place, Place),
    /// The largest integer not above.
    Floor(Place),
    /// `sin a`.
    Sine(Place),
    /// `cos a`.
    Cosine(Place),
    /// The angle of the point (b, a).
    Angle(Place, Place),
    /// `e^a`.
    Exponential(Place),
    /// `ln a`.
    Logarithm(Place),
    /// Of the first (a truth value): the second where it is true, the third where it is not.
    Select(Place, Place, Place),
    /// Entry `a` of a list, by the index of the list.
    Listed(u32, Place),
    /// A polyline at `a`, by its index.
    Along(u32, Place),
    /// `a < b`, a truth value.
    Less(Place, Place),
    /// Both are true.
    Both(Place, Place),
    /// At least one is true.
    Either(Place, Place),
}

impl Operation {
    /// The places that it reads.
    pub fn reads(&self) -> impl Iterator<Item = Place> {
        use Operation::*;
        let (places, count) = match *self {
            Given(_) | Constant(_) | Guard(..) => ([0; 3], 0),
            Negate(a)
            | Absolute(a)
            | Root(a)
            | Floor(a)
            | Sine(a)
            | Cosine(a)
            | Exponential(a)
            | Logarithm(a)
            | Listed(_, a)
            | Along(_, a) => ([a, 0, 0], 1),
            Add(a, b)
            | Subtract(a, b)
            | Multiply(a, b)
            | Divide(a, b)
            | Minimum(a, b)
            | Maximum(a, b)
            | Angle(a, b)
            | Less(a, b)
            | Both(a, b)
            | Either(a, b) => ([a, b, 0], 2),
            Select(a, b, c) => ([a, b, c], 3),
        };
        places.into_iter().take(count)
    }

    /// The same with its places and its index of the interface renamed.
    pub fn moved(&self, place: impl Fn(Place) -> Place, given: impl Fn(u32) -> u32) -> Self {
        use Operation::*;
        match *self {
            Given(index) => Given(given(index)),
            Constant(_) | Guard(..) => *self,
            Negate(a) => Negate(place(a)),
            Add(a, b) => Add(place(a), place(b)),
            Subtract(a, b) => Subtract(place(a), place(b)),
            Multiply(a, b) => Multiply(place(a), place(b)),
            Divide(a, b) => Divide(place(a), place(b)),
            Absolute(a) => Absolute(place(a)),
            Root(a) => Root(place(a)),
            Minimum(a, b) => Minimum(place(a), place(b)),
            Maximum(a, b) => Maximum(place(a), place(b)),
            Floor(a) => Floor(place(a)),
            Sine(a) => Sine(place(a)),
            Cosine(a) => Cosine(place(a)),
            Angle(a, b) => Angle(place(a), place(b)),
            Exponential(a) => Exponential(place(a)),
            Logarithm(a) => Logarithm(place(a)),
            Select(a, b, c) => Select(place(a), place(b), place(c)),
            Listed(list, a) => Listed(list, place(a)),
            Along(polyline, a) => Along(polyline, place(a)),
            Less(a, b) => Less(place(a), place(b)),
            Both(a, b) => Both(place(a), place(b)),
            Either(a, b) => Either(place(a), place(b)),
        }
    }

    /// Whether it is a truth value.
    pub fn is_truth(&self) -> bool {
        matches!(self, Self::Less(..) | Self::Both(..) | Self::Either(..))
    }
}

/// What was recorded.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    /// What is done, in order: every place reads places before it.
    pub operations: Vec<Operation>,
    /// Lists by index, for [`Operation::Listed`].
    pub lists: Vec<Vec<f64>>,
    /// Polylines by index, `[x, y]` with x not falling, for [`Operation::Along`].
    pub polylines: Vec<Vec<[f64; 2]>>,
    known: HashMap<Operation, Place>,
    refused: Option<String>,
}

thread_local! {
    static TAPE: RefCell<Tape> = RefCell::default();
}

/// Records what `work` does with [`Traced`] numbers.
///
/// # Errors
/// What of it cannot be recorded.
pub fn record<R>(work: impl FnOnce() -> R) -> Result<(Tape, R), String> {
    TAPE.with_borrow_mut(|tape| *tape = Tape::default());
    let result = work();
    let tape = TAPE.take();
    match tape.refused {
        Some(message) => Err(message),
        None => Ok((tape, result)),
    }
}

/// The value of a polyline at a place, of the piece that ends there; held beyond its ends.
pub fn along(polyline: &[[f64; 2]], x: f64) -> f64 {
    let after = polyline.partition_point(|knot| knot[0] < x);
    match (after.checked_sub(1).map(|before| polyline[before]), polyline.get(after)) {
        (None, Some(first)) => first[1],
        (Some(from), Some(to)) => from[1] + (to[1] - from[1]) / (to[0] - from[0]) * (x - from[0]),
        (Some(last), None) => last[1],
        (None, None) => 0.0,
    }
}

/// The entry of a list at a whole number; of the first below it, of the last above it.
pub fn listed(list: &[f64], index: f64) -> f64 {
    list[(index.max(0.0) as usize).min(list.len() - 1)]
}

/// A number on the tape.
#[derive(Clone, Copy, Debug)]
pub struct Traced(Place);

/// A truth value on the tape, or one that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// Known while recording.
    Known(bool),
    /// At a place.
    At(Place),
}

/// Puts an operation on the tape, or finds the same one there.
fn push(operation: Operation) -> Place {
    TAPE.with_borrow_mut(|tape| {
        if let Some(&place) = tape.known.get(&operation) {
            return place;
        }
        let place = tape.operations.len() as Place;
        tape.operations.push(operation);
        tape.known.insert(operation, place);
        place
    })
}

/// What has been recorded so far.
pub(super) fn operations() -> Vec<Operation> {
    TAPE.with_borrow(|tape| tape.operations.clone())
}

pub(super) fn refuse(message: &str) {
    TAPE.with_borrow_mut(|tape| {
        tape.refused.get_or_insert_with(|| message.to_owned());
    });
}

impl Traced {
    /// A constant.
    pub fn constant(x: f64) -> Self {
        Self(push(Operation::Constant(x.to_bits())))
    }

    /// The number of the interface with this index.
    pub fn given(index: usize) -> Self {
        Self(push(Operation::Given(index as u32)))
    }

    /// Its place on the tape.
    pub fn place(self) -> Place {
        self.0
    }

    /// The number at a place of the tape.
    pub(super) fn at(place: Place) -> Self {
        Self(place)
    }

    fn operation(self) -> Operation {
        TAPE.with_borrow(|tape| tape.operations[self.0 as usize])
    }

    /// Its value, where that is known while recording.
    pub fn known(self) -> Option<f64> {
        match self.operation() {
            Operation::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    fn one(self, operation: fn(Place) -> Operation, f: fn(f64) -> f64) -> Self {
        match self.known() {
            Some(x) => Self::constant(f(x)),
            None => Self(push(operation(self.0))),
        }
    }

    fn two(self, other: Self, operation: fn(Place, Place) -> Operation, f: fn(f64, f64) -> f64) -> Self {
        match (self.known(), other.known()) {
            (Some(x), Some(y)) => Self::constant(f(x, y)),
            _ => Self(push(operation(self.0, other.0))),
        }
    }

    /// As [`Self::two`] of an operation whose order does not matter.
    fn either_way(
        self,
        other: Self,
        operation: fn(Place, Place) -> Operation,
        f: fn(f64, f64) -> f64,
    ) -> Self {
        if other.0 < self.0 { other.two(self, operation, f) } else { self.two(other, operation, f) }
    }
}

impl Neg for Traced {
    type Output = Self;
    fn neg(self) -> Self {
        match self.operation() {
            Operation::Negate(a) => Self(a),
            _ => self.one(Operation::Negate, |x| -x),
        }
    }
}

impl Add for Traced {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        match (self.known(), other.known()) {
            (Some(0.0), _) => other,
            (_, Some(0.0)) => self,
            _ => match (self.operation(), other.operation()) {
                // Written as a difference: one operation less.
                (_, Operation::Negate(b)) => self - Self(b),
                (Operation::Negate(a), _) => other - Self(a),
                _ => self.either_way(other, Operation::Add, |x, y| x + y),
            },
        }
    }
}

impl Sub for Traced {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        match (self.known(), other.known()) {
            (_, Some(0.0)) => self,
            (Some(0.0), _) => -other,
            _ => match other.operation() {
                Operation::Negate(b) => self + Self(b),
                _ => self.two(other, Operation::Subtract, |x, y| x - y),
            },
        }
    }
}

impl Mul for Traced {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        match (self.known(), other.known()) {
            (Some(0.0), _) | (_, Some(0.0)) => Self::constant(0.0),
            (Some(1.0), _) => other,
            (_, Some(1.0)) => self,
            (Some(-1.0), _) => -other,
            (_, Some(-1.0)) => -self,
            _ => self.either_way(other, Operation::Multiply, |x, y| x * y),
        }
    }
}

impl Div for Traced {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        match (self.known(), other.known()) {
            (_, Some(1.0)) => self,
            (Some(0.0), None) => self,
            _ => self.two(other, Operation::Divide, |x, y| x / y),
        }
    }
}

macro_rules! with_plain {
    ($($trait:ident $method:ident),+) => {$(
        impl $trait<f64> for Traced {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Self::constant(other))
            }
        }
    )+};
}
with_plain!(Add add, Sub sub, Mul mul, Div div);

impl AddAssign for Traced {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Traced {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl MulAssign for Traced {
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

/// Bits while recording: there are none.
#[derive(Clone, Copy, Debug)]
pub struct NoWord;

impl Word for NoWord {
    fn splat(self, _: u64) -> Self {
        self
    }
    fn plus(self, _: Self) -> Self {
        self
    }
    fn times(self, _: Self) -> Self {
        self
    }
    fn xor(self, _: Self) -> Self {
        self
    }
    fn right(self, _: u32) -> Self {
        self
    }
}

/// What is said where random numbers are asked for.
const RANDOM: &str = "random numbers are not recorded; export a step without sensors and without a sea";

impl Real for Traced {
    type Mask = Truth;
    type Word = NoWord;

    fn splat(self, x: f64) -> Self {
        Self::constant(x)
    }
    fn guard(self, double: f64, single: f64) -> Self {
        Self(push(Operation::Guard(double.to_bits(), single.to_bits())))
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self * b - c
    }
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c - self * b
    }
    fn abs(self) -> Self {
        match self.operation() {
            Operation::Absolute(_) => self,
            Operation::Negate(a) => Self(a).abs(),
            _ => self.one(Operation::Absolute, f64::abs),
        }
    }
    fn sqrt(self) -> Self {
        self.one(Operation::Root, f64::sqrt)
    }
    fn min(self, other: Self) -> Self {
        if self.0 == other.0 { self } else { self.two(other, Operation::Minimum, Real::min) }
    }
    fn max(self, other: Self) -> Self {
        if self.0 == other.0 { self } else { self.two(other, Operation::Maximum, Real::max) }
    }
    fn floor(self) -> Self {
        self.one(Operation::Floor, f64::floor)
    }
    fn sin_cos(self) -> (Self, Self) {
        (self.one(Operation::Sine, plain::sin), self.one(Operation::Cosine, plain::cos))
    }
    fn atan2(self, x: Self) -> Self {
        self.two(x, Operation::Angle, plain::atan2)
    }
    fn exp(self) -> Self {
        self.one(Operation::Exponential, plain::exp)
    }
    fn ln(self) -> Self {
        self.one(Operation::Logarithm, plain::ln)
    }
    fn lt(self, other: Self) -> Truth {
        match (self.known(), other.known()) {
            (Some(x), Some(y)) => Truth::Known(x < y),
            _ if self.0 == other.0 => Truth::Known(false),
            _ => Truth::At(push(Operation::Less(self.0, other.0))),
        }
    }
    fn equals(self, other: Self) -> bool {
        match (self.known(), other.known()) {
            (Some(x), Some(y)) => x == y,
            _ => self.0 == other.0,
        }
    }
    fn both(a: Truth, b: Truth) -> Truth {
        match (a, b) {
            (Truth::Known(false), _) | (_, Truth::Known(false)) => Truth::Known(false),
            (Truth::Known(true), other) | (other, Truth::Known(true)) => other,
            (Truth::At(a), Truth::At(b)) if a == b => Truth::At(a),
            (Truth::At(a), Truth::At(b)) => Truth::At(push(Operation::Both(a.min(b), a.max(b)))),
        }
    }
    fn either(a: Truth, b: Truth) -> Truth {
        match (a, b) {
            (Truth::Known(true), _) | (_, Truth::Known(true)) => Truth::Known(true),
            (Truth::Known(false), other) | (other, Truth::Known(false)) => other,
            (Truth::At(a), Truth::At(b)) if a == b => Truth::At(a),
            (Truth::At(a), Truth::At(b)) => Truth::At(push(Operation::Either(a.min(b), a.max(b)))),
        }
    }
    fn any(mask: Truth) -> bool {
        mask != Truth::Known(false)
    }
    fn select(mask: Truth, if_true: Self, if_false: Self) -> Self {
        match mask {
            Truth::Known(true) => if_true,
            Truth::Known(false) => if_false,
            Truth::At(_) if if_true.0 == if_false.0 => if_true,
            Truth::At(place) => Self(push(Operation::Select(place, if_true.0, if_false.0))),
        }
    }
    fn tabulated(self, f: impl Fn(f64) -> (f64, f64)) -> Self {
        if let Some(x) = self.known() {
            return Self::constant(f(x).0);
        }
        refuse("a function that is only known point by point is not recorded; record a list or a polyline");
        self
    }
    fn listed(self, count: usize, f: impl Fn(f64) -> (f64, f64)) -> Self {
        if self.known().is_some() || count == 0 {
            return self.tabulated(f);
        }
        let list: Vec<f64> = (0..count).map(|i| f(i as f64).0).collect();
        if list.iter().all(|x| x.to_bits() == list[0].to_bits()) {
            return Self::constant(list[0]);
        }
        let index = TAPE.with_borrow_mut(|tape| {
            tape.lists.iter().position(|known| *known == list).unwrap_or_else(|| {
                tape.lists.push(list);
                tape.lists.len() - 1
            })
        });
        Self(push(Operation::Listed(index as u32, self.0)))
    }
    fn along(self, knots: impl Fn() -> Vec<[f64; 2]>, f: impl Fn(f64) -> (f64, f64)) -> Self {
        if self.known().is_some() {
            return self.tabulated(f);
        }
        let polyline = knots();
        let index = TAPE.with_borrow_mut(|tape| {
            tape.polylines.iter().position(|known| *known == polyline).unwrap_or_else(|| {
                tape.polylines.push(polyline);
                tape.polylines.len() - 1
            })
        });
        Self(push(Operation::Along(index as u32, self.0)))
    }
    fn word(self) -> NoWord {
        refuse(RANDOM);
        NoWord
    }
    fn of_low_half(self, _: NoWord) -> Self {
        refuse(RANDOM);
        self
    }
    fn before(self, ring: &[Self], newest: usize) -> Self {
        let Some(ago) = self.known() else {
            refuse("a dead time that may be changed is not recorded: its ring has a fixed length");
            return self;
        };
        let (whole, mask) = (ago.floor(), ring.len() - 1);
        let i = newest.wrapping_sub(whole as usize);
        let from = ring[i & mask];
        if ago == whole { from } else { (ring[i.wrapping_sub(1) & mask] - from) * (ago - whole) + from }
    }
    fn largest(self) -> f64 {
        self.known().unwrap_or_else(|| {
            refuse(
                "the length of a memory follows from a number that may be changed; keep that number fixed",
            );
            0.0
        })
    }
}
