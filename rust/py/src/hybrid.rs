//! The hybrid parallel machine.

use nalgebra::Vector3;
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::hybrid::batch::{Batch, FORWARD_COLUMNS, SENSITIVITY_ROWS};
use trunnion_core::hybrid::constraint::{LOOP_EQUATIONS, LOOP_JOINTS, loop_jacobian};
use trunnion_core::hybrid::{ACTIVE, Closure, Constraint, ERRORS, Geometry, Mechanism, Parameter};
use trunnion_core::units::DEG;
use trunnion_core::{Error, Result};

use crate::arrays::{finite, matrix, rows};
use crate::errors::{IntoPy, to_py};
use crate::threads::with_threads;
use crate::user_units::hybrid as units;

/// A hybrid mechanism with errors and closure weights, asked about batches of poses.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Hybrid {
    mechanism: Mechanism,
    geometry: Geometry,
    closure: Closure,
}

fn parameters(names: &[String]) -> Result<Vec<Parameter>> {
    names.iter().map(|name| Parameter::parse(name)).collect()
}

/// Names of the 17 parameters of the paper and of every component at every place, with units.
#[pyfunction]
pub fn hybrid_parameters() -> (Vec<String>, Vec<String>) {
    let paper = Parameter::paper().iter().map(|p| p.name()).collect();
    (paper, Parameter::outside().map(Parameter::name).collect())
}

/// The name with unit that a spelling stands for.
#[pyfunction]
pub fn hybrid_parameter(name: &str) -> PyResult<String> {
    Parameter::parse(name).map(Parameter::name).into_py()
}

/// Nominal e1 to e17 of the example, mm and rad (e16 and e17 are zero).
#[pyfunction]
pub fn hybrid_example() -> Vec<f64> {
    Mechanism::example_dimensions().to_vec()
}

impl Hybrid {
    fn run<'py>(
        &self,
        py: Python<'py>,
        threads: Option<usize>,
        columns: usize,
        work: impl FnOnce(&Batch<'_>) -> Result<Vec<f64>> + Send,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let batch = Batch {
            mechanism: &self.mechanism,
            geometry: self.geometry.clone(),
            closure: self.closure,
        };
        let values = py.detach(|| with_threads(threads, || work(&batch)))?.into_py()?;
        matrix(py, values, columns)
    }
}

#[pymethods]
impl Hybrid {
    #[new]
    fn new(
        #[pyo3(from_py_with = finite)] dimensions: [f64; ERRORS],
        #[pyo3(from_py_with = finite)] home_mm: [f64; 3],
        errors: Vec<(String, f64)>,
        #[pyo3(from_py_with = finite)] closure_mm: [f64; 4],
    ) -> PyResult<Self> {
        let inside = units::dimensions(dimensions);
        let mechanism = Mechanism::new(inside, Vector3::from(home_mm)).into_py()?;
        let closure = Closure::new(closure_mm).into_py()?;
        let geometry = mechanism.with(&units::errors(&errors).into_py()?);
        Ok(Self { mechanism, geometry, closure })
    }

    #[getter]
    fn home_legs_mm(&self) -> [f64; 3] {
        *self.mechanism.home_legs()
    }

    fn forward<'py>(
        &self,
        py: Python<'py>,
        joints: PyReadonlyArray2<'py, f64>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let joints = units::joints(&rows("joints", &joints, ACTIVE)?);
        self.run(py, threads, FORWARD_COLUMNS, |batch| Ok(units::forward(batch.forward(&joints)?)))
    }

    fn sensitivity<'py>(
        &self,
        py: Python<'py>,
        joints: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let joints = units::joints(&rows("joints", &joints, ACTIVE)?);
        let parameters = parameters(&names).into_py()?;
        let columns = FORWARD_COLUMNS + SENSITIVITY_ROWS * parameters.len();
        self.run(py, threads, columns, |batch| {
            Ok(units::sensitivity(batch.sensitivity(&joints, &parameters)?, &parameters))
        })
    }

    fn strain<'py>(
        &self,
        py: Python<'py>,
        joints: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let joints = units::joints(&rows("joints", &joints, ACTIVE)?);
        let parameters = parameters(&names).into_py()?;
        let columns = 10 * parameters.len();
        self.run(py, threads, columns, |batch| {
            Ok(units::strain(batch.strain(&joints, &parameters)?, &parameters))
        })
    }

    fn ballbar<'py>(
        &self,
        py: Python<'py>,
        joints: PyReadonlyArray2<'py, f64>,
        centres: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let joints = units::joints(&rows("joints", &joints, ACTIVE)?);
        let centres = rows("ball centres", &centres, 3)?;
        let parameters = parameters(&names).into_py()?;
        let columns = 4 + parameters.len();
        self.run(py, threads, columns, |batch| {
            Ok(units::ballbar(batch.ballbar(&joints, &centres, &parameters)?, &parameters))
        })
    }

    #[pyo3(signature = (tips, directions, *, reference_deg, negative, exact, threads))]
    fn inverse<'py>(
        &self,
        py: Python<'py>,
        tips: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        #[pyo3(from_py_with = finite)] reference_deg: f64,
        negative: bool,
        exact: bool,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let tips = rows("tool points", &tips, 3)?;
        let directions = rows("tool directions", &directions, 3)?;
        self.run(py, threads, ACTIVE + 1, |batch| {
            let reference = reference_deg * DEG;
            let rows = batch.inverse(&tips, &directions, reference, negative, exact)?;
            Ok(units::commands(rows))
        })
    }

    /// Rank, singular values, self-stress (states × 12: force and moment of loop 1, of loop 3) and
    /// the 12 × 13 Jacobian at one pose.
    fn constraint<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = finite)] joints: [f64; ACTIVE],
    ) -> PyResult<(usize, Vec<f64>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let [l1, l2, l3, q4, q5] = joints;
        let joints = [l1, l2, l3, q4 * DEG, q5 * DEG];
        let solution = self
            .mechanism
            .solve(&self.geometry, &joints, &self.closure)
            .map_err(|error: Error| to_py(&error))?;
        let constraint = Constraint::at(&solution);
        let stress: Vec<f64> = constraint
            .self_stress
            .iter()
            .flatten()
            .flat_map(|w| [w.force, w.moment])
            .flatten()
            .collect();
        let jacobian = loop_jacobian(&solution.posture);
        let by_row: Vec<f64> = jacobian.transpose().iter().copied().collect();
        Ok((
            constraint.rank,
            constraint.singular_values.to_vec(),
            matrix(py, stress, LOOP_EQUATIONS)?,
            matrix(py, by_row, LOOP_JOINTS)?,
        ))
    }
}
