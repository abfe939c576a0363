//! Where a ball on a line touches boxes, spheres and rings.

use nalgebra::Vector3;

use super::spheres::MAX_SPHERES;

/// Which dimension lies along which direction of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bar {
    AlongX,
    AlongY,
}

/// A box with its base on z = 0, turned about Z.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    half: Vector3<f64>,
    bar: Bar,
    sin: f64,
    cos: f64,
}

/// A solid that a ball can touch.
#[derive(Clone, Copy, Debug)]
pub enum Solid {
    /// The union of one or two boxes.
    Blocks([Option<Block>; 2]),
    /// A sphere.
    Sphere {
        /// Radius in mm.
        radius: f64,
        /// Centre in mm.
        centre: Vector3<f64>,
    },
    /// The union of spheres.
    Spheres {
        /// Radius of each in mm.
        radius: f64,
        /// Centres in mm.
        centres: [Vector3<f64>; MAX_SPHERES],
        /// How many there are.
        count: usize,
        /// By how much of itself a centre moves for one mm of spacing.
        per_span: f64,
    },
    /// What is between two cylinders about Z and between two planes; touched from within and from
    /// above, its rims and its outside not at all.
    Ring {
        /// Radius of the bore in mm.
        bore: f64,
        /// Radius of the outside in mm.
        outer: f64,
        /// Height over z = 0 in mm.
        height: f64,
    },
}

/// A straight travel of the ball's centre, in the artefact's frame: origin + travel · direction.
/// The direction need not have length one.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Where the travel is zero, mm.
    pub origin: Vector3<f64>,
    /// Movement of the ball's centre for one mm of travel.
    pub direction: Vector3<f64>,
}

impl Line {
    fn at(&self, travel: f64) -> Vector3<f64> {
        self.origin + self.direction * travel
    }
}

/// First contact of a ball with a solid.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Travel along the line in mm.
    pub travel: f64,
    /// Unit vector from the point of contact to the ball's centre, artefact frame.
    pub normal: Vector3<f64>,
    /// Change of the distance from ball centre to surface for one mm (rad) of error of length,
    /// width, height, squareness.
    pub shape_rates: [f64; 4],
}

/// Which contact of a line with a solid is meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Search {
    /// The first one ahead of travel zero: a move that starts there.
    Ahead,
    /// The one nearest to travel zero: a touch that was recorded there.
    Nearest,
}

impl Block {
    pub(super) fn new(x: f64, y: f64, z: f64, bar: Bar, turn: f64) -> Self {
        let (sin, cos) = turn.sin_cos();
        Self { half: Vector3::new(0.5 * x, 0.5 * y, 0.5 * z), bar, sin, cos }
    }

    /// Into the block's own frame, whose origin is the block's middle.
    fn local(&self, v: &Vector3<f64>, shift: f64) -> Vector3<f64> {
        Vector3::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x, v.z - shift)
    }

    fn line(&self, line: &Line) -> Line {
        Line {
            origin: self.local(&line.origin, self.half.z),
            direction: self.local(&line.direction, 0.0),
        }
    }

    /// From the nearest point of the block to `point` (both in the block's frame).
    fn away(&self, point: &Vector3<f64>) -> Vector3<f64> {
        point - Vector3::from_fn(|i, _| point[i].clamp(-self.half[i], self.half[i]))
    }

    /// Where the ball first touches the block, on the whole line.
    ///
    /// The ball enters the block grown by its radius through one of that box's faces: where it does
    /// so over the block's own face, that is the contact. Else it is on an edge or a corner:
    /// the distance to a convex body is convex along a line, so Newton's method from a point ahead
    /// of the contact comes to it from one side.
    fn entry(&self, line: &Line, radius: f64) -> Option<Entry> {
        let Line { origin, direction } = *line;
        let mut travel = f64::NEG_INFINITY;
        let mut leave = f64::INFINITY;
        let mut side = 0;
        for i in 0..3 {
            let reach = self.half[i] + radius;
            if direction[i] == 0.0 {
                if origin[i].abs() >= reach {
                    return None;
                }
                continue;
            }
            let per_mm = 1.0 / direction[i];
            let (middle, half) = (-origin[i] * per_mm, reach * per_mm.abs());
            if middle - half > travel {
                (travel, side) = (middle - half, i);
            }
            leave = leave.min(middle + half);
        }
        if travel >= leave {
            return None;
        }
        let point = line.at(travel);
        if (0..3).all(|i| i == side || point[i].abs() <= self.half[i]) {
            let mut normal = Vector3::zeros();
            normal[side] = -1.0_f64.copysign(direction[side]);
            return Some(Entry { travel, normal });
        }
        for _ in 0..MAX_STEPS {
            let away = self.away(&line.at(travel));
            let distance = away.norm();
            let normal = away / distance;
            if distance <= radius {
                return Some(Entry { travel, normal });
            }
            let approach = -normal.dot(&direction);
            if approach <= 0.0 {
                return None;
            }
            let step = (distance - radius) / approach;
            travel += step;
            if step <= TOLERANCE_MM {
                return Some(Entry { travel, normal });
            }
        }
        None
    }

    /// Travel at which the ball leaves the block.
    fn exit(&self, line: &Line, radius: f64) -> Option<f64> {
        let back = Line { origin: line.origin, direction: -line.direction };
        self.entry(&back, radius).map(|entry| -entry.travel)
    }

    fn contact(&self, line: &Line, entry: &Entry) -> Contact {
        let normal = entry.normal;
        // Every face moves outward by half of the dimension's growth, except that the base stays.
        let along_x = -0.5 * normal.x.abs();
        let along_y = -0.5 * normal.y.abs();
        let height = -normal.z.max(0.0);
        let (length, width, turn) = match self.bar {
            Bar::AlongX => (along_x, along_y, 0.0),
            Bar::AlongY => {
                let point = line.at(entry.travel);
                (along_y, along_x, normal.x * point.y - normal.y * point.x)
            }
        };
        let normal = Vector3::new(
            self.cos * normal.x - self.sin * normal.y,
            self.sin * normal.x + self.cos * normal.y,
            normal.z,
        );
        Contact { travel: entry.travel, normal, shape_rates: [length, width, height, turn] }
    }
}

