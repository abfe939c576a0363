//! Touches: model, plan, simulation, closed forms, least squares.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::artefact::{Artefact, Search};
use trunnion_core::effects::{self, Kind, Need};
use trunnion_core::identification::{closed_form, least_squares};
use trunnion_core::machine::{self, Machine};
use trunnion_core::moves::MoveTable;
use trunnion_core::probe::Probe;
use trunnion_core::touch::{self, Simulation};
use trunnion_core::units::{ARCSEC, DEG, UM};
use trunnion_core::{Error, Result};

use crate::arrays::{array, finite, matrix, rows, vector};
use crate::errors::IntoPy;
use crate::threads::in_pieces;
use crate::user_units::touches::{self as user_units, ParameterUnits};

fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Linear => "linear",
        Kind::Moment => "moment",
        Kind::Duration => "duration",
    }
}

/// One entry of the catalogue: id, title, owner, parameters (name, unit, kind), needed columns.
type Entry =
    (String, String, &'static str, Vec<(&'static str, &'static str, &'static str)>, Vec<String>);

fn need_name(machine: &Machine, need: Need) -> String {
    match need {
        Need::Feed => "feed_mm_min".to_owned(),
        Need::Time => "time_s".to_owned(),
        Need::Sense(axis) => {
            format!("{}_dir", machine.rotary()[axis].letter().to_ascii_lowercase())
        }
    }
}

/// Every effect that can act on touches of this artefact on this machine.
#[pyfunction]
pub fn catalogue(
    machine: &crate::machine::Machine,
    kind: &str,
    dimensions: Vec<f64>,
) -> PyResult<Vec<Entry>> {
    let machine = &machine.inner;
    let artefact = Artefact::of(kind, &dimensions).into_py()?;
    let entries = effects::catalogue(machine, &artefact).into_iter().map(|effect| {
        let parameters = effect.parameters.iter();
        let parameters = parameters.map(|p| (p.name, p.unit.symbol(), kind_name(p.kind))).collect();
        let needs = effect.needs.iter().map(|need| need_name(machine, *need)).collect();
        (effect.id, effect.title, effect.owner.word(), parameters, needs)
    });
    Ok(entries.collect())
}

/// Touches or planned moves in the core's units.
#[pyclass(frozen, module = "trunnion._core")]
pub struct Moves {
    pub inner: MoveTable,
}

