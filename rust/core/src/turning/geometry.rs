//! Lines and arcs in the half plane (z, x) of a turned part, x the radius.
//!
//! A contour runs from the tailstock to the chuck, towards -Z, with the material on its left and the
//! air on its right (the tool's side under G42). Seen with Z to the right and X up, a
//! counter-clockwise arc is then convex: its centre lies in the material.

use crate::units::UM;
use crate::{Error, Result};

/// A point `[z, x]`, mm, x the radius.
pub type Point = [f64; 2];

/// Shorter than this is nothing, mm: a hundredth of the finest increment of a control.
pub const MIN_LENGTH_MM: f64 = 1e-5;

/// `a - b`.
#[must_use]
pub fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

/// `a + t b`.
#[must_use]
pub fn along(a: Point, t: f64, b: Point) -> Point {
    [a[0] + t * b[0], a[1] + t * b[1]]
}

/// Length of a vector.
#[must_use]
pub fn norm(a: Point) -> f64 {
    a[0].hypot(a[1])
}

/// Third component of the cross product: positive if `b` lies to the left of `a`.
#[must_use]
pub fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Scalar product.
#[must_use]
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// The air side of a direction of travel: a quarter turn to the right.
#[must_use]
pub fn right_of(direction: Point) -> Point {
    [direction[1], -direction[0]]
}

/// A piece of a contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    /// Straight.
    Line {
        /// Start.
        from: Point,
        /// End.
        to: Point,
    },
    /// Circular.
    Arc {
        /// Start.
        from: Point,
        /// End.
        to: Point,
        /// Centre.
        centre: Point,
        /// Its centre lies in the material; counter-clockwise, G3.
        convex: bool,
    },
}

impl Element {
    /// Start.
    #[must_use]
    pub const fn from(&self) -> Point {
        match self {
            Self::Line { from, .. } | Self::Arc { from, .. } => *from,
        }
    }

    /// End.
    #[must_use]
    pub const fn to(&self) -> Point {
        match self {
            Self::Line { to, .. } | Self::Arc { to, .. } => *to,
        }
    }

    /// Unit direction of travel at a point of the element.
    #[must_use]
    pub fn direction(&self, at: Point) -> Point {
        let along = match self {
            Self::Line { from, to } => minus(*to, *from),
            Self::Arc { centre, convex, .. } => {
                let radial = minus(at, *centre);
                if *convex { [-radial[1], radial[0]] } else { [radial[1], -radial[0]] }
            }
        };
        let length = norm(along);
        [along[0] / length, along[1] / length]
    }

    /// Slope dx/dz of a line; `None` for a wall and for an arc.
    #[must_use]
    pub fn slope(&self) -> Option<f64> {
        match self {
            Self::Line { from, to } if (to[0] - from[0]).abs() > MIN_LENGTH_MM => {
                Some((to[1] - from[1]) / (to[0] - from[0]))
            }
            _ => None,
        }
    }

    /// Radius of an arc.
    #[must_use]
    pub fn radius(&self) -> Option<f64> {
        match self {
            Self::Line { .. } => None,
            Self::Arc { from, centre, .. } => Some(norm(minus(*from, *centre))),
        }
    }

    /// Angle turned on an arc, rad, positive; 0 on a line.
    #[must_use]
    pub fn turned(&self) -> f64 {
        match self {
            Self::Line { .. } => 0.0,
            Self::Arc { from, to, centre, convex } => {
                let (a, b) = (minus(*from, *centre), minus(*to, *centre));
                let left = cross(a, b).atan2(dot(a, b));
                (if *convex { left } else { -left }).rem_euclid(std::f64::consts::TAU)
            }
        }
    }

    /// Does the element run towards -Z all along (walls do)?
    #[must_use]
    pub fn runs_to_chuck(&self) -> bool {
        match self {
            Self::Line { from, to } => to[0] <= from[0] + MIN_LENGTH_MM,
            Self::Arc { from, to, .. } => {
                // Ends that rounding has put beyond the point of return do no harm below a micrometre.
                let back = |at: Point| {
                    let z = self.direction(at)[0];
                    let radius = self.radius().unwrap_or(0.0);
                    z > 0.0 && radius * (1.0 - (1.0 - z * z).max(0.0).sqrt()) > UM
                };
                // Within half a turn the direction's z is extreme at the ends or at -1.
                self.turned() <= std::f64::consts::PI + 1e-3 && !back(*from) && !back(*to)
            }
        }
    }

