//! Least squares on touches of any plan: Gauss–Newton on the exact model.
//!
//! Residuals are recorded minus modelled coordinates along the approach. Columns are scaled to unit
//! length before anything is decided about rank, so that µm and arcsec compare. A combination of
//! parameters that the touches cannot see keeps its start value and has no standard error; which
//! parameters it touches is told by [`Fit::unseen`].

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;

use crate::effects::Kind;
use crate::moves::Moves;
use crate::touch::{OFF_SURFACE_MM, TouchModel};
use crate::units::UM;
use crate::{Error, Result};

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

/// Options of [`fit`].
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

/// Scaled singular values below this share of the largest count as zero. What a plan cannot see to
/// first order shows to second order through the tilts of errors and placement, with 1e-4 to 3e-4
/// of the largest at 60 µm, 60″ and placements of 100 µm, 100″; the weakest combination that the
/// paper's plan does see has 0.03.
pub const RANK_TOLERANCE: f64 = 1e-3;
/// A column shorter than this (mm of reading for one mm or rad of the parameter) is rounding, such
/// as sin 2c at multiples of 90°, and counts as empty.
const EMPTY_COLUMN: f64 = 1e-9;
/// A parameter whose share of a unit vector lies in the null space by more than this is unseen.
/// Below it stand second-order shares: a height that cannot be told from the placement's dz drags dx
/// along by the tilt of the placement, 1e-5.
const UNSEEN_SHARE: f64 = 1e-3;
/// Steps are taken by the normal equations, or by QR, where no scaled column lies nearer than this to
/// the others' span.
const WELL_APART: f64 = 10.0 * RANK_TOLERANCE;
/// Steps end it when every parameter moves its readings by less than this, mm.
const CLOSE_MM: f64 = 1e-11;

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

/// Estimates from many measurements in the face's units, one row each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// Estimates, m × p.
    pub values: Vec<f64>,
    /// Standard errors, m × p; infinite for what cannot be seen.
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

/// Where [`Workspace::estimate`] writes one measurement's estimates.
pub struct Row<'a> {
    /// Estimates, face units.
    pub values: &'a mut [f64],
    /// Standard errors, face units.
    pub std_errors: &'a mut [f64],
    /// Whether the fit converged.
    pub converged: &'a mut bool,
}

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
            "got {} touches and {} priors for {p} parameters; wanted at least as many as parameters",
            moves.len(),
            options.priors.len()
        )));
    }
    if !options.priors.is_empty() && options.sigma <= 0.0 {
        return Err(Error::input(
            "priors",
            "no standard deviation of the probe",
            "probe.repeatability_um > 0: priors are weighed against it",
        ));
    }
    Ok(())
}

/// A null space in reduced form: one parameter for each direction (the last ones that can serve),
/// and the rows in which each of these parameters stands alone. Held at their start the parameters
/// decide what the readings leave open; the rows name what cannot be told apart, few at a time.
fn reduced(null_space: &[f64], p: usize) -> (Vec<usize>, Vec<f64>) {
    let mut rows: Vec<Vec<f64>> = null_space.chunks_exact(p).map(<[f64]>::to_vec).collect();
    let size = |row: &[f64]| row.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
    let mut pivots = Vec::with_capacity(rows.len());
    for column in (0..p).rev() {
        let done = pivots.len();
        let share = |row: &[f64]| row[column].abs() / size(row);
        let best = (done..rows.len()).max_by(|&a, &b| share(&rows[a]).total_cmp(&share(&rows[b])));
        let Some(best) = best else { break };
        if share(&rows[best]) <= UNSEEN_SHARE {
            continue;
        }
        rows.swap(done, best);
        let pivot = rows[done].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(index, _)| *index != done) {
            let factor = row[column] / pivot[column];
            for (value, used) in row.iter_mut().zip(&pivot) {
                *value -= factor * used;
            }
            row[column] = 0.0;
        }
        pivots.push(column);
    }
    rows.truncate(pivots.len());
    (pivots, rows.concat())
}

/// Midpoints between the times of the touches.
fn between(times: &[f64]) -> Vec<f64> {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    sorted.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()
}

/// Durations from a fiftieth of the whole to three times it.
fn decades(times: &[f64]) -> Vec<f64> {
    let span = times.iter().copied().fold(0.0, f64::max);
    (0..20).map(|i| span / 50.0 * 150_f64.powf(f64::from(i) / 19.0)).collect()
}