/// Where a ball meets a block: travel along the line, unit normal in the block's frame.
#[derive(Clone, Copy, Debug)]
struct Entry {
    travel: f64,
    normal: Vector3<f64>,
}

/// Newton's steps below this length end it: beyond it lies rounding only.
const TOLERANCE_MM: f64 = 1e-13;

const MAX_STEPS: usize = 100;

impl Solid {
    /// First contact of a ball of this radius that moves along the line; `None` where it passes by,
    /// or, with [`Search::Ahead`], where the move would start inside.
    #[must_use]
    pub fn first_contact(&self, line: &Line, radius: f64, search: Search) -> Option<Contact> {
        match self {
            Self::Sphere { radius: sphere, centre } => {
                sphere_contact(line, centre, sphere + radius, search)
            }
            Self::Spheres { radius: sphere, centres, count, per_span } => {
                let reach = sphere + radius;
                let hits = centres[..*count].iter().filter_map(|centre| {
                    let mut hit = sphere_contact(line, centre, reach, search)?;
                    hit.shape_rates[1] = -hit.normal.dot(centre) * per_span;
                    Some(hit)
                });
                meant(hits, search)
            }
            Self::Ring { bore, outer, height } => {
                let wall = wall_contact(line, bore - radius, *height);
                let top = top_contact(line, radius, [*bore, *outer, *height]);
                let ahead = |hit: &Contact| search == Search::Nearest || hit.travel >= 0.0;
                meant([wall, top].into_iter().flatten().filter(ahead), search)
            }
            Self::Blocks(blocks) => blocks_contact(blocks, line, radius, search),
        }
    }
}

/// The first of the contacts, or the nearest one.
fn meant(contacts: impl Iterator<Item = Contact>, search: Search) -> Option<Contact> {
    let far = |hit: &Contact| match search {
        Search::Ahead => hit.travel,
        Search::Nearest => hit.travel.abs(),
    };
    contacts.min_by(|a, b| far(a).total_cmp(&far(b)))
}

/// Where a ball meets the wall of a bore from within, its centre within the bore's height; `reach`:
/// distance of the centre from the axis then.
fn wall_contact(line: &Line, reach: f64, height: f64) -> Option<Contact> {
    let Line { origin, direction } = *line;
    let speed = direction.xy().norm_squared();
    if speed == 0.0 || reach <= 0.0 {
        return None;
    }
    let closest = -origin.xy().dot(&direction.xy()) / speed;
    let miss = origin.xy() + direction.xy() * closest;
    let half_chord = reach * reach - miss.norm_squared();
    if half_chord <= 0.0 {
        return None;
    }
    let travel = closest + (half_chord / speed).sqrt();
    let centre = line.at(travel);
    let normal = -Vector3::new(centre.x, centre.y, 0.0).normalize();
    let is_within = (0.0..=height).contains(&centre.z);
    is_within.then_some(Contact { travel, normal, shape_rates: [0.5, 0.0, 0.0, 0.0] })
}

/// Where a ball that comes down meets the top of a ring: radii of bore and outside, height.
fn top_contact(line: &Line, radius: f64, [bore, outer, height]: [f64; 3]) -> Option<Contact> {
    if line.direction.z >= 0.0 {
        return None;
    }
    let travel = (height + radius - line.origin.z) / line.direction.z;
    let out = line.at(travel).xy().norm();
    let shape_rates = [0.0, 0.0, -1.0, 0.0];
    (bore..=outer).contains(&out).then_some(Contact { travel, normal: Vector3::z(), shape_rates })
}

