//! A straight-line program: what was recorded, between named numbers.
//!
//! The state of a step is reduced before the program is made. A number that every step leaves at its start is a
//! constant: all are taken for constants first, and those that a step changes are given back until none is left
//! (an induction over steps). A number that reaches no output is left out. What depends on parameters
//! alone is computed once, when they are set.

use crate::error::Error;
use crate::number::plain;
use crate::number::real::Real;
use crate::number::traced::{Operation, Place, Tape, Traced, along, listed, record};

/// A number of the interface.
#[derive(Clone, Debug, PartialEq)]
pub struct Symbol {
    /// Name, an identifier of C.
    pub name: String,
    /// Name in the files and logs of this package.
    pub known_as: String,
    /// Unit; "1" for none.
    pub unit: String,
    /// What it is.
    pub about: String,
    /// Its value at the start.
    pub start: f64,
    /// The smallest and the largest value that it may be set to.
    pub range: [f64; 2],
}

impl Symbol {
    /// A number by its name here, of any finite value; characters that C does not know become underscores.
    pub fn new(name: &str, unit: &str, about: &str, start: f64) -> Self {
        let known = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut identifier: String = name.chars().map(known).collect();
        if identifier.starts_with(|c: char| !c.is_ascii_alphabetic()) {
            identifier.insert(0, 'n');
        }
        let (unit, about) = (unit.to_owned(), about.to_owned());
        Self { name: identifier, known_as: name.to_owned(), unit, about, start, range: [f64::MIN, f64::MAX] }
    }
}

/// What a step reads and writes.
#[derive(Clone, Debug, Default)]
pub struct Interface {
    /// Constants that may be set.
    pub parameters: Vec<Symbol>,
    /// What is remembered.
    pub state: Vec<Symbol>,
    /// What is told.
    pub inputs: Vec<Symbol>,
    /// What comes out.
    pub outputs: Vec<Symbol>,
}

/// What stands in for the numbers of an interface while a step is recorded.
pub struct Given {
    /// In the order of the parameters.
    pub parameters: Vec<Traced>,
    /// In the order of the state; the step leaves the next one here.
    pub state: Vec<Traced>,
    /// In the order of the inputs.
    pub inputs: Vec<Traced>,
}

/// A recorded step.
#[derive(Clone, Debug)]
pub struct Program {
    /// Its numbers by name.
    pub interface: Interface,
    /// What is done, and the tables for it.
    pub tape: Tape,
    /// Where the next state is, in the order of the state.
    pub next: Vec<Place>,
    /// Where the outputs are.
    pub results: Vec<Place>,
}

/// When an operation is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// It is a constant.
    Constant,
    /// When the parameters are set.
    Prepared,
    /// At every step.
    Step,
}

/// Operations of a step by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Sums, differences, products, signs and magnitudes.
    pub simple: usize,
    /// Quotients and roots.
    pub quotients: usize,
    /// Sines, cosines, angles, exponentials, logarithms.
    pub functions: usize,
    /// Comparisons, their joins, selections, smaller and larger ones, floors.
    pub decisions: usize,
    /// Entries of lists and polylines.
    pub tables: usize,
}

impl Count {
    /// All of them.
    pub fn all(&self) -> usize {
        self.simple + self.quotients + self.functions + self.decisions + self.tables
    }
}

impl Program {
    /// Records a step: from what is given to the outputs, with the next state in place of the given one.
    ///
    /// # Errors
    /// What the step refuses, or cannot be recorded.
    pub fn of(
        interface: Interface,
        step: impl Fn(&mut Given) -> Result<Vec<Traced>, Error>,
    ) -> Result<Self, Error> {
        let mut constant = vec![true; interface.state.len()];
        loop {
            let (tape, next, results) = recorded(&interface, &constant, &step)?;
            let kept = |k: usize| {
                matches!(tape.operations[next[k] as usize], Operation::Constant(bits)
                    if f64::from_bits(bits) == interface.state[k].start)
            };
            let changed: Vec<usize> = (0..constant.len()).filter(|&k| constant[k] && !kept(k)).collect();
            if changed.is_empty() {
                return Ok(Self { interface, tape, next, results }.reduced());
            }
            for k in changed {
                constant[k] = false;
            }
        }
    }

