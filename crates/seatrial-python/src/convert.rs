//! The one place where array-likes become rows of numbers and back.

use crate::error::refused;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{AllowTypeChange, IntoPyArray, PyArrayDyn, PyArrayLikeDyn, PyUntypedArrayMethods};
use pyo3::IntoPyObjectExt;
use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString};
use pyo3::{type_hint_identifier, type_hint_subscript};
use seatrial::description::facts::{Facts, Value, written};
use seatrial::model::kinematics::{from_euler, normalised};
use serde::Serialize;
use std::collections::BTreeMap;

/// Of the square of a quaternion's length: less is the rounding of its four products.
const UNIT_LENGTH: f64 = 1e-14;

/// An array-like of any shape as float64, C order.
pub struct Numbers {
    shape: Vec<usize>,
    values: Vec<f64>,
}

impl<'a, 'py> FromPyObject<'a, 'py> for Numbers {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = type_hint_identifier!("numpy.typing", "ArrayLike");
    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array: PyArrayLikeDyn<'py, f64, AllowTypeChange> = object.extract()?;
        Ok(Self { shape: array.shape().to_vec(), values: array.as_array().iter().copied().collect() })
    }
}

impl Numbers {
    /// The numbers of shape `(n,)`.
    pub fn vector(self, name: &str) -> PyResult<Vec<f64>> {
        match self.shape[..] {
            [_] => Ok(self.values),
            _ => Err(refused(format!("{name}: expected shape (n,), found {:?}", self.shape))),
        }
    }

    /// The numbers of shape `(n,)`, or one number n times.
    pub fn held(self, name: &str, n: usize) -> PyResult<Vec<f64>> {
        match self.shape[..] {
            [] => Ok(vec![self.values[0]; n]),
            _ => self.vector(name),
        }
    }

    /// The rows of shape `(n, C)`, or the one row of shape `(C,)`.
    pub fn rows<const C: usize>(&self, name: &str) -> PyResult<Vec<[f64; C]>> {
        match self.shape[..] {
            [c] | [_, c] if c == C => {
                Ok(self.values.chunks_exact(C).map(|row| std::array::from_fn(|i| row[i])).collect())
            }
            _ => Err(refused(format!("{name}: expected shape (n, {C}) or ({C},), found {:?}", self.shape))),
        }
    }

    /// The one row of shape `(C,)` or `(1, C)`.
    pub fn row<const C: usize>(&self, name: &str) -> PyResult<[f64; C]> {
        match self.rows(name)?[..] {
            [row] => Ok(row),
            _ => Err(refused(format!("{name}: expected shape ({C},), found {:?}", self.shape))),
        }
    }

    /// The matrix of shape `(k, columns)` in one row, and k.
    pub fn matrix(self, name: &str, columns: usize) -> PyResult<(usize, Vec<f64>)> {
        match self.shape[..] {
            [k, c] if c == columns => Ok((k, self.values)),
            _ => Err(refused(format!("{name}: expected shape (k, {columns}), found {:?}", self.shape))),
        }
    }

    /// The table of shape `(k, any)` in one row, and k.
    pub fn table(self, name: &str) -> PyResult<(usize, Vec<f64>)> {
        match self.shape[..] {
            [k, _] => Ok((k, self.values)),
            _ => Err(refused(format!("{name}: expected two dimensions, found shape {:?}", self.shape))),
        }
    }

    /// The block of shape `(k, n, columns)` in one row, with k and n.
    pub fn cube(self, name: &str, columns: usize) -> PyResult<(usize, usize, Vec<f64>)> {
        match self.shape[..] {
            [k, n, c] if c == columns => Ok((k, n, self.values)),
            _ => Err(refused(format!("{name}: expected shape (k, n, {columns}), found {:?}", self.shape))),
        }
    }

    /// The block of shape `(n, rows, k)` in one row, with n and k.
    pub fn block(self, name: &str, rows: usize) -> PyResult<(usize, usize, Vec<f64>)> {
        match self.shape[..] {
            [n, r, k] if r == rows => Ok((n, k, self.values)),
            _ => Err(refused(format!("{name}: expected shape (n, {rows}, k), found {:?}", self.shape))),
        }
    }

