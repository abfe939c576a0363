//! Five-axis contouring (paper 003).

use std::str::FromStr;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::contouring::face::{FIGURES, Trace};
use trunnion_core::contouring::margins::{axis_margins, coupled_gain_margin, pole_radius};
use trunnion_core::contouring::{
    AXIS_FIELDS, Axis, Case, Coupling, Feed, Feedback, Gains, Machine, Order, OrientationModel,
    Path, Piece, PositionModel, Reference, Simulation, responses, sweep,
};
use trunnion_core::units::DEG;

use crate::arrays::{array, matrix, rows, vector};
use crate::errors::{IntoPy, to_py};

/// Location errors by ISO name, µm and arcsec.
type Errors = Vec<(String, f64)>;
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
        let breaks = vector(&breaks);
        let pieces = breaks.len().saturating_sub(1);
        let coefficients = rows("coefficients", &coefficients, 6)?;
        let (omega, cosine, sine) =
            (vector(&omega), rows("cosine", &cosine, 6)?, rows("sine", &sine, 6)?);
        let per_piece = (coefficients.len() / 6).checked_div(pieces).unwrap_or(0);
        let sizes = [coefficients.len(), omega.len() * 6, cosine.len(), sine.len()];
        if sizes != [6 * pieces * per_piece, 6 * pieces, 6 * pieces, 6 * pieces] {
            let got = format!("numbers of values {sizes:?}");
            let wanted = format!("as many rows for each of {pieces} pieces");
            return Err(to_py(&Error::input("path", got, wanted)));
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
        let frames: Vec<_> = vector(&u).into_iter().map(|u| self.0.frame(u)).collect();
        let points = frames.iter().flat_map(|f| <[f64; 3]>::from(f.r)).collect();
        let tools = frames.iter().flat_map(|f| <[f64; 3]>::from(f.tool())).collect();
        let curvature = frames.iter().map(|f| f.curvature()).collect();
        Ok((matrix(py, points, 3)?, matrix(py, tools, 3)?, array(py, curvature)))
    }

    /// Parameter u at arc length s from the start, mm.
    fn at_length<'py>(
        &self,
        py: Python<'py>,
        s_mm: PyReadonlyArray1<'py, f64>,
    ) -> Bound<'py, PyArray1<f64>> {
        array(py, vector(&s_mm).into_iter().map(|s| self.0.at_length(s)).collect())
    }
}

fn machine(errors: &Errors) -> PyResult<Machine> {
    Machine::with_errors(errors.iter().map(|(name, value)| (name.as_str(), *value))).into_py()
}

fn feed(args: FeedArgs) -> Feed {
    Feed::from_face(args.0, args.1, args.2, args.3, args.4)
}

fn parse<T: FromStr<Err = Error>>(name: &str) -> PyResult<T> {
    name.parse().into_py()
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
    Ok(Coupling {
        position: parse::<PositionModel>(&args.0)?,
        orientation: parse::<OrientationModel>(&args.1)?,
        gains: gains(&args.2)?,
        order: parse::<Order>(&args.3)?,
    })
}

/// Five axes from five rows in the face's units.
fn axes(values: &[f64]) -> [Axis; 5] {
    [0, 1, 2, 3, 4].map(|i| {
        let mut row = [0.0; AXIS_FIELDS];
        row.copy_from_slice(&values[AXIS_FIELDS * i..AXIS_FIELDS * (i + 1)]);
        Axis::from_face(&row, i >= 3)
    })
}

fn five_axes(array: &PyReadonlyArray2<'_, f64>, sets: usize) -> PyResult<Vec<[Axis; 5]>> {
    let values = rows("axes", array, AXIS_FIELDS)?;
    let set = 5 * AXIS_FIELDS;
    if values.len() != sets * set {
        let got = format!("{} rows", values.len() / AXIS_FIELDS);
        return Err(to_py(&Error::input("axes", got, format!("{} rows", 5 * sets))));
    }
    Ok(values.chunks_exact(set).map(axes).collect())
}