/// Memory for fits of one model on measurements of one length, reused from one to the next.
pub struct Workspace {
    n: usize,
    p: usize,
    deviations: Vec<f64>,
    jacobian: Vec<f64>,
    weights: Vec<f64>,
    kinds: Vec<Kind>,
    /// Parameters that steps may change: moments are searched, not stepped.
    free: Vec<bool>,
}

/// Where Gauss–Newton came to rest.
struct Descent {
    values: Vec<f64>,
    converged: bool,
    steps: usize,
    /// Diagonal of (JᵀWJ)⁻¹ where everything can be seen.
    variances: Option<Vec<f64>>,
    blind: Blind,
}

/// What the readings cannot see.
#[derive(Default)]
struct Blind {
    /// Parameters held at their start.
    held: Vec<usize>,
    /// Directions, one row of p each.
    null_space: Vec<f64>,
    /// Parameters that take part in one.
    unseen: Vec<bool>,
}

impl Workspace {
    /// Memory for measurements of `n` touches.
    #[must_use]
    pub fn new(model: &TouchModel, n: usize) -> Self {
        let p = model.parameter_count();
        let kinds: Vec<Kind> = model.parameter_names().iter().map(|name| name.kind).collect();
        let free = kinds.iter().map(|kind| *kind != Kind::Moment).collect();
        Self {
            n,
            p,
            deviations: vec![0.0; n],
            jacobian: vec![0.0; n * p],
            weights: vec![1.0; n],
            kinds,
            free,
        }
    }

    /// Fits one measurement that [`check`] has passed but for its points, and writes estimates and
    /// standard errors only.
    ///
    /// # Errors
    /// Points that are not finite, touches off the modelled surface.
    pub fn estimate(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        start: &[f64],
        options: &Options,
        row: Row,
    ) -> Result<()> {
        if let Some(bad) = moves.point.iter().position(|value| !value.is_finite()) {
            let what = format!("points, row {}", bad / 3);
            return Err(Error::input(what, moves.point[bad], "a finite number"));
        }
        let descent = self.run(model, moves, start, options)?;
        let units = model.units();
        for ((slot, value), unit) in row.values.iter_mut().zip(&descent.values).zip(units) {
            *slot = value / unit;
        }
        *row.converged = descent.converged;
        if let Some(variances) = &descent.variances {
            let sigma = self.sigma(self.p, options);
            for (k, slot) in row.std_errors.iter_mut().enumerate() {
                *slot = sigma * variances[k].sqrt() / units[k];
            }
        } else {
            let face = self.report(descent, options).to_face(model);
            row.std_errors.copy_from_slice(&face.std_errors);
        }
        Ok(())
    }

    /// Looks for start values where that is needed, then descends from them.
    fn run(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        start: &[f64],
        options: &Options,
    ) -> Result<Descent> {
        self.weights.fill(1.0);
        let near = model.linearise(moves, start, &mut self.deviations, &mut self.jacobian)
            && self.deviations.iter().all(|deviation| deviation.abs() <= OFF_SURFACE_MM);
        if !near {
            model.check_surface(moves, start)?;
        }
        let values = if self.kinds.iter().any(|kind| *kind != Kind::Linear) {
            self.search(model, moves, start, options)?
        } else {
            start.to_vec()
        };
        self.descend(model, moves, &values, options)
    }

    /// Start values of moments and durations, by trying, from where the fit without them ends.
    fn search(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        start: &[f64],
        options: &Options,
    ) -> Result<Vec<f64>> {
        let mut values = start.to_vec();
        let Some(times) = moves.time else { return Ok(values) };
        // Out of the way: moments after the last touch, durations as long as the measurement.
        let end = times.iter().copied().fold(0.0, f64::max);
        let free = self.free.clone();
        for (k, kind) in self.kinds.iter().enumerate() {
            match kind {
                Kind::Linear => continue,
                Kind::Moment => values[k] = end + 1.0,
                Kind::Duration => values[k] = end,
            }
            self.free[k] = false;
        }
        let without = self
            .linearise(model, moves, &values)
            .and_then(|()| self.descend(model, moves, &values, options));
        // Candidates are compared with all searched parameters held: a linear step in one of them
        // would promise what it cannot keep.
        let searched = without.and_then(|found| self.choose(model, moves, found.values, times));
        self.free = free;
        let values = searched?;
        self.linearise(model, moves, &values)?;
        Ok(values)
    }

