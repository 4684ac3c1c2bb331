//! A program as C99: a header and a source, with nothing but `math.h`.
//!
//! In double precision sine, cosine, angle and exponential are the core's own, written into the source (`elementary.c`):
//! platforms differ in the last bit, and the commands with them. In single precision they are the platform's.
//!
//! Every operation is a statement of its own, in the order of the recording: compilers that contract products and
//! sums within an expression find none. No function branches, but those four and what looks a place up in a list. State,
//! parameters and constants that follow from parameters belong to the caller.

use super::program::{Program, Stage, Symbol};
use crate::number::traced::{Operation, Place};
use std::fmt::Write;

/// Names and words of a C module.
pub struct Module<'a> {
    /// Prefix of everything that is public: an identifier.
    pub prefix: &'a str,
    /// What it is, for the head of its files: lines.
    pub about: &'a [String],
    /// Whether the outputs show the state before a step, by a function of their own.
    pub measured: bool,
}

/// A header and a source.
pub struct Source {
    /// `PREFIX.h`.
    pub header: String,
    /// `PREFIX.c`.
    pub source: String,
}

/// The smallest normal numbers of double and single precision: smaller constants stand for them.
const TINY: [f64; 2] = [f64::MIN_POSITIVE, f32::MIN_POSITIVE as f64];

/// What the source says once, where anything uses it: name, text.
const HELPERS: [(&str, &str); 2] = [
    (
        "entry",
        "static real entry(const real *list, int count, real at)\n{\n    int i = 0;\n    if (at > R(0.0))\n    {\n        \
         i = (at < (real)(count - 1)) ? (int)at : (count - 1);\n    }\n    return list[i];\n}\n",
    ),
    (
        "polyline",
        "static real polyline(const real *knots, int count, real at)\n{\n    int i = 0;\n    real y = knots[1];\n    while \
         ((i < count) && (knots[2 * i] < at))\n    {\n        i++;\n    }\n    if (i == count)\n    {\n        y = \
         knots[(2 * count) - 1];\n    }\n    else if (i > 0)\n    {\n        const real *from = &knots[2 * (i - 1)];\n        \
         y = from[1] + (((from[3] - from[1]) / (from[2] - from[0])) * (at - from[0]));\n    }\n    else\n    {\n        /* \
         before the first knot */\n    }\n    return y;\n}\n",
    ),
];

/// The functions of `math.h` in use: name here, in double and in single precision.
const FUNCTIONS: [(&str, &str); 10] = [
    ("ABS", "fabs"),
    // Of a number and one that is none the number, as in the core; a processor has them as one instruction.
    ("SMALLER", "fmin"),
    ("LARGER", "fmax"),
    ("SQRT", "sqrt"),
    ("FLOOR", "floor"),
    ("SIN", "sin"),
    ("COS", "cos"),
    ("ATAN2", "atan2"),
    ("EXP", "exp"),
    ("LOG", "log"),
];

/// Those that the source brings with it in double precision: name, what is called, the part of [`ELEMENTARY`].
const OWN: [(&str, &str, &str); 4] = [
    ("SIN", "core_turned((a), 0)", "SINE"),
    ("COS", "core_turned((a), 1)", "SINE"),
    ("ATAN2", "core_angle((a), (b))", "ANGLE"),
    ("EXP", "core_exponential((a))", "EXPONENTIAL"),
];

/// The core's elementary functions, part by part behind a head with their licence.
const ELEMENTARY: &str = include_str!("elementary.c");

impl Program {
    /// The program as C.
    pub fn to_c(&self, module: &Module<'_>) -> Source {
        Writer { program: self, module, stages: self.stages(), kept: self.kept() }.write()
    }

    /// The statements that find the outputs and the next state, for a function that is written elsewhere: it has what
    /// they read and write behind the pointers `s`, `in` and `out`.
    pub fn statements(&self, outputs: bool, state: bool) -> String {
        let module = Module { prefix: "", about: &[], measured: false };
        let (stages, kept) = (self.stages(), self.kept());
        Writer { program: self, module: &module, stages, kept }.statements(outputs, state)
    }

