//! Places where errors act, the error parameters, and the names of both.

use crate::machine::Component;
use crate::units::Unit;
use crate::{Error, Result};

/// Active joints: L1, L2, L3 (mm), q4, q5 (rad).
pub const ACTIVE: usize = 5;
/// Passive joints: u1, v1, u2, v2, φ, w2, u3, v3 (rad).
pub const PASSIVE: usize = 8;
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
    #[inline]
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
pub(super) const PAPER: [(f64, Source); ERRORS] = [
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