    /// Moments and durations one after the other, each the best of its candidates.
    fn choose(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        mut values: Vec<f64>,
        times: &[f64],
    ) -> Result<Vec<f64>> {
        self.weights.fill(1.0);
        for k in 0..self.p {
            let candidates = match self.kinds[k] {
                Kind::Linear => continue,
                Kind::Moment => between(times),
                Kind::Duration => decades(times),
            };
            let mut best = (f64::INFINITY, values[k]);
            for candidate in candidates {
                values[k] = candidate;
                if let Some(cost) = self.linear_cost(model, moves, &values)
                    && cost < best.0
                {
                    best = (cost, candidate);
                }
            }
            if !best.0.is_finite() {
                let name = model.parameter_names().swap_remove(k).name;
                return Err(Error::input(name, "no candidate", "touches at two times or more"));
            }
            values[k] = best.1;
        }
        Ok(values)
    }

    fn linearise(&mut self, model: &TouchModel, moves: &Moves, values: &[f64]) -> Result<()> {
        let complete = model.linearise(moves, values, &mut self.deviations, &mut self.jacobian);
        // A decomposition of what is not finite would not end.
        if complete && self.jacobian.iter().chain(&self.deviations).all(|v| v.is_finite()) {
            return Ok(());
        }
        Err(left_the_artefact())
    }

    /// Sum of squares that a linear step from here would leave.
    fn linear_cost(&mut self, model: &TouchModel, moves: &Moves, values: &[f64]) -> Option<f64> {
        self.linearise(model, moves, values).ok()?;
        let solved = self.step(values, &Options::default());
        let rows = self.jacobian.chunks_exact(self.p);
        let left = self.deviations.iter().zip(rows).map(|(deviation, row)| {
            deviation + row.iter().zip(&solved.step).map(|(j, s)| j * s).sum::<f64>()
        });
        Some(left.map(|value| value * value).sum())
    }

    /// The normal equations JᵀWJ x = −JᵀW r, factored; `None` where columns come near to depending
    /// on each other. Their condition is the square of J's: below the bound on pivots rounding
    /// changes a step by 1e-10 of itself, which the next step takes back.
    fn normal(&self, values: &[f64], options: &Options) -> Option<Normal> {
        let p = self.p;
        let mut matrix = DMatrix::<f64>::zeros(p, p);
        let mut right = DVector::<f64>::zeros(p);
        let rows = self.jacobian.chunks_exact(p).zip(&self.deviations).zip(&self.weights);
        for ((row, deviation), weight) in rows {
            let columns = matrix.as_mut_slice().chunks_exact_mut(p);
            for (k, (column, slot)) in columns.zip(right.iter_mut()).enumerate() {
                let factor = weight * row[k];
                *slot -= factor * deviation;
                for (entry, value) in column[k..].iter_mut().zip(&row[k..]) {
                    *entry += factor * value;
                }
            }
        }
        for prior in &options.priors {
            let (k, weight) = (prior.parameter, (options.sigma / prior.sigma).powi(2));
            matrix[(k, k)] += weight;
            right[k] += weight * (prior.mean - values[k]);
        }
        for held in (0..p).filter(|&k| !self.free[k]) {
            matrix.row_mut(held).fill(0.0);
            matrix.column_mut(held).fill(0.0);
            matrix[(held, held)] = 1.0;
            right[held] = 0.0;
        }
        let scales: Vec<f64> = matrix.diagonal().iter().map(|square| square.sqrt()).collect();
        if scales.iter().any(|length| *length < EMPTY_COLUMN) {
            return None;
        }
        for (k, mut column) in matrix.column_iter_mut().enumerate() {
            right[k] /= scales[k];
            for (entry, scale) in column.iter_mut().zip(&scales).skip(k) {
                *entry /= scale * scales[k];
            }
        }
        let factor = Cholesky::new(matrix)?;
        let least = factor.l_dirty().diagonal().iter().copied().fold(f64::INFINITY, f64::min);
        (least > WELL_APART).then(|| Normal { factor, right, scales, free: self.free.clone() })
    }

    /// The next step: by the normal equations, or where these are too near to singular on J itself.
    fn step(&self, values: &[f64], options: &Options) -> Solved {
        match self.normal(values, options) {
            Some(normal) => normal.solve(),
            None => self.system(values, options).solve(),
        }
    }

