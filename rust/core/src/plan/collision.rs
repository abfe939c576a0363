//! Whether ball and stem get along a straight way without touching artefact, its stem or table,
//! wherever within its tolerance the artefact stands.
//!
//! Everything is in the table's frame. Shapes and swept queries are parry's: convex shapes and
//! their time of impact.

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::glamx::{DPose3, DQuat, DVec3};
use parry3d_f64::query::{ShapeCastOptions, cast_shapes, distance};
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape};

use crate::artefact::{Artefact, Fixture, Part};
use crate::pose::{Direction, Pose};
use crate::{Error, Result};

/// Ball, stem and body of the probe, mm. The stem leaves the ball towards the spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stylus {
    /// Radius of the ball.
    pub ball_radius: f64,
    /// Radius of the stem.
    pub stem_radius: f64,
    /// Length from the ball's centre to the end of the stem.
    pub length: f64,
    /// Radius and length of the body behind the stem; 0: none.
    pub body: [f64; 2],
}

/// A straight move of the ball's centre, with the stem in one direction.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Where it begins, mm.
    pub from: Vector3<f64>,
    /// Where it ends, mm.
    pub to: Vector3<f64>,
    /// Unit vector from the ball to the spindle.
    pub stem: Vector3<f64>,
}

/// How an artefact stands off its nominal place, as a pose of the table's frame that takes it from
/// where it should be to where it is.
#[derive(Clone, Copy, Debug)]
pub struct Stand(Pose);

impl Stand {
    /// A point of the table where the artefact has it.
    #[must_use]
    pub fn point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.0.undo(point)
    }

    /// A direction in the table's frame as the artefact has it.
    #[must_use]
    pub fn direction(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.0.rotation.tr_mul(direction)
    }

    fn way(&self, way: &Way) -> Way {
        Way {
            from: self.point(&way.from),
            to: self.point(&way.to),
            stem: self.direction(&way.stem),
        }
    }
}

struct Obstacle {
    pose: DPose3,
    shape: Box<dyn Shape>,
    /// Balls whose hull holds it: centre and radius, mm.
    hull: Vec<(Vector3<f64>, f64)>,
    /// How far any of its points may be from nominal, mm.
    growth: f64,
    /// Which part of what is touched it belongs to; none: it is not touched.
    part: Option<usize>,
}

/// How far the control may have the table turned from where it is commanded: work offsets of rotary
/// axes that are not where the zeros of the axes are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RotaryOffset {
    /// Of all axes under the table together, rad.
    pub angle: f64,
    /// Of those that tilt the table: its own axis only turns it, rad.
    pub lean: f64,
    /// How far these axes may pass from the origin of the table's frame, mm.
    pub reach: f64,
}

impl RotaryOffset {
    /// How far it moves a point at this distance from the origin of the table's frame, mm.
    #[must_use]
    pub fn shift(&self, distance: f64) -> f64 {
        self.angle * (self.reach + distance)
    }
}

/// Artefact, its stem and table as obstacles.
pub struct Surroundings {
    obstacles: Vec<Obstacle>,
    tolerance: f64,
    turn_tolerance: f64,
    offset: RotaryOffset,
    origin: Vector3<f64>,
    table_radius: f64,
    table_thickness: f64,
}

fn to_parry(v: &Vector3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// A cylinder that stands on z = `low`; parry's lies along Y.
fn upright(radius: f64, at: &Vector3<f64>, low: f64, high: f64) -> (DPose3, Box<dyn Shape>) {
    let turn = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let middle = DVec3::new(at.x, at.y, 0.5 * (low + high));
    (DPose3::from_parts(middle, turn), Box::new(Cylinder::new(0.5 * (high - low), radius)))
}

fn positive(what: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::input(format!("{what} in mm"), value, "a positive number"))
}