fn sphere_contact(
    line: &Line,
    centre: &Vector3<f64>,
    reach: f64,
    search: Search,
) -> Option<Contact> {
    let Line { origin, direction } = *line;
    let from_centre = origin - centre;
    let speed = direction.norm_squared();
    let closest = -from_centre.dot(&direction) / speed;
    // Distance of the line from the centre, from the foot point: no cancellation.
    let miss = from_centre + direction * closest;
    let half_chord = reach * reach - miss.norm_squared();
    if half_chord <= 0.0 {
        return None;
    }
    let travel = closest - (half_chord / speed).sqrt();
    if search == Search::Ahead && travel < 0.0 {
        return None;
    }
    let normal = (line.at(travel) - centre).normalize();
    Some(Contact { travel, normal, shape_rates: [-0.5, 0.0, 0.0, 0.0] })
}

fn blocks_contact(
    blocks: &[Option<Block>; 2],
    line: &Line,
    radius: f64,
    search: Search,
) -> Option<Contact> {
    let mut hits: [Option<(Entry, &Block, Line)>; 2] = [None, None];
    for (hit, block) in hits.iter_mut().zip(blocks) {
        *hit = block.as_ref().and_then(|block| {
            let local = block.line(line);
            block.entry(&local, radius).map(|entry| (entry, block, local))
        });
    }
    let (first, second) = match hits {
        [Some(a), Some(b)] if b.0.travel < a.0.travel => (b, Some(a)),
        [Some(a), b] => (a, b),
        [None, Some(b)] => (b, None),
        [None, None] => return None,
    };
    let later = second.filter(|second| {
        let (before, after) = (first.0.travel, second.0.travel);
        let meant = match search {
            Search::Ahead => before < 0.0 && after >= 0.0,
            Search::Nearest => after.abs() < before.abs(),
        };
        // Where the ball enters the second block while still in the first, that is no contact.
        meant && first.1.exit(&first.2, radius).is_some_and(|exit| after > exit)
    });
    let (entry, block, local) = later.unwrap_or(first);
    if search == Search::Ahead && entry.travel < 0.0 {
        return None;
    }
    Some(block.contact(&local, &entry))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artefact::Artefact;
    use crate::machine::Places;

    fn cross() -> Solid {
        Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap().solid(&Places::default())
    }

    fn touch(solid: &Solid, origin: [f64; 3], direction: [f64; 3]) -> Option<Contact> {
        let line = Line { origin: origin.into(), direction: direction.into() };
        solid.first_contact(&line, 1.0, Search::Ahead)
    }

    #[test]
    fn faces_edges_and_corners_of_the_cross() {
        let solid = cross();
        let top = touch(&solid, [37.5, 0.0, 40.0], [0.0, 0.0, -1.0]).unwrap();
        assert_eq!(top.travel, 14.0);
        assert_eq!(top.normal, Vector3::z());
        // Half a radius beside the top edge: the ball sinks by 1 − √(1 − 1/4).
        let edge = touch(&solid, [37.5, 13.0, 40.0], [0.0, 0.0, -1.0]).unwrap();
        assert!((edge.travel - (15.0 - 0.75_f64.sqrt())).abs() < 1e-12);
        // Over the corner (50, 12.5, 25), 0.6 out along both.
        let corner = touch(&solid, [50.6, 13.1, 40.0], [0.0, 0.0, -1.0]).unwrap();
        assert!((corner.travel - (15.0 - (1.0_f64 - 0.72).sqrt())).abs() < 1e-12);
        // Into the inner corner along the diagonal: both bars at once.
        let d = std::f64::consts::FRAC_1_SQRT_2;
        let inner = touch(&solid, [30.0, 30.0, 10.0], [-d, -d, 0.0]).unwrap();
        assert!((inner.travel - 16.5 / d).abs() < 1e-12);
        assert!(touch(&solid, [37.5, 13.6, 40.0], [0.0, 0.0, -1.0]).is_none());
        assert!(touch(&solid, [37.5, 0.0, 10.0], [0.0, 0.0, -1.0]).is_none());
    }

    #[test]
    fn the_first_of_two_arms_stops_the_ball() {
        let solid = cross();
        // Along −X at y = 30: the +Y arm's +X side at x = 12.5.
        let side = touch(&solid, [60.0, 30.0, 12.5], [-1.0, 0.0, 0.0]).unwrap();
        assert_eq!(side.travel, 60.0 - 13.5);
        // Along −X at y = 0: the end of the X bar, although the Y bar lies on the line as well.
        let end = touch(&solid, [60.0, 0.0, 12.5], [-1.0, 0.0, 0.0]).unwrap();
        assert_eq!(end.travel, 60.0 - 51.0);
    }
}
