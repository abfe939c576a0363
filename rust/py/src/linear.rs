//! Linear least squares of [`trunnion_core::linear`].

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::linear;

use crate::arrays::{array, finite, matrix, rows, vector};
use crate::errors::IntoPy;

/// Least squares of `columns` (n, p) · x = `values` (n,): solution (p,), cofactor (p, p), rank,
/// singular values, what is held (p,), what is not identifiable (p,), the combinations that are not
/// (k, p), the directions that are (rank, p), and the orthonormal basis (n, rank), which has no
/// columns unless it is expected.
#[pyfunction]
pub fn linear_fit<'py>(
    py: Python<'py>,
    columns: PyReadonlyArray2<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    hold: Vec<bool>,
    #[pyo3(from_py_with = finite)] tolerance: f64,
    basis: bool,
) -> PyResult<(
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    usize,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
)> {
    let p = columns.as_array().ncols();
    let columns = rows("columns", &columns, p)?;
    let values = vector("values", &values)?;
    let options = linear::Options { hold, tolerance, basis };
    let fit = py.detach(|| linear::linear_fit(&columns, &values, p, &options)).into_py()?;
    Ok((
        array(py, fit.solution)?,
        matrix(py, fit.cofactor, p)?,
        fit.rank,
        array(py, fit.singular_values)?,
        PyArray1::from_vec(py, fit.held),
        PyArray1::from_vec(py, fit.not_identifiable),
        matrix(py, fit.combinations, p)?,
        matrix(py, fit.directions, p)?,
        matrix(py, fit.basis, fit.rank)?,
    ))
}
