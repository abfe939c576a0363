//! Linear least squares of [`trunnion_core::linear`], what blocks gain of [`trunnion_core::beside`].

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::{beside, by_value, linear};

use crate::arrays::{array, finite, matrix, matrix_of, rows, vector};
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
        matrix_of(py, fit.basis, values.len(), if basis { fit.rank } else { 0 })?,
    ))
}

/// Gains (b, s) of blocks of k columns beside a basis, and how many columns each adds (b,): by the
/// inner products of the columns of each block with each other (b k, k), with the basis (b k, q), and
/// with residuals (b k, s).
#[pyfunction]
pub fn gains_of_blocks<'py>(
    py: Python<'py>,
    gram: PyReadonlyArray2<'py, f64>,
    basis: PyReadonlyArray2<'py, f64>,
    residuals: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] dependent: f64,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<usize>>)> {
    let [width, q, s] = [&gram, &basis, &residuals].map(|given| given.as_array().ncols());
    let gram = rows("products with each other", &gram, width)?;
    let basis = rows("products with the basis", &basis, q)?;
    let residuals = rows("products with residuals", &residuals, s)?;
    let blocks =
        beside::Beside { width, gram: &gram, basis: &basis, residuals: &residuals, dependent };
    let (gains, ranks) = blocks.gains(q, s).into_py()?;
    Ok((matrix_of(py, gains, ranks.len(), s)?, PyArray1::from_vec(py, ranks)))
}

/// Sums over the readings of each of `count` values, of each of c weights (c, n) times each of s
/// columns (n, s): (count, c s). `values`: number of the value of each reading, of v quantities
/// (v, n); negative: none.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "pyo3 extracts owned values")]
pub fn sums_by_value<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, i64>,
    count: usize,
    weights: PyReadonlyArray2<'py, f64>,
    columns: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n, s) = columns.as_array().dim();
    let each = weights.as_array().nrows();
    let weights = rows("weights of readings", &weights, n)?;
    let columns = rows("columns of readings", &columns, s)?;
    let values: Vec<i64> = values.as_array().iter().copied().collect();
    let by = by_value::ByValue { values: &values, readings: n, count };
    let sums = by.sums(&weights, &columns).into_py()?;
    matrix_of(py, sums, count, each * s)
}

/// Which local errors, by their places and widths (m, 2), have several of the distinct `values` (d,)
/// of a quantity in them, and some on each side (m,).
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "pyo3 extracts owned values")]
pub fn local_errors_inside<'py>(
    py: Python<'py>,
    values: PyReadonlyArray1<'py, f64>,
    errors: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] period: Option<f64>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let values = vector("values", &values)?;
    let errors = rows("places and widths", &errors, 2)?;
    let errors: Vec<(f64, f64)> = errors.chunks_exact(2).map(|one| (one[0], one[1])).collect();
    Ok(PyArray1::from_vec(py, by_value::inside(&values, &errors, period)))
}
