//! The path of the measuring probe along the part (section 2.3) and its program.
//!
//! The ball's centre runs on the contour's offset by s = R_p + T, ball radius plus the allowance
//! that is still on the part. Only lines are measured. A line is measured between its change points
//! (Fig. 5), if its slope allows, as far as earlier and later corners leave room (Fig. 6); then the
//! whole program is checked against the solid part, move by move, and an interval that would gouge
//! is shortened or dropped, with the reason.

use super::clearance::{Chuck, Clearance, Probe, Solid};
use super::geometry::{
    Element, Gap, Point, Turn, along, meet, minus, norm, offset, right_of, turn,
};
use super::profile::Profile;
use crate::units::UM;
use crate::{Error, Result};

/// How the path is laid out. What the paper does not determine is here.
#[derive(Clone, Debug, PartialEq)]
pub struct PathOptions {
    /// The probe.
    pub probe: Probe,
    /// Allowance T on the part while it is measured, mm, normal to the contour.
    pub allowance_mm: f64,
    /// Numbers of lines (elements of the profile) that are not to be measured.
    pub skip: Vec<usize>,
    /// Radius to which the probe is drawn back between intervals, mm.
    pub retract_x_mm: f64,
    /// Height above the touching position, mm (radius), from which it goes down at feed.
    pub approach_mm: f64,
    /// The chuck to keep clear of.
    pub chuck: Chuck,
    /// Shortest interval worth measuring, mm.
    pub shortest_mm: f64,
}

/// An interval that is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Number of the line in the profile.
    pub element: usize,
    /// Ball centre at the start, `[z, x]`.
    pub start: Point,
    /// Ball centre at the end.
    pub end: Point,
    /// Slope dx/dz of the line.
    pub slope: f64,
}

impl Interval {
    /// z of the point of contact for the ball's centre at `z` (section 2.3(5)):
    /// Z1 = Z0 + R_p sin(arctan a).
    #[must_use]
    pub fn contact_z(&self, z: f64, ball_radius_mm: f64) -> f64 {
        z + contact_shift(self.slope, ball_radius_mm)
    }
}

/// R sin(arctan a): how far along Z the point of contact on a cone of slope a = dx/dz lies from the
/// centre of a ball or nose of radius R, mm.
#[must_use]
pub fn contact_shift(slope: f64, radius_mm: f64) -> f64 {
    radius_mm * slope / slope.hypot(1.0)
}

/// A move of the ball's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeMove {
    /// Where from.
    pub from: Point,
    /// Where to.
    pub to: Point,
    /// At feed; else a rapid.
    pub feed: bool,
    /// The ball runs along the surface and is read.
    pub measures: bool,
    /// Least distances to the part with its allowance, mm (touching is 0 while it measures).
    pub clearance: Clearance,
}

/// The path and what was left out.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbePath {
    /// Intervals in the order of measurement.
    pub intervals: Vec<Interval>,
    /// Every move from the first place above the part on.
    pub moves: Vec<ProbeMove>,
    /// Lines that are not measured, or not all of them, and why.
    pub left_out: Vec<(usize, String)>,
}

/// A touch this deep is rounding, mm.
const TOUCHING_MM: f64 = 1e-6;

