//! What a fit is asked for and what it answers.

use crate::touch::TouchModel;
use crate::units::UM;

/// How residuals count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Squares.
    Squares,
    /// Huber's: squares up to this many standard deviations, then straight on. The standard
    /// deviation is taken from the median of the absolute residuals.
    Huber(f64),
}

/// What is known of a parameter beforehand, mm or rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Number of the parameter.
    pub parameter: usize,
    /// Its expected value.
    pub mean: f64,
    /// Standard uncertainty of that.
    pub sigma: f64,
}

/// Options of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How residuals count.
    pub loss: Loss,
    /// Standard deviation of one reading, mm; 0: taken from the residuals. Priors need it.
    pub sigma: f64,
    /// What is known beforehand.
    pub priors: Vec<Prior>,
    /// Most Gauss–Newton steps.
    pub max_steps: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Squares, sigma: 0.0, priors: Vec::new(), max_steps: 50 }
    }
}

/// Result of a fit, mm and rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Estimates, in the model's order.
    pub values: Vec<f64>,
    /// (JᵀWJ)⁻¹ on what can be seen, p × p row-major: times σ² it is the covariance.
    pub cofactor: Vec<f64>,
    /// Whether each parameter takes part in a combination that cannot be seen.
    pub unseen: Vec<bool>,
    /// Directions that cannot be seen, one row of p each: steps of the parameters (mm, rad).
    pub null_space: Vec<f64>,
    /// Singular values of the scaled Jacobian, largest first.
    pub singular_values: Vec<f64>,
    /// Recorded minus modelled coordinate along the approach.
    pub residuals: Vec<f64>,
    /// Weight of each reading, 1 unless the loss lowers it.
    pub weights: Vec<f64>,
    /// Standard deviation of one reading: the given one, or from the residuals.
    pub sigma: f64,
    /// Readings minus parameters that could be determined.
    pub degrees_of_freedom: usize,
    /// Whether the last step was within rounding.
    pub converged: bool,
    /// Gauss–Newton steps made.
    pub steps: usize,
}

/// Where [`super::workspace::Workspace::estimate`] writes one measurement's estimates.
pub struct Row<'a> {
    /// Estimates, face units.
    pub values: &'a mut [f64],
    /// Standard errors, face units.
    pub std_errors: &'a mut [f64],
    /// Whether the fit converged.
    pub converged: &'a mut bool,
}

/// A fit in the face's units: µm, arcsec, ppm, ...
#[derive(Clone, Debug, PartialEq)]
pub struct FaceFit {
    /// Estimates.
    pub values: Vec<f64>,
    /// Standard errors; infinite for what cannot be seen.
    pub std_errors: Vec<f64>,
    /// Covariance of what can be seen, p × p row-major.
    pub covariance: Vec<f64>,
    /// Residuals in µm.
    pub residuals_um: Vec<f64>,
    /// Standard deviation of one reading in µm.
    pub sigma_um: f64,
    /// Combinations that cannot be seen, in the parameters' own units, one row of p each, largest
    /// component 1.
    pub null_space: Vec<f64>,
}

impl Fit {
    /// The fit in the units of the model's parameters.
    #[must_use]
    pub fn to_face(&self, model: &TouchModel) -> FaceFit {
        let units = model.units();
        let p = units.len();
        let variance = self.sigma * self.sigma;
        let mut covariance = self.cofactor.clone();
        for i in 0..p {
            for j in 0..p {
                covariance[i * p + j] *= variance / (units[i] * units[j]);
            }
        }
        let std_errors = (0..p)
            .map(|i| if self.unseen[i] { f64::INFINITY } else { covariance[i * p + i].sqrt() })
            .collect();
        let scale = |row: &[f64]| {
            let row: Vec<f64> = row.iter().zip(units).map(|(v, unit)| v / unit).collect();
            let largest =
                row.iter().fold(0.0_f64, |most, v| if v.abs() > most.abs() { *v } else { most });
            row.into_iter().map(move |v| v / largest)
        };
        FaceFit {
            values: self.values.iter().zip(units).map(|(value, unit)| value / unit).collect(),
            std_errors,
            covariance,
            residuals_um: self.residuals.iter().map(|r| r / UM).collect(),
            sigma_um: self.sigma / UM,
            null_space: self.null_space.chunks_exact(p).flat_map(scale).collect(),
        }
    }
}