    fn system(&self, values: &[f64], options: &Options) -> System {
        let (n, p) = (self.n, self.p);
        let extra = options.priors.len();
        let mut matrix = DMatrix::zeros(n + extra, p);
        let mut right = DVector::zeros(n + extra);
        for (i, row) in self.jacobian.chunks_exact(p).enumerate() {
            let root = self.weights[i].sqrt();
            right[i] = -root * self.deviations[i];
            for (k, value) in row.iter().enumerate() {
                if self.free[k] {
                    matrix[(i, k)] = root * value;
                }
            }
        }
        for (i, prior) in options.priors.iter().enumerate() {
            let scale = options.sigma / prior.sigma;
            matrix[(n + i, prior.parameter)] = scale;
            right[n + i] = scale * (prior.mean - values[prior.parameter]);
        }
        for mut column in matrix.column_iter_mut() {
            if column.norm() < EMPTY_COLUMN {
                column.fill(0.0);
            }
        }
        System { matrix, right }
    }

    /// Gauss–Newton from `start`.
    fn descend(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        start: &[f64],
        options: &Options,
    ) -> Result<Descent> {
        let mut values = start.to_vec();
        let free = self.free.clone();
        let mut blind = Blind { unseen: vec![false; self.p], ..Blind::default() };
        // What the plan cannot see to first order is decided where the fit starts: on the way it
        // would show to second order and lead the fit astray.
        if self.normal(&values, options).is_none() {
            self.hold_unseen(&mut values, start, options, &mut blind, true);
        }
        let done = self.settle(model, moves, &mut values, start, options, &mut blind);
        let variances = match &done {
            Ok(_) if blind.held.is_empty() => {
                self.normal(&values, options).and_then(|normal| normal.variances())
            }
            _ => None,
        };
        self.free = free;
        let (converged, steps) = done?;
        Ok(Descent { values, converged, steps, variances, blind })
    }

    /// Descends, and once more where the end sees less than the start.
    fn settle(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        values: &mut [f64],
        start: &[f64],
        options: &Options,
        blind: &mut Blind,
    ) -> Result<(bool, usize)> {
        let (mut converged, mut steps) = self.iterate(model, moves, values, options)?;
        if self.normal(values, options).is_none()
            && self.hold_unseen(values, start, options, blind, false)
        {
            self.linearise(model, moves, values)?;
            let again = self.iterate(model, moves, values, options)?;
            converged = again.0;
            steps += again.1;
        }
        Ok((converged, steps))
    }

    /// Holds at their start, of what is free, the parameters on which what cannot be seen is put:
    /// where readings leave a choice, the later ones (those of effects). Whether there were any.
    fn hold_unseen(
        &mut self,
        values: &mut [f64],
        start: &[f64],
        options: &Options,
        blind: &mut Blind,
        at_start: bool,
    ) -> bool {
        let free = self.free.clone();
        if at_start {
            // A duration does nothing while its amplitude is zero, as it is at the start.
            let durations = self.kinds.iter().map(|kind| *kind == Kind::Duration);
            self.free.iter_mut().zip(durations).for_each(|(free, is)| *free &= !is);
        }
        let decomposed = self.system(values, options).decompose();
        let judged = std::mem::replace(&mut self.free, free);
        let of_free = |row: &&[f64]| row.iter().zip(&judged).any(|(v, free)| *free && *v != 0.0);
        let rows: Vec<f64> =
            decomposed.null_space.chunks_exact(self.p).filter(of_free).flatten().copied().collect();
        let (pivots, rows) = reduced(&rows, self.p);
        for &pivot in &pivots {
            self.free[pivot] = false;
            values[pivot] = start[pivot];
        }
        for (flag, (hidden, free)) in
            blind.unseen.iter_mut().zip(decomposed.unseen.iter().zip(&judged))
        {
            *flag |= *hidden && *free;
        }
        blind.null_space.extend(rows);
        blind.held.extend(&pivots);
        !pivots.is_empty()
    }

    /// Gauss–Newton over what is free, from values at which the model has just been linearised;
    /// whether it converged, and its steps.
    fn iterate(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        values: &mut [f64],
        options: &Options,
    ) -> Result<(bool, usize)> {
        for step in 1..=options.max_steps {
            self.reweigh(options.loss);
            let solved = self.step(values, options);
            if self.move_by(model, moves, values, &solved, options)? < CLOSE_MM {
                return Ok((true, step));
            }
        }
        Ok((false, options.max_steps))
    }

