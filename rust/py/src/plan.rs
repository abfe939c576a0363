//! Plans: which touches, in which order, on which approach.

use nalgebra::Vector3;
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::artefact::Layout;
use trunnion_core::plan as planning;
use trunnion_core::plan::collision::Stylus;
use trunnion_core::plan::{Arrangement, PlanOptions, PlanRequest, PlannedTouch};
use trunnion_core::units::{ARCSEC, DEG, MM_PER_MIN, UM};

use crate::arrays::{array, finite, matrix, rows};
use crate::artefact::Artefact;
use crate::errors::IntoPy;
use crate::machine::Machine;
use crate::touch::Moves;

/// How a plan is made, mm, degrees, µm, arcsec, mm/min as in the set-up file.
#[pyfunction]
#[pyo3(signature = (
    machine, artefact, *, c_deg, tilt_deg, pairs_deg, feeds_mm_min, both_senses, repeats,
    clearance_mm, overtravel_mm, linear_um, rotary_arcsec, rapid_mm_min, rotary_deg_min,
    ball_radius_mm, stem_radius_mm, stem_length_mm, table_radius_mm, table_thickness_mm, layout,
    all_faces
))]
pub fn plan<'py>(
    py: Python<'py>,
    machine: &Machine,
    artefact: &Artefact,
    #[pyo3(from_py_with = finite)] c_deg: Vec<f64>,
    #[pyo3(from_py_with = finite)] tilt_deg: Vec<f64>,
    pairs_deg: Vec<(f64, f64)>,
    #[pyo3(from_py_with = finite)] feeds_mm_min: Vec<f64>,
    both_senses: bool,
    repeats: usize,
    #[pyo3(from_py_with = finite)] clearance_mm: f64,
    #[pyo3(from_py_with = finite)] overtravel_mm: f64,
    #[pyo3(from_py_with = finite)] linear_um: f64,
    #[pyo3(from_py_with = finite)] rotary_arcsec: f64,
    #[pyo3(from_py_with = finite)] rapid_mm_min: f64,
    #[pyo3(from_py_with = finite)] rotary_deg_min: f64,
    #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
    #[pyo3(from_py_with = finite)] stem_radius_mm: f64,
    #[pyo3(from_py_with = finite)] stem_length_mm: f64,
    #[pyo3(from_py_with = finite)] table_radius_mm: f64,
    #[pyo3(from_py_with = finite)] table_thickness_mm: f64,
    layout: &str,
    all_faces: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let arrangement =
        arrangement(machine, artefact, table_radius_mm, table_thickness_mm).into_py()?;
    let layout = match layout {
        "side" => Layout::Side,
        "top" => Layout::Top,
        _ => return Err(Error::unknown("layout", layout, ["side", "top"])).into_py(),
    };
    let degrees = |values: Vec<f64>| values.into_iter().map(|v| v * DEG).collect();
    let request = PlanRequest {
        turning: degrees(c_deg),
        tilting: degrees(tilt_deg),
        pairs: pairs_deg.into_iter().map(|(a, c)| (a * DEG, c * DEG)).collect(),
        feeds: feeds_mm_min.into_iter().map(|feed| feed * MM_PER_MIN).collect(),
        both_senses,
        repeats,
    };
    let options = PlanOptions {
        clearance: clearance_mm,
        overtravel: overtravel_mm,
        linear_resolution: linear_um * UM,
        rotary_resolution: rotary_arcsec * ARCSEC,
        rapid: rapid_mm_min * MM_PER_MIN,
        rotary_speed: rotary_deg_min * DEG * MM_PER_MIN,
        stylus: Stylus {
            ball_radius: ball_radius_mm,
            stem_radius: stem_radius_mm,
            length: stem_length_mm,
        },
        layout,
        all_faces,
    };
    let touches = py.detach(|| planning::plan(&arrangement, &request, &options)).into_py()?;
    let axes = machine.inner.rotary().len();
    let columns = |pick: &dyn Fn(&PlannedTouch) -> Vec<f64>| -> Vec<f64> {
        touches.iter().flat_map(pick).collect()
    };
    let angles = |t: &PlannedTouch| t.rotary[..axes].iter().map(|v| v / DEG).collect();
    let result = PyDict::new(py);
    result.set_item("rotary_deg", matrix(py, columns(&angles), axes)?)?;
    result.set_item("sense", matrix(py, columns(&|t| t.sense[..axes].to_vec()), axes)?)?;
    let xyz = |v: &Vector3<f64>| v.iter().copied().collect();
    result.set_item("contact_mm", matrix(py, columns(&|t| xyz(&t.contact)), 3)?)?;
    result.set_item("start_mm", matrix(py, columns(&|t| xyz(&t.start)), 3)?)?;
    result.set_item("direction", matrix(py, columns(&|t| xyz(&t.direction)), 3)?)?;
    let cycle: Vec<i64> = touches.iter().map(|t| t.cycle).collect();
    let label: Vec<i64> = touches.iter().map(|t| t.label).collect();
    result.set_item("cycle", PyArray1::from_vec(py, cycle))?;
    result.set_item("point", PyArray1::from_vec(py, label))?;
    result.set_item("feed_mm_min", array(py, columns(&|t| vec![t.feed / MM_PER_MIN]))?)?;
    result.set_item("time_s", array(py, columns(&|t| vec![t.time]))?)?;
    Ok(result)
}