/// One simulation; a dictionary of columns.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn contour_simulate<'py>(
    py: Python<'py>,
    path: PyRef<'py, ContourPath>,
    feed_args: FeedArgs,
    period_s: f64,
    axes: PyReadonlyArray2<'py, f64>,
    feedback: &str,
    coupling_args: Option<CouplingArgs<'py>>,
    believed: Errors,
    real: Errors,
) -> PyResult<Bound<'py, PyDict>> {
    let axes = five_axes(&axes, 1)?[0];
    let feedback = parse::<Feedback>(feedback)?;
    let coupling = coupling_args.as_ref().map(coupling).transpose()?;
    let (believed, real) = (machine(&believed)?, machine(&real)?);
    let (path, feed) = (&path.0, feed(feed_args));
    let (trace, diverged) = py
        .detach(|| {
            let reference = Reference::new(path, feed, period_s, &believed)?;
            let simulation =
                Simulation { reference: &reference, axes, feedback, coupling, machine: &believed };
            let run = simulation.run()?;
            let trace = Trace::new(path, &reference, &believed, &real, &run);
            Ok((trace, run.diverged))
        })
        .into_py()?;
    let out = PyDict::new(py);
    out.set_item("diverged", diverged)?;
    for (name, values, columns) in [
        ("point_mm", trace.point_mm, 3),
        ("reference", trace.reference, 5),
        ("commanded", trace.commanded, 5),
        ("actual", trace.actual, 5),
        ("tip_mm", trace.tip_mm, 3),
        ("contour_vector_um", trace.contour_vector_um, 3),
    ] {
        out.set_item(name, matrix(py, values, columns)?)?;
    }
    for (name, values) in [
        ("u", trace.u),
        ("foot_u", trace.foot_u),
        ("contour_um", trace.contour_um),
        ("orientation_arcsec", trace.orientation_arcsec),
        ("following_um", trace.following_um),
        ("circle_um", trace.circle_um),
        ("tangent_um", trace.tangent_um),
        ("proposed_arcsec", trace.proposed_arcsec),
        ("tangent_arcsec", trace.tangent_arcsec),
    ] {
        out.set_item(name, array(py, values))?;
    }
    Ok(out)
}

