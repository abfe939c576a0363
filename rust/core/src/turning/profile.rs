//! The workpiece: corners with their kinds (Fig. 3), turned into lines and arcs.

use super::geometry::{
    Element, Gap, MIN_LENGTH_MM, Point, Turn, along, cross, dot, impossible, minus, norm, offset,
    turn,
};
use crate::nc::path::{Motion, Move, Plane, Side};
use crate::{Error, Result};

/// Kind of a corner.
///
/// The paper counts eight (its Fig. 3 is a drawing): sharp and filleted corners to either side,
/// lines that run into or out of an arc, arcs that follow each other, and the relief, which is cut
/// after finishing. Here an arc belongs to the point it starts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Corner {
    /// Two elements meet.
    Sharp,
    /// An arc of this radius, mm, tangent to both lines.
    Fillet(f64),
    /// The element before is an arc, the next a line. The radius is that of the point before.
    ArcIn,
    /// The next element is an arc of this radius, mm: positive with its centre in the material
    /// (convex), negative with its centre in the air. At most half a turn.
    ArcOut(f64),
    /// Arcs before and behind; the radius, mm, is that of the next.
    ArcToArc(f64),
    /// An undercut of this half width, mm, cut after finishing: the contour is sharp, and nothing is
    /// measured within it.
    Relief(f64),
}

/// An input point of the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// `[z, x]`, mm, x the radius.
    pub at: Point,
    /// Kind of corner.
    pub corner: Corner,
}

/// A turned contour, from the tailstock to the chuck; radius at most one at each z but for walls.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    elements: Vec<Element>,
    /// Reliefs: corner and half width, mm.
    reliefs: Vec<(Point, f64)>,
}

/// What a program's coordinates follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Follows {
    /// The contour: under G41, G42, or with a sharp tool.
    Contour,
    /// The centre of a nose of this radius, mm.
    NoseCentre(f64),
    /// The imaginary tip of a nose of this radius, mm: the place where tangents to the nose, along
    /// X on its chuck side and along Z on its axis side, meet (tip orientation 3).
    Tip(f64),
}

impl Follows {
    /// By name, with the radius of the nose, mm.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a name that is none, [`Error::Input`] for a radius that cannot be.
    pub fn named(name: &str, nose_mm: f64) -> Result<Self> {
        if !(nose_mm.is_finite() && nose_mm >= 0.0) {
            return Err(Error::input("radius of the nose, mm", nose_mm, "zero or more"));
        }
        match name {
            "contour" => Ok(Self::Contour),
            "nose-centre" => Ok(Self::NoseCentre(nose_mm)),
            "tip" => Ok(Self::Tip(nose_mm)),
            _ => Err(Error::unknown("follows", name, ["contour", "nose-centre", "tip"])),
        }
    }
}

impl Profile {
    /// From the input points P0..PN, tailstock first.
    ///
    /// # Errors
    /// [`Error::Input`] for fewer than two points, negative radii, a contour that folds back
    /// (towards +Z), fillets that do not fit and arcs that do not reach.
    pub fn from_vertices(vertices: &[Vertex]) -> Result<Self> {
        if vertices.len() < 2 {
            return Err(Error::input("points", vertices.len(), "two at least"));
        }
        for (index, vertex) in vertices.iter().enumerate() {
            check_vertex(index, vertex, vertices)?;
        }
        // Straight or circular from corner to corner, then the fillets cut in.
        let mut elements = Vec::with_capacity(2 * vertices.len());
        let mut reliefs = Vec::new();
        for pair in vertices.windows(2) {
            let [before, after] = pair else { continue };
            let element = match before.corner {
                Corner::ArcOut(radius) | Corner::ArcToArc(radius) => {
                    arc_between(before.at, after.at, radius)?
                }
                _ => Element::Line { from: before.at, to: after.at },
            };
            let cut = match before.corner {
                Corner::Fillet(radius) => {
                    let Some(last) = elements.pop() else { continue };
                    let (last, fillet, element) = filleted(&last, &element, radius)?;
                    elements.extend([last, fillet]);
                    element
                }
                Corner::Relief(width) => {
                    reliefs.push((before.at, width));
                    element
                }
                _ => element,
            };
            elements.push(cut);
        }
        elements.retain(|element| norm(minus(element.to(), element.from())) > MIN_LENGTH_MM);
        Self::new(elements, reliefs)
    }