/// Lays out the path.
///
/// # Errors
/// [`Error::Input`] for a probe that cannot be, an allowance that closes a groove, or a retract
/// height at which the probe does not clear the part.
pub fn probe_path(profile: &Profile, options: &PathOptions) -> Result<ProbePath> {
    options.probe.check()?;
    for (what, value, least) in [
        ("allowance, mm", options.allowance_mm, 0.0),
        ("approach, mm", options.approach_mm, 0.0),
        ("chuck radius, mm", options.chuck.radius_mm, 0.0),
        ("face of the chuck, mm", options.chuck.face_mm.abs(), 0.0),
        ("shortest interval, mm", options.shortest_mm, 0.0),
    ] {
        if !(value.is_finite() && value >= least) {
            return Err(Error::input(what, value, "finite and not negative"));
        }
    }
    let stock = if options.allowance_mm > 0.0 {
        Profile::of_elements(
            offset(profile.elements(), options.allowance_mm, Gap::Roll)?,
            Vec::new(),
        )?
    } else {
        profile.clone()
    };
    let solid = Solid::new(&stock, &options.chuck);
    let highest = solid.top() + options.probe.ball_radius_mm + options.approach_mm;
    if options.retract_x_mm.is_nan() || options.retract_x_mm <= highest {
        return Err(Error::input(
            "retract radius, mm",
            options.retract_x_mm,
            format!("more than {highest:.3}: largest radius, ball and approach"),
        ));
    }
    let mut path = ProbePath { intervals: Vec::new(), moves: Vec::new(), left_out: Vec::new() };
    let corners = corners(profile.elements(), options.probe.ball_radius_mm + options.allowance_mm);
    for (index, element) in profile.elements().iter().enumerate() {
        match interval(profile, &corners, index, element, options) {
            Ok(found) => match fitted(&solid, &found, options) {
                Ok(fits) => {
                    if norm(minus(fits.start, found.start)) + norm(minus(fits.end, found.end))
                        > TOUCHING_MM
                    {
                        path.left_out.push((index, format!(
                            "measured from Z {:.3} to {:.3} only: the part is in the probe's way",
                            fits.start[0], fits.end[0]
                        )));
                    }
                    path.intervals.push(fits);
                }
                Err(reason) => path.left_out.push((index, reason)),
            },
            Err(reason) => path.left_out.push((index, reason)),
        }
    }
    path.moves = lay_out(&solid, &path.intervals, options);
    if let Some(bad) = path
        .moves
        .iter()
        .find(|m| m.clearance.ball_mm < -TOUCHING_MM || m.clearance.body_mm < -TOUCHING_MM)
    {
        return Err(Error::Data(format!(
            "the probe gouges by {:.4} mm between Z {:.3} X {:.3} and Z {:.3} X {:.3}; expected free moves",
            -bad.clearance.ball_mm.min(bad.clearance.body_mm),
            bad.from[0],
            2.0 * bad.from[1],
            bad.to[0],
            2.0 * bad.to[1]
        )));
    }
    Ok(path)
}

/// A corner of the offset contour as the paper models it, all straight: Q, where the offset lines of
/// two elements meet. An arc that is tangent to both lines is skipped over.
struct Corner {
    /// Numbers of the elements before and behind.
    between: (usize, usize),
    q: Point,
}

fn corners(elements: &[Element], s: f64) -> Vec<Corner> {
    let tangents = |i: usize, j: usize| {
        let (before, behind) = (elements.get(i)?, elements.get(j)?);
        let (d0, d1) = (before.direction(before.to()), behind.direction(behind.from()));
        let p = along(before.to(), s, right_of(d0));
        let q = along(behind.from(), s, right_of(d1));
        Some(Corner { between: (i, j), q: meet(p, d0, q, d1)? })
    };
    let line = |i: usize| matches!(elements.get(i), Some(Element::Line { .. }));
    let mut found = Vec::with_capacity(elements.len());
    for index in 1..elements.len() {
        if line(index - 1) && line(index) {
            found.extend(tangents(index - 1, index));
        } else if line(index - 1) && line(index + 1) {
            found.extend(tangents(index - 1, index + 1));
        } else if !line(index - 1) && !line(index) {
            found.extend(tangents(index - 1, index));
        }
    }
    found
}

/// Fig. 5: where the interval of element `index` ends at the corner to its neighbour. Around a convex
/// corner and at the tangent point of an arc it is the foot of the normal; in a concave corner, and
/// where a concave arc is smaller than the ball, the ball stops where the offset lines meet.
fn change_point(
    elements: &[Element],
    corners: &[Corner],
    index: usize,
    neighbour: Option<usize>,
    foot: Point,
    s: f64,
) -> f64 {
    let Some((number, other)) = neighbour.and_then(|n| Some((n, elements.get(n)?))) else {
        return foot[0];
    };
    let Some(element) = elements.get(index) else { return foot[0] };
    let kind = if number < index { turn(other, element) } else { turn(element, other) };
    let stops = match (kind, other) {
        (Turn::Concave, _) => true,
        (Turn::Smooth, Element::Arc { convex: false, .. }) => other.radius().is_some_and(|r| r < s),
        _ => false,
    };
    let q = corners
        .iter()
        .find(|c| if number < index { c.between.1 == index } else { c.between.0 == index });
    match q {
        Some(corner) if stops => corner.q[0],
        _ => foot[0],
    }
}

