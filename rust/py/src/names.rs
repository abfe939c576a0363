//! Names that stand for one of a few choices.

use trunnion_core::{Error, Result};

/// The choice that `name` stands for.
///
/// # Errors
/// [`Error::Unknown`] with the names there are.
pub fn choice<T: Copy>(what: &'static str, name: &str, choices: &[(&str, T)]) -> Result<T> {
    let found = choices.iter().find(|(known, _)| *known == name);
    found
        .map(|(_, choice)| *choice)
        .ok_or_else(|| Error::unknown(what, name, choices.iter().map(|(known, _)| *known)))
}
