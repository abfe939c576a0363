//! Does a move of the probe touch the part? Solved on convex shapes, not stepped.
//!
//! The part is a row of trapezoids under its contour; arcs are enclosed by polylines that lie outside
//! by at most [`SAGITTA_MM`], so that a clearance is never overstated. A straight move sweeps the
//! ball over a capsule and the stylus and body, which are convex, over the convex hull of their two
//! ends. The distance of two convex polygons is exact.

use super::geometry::{MIN_LENGTH_MM, Point, along, dot, minus, norm};
use super::profile::Profile;
use crate::units::UM;
use crate::{Error, Result};

/// How far the polygon of the part may lie outside its arcs, mm.
pub const SAGITTA_MM: f64 = 0.1 * UM;

/// The probe of Fig. 4: a ball on a cone below a cylindrical body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Radius R_p of the ball, mm.
    pub ball_radius_mm: f64,
    /// Full angle θ of the cone between ball and body, rad: slopes up to tan((π - θ)/2) can be
    /// touched by the ball.
    pub contact_angle: f64,
    /// Diameter D of the body, mm.
    pub body_diameter_mm: f64,
}

impl Probe {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`Error::Input`] for a probe that cannot be.
    pub fn check(&self) -> Result<()> {
        let positive = |what: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(Error::input(what, value, "finite and more than zero"))
            }
        };
        positive("ball radius, mm", self.ball_radius_mm)?;
        positive("body diameter, mm", self.body_diameter_mm)?;
        if !(0.0..std::f64::consts::PI).contains(&self.contact_angle) {
            return Err(Error::input(
                "contact angle, rad",
                self.contact_angle,
                "from 0 to below π",
            ));
        }
        Ok(())
    }

    /// Steepest slope that the ball touches before the cone does (section 2.3(2)).
    #[must_use]
    pub fn steepest(&self) -> f64 {
        (0.5 * (std::f64::consts::PI - self.contact_angle)).tan()
    }

    /// Cone and body around a ball centred at `centre`, up to `top`: a convex polygon.
    fn body(&self, centre: Point, top: f64) -> Vec<Point> {
        let (sine, cosine) = (0.5 * self.contact_angle).sin_cos();
        let half = 0.5 * self.body_diameter_mm;
        // The cone leaves the ball where its normal (cos, -sin) points, and widens to the body; a
        // body thinner than the ball stands on it.
        let (z, x) = (self.ball_radius_mm * cosine, -self.ball_radius_mm * sine);
        let mut outline = vec![[-half, top - centre[1]], [half, top - centre[1]]];
        if half > z && sine > 0.0 {
            let shoulder = x + (half - z) * cosine / sine;
            outline.extend([[half, shoulder], [z, x], [-z, x], [-half, shoulder]]);
        } else {
            outline.extend([[half, 0.0], [-half, 0.0]]);
        }
        outline.iter().map(|p| along(*p, 1.0, centre)).collect()
    }
}

/// The chuck with its jaws: everything behind its face up to a radius.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chuck {
    /// Radius over the jaws, mm; 0: none.
    pub radius_mm: f64,
    /// Z of the face of the jaws, mm.
    pub face_mm: f64,
}

/// The part, ready for questions of distance.
#[derive(Clone, Debug)]
pub struct Solid {
    pieces: Vec<[Point; 4]>,
    top: f64,
}

impl Solid {
    /// The part inside its contour, and the chuck behind its face up to its radius.
    #[must_use]
    pub fn new(profile: &Profile, chuck: &Chuck) -> Self {
        let mut outline = Vec::new();
        for element in profile.elements() {
            element.enclose(SAGITTA_MM, &mut outline);
        }
        let mut pieces: Vec<[Point; 4]> = outline
            .windows(2)
            .filter_map(|pair| match pair {
                [a, b] if a[0] - b[0] > MIN_LENGTH_MM => Some([*a, *b, [b[0], 0.0], [a[0], 0.0]]),
                _ => None,
            })
            .collect();
        if chuck.radius_mm > 0.0 {
            let Chuck { radius_mm: radius, face_mm: face } = *chuck;
            let back = face - 1e3;
            pieces.push([[face, radius], [back, radius], [back, 0.0], [face, 0.0]]);
        }
        let top = pieces.iter().flatten().fold(0.0, |most: f64, p| most.max(p[1]));
        Self { pieces, top }
    }

    /// Largest radius, mm.
    #[must_use]
    pub fn top(&self) -> f64 {
        self.top
    }