    /// The lists and polylines that the statements read.
    pub fn tables(&self) -> String {
        let mut text = String::new();
        for (i, list) in self.tape.lists.iter().enumerate() {
            let numbers = joined(list.iter().copied());
            let _ = writeln!(text, "static const real list_{i}[{}] = {{ {numbers} }};", list.len());
        }
        for (i, line) in self.tape.polylines.iter().enumerate() {
            let numbers = joined(line.iter().flatten().copied());
            let _ = writeln!(text, "static const real line_{i}[{}] = {{ {numbers} }};", 2 * line.len());
        }
        text
    }

    /// Per place that is prepared and read at every step, its index among the prepared constants.
    fn kept(&self) -> Vec<Option<usize>> {
        let stages = self.stages();
        let mut wanted = vec![false; stages.len()];
        let is_given = |place: Place| matches!(self.tape.operations[place as usize], Operation::Given(_));
        let mut want = |place: Place| {
            wanted[place as usize] |= stages[place as usize] == Stage::Prepared && !is_given(place);
        };
        for (place, operation) in self.tape.operations.iter().enumerate() {
            if stages[place] == Stage::Step {
                operation.reads().for_each(&mut want);
            }
        }
        self.next.iter().chain(&self.results).for_each(|&place| want(place));
        let mut count = 0;
        let number = |wanted: bool| {
            wanted.then(|| {
                count += 1;
                count - 1
            })
        };
        wanted.into_iter().map(number).collect()
    }
}

struct Writer<'a> {
    program: &'a Program,
    module: &'a Module<'a>,
    stages: Vec<Stage>,
    kept: Vec<Option<usize>>,
}