    /// The element moved by `distance` to its air side; `None` if a concave arc vanishes.
    #[must_use]
    pub fn offset(&self, distance: f64) -> Option<Self> {
        let shift = |p: Point| along(p, distance, right_of(self.direction(p)));
        match self {
            Self::Line { from, to } => Some(Self::Line { from: shift(*from), to: shift(*to) }),
            Self::Arc { from, to, centre, convex } => {
                let radius = norm(minus(*from, *centre));
                let left = if *convex { radius + distance } else { radius - distance };
                (left > MIN_LENGTH_MM).then(|| Self::Arc {
                    from: shift(*from),
                    to: shift(*to),
                    centre: *centre,
                    convex: *convex,
                })
            }
        }
    }

    /// The same element between other ends (which lie on its line or circle).
    #[must_use]
    pub const fn between(&self, from: Point, to: Point) -> Self {
        match *self {
            Self::Line { .. } => Self::Line { from, to },
            Self::Arc { centre, convex, .. } => Self::Arc { from, to, centre, convex },
        }
    }

    /// Radius x of the element at `z`, if it is there (the lower end of a wall's range is not: a
    /// wall answers with its larger radius).
    #[must_use]
    pub fn x_at(&self, z: f64) -> Option<f64> {
        let (from, to) = (self.from(), self.to());
        if z > from[0].max(to[0]) + MIN_LENGTH_MM || z < from[0].min(to[0]) - MIN_LENGTH_MM {
            return None;
        }
        Some(match self {
            Self::Line { .. } => match self.slope() {
                None => from[1].max(to[1]),
                Some(slope) => from[1] + slope * (z - from[0]),
            },
            Self::Arc { centre, convex, .. } => {
                let radius = norm(minus(from, *centre));
                let height = (radius * radius - (z - centre[0]).powi(2)).max(0.0).sqrt();
                if *convex { centre[1] + height } else { centre[1] - height }
            }
        })
    }

    /// Points of a polyline that encloses the material side, from start to end, both included: on a
    /// convex arc the corners lie outside by at most `sagitta_mm`, on a concave arc the chords do.
    pub fn enclose(&self, sagitta_mm: f64, points: &mut Vec<Point>) {
        points.push(self.from());
        if let (Self::Arc { from, centre, convex, .. }, Some(radius)) = (self, self.radius()) {
            let turned = self.turned();
            let step = 2.0 * (1.0 - sagitta_mm / (radius + sagitta_mm)).acos();
            let pieces = (turned / step).ceil().max(1.0);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
            let count = pieces as usize;
            let sign = if *convex { 1.0 } else { -1.0 };
            let radial = minus(*from, *centre);
            let at = |angle: f64, scale: f64| {
                let (sine, cosine) = (sign * angle).sin_cos();
                [
                    centre[0] + scale * (cosine * radial[0] - sine * radial[1]),
                    centre[1] + scale * (sine * radial[0] + cosine * radial[1]),
                ]
            };
            let each = turned / pieces;
            for piece in 0..count {
                #[allow(clippy::cast_precision_loss)]
                let piece = piece as f64;
                if *convex {
                    points.push(at((piece + 0.5) * each, 1.0 / (0.5 * each).cos()));
                } else if piece > 0.0 {
                    points.push(at(piece * each, 1.0));
                }
            }
        }
        points.push(self.to());
    }
}

/// Where two lines, each through a point, meet; `None` if they are parallel.
#[must_use]
pub fn meet(p: Point, u: Point, q: Point, v: Point) -> Option<Point> {
    let across = cross(u, v);
    (across.abs() > 1e-12 * norm(u) * norm(v)).then(|| along(p, cross(minus(q, p), v) / across, u))
}