    /// Clearance of the probe on the straight move of its ball's centre `from` → `to`, mm: of the
    /// ball and of its cone and body. Negative by the depth of the gouge.
    #[must_use]
    pub fn clearance(&self, probe: &Probe, from: Point, to: Point) -> Clearance {
        let top = self.top.max(from[1]).max(to[1]) + 100.0;
        let mut ends = probe.body(from, top);
        ends.extend(probe.body(to, top));
        let body = hull(ends);
        let line = [from, to];
        let mut least = Clearance { ball_mm: f64::INFINITY, body_mm: f64::INFINITY };
        for piece in &self.pieces {
            least.ball_mm = least.ball_mm.min(distance(&line, piece) - probe.ball_radius_mm);
            least.body_mm = least.body_mm.min(distance(&body, piece));
        }
        least
    }
}

/// Least distances between the part and the probe on a move, mm; infinite beside no part at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Of the ball.
    pub ball_mm: f64,
    /// Of cone and body.
    pub body_mm: f64,
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut chain: Vec<Point> = Vec::with_capacity(points.len() + 1);
    let mut half = |points: &mut dyn Iterator<Item = &Point>| {
        let floor = chain.len();
        for p in points {
            while let [.., a, b] = chain[floor..]
                && super::geometry::cross(minus(b, a), minus(*p, b)) <= 0.0
            {
                chain.pop();
            }
            chain.push(*p);
        }
        chain.pop();
    };
    half(&mut points.iter());
    half(&mut points.iter().rev());
    chain
}

/// Distance of two convex polygons (a segment is one of two corners); negative by the depth of their
/// overlap.
fn distance(a: &[Point], b: &[Point]) -> f64 {
    // Overlap: the least shift along the normal of an edge that separates them.
    let mut separation = f64::NEG_INFINITY;
    for (polygon, other) in [(a, b), (b, a)] {
        for (p, q) in edges(polygon) {
            let edge = minus(q, p);
            let length = norm(edge);
            if length < MIN_LENGTH_MM {
                continue;
            }
            for normal in
                [[edge[1] / length, -edge[0] / length], [-edge[1] / length, edge[0] / length]]
            {
                let reach = polygon.iter().fold(f64::NEG_INFINITY, |m, c| m.max(dot(*c, normal)));
                let near = other.iter().fold(f64::INFINITY, |m, c| m.min(dot(*c, normal)));
                separation = separation.max(near - reach);
            }
        }
    }
    if separation <= 0.0 {
        return separation;
    }
    let mut least = f64::INFINITY;
    for (p, q) in edges(a) {
        for (r, s) in edges(b) {
            for (point, from, to) in [(p, r, s), (q, r, s), (r, p, q), (s, p, q)] {
                let edge = minus(to, from);
                let square = dot(edge, edge);
                let share = if square > 0.0 { dot(minus(point, from), edge) / square } else { 0.0 };
                least = least.min(norm(minus(point, along(from, share.clamp(0.0, 1.0), edge))));
            }
        }
    }
    least
}

fn edges(polygon: &[Point]) -> impl Iterator<Item = (Point, Point)> {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().copied().zip(next.copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::turning::profile::{Corner, Vertex};

    fn step() -> Profile {
        let at = |z, x| Vertex { at: [z, x], corner: Corner::Sharp };
        Profile::from_vertices(&[at(100.0, 10.0), at(50.0, 10.0), at(50.0, 30.0), at(0.0, 30.0)])
            .unwrap()
    }

    const PROBE: Probe = Probe { ball_radius_mm: 5.0, contact_angle: 1.75, body_diameter_mm: 12.0 };

    #[test]
    fn the_ball_touches_at_its_radius() {
        let solid = Solid::new(&step(), &Chuck::default());
        let seen = solid.clearance(&PROBE, [90.0, 15.0], [60.0, 15.0]);
        assert!(seen.ball_mm.abs() < 1e-12, "{seen:?}");
        let deep = solid.clearance(&PROBE, [90.0, 14.9], [60.0, 15.0]);
        assert!((deep.ball_mm + 0.1).abs() < 1e-3, "{deep:?}");
    }

    #[test]
    fn the_body_is_seen_beside_a_wall() {
        let solid = Solid::new(&step(), &Chuck::default());
        let seen = solid.clearance(&PROBE, [70.0, 15.0], [57.0, 15.0]);
        assert!((seen.body_mm - 1.0).abs() < 1e-9, "{seen:?}");
        let seen = solid.clearance(&PROBE, [70.0, 15.0], [55.5, 15.0]);
        assert!(seen.ball_mm > -1e-9 && (seen.body_mm + 0.5).abs() < 1e-9, "{seen:?}");
    }

    #[test]
    fn a_move_through_the_part_is_seen_though_its_ends_are_free() {
        let solid = Solid::new(&step(), &Chuck::default());
        let seen = solid.clearance(&PROBE, [120.0, 20.0], [-120.0, 20.0]);
        assert!(seen.ball_mm < -10.0, "{seen:?}");
    }
}
