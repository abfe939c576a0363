//! Gauss–Newton on one measurement, in memory that the next one uses again.

use super::candidates::{between, decades};
use super::options::{Fit, Loss, Options, Row};
use super::system::{MIN_SEPARATION, Normal, Solved, System, reduced};
use crate::effects::Kind;
use crate::moves::Moves;
use crate::touch::{MAX_OFF_SURFACE_MM, TouchModel};
use crate::{Error, Result};
use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView};

/// A column shorter than this (mm of reading for one mm or rad of the parameter) is rounding, such
/// as sin 2c at multiples of 90°, and counts as empty.
const MIN_COLUMN: f64 = 1e-9;

/// Steps end it when every parameter moves its readings by less than this, mm.
const TOLERANCE_MM: f64 = 1e-11;

/// Memory for fits of one model on measurements of one length, reused from one to the next.
pub struct Workspace {
    n: usize,
    p: usize,
    /// How many of the parameters are unknowns.
    unknowns: usize,
    deviations: Vec<f64>,
    jacobian: Vec<f64>,
    weights: Vec<f64>,
    kinds: Vec<Kind>,
    /// Parameters that steps may change: moments are searched, not stepped, and what is no unknown
    /// stays where it is.
    free: Vec<bool>,
}

/// Where Gauss–Newton came to rest.
pub(super) struct Descent {
    values: Vec<f64>,
    converged: bool,
    steps: usize,
    /// Diagonal of (JᵀWJ)⁻¹ where everything is identifiable.
    variances: Option<Vec<f64>>,
    unidentified: Unidentified,
}

/// What the readings do not identify.
#[derive(Default)]
struct Unidentified {
    /// Parameters held at their start.
    held: Vec<usize>,
    /// Directions, one row of p each.
    null_space: Vec<f64>,
    /// Parameters that take part in one.
    not_identifiable: Vec<bool>,
}

impl Workspace {
    /// Memory for measurements of `n` touches.
    #[must_use]
    pub fn new(model: &TouchModel, n: usize) -> Self {
        let p = model.parameter_count();
        let kinds: Vec<Kind> = model.parameter_names().iter().map(|name| name.kind).collect();
        let unknown = model.unknown();
        let free = kinds.iter().zip(&unknown).map(|(kind, is)| *is && *kind != Kind::Moment);
        let free = free.collect();
        Self {
            n,
            p,
            unknowns: unknown.iter().filter(|is| **is).count(),
            deviations: vec![0.0; n],
            jacobian: vec![0.0; n * p],
            weights: vec![1.0; n],
            kinds,
            free,
        }
    }