/// The measurable interval of one line by the paper's rules, or why there is none.
fn interval(
    profile: &Profile,
    corners: &[Corner],
    index: usize,
    element: &Element,
    options: &PathOptions,
) -> std::result::Result<Interval, String> {
    if options.skip.contains(&index) {
        return Err("not expected".into());
    }
    let Element::Line { .. } = element else { return Err("an arc: not measured".into()) };
    let Some(slope) = element.slope() else { return Err("a wall: not measured".into()) };
    let steepest = options.probe.steepest();
    if slope.abs() >= steepest {
        return Err(format!("slope {:.3}: the probe reaches below {steepest:.3}", slope.abs()));
    }
    let s = options.probe.ball_radius_mm + options.allowance_mm;
    let half_body = 0.5 * options.probe.body_diameter_mm;
    let Some(Element::Line { from, to }) = element.offset(s) else {
        return Err("no offset".into());
    };
    // Where a line of the cone's slope through Q meets the travel of the ball's centre.
    let shadow =
        |q: Point, flank: f64| (q[1] - flank * q[0] - from[1] + slope * from[0]) / (slope - flank);
    let elements = profile.elements();
    let before = index.checked_sub(1);
    let first = change_point(elements, corners, index, before, from, s);
    let earlier = corners
        .iter()
        .filter(|c| c.between.1 < index)
        .fold(f64::INFINITY, |least, c| least.min(shadow(c.q, steepest)));
    let last = change_point(elements, corners, index, Some(index + 1), to, s);
    let later = corners
        .iter()
        .filter(|c| c.between.0 > index)
        .fold(f64::NEG_INFINITY, |most, c| most.max(shadow(c.q, -steepest)));
    // Reliefs are cut later; the ball keeps off them.
    let relief = |at: Point| {
        let near = profile.reliefs().iter().filter(|(p, _)| norm(minus(*p, at)) < TOUCHING_MM);
        near.fold(0.0, |most: f64, (_, width)| most.max(*width))
    };
    let mut start = first.min(earlier).max(first - half_body);
    let mut end = last.max(later).min(last + half_body);
    if relief(element.from()) > 0.0 {
        start = start.min(from[0] - relief(element.from()));
    }
    if relief(element.to()) > 0.0 {
        end = end.max(to[0] + relief(element.to()));
    }
    if start - end < options.shortest_mm {
        return Err(format!("only {:.3} mm would be free", (start - end).max(0.0)));
    }
    let place = |z: f64| [z, from[1] + slope * (z - from[0])];
    Ok(Interval { element: index, start: place(start), end: place(end), slope })
}

/// The longest part of an interval, from its middle, on which the probe clears the solid part.
fn fitted(
    solid: &Solid,
    interval: &Interval,
    options: &PathOptions,
) -> std::result::Result<Interval, String> {
    let free = |a: Point, b: Point| {
        let seen = solid.clearance(&options.probe, a, b);
        seen.ball_mm >= -TOUCHING_MM && seen.body_mm >= -TOUCHING_MM
    };
    if free(interval.start, interval.end) {
        return Ok(*interval);
    }
    let run = minus(interval.end, interval.start);
    let place = |share: f64| along(interval.start, share, run);
    let seeds = [0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875];
    let Some(seed) = seeds.into_iter().find(|&share| free(place(share), place(share))) else {
        return Err("the part is in the probe's way".into());
    };
    let reach = |limit: f64| {
        let (mut good, mut bad) = (seed, limit);
        if free(place(seed), place(limit)) {
            return limit;
        }
        for _ in 0..40 {
            let middle = 0.5 * (good + bad);
            if free(place(seed), place(middle)) { good = middle } else { bad = middle }
        }
        good
    };
    let (start, end) = (place(reach(0.0)), place(reach(1.0)));
    if start[0] - end[0] < options.shortest_mm {
        return Err("the part is in the probe's way".into());
    }
    Ok(Interval { start, end, ..*interval })
}

