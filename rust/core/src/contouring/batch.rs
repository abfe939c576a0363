//! Many simulations in one call, and the figures that sum each of them up.

use rayon::prelude::*;

use super::interpolator::{Feed, Reference};
use super::path::Path;
use super::simulation::{Coupling, Sample, Simulation, samples};
use super::{Axis, Feedback};
use crate::error::Result;
use crate::machine::FiveAxis;

/// One simulation of a sweep.
#[derive(Clone, Debug)]
pub struct Case {
    /// Which of the paths.
    pub path: usize,
    /// Feed.
    pub feed: Feed,
    /// Control period, s.
    pub period: f64,
    /// Axes.
    pub axes: [Axis; 5],
    /// Where the loops are closed.
    pub feedback: Feedback,
    /// Cross-coupling, or None for independent axes.
    pub coupling: Option<Coupling>,
}

/// Figures of one simulation: mm and rad; infinite where the loop diverged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Number of control steps.
    pub steps: usize,
    /// Whether the loop diverged.
    pub diverged: bool,
    /// Largest true contour error.
    pub contour_max: f64,
    /// Its root mean square.
    pub contour_rms: f64,
    /// Largest true tool-orientation error.
    pub orientation_max: f64,
    /// Its root mean square.
    pub orientation_rms: f64,
    /// Largest distance from the reference sample.
    pub following_max: f64,
    /// Largest error of the foot point by circle and by tangent line.
    pub circle_max: f64,
    /// See `circle_max`.
    pub tangent_max: f64,
    /// Largest error of the tool axis by the proposed model and by the tangent line.
    pub proposed_max: f64,
    /// See `proposed_max`.
    pub tangent_axis_max: f64,
}

impl Figures {
    const DIVERGED: Self = Self {
        steps: 0,
        diverged: true,
        contour_max: f64::INFINITY,
        contour_rms: f64::INFINITY,
        orientation_max: f64::INFINITY,
        orientation_rms: f64::INFINITY,
        following_max: f64::INFINITY,
        circle_max: f64::INFINITY,
        tangent_max: f64::INFINITY,
        proposed_max: f64::INFINITY,
        tangent_axis_max: f64::INFINITY,
    };
}

/// Runs one case.
///
/// # Errors
/// As [`Reference::new`] and [`Simulation::run`].
pub fn figures(
    paths: &[Path],
    case: &Case,
    machine: &FiveAxis,
    real: &FiveAxis,
) -> Result<Figures> {
    let path = paths.get(case.path).ok_or_else(|| {
        crate::Error::input("path of a case", case.path, format!("below {}", paths.len()))
    })?;
    let reference = Reference::new(path, case.feed, case.period, machine)?;
    let simulation = Simulation {
        reference: &reference,
        axes: case.axes,
        feedback: case.feedback,
        coupling: case.coupling,
        machine,
    };
    let run = simulation.run()?;
    if run.diverged {
        return Ok(Figures { steps: run.axes.len(), ..Figures::DIVERGED });
    }
    let mut out = Figures {
        steps: run.axes.len(),
        diverged: false,
        contour_max: 0.0,
        contour_rms: 0.0,
        orientation_max: 0.0,
        orientation_rms: 0.0,
        following_max: 0.0,
        circle_max: 0.0,
        tangent_max: 0.0,
        proposed_max: 0.0,
        tangent_axis_max: 0.0,
    };
    for sample in samples(path, &reference, machine, real, &run.axes) {
        let Sample { truth, proposed, tangent } = sample;
        let contour = truth.contour.norm();
        out.contour_max = out.contour_max.max(contour);
        out.contour_rms += contour * contour;
        out.orientation_max = out.orientation_max.max(truth.orientation);
        out.orientation_rms += truth.orientation * truth.orientation;
        out.following_max = out.following_max.max(truth.following);
        out.circle_max = out.circle_max.max(proposed[0]);
        out.proposed_max = out.proposed_max.max(proposed[1]);
        out.tangent_max = out.tangent_max.max(tangent[0]);
        out.tangent_axis_max = out.tangent_axis_max.max(tangent[1]);
    }
    let n = out.steps.max(1) as f64;
    out.contour_rms = (out.contour_rms / n).sqrt();
    out.orientation_rms = (out.orientation_rms / n).sqrt();
    Ok(out)
}

/// Runs all cases, on all cores, in the order given.
///
/// # Errors
/// The first error of any case.
pub fn sweep(
    paths: &[Path],
    cases: &[Case],
    machine: &FiveAxis,
    real: &FiveAxis,
) -> Result<Vec<Figures>> {
    cases.par_iter().map(|case| figures(paths, case, machine, real)).collect()
}
