//! The one place where errors of the core become Python exceptions.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use trunnion_core::Error;

/// The exception class of `trunnion.base.errors` for each variant.
fn class(error: &Error) -> &'static str {
    match error {
        Error::Input { .. } => "InputError",
        Error::Unknown { .. } => "UnknownNameError",
        Error::Data(_) => "DataError",
        Error::Kinematics(_) => "KinematicsError",
        Error::Program { .. } => "ProgramError",
    }
}

/// The Python exception for an error of the core.
pub fn to_py(error: &Error) -> PyErr {
    Python::attach(|py| {
        let build = || -> PyResult<PyErr> {
            let exception = py.import("trunnion.base.errors")?.getattr(class(error))?;
            let mut message = error.to_string();
            if let Error::Unknown { got, known, .. } = error {
                let known: Vec<&str> = known.split(", ").collect();
                let checks = py.import("trunnion.base.checks")?;
                let near = checks.getattr("did_you_mean")?.call1((got, known))?;
                message += near.extract::<&str>()?;
            }
            Ok(PyErr::from_value(exception.call1((message,))?))
        };
        build().unwrap_or_else(|import| PyRuntimeError::new_err(format!("{error} ({import})")))
    })
}

/// `?` on results of the core inside binding functions.
pub trait IntoPy<T> {
    /// Maps the core's error to its Python exception.
    fn into_py(self) -> PyResult<T>;
}

impl<T> IntoPy<T> for trunnion_core::Result<T> {
    fn into_py(self) -> PyResult<T> {
        self.map_err(|error| to_py(&error))
    }
}
