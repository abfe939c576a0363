//! Artefacts: what is touched. One file a kind, which answers everything that depends on the kind; all
//! of them are listed in [`KINDS`].
//!
//! The artefact's frame has its base on z = 0 and its middle over the origin.

mod cross;
mod cuboid;
mod ring;
mod solid;
mod sphere;
mod spheres;

use nalgebra::Vector3;

use crate::machine::{Component, Machine, Place, Places};
use crate::pose::{Direction, Pose};
use crate::units::Unit;
use crate::{Error, Result};

pub use cross::Cross;
pub use cuboid::Cuboid;
pub use ring::Ring;
pub use solid::{Contact, Line, Search, Solid};
pub use sphere::Sphere;
pub use spheres::{MAX_SPHERES, Spheres};

/// Nominal shape, dimensions in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Artefact {
    /// Two bars that cross in the middle.
    Cross(Cross),
    /// A box.
    Cuboid(Cuboid),
    /// A sphere on a post.
    Sphere(Sphere),
    /// Several spheres.
    Spheres(Spheres),
    /// A ring gauge or a bore.
    Ring(Ring),
}

/// How an artefact stands on the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fixture {
    /// Nominal place of the artefact's origin in the table's frame (middle of its top), mm.
    pub place: Vector3<f64>,
    /// Nominal turn about Z, rad.
    pub turn: f64,
    /// Radius of the stem that carries a sphere, mm; 0: none.
    pub stem_radius: f64,
    /// Lengths of the plate that it stands on, on the table and turned with it, mm; 0: none.
    pub base: Vector3<f64>,
    /// Boxes beside it, on the table and turned with it (jaws of a vise, clamps): X and Y of the middle
    /// from its origin, lengths along X and Y, height over the table, mm.
    pub clamps: Vec<[f64; 5]>,
    /// Radius and height over the table of a chuck about its place, mm; 0: none.
    pub chuck: [f64; 2],
    /// How far its origin may lie from the nominal place, in any direction, mm.
    pub tolerance: f64,
    /// How far it may be turned about Z from nominal, rad.
    pub turn_tolerance: f64,
}

impl Fixture {
    /// Adds the nominal place and turn of the artefact on the table to the places of a machine.
    pub fn add_to(&self, machine: &Machine, places: &mut Places) {
        let place = machine.top_rotation() * self.place;
        for along in Direction::ALL {
            let target = Place::placement(Component::Offset(along));
            places.add(target, place[along.index()]);
        }
        let [alpha, beta] = *machine.top();
        for (about, tilt) in Direction::ALL.into_iter().zip([alpha, beta, self.turn]) {
            places.add(Place::placement(Component::Tilt(about)), tilt);
        }
    }
}

/// A kind of artefact: its name, its dimensions, and how it is made of them.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name, as in the set-up file.
    pub name: &'static str,
    /// Its dimensions, mm, in order: name (in the set-up file without the unit) and how many numbers.
    pub dimensions: &'static [(&'static str, usize)],
    /// Dimensions of some artefact of this kind.
    pub example: &'static [f64],
    make: fn(&[f64]) -> Result<Artefact>,
}

/// All kinds.
pub const KINDS: [Kind; 5] = [cross::KIND, cuboid::KIND, sphere::KIND, spheres::KIND, ring::KIND];

/// A dimension that may be wrong: an effect of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dimension {
    /// Id of the effect.
    pub id: &'static str,
    /// What is wrong, in words.
    pub title: &'static str,
    /// Name of the parameter, with its unit.
    pub parameter: &'static str,
    /// Unit of the parameter.
    pub unit: Unit,
    /// Where it acts.
    pub place: Place,
    /// Its nominal size, mm, by which it expands; 0 for an angle.
    pub size: f64,
}

impl Dimension {
    /// Diameter of a sphere or a bore.
    const fn diameter(size: f64) -> Self {
        Self {
            id: "artefact_diameter",
            title: "diameter of the artefact",
            parameter: "dd_um",
            unit: Unit::Um,
            place: Place::LENGTH,
            size,
        }
    }

    /// Height of a block or a ring.
    const fn height(size: f64) -> Self {
        Self {
            id: "artefact_height",
            title: "height of the artefact",
            parameter: "dh_um",
            unit: Unit::Um,
            place: Place::HEIGHT,
            size,
        }
    }
}

/// A convex part of an artefact, as an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    /// A box of these lengths, its base on z = 0, its middle over the origin.
    Box([f64; 3]),
    /// A ball.
    Ball {
        /// Radius, mm.
        radius: f64,
        /// Centre, mm.
        centre: Vector3<f64>,
    },
    /// What is between two cylinders about Z, its base on z = 0.
    Ring {
        /// Inner radius, mm.
        bore: f64,
        /// Outer radius, mm.
        outer: f64,
        /// Height, mm.
        height: f64,
    },
}

/// Where the touches 17 and 20 lie; the paper's text does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// On the side faces that look up: they see EB0A.
    Side,
    /// On the top faces of the same arms, touched across the stem: they see EC0A as well.
    Top,
}