impl Writer<'_> {
    fn write(&self) -> Source {
        Source { header: self.header(), source: self.source() }
    }

    fn kept_count(&self) -> usize {
        self.kept.iter().flatten().count()
    }

    fn head(&self) -> String {
        let mut text = String::from("/*\n");
        for line in self.module.about {
            let _ = writeln!(text, " * {}", line.replace("*/", "* /"));
        }
        text + " */\n"
    }

    fn header(&self) -> String {
        let (prefix, interface) = (self.module.prefix, &self.program.interface);
        let guard = format!("{}_H", prefix.to_uppercase());
        let mut text = self.head();
        let _ = write!(
            text,
            "#ifndef {guard}\n#define {guard}\n\n/* Single precision where SEATRIAL_FLOAT is defined, for header and \
             source alike. */\n#ifdef SEATRIAL_FLOAT\ntypedef float {prefix}_real;\n#else\ntypedef double {prefix}_real;\n\
             #endif\n\n"
        );
        let described = |name: &str, about: &str, symbols: &[Symbol]| {
            let mut text = format!("/* {about} */\ntypedef struct\n{{\n");
            for symbol in symbols {
                let words = [symbol.unit.as_str(), &symbol.about].into_iter().filter(|word| !word.is_empty());
                let note = words.collect::<Vec<_>>().join(": ").replace("*/", "* /");
                let _ = writeln!(text, "    {prefix}_real {}; /* {note} */", symbol.name);
            }
            if symbols.is_empty() {
                let _ = writeln!(text, "    {prefix}_real none; /* there are none */");
            }
            let _ = write!(text, "}} {prefix}_{name};\n\n");
            text
        };
        text += &described("parameters", "What may be set before prepare().", &interface.parameters);
        let _ = write!(
            text,
            "/* What follows from the parameters; made by prepare(). */\ntypedef struct\n{{\n    {prefix}_real c[{}];\n}} \
             {prefix}_constants;\n\n",
            self.kept_count().max(1)
        );
        text +=
            &described("state", "What is remembered from step to step; made by begin().", &interface.state);
        text += &described("input", "What is told.", &interface.inputs);
        text += &described("output", "What comes out.", &interface.outputs);
        for (comment, signature) in self.signatures() {
            let _ = write!(text, "/* {comment} */\n{signature};\n\n");
        }
        let _ = writeln!(text, "#endif");
        text
    }

    /// What each function does, and its signature.
    fn signatures(&self) -> Vec<(&'static str, String)> {
        let prefix = self.module.prefix;
        let with = |name: &str, state: &str, last: &str| {
            format!(
                "void {prefix}_{name}(const {prefix}_parameters *p, const {prefix}_constants *k, {state}{prefix}_state \
                 *s,\n    const {prefix}_input *in{last})"
            )
        };
        let out = format!(", {prefix}_output *out");
        let mut all = vec![
            (
                "The parameters as they were exported.",
                format!("void {prefix}_defaults({prefix}_parameters *p)"),
            ),
            (
                "The constants that follow from the parameters; again after each change of them.",
                format!("void {prefix}_prepare(const {prefix}_parameters *p, {prefix}_constants *k)"),
            ),
            (
                "The state and the inputs at the start.",
                format!("void {prefix}_begin({prefix}_state *s, {prefix}_input *in)"),
            ),
        ];
        if self.module.measured {
            all.push(("The outputs at a state.", with("measure", "const ", &out)));
            all.push(("One step.", with("step", "", "")));
        } else {
            all.push(("One step, and its outputs.", with("step", "", &out)));
        }
        all
    }

    fn source(&self) -> String {
        let (prefix, program) = (self.module.prefix, self.program);
        let body = program.tables();
        let mut functions = String::new();
        let mut signatures = self.signatures().into_iter().map(|(_, signature)| signature);
        let mut next = || signatures.next().unwrap_or_default();
        let assign = |text: &mut String, what: &str, symbols: &[Symbol]| {
            for symbol in symbols {
                let _ = writeln!(text, "    {what}->{} = {};", symbol.name, constant(symbol.start));
            }
            if symbols.is_empty() {
                let _ = writeln!(text, "    {what}->none = R(0.0);");
            }
        };
        let _ = write!(functions, "{}\n{{\n", next());
        assign(&mut functions, "p", &program.interface.parameters);
        let _ = write!(functions, "}}\n\n{}\n{{\n", next());
        functions += &self.prepared();
        let _ = write!(functions, "}}\n\n{}\n{{\n", next());
        assign(&mut functions, "s", &program.interface.state);
        assign(&mut functions, "in", &program.interface.inputs);
        functions += "}\n";
        let parts: &[(bool, bool)] =
            if self.module.measured { &[(true, false), (false, true)] } else { &[(true, true)] };
        for &(outputs, state) in parts {
            let _ = write!(functions, "\n{}\n{{\n", next());
            functions += &self.step(outputs, state);
            functions += "}\n";
        }
        let mut text = self.head();
        let _ = write!(text, "#include \"{prefix}.h\"\n#include <math.h>\n\ntypedef {prefix}_real real;\n\n");
        text += &preamble(&[&body, &functions]);
        text + &body + if body.is_empty() { "" } else { "\n" } + &functions
    }

    /// The body of prepare().
    fn prepared(&self) -> String {
        let operations = &self.program.tape.operations;
        let mut text = String::new();
        let wanted: Vec<Place> =
            (0..operations.len()).filter(|&place| self.kept[place].is_some()).map(|p| p as Place).collect();
        if wanted.is_empty() {
            return String::from("    (void)p;\n    k->c[0] = R(0.0);\n");
        }
        let mut needed = vec![false; operations.len()];
        wanted.iter().for_each(|&place| needed[place as usize] = true);
        for place in (0..operations.len()).rev().filter(|&place| self.stages[place] == Stage::Prepared) {
            if needed[place] {
                operations[place].reads().for_each(|read| needed[read as usize] = true);
            }
        }
        for (place, operation) in operations.iter().enumerate() {
            if needed[place]
                && self.stages[place] == Stage::Prepared
                && !matches!(operation, Operation::Given(_))
            {
                let value = self.value(*operation, &|read| self.name(read, Stage::Prepared));
                let _ = writeln!(text, "    const {} t{place} = {value};", kind(operation));
            }
        }
        for place in wanted {
            let index = self.kept[place as usize].unwrap_or(0);
            let _ = writeln!(text, "    k->c[{index}] = t{place};");
        }
        text
    }

    /// The body of a step, or of a part of it.
    fn step(&self, outputs: bool, state: bool) -> String {
        let text = self.statements(outputs, state);
        let mut unused = String::new();
        for pointer in ["p", "k", "s", "in"] {
            if !text.contains(&format!(" {pointer}->")) {
                let _ = writeln!(unused, "    (void){pointer};");
            }
        }
        text + &unused
    }

    /// The statements of a step, or of a part of it.
    fn statements(&self, outputs: bool, state: bool) -> String {
        let (program, interface) = (self.program, &self.program.interface);
        let operations = &program.tape.operations;
        let mut needed = vec![false; operations.len()];
        for (part, wanted) in [(true, outputs), (false, state)] {
            if wanted {
                needed.iter_mut().zip(program.needed_for(part)).for_each(|(all, own)| *all |= own);
            }
        }
        let mut text = String::new();
        for (place, operation) in operations.iter().enumerate() {
            if needed[place] && self.stages[place] == Stage::Step {
                let value = self.value(*operation, &|read| self.name(read, Stage::Step));
                let _ = writeln!(text, "    const {} t{place} = {value};", kind(operation));
            }
        }
        // All of the old state has been read by now.
        if state {
            for (symbol, &place) in interface.state.iter().zip(&program.next) {
                let _ = writeln!(text, "    s->{} = {};", symbol.name, self.name(place, Stage::Step));
            }
        }
        if outputs {
            for (symbol, &place) in interface.outputs.iter().zip(&program.results) {
                let _ = writeln!(text, "    out->{} = {};", symbol.name, self.name(place, Stage::Step));
            }
        }
        text
    }

    /// How a number is called while a stage is carried out.
    fn name(&self, place: Place, stage: Stage) -> String {
        let operation = self.program.tape.operations[place as usize];
        match (operation, self.stages[place as usize], self.kept[place as usize]) {
            (Operation::Constant(_) | Operation::Guard(..), ..) => self.value(operation, &|_| String::new()),
            (Operation::Given(index), Stage::Prepared, _) => {
                format!("p->{}", self.program.interface.parameters[index as usize].name)
            }
            (_, Stage::Prepared, Some(index)) if stage == Stage::Step => format!("k->c[{index}]"),
            // Constants that follow from constants beside guards alone are written out where they are needed.
            (_, Stage::Constant, _) => format!("({})", self.value(operation, &|read| self.name(read, stage))),
            _ => format!("t{place}"),
        }
    }

    /// What is done, with the names of what it reads.
    fn value(&self, operation: Operation, name: &dyn Fn(Place) -> String) -> String {
        use Operation::*;
        let interface = &self.program.interface;
        let tape = &self.program.tape;
        match operation {
            Given(index) => {
                let index = index as usize - interface.parameters.len();
                match index.checked_sub(interface.state.len()) {
                    None => format!("s->{}", interface.state[index].name),
                    Some(index) => format!("in->{}", interface.inputs[index].name),
                }
            }
            Constant(bits) => constant(f64::from_bits(bits)),
            Guard(double, single) => {
                let [double, single] = [double, single].map(|bits| digits(f64::from_bits(bits)));
                format!("GUARD({double}, {single})")
            }
            Negate(a) => format!("-{}", name(a)),
            Add(a, b) => format!("{} + {}", name(a), name(b)),
            Subtract(a, b) => format!("{} - {}", name(a), name(b)),
            Multiply(a, b) => format!("{} * {}", name(a), name(b)),
            Divide(a, b) => format!("{} / {}", name(a), name(b)),
            Absolute(a) => format!("ABS({})", name(a)),
            Root(a) => format!("SQRT({})", name(a)),
            Minimum(a, b) => format!("SMALLER({}, {})", name(a), name(b)),
            Maximum(a, b) => format!("LARGER({}, {})", name(a), name(b)),
            Floor(a) => format!("FLOOR({})", name(a)),
            Sine(a) => format!("SIN({})", name(a)),
            Cosine(a) => format!("COS({})", name(a)),
            Angle(a, b) => format!("ATAN2({}, {})", name(a), name(b)),
            Exponential(a) => format!("EXP({})", name(a)),
            Logarithm(a) => format!("LOG({})", name(a)),
            Select(a, b, c) => format!("{} ? {} : {}", name(a), name(b), name(c)),
            Listed(i, a) => format!("entry(list_{i}, {}, {})", tape.lists[i as usize].len(), name(a)),
            Along(i, a) => format!("polyline(line_{i}, {}, {})", tape.polylines[i as usize].len(), name(a)),
            Less(a, b) => format!("{} < {}", name(a), name(b)),
            Both(a, b) => format!("{} && {}", name(a), name(b)),
            Either(a, b) => format!("{} || {}", name(a), name(b)),
        }
    }
}

