//! Derivatives of what is recorded: forward accumulation along the tape of [`super::traced`].
//!
//! Every operation has a derivative by what it reads, recorded like the operations themselves; what does not depend on
//! an input has none, and costs none. Where no derivative exists the answer is that of [`super::dual`]: |x| and √x have
//! none at zero, a comparison takes the side of its value.
//!
//! Source: Griewank & Walther, *Evaluating Derivatives* (2008), chapter 3. Tests: `tests/export.rs` (against dual
//! numbers).

use super::real::Real;
use super::traced::{Operation, Place, Traced, Truth, operations, refuse};

/// The derivatives of the outputs (rows) by the inputs (columns), recorded.
pub fn slopes(outputs: &[Traced], inputs: &[Traced]) -> Vec<Vec<Traced>> {
    let tape = operations();
    let needed = needed(&tape, outputs);
    let mut rows = vec![Vec::with_capacity(inputs.len()); outputs.len()];
    for input in inputs {
        let mut slopes: Vec<Option<Traced>> = vec![None; tape.len()];
        for (place, operation) in tape.iter().enumerate().filter(|(place, _)| needed[*place]) {
            slopes[place] = match place == input.place() as usize {
                true => Some(Traced::constant(1.0)),
                false => slope(place as Place, operation, &|read| slopes[read as usize]),
            };
        }
        for (row, output) in rows.iter_mut().zip(outputs) {
            row.push(slopes[output.place() as usize].unwrap_or_else(|| Traced::constant(0.0)));
        }
    }
    rows
}

/// The places that the outputs need, themselves among them.
fn needed(tape: &[Operation], outputs: &[Traced]) -> Vec<bool> {
    let mut needed = vec![false; tape.len()];
    outputs.iter().for_each(|output| needed[output.place() as usize] = true);
    for place in (0..tape.len()).rev() {
        if needed[place] {
            tape[place].reads().for_each(|read| needed[read as usize] = true);
        }
    }
    needed
}

/// The derivative of an operation, where it has one, out of those of what it reads.
fn slope(own: Place, operation: &Operation, of: &impl Fn(Place) -> Option<Traced>) -> Option<Traced> {
    use Operation::*;
    let at = Traced::at;
    let value = at(own);
    let (none, one) = (Traced::constant(0.0), Traced::constant(1.0));
    let sum = |a: Option<Traced>, b: Option<Traced>| match (a, b) {
        (Some(a), Some(b)) => Some(a + b),
        (a, b) => a.or(b),
    };
    let times = |slope: Option<Traced>, factor: Traced| slope.map(|slope| slope * factor);
    // The slope of the second where the comparison holds, of the first where it does not.
    let chosen = |mask: Truth, holds: Option<Traced>, fails: Option<Traced>| {
        (holds.is_some() || fails.is_some())
            .then(|| Traced::select(mask, holds.unwrap_or(none), fails.unwrap_or(none)))
    };
    match *operation {
        Given(_) | Constant(_) | Guard(..) | Floor(_) | Less(..) | Both(..) | Either(..) => None,
        Negate(a) => of(a).map(|slope| -slope),
        Add(a, b) => sum(of(a), of(b)),
        Subtract(a, b) => match (of(a), of(b)) {
            (Some(a), Some(b)) => Some(a - b),
            (a, b) => a.or(b.map(|slope| -slope)),
        },
        Multiply(a, b) => sum(times(of(a), at(b)), times(of(b), at(a))),
        Divide(a, b) => {
            let above = match (of(a), of(b)) {
                (Some(a), Some(b)) => Some(a - b * value),
                (a, b) => a.or(times(b, -value)),
            };
            above.map(|above| above / at(b))
        }
        Absolute(a) => of(a).map(|slope| {
            let (ahead, astern) = (none.lt(at(a)), at(a).lt(none));
            slope * Traced::select(ahead, one, Traced::select(astern, -one, none))
        }),
        Root(a) => of(a).map(|slope| slope * Traced::select(none.lt(value), one * 0.5 / value, none)),
        Minimum(a, b) => chosen(at(b).lt(at(a)), of(b), of(a)),
        Maximum(a, b) => chosen(at(a).lt(at(b)), of(b), of(a)),
        Sine(a) => times(of(a), at(a).sin_cos().1),
        Cosine(a) => times(of(a), -at(a).sin_cos().0),
        Angle(y, x) => {
            let square = at(y) * at(y) + at(x) * at(x);
            let scale = Traced::select(none.lt(square), one / square, none);
            match (of(y), of(x)) {
                (None, None) => None,
                (dy, dx) => {
                    let turn = dy.unwrap_or(none) * at(x) - dx.unwrap_or(none) * at(y);
                    Some(turn * scale)
                }
            }
        }
        Exponential(a) => times(of(a), value),
        Logarithm(a) => of(a).map(|slope| slope / at(a)),
        Select(mask, a, b) => chosen(Truth::At(mask), of(a), of(b)),
        Listed(_, a) | Along(_, a) => of(a).inspect(|_| {
            refuse("a table of the number that is differentiated is not recorded with its slope");
        }),
    }
}
