//! What a fit is asked for and what it answers.

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
    /// Least standard deviation that is taken from residuals, mm: that of the errors of rounding.
    pub floor: f64,
    /// What is known beforehand.
    pub priors: Vec<Prior>,
    /// Most Gauss–Newton steps.
    pub max_steps: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Squares, sigma: 0.0, floor: 0.0, priors: Vec::new(), max_steps: 50 }
    }
}

/// Result of a fit, mm and rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Estimates, in the model's order.
    pub values: Vec<f64>,
    /// (JᵀWJ)⁻¹ on what is identifiable, p × p row-major: times σ² it is the covariance.
    pub cofactor: Vec<f64>,
    /// Whether each parameter takes part in a combination that is not identifiable.
    pub not_identifiable: Vec<bool>,
    /// Directions that are not identifiable, one row of p each: steps of the parameters (mm, rad).
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

impl Fit {
    /// Standard errors, mm, rad, s; infinite for what is not identifiable.
    #[must_use]
    pub fn std_errors(&self) -> Vec<f64> {
        let p = self.values.len();
        let finite = |i: usize| self.sigma * self.cofactor[i * p + i].sqrt();
        (0..p).map(|i| if self.not_identifiable[i] { f64::INFINITY } else { finite(i) }).collect()
    }
}

/// Where [`super::workspace::Workspace::estimate`] writes one measurement's estimates.
pub struct Row<'a> {
    /// Estimates, mm, rad, s.
    pub values: &'a mut [f64],
    /// Standard errors, mm, rad, s; infinite for what is not identifiable.
    pub std_errors: &'a mut [f64],
    /// Whether the fit converged.
    pub converged: &'a mut bool,
}
