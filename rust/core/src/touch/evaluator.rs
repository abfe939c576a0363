//! Readings and their derivatives row by row.

use nalgebra::{Matrix3, Vector3};

use super::TouchModel;
use crate::artefact::{Contact, Line, Search, Solid};
use crate::effects::{Circumstances, Rate};
use crate::machine::places::COUNT;
use crate::machine::posture::linear;
use crate::machine::{Component, Frames, MAX_ROTARY, Machine, Place, Places, Posture, Side};
use crate::moves::Moves;
use crate::pose::Direction;

/// Between what gaps it is sought by how much a line misses the artefact, mm.
const SMALLEST_GAP_MM: f64 = 1e-4;
const LARGEST_GAP_MM: f64 = 1e5;

/// Goes through touches row by row and keeps what rows share while the axes stand still.
pub struct Evaluator<'a> {
    model: &'a TouchModel,
    moves: Moves<'a>,
    first_time: f64,
    values: &'a [f64],
    constant: Places,
    pose: Option<TouchPose>,
    rates: Vec<Rate>,
    touched: Option<Touched>,
}

/// Travel of a row's touch at the present pose, and its rates by the amounts at all places.
struct Touched {
    row: usize,
    travel: f64,
    by_place: [f64; COUNT],
}

/// Machine and artefact at one set of axis positions and amounts at the places.
struct TouchPose {
    positions: [f64; MAX_ROTARY],
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

impl TouchPose {
    fn new(model: &TouchModel, positions: &[f64], places: &Places) -> Self {
        let frames = Frames::new(places);
        let mut pose = Self {
            positions: [0.0; MAX_ROTARY],
            places: *places,
            posture: Posture::with_frames(&model.machine, positions, &frames),
            frames,
            solid: model.artefact.solid(places),
            gain: Matrix3::zeros(),
            shift: Vector3::zeros(),
            radius: 0.0,
        };
        pose.positions[..positions.len()].copy_from_slice(positions);
        pose.complete(model);
        pose
    }

    /// Goes to other positions and amounts: an effect in time moves the tool, and leaves frames,
    /// posture and artefact as they are.
    fn go(&mut self, model: &TouchModel, positions: &[f64], places: &Places) {
        let other_frames = self.places.pose_part() != places.pose_part();
        if other_frames {
            self.frames = Frames::new(places);
        }
        let kept = &mut self.positions[..positions.len()];
        if other_frames || kept != positions {
            kept.copy_from_slice(positions);
            self.posture = Posture::with_frames(&model.machine, positions, &self.frames);
        }
        if self.places.shape_part() != places.shape_part() {
            self.solid = model.artefact.solid(places);
        }
        self.places = *places;
        self.complete(model);
    }

    /// Works out what hangs on all of it.
    fn complete(&mut self, model: &TouchModel) {
        let (artefact, places) = (&self.posture.artefact, &self.places);
        let origin = self.posture.actual(&Vector3::zeros(), places);
        self.gain = artefact.rotation.tr_mul(&(Matrix3::identity() + linear(places)));
        self.shift = artefact.undo(&origin);
        self.radius = model.probe.ball_radius + places.at(Place::RADIUS);
    }

    /// The move of the ball's true centre as the artefact sees it.
    fn line(&self, point: &Vector3<f64>, direction: &Vector3<f64>) -> Line {
        Line { origin: self.gain * point + self.shift, direction: self.gain * direction }
    }
}

impl<'a> Evaluator<'a> {
    /// At the first row.
    pub(super) fn new(model: &'a TouchModel, moves: &Moves<'a>, values: &'a [f64]) -> Self {
        Self {
            model,
            moves: *moves,
            first_time: moves.first_time(),
            values,
            constant: model.constant_places(values),
            pose: None,
            rates: Vec::new(),
            touched: None,
        }
    }

    /// Takes other parameter values; `constant`: places of those that are no effect's. What does
    /// not change with them stays known.
    pub(super) fn take(&mut self, values: &'a [f64], constant: &Places) {
        self.values = values;
        if self.constant != *constant {
            self.constant = *constant;
            self.pose = None;
        }
    }

