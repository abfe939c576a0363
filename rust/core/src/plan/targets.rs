//! The places on an artefact that are worth a touch.
//!
//! For the cross they carry the paper's labels (Figs. 3 and 4, as equations (3) to (10) fix them).
//! Seen from above the arms follow −Y, −X, +Y, +X (j = 0..3); each has 4j + 1 on top, 4j + 2 on the
//! side at the left of the outward direction, 4j + 3 on the end, 4j + 4 on the other side. Top and
//! side points lie (L − h)/2 out along the arm, as equation (10) has it. With the table tilted by
//! ±90° there are four: 17 and 20 on the side faces that look up (arms along the tilting axis), 18
//! on top and 19 on the end of the arm that points up.

use nalgebra::Vector3;

use super::PlanOptions;
use crate::artefact::Artefact;
use crate::pose::Pose;

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

/// The targets of an artefact on a table at this pose, probed with a stem in this direction.
#[must_use]
pub fn targets(
    artefact: &Artefact,
    table: &Pose,
    stem: &Vector3<f64>,
    options: &PlanOptions,
) -> Vec<Target> {
    match *artefact {
        Artefact::Cross { length, width, height } => {
            let all = cross(length, width, height);
            let upright = table.rotation.tr_mul(stem);
            if upright.z.abs() < 1e-9 && !options.all_faces {
                tilted_cross(&all, &upright, options.layout)
            } else {
                all
            }
        }
        Artefact::Cuboid { length, width, height } => cuboid(length, width, height),
        Artefact::Sphere { diameter, centre } => {
            sphere(0.5 * diameter, &centre.into(), table, stem)
        }
    }
}

/// The sixteen touches of the cross.
fn cross(length: f64, width: f64, height: f64) -> Vec<Target> {
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

/// Four touches on top, two on each side.
fn cuboid(length: f64, width: f64, height: f64) -> Vec<Target> {
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

/// The pole towards the stem and four points of the equator, along the machine's directions, so
/// that the same five moves serve every position of the table.
fn sphere(radius: f64, centre: &Vector3<f64>, table: &Pose, stem: &Vector3<f64>) -> Vec<Target> {
    let side = if stem.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let u = (side - stem * side.dot(stem)).normalize();
    let v = stem.cross(&u);
    let labelled = (1..).zip([*stem, u, v, -u, -v]);
    labelled
        .map(|(label, direction)| {
            let normal = table.rotation.tr_mul(&direction);
            Target { label, point: centre + normal * radius, normal }
        })
        .collect()
}
