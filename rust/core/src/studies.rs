//! Many virtual measurements at once: the whole of simulate and estimate, and what compensation with
//! the estimates leaves, on all cores.
//!
//! Sample number i depends on the seed and on i alone, so that numbers do not depend on how many
//! threads there are or in which pieces the samples are asked for.

use rayon::prelude::*;

use crate::compensation::Model;
use crate::compensation::volumetric::{Control, ControlledPose, Volume};
use crate::identification::closed_form::{self, COUNT, ERRORS, PaperRows, Scratch};
use crate::identification::least_squares::{self, Options, Row, Workspace};
use crate::machine::MAX_ROTARY;
use crate::moves::Moves;
use crate::touch::{Simulation, TouchModel};
use crate::{Error, Result};

/// What all samples of a call share: the paper's plan on the plain model.
#[derive(Clone, Copy, Debug)]
pub struct Measurement<'a> {
    /// The plain model, without effects.
    pub model: &'a TouchModel,
    /// The moves of the plan.
    pub moves: &'a Moves<'a>,
    /// Their labels in the paper.
    pub labels: &'a [i64],
    /// Noise and seed.
    pub simulation: Simulation,
    /// Number of the first sample of this call.
    pub first_sample: u64,
}

/// Samples, mm and rad.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One row of `width` a sample; not numbers in samples that failed.
    pub rows: Vec<f64>,
    /// Numbers in a row.
    pub width: usize,
    /// Samples that failed, in order: counted from the first of this call, and why.
    pub failures: Vec<(usize, Error)>,
}

/// Numbers in a row of [`calibrations`] without least squares.
pub const CLOSED: usize = COUNT + ERRORS;
/// Numbers in a row of [`calibrations`] with least squares.
pub const IDENTIFIED: usize = CLOSED + 2 * COUNT + 1;
/// Numbers in a row of [`compensations`].
pub const VOLUMES: usize = 4;

/// Which estimates the control is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Closed forms that separate errors from placement.
    Separating,
    /// The paper's printed equations.
    Printed,
    /// Least squares.
    Identified,
}

/// What one thread needs for its samples.
struct Bench {
    travel: Vec<f64>,
    points: Vec<f64>,
    scratch: Scratch,
    workspace: Workspace,
}

impl Bench {
    fn new(model: &TouchModel, n: usize) -> Self {
        Self {
            travel: vec![0.0; n],
            points: vec![0.0; 3 * n],
            scratch: Scratch::default(),
            workspace: Workspace::new(model, n),
        }
    }

    /// Least squares from zero, and standard errors; whether they converged.
    fn identify(
        workspace: &mut Workspace,
        model: &TouchModel,
        measured: &Moves,
        options: &Options,
        values: &mut [f64],
        std_errors: &mut [f64],
    ) -> Result<bool> {
        let mut converged = false;
        let row = Row { values, std_errors, converged: &mut converged };
        workspace.estimate(model, measured, &[0.0; COUNT], options, row)?;
        Ok(converged)
    }
}

impl Measurement<'_> {
    /// Finds the paper's touches, and refuses what no sample could do with.
    fn check(&self, options: &Options) -> Result<PaperRows> {
        let paper = PaperRows::find(self.model, self.moves, self.labels)?;
        let p = self.model.parameter_count();
        if p != COUNT {
            let got = format!("{p} parameters");
            return Err(Error::input("calibrations", got, format!("the plain model's {COUNT}")));
        }
        least_squares::check(self.model, self.moves, &[0.0; COUNT], options)?;
        Ok(paper)
    }

    /// Simulates sample number `index` of this call; `values` are the truth in mm and rad.
    fn take<'b>(
        &'b self,
        index: usize,
        values: &[f64],
        travel: &mut [f64],
        points: &'b mut [f64],
    ) -> Result<Moves<'b>> {
        let moves = self.moves;
        let sample = self.first_sample + index as u64;
        self.model.simulate(moves, values, &self.simulation, sample, travel)?;
        let starts = moves.point.chunks_exact(3).zip(moves.direction.chunks_exact(3));
        let recorded = points.chunks_exact_mut(3).zip(travel.iter());
        for ((point, travelled), (start, direction)) in recorded.zip(starts) {
            for k in 0..3 {
                point[k] = start[k] + travelled * direction[k];
            }
        }
        Ok(Moves { point: points, ..*moves })
    }
}

/// Does `run` with every truth (of `COUNT` numbers) and its row of `width`, on all cores.
fn samples<B>(
    truths: &[f64],
    width: usize,
    bench: impl Fn() -> B + Send + Sync,
    run: impl Fn(&mut B, usize, &[f64], &mut [f64]) -> Result<()> + Send + Sync,
) -> Samples {
    let mut rows = vec![f64::NAN; truths.len() / COUNT * width];
    let failures = rows
        .par_chunks_exact_mut(width)
        .zip(truths.par_chunks_exact(COUNT))
        .enumerate()
        .map_init(bench, |bench, (index, (row, truth))| {
            run(bench, index, truth, row).err().map(|error| {
                row.fill(f64::NAN);
                (index, error)
            })
        })
        .flatten()
        .collect();
    Samples { rows, width, failures }
}