    /// The places that the roots need, themselves among them.
    fn needed(&self, roots: impl IntoIterator<Item = Place>) -> Vec<bool> {
        let mut needed = vec![false; self.tape.operations.len()];
        for root in roots {
            needed[root as usize] = true;
        }
        for place in (0..needed.len()).rev() {
            if needed[place] {
                self.tape.operations[place].reads().for_each(|read| needed[read as usize] = true);
            }
        }
        needed
    }

    /// Without what reaches no output: operations, state and parameters.
    fn reduced(self) -> Self {
        let Interface { parameters, state, inputs, outputs } = &self.interface;
        let (first, after) = (parameters.len(), parameters.len() + state.len());
        let given = |needed: &[bool]| -> Vec<bool> {
            let mut given = vec![false; after + inputs.len()];
            for (place, operation) in self.tape.operations.iter().enumerate() {
                if let (true, Operation::Given(index)) = (needed[place], operation) {
                    given[*index as usize] = true;
                }
            }
            given
        };
        let mut live = vec![false; state.len()];
        loop {
            let own = (0..state.len()).filter(|&k| live[k]).map(|k| self.next[k]);
            let read = given(&self.needed(self.results.iter().copied().chain(own)));
            let grown: Vec<bool> = (0..state.len()).map(|k| live[k] || read[first + k]).collect();
            if grown == live {
                break;
            }
            live = grown;
        }
        let next: Vec<Place> = (0..state.len()).filter(|&k| live[k]).map(|k| self.next[k]).collect();
        let needed = self.needed(self.results.iter().chain(&next).copied());
        let read = given(&needed);
        let stays = |index: usize| index >= after || read[index];
        let mut renamed = 0;
        let index: Vec<u32> = (0..after + inputs.len())
            .map(|index| {
                renamed += u32::from(stays(index));
                renamed.wrapping_sub(1)
            })
            .collect();
        let mut tape = Tape::default();
        tape.lists.clone_from(&self.tape.lists);
        tape.polylines.clone_from(&self.tape.polylines);
        let mut place = vec![0; needed.len()];
        for (old, operation) in self.tape.operations.iter().enumerate().filter(|(old, _)| needed[*old]) {
            place[old] = tape.operations.len() as Place;
            tape.operations.push(operation.moved(|read| place[read as usize], |given| index[given as usize]));
        }
        let of = |symbols: &[Symbol], from: usize| {
            let kept = symbols.iter().enumerate().filter(|(k, _)| stays(from + k));
            kept.map(|(_, symbol)| symbol.clone()).collect()
        };
        let interface = Interface {
            parameters: of(parameters, 0),
            state: of(state, first),
            inputs: inputs.clone(),
            outputs: outputs.clone(),
        };
        let moved = |places: &[Place]| places.iter().map(|&old| place[old as usize]).collect();
        Self { interface, next: moved(&next), results: moved(&self.results), tape }
    }

    /// When every operation is carried out.
    pub fn stages(&self) -> Vec<Stage> {
        let parameters = self.interface.parameters.len();
        let mut stages: Vec<Stage> = Vec::with_capacity(self.tape.operations.len());
        for operation in &self.tape.operations {
            let own = match operation {
                Operation::Given(index) if (*index as usize) < parameters => Stage::Prepared,
                Operation::Given(_) => Stage::Step,
                _ => Stage::Constant,
            };
            let of_read = operation.reads().map(|read| stages[read as usize]).max();
            stages.push(own.max(of_read.unwrap_or(Stage::Constant)));
        }
        stages
    }

    /// The places that are needed for the outputs (`true`), or for the next state.
    pub fn needed_for(&self, outputs: bool) -> Vec<bool> {
        self.needed(if outputs { &self.results } else { &self.next }.iter().copied())
    }

