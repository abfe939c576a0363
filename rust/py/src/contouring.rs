//! Five-axis contouring.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::contouring::margins::{axis_margins, coupled_gain_margin, pole_radius};
use trunnion_core::contouring::{
    Axis, Case, Coupling, Feedback, Gains, Order, OrientationModel, Path, Piece, PositionModel,
    Reference, Simulation, responses, samples, sweep,
};
use trunnion_core::machine::FiveAxis;

use crate::arrays::{array, finite, matrix, rows, rows_with_limits, vector, vector_with_limits};
use crate::errors::{IntoPy, to_py};
use crate::machine::Machine;
use crate::names::choice;
use crate::threads::in_pieces;
use crate::user_units::contouring::{
    AXIS_FIELDS, FIGURES, axis, columns, feed, figures, position_unit,
};

/// Contour-error model, orientation-error model, gains (5, 3), order.
type CouplingArgs<'py> = (String, String, PyReadonlyArray2<'py, f64>, String);
/// Feed mm/min, acceleration time s, decelerate, normal acceleration mm/s², dwell s.
type FeedArgs = (f64, f64, bool, f64, f64);

fn six(row: &[f64]) -> [f64; 6] {
    let mut out = [0.0; 6];
    out.copy_from_slice(row);
    out
}

/// A chain of pieces: polynomial plus harmonic, with its arc length.
#[pyclass(frozen, module = "trunnion._core")]
pub struct ContourPath(Path);

#[pymethods]
impl ContourPath {
    #[new]
    fn new(
        breaks: PyReadonlyArray1<'_, f64>,
        coefficients: PyReadonlyArray2<'_, f64>,
        omega: PyReadonlyArray1<'_, f64>,
        cosine: PyReadonlyArray2<'_, f64>,
        sine: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let breaks = vector("breaks", &breaks)?;
        let pieces = breaks.len().saturating_sub(1);
        let coefficients = rows("coefficients", &coefficients, 6)?;
        let (omega, cosine, sine) =
            (vector("omega", &omega)?, rows("cosine", &cosine, 6)?, rows("sine", &sine, 6)?);
        let per_piece = (coefficients.len() / 6).checked_div(pieces).unwrap_or(0);
        let sizes = [coefficients.len(), omega.len() * 6, cosine.len(), sine.len()];
        if sizes != [6 * pieces * per_piece, 6 * pieces, 6 * pieces, 6 * pieces] {
            let got = format!("numbers of values {sizes:?}");
            let expected = format!("as many rows for each of {pieces} pieces");
            return Err(to_py(&Error::input("path", got, expected)));
        }
        let pieces = (0..pieces)
            .map(|i| Piece {
                start: breaks[i],
                end: breaks[i + 1],
                coefficients: coefficients[6 * per_piece * i..6 * per_piece * (i + 1)]
                    .chunks_exact(6)
                    .map(six)
                    .collect(),
                omega: omega[i],
                cosine: six(&cosine[6 * i..6 * i + 6]),
                sine: six(&sine[6 * i..6 * i + 6]),
            })
            .collect();
        Ok(Self(Path::new(pieces).into_py()?))
    }

    #[getter]
    fn length_mm(&self) -> f64 {
        self.0.length()
    }

    /// Tool tip (n, 3), unit tool axis (n, 3) and curvature (n,) at u.
    #[allow(clippy::type_complexity)]
    fn frames<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)>
    {
        let frames: Vec<_> = vector("u", &u)?.into_iter().map(|u| self.0.frame(u)).collect();
        let points = frames.iter().flat_map(|f| <[f64; 3]>::from(f.r)).collect();
        let tools = frames.iter().flat_map(|f| <[f64; 3]>::from(f.tool())).collect();
        let curvature = frames.iter().map(|f| f.curvature()).collect();
        Ok((matrix(py, points, 3)?, matrix(py, tools, 3)?, array(py, curvature)?))
    }

    /// Parameter u at arc length s from the start, mm.
    fn at_length<'py>(
        &self,
        py: Python<'py>,
        s_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let lengths = vector("s_mm", &s_mm)?.into_iter();
        array(py, lengths.map(|s| self.0.at_length(s)).collect())
    }
}

