//! Machines: location errors and kinematics.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trunnion_core::machine::batch::{ForwardBatch, TOOL};
use trunnion_core::machine::kinematics::{AxisPositions, MAX_AXES, Tool};
use trunnion_core::machine::{self, MAX_ROTARY, Places};
use trunnion_core::units::{DEG, UM, Unit};
use trunnion_core::{Error, Result};

use crate::arrays::{each_row, matrix, rows, vector};
use crate::errors::IntoPy;
use crate::user_units::places;

/// Poses that one thread takes at a time.
const CHUNK: usize = 8192;

/// A machine: X, Y, Z and rotary axes, nominal or with location errors.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Machine {
    pub inner: machine::Machine,
    pub places: Places,
}

fn positions(row: &[f64]) -> AxisPositions {
    let mut rotary = [0.0; MAX_ROTARY];
    for (slot, value) in rotary.iter_mut().zip(&row[3..]) {
        *slot = value * DEG;
    }
    AxisPositions { linear: Vector3::new(row[0], row[1], row[2]), rotary }
}

fn tool(row: &[f64]) -> Tool {
    Tool {
        point: Vector3::new(row[0], row[1], row[2]),
        direction: Vector3::new(row[3], row[4], row[5]),
    }
}

/// Prefixes the row to what a pose cannot do.
fn at_row(row: usize) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Kinematics(message) => Error::Kinematics(format!("row {row}: {message}")),
        Error::Input { what, got, expected } => {
            Error::Input { what: format!("row {row}: {what}"), got, expected }
        }
        other => other,
    }
}

