//! The catalogue of effects: id → parameters → where each acts.
//!
//! An effect is a named group of parameters. Its law says how much it adds to which
//! [`Place`]s under the circumstances of a touch; the reading and its exact derivative follow from
//! there by the one model in [`crate::touch`]. A new effect is one more entry of
//! [`catalogue`].

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::Vector3;

use crate::artefact::Artefact;
use crate::machine::{Component, Machine, Place, Places, Rotary};
use crate::pose::Direction;
use crate::units::Unit;
use crate::{Error, Result};

/// What a law may depend on: the circumstances of one touch, in mm, rad, s.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances<'a> {
    /// Commanded positions of the rotary axes.
    pub rotary: &'a [f64],
    /// Sense of the last turn of each rotary axis: −1, 0 or 1.
    pub sense: &'a [f64],
    /// Approach direction, machine frame.
    pub direction: Vector3<f64>,
    /// Feed of the approach.
    pub feed: f64,
    /// Time of the touch, by the clock of the measurement.
    pub time: f64,
    /// Time since the first touch of the measurement: what changes with time begins there.
    pub elapsed: f64,
}

/// A quantity that a law depends on and that a measurement may lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Need {
    /// Feed of the approach.
    Feed,
    /// Time of the touch.
    Time,
    /// Sense of the last turn of this rotary axis.
    Sense(usize),
}

/// What an effect belongs to, and with it what can be done about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Owner {
    /// The machine: it moves the tool on the work and can be compensated.
    Machine,
    /// The probe.
    Probe,
    /// The artefact and its set-up.
    Artefact,
    /// Slow changes with time.
    Time,
}

impl Owner {
    /// Lower-case word for tables.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Machine => "machine",
            Self::Probe => "probe",
            Self::Artefact => "artefact",
            Self::Time => "time",
        }
    }
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name with its unit, as in the contract: `b_um`.
    pub name: &'static str,
    /// Unit that its name counts in.
    pub unit: Unit,
    /// How an estimate of it is found.
    pub kind: Kind,
}

/// How an estimate of a parameter is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// The reading is linear in it, apart from second-order geometry: by least squares.
    Linear,
    /// A moment of the measurement, s: searched between touches, then held.
    Moment,
    /// A duration, s: searched over decades, then refined by least squares.
    Duration,
}

/// Adds what a law says to the places, and notes the derivatives.
pub struct Action<'a> {
    values: &'a [f64],
    first: usize,
    places: &'a mut Places,
    rates: Option<&'a mut Vec<Rate>>,
}

/// Derivative of the amount at a place with respect to a parameter.
#[derive(Clone, Copy, Debug)]
pub struct Rate {
    /// Number of the parameter among all effects' parameters.
    pub parameter: usize,
    /// The place.
    pub place: Place,
    /// d amount / d parameter.
    pub rate: f64,
}

impl Action<'_> {
    /// Adds parameter · factor to a place.
    pub fn add(&mut self, parameter: usize, place: Place, factor: f64) {
        self.places.add(place, self.values[parameter] * factor);
        self.rate(parameter, place, factor);
    }

    /// Notes a derivative that [`Action::add`] does not give: of a parameter inside the factor.
    pub fn rate(&mut self, parameter: usize, place: Place, rate: f64) {
        let parameter = self.first + parameter;
        if let Some(rates) = self.rates.as_deref_mut() {
            rates.push(Rate { parameter, place, rate });
        }
    }

    /// Value of a parameter, mm, rad, s.
    #[must_use]
    pub fn value(&self, parameter: usize) -> f64 {
        self.values[parameter]
    }
}

type Law = Arc<dyn Fn(&Circumstances, &mut Action) + Send + Sync>;

/// A named group of parameters that changes the reading.
#[derive(Clone)]
pub struct Effect {
    /// Id as in the contract.
    pub id: String,
    /// What it is, in a few plain words.
    pub title: String,
    /// What it belongs to.
    pub owner: Owner,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// What its law depends on beyond position and direction.
    pub needs: Vec<Need>,
    law: Law,
}