    /// A row of `columns` values for each of `k` cases: from shape `(k, columns)`, from `(columns,)` for all alike, or
    /// from `(k,)` and `()` where there is one column.
    pub fn for_cases(self, name: &str, k: usize, columns: usize) -> PyResult<Vec<Vec<f64>>> {
        let rows = |values: &[f64]| values.chunks_exact(columns.max(1)).map(<[f64]>::to_vec).collect();
        match self.shape[..] {
            [n, c] if n == k && c == columns => Ok(rows(&self.values)),
            [n] if columns == 1 && n == k => Ok(rows(&self.values)),
            [c] if c == columns => Ok(vec![self.values; k]),
            [] if columns == 1 => Ok(vec![self.values; k]),
            _ => Err(refused(format!(
                "{name}: expected shape ({k}, {columns}) or ({columns},), found {:?}",
                self.shape
            ))),
        }
    }

    /// Whether the array has one dimension.
    pub fn is_single(&self) -> bool {
        self.shape.len() == 1
    }

    /// Unit quaternions from shape `(n, 4)`, or from roll, pitch and yaw of shape `(n, 3)`, rad.
    pub fn attitudes(&self, name: &str) -> PyResult<Vec<[f64; 4]>> {
        let quaternions: Vec<[f64; 4]> = match self.shape.last() {
            Some(3) => self.rows::<3>(name)?.iter().map(from_euler).collect(),
            Some(4) => self.rows::<4>(name)?,
            _ => {
                return Err(refused(format!(
                    "{name}: expected quaternions (n, 4) or roll, pitch, yaw (n, 3), found {:?}",
                    self.shape
                )));
            }
        };
        let lengthless = |q: &[f64; 4]| {
            let square: f64 = q.iter().map(|x| x * x).sum();
            square.is_nan() || square <= 1e-12
        };
        if let Some(row) = quaternions.iter().position(lengthless) {
            return Err(refused(format!("{name}: row {row} is no rotation, found {:?}", quaternions[row])));
        }
        // One of unit length stays as it is, to the bit: what was read once may be given again.
        let unit = |q: &[f64; 4]| (q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < UNIT_LENGTH;
        Ok(quaternions.iter().map(|q| if unit(q) { *q } else { normalised(q) }).collect())
    }
}

/// A fresh float64 array.
pub struct Array(ArrayD<f64>);

impl Array {
    /// The values in C order as an array of this shape.
    pub fn new(shape: &[usize], values: Vec<f64>) -> Self {
        Self(ArrayD::from_shape_vec(IxDyn(shape), values).expect("as many values as the shape says"))
    }

    /// Rows as `(n, C)`, or as `(C,)` when `single`.
    pub fn rows<const C: usize>(rows: &[[f64; C]], single: bool) -> Self {
        let shape = if single { vec![C] } else { vec![rows.len(), C] };
        Self::new(&shape, rows.concat())
    }
}

impl<'py> IntoPyObject<'py> for Array {
    type Target = PyArrayDyn<f64>;
    type Output = Bound<'py, PyArrayDyn<f64>>;
    type Error = std::convert::Infallible;
    const OUTPUT_TYPE: PyStaticExpr = type_hint_subscript!(
        type_hint_identifier!("numpy.typing", "NDArray"),
        type_hint_identifier!("numpy", "float64")
    );
    fn into_pyobject(self, py: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok(self.0.into_pyarray(py))
    }
}

/// A plain value of a report or a file.
pub struct Fact(Value);

impl Fact {
    /// A value of the core.
    pub fn of(value: Value) -> Self {
        Self(value)
    }
}

/// The tables of a file, or one of them, by name.
pub struct Table(Value);

impl Table {
    /// A file of the core, or a part of one, as plain data.
    pub fn of<F: Serialize>(file: &F) -> Self {
        Self(written(file))
    }

    /// Values by name.
    pub fn from_value(value: Value) -> Self {
        Self(value)
    }

    /// Nothing.
    pub fn empty() -> Self {
        Self(Value::Table(Vec::new()))
    }
}

impl<'py> IntoPyObject<'py> for Table {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;
    const OUTPUT_TYPE: PyStaticExpr = type_hint_subscript!(
        type_hint_identifier!("builtins", "dict"),
        type_hint_identifier!("builtins", "str"),
        type_hint_identifier!("typing", "Any")
    );
    fn into_pyobject(self, py: Python<'py>) -> Result<Self::Output, Self::Error> {
        Fact(self.0).into_pyobject(py)
    }
}

/// The facts by name.
pub fn fact_map(facts: Facts) -> BTreeMap<&'static str, Fact> {
    facts.into_iter().map(|(name, value)| (name, Fact(value))).collect()
}