fn arrangement(
    machine: &Machine,
    artefact: &Artefact,
    radius: f64,
    thickness: f64,
) -> trunnion_core::Result<Arrangement> {
    let Artefact { inner, fixture } = artefact;
    let table = [radius, thickness];
    Arrangement::new(machine.inner.clone(), &machine.places, *inner, fixture, table)
}

/// Z above all that swings, and Z above everything at each row's positions of the rotary axes, mm.
#[pyfunction]
#[pyo3(signature = (
    machine, artefact, rotary_deg, *, ball_radius_mm, clearance_mm, table_radius_mm, table_thickness_mm
))]
pub fn safe_levels<'py>(
    py: Python<'py>,
    machine: &Machine,
    artefact: &Artefact,
    rotary_deg: PyReadonlyArray2<'py, f64>,
    #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
    #[pyo3(from_py_with = finite)] clearance_mm: f64,
    #[pyo3(from_py_with = finite)] table_radius_mm: f64,
    #[pyo3(from_py_with = finite)] table_thickness_mm: f64,
) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
    let axes = machine.inner.rotary().len();
    let rotary = rows("rotary positions", &rotary_deg, axes)?;
    let arrangement =
        arrangement(machine, artefact, table_radius_mm, table_thickness_mm).into_py()?;
    let above = ball_radius_mm + clearance_mm;
    let levels = rotary.chunks_exact(axes).map(|angles| {
        let angles: Vec<f64> = angles.iter().map(|angle| angle * DEG).collect();
        arrangement.safe_level(&angles, above)
    });
    Ok((arrangement.swing_level(above), array(py, levels.collect())?))
}

/// Rows of moves from their starts that ball and stem cannot make with the artefact anywhere within
/// its tolerance.
#[pyfunction]
#[pyo3(signature = (
    machine, artefact, moves, reach_mm, *, ball_radius_mm, stem_radius_mm, stem_length_mm, clearance_mm,
    table_radius_mm, table_thickness_mm
))]
pub fn blocked_moves(
    py: Python<'_>,
    machine: &Machine,
    artefact: &Artefact,
    moves: &Moves,
    reach_mm: Vec<f64>,
    ball_radius_mm: f64,
    stem_radius_mm: f64,
    stem_length_mm: f64,
    clearance_mm: f64,
    table_radius_mm: f64,
    table_thickness_mm: f64,
) -> PyResult<Vec<usize>> {
    let arrangement =
        arrangement(machine, artefact, table_radius_mm, table_thickness_mm).into_py()?;
    let stylus =
        Stylus { ball_radius: ball_radius_mm, stem_radius: stem_radius_mm, length: stem_length_mm };
    let moves = moves.inner.view();
    moves.check(machine.inner.rotary().len()).into_py()?;
    let above = ball_radius_mm + clearance_mm;
    Ok(py.detach(|| planning::blocked(&arrangement, &moves, &reach_mm, stylus, above)))
}