/// For every row of `truths` (m × 14, mm and rad) simulates the plan and takes both closed forms,
/// and with `identify` least squares as well, all of which start from zero.
///
/// A row holds eight location errors and six placement parameters by the separating forms; eight
/// location errors by the printed forms; then, with `identify`, the fourteen estimates, their
/// standard errors, and 1 where they converged.
///
/// # Errors
/// What no sample could do with: another plan than the paper's, effects in the model. What fails in
/// single samples is reported in [`Samples::failures`].
pub fn calibrations(
    measurement: &Measurement,
    truths: &[f64],
    identify: Option<&Options>,
) -> Result<Samples> {
    let paper = measurement.check(identify.unwrap_or(&Options::default()))?;
    let model = measurement.model;
    let width = if identify.is_some() { IDENTIFIED } else { CLOSED };
    let run = |bench: &mut Bench, index: usize, truth: &[f64], row: &mut [f64]| -> Result<()> {
        let Bench { travel, points, scratch, workspace } = bench;
        model.check_values(truth)?;
        let measured = measurement.take(index, truth, travel, points)?;
        let separated = closed_form::separate(model, &paper, &measured, &[0.0; COUNT], scratch)?;
        let printed = closed_form::printed(model, &paper, &measured);
        let (closed, rest) = row.split_at_mut(CLOSED);
        let (by_separating, by_printed) = closed.split_at_mut(COUNT);
        if let Some(options) = identify {
            let (values, rest) = rest.split_at_mut(COUNT);
            let (std_errors, end) = rest.split_at_mut(COUNT);
            let converged =
                Bench::identify(workspace, model, &measured, options, values, std_errors)?;
            end.fill(f64::from(u8::from(converged)));
        }
        by_separating.copy_from_slice(&separated.values);
        by_printed.copy_from_slice(&printed.errors);
        Ok(())
    };
    Ok(samples(truths, width, || Bench::new(model, measurement.moves.len()), run))
}

/// For every row of `truths` (m × 14, mm and rad) simulates the plan, estimates the location errors
/// by `method`, and compares the volumetric error of the machine, with the rotary axes at `rotary`
/// (rad), under a control that assumes the nominal machine and under one that assumes the
/// estimates: exact compensation by the linear axes.
///
/// A row holds largest and root mean square before, largest and root mean square left, mm.
///
/// # Errors
/// As [`calibrations`], and another number of rotary positions than axes.
pub fn compensations(
    measurement: &Measurement,
    truths: &[f64],
    method: Method,
    volume: &Volume,
    rotary: &[f64],
) -> Result<Samples> {
    let options = Options::default();
    let paper = measurement.check(&options)?;
    let model = measurement.model;
    let axes = model.machine().rotary().len();
    if rotary.len() != axes {
        return Err(Error::input("rotary positions", rotary.len(), axes.to_string()));
    }
    let nominal = Model::nominal(model.machine().clone());
    let unaware = Control { model: nominal.clone(), zeros: [0.0; MAX_ROTARY] };
    let bench = || (Bench::new(model, measurement.moves.len()), nominal.clone(), unaware.clone());
    type Room = (Bench, Model, Control);
    let run = |room: &mut Room, index: usize, truth: &[f64], row: &mut [f64]| -> Result<()> {
        let (Bench { travel, points, scratch, workspace }, machine, control) = room;
        model.check_values(truth)?;
        let measured = measurement.take(index, truth, travel, points)?;
        let mut estimates = [0.0; COUNT];
        match method {
            Method::Separating => {
                let start = [0.0; COUNT];
                estimates =
                    closed_form::separate(model, &paper, &measured, &start, scratch)?.values;
            }
            Method::Printed => {
                let printed = closed_form::printed(model, &paper, &measured);
                estimates[..ERRORS].copy_from_slice(&printed.errors);
            }
            Method::Identified => {
                let mut std_errors = [0.0; COUNT];
                let found = &mut estimates;
                Bench::identify(workspace, model, &measured, &options, found, &mut std_errors)?;
            }
        }
        machine.set_errors(&truth[..ERRORS])?;
        control.model.set_errors(&estimates[..ERRORS])?;
        for (slots, assumed) in row.chunks_exact_mut(2).zip([&unaware, control]) {
            let error = ControlledPose::new(machine, assumed, rotary)?.error();
            slots[0] = volume.largest(&error);
            slots[1] = volume.mean_square(&error).sqrt();
        }
        Ok(())
    };
    Ok(samples(truths, VOLUMES, bench, run))
}
