//! Dimensions, places where errors act, and the names of both.

use nalgebra::{Matrix3, Vector3};

use super::closure::Closure;
use super::inverse::ToolPose;
use super::posture::{ACTIVE, Joints, PASSIVE, Posture};
use super::solution::side;
use crate::machine::Component;
use crate::pose::rotation_xyz;
use crate::units::Unit;
use crate::{Error, Result};

/// Number of error parameters of the paper, e1 to e17.
pub const ERRORS: usize = 17;
/// Number of places.
pub const PLACES: usize = 18;

/// Where an error can act. A place's displacement is translate(x, y, z) R(a, b, c), in the frame
/// that the chain has there; the mechanism's dimensions are the translations.
///
/// `Base` to `End` of a leg run from the base outwards: base, u turn, `Cross`, v turn, `Leg`,
/// (φ turn of leg 2), telescopic travel along −z, `End`, revolute. `Platform` is where the
/// revolute sits in the platform's frame. `Wrist4` is before the q4 turn, `Wrist5` between q4 and
/// q5, `Tool` after q5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// Joint on the base, of leg 0, 1 or 2.
    Base(usize),
    /// Between the u and the v axis.
    Cross(usize),
    /// Between the v axis and the telescopic travel (on leg 2: before φ).
    Leg(usize),
    /// Between the telescopic travel and the revolute.
    End(usize),
    /// Revolute in the platform.
    Platform(usize),
    /// Platform to q4.
    Wrist4,
    /// q4 to q5.
    Wrist5,
    /// q5 to tool point.
    Tool,
}

impl Place {
    /// All of them, in the order of [`Place::index`].
    pub const ALL: [Self; PLACES] = [
        Self::Base(0),
        Self::Cross(0),
        Self::Leg(0),
        Self::End(0),
        Self::Platform(0),
        Self::Base(1),
        Self::Cross(1),
        Self::Leg(1),
        Self::End(1),
        Self::Platform(1),
        Self::Base(2),
        Self::Cross(2),
        Self::Leg(2),
        Self::End(2),
        Self::Platform(2),
        Self::Wrist4,
        Self::Wrist5,
        Self::Tool,
    ];

    /// 0 to 17.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::Base(leg) => 5 * leg,
            Self::Cross(leg) => 5 * leg + 1,
            Self::Leg(leg) => 5 * leg + 2,
            Self::End(leg) => 5 * leg + 3,
            Self::Platform(leg) => 5 * leg + 4,
            Self::Wrist4 => 15,
            Self::Wrist5 => 16,
            Self::Tool => 17,
        }
    }

    /// `base1`, `cross1`, `leg1`, `end1`, `platform1` ... `wrist4`, `wrist5`, `tool`.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Base(leg) => format!("base{}", leg + 1),
            Self::Cross(leg) => format!("cross{}", leg + 1),
            Self::Leg(leg) => format!("leg{}", leg + 1),
            Self::End(leg) => format!("end{}", leg + 1),
            Self::Platform(leg) => format!("platform{}", leg + 1),
            Self::Wrist4 => "wrist4".to_owned(),
            Self::Wrist5 => "wrist5".to_owned(),
            Self::Tool => "tool".to_owned(),
        }
    }
}

/// Where one of the 17 acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    /// Added to an active joint (L1, L2, L3, q4, q5).
    Joint(usize),
    /// Signed translations at places.
    Places(&'static [(Place, Component, f64)]),
}

const X: Component = Component::ALL[0];
const Y: Component = Component::ALL[1];
const Z: Component = Component::ALL[2];

/// e1 to e17: nominal value (mm, rad; the notes' example, rounded from public figures of such a
/// machine) and where it acts.
const PAPER: [(f64, Source); ERRORS] = [
    (0.0, Source::Places(&[(Place::Cross(0), Z, -1.0)])),
    (0.0, Source::Places(&[(Place::Cross(1), Z, -1.0)])),
    (0.0, Source::Places(&[(Place::Cross(2), Z, -1.0)])),
    (350.0, Source::Places(&[(Place::Base(1), Y, 1.0)])),
    (0.0, Source::Joint(0)),
    (0.0, Source::Joint(1)),
    (0.0, Source::Joint(2)),
    (600.0, Source::Places(&[(Place::Base(0), X, -1.0), (Place::Base(2), X, 1.0)])),
    (200.0, Source::Places(&[(Place::Platform(0), X, -1.0)])),
    (130.0, Source::Places(&[(Place::Platform(1), Y, 1.0)])),
    (200.0, Source::Places(&[(Place::Platform(2), X, 1.0)])),
    (0.0, Source::Places(&[(Place::Platform(1), Z, 1.0)])),
    (200.0, Source::Places(&[(Place::Wrist4, Z, -1.0)])),
    (0.0, Source::Places(&[(Place::Wrist5, Y, 1.0)])),
    (250.0, Source::Places(&[(Place::Tool, Z, -1.0)])),
    (0.0, Source::Joint(3)),
    (0.0, Source::Joint(4)),
];

