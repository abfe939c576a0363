//! The turned part: `trunnion.turning`.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::nc::path::{Position, Start};
use trunnion_core::turning::clearance::{Chuck, Probe};
use trunnion_core::turning::correction::{
    CorrectionOptions, Reading, Rule, StartCorner, change, contour_path, correct,
};
use trunnion_core::turning::diameter::{Cause, Cut};
use trunnion_core::turning::finishing::{FinishOptions, finishing};
use trunnion_core::turning::geometry::{Element, Gap};
use trunnion_core::turning::probe_path::{PathOptions, ProbePath, probe_path};
use trunnion_core::turning::probe_program::ProgramOptions;
use trunnion_core::turning::profile::{Corner, Follows, Profile, Vertex};
use trunnion_core::units::{ARCSEC, DEG, MINUTE, UM};

use crate::arrays::{array, finite, matrix, rows, vector};
use crate::errors::{IntoPy, to_py};
use crate::nc::PyProgram;

type Words = Vec<Vec<(char, f64)>>;

fn follows(name: &str, nose_mm: f64) -> PyResult<Follows> {
    Follows::named(name, nose_mm).into_py()
}

fn gap(name: &str) -> PyResult<Gap> {
    match name {
        "meet" => Ok(Gap::Meet),
        "roll" => Ok(Gap::Roll),
        _ => Err(to_py(&Error::unknown("convex corner", name, ["meet", "roll"]))),
    }
}

fn start(position: Option<[f64; 6]>, feed: Option<f64>, machine_codes: Vec<(char, f64)>) -> Start {
    Start { position: position.map(|axes| Position { axes }), feed, machine_codes }
}

fn element_rows(elements: &[Element]) -> Vec<f64> {
    elements
        .iter()
        .flat_map(|element| {
            let (from, to) = (element.from(), element.to());
            let (kind, centre) = match element {
                Element::Line { .. } => (0.0, [0.0; 2]),
                Element::Arc { centre, convex, .. } => (if *convex { 1.0 } else { -1.0 }, *centre),
            };
            [kind, from[0], from[1], to[0], to[1], centre[0], centre[1]]
        })
        .collect()
}

/// A turned contour of lines and arcs.
#[pyclass(name = "TurnedProfile", module = "trunnion._core", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyProfile {
    inner: Profile,
}

#[pymethods]
impl PyProfile {
    #[staticmethod]
    fn from_vertices(vertices: Vec<(f64, f64, String, f64)>) -> PyResult<Self> {
        let kinds = ["sharp", "fillet", "arc-in", "arc-out", "arc-to-arc", "relief"];
        let vertices = vertices
            .into_iter()
            .map(|(z, x, kind, radius)| {
                let corner = match kind.as_str() {
                    "sharp" => Corner::Sharp,
                    "fillet" => Corner::Fillet(radius),
                    "arc-in" => Corner::ArcIn,
                    "arc-out" => Corner::ArcOut(radius),
                    "arc-to-arc" => Corner::ArcToArc(radius),
                    "relief" => Corner::Relief(radius),
                    _ => return Err(Error::unknown("kind of corner", &kind, kinds)),
                };
                Ok(Vertex { at: [z, x], corner })
            })
            .collect::<Result<Vec<_>, _>>()
            .into_py()?;
        Ok(Self { inner: Profile::from_vertices(&vertices).into_py()? })
    }

    #[staticmethod]
    #[pyo3(signature = (program, *, follows, nose_mm, position = None, feed = None, machine_codes = Vec::new()))]
    fn from_program(
        program: &PyProgram,
        follows: &str,
        #[pyo3(from_py_with = finite)] nose_mm: f64,
        #[pyo3(from_py_with = finite)] position: Option<[f64; 6]>,
        #[pyo3(from_py_with = finite)] feed: Option<f64>,
        machine_codes: Vec<(char, f64)>,
    ) -> PyResult<Self> {
        let path = contour_path(&program.inner, &start(position, feed, machine_codes)).into_py()?;
        let follows = self::follows(follows, nose_mm)?;
        Ok(Self { inner: Profile::from_moves(&path.moves, follows).into_py()? })
    }

