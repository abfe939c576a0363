//! Python binding of `trunnion-core`: flat, thin, no arithmetic.
//!
//! Errors become exceptions in [`errors`], numpy becomes slices in [`arrays`], each in one file.

// A flat binding hands arrays over one by one: long signatures and tuples are its nature.
#![allow(clippy::too_many_arguments, clippy::type_complexity)]

mod arrays;
mod artefact;
mod compensation;
mod contouring;
mod errors;
mod hybrid;
mod linear;
mod machine;
mod names;
mod nc;
mod plan;
mod sets;
mod studies;
mod threads;
mod touch;
mod turning;
mod user_units;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("MAX_THREADS", crate::threads::MAX)?;
        module.add("RANK_TOLERANCE", trunnion_core::linear::RANK_TOLERANCE)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }

    // --- statistics
    #[pymodule_export]
    use crate::linear::{gains_of_blocks, linear_fit, local_errors_inside, sums_by_value};
    #[pymodule_export]
    use crate::sets::{CauseBlocks, CauseSet, sizes_of_sets};

    // --- trunnion
    #[pymodule_export]
    use crate::artefact::{Artefact, artefact_kinds};
    #[pymodule_export]
    use crate::compensation::{MachineModel, field_at, field_on_grid, field_statistics};
    #[pymodule_export]
    use crate::machine::Machine;
    #[pymodule_export]
    use crate::plan::Arrangement;
    #[pymodule_export]
    use crate::studies::Measurements;
    #[pymodule_export]
    use crate::touch::{Moves, TouchModel, catalogue, closed_form_slips};

    // --- turning, part programs
    #[pymodule_export]
    use crate::nc::PyProgram;
    #[pymodule_export]
    use crate::turning::{PyProbePath, PyProfile, turning_cause, turning_change, turning_correct};

    // --- contouring
    #[pymodule_export]
    use crate::contouring::{
        ContourPath, contour_axis_margins, contour_axis_response, contour_axis_responses,
        contour_path_margins, contour_simulate, contour_sweep,
    };

    // --- hybrid
    #[pymodule_export]
    use crate::hybrid::{Hybrid, hybrid_example, hybrid_parameter, hybrid_parameters};
}