#[pymethods]
impl Moves {
    #[new]
    #[pyo3(signature = (rotary_deg, point_mm, direction, feed_mm_min=None, time_s=None, sense=None))]
    fn new(
        rotary_deg: PyReadonlyArray2<'_, f64>,
        point_mm: PyReadonlyArray2<'_, f64>,
        direction: PyReadonlyArray2<'_, f64>,
        feed_mm_min: Option<PyReadonlyArray1<'_, f64>>,
        time_s: Option<PyReadonlyArray1<'_, f64>>,
        sense: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Self> {
        let axes = rotary_deg.as_array().ncols();
        let inner = user_units::moves(
            axes,
            rows("rotary positions", &rotary_deg, axes)?.into_owned(),
            rows("points", &point_mm, 3)?.into_owned(),
            rows("approach directions", &direction, 3)?.into_owned(),
            feed_mm_min.map(|feed| vector("feed_mm_min", &feed)).transpose()?,
            time_s.map(|time| vector("time_s", &time)).transpose()?,
            sense
                .map(|sense| Ok::<_, PyErr>(rows("senses of turning", &sense, axes)?.into_owned()))
                .transpose()?,
        );
        Ok(Self { inner: inner.into_py()? })
    }

    /// The same rows with one rotary axis further by an angle, in the machine's sense.
    fn turned(&self, axis: usize, #[pyo3(from_py_with = finite)] by_deg: f64) -> PyResult<Self> {
        let axes = self.inner.axes();
        if axis >= axes {
            return Err(Error::input("axis", axis, format!("below {axes}"))).into_py();
        }
        Ok(Self { inner: self.inner.turned(axis, by_deg * DEG) })
    }

    fn __len__(&self) -> usize {
        self.inner.view().len()
    }
}

/// The model of touches: location errors, placement and effects as parameters, in this order.
#[pyclass(frozen, module = "trunnion._core")]
pub struct TouchModel {
    pub inner: touch::TouchModel,
    pub units: ParameterUnits,
}

impl TouchModel {
    fn fit_options(
        &self,
        huber: Option<f64>,
        sigma_um: f64,
        moves: &Moves,
        priors: &[(usize, f64, f64)],
        max_steps: usize,
    ) -> Result<least_squares::Options> {
        let units = self.units.all();
        let prior = |&(parameter, mean, sigma): &(usize, f64, f64)| {
            let unit = units.get(parameter).copied().ok_or_else(|| {
                Error::input("prior's parameter", parameter, format!("below {}", units.len()))
            })?;
            if !(mean.is_finite() && sigma.is_finite() && sigma > 0.0) {
                let got = format!("{mean} ± {sigma}");
                return Err(Error::input(
                    "prior",
                    got,
                    "a finite value and a positive uncertainty",
                ));
            }
            Ok(least_squares::Prior { parameter, mean: mean * unit, sigma: sigma * unit })
        };
        Ok(least_squares::Options {
            loss: huber.map_or(least_squares::Loss::Squares, least_squares::Loss::Huber),
            sigma: sigma_um * UM,
            floor: self.inner.rounding(&moves.inner.view()),
            priors: priors.iter().map(prior).collect::<Result<_>>()?,
            max_steps,
        })
    }
}

/// Fits between two looks for Ctrl-C: a tenth of a second or so on one core.
const PIECE: usize = 500;

#[pymethods]
impl TouchModel {
    #[new]
    #[pyo3(signature = (
        machine, artefact, *, ball_radius_mm, tick_um, servo_period_ms, effect_ids
    ))]
    fn new(
        machine: &crate::machine::Machine,
        artefact: &crate::artefact::Artefact,
        #[pyo3(from_py_with = finite)] ball_radius_mm: f64,
        #[pyo3(from_py_with = finite)] tick_um: f64,
        #[pyo3(from_py_with = finite)] servo_period_ms: f64,
        effect_ids: Vec<String>,
    ) -> PyResult<Self> {
        let machine = machine.inner.clone();
        let (artefact, fixture) = (artefact.inner, artefact.fixture.clone());
        let probe = Probe::new(ball_radius_mm, tick_um * UM)
            .and_then(|probe| probe.looked_at_every(1e-3 * servo_period_ms))
            .into_py()?;
        let all = effects::catalogue(&machine, &artefact);
        let chosen = effects::select(&all, &effect_ids).into_py()?;
        let inner = touch::TouchModel::new(machine, artefact, probe, chosen).standing(&fixture);
        let units = ParameterUnits::of(&inner);
        Ok(Self { inner, units })
    }

    #[getter]
    fn letters(&self) -> String {
        self.inner.machine().rotary().iter().map(machine::Rotary::letter).collect()
    }

    #[getter]
    fn parameters(&self) -> Vec<(String, &'static str, &'static str)> {
        let names = self.inner.parameter_names();
        names.into_iter().map(|n| (n.name, n.unit.symbol(), kind_name(n.kind))).collect()
    }

    #[getter]
    fn unknown(&self) -> Vec<bool> {
        self.inner.unknown()
    }

    #[getter]
    fn error_count(&self) -> usize {
        self.inner.errors().len()
    }

    /// Residuals in µm (recorded minus modelled coordinate along the approach).
    fn residuals<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        values: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = self.units.checked(&self.inner, &vector("values", &values)?).into_py()?;
        let moves = moves.inner.view();
        let residuals = py.detach(|| {
            self.inner.check(&moves)?;
            let mut out = vec![0.0; moves.len()];
            self.inner.deviations_near(&moves, &values, &mut out)?;
            out.iter_mut().for_each(|deviation| *deviation /= -UM);
            Ok(out)
        });
        array(py, residuals.into_py()?)
    }

    /// Residuals in µm and the derivative of the modelled coordinate, µm per parameter unit.
    fn linearise<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        values: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let values = self.units.checked(&self.inner, &vector("values", &values)?).into_py()?;
        let moves = moves.inner.view();
        let p = self.inner.parameter_count();
        let result = py.detach(|| -> Result<(Vec<f64>, Vec<f64>)> {
            self.inner.check(&moves)?;
            let (mut residuals, mut jacobian) =
                (vec![0.0; moves.len()], vec![0.0; moves.len() * p]);
            self.inner.linearise_near(&moves, &values, &mut residuals, &mut jacobian)?;
            let units = self.units.all();
            residuals.iter_mut().for_each(|r| *r /= -UM);
            for row in jacobian.chunks_exact_mut(p) {
                row.iter_mut().zip(units).for_each(|(j, unit)| *j *= unit / UM);
            }
            Ok((residuals, jacobian))
        });
        let (residuals, jacobian) = result.into_py()?;
        Ok((array(py, residuals)?, matrix(py, jacobian, p)?))
    }

    /// Derivative of the modelled coordinate by some parameters at each of some values (v, p), µm
    /// per parameter unit, a parameter a row: (v k, n).
    fn rates<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        values: PyReadonlyArray2<'py, f64>,
        columns: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let p = self.inner.parameter_count();
        let given = rows("values", &values, p)?;
        let each = given.chunks_exact(p).map(|one| self.units.checked(&self.inner, one));
        let values = each.collect::<Result<Vec<_>>>().into_py()?;
        let moves = moves.inner.view();
        let rates = py.detach(|| -> Result<Vec<f64>> {
            self.inner.check(&moves)?;
            if let Some(&column) = columns.iter().find(|&&column| column >= p) {
                return Err(Error::input("column", column, format!("below {p}")));
            }
            let mut rates = vec![0.0; values.len() * columns.len() * moves.len()];
            self.inner.rates_near(&moves, &values, &columns, &mut rates)?;
            let units = columns.iter().map(|&column| self.units.all()[column] / UM);
            let all = rates.chunks_exact_mut(moves.len().max(1));
            all.zip(units.cycle()).for_each(|(row, unit)| row.iter_mut().for_each(|r| *r *= unit));
            Ok(rates)
        });
        matrix(py, rates.into_py()?, moves.len())
    }

    /// Name of the face that each touch is on, on the nominal machine: `+X arm, top`.
    fn faces(&self, py: Python<'_>, moves: &Moves) -> PyResult<Vec<String>> {
        let moves = moves.inner.view();
        py.detach(|| {
            self.inner.check(&moves)?;
            Ok(self.inner.faces(&moves))
        })
        .into_py()
    }

    /// Travel in mm from each move's point to the trigger.
    #[pyo3(signature = (moves, values, *, from_start, reach_mm, noise_um, seed, sample))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        values: PyReadonlyArray1<'py, f64>,
        from_start: bool,
        #[pyo3(from_py_with = finite)] reach_mm: f64,
        #[pyo3(from_py_with = finite)] noise_um: f64,
        seed: u64,
        sample: u64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = self.units.checked(&self.inner, &vector("values", &values)?).into_py()?;
        let moves = moves.inner.view();
        let simulation = simulation(from_start, reach_mm, noise_um, seed);
        let travel = py.detach(|| {
            self.inner.check(&moves)?;
            let mut travel = vec![0.0; moves.len()];
            self.inner.simulate(&moves, &values, &simulation, sample, &mut travel)?;
            Ok(travel)
        });
        array(py, travel.into_py()?)
    }

    /// Least squares from `start`; a dictionary of arrays in user units.
    #[pyo3(signature = (moves, start, *, huber, sigma_um, priors, max_steps))]
    fn fit<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        start: PyReadonlyArray1<'py, f64>,
        #[pyo3(from_py_with = finite)] huber: Option<f64>,
        #[pyo3(from_py_with = finite)] sigma_um: f64,
        priors: Vec<(usize, f64, f64)>,
        max_steps: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let start = self.units.checked(&self.inner, &vector("start", &start)?).into_py()?;
        let options = self.fit_options(huber, sigma_um, moves, &priors, max_steps).into_py()?;
        let moves = moves.inner.view();
        let fit = py.detach(|| least_squares::fit(&self.inner, &moves, &start, &options));
        let fit = fit.into_py()?;
        let user = self.units.fit(&fit);
        let p = self.inner.parameter_count();
        let result = PyDict::new(py);
        result.set_item("values", array(py, user.values)?)?;
        result.set_item("std_errors", array(py, user.std_errors)?)?;
        result.set_item("covariance", matrix(py, user.covariance, p)?)?;
        result.set_item("residuals_um", array(py, user.residuals_um)?)?;
        result.set_item("sigma_um", user.sigma_um)?;
        result.set_item("null_space", matrix(py, user.null_space, p)?)?;
        result.set_item("singular_values", array(py, fit.singular_values)?)?;
        result.set_item("weights", array(py, fit.weights)?)?;
        result.set_item("degrees_of_freedom", fit.degrees_of_freedom)?;
        result.set_item("converged", fit.converged)?;
        result.set_item("steps", fit.steps)?;
        Ok(result)
    }

    /// Many measurements of one plan, `points` (m, 3 n): estimates, standard errors, converged.
    #[pyo3(signature = (moves, points, start, *, huber, sigma_um, priors, max_steps, threads))]
    fn fit_many<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        points: PyReadonlyArray2<'py, f64>,
        start: PyReadonlyArray1<'py, f64>,
        #[pyo3(from_py_with = finite)] huber: Option<f64>,
        #[pyo3(from_py_with = finite)] sigma_um: f64,
        priors: Vec<(usize, f64, f64)>,
        max_steps: usize,
        threads: Option<usize>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>)>
    {
        let start = self.units.checked(&self.inner, &vector("start", &start)?).into_py()?;
        let options = self.fit_options(huber, sigma_um, moves, &priors, max_steps).into_py()?;
        let moves = moves.inner.view();
        let points = rows("points", &points, 3 * moves.len())?;
        let p = self.inner.parameter_count();
        let width = 3 * moves.len();
        let count = points.len().checked_div(width).unwrap_or(0);
        let fits = in_pieces(py, threads, (count, PIECE), |first, number| {
            let some = &points[first * width..(first + number) * width];
            least_squares::fit_many(&self.inner, &moves, some, &start, &options)
        })?;
        let mut all = least_squares::Estimates::default();
        for fit in fits {
            let fit = fit.into_py()?;
            all.values.extend(fit.values);
            all.std_errors.extend(fit.std_errors);
            all.converged.extend(fit.converged);
        }
        let found = self.units.estimates(all);
        let converged = PyArray1::from_vec(py, found.converged);
        Ok((matrix(py, found.values, p)?, matrix(py, found.std_errors, p)?, converged))
    }

    /// The separating closed forms: values (14,), the checks κ and ζ in µm, and the change of the
    /// values for one µm of each reading (14, n).
    fn separate<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        labels: Vec<i64>,
        start: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, f64, f64, Bound<'py, PyArray2<f64>>)> {
        let start = self.units.checked(&self.inner, &vector("start", &start)?).into_py()?;
        let moves = moves.inner.view();
        let result = py.detach(|| {
            self.inner.check(&moves)?;
            self.inner.check_surface(&moves, &start)?;
            let rows = closed_form::PaperRows::find(&self.inner, &moves, &labels)?;
            let mut scratch = closed_form::Scratch::default();
            let found = closed_form::separate(&self.inner, &rows, &moves, &start, &mut scratch)?;
            Ok((found, closed_form::separating_operator(&rows, moves.len())?))
        });
        let (found, operator) = result.into_py()?;
        let values = array(py, self.units.to_user(&found.values))?;
        let operator = matrix(py, self.units.operator(operator, moves.len()), moves.len())?;
        Ok((values, found.kappa / UM, found.zeta / UM, operator))
    }

    /// The printed closed forms: errors (8,), per C (k, 7: C, EA, EB, EC, EX, EY, EZ), per A (m, 3: A,
    /// EB, EY), in µm, arcsec and degrees, and the change of the errors for one µm of each reading
    /// (8, n).
    fn printed<'py>(
        &self,
        py: Python<'py>,
        moves: &Moves,
        labels: Vec<i64>,
    ) -> PyResult<(
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray2<f64>>,
    )> {
        let moves = moves.inner.view();
        let found = py.detach(|| -> Result<(closed_form::Printed, Vec<f64>)> {
            self.inner.check(&moves)?;
            let rows = closed_form::PaperRows::find(&self.inner, &moves, &labels)?;
            rows.upright()?;
            let found = closed_form::printed(&self.inner, &rows, &moves);
            Ok((found, closed_form::printed_operator(&self.inner, &rows, &moves)))
        });
        let (found, operator) = found.into_py()?;
        let turned = found.turned.iter().flat_map(|t| {
            [
                t.angle / DEG,
                t.ea / ARCSEC,
                t.eb_c / ARCSEC,
                t.ec / ARCSEC,
                t.ex / UM,
                t.ey_c / UM,
                t.ez / UM,
            ]
        });
        let tilted =
            found.tilted.iter().flat_map(|t| [t.angle / DEG, t.eb_a / ARCSEC, t.ey_a / UM]);
        let (turned, tilted) = (turned.collect(), tilted.collect());
        let errors = array(py, self.units.to_user(&found.errors))?;
        let operator = matrix(py, self.units.operator(operator, moves.len()), moves.len())?;
        Ok((errors, matrix(py, turned, 7)?, matrix(py, tilted, 3)?, operator))
    }
}

pub fn simulation(from_start: bool, reach_mm: f64, noise_um: f64, seed: u64) -> Simulation {
    let search = if from_start { Search::Ahead } else { Search::Nearest };
    Simulation { search, reach: reach_mm, noise: noise_um * UM, seed }
}

/// Corrections of the printed equations, each with its reason.
#[pyfunction]
pub fn closed_form_slips() -> Vec<&'static str> {
    closed_form::SLIPS.to_vec()
}
