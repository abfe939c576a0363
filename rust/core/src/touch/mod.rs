//! What the probe reads: the model of a touch, its exact derivative, and the simulation of a plan.
//!
//! The ball moves along a straight line in recorded coordinates, p(s) = p₀ + s d. Its true centre
//! is (I + Λ) p + δ, and it touches where that centre is the effective radius away from the
//! artefact, which sits at T_A Rx(a) T_C Rz(c) T_S. One touch is one reading: s at contact. With
//! F(s, θ) = distance − radius, ds/dθ = −(∂F/∂θ) / (∂F/∂s): exact, on faces, edges and corners.

mod evaluator;
mod simulation;

pub use evaluator::Evaluator;
pub use simulation::Simulation;

use crate::artefact::{Artefact, Fixture};
use crate::effects::{Circumstances, Effect, Kind, Need, Rate};
use crate::machine::{Component, LocationError, Machine, Place, Places, Posture};
use crate::moves::Moves;
use crate::probe::Probe;
use crate::units::Unit;
use crate::{Error, Result};

/// A recorded touch further than this from the modelled surface belongs to no model, mm.
pub const MAX_OFF_SURFACE_MM: f64 = 5.0;

/// Touches whose derivatives are turned into rows of parameters at a time.
const ROWS_TURNED: usize = 64;

/// The number and meaning of a model's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterName {
    /// `EX0C`, `dx_um`, `drift_z.rate_um_h`.
    pub name: String,
    /// Unit that its name counts in.
    pub unit: Unit,
    /// How an estimate of it is found.
    pub kind: Kind,
}

/// The model of touches: machine, artefact and probe with the location errors, the placement and
/// the parameters of some effects, in this order, as its parameters (mm, rad, s).
#[derive(Clone, Debug)]
pub struct TouchModel {
    machine: Machine,
    artefact: Artefact,
    probe: Probe,
    errors: Vec<LocationError>,
    effects: Vec<Effect>,
    /// The machine without errors, the artefact where it nominally stands.
    nominal: Places,
    /// Where the location errors and the placement act: parameter, place, factor.
    constant: Vec<(usize, Place, f64)>,
    parameters: usize,
}

/// Names of the placement parameters: offsets in µm, tilts in arcsec.
pub const PLACEMENT: [&str; 6] = ["dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec"];

impl TouchModel {
    /// A model of these parts with these effects.
    #[must_use]
    pub fn new(machine: Machine, artefact: Artefact, probe: Probe, effects: Vec<Effect>) -> Self {
        let errors = machine.location_errors();
        let of_errors = errors.iter().map(|error| machine.places_of(error));
        let of_placement = Component::ALL.iter().map(|c| vec![(Place::placement(*c), 1.0)]);
        let constant = of_errors
            .chain(of_placement)
            .enumerate()
            .flat_map(|(k, targets)| targets.into_iter().map(move |(place, f)| (k, place, f)))
            .collect();
        let of_effects: usize = effects.iter().map(|effect| effect.parameters.len()).sum();
        let parameters = errors.len() + Component::ALL.len() + of_effects;
        let mut nominal = machine.nominal();
        Fixture::default().add_to(&machine, &mut nominal);
        Self { machine, artefact, probe, errors, effects, nominal, constant, parameters }
    }

    /// The model with the artefact standing like this on the table; unless this is said, in its
    /// middle.
    #[must_use]
    pub fn standing(mut self, fixture: &Fixture) -> Self {
        self.nominal = self.machine.nominal();
        fixture.add_to(&self.machine, &mut self.nominal);
        self
    }

    /// The places of the machine without errors with the artefact where it nominally stands.
    #[must_use]
    pub const fn nominal(&self) -> &Places {
        &self.nominal
    }

    /// The machine.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The artefact.
    #[must_use]
    pub const fn artefact(&self) -> &Artefact {
        &self.artefact
    }

    /// The probe.
    #[must_use]
    pub const fn probe(&self) -> &Probe {
        &self.probe
    }

