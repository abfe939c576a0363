//! User units: µm, arcsec, ppm, degrees and mm/min of the Python API to mm, rad and s of the core, and
//! back. Anything longer than a factor at its place in the binding stands here.
//!
//! | file | what it converts |
//! |---|---|
//! | `touches` | moves, parameter values, fits, samples of studies |
//! | `contouring` | axes, feeds, columns and figures of a simulation |
//! | `hybrid` | joints, errors and rates of the hybrid machine |

pub mod contouring;
pub mod hybrid;
pub mod touches;

use trunnion_core::machine::{LocationError, Machine, Places};
use trunnion_core::{Error, Result};

/// Location errors by name, µm and arcsec, in mm and rad.
pub fn location_errors(
    machine: &Machine,
    errors: &[(String, f64)],
) -> Result<Vec<(LocationError, f64)>> {
    errors
        .iter()
        .map(|(name, value)| {
            let error = machine.location_error(name)?;
            if !value.is_finite() {
                return Err(Error::input(name.as_str(), value, "a finite number"));
            }
            Ok((error, value * error.unit().to_internal()))
        })
        .collect()
}

/// Location errors by name, µm and arcsec, as amounts at places.
pub fn places(machine: &Machine, errors: &[(String, f64)]) -> Result<Places> {
    let mut places = machine.nominal();
    for (error, amount) in location_errors(machine, errors)? {
        machine.add_location_error(&mut places, &error, amount);
    }
    Ok(places)
}