    #[staticmethod]
    fn from_elements(
        elements: PyReadonlyArray2<'_, f64>,
        reliefs: Vec<(f64, f64, f64)>,
    ) -> PyResult<Self> {
        let values = rows("elements", &elements, 7)?;
        let elements = values
            .chunks_exact(7)
            .filter_map(|row| {
                let [kind, z0, x0, z1, x1, zc, xc] = *row else { return None };
                let (from, to) = ([z0, x0], [z1, x1]);
                Some(if kind == 0.0 {
                    Element::Line { from, to }
                } else {
                    Element::Arc { from, to, centre: [zc, xc], convex: kind > 0.0 }
                })
            })
            .collect();
        let reliefs = reliefs.into_iter().map(|(z, x, width)| ([z, x], width)).collect();
        Ok(Self { inner: Profile::of_elements(elements, reliefs).into_py()? })
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyArray2<f64>>, Vec<(f64, f64, f64)>))> {
        let this = slf.get();
        Ok((slf.get_type().getattr("from_elements")?, (this.elements(py)?, this.reliefs())))
    }

    fn elements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, element_rows(self.inner.elements()), 7)
    }

    fn path<'py>(
        &self,
        py: Python<'py>,
        follows: &str,
        #[pyo3(from_py_with = finite)] nose_mm: f64,
        convex: &str,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let path = self.inner.path(self::follows(follows, nose_mm)?, gap(convex)?).into_py()?;
        matrix(py, element_rows(&path), 7)
    }

    fn reliefs(&self) -> Vec<(f64, f64, f64)> {
        self.inner.reliefs().iter().map(|(at, width)| (at[0], at[1], *width)).collect()
    }

    fn radius_at(&self, z_mm: f64) -> Option<f64> {
        self.inner.x_at(z_mm)
    }

    #[pyo3(signature = (*, dialect, follows, nose_mm, convex, first_element, start_z_mm, retract_x_mm,
        approach_mm, steepest_fall, access_z_mm, feed, first_number, head, tail))]
    fn finishing(
        &self,
        dialect: &str,
        follows: &str,
        #[pyo3(from_py_with = finite)] nose_mm: f64,
        convex: &str,
        first_element: usize,
        #[pyo3(from_py_with = finite)] start_z_mm: f64,
        #[pyo3(from_py_with = finite)] retract_x_mm: f64,
        #[pyo3(from_py_with = finite)] approach_mm: f64,
        #[pyo3(from_py_with = finite)] steepest_fall: f64,
        #[pyo3(from_py_with = finite)] access_z_mm: Vec<f64>,
        #[pyo3(from_py_with = finite)] feed: Option<f64>,
        first_number: Option<u32>,
        head: Words,
        tail: Words,
    ) -> PyResult<(PyProgram, Vec<(f64, f64)>)> {
        let options = FinishOptions {
            dialect: dialect.parse().into_py()?,
            follows: self::follows(follows, nose_mm)?,
            gap: gap(convex)?,
            first_element,
            start_z_mm,
            retract_x_mm,
            approach_mm,
            steepest_fall,
            access_z_mm,
            feed,
            first_number,
            head,
            tail,
        };
        let made = finishing(&self.inner, &options).into_py()?;
        Ok((PyProgram { inner: made.program }, made.left_out))
    }

    #[pyo3(signature = (*, ball_radius_mm, contact_angle_deg, body_diameter_mm, allowance_mm, skip,
        retract_x_mm, approach_mm, chuck_radius_mm, chuck_face_mm, shortest_mm))]
    fn probe_path(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
        #[pyo3(from_py_with = finite)] contact_angle_deg: f64,
        #[pyo3(from_py_with = finite)] body_diameter_mm: f64,
        #[pyo3(from_py_with = finite)] allowance_mm: f64,
        skip: Vec<usize>,
        #[pyo3(from_py_with = finite)] retract_x_mm: f64,
        #[pyo3(from_py_with = finite)] approach_mm: f64,
        #[pyo3(from_py_with = finite)] chuck_radius_mm: f64,
        #[pyo3(from_py_with = finite)] chuck_face_mm: f64,
        #[pyo3(from_py_with = finite)] shortest_mm: f64,
    ) -> PyResult<PyProbePath> {
        let probe =
            Probe { ball_radius_mm, contact_angle: contact_angle_deg * DEG, body_diameter_mm };
        let options = PathOptions {
            probe,
            allowance_mm,
            skip,
            retract_x_mm,
            approach_mm,
            chuck: Chuck { radius_mm: chuck_radius_mm, face_mm: chuck_face_mm },
            shortest_mm,
        };
        let inner = py.detach(|| probe_path(&self.inner, &options)).into_py()?;
        Ok(PyProbePath { inner })
    }
}

