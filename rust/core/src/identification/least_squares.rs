//! Least squares on touches of any plan: Gauss–Newton on the exact model.
//!
//! Residuals are recorded minus modelled coordinates along the approach. Columns are scaled to unit
//! length before anything is decided about rank, so that µm and arcsec compare. A combination of
//! parameters that the touches do not identify keeps its start value and has no standard error; which
//! parameters it touches is reported by [`Fit::not_identifiable`].

use rayon::prelude::*;

pub use super::options::{Fit, Loss, Options, Prior, Row};
pub use super::workspace::Workspace;
pub use crate::linear::RANK_TOLERANCE;
use crate::moves::Moves;
use crate::touch::TouchModel;
use crate::{Error, Result};

/// Fits all parameters of the model from `start` (mm, rad, s).
///
/// # Errors
/// Wrong or useless input, fewer readings than parameters, touches off the modelled surface.
pub fn fit(model: &TouchModel, moves: &Moves, start: &[f64], options: &Options) -> Result<Fit> {
    check(model, moves, start, options)?;
    let mut workspace = Workspace::new(model, moves.len());
    let descent = workspace.run(model, moves, start, options)?;
    Ok(workspace.report(descent, options))
}

/// Estimates from many measurements, mm, rad, s, one row each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// Estimates, m × p.
    pub values: Vec<f64>,
    /// Standard errors, m × p; infinite for what is not identifiable.
    pub std_errors: Vec<f64>,
    /// Whether the last step was within rounding, m.
    pub converged: Vec<bool>,
}

impl Estimates {
    /// Room for `samples` measurements, not numbers as yet.
    #[must_use]
    pub fn room(samples: usize, parameters: usize) -> Self {
        Self {
            values: vec![f64::NAN; samples * parameters],
            std_errors: vec![f64::NAN; samples * parameters],
            converged: vec![false; samples],
        }
    }
}

/// Fits many measurements of one plan: `points` holds m × n × 3 recorded positions, `starts` one
/// vector for all. Runs on rayon's threads; the numbers do not depend on how many.
///
/// # Errors
/// As [`fit`], for the first measurement that fails.
pub fn fit_many(
    model: &TouchModel,
    moves: &Moves,
    points: &[f64],
    start: &[f64],
    options: &Options,
) -> Result<Estimates> {
    let n = moves.len();
    if n == 0 || !points.len().is_multiple_of(3 * n) {
        return Err(Error::input("points", points.len(), format!("a multiple of {}", 3 * n)));
    }
    check(model, moves, start, options)?;
    let p = model.parameter_count();
    let mut estimates = Estimates::room(points.len() / (3 * n), p);
    points
        .par_chunks_exact(3 * n)
        .zip(estimates.values.par_chunks_exact_mut(p))
        .zip(estimates.std_errors.par_chunks_exact_mut(p))
        .zip(estimates.converged.par_iter_mut())
        .try_for_each_init(
            || Workspace::new(model, n),
            |workspace, (((point, values), std_errors), converged)| {
                let measured = Moves { point, ..*moves };
                let row = Row { values, std_errors, converged };
                workspace.estimate(model, &measured, start, options, row)
            },
        )?;
    Ok(estimates)
}

/// Largest standard deviation of a reading, mm.
const MAX_SIGMA_MM: f64 = 1e3;

/// Largest ratio of a prior's uncertainty to that of a reading, and of its value to its uncertainty.
const MAX_WEIGHT: f64 = 1e12;

/// Checks what all measurements of one plan have in common.
///
/// # Errors
/// Wrong or useless input, fewer readings than parameters.
pub fn check(model: &TouchModel, moves: &Moves, start: &[f64], options: &Options) -> Result<()> {
    model.check(moves)?;
    let p = model.parameter_count();
    if start.len() != p {
        return Err(Error::input("start values", start.len(), format!("{p} of them")));
    }
    let known = moves.len() + options.priors.len();
    if known < p {
        return Err(Error::Data(format!(
            "got {} touches and {} priors for {p} parameters; expected at least as many as parameters",
            moves.len(),
            options.priors.len()
        )));
    }
    if !(0.0..=MAX_SIGMA_MM).contains(&options.sigma) {
        let expected = format!("0 to {MAX_SIGMA_MM}");
        return Err(Error::input("standard deviation, mm", options.sigma, expected));
    }
    if let Loss::Huber(limit) = options.loss
        && !(limit.is_finite() && limit > 0.0)
    {
        return Err(Error::input("limit of Huber's loss", limit, "finite and above 0"));
    }
    if !options.priors.is_empty() && options.sigma <= 0.0 {
        return Err(Error::input(
            "priors",
            "no standard deviation of the probe",
            "probe.repeatability_um > 0: priors are weighed against it",
        ));
    }
    for prior in &options.priors {
        let share = prior.sigma / options.sigma;
        let weighs = (1.0 / MAX_WEIGHT..=MAX_WEIGHT).contains(&share);
        if !weighs || prior.mean.abs() > MAX_WEIGHT * prior.sigma {
            let got = format!("{:e} ± {:e}", prior.mean, prior.sigma);
            let expected = format!("an uncertainty within {MAX_WEIGHT:e} times the probe's");
            return Err(Error::input("prior, mm or rad", got, expected));
        }
    }
    Ok(())
}