    fn new(elements: Vec<Element>, reliefs: Vec<(Point, f64)>) -> Result<Self> {
        for element in &elements {
            if !element.runs_to_chuck() {
                return Err(impossible(
                    "folds back towards +Z",
                    element.from(),
                    "z that falls or stays",
                ));
            }
        }
        Ok(Self { elements, reliefs })
    }

    /// From lines and arcs that follow each other, and the corners that will be undercut, with the
    /// half width, mm.
    ///
    /// # Errors
    /// [`Error::Input`] for a contour that folds back.
    pub fn of_elements(elements: Vec<Element>, reliefs: Vec<(Point, f64)>) -> Result<Self> {
        Self::new(elements, reliefs)
    }

    /// From the feed moves of a finishing program; rapids end it, leading moves down to the contour
    /// stand before it.
    ///
    /// The contour is the longest run of connected feed moves without a rapid between them.
    ///
    /// # Errors
    /// [`Error::Program`] with line and column for a contour that folds back, moves out of the ZX
    /// plane, a nose that compensates to the left, or a program without feed moves.
    pub fn from_moves(moves: &[Move], follows: Follows) -> Result<Self> {
        let run = moves
            .split(|m| m.motion == Motion::Rapid)
            .max_by_key(|run| run.iter().filter(|m| m.to.axes[2] < m.from.axes[2]).count())
            .unwrap_or_default();
        if run.is_empty() {
            return Err(Error::Data("the program has no feed moves; expected a contour".into()));
        }
        let mut elements = Vec::with_capacity(run.len());
        for m in run {
            let element = element_of(m)?;
            if norm(minus(element.to(), element.from())) < MIN_LENGTH_MM {
                return Err(m
                    .span
                    .error("a full circle; expected a contour that runs to the chuck"));
            }
            if m.side == Side::Left {
                return Err(m
                    .span
                    .error("G41 on a contour towards the chuck; expected G42 or G40"));
            }
            if !element.runs_to_chuck() {
                return Err(m.span.error(format!(
                    "the contour folds back from Z{:.3} to Z{:.3}; expected Z that falls or stays",
                    m.from.axes[2], m.to.axes[2]
                )));
            }
            elements.push(element);
        }
        let elements = match follows {
            Follows::Contour => elements,
            Follows::NoseCentre(radius) => offset(&elements, -radius, Gap::Meet)?,
            Follows::Tip(radius) => {
                let centre: Vec<_> =
                    elements.iter().map(|e| shifted(e, [radius, radius])).collect();
                offset(&centre, -radius, Gap::Meet)?
            }
        };
        Self::new(elements, Vec::new())
    }

    /// Lines and arcs, tailstock first.
    #[must_use]
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// Corners that will be undercut, with the half width, mm.
    #[must_use]
    pub fn reliefs(&self) -> &[(Point, f64)] {
        &self.reliefs
    }

    /// The path that a program has to hold to cut this profile.
    ///
    /// # Errors
    /// [`Error::Input`] where the nose does not fit.
    pub fn path(&self, follows: Follows, gap: Gap) -> Result<Vec<Element>> {
        match follows {
            Follows::Contour => Ok(self.elements.clone()),
            Follows::NoseCentre(radius) => offset(&self.elements, radius, gap),
            Follows::Tip(radius) => {
                let centre = offset(&self.elements, radius, gap)?;
                Ok(centre.iter().map(|e| shifted(e, [-radius, -radius])).collect())
            }
        }
    }

    /// Radius at `z`, mm; at a wall the larger one; `None` beside the part.
    #[must_use]
    pub fn x_at(&self, z: f64) -> Option<f64> {
        self.elements.iter().filter_map(|e| e.x_at(z)).reduce(f64::max)
    }

    /// Largest radius, mm.
    #[must_use]
    pub fn largest_x(&self) -> f64 {
        let mut points = Vec::new();
        for element in &self.elements {
            element.enclose(1e-3, &mut points);
        }
        points.iter().fold(0.0, |most, p| most.max(p[1]))
    }

    /// First and last z, mm.
    #[must_use]
    pub fn ends(&self) -> Option<(f64, f64)> {
        Some((self.elements.first()?.from()[0], self.elements.last()?.to()[0]))
    }
}