/// Where the (extended) lines or circles of two elements meet, nearest to `near`.
#[must_use]
pub fn intersection(a: &Element, b: &Element, near: Point) -> Option<Point> {
    let mut found: [Option<Point>; 2] = [None, None];
    match (a, b) {
        (Element::Line { from: p, to: p1 }, Element::Line { from: q, to: q1 }) => {
            found[0] = meet(*p, minus(*p1, *p), *q, minus(*q1, *q));
        }
        (Element::Line { from, to }, arc @ Element::Arc { centre, .. })
        | (arc @ Element::Arc { centre, .. }, Element::Line { from, to }) => {
            let (u, radius) = (minus(*to, *from), arc.radius()?);
            let length = norm(u);
            let foot = along(*from, dot(minus(*centre, *from), u) / (length * length), u);
            let distance = norm(minus(*centre, foot));
            // Touching within rounding counts as touching.
            if distance < radius + MIN_LENGTH_MM {
                let half = (radius * radius - distance * distance).max(0.0);
                let reach = half.sqrt() / length;
                found = [Some(along(foot, reach, u)), Some(along(foot, -reach, u))];
            }
        }
        (Element::Arc { centre: p, .. }, Element::Arc { centre: q, .. }) => {
            let (r, s) = (a.radius()?, b.radius()?);
            let between = minus(*q, *p);
            let distance = norm(between);
            if distance > MIN_LENGTH_MM
                && distance < r + s + MIN_LENGTH_MM
                && distance > (r - s).abs() - MIN_LENGTH_MM
            {
                let share = (r * r - s * s + distance * distance) / (2.0 * distance);
                let height = (r * r - share * share).max(0.0).sqrt();
                let foot = along(*p, share / distance, between);
                let across = right_of([between[0] / distance, between[1] / distance]);
                found = [Some(along(foot, height, across)), Some(along(foot, -height, across))];
            }
        }
    }
    found
        .into_iter()
        .flatten()
        .min_by(|a, b| norm(minus(*a, near)).total_cmp(&norm(minus(*b, near))))
}

/// An error for a contour that cannot be.
pub fn impossible(what: &str, at: Point, expected: &str) -> Error {
    Error::input(format!("contour at Z {:.3} X {:.3}", at[0], at[1]), what, expected)
}

/// Tangent-continuous there, or a corner to the left (concave) or right (convex)?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// No corner.
    Smooth,
    /// The air fills less than half the surroundings: the ball touches both sides.
    Concave,
    /// The ball rolls around it.
    Convex,
}

/// The corner between two consecutive elements.
#[must_use]
pub fn turn(before: &Element, after: &Element) -> Turn {
    let (d0, d1) = (before.direction(before.to()), after.direction(after.from()));
    let sine = cross(d0, d1);
    if sine.abs() < 1e-7 && dot(d0, d1) > 0.0 {
        Turn::Smooth
    } else if sine > 0.0 {
        Turn::Convex
    } else {
        Turn::Concave
    }
}

/// What stands where the offset of a convex corner would leave a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gap {
    /// The lines are drawn out until they meet, as in the paper.
    Meet,
    /// The tool rolls around the corner on an arc.
    Roll,
}