/// Many simulations on all cores: names of the figures, and one row of them a case.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn contour_sweep<'py>(
    py: Python<'py>,
    paths: Vec<PyRef<'py, ContourPath>>,
    path_index: Vec<usize>,
    feeds: Vec<FeedArgs>,
    period_s: f64,
    axes: PyReadonlyArray2<'py, f64>,
    feedback: &str,
    couplings: Vec<Option<CouplingArgs<'py>>>,
    coupling_index: Vec<usize>,
    believed: Errors,
    real: Errors,
) -> PyResult<(Vec<&'static str>, Bound<'py, PyArray2<f64>>)> {
    let axes = five_axes(&axes, path_index.len())?;
    let feedback = parse::<Feedback>(feedback)?;
    let couplings = couplings
        .iter()
        .map(|args| args.as_ref().map(coupling).transpose())
        .collect::<PyResult<Vec<_>>>()?;
    let (believed, real) = (machine(&believed)?, machine(&real)?);
    let lengths = [path_index.len(), feeds.len(), coupling_index.len()];
    if lengths.iter().any(|&length| length != lengths[0]) {
        let got = format!("lengths {lengths:?}");
        return Err(to_py(&Error::input("cases of a sweep", got, "one length")));
    }
    let cases = (0..path_index.len())
        .map(|i| {
            let number = coupling_index[i];
            let coupling = couplings.get(number).ok_or_else(|| {
                let wanted = format!("below {}", couplings.len());
                to_py(&Error::input("controller of a case", number, wanted))
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
    let figures = py.detach(|| sweep(&paths, &cases, &believed, &real)).into_py()?;
    let values: Vec<f64> = figures.iter().flat_map(|f| f.row()).collect();
    Ok((FIGURES.to_vec(), matrix(py, values, FIGURES.len())?))
}

/// Margins of each axis's own loop (or coupled along the normal): gain, phase (rad), crossover (Hz),
/// delay (s), one row an axis.
#[pyfunction]
pub fn contour_axis_margins<'py>(
    py: Python<'py>,
    axes: PyReadonlyArray2<'py, f64>,
    gains_of_coupling: Option<PyReadonlyArray2<'py, f64>>,
    period_s: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let axes = five_axes(&axes, 1)?[0];
    let gains = gains_of_coupling.as_ref().map(gains).transpose()?;
    let values: Vec<f64> = (0..5)
        .flat_map(|i| {
            let m = axis_margins(&axes[i], gains.as_ref().map(|g| &g[i]), period_s);
            [m.gain, m.phase, m.crossover_hz, m.delay]
        })
        .collect();
    matrix(py, values, 4)
}

/// Largest pole and gain margin of the coupled five-axis loop at each u, shape (n, 2).
#[pyfunction]
pub fn contour_path_margins<'py>(
    py: Python<'py>,
    path: PyRef<'py, ContourPath>,
    u: PyReadonlyArray1<'py, f64>,
    axes: PyReadonlyArray2<'py, f64>,
    gains_of_coupling: PyReadonlyArray2<'py, f64>,
    period_s: f64,
    believed: Errors,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let axes = five_axes(&axes, 1)?[0];
    let gains = gains(&gains_of_coupling)?;
    let machine = machine(&believed)?;
    let (u, path) = (vector(&u), &path.0);
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
    period_s: f64,
    feedback: &str,
    command: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let out = axis_responses(py, letter, &vector(&axis), period_s, feedback, &vector(&command), 1)?;
    Ok(array(py, out))
}

/// The same of an axis with each of m sets of parameters (m, 13), every `stride`-th control period:
/// (m, n).
#[pyfunction]
pub fn contour_axis_responses<'py>(
    py: Python<'py>,
    letter: char,
    axes: PyReadonlyArray2<'py, f64>,
    period_s: f64,
    feedback: &str,
    command: PyReadonlyArray1<'py, f64>,
    stride: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let command = vector(&command);
    let axes = rows("axes", &axes, AXIS_FIELDS)?;
    let out = axis_responses(py, letter, &axes, period_s, feedback, &command, stride)?;
    matrix(py, out, command.len().div_ceil(stride))
}

fn axis_responses(
    py: Python<'_>,
    letter: char,
    axes: &[f64],
    period_s: f64,
    feedback: &str,
    command: &[f64],
    stride: usize,
) -> PyResult<Vec<f64>> {
    if !axes.len().is_multiple_of(AXIS_FIELDS) {
        let wanted = format!("{AXIS_FIELDS} numbers");
        return Err(to_py(&Error::input("axis", axes.len(), wanted)));
    }
    if let Some(row) = command.iter().position(|v| !v.is_finite()) {
        let what = format!("command, row {row}");
        return Err(to_py(&Error::input(what, command[row], "a finite number")));
    }
    let rotary = !matches!(letter, 'X' | 'Y' | 'Z');
    let unit = if rotary { DEG } else { 1.0 };
    let feedback = parse::<Feedback>(feedback)?;
    let axes: Vec<Axis> = axes
        .chunks_exact(AXIS_FIELDS)
        .map(|numbers| {
            let mut row = [0.0; AXIS_FIELDS];
            row.copy_from_slice(numbers);
            Axis::from_face(&row, rotary)
        })
        .collect();
    let command: Vec<f64> = command.iter().map(|r| r * unit).collect();
    let mut out =
        py.detach(|| responses(&axes, letter, period_s, feedback, &command, stride)).into_py()?;
    out.iter_mut().for_each(|load| *load /= unit);
    Ok(out)
}
