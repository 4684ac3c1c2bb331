//! What a part of the loop remembers from step to step, number by number and by name: for those who keep the state
//! of a step outside of it, such as a program that is exported ([`crate::export`]).
//!
//! A struct lists every field once ([`memory!`](crate::memory)), those that are no memory behind a semicolon: a
//! field that is added and not listed does not compile. Tests: `tests/export.rs`.

use super::real::Real;

/// What is done with a number and its name.
pub type Visit<'a, T> = dyn FnMut(&str, &mut T) + 'a;

/// Numbers that are remembered from step to step.
pub trait Memory<T> {
    /// Shows every number by its name, which begins with `name`, always in the same order.
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>);
}

impl<T: Real> Memory<T> for T {
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>) {
        f(name, self);
    }
}

impl<T, M: Memory<T>, const N: usize> Memory<T> for [M; N] {
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>) {
        for (i, part) in self.iter_mut().enumerate() {
            part.visit(&format!("{name}_{i}"), f);
        }
    }
}

impl<T, M: Memory<T>> Memory<T> for Vec<M> {
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>) {
        for (i, part) in self.iter_mut().enumerate() {
            part.visit(&format!("{name}_{i}"), f);
        }
    }
}

impl<T, M: Memory<T>> Memory<T> for Option<M> {
    fn visit(&mut self, name: &str, f: &mut Visit<'_, T>) {
        if let Some(part) = self {
            part.visit(name, f);
        }
    }
}

/// Implements [`Memory`](crate::number::memory::Memory) for a struct: the fields that are remembered; those that are
/// not.
#[macro_export]
macro_rules! memory {
    ($type:ident: $($field:ident),+; $($left:ident),*) => {
        impl<T: $crate::number::real::Real> $crate::number::memory::Memory<T> for $type<T> {
            fn visit(&mut self, name: &str, f: &mut $crate::number::memory::Visit<'_, T>) {
                let Self { $($field,)+ $($left: _,)* } = self;
                let under = |field: &str| match name {
                    "" => field.to_owned(),
                    _ => format!("{name}_{field}"),
                };
                $($crate::number::memory::Memory::<T>::visit($field, &under(stringify!($field)), f);)+
            }
        }
    };
}