    /// The machine's location errors, the first parameters.
    #[must_use]
    pub fn errors(&self) -> &[LocationError] {
        &self.errors
    }

    /// The effects.
    #[must_use]
    pub fn effects(&self) -> &[Effect] {
        &self.effects
    }

    /// Number of location errors and placement parameters: those of the plain model.
    #[must_use]
    pub const fn plain_count(&self) -> usize {
        self.errors.len() + Component::ALL.len()
    }

    /// Which parameters are unknowns: a turn of what looks alike from all sides is none.
    #[must_use]
    pub fn unknown(&self) -> Vec<bool> {
        let mut unknown = vec![true; self.parameters];
        let tilts = self.errors.len() + 3;
        unknown[tilts..tilts + 3].copy_from_slice(&self.artefact.turns());
        unknown
    }

    /// Number of parameters.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.parameters
    }

    /// Names and units of all parameters, in order.
    #[must_use]
    pub fn parameter_names(&self) -> Vec<ParameterName> {
        let plain = |name: String, unit| ParameterName { name, unit, kind: Kind::Linear };
        let mut names: Vec<_> = self.errors.iter().map(|e| plain(e.name(), e.unit())).collect();
        for (i, name) in PLACEMENT.into_iter().enumerate() {
            names.push(plain(name.to_owned(), if i < 3 { Unit::Um } else { Unit::Arcsec }));
        }
        for effect in &self.effects {
            names.extend(effect.parameters.iter().map(|p| ParameterName {
                name: format!("{}.{}", effect.id, p.name),
                unit: p.unit,
                kind: p.kind,
            }));
        }
        names
    }

    /// Checks parameter values, mm, rad, s.
    ///
    /// # Errors
    /// Another number of values than parameters, or one that is not finite.
    pub fn check_values(&self, values: &[f64]) -> Result<()> {
        if values.len() != self.parameters {
            let expected = format!("{} of them", self.parameters);
            return Err(Error::input("parameter values", values.len(), expected));
        }
        if let Some(bad) = values.iter().position(|value| !value.is_finite()) {
            let name = self.parameter_names().swap_remove(bad).name;
            return Err(Error::input(name, values[bad], "a finite number"));
        }
        Ok(())
    }

    /// Checks that the moves carry what the machine and the effects need.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, directions that are not unit vectors, a column
    /// that an effect needs and that is not there.
    pub fn check(&self, moves: &Moves) -> Result<()> {
        moves.check(self.machine.rotary().len())?;
        if self.probe.period > 0.0 && moves.feed.is_none() {
            let got = "data without column feed_mm_min".to_owned();
            let expected = "data with column feed_mm_min: the tick is the feed times the period";
            return Err(Error::input("servo period of the probe", got, expected));
        }
        for effect in &self.effects {
            if let Some(column) = self.missing(effect, moves) {
                let what = format!("effect {:?}", effect.id);
                let got = format!("data without column {column}");
                return Err(Error::input(what, got, format!("data with column {column}")));
            }
        }
        Ok(())
    }

    /// Standard deviation of the errors of rounding to ticks, rms over the rows, mm.
    #[must_use]
    pub fn rounding(&self, moves: &Moves) -> f64 {
        let squares: f64 =
            (0..moves.len()).map(|row| self.probe.tick_at(moves.feed_at(row)).powi(2)).sum();
        (squares / (12 * moves.len().max(1)) as f64).sqrt()
    }

    /// The first column that an effect needs and that the moves lack.
    #[must_use]
    pub fn missing(&self, effect: &Effect, moves: &Moves) -> Option<String> {
        effect.needs.iter().find_map(|need| match *need {
            Need::Feed if moves.feed.is_none() => Some("feed_mm_min".to_owned()),
            Need::Time if moves.time.is_none() => Some("time_s".to_owned()),
            Need::Sense(axis) if moves.sense.is_none() => {
                Some(format!("{}_dir", self.machine.rotary()[axis].letter().to_ascii_lowercase()))
            }
            _ => None,
        })
    }

    /// The amounts at all places from the location errors and the placement.
    #[must_use]
    pub fn constant_places(&self, values: &[f64]) -> Places {
        let mut places = self.nominal;
        for &(parameter, place, factor) in &self.constant {
            places.add(place, factor * values[parameter]);
        }
        places
    }

    /// Adds what the effects do under these circumstances.
    pub fn add_effects(
        &self,
        circumstances: &Circumstances,
        values: &[f64],
        places: &mut Places,
        mut rates: Option<&mut Vec<Rate>>,
    ) {
        let mut first = self.plain_count();
        for effect in &self.effects {
            let own = &values[first..first + effect.parameters.len()];
            effect.act(circumstances, own, first, places, rates.as_deref_mut());
            first += own.len();
        }
    }

    /// An evaluator over the rows of `moves` at these parameter values.
    #[must_use]
    pub fn evaluator<'a>(&'a self, moves: &Moves<'a>, values: &'a [f64]) -> Evaluator<'a> {
        Evaluator::new(self, moves, values)
    }

    /// Readings along the recorded lines: predicted minus recorded coordinate along the approach,
    /// in mm, with the mean delay of the trigger. `None` where a line misses the artefact.
    pub fn deviations(&self, moves: &Moves, values: &[f64], out: &mut [Option<f64>]) {
        let mut evaluator = self.evaluator(moves, values);
        for (row, slot) in out.iter_mut().enumerate() {
            *slot = evaluator.deviation(row);
        }
    }

    /// Deviations as [`TouchModel::deviations`] with their exact derivative, row-major n × p.
    /// False where a line misses the artefact; the arrays are then not complete.
    pub fn linearise(
        &self,
        moves: &Moves,
        values: &[f64],
        deviations: &mut [f64],
        jacobian: &mut [f64],
    ) -> bool {
        let mut evaluator = self.evaluator(moves, values);
        let rows = jacobian.chunks_exact_mut(self.parameter_count());
        for (row, (slot, gradient)) in deviations.iter_mut().zip(rows).enumerate() {
            match evaluator.gradient(row, gradient) {
                Some(deviation) => *slot = deviation,
                None => return false,
            }
        }
        true
    }

    /// Name of the face that each touch is on, on the nominal machine.
    #[must_use]
    pub fn faces(&self, moves: &Moves) -> Vec<String> {
        let axes = self.machine.rotary().len();
        let row = |row: usize| {
            let positions = &moves.rotary[axes * row..axes * (row + 1)];
            let artefact = Posture::new(&self.machine, positions, &self.nominal).artefact;
            let direction = Moves::vector(moves.direction, row);
            let contact = Moves::vector(moves.point, row) + direction * self.probe.ball_radius;
            self.artefact.face(&artefact.undo(&contact), &-artefact.rotation.tr_mul(&direction))
        };
        (0..moves.len()).map(row).collect()
    }

    /// Readings as [`TouchModel::deviations`], of touches that lie near the modelled surface.
    ///
    /// # Errors
    /// Rows further than [`MAX_OFF_SURFACE_MM`] from it, or whose line misses the artefact.
    pub fn deviations_near(&self, moves: &Moves, values: &[f64], out: &mut [f64]) -> Result<()> {
        let mut evaluator = self.evaluator(moves, values);
        for (row, slot) in out.iter_mut().enumerate() {
            let deviation = evaluator.deviation(row);
            *slot = near(&mut evaluator, row, deviation)?;
        }
        Ok(())
    }

    /// Deviations with their derivative as [`TouchModel::linearise`], of touches that lie near the
    /// modelled surface.
    ///
    /// # Errors
    /// As [`TouchModel::deviations_near`].
    pub fn linearise_near(
        &self,
        moves: &Moves,
        values: &[f64],
        deviations: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<()> {
        let mut evaluator = self.evaluator(moves, values);
        let rows = jacobian.chunks_exact_mut(self.parameter_count());
        for (row, (slot, gradient)) in deviations.iter_mut().zip(rows).enumerate() {
            let deviation = evaluator.gradient(row, gradient);
            *slot = near(&mut evaluator, row, deviation)?;
        }
        Ok(())
    }

    /// Derivatives by some parameters at several values each, in one pass through the touches: what
    /// does not change between the values is calculated once. Row `k` of all columns at the values
    /// number `v` is row `v · columns + k` of `out`, with a number for each touch.
    ///
    /// # Errors
    /// As [`TouchModel::deviations_near`].
    pub fn rates_near(
        &self,
        moves: &Moves,
        values: &[Vec<f64>],
        columns: &[usize],
        out: &mut [f64],
    ) -> Result<()> {
        let (count, width) = (moves.len(), values.len() * columns.len());
        let (Some(first), true) = (values.first(), count * width > 0) else { return Ok(()) };
        let constants: Vec<Places> = values.iter().map(|one| self.constant_places(one)).collect();
        let mut evaluator = self.evaluator(moves, first);
        let mut gradient = vec![0.0; self.parameter_count()];
        let mut made = vec![0.0; ROWS_TURNED * width];
        for begun in (0..count).step_by(ROWS_TURNED) {
            let ended = count.min(begun + ROWS_TURNED);
            for (row, all) in (begun..ended).zip(made.chunks_exact_mut(width)) {
                let each = values.iter().zip(&constants).zip(all.chunks_exact_mut(columns.len()));
                for ((values, constant), own) in each {
                    evaluator.take(values, constant);
                    let deviation = evaluator.gradient(row, &mut gradient);
                    near(&mut evaluator, row, deviation)?;
                    own.iter_mut()
                        .zip(columns)
                        .for_each(|(slot, &column)| *slot = gradient[column]);
                }
            }
            for (column, rates) in out.chunks_exact_mut(count).enumerate() {
                let turned = rates[begun..ended].iter_mut().zip(made.chunks_exact(width));
                turned.for_each(|(slot, all)| *slot = all[column]);
            }
        }
        Ok(())
    }

    /// Checks that every recorded touch lies near the modelled surface.
    ///
    /// # Errors
    /// As [`TouchModel::deviations_near`].
    pub fn check_surface(&self, moves: &Moves, values: &[f64]) -> Result<()> {
        let mut evaluator = self.evaluator(moves, values);
        (0..moves.len()).try_for_each(|row| {
            let deviation = evaluator.deviation(row);
            near(&mut evaluator, row, deviation).map(drop)
        })
    }
}

