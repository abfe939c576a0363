//! The sphere.

use nalgebra::Vector3;

use super::solid::Solid;
use super::{Artefact, Dimension, Kind, Part, Shape, Target, View, exactly, positive};
use crate::machine::{Place, Places};
use crate::pose::Pose;
use crate::{Error, Result};

/// A sphere, mm; the stem that carries it is an obstacle of the plan only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Diameter.
    pub diameter: f64,
    /// Centre in the artefact's frame.
    pub centre: [f64; 3],
}

pub(super) const KIND: Kind = Kind {
    name: "sphere",
    dimensions: &[("diameter", 1), ("centre", 3)],
    example: &[1.0, 0.0, 0.0, 0.0],
    make,
};

fn make(dimensions: &[f64]) -> Result<Artefact> {
    let [diameter, x, y, z] = exactly(&KIND, dimensions)?;
    positive(&[("diameter", diameter)])?;
    let centre = [x, y, z];
    if !centre.iter().all(|c| c.is_finite()) {
        let got = format!("{centre:?}");
        return Err(Error::input("artefact centre in mm", got, "three finite numbers"));
    }
    Ok(Artefact::Sphere(Sphere { diameter, centre }))
}

impl Shape for Sphere {
    fn solid(&self, places: &Places) -> Solid {
        Solid::Sphere {
            radius: 0.5 * (self.diameter + places.at(Place::LENGTH)),
            centre: self.centre.into(),
        }
    }

    fn dimensions(&self) -> Vec<Dimension> {
        vec![Dimension::diameter(self.diameter)]
    }

    fn targets(&self, view: &View) -> Vec<Target> {
        targets_of(0.5 * self.diameter, &self.centre.into(), view.artefact, view.stem)
    }

    fn outline(&self) -> Vec<Part> {
        vec![Part::Ball { radius: 0.5 * self.diameter, centre: self.centre.into() }]
    }

    fn turns(&self) -> [bool; 3] {
        [false; 3]
    }

    fn face(&self, _: &Vector3<f64>, _: &Vector3<f64>) -> String {
        "sphere".to_owned()
    }
}

/// The pole towards the stem and four points of the equator, along the machine's directions, so
/// that the same five moves serve every position of the table.
pub(super) fn targets_of(
    radius: f64,
    centre: &Vector3<f64>,
    pose: &Pose,
    stem: &Vector3<f64>,
) -> Vec<Target> {
    let side = if stem.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let u = (side - stem * side.dot(stem)).normalize();
    let v = stem.cross(&u);
    let labelled = (1..).zip([*stem, u, v, -u, -v]);
    labelled
        .map(|(label, direction)| {
            let normal = pose.rotation.tr_mul(&direction);
            Target { label, point: centre + normal * radius, normal }
        })
        .collect()
}
