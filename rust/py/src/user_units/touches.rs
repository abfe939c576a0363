//! Touches: moves, parameter values, fits, samples of studies.

use trunnion_core::Result;
use trunnion_core::identification::least_squares::{Estimates, Fit};
use trunnion_core::moves::MoveTable;
use trunnion_core::studies::Samples;
use trunnion_core::touch::TouchModel;
use trunnion_core::units::{DEG, MM_PER_MIN, UM};

/// Moves from degrees, mm, mm/min and s; row-major, `axes` rotary positions a row.
///
/// # Errors
/// As [`MoveTable::new`].
pub fn moves(
    axes: usize,
    rotary_deg: Vec<f64>,
    point_mm: Vec<f64>,
    direction: Vec<f64>,
    feed_mm_min: Option<Vec<f64>>,
    time_s: Option<Vec<f64>>,
    sense: Option<Vec<f64>>,
) -> Result<MoveTable> {
    let scaled = |values: Vec<f64>, unit: f64| values.into_iter().map(|v| v * unit).collect();
    let feed = feed_mm_min.map(|feed| scaled(feed, MM_PER_MIN));
    MoveTable::new(axes, scaled(rotary_deg, DEG), point_mm, direction, feed, time_s, sense)
}

/// What one user unit of each parameter is in mm, rad, s.
pub struct ParameterUnits(Vec<f64>);

impl ParameterUnits {
    /// Those of a model.
    pub fn of(model: &TouchModel) -> Self {
        Self(model.parameter_names().iter().map(|name| name.unit.to_internal()).collect())
    }

    /// The units.
    pub fn all(&self) -> &[f64] {
        &self.0
    }

    /// Rows of parameter values in mm, rad, s.
    pub fn to_core(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(self.0.iter().cycle()).map(|(value, unit)| value * unit).collect()
    }

    /// Values of one model in mm, rad, s.
    ///
    /// # Errors
    /// As [`TouchModel::check_values`].
    pub fn checked(&self, model: &TouchModel, values: &[f64]) -> Result<Vec<f64>> {
        let values = self.to_core(values);
        model.check_values(&values)?;
        Ok(values)
    }

    /// Values of the first parameters in user units.
    pub fn to_user(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.0).map(|(value, unit)| value / unit).collect()
    }

    fn in_place(&self, values: &mut [f64]) {
        values.iter_mut().zip(self.0.iter().cycle()).for_each(|(value, unit)| *value /= unit);
    }

    /// Rows of a linear map from readings in mm: user units per µm.
    pub fn operator(&self, mut operator: Vec<f64>, readings: usize) -> Vec<f64> {
        for (row, unit) in operator.chunks_exact_mut(readings).zip(&self.0) {
            row.iter_mut().for_each(|value| *value *= UM / unit);
        }
        operator
    }

    /// Estimates and standard errors of many measurements.
    pub fn estimates(&self, mut estimates: Estimates) -> Estimates {
        self.in_place(&mut estimates.values);
        self.in_place(&mut estimates.std_errors);
        estimates
    }

    /// Rows of [`trunnion_core::studies::calibrations`]: runs of parameters, then what has no unit.
    pub fn calibrations(&self, mut samples: Samples, runs: &[usize]) -> Samples {
        for row in samples.rows.chunks_exact_mut(samples.width) {
            let mut rest = row;
            for &run in runs {
                let (values, behind) = std::mem::take(&mut rest).split_at_mut(run);
                self.in_place(values);
                rest = behind;
            }
        }
        samples
    }

    /// A fit.
    pub fn fit(&self, fit: &Fit) -> UserFit {
        let p = self.0.len();
        let variance = fit.sigma * fit.sigma;
        let mut covariance = fit.cofactor.clone();
        for i in 0..p {
            for j in 0..p {
                covariance[i * p + j] *= variance / (self.0[i] * self.0[j]);
            }
        }
        let std_errors =
            (0..p)
                .map(|i| {
                    if fit.not_identifiable[i] {
                        f64::INFINITY
                    } else {
                        covariance[i * p + i].sqrt()
                    }
                })
                .collect();
        let null_space = fit.null_space.chunks_exact(p).flat_map(|row| self.combination(row));
        UserFit {
            values: self.to_user(&fit.values),
            std_errors,
            covariance,
            residuals_um: fit.residuals.iter().map(|r| r / UM).collect(),
            sigma_um: fit.sigma / UM,
            null_space: null_space.collect(),
        }
    }

    /// A combination of parameters in their own units, largest component 1.
    fn combination(&self, row: &[f64]) -> Vec<f64> {
        let row = self.to_user(row);
        let largest =
            row.iter().fold(0.0_f64, |most, v| if v.abs() > most.abs() { *v } else { most });
        row.into_iter().map(|v| v / largest).collect()
    }
}

/// A fit in user units.
pub struct UserFit {
    /// Estimates.
    pub values: Vec<f64>,
    /// Standard errors; infinite for what is not identifiable.
    pub std_errors: Vec<f64>,
    /// Covariance of what is identifiable, p × p row-major.
    pub covariance: Vec<f64>,
    /// Residuals in µm.
    pub residuals_um: Vec<f64>,
    /// Standard deviation of one reading in µm.
    pub sigma_um: f64,
    /// Combinations that are not identifiable, one row of p each, largest component 1.
    pub null_space: Vec<f64>,
}
