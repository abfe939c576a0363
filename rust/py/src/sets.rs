//! Sets of causes of [`trunnion_core::sets`], their sizes of [`trunnion_core::sizes`].

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::{sets, sizes};

use crate::arrays::{array, finite, matrix_of, of_width, rows, vector, vector_with_limits};
use crate::errors::IntoPy;

/// A set of blocks.
#[pyclass(frozen, module = "trunnion._core")]
pub struct CauseSet {
    inner: sets::Set,
}

#[pymethods]
impl CauseSet {
    /// Sum of squares that it leaves.
    #[getter]
    const fn rss(&self) -> f64 {
        self.inner.rss()
    }

    /// Sum of its penalties.
    #[getter]
    const fn penalty(&self) -> f64 {
        self.inner.penalty
    }

    /// Count of its columns.
    #[getter]
    const fn columns(&self) -> usize {
        self.inner.columns()
    }

    /// Inner products of its basis with all columns (k, m), and of all with what it leaves (m,).
    fn products<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)> {
        let residual = self.inner.residual();
        let (k, m) = (self.inner.columns(), residual.len());
        let taken = matrix_of(
            py,
            self.inner.taken().iter().flat_map(|own| own.products.iter().copied()).collect(),
            k,
            m,
        )?;
        Ok((taken, array(py, residual)?))
    }
}

/// The blocks of all candidates, and what their sets cost.
#[pyclass(frozen, module = "trunnion._core")]
pub struct CauseBlocks {
    inner: sets::Blocks,
    score: sets::Score,
}

#[pymethods]
impl CauseBlocks {
    #[new]
    #[pyo3(signature = (
        *, width, start, rank, candidate, penalty, positive, dependent, degrees_of_freedom, floor, least
    ))]
    fn new(
        width: usize,
        start: Vec<usize>,
        rank: Vec<usize>,
        candidate: Vec<usize>,
        penalty: PyReadonlyArray1<'_, f64>,
        positive: Vec<bool>,
        #[pyo3(from_py_with = finite)] dependent: f64,
        degrees_of_freedom: usize,
        #[pyo3(from_py_with = finite)] floor: f64,
        #[pyo3(from_py_with = finite)] least: f64,
    ) -> PyResult<Self> {
        let penalty = vector_with_limits("penalties", &penalty)?;
        let inner = sets::Blocks::new(width, start, rank, candidate, penalty, positive, dependent)
            .into_py()?;
        Ok(Self { inner, score: sets::Score { degrees_of_freedom, floor, least } })
    }

    /// The empty set, by the inner products of all columns with the residuals (m,).
    fn empty(
        &self,
        residual: PyReadonlyArray1<'_, f64>,
        #[pyo3(from_py_with = finite)] rss: f64,
    ) -> PyResult<CauseSet> {
        let residual = vector("products with the residuals", &residual)?;
        Ok(CauseSet { inner: self.inner.empty(residual, rss).into_py()? })
    }

    /// A set and one more block, by the inner products of its columns with all (k, m).
    fn extended(
        &self,
        before: &CauseSet,
        block: usize,
        products: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<CauseSet> {
        let products = rows("products with a block", &products, self.inner.width)?;
        let inner = self.inner.extended(&before.inner, block, &products).into_py()?;
        Ok(CauseSet { inner })
    }

    /// What some blocks leave of the empty set's sum of squares, and the drop of it by each of the
    /// blocks from `first` to before `end` (b,). `blocks`: each with the inner products of its columns
    /// with all (k, m).
    #[allow(clippy::needless_pass_by_value, reason = "pyo3 extracts owned values")]
    fn gains_beside<'py>(
        &self,
        py: Python<'py>,
        empty: &CauseSet,
        blocks: Vec<(usize, PyReadonlyArray2<'py, f64>)>,
        first: usize,
        end: usize,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        let products = blocks
            .iter()
            .map(|(block, x)| Ok((*block, of_width("products with a block", x, self.inner.width)?)))
            .collect::<PyResult<Vec<_>>>()?;
        let beside: Vec<(usize, &[f64])> = products.iter().map(|(b, x)| (*b, &x[..])).collect();
        let (rss, gains) = self.inner.gains_beside(&empty.inner, &beside, first..end).into_py()?;
        Ok((rss, array(py, gains)?))
    }

    /// Every candidate beside every set, at its best block, best first: score, number of the set,
    /// block, sum of squares, count of columns. All as far as `reach` above the best, and `best`; so
    /// `many` at least.
    fn tried(
        &self,
        py: Python<'_>,
        sets: Vec<PyRef<'_, CauseSet>>,
        best: f64,
        #[pyo3(from_py_with = finite)] reach: f64,
        many: usize,
    ) -> PyResult<Vec<(f64, usize, usize, f64, usize)>> {
        let sets: Vec<&sets::Set> = sets.iter().map(|set| &set.inner).collect();
        let found = py.detach(|| self.inner.tried(&sets, &self.score, (best, reach, many)));
        let found = found.into_py()?.into_iter();
        Ok(found.map(|one| (one.score, one.set, one.block, one.rss, one.columns)).collect())
    }
}

/// Sizes of sets of blocks (s), each as the numbers of its blocks: drop of the sum of squares (s,),
/// logarithms of the determinants of the covariances of the sizes of their `counted` blocks (s,), and
/// of each block of each set by itself, with the length of its sizes, set after set. `rank`, `counted`:
/// of each block; `gram`, `residual`: inner products of their columns with each other (k, k) and with
/// the residuals (k,).
#[pyfunction]
#[pyo3(signature = (sets, *, rank, counted, gram, residual, dependent))]
#[allow(clippy::needless_pass_by_value, reason = "pyo3 extracts owned values")]
pub fn sizes_of_sets<'py>(
    py: Python<'py>,
    sets: Vec<Vec<usize>>,
    rank: Vec<usize>,
    counted: Vec<bool>,
    gram: PyReadonlyArray2<'py, f64>,
    residual: PyReadonlyArray1<'py, f64>,
    #[pyo3(from_py_with = finite)] dependent: f64,
) -> PyResult<(
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
)> {
    let residual = vector("products with the residuals", &residual)?;
    let gram = rows("products with each other", &gram, residual.len())?;
    let products = sizes::Products { rank: &rank, gram: &gram, residual: &residual, dependent };
    let found = products.sizes(&sets, &counted).into_py()?;
    Ok((
        array(py, found.gain)?,
        array(py, found.together)?,
        array(py, found.each)?,
        array(py, found.length)?,
    ))
}