/// Retract, cross, approach, measure.
fn lay_out(solid: &Solid, intervals: &[Interval], options: &PathOptions) -> Vec<ProbeMove> {
    let mut moves: Vec<ProbeMove> = Vec::new();
    let mut at: Option<Point> = None;
    let push = |moves: &mut Vec<ProbeMove>, from: Point, to: Point, feed: bool, measures: bool| {
        let clearance = solid.clearance(&options.probe, from, to);
        moves.push(ProbeMove { from, to, feed, measures, clearance });
    };
    for interval in intervals {
        let follows = at.is_some_and(|at| norm(minus(at, interval.start)) < 0.5 * UM);
        if !follows {
            let above = [interval.start[0], interval.start[1] + options.approach_mm];
            if let Some(at) = at {
                let up = [at[0], options.retract_x_mm];
                let over = [interval.start[0], options.retract_x_mm];
                push(&mut moves, at, up, false, false);
                push(&mut moves, up, over, false, false);
                push(&mut moves, over, above, false, false);
            } else {
                push(&mut moves, [above[0], options.retract_x_mm], above, false, false);
            }
            push(&mut moves, above, interval.start, true, false);
        }
        push(&mut moves, interval.start, interval.end, true, true);
        at = Some(interval.end);
    }
    moves
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nc::Dialect;
    use crate::turning::probe_program::ProgramOptions;
    use crate::turning::profile::{Corner as Kind, Vertex};

    /// The part of Fig. 9, read back from Figs. 12 and 14; the flange's radius is not determined.
    fn part() -> Profile {
        let sharp = |z, x| Vertex { at: [z, x], corner: Kind::Sharp };
        let fillet = |z, x| Vertex { at: [z, x], corner: Kind::Fillet(5.0) };
        Profile::from_vertices(&[
            sharp(235.0, 10.0),
            sharp(230.0, 15.0),
            sharp(190.0, 15.0),
            sharp(155.0, 25.0),
            sharp(155.0, 30.0),
            sharp(150.0, 35.0),
            fillet(125.0, 35.0),
            sharp(125.0, 20.0),
            sharp(65.0, 20.0),
            fillet(65.0, 35.0),
            sharp(35.0, 35.0),
            sharp(35.0, 42.0),
            sharp(0.0, 42.0),
        ])
        .unwrap()
    }

    fn options(angle_deg: f64) -> PathOptions {
        PathOptions {
            probe: Probe {
                ball_radius_mm: 5.0,
                contact_angle: angle_deg * crate::units::DEG,
                body_diameter_mm: 12.0,
            },
            allowance_mm: 0.5,
            skip: vec![13],
            retract_x_mm: 50.0,
            approach_mm: 1.0,
            chuck: Chuck::default(),
            shortest_mm: 1.0,
        }
    }

    #[test]
    fn fig_12_comes_out_between_95_and_125_degrees() {
        let golden = include_str!("../../../../tests/data/turning/fig12.nc");
        for angle in [95.0, 110.0, 124.9] {
            let path = probe_path(&part(), &options(angle)).unwrap();
            let program = path
                .program(&ProgramOptions {
                    comments: Vec::new(),
                    dialect: Dialect::PaperUm,
                    feed: None,
                    first_number: Some(3),
                    head: Vec::new(),
                    tail: vec![vec![('T', 40.0)]],
                    retract_last: false,
                })
                .unwrap();
            assert_eq!(program.emit(), golden, "{angle}");
        }
        for angle in [94.8, 125.2] {
            let path = probe_path(&part(), &options(angle)).unwrap();
            assert!(
                path.intervals.iter().any(|i| (i.end[0] - 166.5).abs() > 1e-3 && i.element == 2
                    || i.element == 1 && (i.end[0] - 190.770).abs() > 1e-3),
                "{angle}"
            );
        }
    }

    #[test]
    fn the_contact_on_a_cone_is_where_section_2_3_5_says() {
        assert!((contact_shift(-10.0 / 35.0, 5.0) + 1.3736).abs() < 1e-4);
    }
}
