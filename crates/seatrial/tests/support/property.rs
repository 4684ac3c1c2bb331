//! Properties of drawn values, with one runner for all of them.
//!
//! The macro `proptest!` compiles its runner and its shrinking for every test anew, over a quarter of the evidence's code.
//! Here the values travel in boxes, so that both are compiled once.

use std::any::Any;
use std::fmt::Debug;

use proptest::prelude::*;
use proptest::test_runner::{TestCaseResult, TestRunner};

/// A drawn value of any type.
trait Drawn: Debug {
    fn any(self: Box<Self>) -> Box<dyn Any>;
}

impl<T: Debug + 'static> Drawn for T {
    fn any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}

/// Tests `name in strategy, ...` over so many cases, in the words of `proptest!`.
macro_rules! properties {
    (#![cases($count:expr)] $($(#[$attribute:meta])* fn $name:ident($($value:pat in $strategy:expr),+ $(,)?) $law:block)*) => {
        $($(#[$attribute])* fn $name() {
            let names = stringify!($($value),+);
            crate::property::hold($count, names, ($($strategy,)+), |($($value,)+)| {
                let (): () = $law;
                Ok(())
            });
        })*
    };
}

/// The law holds for so many drawn values, times `PROPTEST_CASES`/256 where that is set.
///
/// # Panics
/// With the smallest values found that break it, under their names.
pub fn hold<S: Strategy + 'static>(
    count: u32,
    names: &str,
    strategy: S,
    law: impl Fn(S::Value) -> TestCaseResult,
) where
    S::Value: 'static,
{
    let drawn = strategy.prop_map(|value| Box::new(value) as Box<dyn Drawn>).boxed();
    run(count, names, &drawn, &|value| law(*value.any().downcast().expect("a value of this strategy")));
}

fn run(
    count: u32,
    names: &str,
    strategy: &BoxedStrategy<Box<dyn Drawn>>,
    law: &dyn Fn(Box<dyn Drawn>) -> TestCaseResult,
) {
    let default = ProptestConfig::default();
    let cases = (count * default.cases).div_ceil(256);
    let mut runner = TestRunner::new(ProptestConfig { cases, failure_persistence: None, ..default });
    if let Err(error) = runner.run(strategy, law) {
        panic!("({names}): {error}\n{runner}");
    }
}

properties! {
    #![cases(64)]

    #[test]
    #[should_panic(expected = "(a, b): Test failed: 1000 is too large")]
    fn a_law_that_fails_names_its_smallest_values(a in 0..2000_i32, b in 0..10_i32) {
        prop_assert!(a < 1000, "{a} is too large");
        prop_assert!(b < 10);
    }
}
