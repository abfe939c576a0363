//! Several spheres of one diameter: a ball plate, a ball bar, a scale with its master balls.

use nalgebra::Vector3;

use super::solid::Solid;
use super::sphere::targets_of;
use super::{Artefact, Dimension, Kind, Part, Shape, Target, View, positive};
use crate::machine::{Place, Places};
use crate::units::Unit;
use crate::{Error, Result};

/// Most spheres of an artefact.
pub const MAX_SPHERES: usize = 9;

/// Spheres, mm; the stems that carry them are obstacles of the plan only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spheres {
    /// Diameter of each.
    pub diameter: f64,
    centres: [Vector3<f64>; MAX_SPHERES],
    count: usize,
}

pub(super) const KIND: Kind = Kind {
    name: "spheres",
    dimensions: &[("diameter", 1), ("spheres", 6)],
    example: &[1.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0],
    make,
};

fn make(dimensions: &[f64]) -> Result<Artefact> {
    let (&diameter, rest) = dimensions.split_first().unwrap_or((&0.0, &[]));
    positive(&[("diameter", diameter)])?;
    let count = rest.len() / 3;
    if rest.len() % 3 != 0 || !(2..=MAX_SPHERES).contains(&count) {
        let got = format!("{} coordinates", rest.len());
        let expected = format!("three for each of 2 to {MAX_SPHERES} spheres");
        return Err(Error::input("artefact spheres in mm", got, expected));
    }
    if !rest.iter().all(|value| value.is_finite()) {
        return Err(Error::input("artefact spheres in mm", "some", "finite numbers"));
    }
    let mut centres = [Vector3::zeros(); MAX_SPHERES];
    for (centre, given) in centres.iter_mut().zip(rest.chunks_exact(3)) {
        *centre = Vector3::from_column_slice(given);
    }
    for (second, centre) in centres[..count].iter().enumerate() {
        for (first, other) in centres[..second].iter().enumerate() {
            let apart = (centre - other).norm();
            if apart <= diameter {
                let got = format!("spheres {} and {} {apart} mm apart", first + 1, second + 1);
                let expected = format!("more than their diameter, {diameter}");
                return Err(Error::input("artefact spheres in mm", got, expected));
            }
        }
    }
    Ok(Artefact::Spheres(Spheres { diameter, centres, count }))
}

impl Spheres {
    /// Their centres in the artefact's frame.
    #[must_use]
    pub fn centres(&self) -> &[Vector3<f64>] {
        &self.centres[..self.count]
    }

    /// Largest distance of two of them.
    fn span(&self) -> f64 {
        let centres = self.centres();
        let pairs = centres.iter().flat_map(|a| centres.iter().map(move |b| (a - b).norm()));
        pairs.fold(0.0, f64::max)
    }
}

impl Shape for Spheres {
    fn solid(&self, places: &Places) -> Solid {
        let span = self.span();
        let grown = 1.0 + places.at(Place::WIDTH) / span;
        Solid::Spheres {
            radius: 0.5 * (self.diameter + places.at(Place::LENGTH)),
            centres: self.centres.map(|centre| centre * grown),
            count: self.count,
            per_span: 1.0 / (span * grown),
        }
    }

    fn dimensions(&self) -> Vec<Dimension> {
        vec![
            Dimension::diameter(self.diameter),
            Dimension {
                id: "artefact_spacing",
                title: "distances between the spheres, by their largest",
                parameter: "ds_um",
                unit: Unit::Um,
                place: Place::WIDTH,
                size: self.span(),
            },
        ]
    }

    /// Five points of each, as for a sphere.
    fn targets(&self, view: &View) -> Vec<Target> {
        let each = (0..).step_by(10).zip(self.centres());
        let of_one = |(before, centre): (i64, &Vector3<f64>)| {
            let own = targets_of(0.5 * self.diameter, centre, view.artefact, view.stem);
            own.into_iter().map(move |one| Target { label: before + one.label, ..one })
        };
        each.flat_map(of_one).collect()
    }

    fn outline(&self) -> Vec<Part> {
        let radius = 0.5 * self.diameter;
        self.centres().iter().map(|&centre| Part::Ball { radius, centre }).collect()
    }

    fn face(&self, point: &Vector3<f64>, _: &Vector3<f64>) -> String {
        let distance = |i: &usize| (self.centres[*i] - point).norm();
        let nearest = (0..self.count).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        format!("sphere {}", nearest.unwrap_or(0) + 1)
    }
}