    /// Brings the pose to a row, computing only what changed.
    fn pose(&mut self, row: usize, with_rates: bool) -> Option<&TouchPose> {
        let model = self.model;
        let axes = model.machine.rotary().len();
        let positions = &self.moves.rotary[axes * row..axes * (row + 1)];
        let places = if model.effects.is_empty() {
            None
        } else {
            Some(self.act(row, positions, with_rates))
        };
        let same = self.pose.as_ref().is_some_and(|pose| {
            pose.positions[..axes] == *positions
                && places.as_ref().is_none_or(|places| pose.places == *places)
        });
        if !same {
            let places = places.as_ref().unwrap_or(&self.constant);
            match &mut self.pose {
                Some(pose) => pose.go(model, positions, places),
                None => self.pose = Some(TouchPose::new(model, positions, places)),
            }
            self.touched = None;
        }
        self.pose.as_ref()
    }

    /// The amounts at all places in a row; their rates by the effects' parameters go to `rates`.
    fn act(&mut self, row: usize, positions: &[f64], with_rates: bool) -> Places {
        let axes = positions.len();
        let none = [0.0; MAX_ROTARY];
        let time = self.moves.time.map_or(0.0, |time| time[row]);
        let circumstances = Circumstances {
            rotary: positions,
            sense: match self.moves.sense {
                Some(sense) => &sense[axes * row..axes * (row + 1)],
                None => &none[..axes],
            },
            direction: Moves::vector(self.moves.direction, row),
            feed: self.moves.feed_at(row),
            time,
            elapsed: time - self.first_time,
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
        let pose = self.pose(row, false)?;
        pose.solid.first_contact(&pose.line(&point, &direction), pose.radius, search)
    }

    /// Recorded centre of the ball of a row, mm.
    pub(super) fn point(&self, row: usize) -> Vector3<f64> {
        Moves::vector(self.moves.point, row)
    }

    /// How far from the artefact the ball passes that misses it, mm: by how much a larger ball
    /// would touch. `None` where none does, as in a ring.
    pub(super) fn gap(&mut self, row: usize) -> Option<f64> {
        let point = self.point(row);
        let direction = Moves::vector(self.moves.direction, row);
        let pose = self.pose(row, false)?;
        let line = pose.line(&point, &direction);
        let touches = |gap: f64| {
            pose.solid.first_contact(&line, pose.radius + gap, Search::Nearest).is_some()
        };
        let (mut missed, mut touched) = (0.0, SMALLEST_GAP_MM);
        while !touches(touched) {
            (missed, touched) = (touched, 2.0 * touched);
            if touched > LARGEST_GAP_MM {
                return None;
            }
        }
        while touched - missed > SMALLEST_GAP_MM {
            let middle = f64::midpoint(missed, touched);
            if touches(middle) {
                touched = middle;
            } else {
                missed = middle;
            }
        }
        Some(touched)
    }

    /// Predicted minus recorded coordinate along the approach, mm.
    pub fn deviation(&mut self, row: usize) -> Option<f64> {
        let contact = self.contact(row, Search::Nearest)?;
        Some(contact.travel + self.model.probe.mean_delay(self.moves.feed_at(row)))
    }

    /// The deviation of a row and its derivative with respect to every parameter.
    pub fn gradient(&mut self, row: usize, gradient: &mut [f64]) -> Option<f64> {
        let model = self.model;
        self.pose(row, true)?;
        if self.touched.as_ref().is_none_or(|touched| touched.row != row) {
            let point = Moves::vector(self.moves.point, row);
            let direction = Moves::vector(self.moves.direction, row);
            let pose = self.pose.as_ref()?;
            let line = pose.line(&point, &direction);
            let contact = pose.solid.first_contact(&line, pose.radius, Search::Nearest)?;
            let recorded = point + direction * contact.travel;
            let by_place = by_place(&model.machine, pose, &contact, &recorded, &line.direction);
            self.touched = Some(Touched { row, travel: contact.travel, by_place });
        }
        let Touched { travel, by_place, .. } = self.touched.as_ref()?;
        gradient.fill(0.0);
        for &(parameter, place, factor) in &model.constant {
            gradient[parameter] += factor * by_place[place.index()];
        }
        for rate in &self.rates {
            gradient[rate.parameter] += rate.rate * by_place[rate.place.index()];
        }
        Some(travel + model.probe.mean_delay(self.moves.feed_at(row)))
    }
}

/// d travel / d amount, for every place: minus the rate of the distance from ball to artefact over
/// its rate by travel. All rates are linear in the normal, so that it is scaled once.
fn by_place(
    machine: &Machine,
    pose: &TouchPose,
    contact: &Contact,
    recorded: &Vector3<f64>,
    line_direction: &Vector3<f64>,
) -> [f64; COUNT] {
    let TouchPose { posture, places, .. } = pose;
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
