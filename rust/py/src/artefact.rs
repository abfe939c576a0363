//! Artefacts: what is touched, and how it stands on the table.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::artefact::{self, Fixture, KINDS};
use trunnion_core::units::DEG;

use crate::errors::IntoPy;

/// Kinds of artefact: dimensions (mm, in order) of an example of each.
#[pyfunction]
pub fn artefact_kinds(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for kind in KINDS {
        all.set_item(kind.name, kind.example.to_vec())?;
    }
    Ok(all)
}

/// An artefact on the table: nominal place (mm) and turn about Z, and how far it may be off.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Artefact {
    pub inner: artefact::Artefact,
    pub fixture: Fixture,
}

#[pymethods]
impl Artefact {
    #[new]
    #[pyo3(signature = (
        kind, dimensions, *, place_mm, turn_deg, stem_diameter_mm, base_mm, clamps_mm, chuck_mm,
        tolerance_mm, tolerance_deg
    ))]
    fn new(
        kind: &str,
        dimensions: Vec<f64>,
        place_mm: [f64; 3],
        turn_deg: f64,
        stem_diameter_mm: f64,
        base_mm: [f64; 3],
        clamps_mm: Vec<[f64; 5]>,
        chuck_mm: [f64; 2],
        tolerance_mm: f64,
        tolerance_deg: f64,
    ) -> PyResult<Self> {
        let inner = artefact::Artefact::of(kind, &dimensions).into_py()?;
        let fixture = Fixture {
            place: place_mm.into(),
            turn: turn_deg * DEG,
            stem_radius: 0.5 * stem_diameter_mm,
            base: base_mm.into(),
            clamps: clamps_mm,
            chuck: [0.5 * chuck_mm[0], chuck_mm[1]],
            tolerance: tolerance_mm,
            turn_tolerance: tolerance_deg * DEG,
        };
        Ok(Self { inner, fixture })
    }
}