fn check_vertex(index: usize, vertex: &Vertex, vertices: &[Vertex]) -> Result<()> {
    let [z, x] = vertex.at;
    let name = |what: &str| format!("point {index}: {what}");
    if !(z.is_finite() && x.is_finite() && x >= 0.0) {
        return Err(Error::input(name("z, x"), format!("{z}, {x}"), "finite, x not negative"));
    }
    let radius = match vertex.corner {
        Corner::Fillet(r) | Corner::Relief(r) => Some(r),
        Corner::ArcOut(r) | Corner::ArcToArc(r) => Some(r.abs()),
        Corner::Sharp | Corner::ArcIn => None,
    };
    if let Some(radius) = radius.filter(|r| !(r.is_finite() && *r > 0.0)) {
        return Err(Error::input(name("radius"), radius, "finite and more than zero"));
    }
    let before = index.checked_sub(1).and_then(|i| vertices.get(i));
    let after_arc =
        before.is_some_and(|v| matches!(v.corner, Corner::ArcOut(_) | Corner::ArcToArc(_)));
    let says_arc = matches!(vertex.corner, Corner::ArcIn | Corner::ArcToArc(_));
    if after_arc != says_arc {
        let expected = if after_arc { "arc in or arc to arc" } else { "no arc before it" };
        return Err(Error::input(name("kind of corner"), format!("{:?}", vertex.corner), expected));
    }
    let inner = before.is_some() && index + 1 < vertices.len();
    if !inner
        && matches!(vertex.corner, Corner::Fillet(_) | Corner::Relief(_) | Corner::ArcToArc(_))
    {
        return Err(Error::input(
            name("kind of corner"),
            format!("{:?}", vertex.corner),
            "an inner point",
        ));
    }
    if index + 1 == vertices.len() && matches!(vertex.corner, Corner::ArcOut(_)) {
        return Err(Error::input(name("kind of corner"), "an arc behind the last point", "sharp"));
    }
    if let Some(before) = before
        && z > before.at[0] + MIN_LENGTH_MM
    {
        return Err(Error::input(name("z"), z, format!("at most {}: it folds back", before.at[0])));
    }
    Ok(())
}

/// The arc of at most half a turn with this radius, positive if convex.
fn arc_between(from: Point, to: Point, radius: f64) -> Result<Element> {
    let chord = minus(to, from);
    let half = 0.5 * norm(chord);
    if half < MIN_LENGTH_MM || half > radius.abs() + MIN_LENGTH_MM {
        let got = format!("radius {} mm over {:.3} mm", radius.abs(), 2.0 * half);
        return Err(impossible(&got, from, "a radius of at least half the distance"));
    }
    let height = (radius * radius - half * half).max(0.0).sqrt();
    // The material is on the left, and so is the centre of a convex arc.
    let left = [-chord[1] / (2.0 * half), chord[0] / (2.0 * half)];
    let middle = along(from, 0.5, chord);
    let centre = along(middle, height * radius.signum(), left);
    Ok(Element::Arc { from, to, centre, convex: radius > 0.0 })
}

/// Two lines and the arc between them.
fn filleted(before: &Element, after: &Element, radius: f64) -> Result<(Element, Element, Element)> {
    let corner = after.from();
    let (Element::Line { .. }, Element::Line { .. }) = (before, after) else {
        return Err(impossible("a fillet beside an arc", corner, "a fillet between two lines"));
    };
    let (d0, d1) = (before.direction(corner), after.direction(corner));
    let kind = turn(before, after);
    if kind == Turn::Smooth {
        return Err(impossible("a fillet where nothing turns", corner, "a corner"));
    }
    let angle = cross(d0, d1).abs().atan2(dot(d0, d1));
    let tangent = radius * (0.5 * angle).tan();
    let room = norm(minus(before.from(), corner)).min(norm(minus(after.to(), corner)));
    if tangent > room + MIN_LENGTH_MM {
        let got = format!("a fillet of radius {radius} mm needs {tangent:.3} mm, has {room:.3} mm");
        return Err(impossible(&got, corner, "a fillet that fits"));
    }
    let (from, to) = (along(corner, -tangent, d0), along(corner, tangent, d1));
    let convex = kind == Turn::Convex;
    let left = [-d0[1], d0[0]];
    let centre = along(from, if convex { radius } else { -radius }, left);
    let fillet = Element::Arc { from, to, centre, convex };
    Ok((before.between(before.from(), from), fillet, after.between(to, after.to())))
}

