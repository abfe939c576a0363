//! A ring gauge, or a bore in a block: touched on the wall of its bore and on top.

use nalgebra::Vector3;

use super::solid::Solid;
use super::{Artefact, Dimension, Kind, Part, Shape, Target, View, exactly, positive};
use crate::machine::{Place, Places};
use crate::{Error, Result};

/// A ring, mm: its axis is Z of the artefact's frame, its base on z = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Diameter of the bore.
    pub bore: f64,
    /// Diameter of its outside, which is not touched.
    pub outer: f64,
    /// Height over the table.
    pub height: f64,
}

pub(super) const KIND: Kind = Kind {
    name: "ring",
    dimensions: &[("diameter", 1), ("outer_diameter", 1), ("height", 1)],
    example: &[2.0, 3.0, 1.0],
    make,
};

fn make(dimensions: &[f64]) -> Result<Artefact> {
    let [bore, outer, height] = exactly(&KIND, dimensions)?;
    positive(&[("diameter", bore), ("outer diameter", outer), ("height", height)])?;
    if bore >= outer {
        let expected = format!("less than the outer diameter, {outer}");
        return Err(Error::input("diameter of the ring's bore in mm", bore, expected));
    }
    Ok(Artefact::Ring(Ring { bore, outer, height }))
}

impl Shape for Ring {
    fn solid(&self, places: &Places) -> Solid {
        Solid::Ring {
            bore: 0.5 * (self.bore + places.at(Place::LENGTH)),
            outer: 0.5 * self.outer,
            height: self.height + places.at(Place::HEIGHT),
        }
    }

    fn dimensions(&self) -> Vec<Dimension> {
        vec![Dimension::diameter(self.bore), Dimension::height(self.height)]
    }

    /// Four points of the wall at each of two heights, and four on top.
    fn targets(&self, _: &View) -> Vec<Target> {
        let (wall, top) = (0.5 * self.bore, 0.25 * (self.bore + self.outer));
        let around = [Vector3::x(), Vector3::y(), -Vector3::x(), -Vector3::y()];
        let on = |radius: f64, height: f64| {
            around.map(|out| (out * radius + Vector3::z() * (height * self.height), -out))
        };
        let walls = [on(wall, 0.3), on(wall, 0.7)].concat();
        let tops = on(top, 1.0).map(|(point, _)| (point, Vector3::z()));
        let labelled = (1..).zip(walls.into_iter().chain(tops));
        labelled.map(|(label, (point, normal))| Target { label, point, normal }).collect()
    }

    fn outline(&self) -> Vec<Part> {
        vec![Part::Ring { bore: 0.5 * self.bore, outer: 0.5 * self.outer, height: self.height }]
    }

    fn face(&self, _: &Vector3<f64>, normal: &Vector3<f64>) -> String {
        if normal.z > 0.5 { "top".to_owned() } else { "bore".to_owned() }
    }

    fn turns(&self) -> [bool; 3] {
        [true, true, false]
    }
}