/// The path of the probe along a part.
#[pyclass(name = "TurnedProbePath", module = "trunnion._core", frozen)]
pub struct PyProbePath {
    inner: ProbePath,
}

#[pymethods]
impl PyProbePath {
    /// element, start z, start x, end z, end x, slope.
    fn intervals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.inner.intervals.iter().flat_map(|i| {
            #[allow(clippy::cast_precision_loss)] // a small count
            let element = i.element as f64;
            [element, i.start[0], i.start[1], i.end[0], i.end[1], i.slope]
        });
        matrix(py, rows.collect(), 6)
    }

    /// from z, from x, to z, to x, feed, measures, clearance of ball, of body.
    fn moves<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.inner.moves.iter().flat_map(|m| {
            let [feed, measures] = [m.feed, m.measures].map(|b| f64::from(u8::from(b)));
            let (ball, body) = (m.clearance.ball_mm, m.clearance.body_mm);
            [m.from[0], m.from[1], m.to[0], m.to[1], feed, measures, ball, body]
        });
        matrix(py, rows.collect(), 8)
    }

    fn left_out(&self) -> Vec<(usize, String)> {
        self.inner.left_out.clone()
    }

    fn contact_z<'py>(
        &self,
        py: Python<'py>,
        interval: usize,
        z_mm: PyReadonlyArray1<'py, f64>,
        #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let interval = self.inner.intervals.get(interval).ok_or_else(|| {
            let count = self.inner.intervals.len();
            to_py(&Error::input("interval", interval, format!("below {count}")))
        })?;
        let z = vector("z_mm", &z_mm)?;
        array(py, z.iter().map(|&z| interval.contact_z(z, ball_radius_mm)).collect())
    }

    #[pyo3(signature = (*, dialect, feed, first_number, comments, head, tail, retract_last))]
    fn program(
        &self,
        dialect: &str,
        #[pyo3(from_py_with = finite)] feed: Option<f64>,
        first_number: Option<u32>,
        comments: Vec<String>,
        head: Words,
        tail: Words,
        retract_last: bool,
    ) -> PyResult<PyProgram> {
        let dialect = dialect.parse().into_py()?;
        let options =
            ProgramOptions { dialect, feed, first_number, comments, head, tail, retract_last };
        Ok(PyProgram { inner: self.inner.program(&options).into_py()? })
    }
}

#[pyfunction]
#[pyo3(signature = (program, z_mm, error_um, *, unit_um, window, rule, bound_um, look_ahead, follows,
    nose_mm, position, feed, machine_codes, keep_numbers))]
pub fn turning_correct<'py>(
    py: Python<'py>,
    program: &PyProgram,
    z_mm: PyReadonlyArray1<'py, f64>,
    error_um: PyReadonlyArray1<'py, f64>,
    #[pyo3(from_py_with = finite)] unit_um: f64,
    window: usize,
    rule: &str,
    #[pyo3(from_py_with = finite)] bound_um: f64,
    look_ahead: bool,
    follows: &str,
    #[pyo3(from_py_with = finite)] nose_mm: f64,
    #[pyo3(from_py_with = finite)] position: Option<[f64; 6]>,
    #[pyo3(from_py_with = finite)] feed: Option<f64>,
    machine_codes: Vec<(char, f64)>,
    keep_numbers: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (z, errors) = (vector("z_mm", &z_mm)?, vector("error_um", &error_um)?);
    if z.len() != errors.len() {
        let got = format!("{} and {}", z.len(), errors.len());
        return Err(to_py(&Error::input("z_mm, error_um", got, "equally many")));
    }
    let rule = match rule {
        "paper" => Rule::Paper,
        "every-window" => Rule::EveryWindow,
        "mid-run" => Rule::MidRun,
        "bounded" => Rule::Bounded { bound_mm: bound_um * UM },
        _ => {
            let known = ["paper", "every-window", "mid-run", "bounded"];
            return Err(to_py(&Error::unknown("rule", rule, known)));
        }
    };
    let options = CorrectionOptions {
        unit_mm: unit_um * UM,
        window,
        rule,
        start_corner: if look_ahead { StartCorner::LookAhead } else { StartCorner::Zero },
        follows: self::follows(follows, nose_mm)?,
        start: start(position, feed, machine_codes),
        keep_numbers,
    };
    let readings: Vec<Reading> =
        z.iter().zip(&errors).map(|(&z, &error)| Reading { z, error: error * UM }).collect();
    let got = py.detach(|| correct(&program.inner, &readings, &options)).into_py()?;
    let dict = PyDict::new(py);
    let indices = got.inserted.iter().map(|&index| index as u64);
    dict.set_item("inserted", PyArray1::from_iter(py, indices))?;
    let windows = &got.windows;
    dict.set_item("window_z_mm", array(py, windows.iter().map(|w| w.z).collect())?)?;
    dict.set_item("window_mean_um", array(py, windows.iter().map(|w| w.mean / UM).collect())?)?;
    dict.set_item("window_k", PyArray1::from_iter(py, windows.iter().map(|w| w.k)))?;
    dict.set_item("change_um", array(py, got.change.iter().map(|c| c / UM).collect())?)?;
    dict.set_item("covered", PyArray1::from_iter(py, got.covered.iter().copied()))?;
    dict.set_item("bound_um", got.bound.map(|bound| bound / UM))?;
    dict.set_item("program", PyProgram { inner: got.program })?;
    Ok(dict)
}