impl Surroundings {
    /// The artefact on a round table.
    ///
    /// # Errors
    /// A table without radius or thickness, a stem, a tolerance or an offset below zero.
    pub fn new(
        artefact: &Artefact,
        fixture: &Fixture,
        [table_radius, table_thickness]: [f64; 2],
        offset: RotaryOffset,
    ) -> Result<Self> {
        positive("radius of the table", table_radius)?;
        positive("thickness of the table", table_thickness)?;
        let sizes = [
            ("radius of the artefact's stem", fixture.stem_radius),
            ("tolerance of the artefact's place", fixture.tolerance),
            ("tolerance of the artefact's turn", fixture.turn_tolerance),
            ("offset of the rotary axes", offset.angle),
        ];
        for (what, size) in sizes {
            if !(size.is_finite() && size >= 0.0) {
                return Err(Error::input(what, size, "0 or a positive number"));
            }
        }
        let mut around = Self {
            obstacles: Vec::new(),
            tolerance: fixture.tolerance,
            turn_tolerance: fixture.turn_tolerance,
            offset,
            origin: fixture.place,
            table_radius,
            table_thickness,
        };
        for (number, part) in artefact.outline().into_iter().enumerate() {
            match part {
                Part::Box(lengths) => around.add_box(number, lengths, fixture.turn),
                Part::Ball { radius, centre } => around.add_ball(number, radius, &centre, fixture),
                Part::Ring { bore, outer, height } => {
                    around.add_ring(number, [bore, outer, height], fixture.turn);
                }
            }
        }
        around.add_base(&fixture.base, fixture.turn);
        around.add_holders(fixture)?;
        let (pose, shape) = upright(table_radius, &Vector3::zeros(), -table_thickness, 0.0);
        let growth = around.shift_at(0.0);
        let hull = Vec::new();
        around.obstacles.push(Obstacle { pose, shape, hull, growth, part: None });
        around.grow_by_offset();
        Ok(around)
    }

    /// An obstacle without a hull (the table, what carries a ring) is as far out as the table's rim.
    fn grow_by_offset(&mut self) {
        let rim = self.rim();
        for obstacle in &mut self.obstacles {
            let ends = obstacle.hull.iter().map(|(centre, r)| centre.norm() + r);
            obstacle.growth += self.offset.shift(ends.reduce(f64::max).unwrap_or(rim));
        }
    }

    /// Distance of the table's rim from the origin of its frame.
    fn rim(&self) -> f64 {
        self.table_radius.hypot(self.table_thickness)
    }

    /// What carries a box above the table is taken to be as wide as the box.
    fn add_box(&mut self, part: usize, [x, y, z]: [f64; 3], turn: f64) {
        let range = [self.origin.z.min(0.0), self.origin.z + z];
        self.add_block(Some(part), [x, y], &Vector3::zeros(), range, turn);
    }

    /// A plate under the artefact, on the table.
    fn add_base(&mut self, base: &Vector3<f64>, turn: f64) {
        if base.iter().all(|length| *length > 0.0) {
            self.add_block(None, [base.x, base.y], &Vector3::zeros(), [0.0, base.z], turn);
        }
    }

    /// Clamps beside the artefact, and a chuck about it.
    fn add_holders(&mut self, fixture: &Fixture) -> Result<()> {
        let rotation = Direction::Z.rotation(fixture.turn);
        for [x, y, along_x, along_y, height] in &fixture.clamps {
            for (what, size) in [("X", along_x), ("Y", along_y), ("Z", height)] {
                positive(&format!("length of a clamp along {what}"), *size)?;
            }
            let off = rotation * Vector3::new(*x, *y, 0.0);
            self.add_block(None, [*along_x, *along_y], &off, [0.0, *height], fixture.turn);
        }
        let [radius, height] = fixture.chuck;
        if radius > 0.0 && height > 0.0 {
            let at = fixture.place;
            let (pose, shape) = upright(radius, &at, 0.0, height);
            // A prism about it.
            let step = std::f64::consts::TAU / CORNERS as f64;
            let hull = (0..CORNERS).flat_map(|corner| {
                let out = Direction::Z.rotation(step * corner as f64) * Vector3::x() * radius;
                let around = at + out / (0.5 * step).cos();
                [0.0, height].map(|z| (Vector3::new(around.x, around.y, z), 0.0))
            });
            let hull = hull.collect();
            let growth = self.shift_at(0.0);
            self.obstacles.push(Obstacle { pose, shape, hull, growth, part: None });
        }
        Ok(())
    }