fn machine(machine: &Machine) -> PyResult<FiveAxis> {
    FiveAxis::new(&machine.inner, &machine.places).into_py()
}

fn feedback(name: &str) -> PyResult<Feedback> {
    let choices = [("motor", Feedback::Motor), ("load", Feedback::Load)];
    choice("feedback", name, &choices).into_py()
}

fn gains(array: &PyReadonlyArray2<'_, f64>) -> PyResult<[Gains; 5]> {
    let values = rows("gains", array, 3)?;
    if values.len() != 15 {
        let got = format!("shape ({}, 3)", values.len() / 3);
        return Err(to_py(&Error::input("gains", got, "shape (5, 3)")));
    }
    Ok([0, 1, 2, 3, 4].map(|i| Gains {
        proportional: values[3 * i],
        integral: values[3 * i + 1],
        derivative: values[3 * i + 2],
    }))
}

fn coupling(args: &CouplingArgs<'_>) -> PyResult<Coupling> {
    let positions = [("circle", PositionModel::Circle), ("tangent", PositionModel::Tangent)];
    let orientations =
        [("proposed", OrientationModel::Proposed), ("tangent", OrientationModel::Tangent)];
    let orders = [
        ("controller_last", Order::ControllerLast),
        ("jacobian_last", Order::JacobianLast),
        ("as_printed", Order::AsPrinted),
    ];
    let order = "order of controller and inverse Jacobian";
    Ok(Coupling {
        position: choice("contour-error model", &args.0, &positions).into_py()?,
        orientation: choice("orientation-error model", &args.1, &orientations).into_py()?,
        gains: gains(&args.2)?,
        order: choice(order, &args.3, &orders).into_py()?,
    })
}

/// Five axes from five rows.
fn axes(values: &[f64]) -> [Axis; 5] {
    [0, 1, 2, 3, 4].map(|i| {
        let mut row = [0.0; AXIS_FIELDS];
        row.copy_from_slice(&values[AXIS_FIELDS * i..AXIS_FIELDS * (i + 1)]);
        axis(&row, i >= 3)
    })
}

fn five_axes(array: &PyReadonlyArray2<'_, f64>, sets: usize) -> PyResult<Vec<[Axis; 5]>> {
    let values = rows_with_limits("axes", array, AXIS_FIELDS)?;
    let set = 5 * AXIS_FIELDS;
    if values.len() != sets * set {
        let got = format!("{} rows", values.len() / AXIS_FIELDS);
        return Err(to_py(&Error::input("axes", got, format!("{} rows", 5 * sets))));
    }
    Ok(values.chunks_exact(set).map(axes).collect())
}

/// One simulation; a dictionary of columns.
#[pyfunction]
#[pyo3(signature = (path, feed, *, period_s, axes, feedback, coupling, assumed, real))]
pub fn contour_simulate<'py>(
    py: Python<'py>,
    path: PyRef<'py, ContourPath>,
    feed: FeedArgs,
    #[pyo3(from_py_with = finite)] period_s: f64,
    axes: PyReadonlyArray2<'py, f64>,
    feedback: &str,
    coupling: Option<CouplingArgs<'py>>,
    assumed: PyRef<'py, Machine>,
    real: PyRef<'py, Machine>,
) -> PyResult<Bound<'py, PyDict>> {
    let axes = five_axes(&axes, 1)?[0];
    let feedback = self::feedback(feedback)?;
    let coupling = coupling.as_ref().map(self::coupling).transpose()?;
    let (assumed, real) = (machine(&assumed)?, machine(&real)?);
    let (path, feed) = (&path.0, self::feed(feed));
    let (columns, diverged) = py
        .detach(|| {
            let reference = Reference::new(path, feed, period_s, &assumed)?;
            let simulation =
                Simulation { reference: &reference, axes, feedback, coupling, machine: &assumed };
            let run = simulation.run()?;
            let samples = samples(path, &reference, &assumed, &real, &run.axes);
            Ok((columns(path, &reference, &run, samples), run.diverged))
        })
        .into_py()?;
    let out = PyDict::new(py);
    out.set_item("diverged", diverged)?;
    for (name, width, values) in columns {
        match width {
            1 => out.set_item(name, array(py, values)?)?,
            _ => out.set_item(name, matrix(py, values, width)?)?,
        }
    }
    Ok(out)
}

