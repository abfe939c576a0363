//! Whether ball and stem get along a straight way without touching artefact or table.
//!
//! Everything is in the table's frame. Shapes and swept queries are parry's: convex shapes and
//! their time of impact.

use nalgebra::Vector3;
use parry3d_f64::glamx::{DPose3, DQuat, DVec3};
use parry3d_f64::query::{ShapeCastOptions, cast_shapes};
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape};

use crate::artefact::{Artefact, Part};
use crate::pose::Pose;

/// Ball and stem of the probe, mm. The stem leaves the ball towards the spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stylus {
    /// Radius of the ball.
    pub ball_radius: f64,
    /// Radius of the stem.
    pub stem_radius: f64,
    /// Length from the ball's centre to the end of the stem.
    pub length: f64,
}

/// Artefact and table as obstacles.
pub struct Surroundings {
    obstacles: Vec<(DPose3, Box<dyn Shape>)>,
    /// Points on the hull, to find the highest.
    corners: Vec<Vector3<f64>>,
    table_radius: f64,
    table_thickness: f64,
}

fn to_parry(v: &Vector3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

impl Surroundings {
    /// The artefact on a round table.
    #[must_use]
    pub fn new(artefact: &Artefact, table_radius: f64, table_thickness: f64) -> Self {
        let mut obstacles: Vec<(DPose3, Box<dyn Shape>)> = Vec::new();
        let mut corners = Vec::new();
        for part in artefact.outline() {
            match part {
                Part::Box([x, y, z]) => {
                    let half = DVec3::new(0.5 * x, 0.5 * y, 0.5 * z);
                    let pose = DPose3::from_translation(DVec3::new(0.0, 0.0, 0.5 * z));
                    obstacles.push((pose, Box::new(Cuboid::new(half))));
                    for (i, j) in [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)] {
                        corners.push(Vector3::new(i * x, j * y, z));
                    }
                }
                Part::Ball { radius, centre } => {
                    let pose = DPose3::from_translation(to_parry(&centre));
                    obstacles.push((pose, Box::new(Ball::new(radius))));
                    for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
                        corners.extend([centre + direction * radius, centre - direction * radius]);
                    }
                }
            }
        }
        // parry's cylinder stands along Y.
        let upright = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let middle = DVec3::new(0.0, 0.0, -0.5 * table_thickness);
        let table = Cylinder::new(0.5 * table_thickness, table_radius);
        obstacles.push((DPose3::from_parts(middle, upright), Box::new(table)));
        Self { obstacles, corners, table_radius, table_thickness }
    }

    /// Highest coordinate along `up` (machine frame) of anything on the table at this pose.
    #[must_use]
    pub fn highest(&self, table: &Pose, up: &Vector3<f64>) -> f64 {
        let axis = table.rotation.column(2).dot(up);
        let rim = self.table_radius * (1.0 - axis * axis).max(0.0).sqrt();
        let disc = table.translation.dot(up) + rim + (-self.table_thickness * axis).max(0.0);
        let corners = self.corners.iter().map(|corner| table.apply(corner).dot(up));
        corners.fold(disc, f64::max)
    }

    /// Largest distance of anything on the table from the origin.
    #[must_use]
    pub fn farthest(&self) -> f64 {
        let table = self.table_radius.hypot(self.table_thickness);
        self.corners.iter().map(Vector3::norm).fold(table, f64::max)
    }

    /// Whether ball and stem can move from `from` to `to` (ball centre, table frame) with the stem in
    /// direction `stem`.
    #[must_use]
    pub fn is_free(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        stem: &Vector3<f64>,
        stylus: &Stylus,
    ) -> bool {
        let tip = Vector3::zeros();
        let end = stem * stylus.length;
        let shapes: [Box<dyn Shape>; 2] = [
            Box::new(Ball::new(stylus.ball_radius)),
            Box::new(Capsule::new(to_parry(&tip), to_parry(&end), stylus.stem_radius)),
        ];
        let pose = DPose3::from_translation(to_parry(from));
        let velocity = to_parry(&(to - from));
        let options = ShapeCastOptions {
            max_time_of_impact: 1.0,
            compute_impact_geometry_on_penetration: false,
            ..ShapeCastOptions::default()
        };
        shapes.iter().all(|shape| {
            self.obstacles.iter().all(|(place, obstacle)| {
                let hit = cast_shapes(
                    &pose,
                    velocity,
                    shape.as_ref(),
                    place,
                    DVec3::ZERO,
                    obstacle.as_ref(),
                    options,
                );
                matches!(hit, Ok(None))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stem_must_not_pass_through_an_arm() {
        let cross = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        let around = Surroundings::new(&cross, 150.0, 30.0);
        let stylus = Stylus { ball_radius: 1.0, stem_radius: 0.5, length: 100.0 };
        let free = |from: [f64; 3], to: [f64; 3], stem: [f64; 3]| {
            around.is_free(&from.into(), &to.into(), &stem.into(), &stylus)
        };
        let up = [0.0, 0.0, 1.0];
        assert!(free([20.0, -37.5, 12.5], [13.6, -37.5, 12.5], up));
        assert!(!free([20.0, -37.5, 12.5], [13.4, -37.5, 12.5], up));
        // A stem along −Y from the side of the −X arm runs through nothing; along +X through the Y bar.
        assert!(free([-37.5, -20.0, 12.5], [-37.5, -13.6, 12.5], [0.0, -1.0, 0.0]));
        assert!(!free([-37.5, -20.0, 12.5], [-37.5, -13.6, 12.5], [1.0, 0.0, 0.0]));
        // Down into the table.
        assert!(!free([80.0, 80.0, 10.0], [80.0, 80.0, 0.5], up));
    }
}