/// Dimensions that must be zero for the closed-form inverse: e1, e2, e3, e14.
pub(super) const NO_CLOSED_FORM: [usize; 4] = [0, 1, 2, 13];

/// An error parameter: one of the 17 of the paper, or any component at any place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// e1 to e17, counted from 0.
    Paper(usize),
    /// A component of the displacement at a place.
    Outside(Place, Component),
}

impl Parameter {
    /// The 17 of the paper.
    #[must_use]
    pub fn paper() -> [Self; ERRORS] {
        std::array::from_fn(Self::Paper)
    }

    /// Every component at every place.
    pub fn outside() -> impl Iterator<Item = Self> {
        Place::ALL.into_iter().flat_map(|p| Component::ALL.map(|c| Self::Outside(p, c)))
    }

    /// µm for lengths, arcsec for angles.
    #[must_use]
    pub const fn unit(self) -> Unit {
        match self {
            Self::Paper(15 | 16) | Self::Outside(_, Component::Tilt(_)) => Unit::Arcsec,
            Self::Paper(_) | Self::Outside(..) => Unit::Um,
        }
    }

    /// Name with unit: `e5_um`, `e16_arcsec`, `base3_y_um`, `wrist5_b_arcsec`.
    #[must_use]
    pub fn name(self) -> String {
        let unit = self.unit().symbol();
        match self {
            Self::Paper(i) => format!("e{}_{unit}", i + 1),
            Self::Outside(place, component) => {
                format!("{}_{}_{unit}", place.name(), component.letter().to_ascii_lowercase())
            }
        }
    }

    /// The parameter of this name; `e5` and `E5_um` are understood for `e5_um`.
    ///
    /// # Errors
    /// A name that is none.
    pub fn parse(name: &str) -> Result<Self> {
        let lower = name.trim().to_ascii_lowercase();
        let fits = |p: &Self| {
            let full = p.name();
            full == lower || full.rsplit_once('_').is_some_and(|(stem, _)| stem == lower)
        };
        Self::paper().into_iter().chain(Self::outside()).find(fits).ok_or_else(|| {
            Error::input(
                "error parameter",
                name,
                "e1_um .. e15_um, e16_arcsec, e17_arcsec, or <place>_<component>, e.g. \
                 base3_y_um or wrist5_b_arcsec, with place base1..3, cross1..3, leg1..3, \
                 end1..3, platform1..3, wrist4, wrist5, tool and component x, y, z (um), a, b, c \
                 (arcsec)",
            )
        })
    }

    pub(super) const fn source(self) -> Option<Source> {
        match self {
            Self::Paper(i) => Some(PAPER[i].1),
            Self::Outside(..) => None,
        }
    }
}

/// Errors of a mechanism, added to its dimensions: parameter and value in mm or rad.
pub type Errors = [(Parameter, f64)];

/// The displacement at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Displacement {
    pub shift: Vector3<f64>,
    pub tilt: Vector3<f64>,
    /// R(tilt); `None` where nothing is tilted.
    pub rotation: Option<Matrix3<f64>>,
}

/// A mechanism with its errors: what the kinematics needs and no more.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    pub(super) places: [Displacement; PLACES],
    /// Added to L1, L2, L3 (mm), q4, q5 (rad).
    pub(super) offsets: [f64; ACTIVE],
}

/// A nominal mechanism: dimensions and a posture from which its branch is followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Mechanism {
    dimensions: [f64; ERRORS],
    home: [f64; PASSIVE],
    home_legs: [f64; 3],
    /// Sign of the determinant at home for each choice of eight equations.
    home_sides: [[f64; 2]; 2],
}

impl Mechanism {
    /// Nominal e1 to e17 of the notes' example, mm and rad.
    #[must_use]
    pub fn example_dimensions() -> [f64; ERRORS] {
        PAPER.map(|(nominal, _)| nominal)
    }