/// The contour moved by `distance` to the air side: the path of a nose or ball of that radius
/// (to the material side if negative: the contour of a nose's centre path).
///
/// # Errors
/// [`Error::Input`] where the offset turns an element around: the nose does not fit there.
pub fn offset(elements: &[Element], distance: f64, gap: Gap) -> Result<Vec<Element>> {
    let mut moved: Vec<Element> = Vec::with_capacity(elements.len());
    let mut original: Vec<&Element> = Vec::with_capacity(elements.len());
    for element in elements {
        let Some(shifted) = element.offset(distance) else { continue };
        if let (Some(last), Some(before)) = (moved.last_mut(), original.last()) {
            let apart = norm(minus(last.to(), shifted.from()));
            if apart > MIN_LENGTH_MM {
                let corner = turn(before, element);
                let opens = (corner == Turn::Convex) == (distance > 0.0);
                if opens && gap == Gap::Roll && corner != Turn::Smooth {
                    let arc = Element::Arc {
                        from: last.to(),
                        to: shifted.from(),
                        centre: element.from(),
                        convex: distance > 0.0,
                    };
                    moved.push(arc);
                    original.push(element);
                    moved.push(shifted);
                    original.push(element);
                    continue;
                }
                let at = intersection(last, &shifted, element.from()).ok_or_else(|| {
                    impossible(
                        &format!("an offset of {distance} mm finds no corner"),
                        element.from(),
                        "lines or arcs that meet: a smaller radius",
                    )
                })?;
                *last = last.between(last.from(), at);
                let shifted = shifted.between(at, shifted.to());
                moved.push(shifted);
                original.push(element);
                continue;
            }
        }
        moved.push(shifted);
        original.push(element);
    }
    for (shifted, element) in moved.iter().zip(&original) {
        if let (Element::Line { from, to }, Element::Line { .. }) = (shifted, element) {
            let run = minus(*to, *from);
            if dot(run, element.direction(element.from())) < -MIN_LENGTH_MM {
                return Err(impossible(
                    &format!("an offset of {distance} mm does not fit"),
                    element.from(),
                    "a smaller radius, or a wider groove",
                ));
            }
        }
    }
    moved.retain(|element| norm(minus(element.to(), element.from())) > MIN_LENGTH_MM);
    Ok(moved)
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUARTER: Element =
        Element::Arc { from: [0.0, 0.0], to: [-5.0, 5.0], centre: [-5.0, 0.0], convex: true };

    #[test]
    fn a_rounded_end_is_convex_and_grows_outward() {
        assert!((QUARTER.turned() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!(QUARTER.runs_to_chuck());
        let grown = QUARTER.offset(1.0).unwrap();
        assert!((grown.radius().unwrap() - 6.0).abs() < 1e-12);
        assert!((QUARTER.x_at(-2.0).unwrap() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn the_enclosing_polyline_lies_in_the_air() {
        for element in [
            QUARTER,
            Element::Arc { from: [0.0, 0.0], to: [-5.0, 5.0], centre: [0.0, 5.0], convex: false },
        ] {
            let Element::Arc { centre, convex, .. } = element else { panic!() };
            let mut points = Vec::new();
            element.enclose(1e-3, &mut points);
            for pair in points.windows(2) {
                for share in [0.0, 0.3, 0.5, 0.8] {
                    let p = along(pair[0], share, minus(pair[1], pair[0]));
                    let outside = norm(minus(p, centre)) - 5.0;
                    let outside = if convex { outside } else { -outside };
                    assert!((-1e-12..=1.01e-3).contains(&outside), "{outside}");
                }
            }
        }
    }

    #[test]
    fn an_offset_there_and_back_is_the_contour() {
        let contour = [
            Element::Line { from: [40.0, 5.0], to: [30.0, 10.0] },
            Element::Line { from: [30.0, 10.0], to: [20.0, 10.0] },
            Element::Arc {
                from: [20.0, 10.0],
                to: [15.0, 15.0],
                centre: [20.0, 15.0],
                convex: false,
            },
            Element::Line { from: [15.0, 15.0], to: [15.0, 20.0] },
            Element::Line { from: [15.0, 20.0], to: [0.0, 20.0] },
        ];
        for gap in [Gap::Meet, Gap::Roll] {
            let path = offset(&contour, 0.8, gap).unwrap();
            let back = offset(&path, -0.8, Gap::Meet).unwrap();
            assert_eq!(back.len(), contour.len());
            for (a, b) in back.iter().zip(&contour) {
                assert!(norm(minus(a.from(), b.from())) < 1e-9, "{a:?} {b:?}");
                assert!(norm(minus(a.to(), b.to())) < 1e-9, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn a_nose_that_does_not_fit_is_told() {
        let groove = [
            Element::Line { from: [20.0, 10.0], to: [11.0, 10.0] },
            Element::Line { from: [11.0, 10.0], to: [11.0, 5.0] },
            Element::Line { from: [11.0, 5.0], to: [10.0, 5.0] },
            Element::Line { from: [10.0, 5.0], to: [10.0, 10.0] },
        ];
        assert!(offset(&groove, 0.8, Gap::Roll).is_err());
        assert!(offset(&groove, 0.4, Gap::Roll).is_ok());
    }
}
