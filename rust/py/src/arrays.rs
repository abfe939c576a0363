//! The one place where numpy arrays become slices and back.
//!
//! `PyReadonlyArray::as_slice` also accepts Fortran order, which would scramble an (n, k) array, so
//! everything goes through a copy in standard (row-major) layout where it is not already there.

use std::borrow::Cow;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::Error;

use crate::errors::to_py;

/// A one-dimensional array as a vector.
pub fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

/// An (n, `columns`) array as row-major numbers, without copying where they already are; another
/// number of columns is an error.
pub fn rows<'a>(
    what: &str,
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
) -> PyResult<Cow<'a, [f64]>> {
    let view = array.as_array();
    if view.ncols() != columns {
        let got = format!("shape ({}, {})", view.nrows(), view.ncols());
        return Err(to_py(&Error::input(what, got, format!("shape (n, {columns})"))));
    }
    Ok(view.to_slice().map_or_else(|| view.iter().copied().collect(), Cow::Borrowed))
}

/// A row-major vector as an (n, `columns`) array, without copying.
pub fn matrix<'py>(
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
pub fn array<'py>(py: Python<'py>, values: Vec<f64>) -> Bound<'py, PyArray1<f64>> {
    values.into_pyarray(py)
}
