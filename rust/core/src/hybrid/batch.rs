//! Many poses at once, in mm and rad. Rows are independent, or in runs of a fixed length, so the numbers are the same on any
//! number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::ballbar;
use super::closure::Closure;
use super::geometry::Geometry;
use super::mechanism::Mechanism;
use super::parameter::{ACTIVE, PASSIVE, Parameter};
use super::posture::ToolPose;
use super::solution::Solution;
use crate::{Error, Result};

/// A mechanism with errors and a closure, asked about many poses on the threads of the current
/// rayon pool.
#[derive(Clone, Debug)]
pub struct Batch<'a> {
    /// The nominal mechanism.
    pub mechanism: &'a Mechanism,
    /// The mechanism with errors.
    pub geometry: Geometry,
    /// Weights of the closure equations.
    pub closure: Closure,
}

/// Columns of a row of [`Batch::forward`]: tool point (3, mm), direction (3), passive joints
/// (8, rad), residuals of loop 1 and loop 3 (gap 3, mm; y·z and y·x, rad), pivot ratio, steps.
pub const FORWARD_COLUMNS: usize = 3 + 3 + PASSIVE + 10 + 2;
/// Rows of a sensitivity: tool point (3, mm), turn of the tool (3, rad), the serial part of
/// both (3 + 3), passive joints (8, rad).
pub const SENSITIVITY_ROWS: usize = 3 + 3 + 3 + 3 + PASSIVE;

/// Rows of which each but the first is solved from the one before.
const RUN: usize = 128;

fn at_row(row: usize) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Input { what, got, expected } => {
            Error::Input { what: format!("row {row}: {what}"), got, expected }
        }
        Error::Kinematics(message) => Error::Kinematics(format!("row {row}: {message}")),
        other => other,
    }
}