impl std::fmt::Debug for Effect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Effect").field("id", &self.id).finish_non_exhaustive()
    }
}

impl Effect {
    /// Adds the effect to the places and appends its derivatives.
    ///
    /// `values` are this effect's parameters in mm, rad, s; `first` is the number of its first
    /// parameter among those of all effects in use.
    pub fn act(
        &self,
        circumstances: &Circumstances,
        values: &[f64],
        first: usize,
        places: &mut Places,
        rates: Option<&mut Vec<Rate>>,
    ) {
        (self.law)(circumstances, &mut Action { values, first, places, rates });
    }
}

/// Collects entries of the catalogue.
struct Catalogue(Vec<Effect>);

impl Catalogue {
    fn add(
        &mut self,
        id: impl Into<String>,
        title: impl Into<String>,
        owner: Owner,
        parameters: &[(&'static str, Unit)],
        law: impl Fn(&Circumstances, &mut Action) + Send + Sync + 'static,
    ) -> &mut Effect {
        let parameters = parameters
            .iter()
            .map(|&(name, unit)| Parameter { name, unit, kind: Kind::Linear })
            .collect();
        self.0.push(Effect {
            id: id.into(),
            title: title.into(),
            owner,
            parameters,
            needs: Vec::new(),
            law: Arc::new(law),
        });
        let last = self.0.len() - 1;
        &mut self.0[last]
    }
}

impl Effect {
    fn needs(&mut self, need: Need) -> &mut Self {
        self.needs.push(need);
        self
    }

    fn kind(&mut self, parameter: usize, kind: Kind) -> &mut Self {
        self.parameters[parameter].kind = kind;
        self
    }
}

/// Every effect that can act on touches of this artefact on this machine.
#[must_use]
pub fn catalogue(machine: &Machine, artefact: &Artefact) -> Vec<Effect> {
    let mut entries = Catalogue(Vec::new());
    probe(&mut entries);
    dimensions(&mut entries, artefact);
    linear_axes(&mut entries);
    for (axis, rotary) in machine.rotary().iter().enumerate() {
        let motions = AxisMotions { axis, rotary: *rotary };
        let letter = rotary.letter();
        if rotary.about() == Direction::Z {
            motions.add_positioning(&mut entries);
        } else {
            motions.add_tilting(&mut entries);
        }
        if rotary.about() == Direction::Z || machine.carrier_of_work() == Some(axis) {
            motions.add_turning(&mut entries);
        }
        rotary_backlash(&mut entries, axis, letter);
    }
    drift(&mut entries);
    entries.0
}

/// The effects with these ids, in this order.
///
/// # Errors
/// An id that is not in the catalogue, or one that stands twice.
pub fn select(catalogue: &[Effect], ids: &[String]) -> Result<Vec<Effect>> {
    let mut chosen = Vec::with_capacity(ids.len());
    for (i, id) in ids.iter().enumerate() {
        if ids[..i].contains(id) {
            return Err(Error::input("effects", format!("{id:?} twice"), "each once"));
        }
        let effect = catalogue.iter().find(|effect| &effect.id == id).ok_or_else(|| {
            Error::unknown("effect", id, catalogue.iter().map(|effect| effect.id.as_str()))
        })?;
        chosen.push(effect.clone());
    }
    Ok(chosen)
}

const fn offset(direction: Direction) -> Component {
    Component::Offset(direction)
}

const fn tilt(direction: Direction) -> Component {
    Component::Tilt(direction)
}

fn probe(entries: &mut Catalogue) {
    use Unit::{Ms, Um};
    let owner = Owner::Probe;
    // Share of the approach that is across the stem: 0 along it, 1 square to it.
    let across = |t: &Circumstances| 1.0 - t.direction.z * t.direction.z;
    entries.add("probe_radius", "ball radius of the probe", owner, &[("dr_um", Um)], |_, a| {
        a.add(0, Place::RADIUS, 1.0);
    });
    entries.add("probe_bending", "bending of the probe", owner, &[("k_um", Um)], move |t, a| {
        a.add(0, Place::RADIUS, -across(t));
    });
    let lobes = [("a3_um", Um), ("b3_um", Um)];
    entries.add(
        "probe_lobing",
        "three-lobed pre-travel of the probe",
        owner,
        &lobes,
        move |t, a| {
            let phi = t.direction.y.atan2(t.direction.x);
            a.add(0, Place::RADIUS, -across(t) * (3.0 * phi).cos());
            a.add(1, Place::RADIUS, -across(t) * (3.0 * phi).sin());
        },
    );
    let delay = [("tau_ms", Ms)];
    entries
        .add("trigger_delay", "delay of the trigger", owner, &delay, |t, a| {
            a.add(0, Place::RADIUS, -t.feed);
        })
        .needs(Need::Feed);
}

fn dimensions(entries: &mut Catalogue, artefact: &Artefact) {
    use Unit::{Ppm, S, Um};
    let owner = Owner::Artefact;
    let dimensions = artefact.dimensions();
    for dimension in &dimensions {
        let place = dimension.place;
        let parameters = [(dimension.parameter, dimension.unit)];
        entries.add(dimension.id, dimension.title, owner, &parameters, move |_, a| {
            a.add(0, place, 1.0);
        });
    }
    let title = "thermal expansion of the artefact";
    entries.add("artefact_expansion", title, owner, &[("ppm", Ppm)], move |_, a| {
        for dimension in dimensions.iter().filter(|dimension| dimension.size > 0.0) {
            a.add(0, dimension.place, dimension.size);
        }
    });
    let shift = [("dx_um", Um), ("dy_um", Um), ("dz_um", Um), ("t0_s", S)];
    entries
        .add("setup_shift", "shift of the artefact on the table", owner, &shift, |t, a| {
            if t.time >= a.value(3) {
                for direction in Direction::ALL {
                    a.add(direction.index(), Place::placement(offset(direction)), 1.0);
                }
            }
        })
        .needs(Need::Time)
        .kind(3, Kind::Moment);
}

/// An approach whose component along an axis is below this does not move that axis: directions are
/// computed, and cos 90° is 6e-17.
const SQUARE_TO: f64 = 1e-9;

fn linear_axes(entries: &mut Catalogue) {
    use Direction::{X, Y, Z};
    use Unit::{Arcsec, Ppm, Um};
    let owner = Owner::Machine;
    for d in Direction::ALL {
        let letter = d.travel_letter();
        let id = format!("scale_{}", letter.to_ascii_lowercase());
        entries.add(
            id,
            format!("scale of the {letter} axis"),
            owner,
            &[("ppm", Ppm)],
            move |_, a| {
                a.add(0, Place::linear(d, d), 1.0);
            },
        );
    }
    let squareness = [
        ("squareness_xy", "squareness of Y to X (EC0Y)", X, Y, -1.0),
        ("squareness_xz", "squareness of Z to X (EB0Z)", X, Z, 1.0),
        ("squareness_yz", "squareness of Z to Y (EA0Z)", Y, Z, -1.0),
    ];
    for (id, title, row, column, sign) in squareness {
        entries.add(id, title, owner, &[("arcsec", Arcsec)], move |_, a| {
            a.add(0, Place::linear(row, column), sign);
        });
    }
    for d in Direction::ALL {
        let letter = d.travel_letter();
        let id = format!("backlash_{}", letter.to_ascii_lowercase());
        let title = format!("backlash of the {letter} axis");
        entries.add(id, title, owner, &[("b_um", Um)], move |t, a| {
            let along = t.direction[d.index()];
            if along.abs() > SQUARE_TO {
                a.add(0, Place::offset(d), -0.5 * along.signum());
            }
        });
    }
}

/// Error motions of a rotary axis: they act before the axis's own turn, and an oblique axis has them
/// in its own frame.
#[derive(Clone, Copy)]
struct AxisMotions {
    axis: usize,
    rotary: Rotary,
}

impl AxisMotions {
    fn id(&self, what: &str) -> String {
        format!("{}_{what}", self.rotary.letter().to_ascii_lowercase())
    }

    /// Where a unit of a component in the axis' own frame acts.
    fn places(&self, component: Component) -> Vec<(Place, f64)> {
        let Some(own) = self.rotary.own() else {
            return vec![(Place::frame(self.axis, component), 1.0)];
        };
        let (along, made): (_, fn(Direction) -> Component) = match component {
            Component::Offset(along) => (along, Component::Offset),
            Component::Tilt(about) => (about, Component::Tilt),
        };
        let column = own.column(along.index());
        let each = Direction::ALL.into_iter();
        each.map(|d| (Place::frame(self.axis, made(d)), column[d.index()])).collect()
    }

    /// The two directions square to the axis, in order X, Y, Z.
    fn across(&self) -> [Direction; 2] {
        use Direction::{X, Y, Z};
        match self.rotary.about() {
            X => [Y, Z],
            Y => [X, Z],
            Z => [X, Y],
        }
    }

    /// Positioning of an axis about Z (C), once a turn.
    fn add_positioning(&self, entries: &mut Catalogue) {
        let (axis, letter) = (self.axis, self.rotary.letter());
        let names = [("a1_arcsec", Unit::Arcsec), ("b1_arcsec", Unit::Arcsec)];
        let title = format!("positioning of {letter}, once a turn");
        entries.add(self.id("positioning"), title, Owner::Machine, &names, move |t, a| {
            let (sin, cos) = t.rotary[axis].sin_cos();
            a.add(0, Place::turn(axis), cos - 1.0);
            a.add(1, Place::turn(axis), sin);
        });
    }

    /// Error motions of an axis that turns all round.
    fn add_turning(&self, entries: &mut Catalogue) {
        use Unit::{Arcsec, Um};
        let (axis, letter, owner) = (self.axis, self.rotary.letter(), Owner::Machine);
        let names = [("a2_arcsec", Arcsec), ("b2_arcsec", Arcsec)];
        let title = format!("positioning of {letter}, twice a turn");
        entries.add(self.id("positioning_2"), title, owner, &names, move |t, a| {
            let (sin, cos) = (2.0 * t.rotary[axis]).sin_cos();
            a.add(0, Place::turn(axis), cos - 1.0);
            a.add(1, Place::turn(axis), sin);
        });
        let pairs = |components: [Component; 2]| {
            let places = components.map(|component| self.places(component));
            move |t: &Circumstances, a: &mut Action| {
                let (sin, cos) = (2.0 * t.rotary[axis]).sin_cos();
                for (i, places) in places.iter().enumerate() {
                    for &(place, part) in places {
                        a.add(2 * i, place, part * cos);
                        a.add(2 * i + 1, place, part * sin);
                    }
                }
            }
        };
        let across = self.across();
        let radial = across.map(|d| match d {
            Direction::X => ["ax_um", "bx_um"],
            Direction::Y => ["ay_um", "by_um"],
            Direction::Z => ["az_um", "bz_um"],
        });
        let radial = radial.concat().into_iter().map(|name| (name, Um)).collect::<Vec<_>>();
        let title = format!("radial error motion of {letter}, twice a turn");
        entries.add(self.id("radial_2"), title, owner, &radial, pairs(across.map(offset)));
        let along = offset(self.rotary.about());
        for (n, what, words, names) in [
            (1.0, "axial", "once", [("a1_um", Um), ("b1_um", Um)]),
            (2.0, "axial_2", "twice", [("a2_um", Um), ("b2_um", Um)]),
        ] {
            let title = format!("axial error motion of {letter}, {words} a turn");
            let places = self.places(along);
            entries.add(self.id(what), title, owner, &names, move |t, a| {
                let (sin, cos) = (n * t.rotary[axis]).sin_cos();
                for &(place, part) in &places {
                    a.add(0, place, part * cos);
                    a.add(1, place, part * sin);
                }
            });
        }
        let wobble = across.map(|d| match d {
            Direction::X => ["ax_arcsec", "bx_arcsec"],
            Direction::Y => ["ay_arcsec", "by_arcsec"],
            Direction::Z => ["az_arcsec", "bz_arcsec"],
        });
        let wobble = wobble.concat().into_iter().map(|name| (name, Arcsec)).collect::<Vec<_>>();
        let title = format!("tilt error motion of {letter}, twice a turn");
        entries.add(self.id("wobble_2"), title, owner, &wobble, pairs(across.map(tilt)));
    }

    /// Error motions of an axis about X (A) or Y (B), which gravity loads.
    fn add_tilting(&self, entries: &mut Catalogue) {
        use Unit::{Arcsec, Um};
        let (axis, letter, owner) = (self.axis, self.rotary.letter(), Owner::Machine);
        let turn = Place::turn(axis);
        let angle = move |t: &Circumstances| t.rotary[axis];
        let k = [("k_arcsec", Arcsec)];
        let title = format!("positioning of {letter}");
        entries.add(self.id("positioning"), title, owner, &k, move |t, a| {
            a.add(0, turn, angle(t).sin());
        });
        let title = format!("scale of the {letter} axis");
        entries.add(self.id("scale"), title, owner, &k, move |t, a| {
            a.add(0, turn, angle(t) / FRAC_PI_2);
        });
        // The direction across: Y for A, X for B, in the plane that the tilting table sags in.
        let [level, up] = self.across();
        let names = match level {
            Direction::X => [("kx_um", Um), ("kz_um", Um)],
            _ => [("ky_um", Um), ("kz_um", Um)],
        };
        let title = format!("sag of the {letter} axis");
        let places = [level, up].map(|d| self.places(offset(d)));
        entries.add(self.id("sag"), title, owner, &names, move |t, a| {
            for &(place, part) in &places[0] {
                a.add(0, place, part * angle(t).sin());
            }
            for &(place, part) in &places[1] {
                a.add(1, place, part * (angle(t).cos() - 1.0));
            }
        });
        let title = format!("twist of the {letter} axis");
        let places = self.places(tilt(level));
        entries.add(self.id("twist"), title, owner, &k, move |t, a| {
            for &(place, part) in &places {
                a.add(0, place, part * angle(t).sin());
            }
        });
    }
}

fn rotary_backlash(entries: &mut Catalogue, axis: usize, letter: char) {
    let id = format!("{}_backlash", letter.to_ascii_lowercase());
    let title = format!("backlash of the {letter} axis");
    let b = [("b_arcsec", Unit::Arcsec)];
    entries
        .add(id, title, Owner::Machine, &b, move |t, a| {
            a.add(0, Place::turn(axis), -0.5 * t.sense[axis]);
        })
        .needs(Need::Sense(axis));
}

fn drift(entries: &mut Catalogue) {
    use Unit::{Min, Um, UmPerHour};
    for d in Direction::ALL {
        let letter = d.travel_letter();
        let id = format!("drift_{}", letter.to_ascii_lowercase());
        let title = format!("drift of the {letter} axis");
        let rate = [("rate_um_h", UmPerHour)];
        entries
            .add(id, title, Owner::Time, &rate, move |t, a| a.add(0, Place::offset(d), t.elapsed))
            .needs(Need::Time);
    }
    let warmup = [("amplitude_um", Um), ("tau_min", Min)];
    entries
        .add("warmup_z", "warm-up of the Z axis", Owner::Time, &warmup, |t, a| {
            let place = Place::offset(Direction::Z);
            let tau = a.value(1).max(f64::MIN_POSITIVE);
            let left = (-t.elapsed / tau).exp();
            a.add(0, place, 1.0 - left);
            if left > 0.0 {
                // Written so that a time constant that a step has taken to zero leaves no 0 / 0.
                a.rate(1, place, -a.value(0) * left * (t.elapsed / tau) / tau);
            }
        })
        .needs(Need::Time)
        .kind(1, Kind::Duration);
}
