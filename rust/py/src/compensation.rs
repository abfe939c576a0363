//! Compensation: volumetric error as an affine field a pose, its derivatives, corrected commands.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trunnion_core::artefact::Artefact;
use trunnion_core::compensation::Model;
use trunnion_core::compensation::inverse::Commands;
use trunnion_core::compensation::volumetric::{self, Affine, Control, ControlledPose, Volume};
use trunnion_core::effects;
use trunnion_core::machine::kinematics::AxisPositions;
use trunnion_core::machine::{MAX_ROTARY, Machine};
use trunnion_core::units::{ARCSEC, DEG, UM};
use trunnion_core::{Error, Result};

use crate::arrays::{array, finite, matrix, rows, vector};
use crate::errors::IntoPy;
use crate::threads::with_threads;
use crate::user_units::location_errors;

/// A machine with location errors, placement of the work and effects of the machine.
#[pyclass(frozen, module = "trunnion._core")]
pub struct MachineModel {
    inner: Model,
}

fn model(
    machine: Machine,
    errors: &[(String, f64)],
    placement: &[f64; 6],
    effects: &[(String, Vec<f64>)],
) -> Result<Model> {
    // Effects of the machine do not depend on what is touched.
    let any = Artefact::of("cross", &[2.0, 1.0, 1.0])?;
    let catalogue = effects::catalogue(&machine, &any);
    let ids: Vec<String> = effects.iter().map(|(id, _)| id.clone()).collect();
    let chosen = effects::select(&catalogue, &ids)?;
    let mut model = Model::nominal(machine);
    for (error, amount) in location_errors(model.machine(), errors)? {
        model.add_error(&error, amount)?;
    }
    let [x, y, z, a, b, c] = *placement;
    model.set_placement(&[x * UM, y * UM, z * UM, a * ARCSEC, b * ARCSEC, c * ARCSEC])?;
    for (effect, (_, values)) in chosen.into_iter().zip(effects) {
        let factors = effect.parameters.iter().map(|p| p.unit.to_internal());
        // Another number of values than parameters is refused below.
        let values: Vec<f64> =
            values.iter().zip(factors.chain(std::iter::repeat(1.0))).map(|(v, f)| v * f).collect();
        model.add_effect(effect, &values)?;
    }
    Ok(model)
}

impl MachineModel {
    fn axes(&self) -> usize {
        self.inner.machine().rotary().len()
    }

    /// Rows of rotary positions, rad.
    fn rotary(&self, rotary_deg: &PyReadonlyArray2<'_, f64>) -> PyResult<RotaryRows> {
        let rotary = rows("rotary positions", rotary_deg, self.axes())?;
        let values = rotary.iter().map(|angle| angle * DEG).collect();
        Ok(RotaryRows { values, axes: self.axes(), count: rotary_deg.as_array().nrows() })
    }

    /// Does `each` with machine and control at every row of rotary positions.
    fn at_poses<T>(
        &self,
        control: &Self,
        zeros_arcsec: &[f64],
        rotary: &RotaryRows,
        each: impl Fn(&ControlledPose) -> T,
    ) -> Result<Vec<T>> {
        let mut zeros = [0.0; MAX_ROTARY];
        for (slot, zero) in zeros.iter_mut().zip(zeros_arcsec) {
            *slot = zero * ARCSEC;
        }
        let control = Control { model: control.inner.clone(), zeros };
        let poses = (0..rotary.count).map(|row| rotary.row(row));
        poses.map(|angles| Ok(each(&ControlledPose::new(&self.inner, &control, angles)?))).collect()
    }
}

/// Rows of rotary positions, which are empty on a machine without rotary axes.
struct RotaryRows {
    values: Vec<f64>,
    axes: usize,
    count: usize,
}

impl RotaryRows {
    fn row(&self, row: usize) -> &[f64] {
        &self.values[self.axes * row..self.axes * (row + 1)]
    }
}

#[pymethods]
impl MachineModel {
    #[new]
    #[pyo3(signature = (machine, *, errors, placement, effects, direction, sense))]
    fn new(
        machine: &crate::machine::Machine,
        errors: Vec<(String, f64)>,
        #[pyo3(from_py_with = finite)] placement: [f64; 6],
        effects: Vec<(String, Vec<f64>)>,
        #[pyo3(from_py_with = finite)] direction: [f64; 3],
        #[pyo3(from_py_with = finite)] sense: Vec<f64>,
    ) -> PyResult<Self> {
        let machine = machine.inner.clone();
        let mut inner = model(machine, &errors, &placement, &effects).into_py()?;
        inner.approach(Vector3::from(direction), &sense);
        Ok(Self { inner })
    }

