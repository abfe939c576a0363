//! How many threads a long call may use.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use trunnion_core::Error;

use crate::errors::to_py;

/// The most threads: more are likely a typo and would exhaust memory.
pub const MAX: usize = 1024;

/// Runs `work` on this many threads; `None`: on all cores.
pub fn with_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    match threads {
        None => Ok(work()),
        Some(count) if count == 0 || count > MAX => {
            let expected = format!("1 to {MAX}, or None for all cores");
            Err(to_py(&Error::input("threads", count, expected)))
        }
        Some(count) => rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .map(|pool| pool.install(work))
            .map_err(|error| PyRuntimeError::new_err(error.to_string())),
    }
}
