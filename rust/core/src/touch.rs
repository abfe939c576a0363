//! What the probe reads: the model of a touch, its exact derivative, and the simulation of a plan.
//!
//! The ball moves along a straight line in recorded coordinates, p(s) = p₀ + s d. Its true centre
//! is (I + Λ) p + δ, and it touches where that centre is the effective radius away from the
//! artefact, which sits at T_A Rx(a) T_C Rz(c) T_S. One touch is one reading: s at contact. With
//! F(s, θ) = distance − radius, ds/dθ = −(∂F/∂θ) / (∂F/∂s): exact, on faces, edges and corners.

use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::artefact::{Artefact, Contact, Line, Search, Solid};
use crate::effects::{Circumstances, Effect, Kind, Need, Rate};
use crate::machine::places::COUNT;
use crate::machine::posture::linear;
use crate::machine::{Component, Frames, LocationError, Machine, Place, Places, Posture, Side};
use crate::moves::Moves;
use crate::probe::Probe;
use crate::units::Unit;
use crate::{Error, Result};

/// A recorded touch further than this from the modelled surface belongs to no model, mm.
pub const OFF_SURFACE_MM: f64 = 5.0;

/// The number and meaning of a model's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterName {
    /// `EX0C`, `dx_um`, `drift_z.rate_um_h`.
    pub name: String,
    /// Unit at the face.
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
    /// Where the location errors and the placement act: parameter, place, factor.
    constant: Vec<(usize, Place, f64)>,
    /// What one of the face's units is in mm, rad, s.
    units: Vec<f64>,
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
        let mut model =
            Self { machine, artefact, probe, errors, effects, constant, units: Vec::new() };
        let names = model.parameter_names();
        model.units = names.iter().map(|name| name.unit.to_internal()).collect();
        model
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

    /// Number of parameters.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.units.len()
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

    /// What one of the face's units is in mm, rad, s, for every parameter.
    #[must_use]
    pub fn units(&self) -> &[f64] {
        &self.units
    }

    /// Parameter values from the face's units.
    ///
    /// # Errors
    /// Another number of values than parameters, or one that is not finite.
    pub fn from_face(&self, values: &[f64]) -> Result<Vec<f64>> {
        if values.len() != self.units.len() {
            let wanted = format!("{} of them", self.units.len());
            return Err(Error::input("parameter values", values.len(), wanted));
        }
        if let Some(bad) = values.iter().position(|value| !value.is_finite()) {
            let name = self.parameter_names().swap_remove(bad).name;
            return Err(Error::input(name, values[bad], "a finite number"));
        }
        Ok(values.iter().zip(&self.units).map(|(value, unit)| value * unit).collect())
    }

    /// Checks that the moves carry what the machine and the effects need.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, directions that are not unit vectors, a column
    /// that an effect needs and that is not there.
    pub fn check(&self, moves: &Moves) -> Result<()> {
        moves.check(self.machine.rotary().len())?;
        for effect in &self.effects {
            if let Some(column) = self.missing(effect, moves) {
                let what = format!("effect {:?}", effect.id);
                let got = format!("data without column {column}");
                return Err(Error::input(what, got, format!("data with column {column}")));
            }
        }
        Ok(())
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
        let mut places = Places::default();
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

    /// A walk over the rows of `moves` at these parameter values.
    #[must_use]
    pub fn walk<'a>(&'a self, moves: &Moves<'a>, values: &'a [f64]) -> Walk<'a> {
        Walk {
            model: self,
            moves: *moves,
            values,
            constant: self.constant_places(values),
            stand: None,
            rates: Vec::new(),
        }
    }

    /// Readings along the recorded lines: predicted minus recorded coordinate along the approach,
    /// in mm, with the mean delay of the trigger. `None` where a line misses the artefact.
    pub fn deviations(&self, moves: &Moves, values: &[f64], out: &mut [Option<f64>]) {
        let mut walk = self.walk(moves, values);
        for (row, slot) in out.iter_mut().enumerate() {
            *slot = walk.deviation(row);
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
        let mut walk = self.walk(moves, values);
        let rows = jacobian.chunks_exact_mut(self.parameter_count());
        for (row, (slot, gradient)) in deviations.iter_mut().zip(rows).enumerate() {
            match walk.gradient(row, gradient) {
                Some(deviation) => *slot = deviation,
                None => return false,
            }
        }
        true
    }

    /// Checks that every recorded touch lies near the modelled surface.
    ///
    /// # Errors
    /// Rows further than [`OFF_SURFACE_MM`] from it, or whose line misses the artefact.
    pub fn check_surface(&self, moves: &Moves, values: &[f64]) -> Result<()> {
        let mut walk = self.walk(moves, values);
        for row in 0..moves.len() {
            let problem = match walk.deviation(row) {
                Some(deviation) if deviation.abs() <= OFF_SURFACE_MM => continue,
                Some(deviation) => {
                    format!("lies {:.3} mm from the modelled surface", deviation.abs())
                }
                None => "moves along a line that misses the modelled artefact".to_owned(),
            };
            return Err(Error::Data(format!(
                "touch in row {row} {problem}; wanted at most {OFF_SURFACE_MM} mm: check the \
                 artefact's kind and dimensions, the machine preset and the signs of its axes"
            )));
        }
        Ok(())
    }
}