/// A point on a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The paper's label, or a number of our own where the paper has none.
    pub label: i64,
    /// Nominal point of contact, artefact frame.
    pub point: Vector3<f64>,
    /// Outward normal of the face.
    pub normal: Vector3<f64>,
}

/// From where targets are looked for.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Pose of the artefact.
    pub artefact: &'a Pose,
    /// Direction of the stem, machine frame.
    pub stem: &'a Vector3<f64>,
    /// Where the touches 17 and 20 of the cross lie.
    pub layout: Layout,
    /// At ±90° every reachable face, not only the paper's four.
    pub all_faces: bool,
}

/// What a kind of artefact answers.
trait Shape {
    /// The solid with the errors of its dimensions.
    fn solid(&self, places: &Places) -> Solid;
    /// Dimensions that may be wrong.
    fn dimensions(&self) -> Vec<Dimension>;
    /// The places worth a touch.
    fn targets(&self, view: &View) -> Vec<Target>;
    /// Whether each of its faces is plane, so that a touch can be held to the one that is meant.
    fn has_plane_faces(&self) -> bool {
        false
    }
    /// The solid as obstacles.
    fn outline(&self) -> Vec<Part>;
    /// Name of the face with this outward normal at a point, artefact frame.
    fn face(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> String;
    /// Whether a turn about X, Y and Z of its frame is anything else than a shift.
    fn turns(&self) -> [bool; 3] {
        [true; 3]
    }
}

impl Artefact {
    fn shape(&self) -> &dyn Shape {
        match self {
            Self::Cross(cross) => cross,
            Self::Cuboid(cuboid) => cuboid,
            Self::Sphere(sphere) => sphere,
            Self::Spheres(spheres) => spheres,
            Self::Ring(ring) => ring,
        }
    }

    /// The artefact of a kind with these dimensions (mm), in the order of its [`Kind`].
    ///
    /// # Errors
    /// An unknown kind, another number of dimensions, dimensions that cannot be.
    pub fn of(kind: &str, dimensions: &[f64]) -> Result<Self> {
        let found = KINDS.iter().find(|known| known.name == kind);
        let kind = found.ok_or_else(|| {
            Error::unknown("artefact", kind, KINDS.iter().map(|known| known.name))
        })?;
        (kind.make)(dimensions)
    }

    /// The solid with the errors of its dimensions.
    #[must_use]
    pub fn solid(&self, places: &Places) -> Solid {
        self.shape().solid(places)
    }

    /// Dimensions that may be wrong.
    #[must_use]
    pub fn dimensions(&self) -> Vec<Dimension> {
        self.shape().dimensions()
    }

    /// The places worth a touch.
    #[must_use]
    pub fn targets(&self, view: &View) -> Vec<Target> {
        self.shape().targets(view)
    }

    /// Whether each of its faces is plane, so that a touch can be held to the one that is meant.
    #[must_use]
    pub fn has_plane_faces(&self) -> bool {
        self.shape().has_plane_faces()
    }

    /// The solid as obstacles.
    #[must_use]
    pub fn outline(&self) -> Vec<Part> {
        self.shape().outline()
    }

    /// Whether a turn about X, Y and Z of its frame is anything else than a shift.
    #[must_use]
    pub fn turns(&self) -> [bool; 3] {
        self.shape().turns()
    }

    /// Name of the face with this outward normal at a point, artefact frame.
    #[must_use]
    pub fn face(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> String {
        self.shape().face(point, normal)
    }
}

/// The dimensions of a kind as an array.
fn exactly<const N: usize>(kind: &Kind, dimensions: &[f64]) -> Result<[f64; N]> {
    dimensions.try_into().map_err(|_| {
        let names: Vec<&str> = kind.dimensions.iter().map(|(name, _)| *name).collect();
        let what = format!("dimensions of a {}", kind.name);
        let expected = format!("{N}: {}", names.join(", "));
        Error::input(what, format!("{} numbers", dimensions.len()), expected)
    })
}

/// Checks lengths, mm.
fn positive(lengths: &[(&str, f64)]) -> Result<()> {
    for (what, value) in lengths {
        if !(value.is_finite() && *value > 0.0) {
            return Err(Error::input(format!("artefact {what} in mm"), value, "a positive number"));
        }
    }
    Ok(())
}

/// Length, width and height as dimensions that may be wrong.
fn of_a_block(length: f64, width: f64, height: f64) -> Vec<Dimension> {
    let unit = Unit::Um;
    vec![
        Dimension {
            id: "artefact_length",
            title: "length of the artefact",
            parameter: "dl_um",
            unit,
            place: Place::LENGTH,
            size: length,
        },
        Dimension {
            id: "artefact_width",
            title: "width of the artefact",
            parameter: "dw_um",
            unit,
            place: Place::WIDTH,
            size: width,
        },
        Dimension::height(height),
    ]
}

/// `top`, or `+X side` and the like, by the largest component of the normal.
fn side(normal: &Vector3<f64>) -> String {
    let axis = normal.iamax();
    let sign = if normal[axis] > 0.0 { '+' } else { '-' };
    match axis {
        2 => "top".to_owned(),
        0 => format!("{sign}X side"),
        _ => format!("{sign}Y side"),
    }
}