fn shifted(element: &Element, by: Point) -> Element {
    let shift = |p: &Point| along(*p, 1.0, by);
    match element {
        Element::Line { from, to } => Element::Line { from: shift(from), to: shift(to) },
        Element::Arc { from, to, centre, convex } => Element::Arc {
            from: shift(from),
            to: shift(to),
            centre: shift(centre),
            convex: *convex,
        },
    }
}

/// A feed move as a piece of contour.
///
/// # Errors
/// [`Error::Program`] for anything but a line or an arc in the ZX plane.
pub fn element_of(m: &Move) -> Result<Element> {
    let (from, to) = ([m.from.axes[2], m.from.axes[0]], [m.to.axes[2], m.to.axes[0]]);
    match m.motion {
        Motion::Feed | Motion::Rapid => Ok(Element::Line { from, to }),
        Motion::Arc { plane: Plane::Zx, centre, clockwise } => {
            Ok(Element::Arc { from, to, centre, convex: !clockwise })
        }
        Motion::Arc { .. } => Err(m.span.error("an arc outside the ZX plane; expected G18")),
        Motion::Probe => Err(m.span.error("a probing move; expected a contour")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sharp(z: f64, x: f64) -> Vertex {
        Vertex { at: [z, x], corner: Corner::Sharp }
    }

    #[test]
    fn fillets_touch_both_lines() {
        let corner = Vertex { at: [50.0, 20.0], corner: Corner::Fillet(5.0) };
        let concave =
            Profile::from_vertices(&[sharp(100.0, 20.0), corner, sharp(50.0, 40.0)]).unwrap();
        let [line, arc, wall] = concave.elements() else { panic!() };
        assert!((line.to()[0] - 55.0).abs() < 1e-12);
        assert!((wall.from()[1] - 25.0).abs() < 1e-12);
        let Element::Arc { centre, convex, .. } = arc else { panic!() };
        assert!(!convex && norm(minus(*centre, [55.0, 25.0])) < 1e-12);
        assert_eq!(turn(line, arc), Turn::Smooth);
        assert_eq!(turn(arc, wall), Turn::Smooth);
        let corner = Vertex { at: [50.0, 40.0], corner: Corner::Fillet(5.0) };
        let convex =
            Profile::from_vertices(&[sharp(100.0, 40.0), corner, sharp(50.0, 20.0)]).unwrap();
        let Element::Arc { centre, convex, .. } = convex.elements()[1] else { panic!() };
        assert!(convex && norm(minus(centre, [55.0, 35.0])) < 1e-12);
    }

    #[test]
    fn arcs_between_points() {
        let ball = [
            Vertex { at: [10.0, 0.0], corner: Corner::ArcOut(10.0) },
            Vertex { at: [0.0, 10.0], corner: Corner::ArcToArc(-10.0) },
            Vertex { at: [-10.0, 20.0], corner: Corner::ArcIn },
            sharp(-30.0, 20.0),
        ];
        let profile = Profile::from_vertices(&ball).unwrap();
        let Element::Arc { centre, convex, .. } = profile.elements()[0] else { panic!() };
        assert!(convex && norm(centre) < 1e-9, "{centre:?}");
        let Element::Arc { centre, convex, .. } = profile.elements()[1] else { panic!() };
        assert!(!convex && norm(minus(centre, [0.0, 20.0])) < 1e-9, "{centre:?}");
        assert!(Profile::from_vertices(&[ball[0], sharp(0.0, 10.0)]).is_err());
    }

    #[test]
    fn impossible_shapes_are_refused() {
        assert!(Profile::from_vertices(&[sharp(0.0, 1.0)]).is_err());
        assert!(Profile::from_vertices(&[sharp(0.0, 1.0), sharp(1.0, 1.0)]).is_err());
        assert!(Profile::from_vertices(&[sharp(1.0, -1.0), sharp(0.0, 1.0)]).is_err());
        let big = Vertex { at: [50.0, 20.0], corner: Corner::Fillet(25.0) };
        assert!(Profile::from_vertices(&[sharp(100.0, 20.0), big, sharp(50.0, 40.0)]).is_err());
    }
}