/// Goes through touches row by row and keeps what rows share while the axes stand still.
pub struct Walk<'a> {
    model: &'a TouchModel,
    moves: Moves<'a>,
    values: &'a [f64],
    constant: Places,
    stand: Option<Stand>,
    rates: Vec<Rate>,
}

/// Machine and artefact at one set of axis positions and amounts at the places.
struct Stand {
    positions: [f64; crate::machine::MAX_ROTARY],
    places: Places,
    frames: Frames,
    posture: Posture,
    solid: Solid,
    /// artefact_from_recorded: Rᵀ (I + Λ), and where the origin goes.
    gain: Matrix3<f64>,
    shift: Vector3<f64>,
    /// Effective radius of the ball.
    radius: f64,
}

impl Stand {
    fn new(model: &TouchModel, positions: &[f64], places: &Places, frames: Frames) -> Self {
        let posture = Posture::with_frames(&model.machine, positions, &frames);
        let mut kept = [0.0; crate::machine::MAX_ROTARY];
        kept[..positions.len()].copy_from_slice(positions);
        let origin = posture.actual(&Vector3::zeros(), places);
        Self {
            positions: kept,
            places: *places,
            frames,
            solid: model.artefact.solid(places),
            gain: posture.artefact.rotation.tr_mul(&(Matrix3::identity() + linear(places))),
            shift: posture.artefact.undo(&origin),
            radius: model.probe.ball_radius + places.at(Place::RADIUS),
            posture,
        }
    }

    /// The move of the ball's true centre as the artefact sees it.
    fn line(&self, point: &Vector3<f64>, direction: &Vector3<f64>) -> Line {
        Line { origin: self.gain * point + self.shift, direction: self.gain * direction }
    }
}

impl Walk<'_> {
    /// Brings the stand to a row, computing only what changed.
    fn stand(&mut self, row: usize, with_rates: bool) -> Option<&Stand> {
        let model = self.model;
        let axes = model.machine.rotary().len();
        let positions = &self.moves.rotary[axes * row..axes * (row + 1)];
        let places = if model.effects.is_empty() {
            None
        } else {
            Some(self.act(row, positions, with_rates))
        };
        let stands = self.stand.as_ref().is_some_and(|stand| {
            stand.positions[..axes] == *positions
                && places.as_ref().is_none_or(|places| stand.places == *places)
        });
        if !stands {
            let places = places.as_ref().unwrap_or(&self.constant);
            let frames = match &self.stand {
                Some(stand) if model.effects.is_empty() => stand.frames,
                _ => Frames::new(places),
            };
            self.stand = Some(Stand::new(model, positions, places, frames));
        }
        self.stand.as_ref()
    }

    /// The amounts at all places in a row; their rates by the effects' parameters go to `rates`.
    fn act(&mut self, row: usize, positions: &[f64], with_rates: bool) -> Places {
        let axes = positions.len();
        let none = [0.0; crate::machine::MAX_ROTARY];
        let circumstances = Circumstances {
            rotary: positions,
            sense: match self.moves.sense {
                Some(sense) => &sense[axes * row..axes * (row + 1)],
                None => &none[..axes],
            },
            direction: Moves::vector(self.moves.direction, row),
            feed: self.moves.feed.map_or(0.0, |feed| feed[row]),
            time: self.moves.time.map_or(0.0, |time| time[row]),
        };
        let mut places = self.constant;
        self.rates.clear();
        let rates = with_rates.then_some(&mut self.rates);
        self.model.add_effects(&circumstances, self.values, &mut places, rates);
        places
    }

    /// First contact of a row's move, travel counted from its point, without the delay of the
    /// trigger.
    pub fn contact(&mut self, row: usize, search: Search) -> Option<Contact> {
        let point = Moves::vector(self.moves.point, row);
        let direction = Moves::vector(self.moves.direction, row);
        let stand = self.stand(row, false)?;
        stand.solid.first_contact(&stand.line(&point, &direction), stand.radius, search)
    }

    /// Predicted minus recorded coordinate along the approach, mm.
    pub fn deviation(&mut self, row: usize) -> Option<f64> {
        let contact = self.contact(row, Search::Nearest)?;
        Some(contact.travel + self.model.probe.mean_delay())
    }

    /// The deviation of a row and its derivative with respect to every parameter.
    pub fn gradient(&mut self, row: usize, gradient: &mut [f64]) -> Option<f64> {
        let model = self.model;
        let point = Moves::vector(self.moves.point, row);
        let direction = Moves::vector(self.moves.direction, row);
        let stand = self.stand(row, true)?;
        let line = stand.line(&point, &direction);
        let contact = stand.solid.first_contact(&line, stand.radius, Search::Nearest)?;
        let recorded = point + direction * contact.travel;
        let by_place = by_place(&model.machine, stand, &contact, &recorded, &line.direction);
        gradient.fill(0.0);
        for &(parameter, place, factor) in &model.constant {
            gradient[parameter] += factor * by_place[place.index()];
        }
        for rate in &self.rates {
            gradient[rate.parameter] += rate.rate * by_place[rate.place.index()];
        }
        Some(contact.travel + model.probe.mean_delay())
    }
}

