//! The one place where numbers of Python become those of the core, and back.
//!
//! What comes in is finite ([`finite`], [`vector`], [`rows`]; [`rows_with_limits`] allows infinity,
//! [`of_width`] leaves the check to the core), what goes out is no nan ([`array`], [`matrix`]).
//!
//! `PyReadonlyArray::as_slice` also accepts Fortran order, which would scramble an (n, k) array, so
//! everything goes through a copy in standard (row-major) layout where it is not already there.

use std::borrow::Cow;

use numpy::ndarray::{Array2, ArrayView2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::Error;

use crate::errors::to_py;

/// Numbers that are looked at before one of them may be refused.
const ASKED_AT_ONCE: usize = 64;

/// Numbers in an argument of Python.
pub trait Numbers {
    /// The first that is not finite.
    fn not_finite(&self) -> Option<f64>;
}

impl Numbers for f64 {
    fn not_finite(&self) -> Option<f64> {
        (!self.is_finite()).then_some(*self)
    }
}

impl<T: Numbers> Numbers for Option<T> {
    fn not_finite(&self) -> Option<f64> {
        self.as_ref().and_then(Numbers::not_finite)
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    fn not_finite(&self) -> Option<f64> {
        self.iter().find_map(Numbers::not_finite)
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn not_finite(&self) -> Option<f64> {
        self.iter().find_map(Numbers::not_finite)
    }
}

/// For `from_py_with`: an argument that holds finite numbers only.
pub fn finite<'py, T>(value: &Bound<'py, PyAny>) -> PyResult<T>
where
    T: Numbers + for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>,
{
    let complex = value.getattr("dtype").and_then(|dtype| dtype.getattr("kind"));
    if complex.is_ok_and(|kind| kind.eq("c").unwrap_or(false)) {
        return Err(to_py(&Error::input("number", "complex numbers", "real numbers")));
    }
    let found: T = value.extract().map_err(Into::into)?;
    found
        .not_finite()
        .map_or(Ok(found), |number| Err(to_py(&Error::input("number", number, "a finite number"))))
}

/// For `from_py_with`: an argument that is text.
pub fn text(value: &Bound<'_, PyAny>) -> PyResult<String> {
    value.extract().map_err(|_| {
        let got = value.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string());
        to_py(&Error::input("text of a program, dialect", got, "text"))
    })
}

fn all_finite(what: &str, values: &[f64], columns: usize) -> PyResult<()> {
    check(what, values, columns, f64::is_finite, "finite numbers")
}

fn check(
    what: &str,
    values: &[f64],
    columns: usize,
    fits: impl Fn(f64) -> bool,
    expected: &str,
) -> PyResult<()> {
    misfit(values, fits).map_or(Ok(()), |at| {
        let what = format!("{what}, row {}", at / columns.max(1));
        Err(to_py(&Error::input(what, values[at], expected)))
    })
}

/// The first number that does not fit: some are asked at a time, without a branch for each.
fn misfit(values: &[f64], fits: impl Fn(f64) -> bool) -> Option<usize> {
    let all = |some: &&[f64]| some.iter().fold(true, |all, &value| all & fits(value));
    let fit = values.chunks(ASKED_AT_ONCE).take_while(all).count() * ASKED_AT_ONCE;
    values.iter().skip(fit).position(|&value| !fits(value)).map(|at| fit + at)
}

/// A one-dimensional array of finite numbers as a vector.
pub fn vector(what: &str, array: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    all_finite(what, &values, 1)?;
    Ok(values)
}

/// The same, in which a limit may be infinite.
pub fn vector_with_limits(what: &str, array: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    check(what, &values, 1, |value| !value.is_nan(), "numbers")?;
    Ok(values)
}

/// An (n, `columns`) array of finite numbers row by row, without copying where they already are;
/// another number of columns is an error.
pub fn rows<'a>(
    what: &str,
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
) -> PyResult<Cow<'a, [f64]>> {
    let values = of_width(what, array, columns)?;
    all_finite(what, &values, columns)?;
    Ok(values)
}

/// The same, in which a limit may be infinite.
pub fn rows_with_limits<'a>(
    what: &str,
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
) -> PyResult<Cow<'a, [f64]>> {
    let values = of_width(what, array, columns)?;
    check(what, &values, columns, |value| !value.is_nan(), "numbers")?;
    Ok(values)
}

/// The same of any numbers: the core checks those that it uses, which are few of them.
pub fn of_width<'a>(
    what: &str,
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
) -> PyResult<Cow<'a, [f64]>> {
    let view = array.as_array();
    if view.ncols() != columns {
        let got = format!("shape ({}, {})", view.nrows(), view.ncols());
        return Err(to_py(&Error::input(what, got, format!("shape (n, {columns})"))));
    }
    Ok(view.to_slice().map_or_else(|| row_after_row(&view), Cow::Borrowed))
}

fn row_after_row<'a>(view: &ArrayView2<'_, f64>) -> Cow<'a, [f64]> {
    let mut values = Vec::with_capacity(view.len());
    for row in view.rows() {
        values.extend(row);
    }
    Cow::Owned(values)
}

/// Rows of an (n, `columns`) array, of which there may be none: rows of machines without rotary axes.
pub fn each_row(values: &[f64], columns: usize, n: usize) -> impl Iterator<Item = &[f64]> {
    (0..n).map(move |row| values.get(columns * row..columns * (row + 1)).unwrap_or_default())
}

/// Numbers that come out are numbers: input beyond double precision is refused here.
fn no_nan(values: &[f64]) -> PyResult<()> {
    if misfit(values, |value| !value.is_nan()).is_some() {
        let expected =
            "numbers that double precision can hold: the input is too large or too small";
        return Err(to_py(&Error::input("result", "nan", expected)));
    }
    Ok(())
}

/// A row-major vector as an (n, `columns`) array, without copying.
pub fn matrix<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    no_nan(&values)?;
    matrix_with_gaps(py, values, columns)
}

/// The same with `n` rows, of which each may be empty.
pub fn matrix_of<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    n: usize,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    no_nan(&values)?;
    Array2::from_shape_vec((n, columns), values)
        .map(|array| array.into_pyarray(py))
        .map_err(|error| pyo3::exceptions::PyRuntimeError::new_err(error.to_string()))
}

/// The same, in which rows of samples that failed are nan.
pub fn matrix_with_gaps<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = values.len().checked_div(columns).unwrap_or(0);
    Array2::from_shape_vec((rows, columns), values)
        .map(|array| array.into_pyarray(py))
        .map_err(|error| pyo3::exceptions::PyRuntimeError::new_err(error.to_string()))
}

/// A vector as a one-dimensional array, without copying.
pub fn array<'py>(py: Python<'py>, values: Vec<f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    no_nan(&values)?;
    Ok(values.into_pyarray(py))
}