    /// Readings and priors beyond the parameters that could be determined.
    fn degrees_of_freedom(&self, determined: usize, options: &Options) -> usize {
        (self.n + options.priors.len()).saturating_sub(determined)
    }

    /// Standard deviation of one reading: as given, or from what is left. Moments count among the
    /// `determined` parameters.
    fn sigma(&self, determined: usize, options: &Options) -> f64 {
        let freedom = self.degrees_of_freedom(determined, options);
        if options.sigma > 0.0 {
            return options.sigma;
        }
        if freedom == 0 {
            return 0.0;
        }
        let left = self.deviations.iter().zip(&self.weights).map(|(r, w)| w * r * r);
        (left.sum::<f64>() / freedom as f64).sqrt()
    }

    /// Everything there is to say about the fit, by a singular value decomposition.
    fn report(&mut self, descent: Descent, options: &Options) -> Fit {
        let Descent { values, converged, steps, blind, .. } = descent;
        let moments = self.free.iter().filter(|free| !**free).count();
        let free = self.free.clone();
        for &held in &blind.held {
            self.free[held] = false;
        }
        let decomposed = self.system(&values, options).decompose();
        self.free = free;
        let determined = decomposed.rank + moments;
        let Blind { null_space, unseen, .. } = blind;
        Fit {
            values,
            cofactor: decomposed.cofactor,
            unseen,
            null_space,
            singular_values: decomposed.singular_values,
            residuals: self.deviations.iter().map(|d| -d).collect(),
            weights: self.weights.clone(),
            sigma: self.sigma(determined, options),
            degrees_of_freedom: self.degrees_of_freedom(determined, options),
            converged,
            steps,
        }
    }

    /// Weighted sum of squares of the readings, mm², with the priors'.
    fn cost(&self, values: &[f64], options: &Options) -> f64 {
        let readings = self.deviations.iter().zip(&self.weights).map(|(d, w)| w * d * d);
        let priors = options.priors.iter().map(|prior| {
            (options.sigma / prior.sigma * (prior.mean - values[prior.parameter])).powi(2)
        });
        readings.sum::<f64>() + priors.sum::<f64>()
    }

    /// Takes the step, halved until the model still touches and fits no worse; returns how far it
    /// moved the readings, mm.
    fn move_by(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        values: &mut [f64],
        solved: &Solved,
        options: &Options,
    ) -> Result<f64> {
        let bound = self.cost(values, options) * (1.0 + 1e-9) + CLOSE_MM.powi(2);
        let before = values.to_vec();
        let mut share = 1.0;
        let mut moved = Err(left_the_artefact());
        for _ in 0..12 {
            for ((value, from), step) in values.iter_mut().zip(&before).zip(&solved.step) {
                *value = from + share * step;
            }
            if self.linearise(model, moves, values).is_ok() {
                moved = Ok(share * solved.largest);
                if self.cost(values, options) <= bound {
                    return moved;
                }
            }
            share *= 0.5;
        }
        moved
    }

    fn reweigh(&mut self, loss: Loss) {
        let Loss::Huber(knee) = loss else { return };
        let mut sizes: Vec<f64> = self.deviations.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        // Median absolute deviation of a normal law is 0.6745 σ.
        let sigma = sizes[sizes.len() / 2] / 0.6745;
        for (weight, deviation) in self.weights.iter_mut().zip(&self.deviations) {
            let size = deviation.abs();
            *weight = if size <= knee * sigma { 1.0 } else { knee * sigma / size };
        }
    }
}

fn left_the_artefact() -> Error {
    Error::Data("identification: a touch left the modelled artefact on the way".into())
}

/// Normal equations with columns scaled to unit length.
struct Normal {
    factor: Cholesky<f64, Dyn>,
    right: DVector<f64>,
    scales: Vec<f64>,
    free: Vec<bool>,
}

impl Normal {
    fn solve(self) -> Solved {
        let solution = self.factor.solve(&self.right);
        Solved {
            step: solution.iter().zip(&self.scales).map(|(value, scale)| value / scale).collect(),
            largest: solution.amax(),
        }
    }