/// d travel / d amount, for every place: minus the rate of the distance from ball to artefact over
/// its rate by travel. All rates are linear in the normal, so that it is scaled once.
fn by_place(
    machine: &Machine,
    stand: &Stand,
    contact: &Contact,
    recorded: &Vector3<f64>,
    line_direction: &Vector3<f64>,
) -> [f64; COUNT] {
    use crate::pose::Direction;
    let Stand { posture, places, .. } = stand;
    let scale = -1.0 / contact.normal.dot(line_direction);
    let normal = posture.artefact.rotation * contact.normal * scale;
    let centre = posture.actual(recorded, places);
    let mut rates = [0.0; COUNT];
    for (axis, rotary) in machine.rotary().iter().enumerate() {
        let joint = &posture.joints[axis];
        // The table moves the artefact, a head moves the ball.
        let (sign, values) = match rotary.side {
            Side::Workpiece => (-1.0, joint.rates(&centre, &normal)),
            Side::Tool => (1.0, joint.rates(&posture.tool, &normal)),
        };
        for (component, value) in Component::ALL.into_iter().zip(values) {
            rates[Place::frame(axis, component).index()] = sign * value;
        }
        rates[Place::turn(axis).index()] = sign * values[6];
    }
    let placement = posture.placement.rates(&centre, &normal);
    for (component, value) in Component::ALL.into_iter().zip(placement) {
        rates[Place::placement(component).index()] = -value;
    }
    for row in Direction::ALL {
        for column in Direction::ALL {
            let rate = normal[row.index()] * recorded[column.index()];
            rates[Place::linear(row, column).index()] = rate;
        }
        rates[Place::offset(row).index()] = normal[row.index()];
    }
    rates[Place::RADIUS.index()] = -scale;
    for (place, rate) in [Place::LENGTH, Place::WIDTH, Place::HEIGHT, Place::SQUARENESS]
        .into_iter()
        .zip(contact.shape_rates)
    {
        rates[place.index()] = rate * scale;
    }
    rates
}

/// How a plan is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Simulation {
    /// What the rows' points are: starts of moves, or touches recorded before.
    pub search: Search,
    /// Longest travel of a move, mm.
    pub reach: f64,
    /// Standard deviation of the probe's repeatability, mm.
    pub noise: f64,
    /// Seed; the noise of sample number `sample` does not depend on any other sample.
    pub seed: u64,
}

impl TouchModel {
    /// Travel at the trigger for every row: contact plus noise, then the next tick.
    ///
    /// `values` are the true parameters; `sample` numbers independent measurements of one seed.
    ///
    /// # Errors
    /// A move that does not touch the artefact within its reach, or starts inside it.
    pub fn simulate(
        &self,
        moves: &Moves,
        values: &[f64],
        simulation: &Simulation,
        sample: u64,
        travel: &mut [f64],
    ) -> Result<()> {
        let mut walk = self.walk(moves, values);
        let mut random = Pcg64::new(u128::from(simulation.seed), u128::from(sample));
        for (row, slot) in travel.iter_mut().enumerate() {
            let contact = walk.contact(row, simulation.search);
            let reached = contact.filter(|contact| contact.travel.abs() <= simulation.reach);
            let contact = reached.ok_or_else(|| {
                let problem = match contact {
                    Some(contact) => format!("touches only after {:.3} mm", contact.travel),
                    None => "does not touch the artefact, or starts inside it".to_owned(),
                };
                let wanted = format!("a touch within {} mm", simulation.reach);
                Error::Data(format!("move in row {row} {problem}; wanted {wanted}"))
            })?;
            let noise: f64 =
                if simulation.noise > 0.0 { StandardNormal.sample(&mut random) } else { 0.0 };
            *slot = self.probe.trigger(contact.travel + simulation.noise * noise);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::catalogue;
    use crate::units::{ARCSEC, UM};

    /// Central differences of the whole model against the exact gradient, every effect at once.
    #[test]
    fn gradients_agree_with_central_differences() {
        for preset in crate::machine::PRESETS {
            let machine = Machine::preset(preset, 150.0).unwrap();
            let artefact = Artefact::Cross { length: 100.0, width: 25.0, height: 25.0 };
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
                let posture = Posture::new(model.machine(), positions, &Places::default());
                posture.table.apply(&point.into())
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