    /// Fits one measurement that [`super::least_squares::check`] has passed but for its points, and writes estimates and
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
        row.values.copy_from_slice(&descent.values);
        *row.converged = descent.converged;
        if let Some(variances) = &descent.variances {
            let sigma = self.sigma(self.unknowns, options);
            for (slot, variance) in row.std_errors.iter_mut().zip(variances) {
                *slot = sigma * variance.sqrt();
            }
        } else {
            row.std_errors.copy_from_slice(&self.report(descent, options).std_errors());
        }
        Ok(())
    }

    /// Looks for start values where that is needed, then descends from them.
    pub(super) fn run(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        start: &[f64],
        options: &Options,
    ) -> Result<Descent> {
        self.weights.fill(1.0);
        let near = model.linearise(moves, start, &mut self.deviations, &mut self.jacobian)
            && self.deviations.iter().all(|deviation| deviation.abs() <= MAX_OFF_SURFACE_MM);
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
        let free = self.free.clone();
        for (k, kind) in self.kinds.iter().enumerate() {
            match kind {
                Kind::Linear => continue,
                Kind::Moment => values[k] = moves.first_time() + moves.span() + 1.0,
                Kind::Duration => values[k] = moves.span(),
            }
            self.free[k] = false;
        }
        let without = self
            .linearise(model, moves, &values)
            .and_then(|()| self.descend(model, moves, &values, options));
        // Candidates are compared with all searched parameters held: a linear step in one of them
        // would state what it cannot keep.
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
                Kind::Duration => decades(moves.span()),
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
        // Each touch is a column of Jᵀ in memory.
        let transposed = DMatrixView::from_slice(&self.jacobian, p, self.n);
        let mut weighed = transposed.into_owned();
        for (mut column, weight) in weighed.column_iter_mut().zip(&self.weights) {
            column *= *weight;
        }
        let mut matrix = &weighed * transposed.transpose();
        let mut right = -(weighed * DVectorView::from_slice(&self.deviations, self.n));
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
        if scales.iter().any(|length| *length < MIN_COLUMN) {
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
        (least > MIN_SEPARATION).then(|| Normal { factor, right, scales, free: self.free.clone() })
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
            if column.norm() < MIN_COLUMN {
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
        let mut unidentified =
            Unidentified { not_identifiable: vec![false; self.p], ..Unidentified::default() };
        // What the plan does not identify to first order is decided where the fit starts: on the way it
        // would show to second order and lead the fit astray.
        if self.normal(&values, options).is_none() {
            self.hold_not_identifiable(&mut values, start, options, &mut unidentified, true);
        }
        let done = self.settle(model, moves, &mut values, start, options, &mut unidentified);
        let variances = match &done {
            Ok(_) if unidentified.held.is_empty() => {
                self.normal(&values, options).and_then(|normal| normal.variances())
            }
            _ => None,
        };
        self.free = free;
        let (converged, steps) = done?;
        Ok(Descent { values, converged, steps, variances, unidentified })
    }

    /// Descends, and once more where the end sees less than the start.
    fn settle(
        &mut self,
        model: &TouchModel,
        moves: &Moves,
        values: &mut [f64],
        start: &[f64],
        options: &Options,
        unidentified: &mut Unidentified,
    ) -> Result<(bool, usize)> {
        let (mut converged, mut steps) = self.iterate(model, moves, values, options)?;
        if self.normal(values, options).is_none()
            && self.hold_not_identifiable(values, start, options, unidentified, false)
        {
            self.linearise(model, moves, values)?;
            let again = self.iterate(model, moves, values, options)?;
            converged = again.0;
            steps += again.1;
        }
        Ok((converged, steps))
    }

    /// Holds at their start, of what is free, the parameters on which what is not identifiable is put:
    /// where readings leave a choice, the later ones (those of effects). Whether there were any.
    fn hold_not_identifiable(
        &mut self,
        values: &mut [f64],
        start: &[f64],
        options: &Options,
        unidentified: &mut Unidentified,
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
        for (flag, (excluded, free)) in unidentified
            .not_identifiable
            .iter_mut()
            .zip(decomposed.not_identifiable.iter().zip(&judged))
        {
            *flag |= *excluded && *free;
        }
        unidentified.null_space.extend(rows);
        unidentified.held.extend(&pivots);
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
            if self.move_by(model, moves, values, &solved, options)? < TOLERANCE_MM {
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
        (left.sum::<f64>() / freedom as f64).sqrt().max(options.floor)
    }

    /// Everything there is to say about the fit, by a singular value decomposition.
    pub(super) fn report(&mut self, descent: Descent, options: &Options) -> Fit {
        let Descent { values, converged, steps, unidentified, .. } = descent;
        let moments = self.kinds.iter().filter(|kind| **kind == Kind::Moment).count();
        let free = self.free.clone();
        for &held in &unidentified.held {
            self.free[held] = false;
        }
        let decomposed = self.system(&values, options).decompose();
        self.free = free;
        let determined = decomposed.rank + moments;
        let Unidentified { null_space, not_identifiable, .. } = unidentified;
        Fit {
            values,
            cofactor: decomposed.cofactor,
            not_identifiable,
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
        let bound = self.cost(values, options) * (1.0 + 1e-9) + TOLERANCE_MM.powi(2);
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