    /// The operations at every step among these places.
    pub fn count(&self, needed: &[bool]) -> Count {
        use Operation::*;
        let mut count = Count::default();
        for ((operation, stage), _) in
            self.tape.operations.iter().zip(self.stages()).zip(needed).filter(|(_, needed)| **needed)
        {
            if stage < Stage::Step {
                continue;
            }
            match operation {
                Given(_) | Constant(_) | Guard(..) => {}
                Negate(_) | Add(..) | Subtract(..) | Multiply(..) | Absolute(_) => count.simple += 1,
                Divide(..) | Root(_) => count.quotients += 1,
                Sine(_) | Cosine(_) | Angle(..) | Exponential(_) | Logarithm(_) => count.functions += 1,
                Listed(..) | Along(..) => count.tables += 1,
                _ => count.decisions += 1,
            }
        }
        count
    }

    /// Next state and outputs of a step in double precision; parameters, state and inputs in the order of the interface.
    pub fn run(&self, parameters: &[f64], state: &[f64], inputs: &[f64]) -> (Vec<f64>, Vec<f64>) {
        use Operation::*;
        let given: Vec<f64> = [parameters, state, inputs].concat();
        let mut x: Vec<f64> = Vec::with_capacity(self.tape.operations.len());
        for operation in &self.tape.operations {
            let at = |place: Place| x[place as usize];
            let truth = |yes: bool| f64::from(u8::from(yes));
            x.push(match *operation {
                Given(index) => given[index as usize],
                Constant(bits) | Guard(bits, _) => f64::from_bits(bits),
                Negate(a) => -at(a),
                Add(a, b) => at(a) + at(b),
                Subtract(a, b) => at(a) - at(b),
                Multiply(a, b) => at(a) * at(b),
                Divide(a, b) => at(a) / at(b),
                Absolute(a) => at(a).abs(),
                Root(a) => at(a).sqrt(),
                Minimum(a, b) => Real::min(at(a), at(b)),
                Maximum(a, b) => Real::max(at(a), at(b)),
                Floor(a) => at(a).floor(),
                Sine(a) => plain::sin(at(a)),
                Cosine(a) => plain::cos(at(a)),
                Angle(a, b) => plain::atan2(at(a), at(b)),
                Exponential(a) => plain::exp(at(a)),
                Logarithm(a) => plain::ln(at(a)),
                Select(a, b, c) => {
                    if at(a) != 0.0 {
                        at(b)
                    } else {
                        at(c)
                    }
                }
                Listed(list, a) => listed(&self.tape.lists[list as usize], at(a)),
                Along(polyline, a) => along(&self.tape.polylines[polyline as usize], at(a)),
                Less(a, b) => truth(at(a) < at(b)),
                Both(a, b) => truth(at(a) != 0.0 && at(b) != 0.0),
                Either(a, b) => truth(at(a) != 0.0 || at(b) != 0.0),
            });
        }
        let of = |places: &[Place]| places.iter().map(|&place| x[place as usize]).collect();
        (of(&self.next), of(&self.results))
    }
}

/// The tape of a step, where its next state and its outputs are; constant state as constants.
fn recorded(
    interface: &Interface,
    constant: &[bool],
    step: &impl Fn(&mut Given) -> Result<Vec<Traced>, Error>,
) -> Result<(Tape, Vec<Place>, Vec<Place>), Error> {
    let counts = [interface.parameters.len(), interface.state.len(), interface.inputs.len()];
    let (tape, outcome) = record(|| {
        let given = |from: usize, count: usize| (from..from + count).map(Traced::given).collect();
        let of_state = |(k, symbol): (usize, &Symbol)| match constant[k] {
            true => Traced::constant(symbol.start),
            false => Traced::given(counts[0] + k),
        };
        let mut given = Given {
            parameters: given(0, counts[0]),
            state: interface.state.iter().enumerate().map(of_state).collect(),
            inputs: given(counts[0] + counts[1], counts[2]),
        };
        let results = step(&mut given)?;
        let places = |numbers: &[Traced]| numbers.iter().map(|number| number.place()).collect::<Vec<_>>();
        Ok((places(&given.state), places(&results)))
    })
    .map_err(Error::simulation)?;
    let (next, results) = outcome?;
    Ok((tape, next, results))
}