#[pyfunction]
#[pyo3(signature = (before, after, z_mm, *, follows, nose_mm, position, feed, machine_codes))]
pub fn turning_change<'py>(
    py: Python<'py>,
    before: &PyProgram,
    after: &PyProgram,
    z_mm: PyReadonlyArray1<'py, f64>,
    follows: &str,
    #[pyo3(from_py_with = finite)] nose_mm: f64,
    #[pyo3(from_py_with = finite)] position: Option<[f64; 6]>,
    #[pyo3(from_py_with = finite)] feed: Option<f64>,
    machine_codes: Vec<(char, f64)>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
    let z = vector("z_mm", &z_mm)?;
    let follows = self::follows(follows, nose_mm)?;
    let start = start(position, feed, machine_codes);
    let found = py.detach(|| change(&before.inner, &after.inner, &z, follows, &start)).into_py()?;
    let change_um = found.iter().map(|c| c.unwrap_or(0.0) / UM).collect();
    let covered = PyArray1::from_iter(py, found.iter().map(Option::is_some));
    Ok((array(py, change_um)?, covered))
}

/// Error of the diameter and its derivatives, in µm, arcsec, s, mm, µm/min.
///
/// `cuts`: z, length cut, time, force, diameter, way to the nearest correction block, one row a
/// reading.
#[pyfunction]
pub fn turning_cause<'py>(
    py: Python<'py>,
    cause: &str,
    cuts: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] overhang_mm: f64,
    #[pyo3(from_py_with = finite)] parameters: Vec<f64>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
    let name = cause;
    let cause = Cause::of(name).into_py()?;
    let units: &[f64] = match cause {
        Cause::ToolHeating | Cause::WorkpieceHeating | Cause::BlockAcceleration => &[UM, 1.0],
        Cause::ToolWear => &[UM / MINUTE],
        Cause::Taper => &[ARCSEC],
        Cause::Bending | Cause::ChuckTilt | Cause::Barrel => &[UM],
        Cause::Chatter => &[UM, UM, 1.0],
    };
    if parameters.len() != units.len() {
        let what = format!("parameters of {name}");
        return Err(to_py(&Error::input(what, parameters.len(), units.len().to_string())));
    }
    let mut inside = [0.0; 3];
    for ((slot, value), unit) in inside.iter_mut().zip(&parameters).zip(units) {
        *slot = value * unit;
    }
    let cuts = rows("cuts", &cuts, 6)?;
    let (mut errors, mut slopes) = (Vec::new(), Vec::new());
    for row in cuts.chunks_exact(6) {
        let [z_mm, length_mm, time_s, force, diameter, to_block_mm] = *row else { continue };
        let cut = Cut { z_mm, length_mm, time_s, force, diameter, to_block_mm };
        let (error, slope) = cause.error(inside, &cut, overhang_mm);
        errors.push(error / UM);
        slopes.extend(slope.iter().zip(units).map(|(slope, unit)| slope * unit / UM));
    }
    Ok((array(py, errors)?, matrix(py, slopes, units.len())?))
}
