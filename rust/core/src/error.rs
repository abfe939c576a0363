//! What can go wrong, said once for the whole core. A message says what, got what, expected what.

/// An error of the core. Each variant becomes one Python exception in the binding.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A value the caller gave is not usable.
    #[error("{what}: got {got}, expected {expected}")]
    Input {
        /// The quantity, with its place (row, parameter).
        what: String,
        /// What was given.
        got: String,
        /// What would have been right.
        expected: String,
    },
    /// A name that is in no list.
    #[error("unknown {kind} {got:?}; expected one of: {known}")]
    Unknown {
        /// Kind of thing named: effect, machine preset, location error.
        kind: &'static str,
        /// The name given.
        got: String,
        /// The names there are, separated by commas.
        known: String,
    },
    /// Measured data that cannot belong to the model.
    #[error("{0}")]
    Data(String),
    /// A pose that the machine or mechanism cannot take.
    #[error("{0}")]
    Kinematics(String),
    /// A program that cannot be read or cut.
    #[error("line {line}, column {column}: {message}")]
    Program {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What stood there and what was expected.
        message: String,
    },
}

/// Result of the core.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Input`] from anything printable.
    pub fn input(what: impl Into<String>, got: impl ToString, expected: impl Into<String>) -> Self {
        Self::Input { what: what.into(), got: short(&got.to_string()), expected: expected.into() }
    }

    /// An [`Error::Unknown`] that lists the names there are.
    pub fn unknown<'a>(
        kind: &'static str,
        got: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        let known = known.into_iter().collect::<Vec<_>>().join(", ");
        Self::Unknown { kind, got: got.to_owned(), known }
    }
}

/// What a message shows of a value: numbers of hundreds of digits with an exponent.
fn short(got: &str) -> String {
    match got.parse::<f64>() {
        Ok(number) if got.len() > 20 => format!("{number:e}"),
        _ => got.to_owned(),
    }
}