/// Runs between two looks for Ctrl-C.
const PIECE: usize = 4;

/// Many simulations on all cores: names of the figures, and one row of them a case.
#[pyfunction]
#[pyo3(signature = (
    paths, *, path_index, feeds, period_s, axes, feedback, couplings, coupling_index, assumed,
    real
))]
pub fn contour_sweep<'py>(
    py: Python<'py>,
    paths: Vec<PyRef<'py, ContourPath>>,
    path_index: Vec<usize>,
    feeds: Vec<FeedArgs>,
    #[pyo3(from_py_with = finite)] period_s: f64,
    axes: PyReadonlyArray2<'py, f64>,
    feedback: &str,
    couplings: Vec<Option<CouplingArgs<'py>>>,
    coupling_index: Vec<usize>,
    assumed: PyRef<'py, Machine>,
    real: PyRef<'py, Machine>,
) -> PyResult<(Vec<&'static str>, Bound<'py, PyArray2<f64>>)> {
    let axes = five_axes(&axes, path_index.len())?;
    let feedback = self::feedback(feedback)?;
    let couplings = couplings
        .iter()
        .map(|args| args.as_ref().map(coupling).transpose())
        .collect::<PyResult<Vec<_>>>()?;
    let (assumed, real) = (machine(&assumed)?, machine(&real)?);
    let lengths = [path_index.len(), feeds.len(), coupling_index.len()];
    if lengths.iter().any(|&length| length != lengths[0]) {
        let got = format!("lengths {lengths:?}");
        return Err(to_py(&Error::input("cases of a sweep", got, "one length")));
    }
    let cases = (0..path_index.len())
        .map(|i| {
            let number = coupling_index[i];
            let coupling = couplings.get(number).ok_or_else(|| {
                let expected = format!("below {}", couplings.len());
                to_py(&Error::input("controller of a case", number, expected))
            })?;
            Ok(Case {
                path: path_index[i],
                feed: feed(feeds[i]),
                period: period_s,
                axes: axes[i],
                feedback,
                coupling: *coupling,
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let paths: Vec<Path> = paths.iter().map(|path| path.0.clone()).collect();
    let found = in_pieces(py, None, (cases.len(), PIECE), |first, count| {
        sweep(&paths, &cases[first..first + count], &assumed, &real)
    })?;
    let mut values = Vec::with_capacity(cases.len() * FIGURES.len());
    for piece in found {
        values.extend(piece.into_py()?.iter().flat_map(figures));
    }
    Ok((FIGURES.to_vec(), matrix(py, values, FIGURES.len())?))
}

/// Margins of each axis's own loop (or coupled along the normal): gain, phase (rad), crossover (Hz),
/// delay (s), one row an axis.
#[pyfunction]
pub fn contour_axis_margins<'py>(
    py: Python<'py>,
    axes: PyReadonlyArray2<'py, f64>,
    gains_of_coupling: Option<PyReadonlyArray2<'py, f64>>,
    #[pyo3(from_py_with = finite)] period_s: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let axes = five_axes(&axes, 1)?[0];
    let gains = gains_of_coupling.as_ref().map(gains).transpose()?;
    let mut values = Vec::with_capacity(20);
    for (i, (axis, name)) in axes.iter().zip("XYZAC".chars()).enumerate() {
        let gains = gains.as_ref().map(|g| &g[i]);
        let m = axis_margins(axis, name, gains, period_s).into_py()?;
        values.extend([m.gain, m.phase, m.crossover_hz, m.delay]);
    }
    matrix(py, values, 4)
}

/// Largest pole and gain margin of the coupled five-axis loop at each u, shape (n, 2).
#[pyfunction]
#[pyo3(signature = (path, u, *, axes, gains, period_s, assumed))]
pub fn contour_path_margins<'py>(
    py: Python<'py>,
    path: PyRef<'py, ContourPath>,
    u: PyReadonlyArray1<'py, f64>,
    axes: PyReadonlyArray2<'py, f64>,
    gains: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] period_s: f64,
    assumed: PyRef<'py, Machine>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let axes = five_axes(&axes, 1)?[0];
    let gains = self::gains(&gains)?;
    let machine = machine(&assumed)?;
    let (u, path) = (vector("u", &u)?, &path.0);
    let values = py
        .detach(|| {
            let mut values = Vec::with_capacity(2 * u.len());
            for u in u {
                let pole = pole_radius(path, u, &machine, &axes, &gains, period_s, 1.0)?;
                let margin = coupled_gain_margin(path, u, &machine, &axes, &gains, period_s)?;
                values.extend([pole, margin]);
            }
            Ok(values)
        })
        .into_py()?;
    matrix(py, values, 2)
}

/// Load positions of one axis on its own under commanded positions (mm, or deg for A, B, C).
#[pyfunction]
pub fn contour_axis_response<'py>(
    py: Python<'py>,
    letter: char,
    axis: PyReadonlyArray1<'py, f64>,
    #[pyo3(from_py_with = finite)] period_s: f64,
    feedback: &str,
    command: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let out = axis_responses(
        py,
        letter,
        &vector_with_limits("axis", &axis)?,
        None,
        period_s,
        feedback,
        &vector("command", &command)?,
        1,
    )?;
    array(py, out)
}