/// Macros and helpers that these texts use: constants, functions of `math.h`, what C has no operator for.
pub(super) fn preamble(texts: &[&str]) -> String {
    let mut text = String::from("#define R(x) ((real)(x))\n");
    let used = |name: &str| texts.iter().any(|text| text.contains(&format!("{name}(")));
    for (single, suffix) in [(true, "f"), (false, "")] {
        text += if single { "#ifdef SEATRIAL_FLOAT\n" } else { "#else\n" };
        if used("GUARD") {
            let _ = writeln!(text, "#define GUARD(d, s) ((real)({}))", if single { "s" } else { "d" });
        }
        for (name, function) in FUNCTIONS.iter().filter(|(name, _)| used(name)) {
            let two = ["ATAN2", "SMALLER", "LARGER"].contains(name);
            let arguments = if two { ["(a, b)", "((a), (b))"] } else { ["(a)", "((a))"] };
            let own = OWN.iter().find(|(own, ..)| own == name && !single);
            let call =
                own.map_or(format!("{function}{suffix}{}", arguments[1]), |(_, call, _)| (*call).to_owned());
            let _ = writeln!(text, "#define {name}{} {call}", arguments[0]);
        }
    }
    text += "#endif\n\n";
    text += &elementary(&used);
    for (_, helper) in HELPERS.iter().filter(|(name, _)| used(name)) {
        text += helper;
        text.push('\n');
    }
    text
}

