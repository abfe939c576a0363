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
use crate::machine::{Component, Machine, Place, Places};
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
    /// Time since the start.
    pub time: f64,
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
        match rotary.direction {
            Direction::Z => turning_axis(&mut entries, axis),
            tilt => tilting_axis(&mut entries, axis, tilt),
        }
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

/// Error motions of a rotary axis about Z (C): they act before the axis's own turn.
fn turning_axis(entries: &mut Catalogue, axis: usize) {
    use Direction::{X, Y, Z};
    use Unit::{Arcsec, Um};
    let owner = Owner::Machine;
    let angle = move |t: &Circumstances| t.rotary[axis];
    for (n, id, names) in [
        (1.0, "c_positioning", [("a1_arcsec", Arcsec), ("b1_arcsec", Arcsec)]),
        (2.0, "c_positioning_2", [("a2_arcsec", Arcsec), ("b2_arcsec", Arcsec)]),
    ] {
        let title = match id {
            "c_positioning" => "positioning of C, once a turn",
            _ => "positioning of C, twice a turn",
        };
        entries.add(id, title, owner, &names, move |t, a| {
            let (sin, cos) = (n * angle(t)).sin_cos();
            a.add(0, Place::turn(axis), cos - 1.0);
            a.add(1, Place::turn(axis), sin);
        });
    }
    let pairs = |components: [Component; 2]| {
        move |t: &Circumstances, a: &mut Action| {
            let (sin, cos) = (2.0 * t.rotary[axis]).sin_cos();
            for (i, component) in components.into_iter().enumerate() {
                a.add(2 * i, Place::frame(axis, component), cos);
                a.add(2 * i + 1, Place::frame(axis, component), sin);
            }
        }
    };
    let radial = [("ax_um", Um), ("bx_um", Um), ("ay_um", Um), ("by_um", Um)];
    let title = "radial error motion of C, twice a turn";
    entries.add("c_radial_2", title, owner, &radial, pairs([offset(X), offset(Y)]));
    for (n, id, names) in [
        (1.0, "c_axial", [("a1_um", Um), ("b1_um", Um)]),
        (2.0, "c_axial_2", [("a2_um", Um), ("b2_um", Um)]),
    ] {
        let title = match id {
            "c_axial" => "axial error motion of C, once a turn",
            _ => "axial error motion of C, twice a turn",
        };
        entries.add(id, title, owner, &names, move |t, a| {
            let (sin, cos) = (n * angle(t)).sin_cos();
            a.add(0, Place::frame(axis, offset(Z)), cos);
            a.add(1, Place::frame(axis, offset(Z)), sin);
        });
    }
    let wobble = [
        ("ax_arcsec", Arcsec),
        ("bx_arcsec", Arcsec),
        ("ay_arcsec", Arcsec),
        ("by_arcsec", Arcsec),
    ];
    let title = "tilt error motion of C, twice a turn";
    entries.add("c_wobble_2", title, owner, &wobble, pairs([tilt(X), tilt(Y)]));
    rotary_backlash(entries, axis, 'C');
}

/// Error motions of a rotary axis about X (A) or Y (B).
fn tilting_axis(entries: &mut Catalogue, axis: usize, about: Direction) {
    use Direction::{X, Y, Z};
    use Unit::{Arcsec, Um};
    let owner = Owner::Machine;
    let letter = about.turn_letter();
    let id = |what: &str| format!("{}_{what}", letter.to_ascii_lowercase());
    let turn = Place::turn(axis);
    let angle = move |t: &Circumstances| t.rotary[axis];
    let k = [("k_arcsec", Arcsec)];
    entries.add(id("positioning"), format!("positioning of {letter}"), owner, &k, move |t, a| {
        a.add(0, turn, angle(t).sin());
    });
    entries.add(id("scale"), format!("scale of the {letter} axis"), owner, &k, move |t, a| {
        a.add(0, turn, angle(t) / FRAC_PI_2);
    });
    // The direction across: Y for A, X for B, in the plane that the tilting table sags in.
    let (across, names) = match about {
        Y => (X, [("kx_um", Um), ("kz_um", Um)]),
        X | Z => (Y, [("ky_um", Um), ("kz_um", Um)]),
    };
    entries.add(id("sag"), format!("sag of the {letter} axis"), owner, &names, move |t, a| {
        a.add(0, Place::frame(axis, offset(across)), angle(t).sin());
        a.add(1, Place::frame(axis, offset(Z)), angle(t).cos() - 1.0);
    });
    entries.add(id("twist"), format!("twist of the {letter} axis"), owner, &k, move |t, a| {
        a.add(0, Place::frame(axis, tilt(across)), angle(t).sin());
    });
    rotary_backlash(entries, axis, letter);
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
            .add(id, title, Owner::Time, &rate, move |t, a| a.add(0, Place::offset(d), t.time))
            .needs(Need::Time);
    }
    let warmup = [("amplitude_um", Um), ("tau_min", Min)];
    entries
        .add("warmup_z", "warm-up of the Z axis", Owner::Time, &warmup, |t, a| {
            let place = Place::offset(Direction::Z);
            let tau = a.value(1).max(f64::MIN_POSITIVE);
            let left = (-t.time / tau).exp();
            a.add(0, place, 1.0 - left);
            if left > 0.0 {
                // Written so that a time constant that a step has taken to zero leaves no 0 / 0.
                a.rate(1, place, -a.value(0) * left * (t.time / tau) / tau);
            }
        })
        .needs(Need::Time)
        .kind(1, Kind::Duration);
}
