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
    Ok(match pool(threads)? {
        None => work(),
        Some(pool) => pool.install(work),
    })
}

/// Threads of their own; `None`: those of all cores, which are shared.
fn pool(threads: Option<usize>) -> PyResult<Option<rayon::ThreadPool>> {
    match threads {
        None => Ok(None),
        Some(count) if count == 0 || count > MAX => {
            let expected = format!("1 to {MAX}, or None for all cores");
            Err(to_py(&Error::input("threads", count, expected)))
        }
        Some(count) => rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .map(Some)
            .map_err(|error| PyRuntimeError::new_err(error.to_string())),
    }
}

/// Does `count` things in pieces of at most `size`, `work(first, number)` each, and answers Ctrl-C
/// between them: a piece has to take a fraction of a second.
pub fn in_pieces<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    (count, size): (usize, usize),
    work: impl Fn(usize, usize) -> T + Send + Sync,
) -> PyResult<Vec<T>> {
    let pool = pool(threads)?;
    let mut found = Vec::with_capacity(count / size + 1);
    let mut first = 0;
    // Once for nothing at all, too: what is wrong with it is said.
    while found.is_empty() || first < count {
        let number = size.min(count - first);
        found.push(py.detach(|| match &pool {
            None => work(first, number),
            Some(pool) => pool.install(|| work(first, number)),
        }));
        py.check_signals()?;
        first += number;
    }
    Ok(found)
}