/// The same of an axis with each of m sets of parameters (m, 17), every `stride`-th control period:
/// (m, n). `starts`: position ahead of the first command and speed at the beginning (mm, mm/s; deg,
/// deg/s), (m, 2); by default rest.
#[pyfunction]
#[pyo3(signature = (letter, axes, period_s, feedback, command, *, stride, starts=None))]
pub fn contour_axis_responses<'py>(
    py: Python<'py>,
    letter: char,
    axes: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] period_s: f64,
    feedback: &str,
    command: PyReadonlyArray1<'py, f64>,
    stride: usize,
    starts: Option<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let command = vector("command", &command)?;
    let axes = rows_with_limits("axes", &axes, AXIS_FIELDS)?;
    let starts = starts.as_ref().map(|starts| rows("starts", starts, 2)).transpose()?;
    let starts = starts.as_deref();
    let out = axis_responses(py, letter, &axes, starts, period_s, feedback, &command, stride)?;
    matrix(py, out, command.len().div_ceil(stride))
}

fn axis_responses(
    py: Python<'_>,
    letter: char,
    axes: &[f64],
    starts: Option<&[f64]>,
    period_s: f64,
    feedback: &str,
    command: &[f64],
    stride: usize,
) -> PyResult<Vec<f64>> {
    if !axes.len().is_multiple_of(AXIS_FIELDS) {
        let expected = format!("{AXIS_FIELDS} numbers");
        return Err(to_py(&Error::input("axis", axes.len(), expected)));
    }
    if let Some(row) = command.iter().position(|v| !v.is_finite()) {
        let what = format!("command, row {row}");
        return Err(to_py(&Error::input(what, command[row], "a finite number")));
    }
    let unit = position_unit(letter);
    let feedback = self::feedback(feedback)?;
    let axes: Vec<Axis> = axes
        .chunks_exact(AXIS_FIELDS)
        .map(|numbers| {
            let mut row = [0.0; AXIS_FIELDS];
            row.copy_from_slice(numbers);
            axis(&row, !matches!(letter, 'X' | 'Y' | 'Z'))
        })
        .collect();
    let starts: Vec<[f64; 2]> = match starts {
        None => vec![[0.0; 2]; axes.len()],
        Some(numbers) => numbers.chunks_exact(2).map(|s| [s[0] * unit, s[1] * unit]).collect(),
    };
    let command: Vec<f64> = command.iter().map(|r| r * unit).collect();
    let follow = || responses(&axes, &starts, letter, period_s, feedback, &command, stride);
    let mut out = py.detach(follow).into_py()?;
    out.iter_mut().for_each(|load| *load /= unit);
    Ok(out)
}