impl<'py> IntoPyObject<'py> for Fact {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;
    const OUTPUT_TYPE: PyStaticExpr = type_hint_identifier!("typing", "Any");
    fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match self.0 {
            Value::None => Ok(py.None().into_bound(py)),
            Value::Flag(x) => x.into_bound_py_any(py),
            Value::Number(x) => x.into_bound_py_any(py),
            Value::Text(x) => x.into_bound_py_any(py),
            Value::Whole(x) => x.into_bound_py_any(py),
            Value::Vector(x) => x.into_bound_py_any(py),
            Value::List(values) => {
                let values: Vec<Self> = values.into_iter().map(Self).collect();
                values.into_bound_py_any(py)
            }
            Value::Table(values) => {
                let table = PyDict::new(py);
                for (key, value) in values {
                    table.set_item(key, Self(value))?;
                }
                Ok(table.into_any())
            }
        }
    }
}

/// Numbers by name: any mapping of names to array-likes.
pub struct Named(BTreeMap<String, Numbers>);

impl<'a, 'py> FromPyObject<'a, 'py> for Named {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = type_hint_subscript!(
        type_hint_identifier!("collections.abc", "Mapping"),
        type_hint_identifier!("builtins", "str"),
        type_hint_identifier!("numpy.typing", "ArrayLike")
    );
    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let Ok(map) = object.cast::<PyMapping>() else {
            return Err(refused(format!(
                "expected numbers by name, {{\"yaw\": 0.1}}, found {}",
                kind(&object)?
            )));
        };
        let pair = |item: Bound<'py, PyAny>| {
            let (key, value): (Bound<'py, PyAny>, Bound<'py, PyAny>) = item.extract()?;
            let Ok(name) = key.extract::<String>() else {
                return Err(refused(format!("expected names as text, found {}", kind(&key)?)));
            };
            // NumPy would read the text "1.0" as a number.
            match value.extract::<Numbers>() {
                Ok(numbers) if !value.is_instance_of::<PyString>() => Ok((name, numbers)),
                _ => Err(refused(format!("{name}: expected numbers, found {}", kind(&value)?))),
            }
        };
        Ok(Self(map.items()?.iter().map(pair).collect::<PyResult<_>>()?))
    }
}

/// A value as messages name it, with its type.
fn kind(object: &Bound<'_, PyAny>) -> PyResult<String> {
    let shown: String = object.repr()?.to_string().chars().take(40).collect();
    Ok(format!("{shown} ({})", object.get_type().name()?))
}

impl Named {
    /// The arrays by name.
    pub fn by_name(self) -> BTreeMap<String, Numbers> {
        self.0
    }

    /// One series `(n,)` per name; none when missing.
    pub fn vectors(map: Option<Self>) -> PyResult<BTreeMap<String, Vec<f64>>> {
        map.into_iter().flat_map(|m| m.0).map(|(name, x)| Ok((name.clone(), x.vector(&name)?))).collect()
    }

    /// One series `(n,)` per name, or one number for all of it; none when missing.
    pub fn held(map: Option<Self>, n: usize) -> PyResult<BTreeMap<String, Vec<f64>>> {
        let series = |(name, x): (String, Numbers)| x.held(&name, n).map(|values| (name, values));
        map.into_iter().flat_map(|m| m.0).map(series).collect()
    }

    /// One number per name; none when missing.
    pub fn scalars(map: Option<Self>) -> PyResult<BTreeMap<String, f64>> {
        let one = |(name, x): (String, Numbers)| match x.values[..] {
            [value] => Ok((name, value)),
            _ => Err(refused(format!("{name}: expected one number, found shape {:?}", x.shape))),
        };
        map.into_iter().flat_map(|m| m.0).map(one).collect()
    }
}

/// The rows of an optional array of shape `(n, C)` or `(C,)`.
pub fn optional_rows<const C: usize>(name: &str, rows: Option<Numbers>) -> PyResult<Vec<[f64; C]>> {
    rows.map_or(Ok(Vec::new()), |rows| rows.rows(name))
}
