//! Plans: which touches, in which order, on which approach.

use nalgebra::Vector3;
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::artefact::Layout;
use trunnion_core::plan as planning;
use trunnion_core::plan::collision::Stylus;
use trunnion_core::plan::{PlanOptions, PlanRequest, PlannedTouch};
use trunnion_core::units::{ARCSEC, DEG, MM_PER_MIN, UM};

use crate::arrays::{array, each_row, finite, matrix, matrix_of, rows};
use crate::artefact::Artefact;
use crate::errors::IntoPy;
use crate::machine::Machine;
use crate::touch::Moves;

/// Machine, artefact on its table, probe, and the measures of an approach, mm.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Arrangement {
    inner: planning::Arrangement,
    stylus: Stylus,
    clearance: f64,
    overtravel: f64,
}

impl Arrangement {
    /// Distance that the ball's centre keeps from everything it crosses.
    fn above(&self) -> f64 {
        self.stylus.ball_radius + self.clearance
    }
}

#[pymethods]
impl Arrangement {
    #[new]
    #[pyo3(signature = (
        machine, artefact, *, ball_radius_mm, stem_radius_mm, stem_length_mm, body_radius_mm,
        body_length_mm, table_radius_mm, table_thickness_mm, clearance_mm, overtravel_mm,
        rotary_offset_deg
    ))]
    fn new(
        machine: &Machine,
        artefact: &Artefact,
        #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
        #[pyo3(from_py_with = finite)] stem_radius_mm: f64,
        #[pyo3(from_py_with = finite)] stem_length_mm: f64,
        #[pyo3(from_py_with = finite)] body_radius_mm: f64,
        #[pyo3(from_py_with = finite)] body_length_mm: f64,
        #[pyo3(from_py_with = finite)] table_radius_mm: f64,
        #[pyo3(from_py_with = finite)] table_thickness_mm: f64,
        #[pyo3(from_py_with = finite)] clearance_mm: f64,
        #[pyo3(from_py_with = finite)] overtravel_mm: f64,
        #[pyo3(from_py_with = finite)] rotary_offset_deg: f64,
    ) -> PyResult<Self> {
        let Artefact { inner, fixture } = artefact;
        let table = [table_radius_mm, table_thickness_mm];
        let offset = rotary_offset_deg * DEG;
        let (machine, places) = (machine.inner.clone(), &machine.places);
        let inner = planning::Arrangement::new(machine, places, *inner, fixture, table, offset);
        Ok(Self {
            inner: inner.into_py()?,
            stylus: Stylus {
                ball_radius: ball_radius_mm,
                stem_radius: stem_radius_mm,
                length: stem_length_mm,
                body: [body_radius_mm, body_length_mm],
            },
            clearance: clearance_mm,
            overtravel: overtravel_mm,
        })
    }

    /// Touches of a plan; angles in degrees, resolutions in µm and arcsec, feeds in mm/min.
    #[pyo3(signature = (
        *, turn_deg, tilt_deg, pairs_deg, feeds_mm_min, both_senses, repeats, linear_um, rotary_arcsec,
        layout, all_faces
    ))]
    fn plan<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = finite)] turn_deg: Vec<f64>,
        #[pyo3(from_py_with = finite)] tilt_deg: Vec<f64>,
        pairs_deg: Vec<(f64, f64)>,
        #[pyo3(from_py_with = finite)] feeds_mm_min: Vec<f64>,
        both_senses: bool,
        repeats: usize,
        #[pyo3(from_py_with = finite)] linear_um: f64,
        #[pyo3(from_py_with = finite)] rotary_arcsec: f64,
        layout: &str,
        all_faces: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let layout = match layout {
            "side" => Layout::Side,
            "top" => Layout::Top,
            _ => return Err(Error::unknown("layout", layout, ["side", "top"])).into_py(),
        };
        let degrees = |values: Vec<f64>| values.into_iter().map(|v| v * DEG).collect();
        let request = PlanRequest {
            turning: degrees(turn_deg),
            tilting: degrees(tilt_deg),
            pairs: pairs_deg.into_iter().map(|(a, c)| (a * DEG, c * DEG)).collect(),
            feeds: feeds_mm_min.into_iter().map(|feed| feed * MM_PER_MIN).collect(),
            both_senses,
            repeats,
        };
        let options = PlanOptions {
            clearance: self.clearance,
            overtravel: self.overtravel,
            linear_resolution: linear_um * UM,
            rotary_resolution: rotary_arcsec * ARCSEC,
            stylus: self.stylus,
            layout,
            all_faces,
        };
        let touches = py.detach(|| planning::plan(&self.inner, &request, &options)).into_py()?;
        columns(py, &touches, self.inner.machine.rotary().len())
    }

    /// Z above all that swings, and Z above everything at each row's positions of the rotary axes.
    fn safe_levels<'py>(
        &self,
        py: Python<'py>,
        rotary_deg: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        let axes = self.inner.machine.rotary().len();
        let rotary = rows("rotary positions", &rotary_deg, axes)?;
        let levels = each_row(&rotary, axes, rotary_deg.as_array().nrows()).map(|angles| {
            let angles: Vec<f64> = angles.iter().map(|angle| angle * DEG).collect();
            self.inner.safe_level(&angles, self.above())
        });
        Ok((self.inner.swing_level(self.above()), array(py, levels.collect())?))
    }

    /// How far offsets of the rotary axes move a point at this distance from the table's top, mm.
    fn offset_shift_mm(&self, #[pyo3(from_py_with = finite)] distance_mm: f64) -> f64 {
        self.inner.offset.shift(distance_mm)
    }

    /// Rows of moves from their starts that ball and stem cannot make with the artefact anywhere
    /// within its tolerance.
    fn blocked_moves(
        &self,
        py: Python<'_>,
        moves: &Moves,
        reach_mm: Vec<f64>,
    ) -> PyResult<Vec<usize>> {
        let moves = moves.inner.view();
        moves.check(self.inner.machine.rotary().len()).into_py()?;
        let blocked =
            || planning::blocked(&self.inner, &moves, &reach_mm, self.stylus, self.above());
        Ok(py.detach(blocked))
    }
}

