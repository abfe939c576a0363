//! Many virtual calibrations at once: the whole of simulate and estimate, on all cores.
//!
//! Sample number i depends on the seed and on i alone, so that numbers do not depend on how many
//! threads there are or in which pieces the samples are asked for.

use rayon::prelude::*;

use crate::identification::closed_form::{self, COUNT, ERRORS, PaperRows, Scratch};
use crate::identification::least_squares::{self, Options, Row, Workspace};
use crate::moves::Moves;
use crate::touch::{Simulation, TouchModel};
use crate::{Error, Result};

/// Estimates of many virtual calibrations in the face's units.
#[derive(Clone, Debug)]
pub struct Calibrations {
    /// One row of `width` a sample: eight location errors and six placement parameters by the
    /// separating forms; eight location errors by the printed forms; then, where least squares were
    /// asked for, the fourteen estimates, their standard errors, and 1 where they converged. Not
    /// numbers in samples that failed.
    pub rows: Vec<f64>,
    /// Numbers in a row.
    pub width: usize,
    /// Samples that failed, in order: counted from the first of this call, and why.
    pub failures: Vec<(usize, Error)>,
}

/// Numbers in a row without least squares.
pub const CLOSED: usize = COUNT + ERRORS;
/// Numbers in a row with least squares.
pub const IDENTIFIED: usize = CLOSED + 2 * COUNT + 1;

/// What one thread needs for its samples.
struct Bench {
    travel: Vec<f64>,
    points: Vec<f64>,
    scratch: Scratch,
    workspace: Workspace,
}

/// For every row of `truths` (m × p, face units) simulates the plan and takes both closed forms, and
/// with `identify` least squares as well, all of which start from zero.
///
/// # Errors
/// What no sample could do with: another plan than the paper's, effects in the model. What fails in
/// single samples is told in [`Calibrations::failures`].
pub fn calibrations(
    model: &TouchModel,
    moves: &Moves,
    labels: &[i64],
    truths: &[f64],
    simulation: &Simulation,
    first_sample: u64,
    identify: Option<&Options>,
) -> Result<Calibrations> {
    let paper = PaperRows::find(model, moves, labels)?;
    let p = model.parameter_count();
    if p != COUNT {
        let got = format!("{p} parameters");
        return Err(Error::input("calibrations", got, format!("the plain model's {COUNT}")));
    }
    least_squares::check(model, moves, &[0.0; COUNT], identify.unwrap_or(&Options::default()))?;
    let width = if identify.is_some() { IDENTIFIED } else { CLOSED };
    let n = moves.len();
    let mut rows = vec![f64::NAN; truths.len() / p * width];
    let bench = || Bench {
        travel: vec![0.0; n],
        points: vec![0.0; 3 * n],
        scratch: Scratch::default(),
        workspace: Workspace::new(model, n),
    };
    let run = |bench: &mut Bench, index: usize, truth: &[f64], row: &mut [f64]| -> Result<()> {
        let values = model.from_face(truth)?;
        let Bench { travel, points, scratch, workspace } = bench;
        model.simulate(moves, &values, simulation, first_sample + index as u64, travel)?;
        let starts = moves.point.chunks_exact(3).zip(moves.direction.chunks_exact(3));
        let recorded = points.chunks_exact_mut(3).zip(travel.iter());
        for ((point, travelled), (start, direction)) in recorded.zip(starts) {
            for k in 0..3 {
                point[k] = start[k] + travelled * direction[k];
            }
        }
        let measured = Moves { point: points, ..*moves };
        let separated = closed_form::separate(model, &paper, &measured, &[0.0; COUNT], scratch)?;
        let printed = closed_form::printed(model, &paper, &measured);
        let (closed, rest) = row.split_at_mut(CLOSED);
        let (by_separating, by_printed) = closed.split_at_mut(COUNT);
        let to_face = |slots: &mut [f64], values: &[f64]| {
            for ((slot, value), unit) in slots.iter_mut().zip(values).zip(model.units()) {
                *slot = value / unit;
            }
        };
        if let Some(options) = identify {
            let (values, rest) = rest.split_at_mut(COUNT);
            let (std_errors, end) = rest.split_at_mut(COUNT);
            let mut converged = false;
            let row = Row { values, std_errors, converged: &mut converged };
            workspace.estimate(model, &measured, &[0.0; COUNT], options, row)?;
            end.fill(f64::from(u8::from(converged)));
        }
        to_face(by_separating, &separated.values);
        to_face(by_printed, &printed.errors);
        Ok(())
    };
    let failures = rows
        .par_chunks_exact_mut(width)
        .zip(truths.par_chunks_exact(p))
        .enumerate()
        .map_init(bench, |bench, (index, (row, truth))| {
            run(bench, index, truth, row).err().map(|error| {
                row.fill(f64::NAN);
                (index, error)
            })
        })
        .flatten()
        .collect();
    Ok(Calibrations { rows, width, failures })
}