    /// The wall of a bore as narrow boxes, whose inner faces touch it, and what carries it.
    fn add_ring(&mut self, part: usize, [bore, outer, height]: [f64; 3], turn: f64) {
        let range = [self.origin.z.min(0.0), self.origin.z + height];
        let step = std::f64::consts::TAU / WALLS as f64;
        let width = 2.0 * outer * (0.5 * step).tan();
        for wall in 0..WALLS {
            let angle = turn + step * wall as f64;
            let middle = Direction::Z.rotation(angle) * Vector3::x() * (0.5 * (bore + outer));
            self.add_block(Some(part), [outer - bore, width], &middle, range, angle);
        }
        if self.origin.z > 0.0 {
            let (pose, shape) = upright(outer, &self.origin, 0.0, self.origin.z);
            let growth = self.shift_at(0.0);
            self.obstacles.push(Obstacle { pose, shape, hull: Vec::new(), growth, part: None });
        }
    }

    /// A box with these lengths, its middle off the artefact's origin by `off` (table's frame),
    /// between two heights over the table.
    fn add_block(
        &mut self,
        part: Option<usize>,
        [x, y]: [f64; 2],
        off: &Vector3<f64>,
        [low, high]: [f64; 2],
        turn: f64,
    ) {
        let half = DVec3::new(0.5 * x, 0.5 * y, 0.5 * (high - low));
        let at = self.origin + off;
        let middle = DVec3::new(at.x, at.y, 0.5 * (low + high));
        let rotation = Direction::Z.rotation(turn);
        let corners = [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)].map(|(i, j)| {
            let across = rotation * Vector3::new(i * x, j * y, 0.0);
            [low, high].map(|z| (Vector3::new(at.x, at.y, z) + across, 0.0))
        });
        self.obstacles.push(Obstacle {
            pose: DPose3::from_parts(middle, DQuat::from_rotation_z(turn)),
            shape: Box::new(Cuboid::new(half)),
            hull: corners.concat(),
            growth: self.shift_at(off.norm() + 0.5 * x.hypot(y)),
            part,
        });
    }

    fn add_ball(&mut self, part: usize, radius: f64, centre: &Vector3<f64>, fixture: &Fixture) {
        let at = self.origin + Direction::Z.rotation(fixture.turn) * centre;
        let growth = self.shift_at(centre.xy().norm());
        self.obstacles.push(Obstacle {
            pose: DPose3::from_translation(to_parry(&at)),
            shape: Box::new(Ball::new(radius)),
            hull: vec![(at, radius)],
            growth,
            part: Some(part),
        });
        let stem = fixture.stem_radius;
        if stem > 0.0 && at.z > 0.0 {
            let (pose, shape) = upright(stem, &at, 0.0, at.z);
            let foot = Vector3::new(at.x, at.y, 0.0);
            let hull = vec![(foot, stem), (at, stem)];
            self.obstacles.push(Obstacle { pose, shape, hull, growth, part: None });
        }
    }

    /// How far a point of the artefact may be from nominal, mm, at this distance from the Z axis of
    /// its frame.
    fn shift_at(&self, radius: f64) -> f64 {
        self.tolerance + SLACK_MM + self.turn_tolerance * radius
    }

    /// How far any point of what is touched may be from nominal, mm.
    #[must_use]
    pub fn growth(&self) -> f64 {
        let touched = self.obstacles.iter().filter(|obstacle| obstacle.part.is_some());
        touched.map(|obstacle| obstacle.growth).fold(0.0, f64::max)
    }

    /// How the artefact may stand: where it should, off by the tolerances of place and turn in 14
    /// directions each and both senses, and leaning with a table that is turned too far.
    #[must_use]
    pub fn stands(&self) -> Vec<Stand> {
        let mut directions = Vec::new();
        for direction in Direction::ALL {
            directions.extend([direction.unit(), -direction.unit()]);
        }
        directions.extend((0..8).map(|corner: usize| {
            Vector3::from_fn(|i, _| if corner >> i & 1 == 0 { 1.0 } else { -1.0 }).normalize()
        }));
        let turn = self.turn_tolerance + self.offset.angle;
        let way = self.tolerance + self.offset.shift(self.origin.norm());
        let off = directions.iter().flat_map(|direction| {
            [turn, -turn].map(|turn| self.stand(Direction::Z.rotation(turn), direction * way))
        });
        std::iter::once(Stand(Pose::identity())).chain(off).chain(self.tilted()).collect()
    }

    /// The artefact leaning by the offset of the axes that tilt, in [`LEANS`] directions; so much more
    /// that it leans by the offset in every direction between them.
    fn tilted(&self) -> impl Iterator<Item = Stand> {
        let step = std::f64::consts::TAU / LEANS as f64;
        let tilt = Direction::X.rotation(self.offset.lean / (0.5 * step).cos());
        let count = if self.offset.lean > 0.0 { LEANS } else { 0 };
        (0..count).map(move |lean| {
            let around = Direction::Z.rotation(step * lean as f64);
            self.stand(around * tilt * around.transpose(), Vector3::zeros())
        })
    }

    /// The artefact turned about its origin, then moved.
    fn stand(&self, rotation: Matrix3<f64>, moved: Vector3<f64>) -> Stand {
        let kept = self.origin - rotation * self.origin;
        Stand(Pose { rotation, translation: kept + moved })
    }

    /// Highest coordinate along `up` (machine frame) of anything that may be on the table at this
    /// pose.
    #[must_use]
    pub fn highest(&self, table: &Pose, up: &Vector3<f64>) -> f64 {
        let axis = table.rotation.column(2).dot(up);
        let rim = self.table_radius * (1.0 - axis * axis).max(0.0).sqrt();
        let disc = table.translation.dot(up) + rim + (-self.table_thickness * axis).max(0.0);
        let balls = self.obstacles.iter().flat_map(|obstacle| {
            let balls = obstacle.hull.iter();
            balls.map(|(centre, r)| table.apply(centre).dot(up) + r + obstacle.growth)
        });
        balls.fold(disc + self.shift_at(0.0) + self.offset.shift(self.rim()), f64::max)
    }

    /// Largest distance of anything that may be on the table from the origin of its frame.
    #[must_use]
    pub fn farthest(&self) -> f64 {
        let table = self.rim() + self.shift_at(0.0) + self.offset.shift(self.rim());
        let balls = self.obstacles.iter().flat_map(|obstacle| {
            obstacle.hull.iter().map(|(centre, r)| centre.norm() + r + obstacle.growth)
        });
        balls.fold(table, f64::max)
    }

    /// Whether ball and stem can make a move, wherever within its tolerance the artefact stands.
    #[must_use]
    pub fn is_free(&self, way: &Way, stylus: &Stylus) -> bool {
        self.obstacles.iter().all(|obstacle| !obstacle.meets(way, stylus, obstacle.growth))
    }

    /// Whether ball and stem can make an approach. `contact` is its nominal end; `ends` has, for each
    /// of some stands of the artefact, how far the ball really gets.
    #[must_use]
    pub fn is_approach_free(
        &self,
        way: &Way,
        contact: &Vector3<f64>,
        ends: &[(Stand, Vector3<f64>)],
        stylus: &Stylus,
    ) -> bool {
        let at: Vec<usize> = self
            .obstacles
            .iter()
            .filter_map(|obstacle| obstacle.part.filter(|_| obstacle.is_at(contact, stylus)))
            .collect();
        let is_touched =
            |obstacle: &&Obstacle| obstacle.part.is_some_and(|part| at.contains(&part));
        let (touched, others): (Vec<_>, Vec<_>) = self.obstacles.iter().partition(is_touched);
        others.iter().all(|obstacle| !obstacle.meets(way, stylus, obstacle.growth))
            && ends.iter().all(|(stand, end)| {
                let way = stand.way(&Way { to: *end, ..*way });
                touched.iter().all(|obstacle| !obstacle.meets(&way, stylus, 0.0))
            })
    }
}