fn columns<'py>(
    py: Python<'py>,
    touches: &[PlannedTouch],
    axes: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let columns = |pick: &dyn Fn(&PlannedTouch) -> Vec<f64>| -> Vec<f64> {
        touches.iter().flat_map(pick).collect()
    };
    let angles = |t: &PlannedTouch| t.rotary[..axes].iter().map(|v| v / DEG).collect();
    let result = PyDict::new(py);
    result.set_item("rotary_deg", matrix_of(py, columns(&angles), touches.len(), axes)?)?;
    let senses = columns(&|t| t.sense[..axes].to_vec());
    result.set_item("sense", matrix_of(py, senses, touches.len(), axes)?)?;
    let xyz = |v: &Vector3<f64>| v.iter().copied().collect();
    result.set_item("contact_mm", matrix(py, columns(&|t| xyz(&t.contact)), 3)?)?;
    result.set_item("start_mm", matrix(py, columns(&|t| xyz(&t.start)), 3)?)?;
    result.set_item("direction", matrix(py, columns(&|t| xyz(&t.direction)), 3)?)?;
    let cycle: Vec<i64> = touches.iter().map(|t| t.cycle).collect();
    let label: Vec<i64> = touches.iter().map(|t| t.label).collect();
    result.set_item("cycle", PyArray1::from_vec(py, cycle))?;
    result.set_item("point", PyArray1::from_vec(py, label))?;
    result.set_item("feed_mm_min", array(py, columns(&|t| vec![t.feed / MM_PER_MIN]))?)?;
    Ok(result)
}