impl Batch<'_> {
    fn rows(
        &self,
        count: usize,
        columns: usize,
        fill: impl Fn(usize, &mut [f64]) -> Result<()> + Sync,
    ) -> Result<Vec<f64>> {
        let mut out = vec![0.0; count * columns];
        if columns == 0 {
            return Ok(out);
        }
        let failures = out
            .par_chunks_mut(columns)
            .enumerate()
            .filter_map(|(row, slot)| fill(row, slot).map_err(at_row(row)).err())
            .collect();
        first_of(failures)?;
        Ok(out)
    }

    /// The same of rows that follow a path: most are solved from the row before, in half the steps.
    fn along_path(
        &self,
        joints: &[f64],
        columns: usize,
        fill: impl Fn(usize, &Solution, &mut [f64]) -> Result<()> + Sync,
    ) -> Result<Vec<f64>> {
        let mut out = vec![0.0; joints.len() / ACTIVE * columns];
        let failures = out
            .par_chunks_mut(RUN * columns)
            .enumerate()
            .filter_map(|(run, slots)| {
                let mut before = None;
                slots.chunks_exact_mut(columns).enumerate().find_map(|(at, slot)| {
                    let row = RUN * run + at;
                    let own = commanded(joints, row);
                    self.mechanism
                        .solve_near(&self.geometry, &own, &self.closure, before.as_ref())
                        .and_then(|solution| {
                            fill(row, &solution, slot)?;
                            before = Some(solution.joints);
                            Ok(())
                        })
                        .map_err(at_row(row))
                        .err()
                })
            })
            .collect();
        first_of(failures)?;
        Ok(out)
    }

    fn solve(&self, joints: &[f64], row: usize) -> Result<Solution> {
        self.mechanism.solve(&self.geometry, &commanded(joints, row), &self.closure)
    }

    /// Forward solutions at `joints` (n × 5: L1, L2, L3 in mm, q4, q5 in rad), n ×
    /// [`FORWARD_COLUMNS`].
    ///
    /// # Errors
    /// As [`Mechanism::solve`], with the row.
    pub fn forward(&self, joints: &[f64]) -> Result<Vec<f64>> {
        self.rows(joints.len() / ACTIVE, FORWARD_COLUMNS, |row, slot| {
            fill_forward(&self.solve(joints, row)?, slot);
            Ok(())
        })
    }

    /// Forward solutions followed by the sensitivities to `parameters`: a row holds the columns of
    /// [`Batch::forward`] and then [`SENSITIVITY_ROWS`] × k.
    ///
    /// # Errors
    /// As [`Mechanism::solve`], with the row.
    pub fn sensitivity(&self, joints: &[f64], parameters: &[Parameter]) -> Result<Vec<f64>> {
        let k = parameters.len();
        let width = FORWARD_COLUMNS + SENSITIVITY_ROWS * k;
        self.rows(joints.len() / ACTIVE, width, |row, slot| {
            let solution = self.solve(joints, row)?;
            let (forward, rates) = slot.split_at_mut(FORWARD_COLUMNS);
            fill_forward(&solution, forward);
            let differential = solution.differential(&self.geometry);
            for (column, parameter) in parameters.iter().enumerate() {
                let sensitivity = differential.of(*parameter);
                let all = sensitivity.tool.iter().chain(&sensitivity.serial);
                for (i, rate) in all.chain(&sensitivity.passive).enumerate() {
                    rates[i * k + column] = *rate;
                }
            }
            Ok(())
        })
    }

    /// First-order strain of the loops under `parameters`: n × 10 × k, rows as the residuals of
    /// [`Batch::forward`].
    ///
    /// # Errors
    /// As [`Mechanism::solve`], with the row.
    pub fn strain(&self, joints: &[f64], parameters: &[Parameter]) -> Result<Vec<f64>> {
        let k = parameters.len();
        self.rows(joints.len() / ACTIVE, 10 * k, |row, slot| {
            let solution = self.solve(joints, row)?;
            let differential = solution.differential(&self.geometry);
            for (column, parameter) in parameters.iter().enumerate() {
                let left = differential.strain(*parameter).map(|r| r.rows());
                for (i, value) in left.iter().flatten().enumerate() {
                    slot[i * k + column] = *value;
                }
            }
            Ok(())
        })
    }

    /// Ball-bar readings: for each row of `joints` (n × 5) and ball centre (n × 3, mm), the length
    /// (mm), the direction from ball to tool point (3) and the gradient by `parameters` (k): n × (4 + k). The gradient by the centre is minus the direction.
    ///
    /// # Errors
    /// As [`Mechanism::solve`] and [`ballbar::reading`], with the row.
    pub fn ballbar(
        &self,
        joints: &[f64],
        centres: &[f64],
        parameters: &[Parameter],
    ) -> Result<Vec<f64>> {
        same_rows("ball centres", centres.len() / 3, joints.len() / ACTIVE)?;
        self.along_path(joints, 4 + parameters.len(), |row, solution, slot| {
            let centre = Vector3::from_column_slice(&centres[3 * row..3 * row + 3]);
            let reading = ballbar::reading(solution, &centre)?;
            slot[0] = reading.length;
            slot[1..4].copy_from_slice(reading.direction.as_slice());
            let gradient = ballbar::gradient(&self.geometry, solution, &reading, parameters);
            for (value, cell) in gradient.zip(&mut slot[4..]) {
                *cell = value;
            }
            Ok(())
        })
    }

    /// Commands for tool points (n × 3, mm) and directions (n × 3): n × 6, L1, L2, L3 (mm), q4, q5
    /// (rad) and 1 where the nominal wrist is singular. `negative` takes the branch with q5 ≤ 0. On
    /// the nominal machine closed form, with `exact` Newton on the machine with errors.
    ///
    /// # Errors
    /// As [`Mechanism::nominal_inverse`] and [`Mechanism::inverse`], with the row.
    pub fn inverse(
        &self,
        tips: &[f64],
        directions: &[f64],
        reference: f64,
        negative: bool,
        exact: bool,
    ) -> Result<Vec<f64>> {
        same_rows("tool directions", directions.len() / 3, tips.len() / 3)?;
        let start = self.mechanism.without_offsets();
        self.rows(tips.len() / 3, ACTIVE + 1, |row, slot| {
            let pose = ToolPose {
                tip: Vector3::from_column_slice(&tips[3 * row..3 * row + 3]),
                direction: Vector3::from_column_slice(&directions[3 * row..3 * row + 3]),
            };
            let mechanism = if exact { &start } else { self.mechanism };
            let nominal = mechanism.nominal_inverse(&pose, reference)?;
            let mut active = nominal.active[usize::from(negative)];
            if exact {
                let solution =
                    self.mechanism.inverse(&self.geometry, &pose, &active, &self.closure)?;
                active = solution.joints.active;
            }
            slot[..ACTIVE].copy_from_slice(&active);
            slot[ACTIVE] = f64::from(u8::from(nominal.singular));
            Ok(())
        })
    }
}

/// Commands of one row.
fn commanded(joints: &[f64], row: usize) -> [f64; ACTIVE] {
    std::array::from_fn(|k| joints[ACTIVE * row + k])
}

/// Of several failing rows the first is reported, whichever thread comes to it.
fn first_of(failures: Vec<Error>) -> Result<()> {
    failures.into_iter().next().map_or(Ok(()), Err)
}

fn same_rows(what: &str, got: usize, expected: usize) -> Result<()> {
    if got == expected {
        return Ok(());
    }
    Err(Error::input(format!("rows of {what}"), got, expected.to_string()))
}

fn fill_forward(solution: &Solution, slot: &mut [f64]) {
    let posture = &solution.posture;
    slot[..3].copy_from_slice(posture.tip().as_slice());
    slot[3..6].copy_from_slice(posture.direction().as_slice());
    for (cell, angle) in slot[6..14].iter_mut().zip(solution.joints.passive) {
        *cell = angle;
    }
    let residuals = solution.residuals().map(|r| r.rows());
    for (cell, value) in slot[14..24].iter_mut().zip(residuals.iter().flatten()) {
        *cell = *value;
    }
    slot[24] = solution.pivot_ratio();
    slot[25] = solution.steps as f64;
}