    /// A mechanism from nominal e1 to e17 (mm, rad) and a tool point (mm) in the middle of its
    /// working space, where the tool is vertical: the posture there defines the assembly branch.
    ///
    /// # Errors
    /// A dimension that is not finite, or a home point where the loops do not close.
    pub fn new(dimensions: [f64; ERRORS], home_tip: Vector3<f64>) -> Result<Self> {
        for (i, value) in dimensions.iter().enumerate() {
            if !value.is_finite() {
                return Err(Error::input(
                    format!("dimension e{}", i + 1),
                    value,
                    "a finite length",
                ));
            }
        }
        let pose = ToolPose { tip: home_tip, direction: -Vector3::z() };
        let mut mechanism = Self {
            dimensions,
            home: [0.0; PASSIVE],
            home_legs: [0.0; 3],
            home_sides: [[0.0; 2]; 2],
        };
        // Offsets that the closed form does not know (e1, e2, e3, e14) are closed by Newton below.
        let plain = mechanism.without_offsets();
        let start = plain.nominal_inverse(&pose, 0.0)?;
        mechanism.home = start.passive;
        mechanism.home_legs = std::array::from_fn(|k| start.active[0][k]);
        if plain.dimensions != dimensions {
            let legs = [start.active[0][0], start.active[0][1], start.active[0][2], 0.0, 0.0];
            mechanism.home = mechanism.solve_nominal(&legs)?;
        }
        let [l1, l2, l3] = mechanism.home_legs;
        let joints = Joints { passive: mechanism.home, active: [l1, l2, l3, 0.0, 0.0] };
        let posture = Posture::new(&mechanism.with(&[]), &joints);
        mechanism.home_sides = [3, 4].map(|first| {
            [3, 4].map(|second| {
                let weight = |row: usize, kept: usize| if row == kept { 1000.0 } else { 0.0 };
                let closure = Closure {
                    along_mm: [weight(3, first), weight(3, second)],
                    about_mm: [weight(4, first), weight(4, second)],
                };
                side(&closure.jacobian(&posture), &closure)
            })
        });
        Ok(mechanism)
    }

    /// The same without the offsets e1, e2, e3, e14, which have no closed-form inverse.
    pub(super) fn without_offsets(&self) -> Self {
        let mut plain = self.clone();
        for i in NO_CLOSED_FORM {
            plain.dimensions[i] = 0.0;
        }
        plain
    }

    /// Nominal e1 to e17, mm and rad.
    #[must_use]
    pub const fn dimensions(&self) -> &[f64; ERRORS] {
        &self.dimensions
    }

    /// Passive joints at home, rad.
    #[must_use]
    pub const fn home(&self) -> &[f64; PASSIVE] {
        &self.home
    }

    /// Leg lengths at home, mm.
    #[must_use]
    pub const fn home_legs(&self) -> &[f64; 3] {
        &self.home_legs
    }

    /// Which side of the singular postures home is on, under this closure.
    pub(super) fn home_side(&self, closure: &Closure) -> f64 {
        let [first, second] = closure.kept();
        self.home_sides[first - 3][second - 3]
    }

    /// The mechanism with errors.
    #[must_use]
    pub fn with(&self, errors: &Errors) -> Geometry {
        let zero = Displacement { shift: Vector3::zeros(), tilt: Vector3::zeros(), rotation: None };
        let mut geometry = Geometry { places: [zero; PLACES], offsets: [0.0; ACTIVE] };
        for (i, value) in self.dimensions.iter().enumerate() {
            geometry.add(Parameter::Paper(i), *value);
        }
        for (parameter, value) in errors {
            geometry.add(*parameter, *value);
        }
        for place in &mut geometry.places {
            if place.tilt != Vector3::zeros() {
                place.rotation = Some(rotation_xyz(place.tilt.x, place.tilt.y, place.tilt.z));
            }
        }
        geometry
    }
}

impl Geometry {
    fn add(&mut self, parameter: Parameter, value: f64) {
        match (parameter, parameter.source()) {
            (_, Some(Source::Joint(joint))) => self.offsets[joint] += value,
            (_, Some(Source::Places(terms))) => {
                for (place, component, sign) in terms {
                    self.displace(*place, *component, sign * value);
                }
            }
            (Parameter::Outside(place, component), None) => {
                self.displace(place, component, value);
            }
            (Parameter::Paper(_), None) => {}
        }
    }

    fn displace(&mut self, place: Place, component: Component, value: f64) {
        let displacement = &mut self.places[place.index()];
        match component {
            Component::Offset(direction) => displacement.shift[direction.index()] += value,
            Component::Tilt(direction) => displacement.tilt[direction.index()] += value,
        }
    }
}
