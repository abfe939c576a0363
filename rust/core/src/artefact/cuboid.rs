//! The box.

use nalgebra::Vector3;

use super::solid::{Bar, Block, Solid};
use super::{
    Artefact, Dimension, Kind, Part, Shape, Target, View, exactly, of_a_block, positive, side,
};
use crate::Result;
use crate::machine::{Place, Places};

/// A box, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    /// Along X.
    pub length: f64,
    /// Along Y.
    pub width: f64,
    /// Height over the table.
    pub height: f64,
}

pub(super) const KIND: Kind = Kind {
    name: "cuboid",
    dimensions: &[("length", 1), ("width", 1), ("height", 1)],
    example: &[2.0, 1.0, 1.0],
    make,
};

fn make(dimensions: &[f64]) -> Result<Artefact> {
    let [length, width, height] = exactly(&KIND, dimensions)?;
    positive(&[("length", length), ("width", width), ("height", height)])?;
    Ok(Artefact::Cuboid(Cuboid { length, width, height }))
}

impl Shape for Cuboid {
    fn solid(&self, places: &Places) -> Solid {
        let length = self.length + places.at(Place::LENGTH);
        let width = self.width + places.at(Place::WIDTH);
        let height = self.height + places.at(Place::HEIGHT);
        Solid::Blocks([Some(Block::new(length, width, height, Bar::AlongX, 0.0)), None])
    }

    fn dimensions(&self) -> Vec<Dimension> {
        of_a_block(self.length, self.width, self.height)
    }

    fn targets(&self, _: &View) -> Vec<Target> {
        all_targets(*self)
    }

    fn has_plane_faces(&self) -> bool {
        true
    }

    fn outline(&self) -> Vec<Part> {
        vec![Part::Box([self.length, self.width, self.height])]
    }

    fn face(&self, _: &Vector3<f64>, normal: &Vector3<f64>) -> String {
        side(normal)
    }
}

/// Four touches on top, two on each side.
fn all_targets(Cuboid { length, width, height }: Cuboid) -> Vec<Target> {
    let (x, y) = (0.5 * length, 0.5 * width);
    let (dx, dy, z) = (0.7 * x, 0.7 * y, 0.5 * height);
    let mut faces = Vec::with_capacity(12);
    for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        faces.push((Vector3::new(sx * dx, sy * dy, height), Vector3::z()));
    }
    for sign in [-1.0, 1.0] {
        faces.push((Vector3::new(sign * dx, -y, z), -Vector3::y()));
        faces.push((Vector3::new(x, sign * dy, z), Vector3::x()));
        faces.push((Vector3::new(-sign * dx, y, z), Vector3::y()));
        faces.push((Vector3::new(-x, -sign * dy, z), -Vector3::x()));
    }
    let labelled = (1..).zip(faces);
    labelled.map(|(label, (point, normal))| Target { label, point, normal }).collect()
}