/// What is kept beyond the stated tolerance: commands are rounded, starts are dithered by a tick, and
/// the machine has errors that nobody knows yet. Programs move exactly (G61): blending adds nothing.
const SLACK_MM: f64 = 0.05;

/// Boxes that stand for the wall of a bore: between two of them it is 0.05 % of its radius away, which
/// is within [`SLACK_MM`] for bores up to 180 mm.
const WALLS: usize = 96;

/// Directions in which an artefact on a table that is turned too far is looked at.
const LEANS: usize = 8;

/// Corners of the prism that stands for a chuck where the highest point is looked for.
const CORNERS: usize = 24;

/// A part is touched where the ball's distance from it is below this, mm.
const TOUCHED_MM: f64 = 1e-3;

impl Obstacle {
    /// Whether the ball touches it with its centre at `contact`.
    fn is_at(&self, contact: &Vector3<f64>, stylus: &Stylus) -> bool {
        let ball = Ball::new(stylus.ball_radius);
        let pose = DPose3::from_translation(to_parry(contact));
        let gap = distance(&pose, &ball, &self.pose, self.shape.as_ref());
        gap.is_ok_and(|gap| gap.distance < TOUCHED_MM)
    }

    /// Whether ball or stem come nearer than `growth` on a move.
    fn meets(&self, way: &Way, stylus: &Stylus, growth: f64) -> bool {
        let end = way.stem * stylus.length;
        let ball = Ball::new(stylus.ball_radius);
        let stem = Capsule::new(DVec3::ZERO, to_parry(&end), stylus.stem_radius);
        let from = DPose3::from_translation(to_parry(&way.from));
        let [radius, length] = stylus.body;
        let body = Cylinder::new(0.5 * length, radius);
        let middle = way.from + way.stem * (stylus.length + 0.5 * length);
        // parry's cylinder lies along Y.
        let along = DQuat::from_rotation_arc(DVec3::Y, to_parry(&way.stem));
        let behind = DPose3::from_parts(to_parry(&middle), along);
        let shapes: [(&DPose3, &dyn Shape); 3] = [(&from, &ball), (&from, &stem), (&behind, &body)];
        let shapes = &shapes[..if radius > 0.0 && length > 0.0 { 3 } else { 2 }];
        let velocity = to_parry(&(way.to - way.from));
        let options = ShapeCastOptions {
            max_time_of_impact: 1.0,
            target_distance: growth,
            compute_impact_geometry_on_penetration: false,
            ..ShapeCastOptions::default()
        };
        shapes.iter().any(|(pose, shape)| {
            let place = &self.pose;
            let hit = cast_shapes(
                pose,
                velocity,
                *shape,
                place,
                DVec3::ZERO,
                self.shape.as_ref(),
                options,
            );
            let gap = distance(pose, *shape, place, self.shape.as_ref());
            !matches!(hit, Ok(None)) || gap.is_ok_and(|gap| gap.distance <= growth)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: [f64; 2] = [150.0, 30.0];
    const EXACT: RotaryOffset = RotaryOffset { angle: 0.0, lean: 0.0, reach: 0.0 };
    const STYLUS: Stylus =
        Stylus { ball_radius: 1.0, stem_radius: 0.5, length: 100.0, body: [0.0; 2] };

    fn is_free(around: &Surroundings, from: [f64; 3], to: [f64; 3], stem: [f64; 3]) -> bool {
        let way = Way { from: from.into(), to: to.into(), stem: stem.into() };
        around.is_free(&way, &STYLUS)
    }

    #[test]
    fn the_stem_must_not_pass_through_an_arm() {
        let cross = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        let around = Surroundings::new(&cross, &Fixture::default(), TABLE, EXACT).unwrap();
        let up = [0.0, 0.0, 1.0];
        assert!(is_free(&around, [20.0, -37.5, 12.5], [13.6, -37.5, 12.5], up));
        assert!(!is_free(&around, [20.0, -37.5, 12.5], [13.4, -37.5, 12.5], up));
        // A stem along −Y from the side of the −X arm runs through nothing; along +X through the Y bar.
        let away = [0.0, -1.0, 0.0];
        assert!(is_free(&around, [-37.5, -20.0, 12.5], [-37.5, -13.6, 12.5], away));
        let across = [1.0, 0.0, 0.0];
        assert!(!is_free(&around, [-37.5, -20.0, 12.5], [-37.5, -13.6, 12.5], across));
        // Down into the table.
        assert!(!is_free(&around, [80.0, 80.0, 10.0], [80.0, 80.0, 0.5], up));
    }

    #[test]
    fn obstacles_grow_by_the_tolerance_of_the_place() {
        let cross = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        let place = Vector3::new(30.0, -20.0, 10.0);
        let fixture = Fixture { place, tolerance: 2.0, ..Fixture::default() };
        let around = Surroundings::new(&cross, &fixture, TABLE, EXACT).unwrap();
        let up = [0.0, 0.0, 1.0];
        let side = |x: f64| is_free(&around, [70.0, -57.5, 22.5], [x, -57.5, 22.5], up);
        assert!(side(30.0 + 12.5 + 1.0 + 2.1) && !side(30.0 + 12.5 + 1.0 + 1.9));
        // What carries it is as wide as the cross.
        assert!(!is_free(&around, [70.0, -57.5, 5.0], [45.0, -57.5, 5.0], up));
        assert!((around.highest(&Pose::identity(), &Vector3::z()) - 37.0 - SLACK_MM).abs() < 1e-12);
    }

    #[test]
    fn a_sphere_stands_on_its_stem() {
        let sphere = Artefact::of("sphere", &[25.0, 0.0, 0.0, 60.0]).unwrap();
        let below = ([0.0, 0.0, 30.0], [0.0, 0.0, 46.0], [0.0, 1.0, 0.0]);
        for (stem_radius, expected) in [(0.0, true), (4.0, false)] {
            let fixture = Fixture { stem_radius, ..Fixture::default() };
            let around = Surroundings::new(&sphere, &fixture, TABLE, EXACT).unwrap();
            assert_eq!(is_free(&around, below.0, below.1, below.2), expected);
        }
    }

    #[test]
    fn clamps_a_chuck_and_the_probe_s_body_are_in_the_way() {
        let cuboid = Artefact::of("cuboid", &[60.0, 60.0, 40.0]).unwrap();
        let up = [0.0, 0.0, 1.0];
        let free = |fixture: &Fixture, stylus: &Stylus, z: f64| {
            let around = Surroundings::new(&cuboid, fixture, TABLE, EXACT).unwrap();
            let way =
                Way { from: [45.0, 0.0, z].into(), to: [32.0, 0.0, z].into(), stem: up.into() };
            around.is_free(&way, stylus)
        };
        let bare = Fixture::default();
        assert!(free(&bare, &STYLUS, 12.0));
        let clamped = Fixture { clamps: vec![[40.0, 0.0, 10.0, 30.0, 15.0]], ..bare.clone() };
        assert!(!free(&clamped, &STYLUS, 12.0) && free(&clamped, &STYLUS, 20.0));
        let held = Fixture { chuck: [45.0, 25.0], ..bare.clone() };
        assert!(!free(&held, &STYLUS, 20.0) && free(&held, &STYLUS, 30.0));
        let short = Stylus { length: 20.0, body: [20.0, 60.0], ..STYLUS };
        assert!(!free(&bare, &short, 12.0) && free(&bare, &short, 22.0));
        let around = Surroundings::new(&cuboid, &held, TABLE, EXACT).unwrap();
        assert!((around.highest(&Pose::identity(), &Vector3::z()) - 40.0 - SLACK_MM).abs() < 1e-9);
        let thin = Fixture { clamps: vec![[40.0, 0.0, 0.0, 30.0, 15.0]], ..bare };
        assert!(Surroundings::new(&cuboid, &thin, TABLE, EXACT).is_err());
    }

    #[test]
    fn a_table_without_size_is_refused() {
        let cross = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        for (radius, thickness) in [(-1.0, 30.0), (150.0, -30.0), (150.0, 0.0), (f64::NAN, 30.0)] {
            assert!(
                Surroundings::new(&cross, &Fixture::default(), [radius, thickness], EXACT).is_err()
            );
        }
    }
}