#[pymethods]
impl Machine {
    #[new]
    #[pyo3(signature = (
        chain, tool_length_mm, errors, *, directions=Vec::new(), points_mm=Vec::new(),
        table_normal=[0.0, 0.0, 1.0]
    ))]
    fn new(
        chain: &str,
        tool_length_mm: f64,
        errors: Vec<(String, f64)>,
        directions: Vec<(char, [f64; 3])>,
        points_mm: Vec<(char, [f64; 3])>,
        table_normal: [f64; 3],
    ) -> PyResult<Self> {
        let mut letters: Vec<char> =
            directions.iter().chain(&points_mm).map(|(letter, _)| *letter).collect();
        letters.sort_unstable();
        letters.dedup();
        let of = |values: &[(char, [f64; 3])], letter: char| {
            values.iter().find(|(other, _)| *other == letter).map(|(_, value)| *value)
        };
        let lines = letters.into_iter().map(|letter| {
            let (direction, point) = (of(&directions, letter), of(&points_mm, letter));
            (letter, machine::Line { direction, point })
        });
        let lines: Vec<_> = lines.collect();
        let inner = machine::Machine::new(chain, tool_length_mm, &lines).into_py()?;
        let inner = inner.topped(table_normal).into_py()?;
        let places = places(&inner, &errors).into_py()?;
        Ok(Self { inner, places })
    }

    #[getter]
    fn chain(&self) -> &str {
        self.inner.code()
    }

    #[getter]
    fn letters(&self) -> String {
        self.inner.rotary().iter().map(machine::Rotary::letter).collect()
    }

    /// "table" or "head" for each rotary axis.
    #[getter]
    fn sides(&self) -> Vec<&'static str> {
        let side = |axis: &machine::Rotary| match axis.side {
            machine::Side::Workpiece => "table",
            machine::Side::Tool => "head",
        };
        self.inner.rotary().iter().map(side).collect()
    }

    /// Letters of the axis that turns the workpiece against the tool and of the one that tilts it.
    #[getter]
    fn roles(&self) -> (Option<char>, Option<char>) {
        let letter = |axis: usize| self.inner.rotary()[axis].letter();
        (self.inner.turning_axis().map(letter), self.inner.tilting_axis().map(letter))
    }

    /// Position of the tilting axis at which the table top looks to the spindle, degrees.
    #[getter]
    fn level_deg(&self) -> f64 {
        self.inner.level() / DEG
    }

    #[getter]
    fn location_errors(&self) -> Vec<(String, &'static str)> {
        let errors = self.inner.location_errors();
        errors.iter().map(|error| (error.name(), error.unit().symbol())).collect()
    }

    /// Components that are no location errors, and why.
    #[getter]
    fn redundant_errors(&self) -> Vec<(String, String)> {
        self.inner.redundant_errors()
    }

    /// Points (n, 3) less tool points for axis positions (n, 3 + axes), along the machine's X, Y and
    /// Z, µm: (n, 3).
    fn apart<'py>(
        &self,
        py: Python<'py>,
        axes: PyReadonlyArray2<'py, f64>,
        points_mm: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = 3 + self.inner.rotary().len();
        let axes = rows("axis positions", &axes, width)?;
        let points = rows("points", &points_mm, 3)?;
        if axes.len() / width != points.len() / 3 {
            let expected = format!("{} of them", axes.len() / width);
            return Err(Error::input("points", points.len() / 3, expected)).into_py();
        }
        let apart = py.detach(|| {
            let forward = ForwardBatch::new(&self.inner, &self.places);
            let mut apart = vec![0.0; points.len()];
            forward.apart(&axes, &points, &mut apart);
            apart.iter_mut().for_each(|value| *value /= UM);
            apart
        });
        matrix(py, apart, 3)
    }

    fn forward<'py>(
        &self,
        py: Python<'py>,
        axes: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = 3 + self.inner.rotary().len();
        let axes = rows("axis positions", &axes, width)?;
        let tools = py.detach(|| {
            let forward = ForwardBatch::new(&self.inner, &self.places);
            let mut tools = vec![0.0; axes.len() / width * TOOL];
            let chunks = tools.par_chunks_mut(TOOL * CHUNK).zip(axes.par_chunks(width * CHUNK));
            chunks.for_each(|(tools, axes)| forward.tools(axes, tools));
            tools
        });
        matrix(py, tools, TOOL)
    }

    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        axes: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = 3 + self.inner.rotary().len();
        let axes = rows("axis positions", &axes, width)?;
        let all = py.detach(|| {
            let mut all = Vec::with_capacity(axes.len() * 6);
            for row in axes.chunks_exact(width) {
                let (_, jacobian) = self.inner.forward_jacobian(&positions(row), &self.places);
                for i in 0..6 {
                    let scale = |k: usize| if k < 3 { 1.0 } else { Unit::Deg.to_internal() };
                    all.extend((0..width).map(|k| jacobian[(i, k)] * scale(k)));
                }
            }
            all
        });
        debug_assert!(width <= MAX_AXES);
        matrix(py, all, 6 * width)
    }

    /// Both branches of the nominal machine, row-major (n, 2 × axes), and whether singular.
    fn inverse<'py>(
        &self,
        py: Python<'py>,
        tools: PyReadonlyArray2<'py, f64>,
        reference_deg: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>)> {
        let tools = rows("tool points and directions", &tools, 6)?;
        let reference: Vec<f64> =
            vector("reference_deg", &reference_deg)?.iter().map(|v| v * DEG).collect();
        let width = 3 + self.inner.rotary().len();
        let solved = py.detach(|| -> Result<(Vec<f64>, Vec<bool>)> {
            let mut all = Vec::with_capacity(tools.len() / 6 * 2 * width);
            let mut singular = Vec::with_capacity(tools.len() / 6);
            for (i, row) in tools.chunks_exact(6).enumerate() {
                let branches = self.inner.inverse(&tool(row), &reference).map_err(at_row(i))?;
                for branch in branches.positions {
                    all.extend(branch.linear.iter());
                    all.extend(branch.rotary[..width - 3].iter().map(|angle| angle / DEG));
                }
                singular.push(branches.singular);
            }
            Ok((all, singular))
        });
        let (all, singular) = solved.into_py()?;
        Ok((matrix(py, all, 2 * width)?, PyArray1::from_vec(py, singular)))
    }

    /// Axis positions that reach the tool poses on the machine with its errors, from starts nearby.
    fn inverse_exact<'py>(
        &self,
        py: Python<'py>,
        tools: PyReadonlyArray2<'py, f64>,
        starts: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = 3 + self.inner.rotary().len();
        let tools = rows("tool points and directions", &tools, 6)?;
        let starts = rows("start positions", &starts, width)?;
        let solved = py.detach(|| -> Result<Vec<f64>> {
            let mut all = Vec::with_capacity(starts.len());
            let pairs = tools.chunks_exact(6).zip(starts.chunks_exact(width));
            for (i, (row, start)) in pairs.enumerate() {
                let reached =
                    self.inner.inverse_with_errors(&tool(row), &positions(start), &self.places);
                let reached = reached.map_err(at_row(i))?;
                all.extend(reached.linear.iter());
                all.extend(reached.rotary[..width - 3].iter().map(|angle| angle / DEG));
            }
            Ok(all)
        });
        matrix(py, solved.into_py()?, width)
    }

    /// X, Y, Z that bring the tool points to their place at these rotary positions.
    fn linear_axes_for<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = rows("tool points", &points, 3)?;
        let axes = self.inner.rotary().len();
        let rotary = rows("rotary positions", &rotary_deg, axes)?;
        let solved = py.detach(|| -> Result<Vec<f64>> {
            let mut all = Vec::with_capacity(points.len());
            for (i, (point, angles)) in
                points.chunks_exact(3).zip(each_row(&rotary, axes, points.len() / 3)).enumerate()
            {
                let angles: Vec<f64> = angles.iter().map(|angle| angle * DEG).collect();
                let point = Vector3::new(point[0], point[1], point[2]);
                let linear = self.inner.linear_axes_for(&point, &angles, &self.places);
                all.extend(linear.map_err(at_row(i))?.iter());
            }
            Ok(all)
        });
        matrix(py, solved.into_py()?, 3)
    }

    /// Pose of the table, machine from table: row-major 3 × 4 (R | t in mm), one row a pose.
    fn table_pose<'py>(
        &self,
        py: Python<'py>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let axes = self.inner.rotary().len();
        let rotary = rows("rotary positions", &rotary_deg, axes)?;
        let count = rotary_deg.as_array().nrows();
        let mut all = Vec::with_capacity(count * 12);
        for angles in each_row(&rotary, axes, count) {
            let angles: Vec<f64> = angles.iter().map(|angle| angle * DEG).collect();
            let posture = machine::Posture::new(&self.inner, &angles, &self.places);
            for i in 0..3 {
                all.extend(posture.table.rotation.row(i).iter());
                all.push(posture.table.translation[i]);
            }
        }
        matrix(py, all, 12)
    }
}