/// The parts of [`ELEMENTARY`] that are `used`, with their licence; nothing where none is.
fn elementary(used: &impl Fn(&str) -> bool) -> String {
    let mut parts = ELEMENTARY.split("/* part: ");
    let head = parts.next().unwrap_or_default();
    let wanted = |name: &str| OWN.iter().any(|(function, _, part)| *part == name && used(function));
    let bodies = parts.filter_map(|part| part.split_once(" */\n")).filter(|(name, _)| wanted(name));
    let text: String = bodies.map(|(_, body)| body).collect();
    if text.is_empty() {
        text
    } else {
        format!("#ifndef SEATRIAL_FLOAT\n{head}{}\n#endif\n\n", text.trim_end())
    }
}

/// The type of a place.
fn kind(operation: &Operation) -> &'static str {
    if operation.is_truth() { "_Bool" } else { "real" }
}

/// Digits that tell the number.
fn digits(x: f64) -> String {
    format!("{x:?}")
}

/// A constant of the type in use.
pub(super) fn constant(x: f64) -> String {
    match x {
        _ if x.is_nan() => "R(NAN)".into(),
        _ if x == f64::INFINITY => "R(INFINITY)".into(),
        _ if x == f64::NEG_INFINITY => "R(-INFINITY)".into(),
        _ if x != 0.0 && x.abs() < TINY[1] => {
            let [double, single] = [x.abs().max(TINY[0]), TINY[1]].map(|tiny| digits(tiny.copysign(x)));
            format!("GUARD({double}, {single})")
        }
        _ => format!("R({})", digits(x)),
    }
}

fn joined(numbers: impl Iterator<Item = f64>) -> String {
    let words: Vec<String> = numbers.map(constant).collect();
    words.join(", ")
}
