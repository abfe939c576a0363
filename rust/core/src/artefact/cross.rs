//! The cross of Kang, Kim and Jee (2022), Fig. 2: the union of two bars along X and Y.
//!
//! For the cross they carry the paper's labels (Figs. 3 and 4, as equations (3) to (10) fix them).
//! Seen from above the arms follow −Y, −X, +Y, +X (j = 0..3); each has 4j + 1 on top, 4j + 2 on the
//! side at the left of the outward direction, 4j + 3 on the end, 4j + 4 on the other side. Top and
//! side points lie (L − h)/2 out along the arm, as equation (10) has it. With the table tilted by
//! ±90° there are four: 17 and 20 on the side faces that look up (arms along the tilting axis), 18
//! on top and 19 on the end of the arm that points up.

use nalgebra::Vector3;

use super::solid::{Bar, Block, Solid};
use super::{
    Artefact, Dimension, Kind, Layout, Part, Shape, Target, View, exactly, of_a_block, positive,
    side,
};
use crate::machine::{Place, Places};
use crate::units::Unit;
use crate::{Error, Result};

/// Two bars of one size that cross in the middle, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cross {
    /// Length of each bar, L.
    pub length: f64,
    /// Width of each bar, w.
    pub width: f64,
    /// Height over the table, h.
    pub height: f64,
}

pub(super) const KIND: Kind = Kind {
    name: "cross",
    dimensions: &[("length", 1), ("width", 1), ("height", 1)],
    example: &[2.0, 1.0, 1.0],
    make,
};

fn make(dimensions: &[f64]) -> Result<Artefact> {
    let [length, width, height] = exactly(&KIND, dimensions)?;
    positive(&[("length", length), ("width", width), ("height", height)])?;
    if width >= length {
        let expected = format!("less than the length, {length}");
        return Err(Error::input("width of the cross in mm", width, expected));
    }
    Ok(Artefact::Cross(Cross { length, width, height }))
}

impl Shape for Cross {
    fn solid(&self, places: &Places) -> Solid {
        let length = self.length + places.at(Place::LENGTH);
        let width = self.width + places.at(Place::WIDTH);
        let height = self.height + places.at(Place::HEIGHT);
        let turn = places.at(Place::SQUARENESS);
        Solid::Blocks([
            Some(Block::new(length, width, height, Bar::AlongX, 0.0)),
            Some(Block::new(width, length, height, Bar::AlongY, turn)),
        ])
    }

    fn dimensions(&self) -> Vec<Dimension> {
        let mut dimensions = of_a_block(self.length, self.width, self.height);
        dimensions.push(Dimension {
            id: "artefact_squareness",
            title: "squareness of the artefact's bars",
            parameter: "gamma_arcsec",
            unit: Unit::Arcsec,
            place: Place::SQUARENESS,
            size: 0.0,
        });
        dimensions
    }

    fn targets(&self, view: &View) -> Vec<Target> {
        let all = all_targets(*self);
        let upright = view.artefact.rotation.tr_mul(view.stem);
        if upright.z.abs() < TILTED && !view.all_faces {
            tilted_cross(&all, &upright, view.layout)
        } else {
            all
        }
    }

    fn has_plane_faces(&self) -> bool {
        true
    }

    fn outline(&self) -> Vec<Part> {
        let Self { length, width, height } = *self;
        vec![Part::Box([length, width, height]), Part::Box([width, length, height])]
    }

    fn face(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> String {
        let (letter, out) =
            if point.y.abs() > point.x.abs() { ('Y', point.y) } else { ('X', point.x) };
        let sign = if out > 0.0 { '+' } else { '-' };
        format!("{sign}{letter} arm, {}", side(normal))
    }
}

/// A table tilted by ±90° is one whose Z is square to the stem within this (rad): known errors of the
/// machine tilt it.
const TILTED: f64 = 2e-3;

/// The sixteen touches of the cross.
fn all_targets(Cross { length, width, height }: Cross) -> Vec<Target> {
    let out = 0.5 * (length - height);
    // Outward directions of the arms in the order of their labels.
    let arms = [-Vector3::y(), -Vector3::x(), Vector3::y(), Vector3::x()];
    let mut targets = Vec::with_capacity(16);
    for (label, outward) in (1..).step_by(4).zip(arms) {
        let left = Vector3::z().cross(&outward);
        let middle = Vector3::z() * (0.5 * height);
        let side = |normal: Vector3<f64>| outward * out + normal * (0.5 * width) + middle;
        targets.extend([
            Target { label, point: outward * out + 2.0 * middle, normal: Vector3::z() },
            Target { label: label + 1, point: side(left), normal: left },
            Target { label: label + 2, point: outward * (0.5 * length) + middle, normal: outward },
            Target { label: label + 3, point: side(-left), normal: -left },
        ]);
    }
    targets
}

/// The paper's four touches of the cross on a table tilted by ±90°; `up` is the stem's direction in
/// the artefact's frame.
fn tilted_cross(all: &[Target], up: &Vector3<f64>, layout: Layout) -> Vec<Target> {
    let is_top = |target: &&Target| target.label % 4 == 1;
    let is_end = |target: &&Target| target.label % 4 == 3;
    let across = |target: &&Target| {
        let outward = Vector3::new(target.point.x, target.point.y, 0.0);
        outward.normalize().dot(up).abs() < 0.5
    };
    let relabel = |target: Option<&Target>, label| target.map(|t| Target { label, ..*t });
    let top = all.iter().filter(is_top).find(|t| t.point.dot(up) > 1e-6);
    let end = all.iter().filter(is_end).find(|t| t.normal.dot(up) > 0.5);
    let mut pair: Vec<&Target> = match layout {
        Layout::Side => {
            let sides = all.iter().filter(|t| t.label % 2 == 0);
            sides.filter(|t| t.normal.dot(up) > 0.5).collect()
        }
        Layout::Top => all.iter().filter(is_top).filter(across).collect(),
    };
    pair.sort_by(|a, b| (a.point.x + a.point.y).total_cmp(&(b.point.x + b.point.y)));
    [
        relabel(pair.first().copied(), 17),
        relabel(top, 18),
        relabel(end, 19),
        relabel(pair.last().copied(), 20),
    ]
    .into_iter()
    .flatten()
    .collect()
}