/// The deviation of a row that lies near the modelled surface.
fn near(evaluator: &mut Evaluator, row: usize, deviation: Option<f64>) -> Result<f64> {
    let problem = match deviation {
        Some(deviation) if deviation.abs() <= MAX_OFF_SURFACE_MM => return Ok(deviation),
        Some(deviation) => format!(
            "touch in row {row} lies {:.3} mm from the modelled surface; expected at most \
             {MAX_OFF_SURFACE_MM} mm",
            deviation.abs()
        ),
        None => {
            let ball = evaluator.point(row);
            let by = evaluator.gap(row).map_or_else(String::new, |gap| format!(" by {gap:.3} mm"));
            format!(
                "touch in row {row} with the ball at ({:.3}, {:.3}, {:.3}) mm: the ball misses the \
                 modelled artefact{by} all along its approach; expected a contact within \
                 {MAX_OFF_SURFACE_MM} mm of that place",
                ball.x, ball.y, ball.z
            )
        }
    };
    Err(Error::Data(format!(
        "{problem}: check the artefact's kind and dimensions, the machine preset and the signs of \
         its axes"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    use crate::effects::catalogue;
    use crate::units::{ARCSEC, UM};

    /// Central differences of the whole model against the exact gradient, every effect at once.
    #[test]
    fn gradients_agree_with_central_differences() {
        for machine in crate::machine::examples(150.0) {
            let preset = machine.code().to_owned();
            let artefact = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
            let effects = catalogue(&machine, &artefact);
            let probe = Probe::new(1.0, 0.0).unwrap();
            let model = TouchModel::new(machine, artefact, probe, effects);
            // A top face tilted by half a radian, and the edge of a bar.
            let (rotary, sense) = ([0.5, 2.1, 0.0, 0.4], [1.0, -1.0, -1.0, 1.0]);
            let mut values: Vec<f64> = (0..model.parameter_count())
                .map(|i| (1.0 + (i as f64 * 1.7).sin()) * 20.0 * ARCSEC.max(UM / 10.0))
                .collect();
            let names = model.parameter_names();
            for (value, name) in values.iter_mut().zip(&names) {
                match name.name.as_str() {
                    "setup_shift.t0_s" => *value = 50.0,
                    "warmup_z.tau_min" => *value = 600.0,
                    _ => {}
                }
            }
            let direction: Vector3<f64> = Vector3::new(0.2, -0.3, -0.9).normalize();
            let on_table = |positions: &[f64], point: [f64; 3]| {
                let posture = Posture::new(model.machine(), positions, model.nominal());
                posture.artefact.apply(&point.into())
            };
            let face = on_table(&rotary[..2], [37.5, 2.0, 26.0]);
            let edge = on_table(&rotary[2..], [12.9, 37.0, 25.7]);
            let point: Vec<f64> = face.iter().chain(edge.iter()).copied().collect();
            let direction: Vec<f64> = direction.iter().chain(direction.iter()).copied().collect();
            let moves = Moves {
                rotary: &rotary,
                point: &point,
                direction: &direction,
                feed: Some(&[10.0, 5.0]),
                time: Some(&[100.0, 40.0]),
                sense: Some(&sense),
            };
            model.check(&moves).unwrap();
            let p = model.parameter_count();
            let (mut deviations, mut jacobian) = (vec![0.0; 2], vec![0.0; 2 * p]);
            assert!(model.linearise(&moves, &values, &mut deviations, &mut jacobian));
            // The same by some parameters at several values in one pass, to the last bit.
            let mut other = values.clone();
            other[p - 1] *= 2.0;
            let columns = [p - 1, 0, 3];
            let several = [values.clone(), other.clone(), values.clone()];
            let mut rates = vec![0.0; 3 * 3 * 2];
            let found = model.rates_near(&moves, &several, &columns, &mut rates);
            let mut far = false;
            for (v, at) in several.iter().enumerate() {
                let mut whole = vec![0.0; 2 * p];
                assert!(model.linearise(&moves, at, &mut deviations, &mut whole));
                far |= deviations.iter().any(|d| d.abs() > MAX_OFF_SURFACE_MM);
                for (k, column) in columns.iter().enumerate().filter(|_| found.is_ok()) {
                    for row in 0..2 {
                        assert_eq!(rates[2 * (3 * v + k) + row], whole[row * p + column]);
                    }
                }
            }
            // Far from the surface they are refused.
            assert_eq!(found.is_err(), far, "{preset}");
            for k in 0..p {
                let step = 1e-6 * if names[k].unit == Unit::Min { 1e5 } else { 1.0 };
                let mut shifted = [vec![None; 2], vec![None; 2]];
                for (out, sign) in shifted.iter_mut().zip([1.0, -1.0]) {
                    let mut moved = values.clone();
                    moved[k] += sign * step;
                    model.deviations(&moves, &moved, out);
                }
                for row in 0..2 {
                    let difference =
                        (shifted[0][row].unwrap() - shifted[1][row].unwrap()) / (2.0 * step);
                    let exact = jacobian[row * p + k];
                    let scale = 1e-6 * (1.0 + exact.abs());
                    assert!(
                        (difference - exact).abs() < scale,
                        "{preset} {} row {row}: {difference} {exact}",
                        names[k].name
                    );
                }
            }
        }
    }
}