    #[getter]
    fn letters(&self) -> String {
        self.inner.machine().rotary().iter().map(trunnion_core::machine::Rotary::letter).collect()
    }

    #[getter]
    fn parameters(&self) -> Vec<(String, &'static str)> {
        self.inner.parameters().into_iter().map(|(name, unit)| (name, unit.symbol())).collect()
    }

    #[getter]
    fn control_parameters(&self) -> Vec<String> {
        volumetric::parameters(&self.inner)
    }

    /// Error field of each pose as (m, 12): gain | offset row by row, µm per mm and µm; and the
    /// direction error in arcsec.
    fn fields<'py>(
        &self,
        py: Python<'py>,
        control: &Self,
        #[pyo3(from_py_with = finite)] zeros_arcsec: Vec<f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)> {
        let rotary = self.rotary(&rotary_deg)?;
        let found = py.detach(|| {
            self.at_poses(control, &zeros_arcsec, &rotary, |pose| {
                (pose.error().rows(), pose.direction_error() / ARCSEC)
            })
        });
        let (fields, directions): (Vec<_>, Vec<_>) = found.into_py()?.into_iter().unzip();
        let fields = fields.into_iter().flatten().map(|value| value / UM).collect();
        Ok((matrix(py, fields, 12)?, array(py, directions)?))
    }

    /// Derivatives of the fields with respect to `parameters`, (m, 12 p), µm per user unit.
    fn truth_rates<'py>(
        &self,
        py: Python<'py>,
        control: &Self,
        #[pyo3(from_py_with = finite)] zeros_arcsec: Vec<f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rotary = self.rotary(&rotary_deg)?;
        let units: Vec<f64> =
            self.inner.parameters().iter().map(|(_, unit)| unit.to_internal() / UM).collect();
        let found = py.detach(|| {
            self.at_poses(control, &zeros_arcsec, &rotary, |pose| {
                scaled(&pose.truth_rates(), &units)
            })
        });
        matrix(py, found.into_py()?.concat(), 12 * units.len())
    }

    /// Derivatives of the fields with respect to `control_parameters`, (m, 12 q), µm per arcsec of
    /// a zero and per µm of the rest.
    fn control_rates<'py>(
        &self,
        py: Python<'py>,
        control: &Self,
        #[pyo3(from_py_with = finite)] zeros_arcsec: Vec<f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rotary = self.rotary(&rotary_deg)?;
        let count = volumetric::parameters(&self.inner).len();
        let mut units = vec![1.0; count];
        units[..self.axes()].fill(ARCSEC / UM);
        let found = py.detach(|| {
            self.at_poses(control, &zeros_arcsec, &rotary, |pose| {
                scaled(&pose.control_rates(), &units)
            })
        });
        matrix(py, found.into_py()?.concat(), 12 * count)
    }

    /// X, Y, Z that bring the tool point to points of the work at these rotary positions.
    fn linear_commands<'py>(
        &self,
        py: Python<'py>,
        points_mm: PyReadonlyArray2<'py, f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = rows("tool points", &points_mm, 3)?;
        let rotary = self.rotary(&rotary_deg)?;
        let solved = py.detach(|| {
            with_threads(threads, || -> Result<Vec<[f64; 3]>> {
                let poses = points.par_chunks_exact(3).zip(0..rotary.count);
                poses
                    .map(|(p, row)| {
                        let q = rotary.row(row);
                        let point = Vector3::new(p[0], p[1], p[2]);
                        self.inner.linear_commands(&point, q).map(Into::into)
                    })
                    .collect()
            })
        });
        matrix(py, solved?.into_py()?.concat(), 3)
    }

    /// Commands of all axes (n, 3 + axes), direction left in arcsec, whether singular.
    fn commands<'py>(
        &self,
        py: Python<'py>,
        points_mm: PyReadonlyArray2<'py, f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
        #[pyo3(from_py_with = finite)] largest_turn_deg: f64,
        threads: Option<usize>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)>
    {
        let points = rows("tool points", &points_mm, 3)?;
        let rotary = self.rotary(&rotary_deg)?;
        let axes = self.axes();
        let solved = py.detach(|| {
            with_threads(threads, || -> Result<Vec<Commands>> {
                let poses = points.par_chunks_exact(3).zip(0..rotary.count);
                poses
                    .map(|(p, row)| {
                        let q = rotary.row(row);
                        let point = Vector3::new(p[0], p[1], p[2]);
                        self.inner.commands(&point, q, largest_turn_deg * DEG)
                    })
                    .collect()
            })
        });
        let solved = solved?.into_py()?;
        let mut all = Vec::with_capacity(solved.len() * (3 + axes));
        for commands in &solved {
            all.extend(commands.positions.linear.iter());
            all.extend(commands.positions.rotary[..axes].iter().map(|angle| angle / DEG));
        }
        let left = solved.iter().map(|commands| commands.direction_left / ARCSEC).collect();
        let singular = solved.iter().map(|commands| commands.singular).collect();
        let singular = PyArray1::from_vec(py, singular);
        Ok((matrix(py, all, 3 + axes)?, array(py, left)?, singular))
    }

    /// Tool point and direction on the work for axis positions (n, 3 + axes): (n, 6).
    fn reached<'py>(
        &self,
        py: Python<'py>,
        axes_mm_deg: PyReadonlyArray2<'py, f64>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = 3 + self.axes();
        let axes = rows("axis positions", &axes_mm_deg, width)?;
        let reached = py.detach(|| {
            with_threads(threads, || {
                let tools = axes.par_chunks_exact(width).map(|row| {
                    let mut rotary = [0.0; MAX_ROTARY];
                    for (slot, angle) in rotary.iter_mut().zip(&row[3..]) {
                        *slot = angle * DEG;
                    }
                    let linear = Vector3::new(row[0], row[1], row[2]);
                    let tool = self.inner.reached(&AxisPositions { linear, rotary });
                    let (p, d) = (tool.point, tool.direction);
                    [p.x, p.y, p.z, d.x, d.y, d.z]
                });
                tools.collect::<Vec<_>>()
            })
        });
        matrix(py, reached?.concat(), 6)
    }
}

