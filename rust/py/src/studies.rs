//! Studies: many virtual measurements of one plan.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use trunnion_core::compensation::volumetric::Volume;
use trunnion_core::identification::{closed_form, least_squares};
use trunnion_core::studies::{self, Measurement, Method};
use trunnion_core::touch::Simulation;
use trunnion_core::units::{DEG, UM};

use crate::arrays::{finite, matrix_with_gaps, rows};
use crate::errors::IntoPy;
use crate::names::choice;
use crate::threads::in_pieces;
use crate::touch::{Moves, TouchModel, simulation};

/// One row a sample, and the samples that failed, whose rows are not numbers.
type Samples<'py> = (Bound<'py, PyArray2<f64>>, Vec<(usize, String)>);

/// Virtual measurements of one plan by one probe: what all samples share.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Measurements {
    model: Py<TouchModel>,
    moves: Py<Moves>,
    labels: Vec<i64>,
    simulation: Simulation,
}

#[pymethods]
impl Measurements {
    #[new]
    #[pyo3(signature = (model, moves, labels, *, reach_mm, noise_um, seed))]
    fn new(
        model: Py<TouchModel>,
        moves: Py<Moves>,
        labels: Vec<i64>,
        #[pyo3(from_py_with = finite)] reach_mm: f64,
        #[pyo3(from_py_with = finite)] noise_um: f64,
        seed: u64,
    ) -> Self {
        Self { model, moves, labels, simulation: simulation(true, reach_mm, noise_um, seed) }
    }

    /// For every row of `truths` (m, 14) the plan is simulated, both closed forms are taken, and with
    /// `identify` least squares. A row holds 14 separating, 8 printed, then 14 identified, 14 standard
    /// errors, converged.
    #[pyo3(signature = (truths, *, first_sample, identify, threads))]
    fn calibrations<'py>(
        &self,
        py: Python<'py>,
        truths: PyReadonlyArray2<'py, f64>,
        first_sample: u64,
        identify: bool,
        threads: Option<usize>,
    ) -> PyResult<Samples<'py>> {
        let options = identify.then(least_squares::Options::default);
        let found = self.run(py, &truths, first_sample, threads, |measurement, truths| {
            studies::calibrations(measurement, truths, options.as_ref())
        })?;
        let (all, errors) = (closed_form::COUNT, closed_form::ERRORS);
        let runs = if identify { vec![all, errors, all, all] } else { vec![all, errors] };
        samples(py, self.model.get().units.calibrations(found, &runs))
    }

    /// What compensation leaves: for every row of `truths` (m, 14) the plan is simulated, the location
    /// errors are estimated by `method` ("separating", "printed", "identified"), and the volumetric
    /// error over the grid x × y × z with the rotary axes at `rotary_deg` is taken under a control
    /// that assumes the nominal machine and under one that assumes the estimates. A row holds largest
    /// and root mean square before, largest and root mean square left, µm.
    #[pyo3(signature = (truths, *, first_sample, method, grid, rotary_deg, threads))]
    fn compensations<'py>(
        &self,
        py: Python<'py>,
        truths: PyReadonlyArray2<'py, f64>,
        first_sample: u64,
        method: &str,
        #[pyo3(from_py_with = finite)] grid: [Vec<f64>; 3],
        #[pyo3(from_py_with = finite)] rotary_deg: Vec<f64>,
        threads: Option<usize>,
    ) -> PyResult<Samples<'py>> {
        let methods = [
            ("separating", Method::Separating),
            ("printed", Method::Printed),
            ("identified", Method::Identified),
        ];
        let method = choice("method", method, &methods).into_py()?;
        let volume = Volume::new([&grid[0], &grid[1], &grid[2]]);
        let rotary: Vec<f64> = rotary_deg.iter().map(|angle| angle * DEG).collect();
        let mut found = self.run(py, &truths, first_sample, threads, |measurement, truths| {
            studies::compensations(measurement, truths, method, &volume, &rotary)
        })?;
        found.rows.iter_mut().for_each(|value| *value /= UM);
        samples(py, found)
    }
}

impl Measurements {
    fn run(
        &self,
        py: Python<'_>,
        truths: &PyReadonlyArray2<'_, f64>,
        first_sample: u64,
        threads: Option<usize>,
        study: impl Fn(&Measurement, &[f64]) -> trunnion_core::Result<studies::Samples> + Send + Sync,
    ) -> PyResult<studies::Samples> {
        let TouchModel { inner: model, units } = self.model.get();
        let truths = units.to_core(&rows("true parameters", truths, model.parameter_count())?);
        let moves = &self.moves.get().inner.view();
        let (labels, simulation) = (self.labels.as_slice(), self.simulation);
        let width = model.parameter_count();
        let pieces = in_pieces(py, threads, (truths.len() / width, PIECE), |first, count| {
            let first_sample = first_sample + first as u64;
            let measurement = Measurement { model, moves, labels, simulation, first_sample };
            study(&measurement, &truths[first * width..(first + count) * width])
        })?;
        joined(pieces).into_py()
    }
}

/// Samples between two looks for Ctrl-C: a tenth of a second or so on one core.
const PIECE: usize = 500;

fn joined(
    pieces: Vec<trunnion_core::Result<studies::Samples>>,
) -> trunnion_core::Result<studies::Samples> {
    let mut all = studies::Samples { rows: Vec::new(), width: 1, failures: Vec::new() };
    for (number, piece) in pieces.into_iter().enumerate() {
        let piece = piece?;
        all.width = piece.width;
        all.rows.extend(piece.rows);
        let failed = piece.failures.into_iter();
        all.failures.extend(failed.map(|(index, error)| (number * PIECE + index, error)));
    }
    Ok(all)
}

fn samples(py: Python<'_>, found: studies::Samples) -> PyResult<Samples<'_>> {
    let failures = found.failures.iter().map(|(index, error)| (*index, error.to_string()));
    let failures = failures.collect();
    Ok((matrix_with_gaps(py, found.rows, found.width)?, failures))
}