    /// Diagonal of (JᵀWJ)⁻¹: the squared lengths of the columns of L⁻¹; `None` unless the matrix
    /// certainly has full rank. L⁻¹ is at least as long as 1/σ of the least singular value, and the
    /// largest of p unit columns is at most √p. Parameters that are held have variance 0.
    fn variances(&self) -> Option<Vec<f64>> {
        let p = self.scales.len();
        let mut inverse = DMatrix::identity(p, p);
        self.factor.l_dirty().solve_lower_triangular_mut(&mut inverse);
        let lengths: Vec<f64> = inverse.column_iter().map(|column| column.norm_squared()).collect();
        let length = lengths.iter().sum::<f64>().sqrt();
        (length * RANK_TOLERANCE * (p as f64).sqrt() < 1.0).then(|| {
            let squares = lengths.iter().zip(&self.scales).zip(&self.free);
            squares.map(|((l, s), free)| if *free { l / (s * s) } else { 0.0 }).collect()
        })
    }
}

struct System {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

struct Solved {
    step: Vec<f64>,
    /// Largest movement of the readings by one parameter's step, mm.
    largest: f64,
}

struct Decomposed {
    cofactor: Vec<f64>,
    unseen: Vec<bool>,
    null_space: Vec<f64>,
    singular_values: Vec<f64>,
    rank: usize,
}

impl System {
    /// Lengths of the columns; 1 where a column is empty.
    fn scales(&self) -> Vec<f64> {
        let lengths = self.matrix.column_iter().map(|column| column.norm());
        lengths.map(|length| if length > 0.0 { length } else { 1.0 }).collect()
    }

    fn scaled(&self, scales: &[f64]) -> DMatrix<f64> {
        let mut scaled = self.matrix.clone();
        for (mut column, scale) in scaled.column_iter_mut().zip(scales) {
            column /= *scale;
        }
        scaled
    }

    /// Least-squares step by QR; by a truncated singular value decomposition where columns depend on
    /// each other, which leaves what cannot be seen where it is.
    fn solve(&self) -> Solved {
        let scales = self.scales();
        let p = scales.len();
        let qr = self.scaled(&scales).qr();
        let mut right = self.right.clone();
        qr.q_tr_mul(&mut right);
        let right = right.rows(0, p).clone_owned();
        let r = qr.r();
        let smallest = r.diagonal().iter().fold(f64::INFINITY, |least, d| least.min(d.abs()));
        let solution = if smallest > WELL_APART { r.solve_upper_triangular(&right) } else { None };
        let solution = solution.unwrap_or_else(|| {
            let svd = r.svd(true, true);
            let largest = svd.singular_values.max();
            svd.solve(&right, RANK_TOLERANCE * largest).unwrap_or_else(|_| DVector::zeros(p))
        });
        Solved {
            step: solution.iter().zip(&scales).map(|(value, scale)| value / scale).collect(),
            largest: solution.amax(),
        }
    }

    fn decompose(&self) -> Decomposed {
        let scales = self.scales();
        let p = scales.len();
        let r = self.scaled(&scales).qr().r();
        let svd = r.svd(false, true);
        let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
        order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
        let largest = order.first().map_or(0.0, |&first| svd.singular_values[first]);
        let directions = svd.v_t.unwrap_or_else(|| DMatrix::identity(p, p));
        let mut cofactor = vec![0.0; p * p];
        let mut null_space = Vec::new();
        let mut hidden = vec![0.0; p];
        let mut rank = 0;
        for &index in &order {
            let value = svd.singular_values[index];
            let direction = directions.row(index);
            if value > RANK_TOLERANCE * largest && value > 0.0 {
                rank += 1;
                for i in 0..p {
                    for j in 0..p {
                        cofactor[i * p + j] +=
                            direction[i] * direction[j] / (value * value * scales[i] * scales[j]);
                    }
                }
            } else {
                null_space.extend(direction.iter().zip(&scales).map(|(v, scale)| v / scale));
                for (share, component) in hidden.iter_mut().zip(direction.iter()) {
                    *share += component * component;
                }
            }
        }
        Decomposed {
            cofactor,
            unseen: hidden.iter().map(|share| share.sqrt() > UNSEEN_SHARE).collect(),
            null_space,
            singular_values: order.iter().map(|&index| svd.singular_values[index]).collect(),
            rank,
        }
    }
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