fn scaled(rates: &[Affine], units: &[f64]) -> Vec<f64> {
    let pairs = rates.iter().zip(units);
    pairs.flat_map(|(rate, unit)| rate.rows().map(|value| value * unit)).collect()
}

fn one_field(field: &[f64]) -> Result<Affine> {
    let rows = <&[f64; 12]>::try_from(field)
        .map_err(|_| Error::input("field", format!("{} numbers", field.len()), "12"))?;
    Ok(Affine::from_rows(rows))
}

/// Largest length in the box and mean square over the grid x × y × z of each field (m, 12).
#[pyfunction]
pub fn field_statistics<'py>(
    py: Python<'py>,
    fields: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] grid: [Vec<f64>; 3],
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let fields = rows("fields", &fields, 12)?;
    let found = py.detach(|| -> Result<(Vec<f64>, Vec<f64>)> {
        let volume = Volume::new([&grid[0], &grid[1], &grid[2]]);
        let each = fields.chunks_exact(12).map(|field| {
            let field = one_field(field)?;
            Ok((volume.largest(&field), volume.mean_square(&field)))
        });
        each.collect()
    });
    let (largest, squares) = found.into_py()?;
    Ok((array(py, largest)?, array(py, squares)?))
}

/// A field (12,) at points (n, 3).
#[pyfunction]
pub fn field_at<'py>(
    py: Python<'py>,
    field: PyReadonlyArray1<'py, f64>,
    points_mm: PyReadonlyArray2<'py, f64>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let field = one_field(&vector("field", &field)?).into_py()?;
    let points = rows("points", &points_mm, 3)?;
    let values = py.detach(|| {
        with_threads(threads, || {
            let mut values = vec![0.0; points.len()];
            field.at_points(&points, &mut values);
            values
        })
    });
    matrix(py, values?, 3)
}

/// A field (12,) on the grid x × y × z, z fastest: (n, 3).
#[pyfunction]
pub fn field_on_grid<'py>(
    py: Python<'py>,
    field: PyReadonlyArray1<'py, f64>,
    #[pyo3(from_py_with = finite)] grid: [Vec<f64>; 3],
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let field = one_field(&vector("field", &field)?).into_py()?;
    let [x, y, z] = grid;
    let values = py.detach(|| {
        with_threads(threads, || {
            let mut values = vec![0.0; 3 * x.len() * y.len() * z.len()];
            field.on_grid(&x, &y, &z, &mut values);
            values
        })
    });
    matrix(py, values?, 3)
}
