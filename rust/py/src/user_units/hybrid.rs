//! The hybrid machine: mm and degrees for joints, µm and arcsec for errors.

use rayon::prelude::*;
use trunnion_core::hybrid::batch::{FORWARD_COLUMNS, SENSITIVITY_ROWS};
use trunnion_core::hybrid::{ACTIVE, ERRORS, PASSIVE, Parameter};
use trunnion_core::units::{ARCSEC, DEG, UM};
use trunnion_core::{Error, Result};

/// Errors by name, µm and arcsec, in mm and rad.
///
/// # Errors
/// An unknown name, or a value that is not finite.
pub fn errors(named: &[(String, f64)]) -> Result<Vec<(Parameter, f64)>> {
    named
        .iter()
        .map(|(name, value)| {
            let parameter = Parameter::parse(name)?;
            if !value.is_finite() {
                return Err(Error::input(format!("error {name}"), value, "a finite number"));
            }
            Ok((parameter, value * parameter.unit().to_internal()))
        })
        .collect()
}

/// Nominal e1 to e17, with e16 and e17 from degrees.
pub fn dimensions(mut dimensions: [f64; ERRORS]) -> [f64; ERRORS] {
    dimensions[15] *= DEG;
    dimensions[16] *= DEG;
    dimensions
}

/// Rows of joints L1, L2, L3 (mm), q4, q5, these from degrees.
pub fn joints(rows: &[f64]) -> Vec<f64> {
    let mut rows = rows.to_vec();
    for row in rows.chunks_exact_mut(ACTIVE) {
        row[3] *= DEG;
        row[4] *= DEG;
    }
    rows
}

/// Rows of commands L1, L2, L3 (mm), q4, q5 to degrees, and a flag.
pub fn commands(mut rows: Vec<f64>) -> Vec<f64> {
    for row in rows.chunks_exact_mut(ACTIVE + 1) {
        row[3] /= DEG;
        row[4] /= DEG;
    }
    rows
}

fn residual(row: usize) -> f64 {
    if row % 5 < 3 { UM } else { ARCSEC }
}

fn forward_row(row: &mut [f64]) {
    row[6..6 + PASSIVE].iter_mut().for_each(|angle| *angle /= DEG);
    for (i, value) in row[6 + PASSIVE..FORWARD_COLUMNS - 2].iter_mut().enumerate() {
        *value /= residual(i);
    }
}

fn units(parameters: &[Parameter]) -> Vec<f64> {
    parameters.iter().map(|parameter| parameter.unit().to_internal()).collect()
}

/// Forward solutions: degrees, µm, arcsec.
pub fn forward(mut rows: Vec<f64>) -> Vec<f64> {
    rows.par_chunks_exact_mut(FORWARD_COLUMNS).for_each(forward_row);
    rows
}

/// Forward solutions and sensitivities: µm and arcsec per user unit of each parameter.
pub fn sensitivity(mut rows: Vec<f64>, parameters: &[Parameter]) -> Vec<f64> {
    let units = units(parameters);
    let k = units.len();
    let width = FORWARD_COLUMNS + SENSITIVITY_ROWS * k;
    rows.par_chunks_exact_mut(width).for_each(|row| {
        let (forward, rates) = row.split_at_mut(FORWARD_COLUMNS);
        forward_row(forward);
        for (i, rates) in rates.chunks_exact_mut(k.max(1)).enumerate() {
            // Point and turn of the whole, point and turn of the serial part, passive joints.
            let small = if matches!(i, 0..3 | 6..9) { UM } else { ARCSEC };
            rates.iter_mut().zip(&units).for_each(|(rate, unit)| *rate *= unit / small);
        }
    });
    rows
}

/// Strain of the loops: µm and arcsec per user unit of each parameter.
pub fn strain(mut rows: Vec<f64>, parameters: &[Parameter]) -> Vec<f64> {
    let units = units(parameters);
    let k = units.len();
    rows.par_chunks_exact_mut((10 * k).max(1)).for_each(|row| {
        for (i, rates) in row.chunks_exact_mut(k).enumerate() {
            let small = residual(i);
            rates.iter_mut().zip(&units).for_each(|(rate, unit)| *rate = *rate / small * unit);
        }
    });
    rows
}

/// Ball-bar readings: length (mm), direction (3), gradient in µm per user unit of each parameter.
pub fn ballbar(mut rows: Vec<f64>, parameters: &[Parameter]) -> Vec<f64> {
    let units = units(parameters);
    rows.par_chunks_exact_mut(4 + units.len()).for_each(|row| {
        row[4..].iter_mut().zip(&units).for_each(|(rate, unit)| *rate *= unit / UM);
    });
    rows
}
