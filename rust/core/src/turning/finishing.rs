//! From a profile to the program that finishes it.

use super::geometry::{Element, Gap, MIN_LENGTH_MM, Point, minus, norm};
use super::probe_program::Writer;
use super::profile::{Follows, Profile};
use crate::nc::{Dialect, Program, Word};
use crate::{Error, Result};

/// How the program is laid out. What the paper does not determine is here.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishOptions {
    /// Dialect.
    pub dialect: Dialect,
    /// What the coordinates follow.
    pub follows: Follows,
    /// What happens at convex corners of a centre path.
    pub gap: Gap,
    /// Number of the first element that is cut.
    pub first_element: usize,
    /// z before the part, mm, from which the tool sets in.
    pub start_z_mm: f64,
    /// Radius to which the tool is drawn back, mm.
    pub retract_x_mm: f64,
    /// Height above a floor, mm (radius), from which the tool plunges at feed.
    pub approach_mm: f64,
    /// Steepest fall towards the chuck, dx/dz, that the tool's back edge lets it follow.
    pub steepest_fall: f64,
    /// z at which the tool may plunge into what it cannot follow down to, mm.
    pub access_z_mm: Vec<f64>,
    /// Feed, as the dialect counts it; none writes no F.
    pub feed: Option<f64>,
    /// Number of the first block; none writes no numbers.
    pub first_number: Option<u32>,
    /// Blocks before: `(letter, value)` words (G42 among them, where the contour is held).
    pub head: Vec<Vec<(char, f64)>>,
    /// Blocks behind.
    pub tail: Vec<Vec<(char, f64)>>,
}

/// A finishing program and the elements that it leaves alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Finishing {
    /// The program: X in diameters, arcs by radius.
    pub program: Program,
    /// Ranges of z, mm, that the tool could not follow, from the tailstock: another tool's work.
    pub left_out: Vec<(f64, f64)>,
}

/// Writes the finishing program.
///
/// Where the contour falls more steeply than the tool follows (a groove's wall), the tool is drawn
/// back, plunges at an access point on a floor further on, and goes on from there (Fig. 14).
///
/// # Errors
/// [`Error::Input`] for a nose that does not fit, a groove without an access point, a retract height
/// below the part.
pub fn finishing(profile: &Profile, options: &FinishOptions) -> Result<Finishing> {
    if options.retract_x_mm.is_nan() || options.retract_x_mm <= profile.largest_x() {
        let expected = format!("more than the largest radius, {:.3}", profile.largest_x());
        return Err(Error::input("retract radius, mm", options.retract_x_mm, expected));
    }
    // Elements keep their numbers only on the profile itself: cut the head off there.
    let kept = profile.elements().get(options.first_element..).unwrap_or_default();
    let path = profile.path(options.follows, options.gap)?;
    let (Some(first), Some(kept_first)) = (path.first(), kept.first()) else {
        return Err(Error::input("first element", options.first_element, "one of the profile"));
    };
    let expected =
        kept_first.offset(reach(options.follows)).map_or(first.from(), |e| e.direction(e.from()));
    let begin = path
        .iter()
        .position(|e| {
            norm(minus(e.direction(e.from()), expected)) < 1e-9
                && e.to()[0] <= kept_first.from()[0] + reach(options.follows) + MIN_LENGTH_MM
        })
        .unwrap_or(0);
    let path = path.get(begin..).unwrap_or_default();

    let mut pen = Pen::new(options)?;
    let Some(first) = path.first() else {
        return Err(Error::input("profile", "no elements", "one at least"));
    };
    pen.rapid(&[None, Some(options.start_z_mm)])?;
    pen.rapid(&[Some(first.from()[1]), None])?;
    pen.line([first.from()[0], first.from()[1]])?;
    let mut left_out = Vec::new();
    let mut index = 0;
    while let Some(element) = path.get(index) {
        if !falls(element, options.steepest_fall) {
            pen.element(element)?;
            index += 1;
            continue;
        }
        // Look for a floor with an access point.
        let from = element.from();
        let floor = path.iter().enumerate().skip(index).find_map(|(i, e)| {
            let inside =
                |z: &&f64| **z < e.from()[0] - MIN_LENGTH_MM && **z > e.to()[0] + MIN_LENGTH_MM;
            let line = matches!(e, Element::Line { .. }) && !falls(e, options.steepest_fall);
            Some((i, *options.access_z_mm.iter().find(|z| line && inside(z))?))
        });
        let Some((floor, z)) = floor else {
            return Err(Error::input(
                format!("contour at Z {:.3} X {:.3}", from[0], 2.0 * from[1]),
                "a fall that the tool cannot follow",
                "a z of access to the floor behind it",
            ));
        };
        let Some((e, x)) = path.get(floor).and_then(|e| Some((e, e.x_at(z)?))) else { break };
        pen.rapid(&[Some(options.retract_x_mm), None])?;
        pen.rapid(&[None, Some(z)])?;
        pen.rapid(&[Some(x + options.approach_mm), None])?;
        pen.line([z, x])?;
        left_out.push((from[0], z));
        pen.element(&e.between([z, x], e.to()))?;
        index = floor + 1;
    }
    pen.rapid(&[Some(options.retract_x_mm), None])?;
    for words in &options.tail {
        pen.writer.words(words)?;
    }
    Ok(Finishing { program: pen.writer.program, left_out })
}

fn reach(follows: Follows) -> f64 {
    match follows {
        Follows::Contour => 0.0,
        Follows::NoseCentre(radius) | Follows::Tip(radius) => radius,
    }
}

/// Does the element fall towards the chuck more steeply than the tool can follow?
fn falls(element: &Element, steepest: f64) -> bool {
    [element.from(), element.to()].iter().any(|&at| {
        let [dz, dx] = element.direction(at);
        dx < 0.0 && -dx > steepest * -dz + 1e-9
    })
}

/// Writes moves, leaving out what does not change.
struct Pen<'a> {
    writer: Writer,
    options: &'a FinishOptions,
    motion: Option<f64>,
    at: [Option<crate::nc::Number>; 2],
    feed: Option<f64>,
}

impl<'a> Pen<'a> {
    fn new(options: &'a FinishOptions) -> Result<Self> {
        let mut writer = Writer::numbered(options.dialect, options.first_number);
        for words in &options.head {
            writer.words(words)?;
        }
        Ok(Self { writer, options, motion: None, at: [None; 2], feed: options.feed })
    }

    fn rapid(&mut self, [x, z]: &[Option<f64>; 2]) -> Result<()> {
        self.block(0.0, *x, *z, None)
    }

    fn line(&mut self, to: Point) -> Result<()> {
        self.block(1.0, Some(to[1]), Some(to[0]), None)
    }

    fn element(&mut self, element: &Element) -> Result<()> {
        let to = element.to();
        match element {
            Element::Line { .. } => self.line(to),
            Element::Arc { convex, .. } => {
                let code = if *convex { 3.0 } else { 2.0 };
                self.block(code, Some(to[1]), Some(to[0]), element.radius())
            }
        }
    }

    fn block(
        &mut self,
        code: f64,
        x: Option<f64>,
        z: Option<f64>,
        radius: Option<f64>,
    ) -> Result<()> {
        let dialect = self.options.dialect;
        let mut words = Vec::with_capacity(5);
        if self.motion.is_none_or(|motion| motion.to_bits() != code.to_bits()) {
            words.push(dialect.word('G', code)?);
        }
        let targets = [x.map(|x| 2.0 * x), z];
        let mut moved = false;
        for (axis, (letter, target)) in ['X', 'Z'].into_iter().zip(targets).enumerate() {
            let Some(number) = target.map(|t| dialect.length(t)).transpose()? else { continue };
            if self.at[axis] != Some(number) {
                words.push(Word::new(letter, number));
                self.at[axis] = Some(number);
                moved = true;
            }
        }
        if !moved {
            return Ok(());
        }
        self.motion = Some(code);
        if let Some(radius) = radius {
            words.push(Word::new('R', dialect.length(radius)?));
        }
        if code > 0.0
            && let Some(feed) = self.feed.take()
        {
            words.push(dialect.word('F', feed)?);
        }
        self.writer.block(words)
    }
}
