//! Which touches, in which order, on which approach.
//!
//! - [`targets`]: the places on the artefact that are worth a touch, with the paper's labels;
//! - [`collision`]: whether ball and stem get there and back without touching anything else;
//! - `approach`: one touch after the other with the artefact anywhere within its tolerance;
//! - `senses`: from which sense the axes come;
//! - here: positions of the axes and feeds; commands rounded to the resolution of the axes.
//!
//! Between touches the probe retracts to the start of its approach, moves along the stem to a
//! level above everything at this position of the axes, across, and down to the next start.

mod approach;
pub mod collision;
mod senses;

use nalgebra::Vector3;

use crate::artefact::{Artefact, Fixture, Layout, Target, View};
use crate::machine::{MAX_ROTARY, Machine, Places, Posture, Side};
use crate::pose::Pose;
use crate::{Error, Result};

use approach::{Approach, Approaches};
use collision::{RotaryOffset, Stylus, Surroundings};
use senses::Senses;

pub use approach::blocked;

/// How a plan is made; mm, rad, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanOptions {
    /// Distance of the start of an approach from the nominal contact.
    pub clearance: f64,
    /// How far the commanded end lies beyond it.
    pub overtravel: f64,
    /// Resolution of linear commands; 0: exact.
    pub linear_resolution: f64,
    /// Resolution of rotary commands; 0: exact.
    pub rotary_resolution: f64,
    /// Ball and stem.
    pub stylus: Stylus,
    /// Where the touches 17 and 20 of the tilted cross lie.
    pub layout: Layout,
    /// At ±90° touch every reachable face, not only the paper's four (Fig. 4).
    pub all_faces: bool,
}

impl PlanOptions {
    /// How far the ball's centre stays over everything it crosses.
    const fn above(&self) -> f64 {
        self.stylus.ball_radius + self.clearance
    }
}

/// What is to be measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanRequest {
    /// Positions of the axis under the artefact (C) with the top of the table towards the spindle
    /// (the tilting axis at zero, or at [`Machine::level`]), rad.
    pub turning: Vec<f64>,
    /// Positions of the tilting axis (A or B) with the other one at zero, rad.
    pub tilting: Vec<f64>,
    /// Pairs (tilting, turning) beyond these two cycles, rad.
    pub pairs: Vec<(f64, f64)>,
    /// Feeds of the approaches, mm/s; with several, every touch is made at each.
    pub feeds: Vec<f64>,
    /// Every position from both senses of turning.
    pub both_senses: bool,
    /// How often all of it is done.
    pub repeats: usize,
}

/// One planned touch.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedTouch {
    /// Commanded positions of the rotary axes, rad.
    pub rotary: [f64; MAX_ROTARY],
    /// Sense of the last turn of each axis before the touch; 0: not turned.
    pub sense: [f64; MAX_ROTARY],
    /// The paper's cycle, 1 to 3 (4: further pairs of angles).
    pub cycle: i64,
    /// The paper's label of the touch, 1 to 20.
    pub label: i64,
    /// Commanded start of the approach, ball centre, machine frame.
    pub start: Vector3<f64>,
    /// Nominal ball centre at contact, machine frame.
    pub contact: Vector3<f64>,
    /// Unit approach direction of the rounded commands.
    pub direction: Vector3<f64>,
    /// Feed of the approach, mm/s.
    pub feed: f64,
}

/// Machine and artefact as they are known to stand before anything is measured.
pub struct Arrangement {
    /// Chain of axes.
    pub machine: Machine,
    /// What is touched.
    pub artefact: Artefact,
    places: Places,
    around: Surroundings,
    /// How far the control may have the table turned.
    pub offset: RotaryOffset,
}

impl Arrangement {
    /// A machine with known errors at `places` (those of its nominal geometry among them) and an
    /// artefact on its table, a disc of this radius and thickness. The control may have each rotary
    /// axis under the table `offset` from where it is commanded, rad.
    ///
    /// # Errors
    /// A table without radius or thickness, a stem, a tolerance or an offset below zero.
    pub fn new(
        machine: Machine,
        places: &Places,
        artefact: Artefact,
        fixture: &Fixture,
        table: [f64; 2],
        offset: f64,
    ) -> Result<Self> {
        let (under, seat) = offsets_under(&machine, places);
        let reach = under.iter().map(|place| place.norm()).sum::<f64>() + seat;
        let tilting = under.len() - usize::from(turns_table(&machine));
        let offset = RotaryOffset {
            angle: offset * under.len() as f64,
            lean: offset * tilting as f64,
            reach,
        };
        let around = Surroundings::new(&artefact, fixture, table, offset)?;
        let mut places = *places;
        fixture.add_to(&machine, &mut places);
        Ok(Self { machine, artefact, places, around, offset })
    }

    fn posture(&self, rotary: &[f64]) -> Posture {
        Posture::new(&self.machine, rotary, &self.places)
    }

    /// The top of the table, its normal along Z: the frame of what stands around.
    fn table(&self, posture: &Posture) -> Pose {
        let Pose { rotation, translation } = posture.table;
        Pose { rotation: rotation * self.machine.top_rotation(), translation }
    }

    /// Coordinate along the stem that is `above` mm over everything with the rotary axes at these
    /// positions, rad.
    #[must_use]
    pub fn safe_level(&self, rotary: &[f64], above: f64) -> f64 {
        let posture = self.posture(rotary);
        self.around.highest(&self.table(&posture), &(posture.head.rotation * Vector3::z())) + above
    }

    /// Coordinate along the stem that is `above` mm over everything whatever the rotary axes do.
    #[must_use]
    pub fn swing_level(&self, above: f64) -> f64 {
        let (offsets, seat) = offsets_under(&self.machine, &self.places);
        let fixed_head = self.machine.rotary().iter().all(|axis| axis.side == Side::Workpiece);
        let reach = offsets.iter().enumerate().map(|(number, offset)| {
            // The first axis stands still in the machine frame.
            if number == 0 && fixed_head { offset.z } else { offset.norm() }
        });
        self.around.farthest() + reach.sum::<f64>() + seat + above
    }

    /// Checks that approaches start outside of what the artefact's tolerance covers, and search
    /// beyond it.
    fn check(&self, options: &PlanOptions) -> Result<()> {
        let shift = self.around.growth();
        let would_do = format!(
            "more than {shift:.3}: within artefact.tolerance_mm, artefact.tolerance_deg and \
             control.rotary_offset_deg a face may stand off so far; raise it, or place the artefact \
             better and state smaller tolerances"
        );
        for (key, value) in
            [("plan.clearance_mm", options.clearance), ("plan.overtravel_mm", options.overtravel)]
        {
            if value.is_nan() || value <= shift + 2.0 * options.linear_resolution {
                return Err(Error::input(key, value, would_do));
            }
        }
        Ok(())
    }
}

/// Offsets of the axes under the table, each from the one before, and how far the table's top is
/// from the last, mm.
fn offsets_under(machine: &Machine, places: &Places) -> (Vec<Vector3<f64>>, f64) {
    let offsets = machine.rotary().iter().enumerate().filter_map(|(axis, rotary)| {
        let frame = places.frame(axis);
        (rotary.side == Side::Workpiece).then(|| Vector3::new(frame[0], frame[1], frame[2]))
    });
    (offsets.collect(), machine.seat().map_or(0.0, |seat| seat.norm()))
}

/// Whether the last axis under the table turns it about its own normal.
fn turns_table(machine: &Machine) -> bool {
    let last = machine.rotary().iter().rfind(|axis| axis.side == Side::Workpiece);
    last.is_some_and(|axis| {
        let normal = machine.top_rotation() * Vector3::z();
        axis.direction().normalize().dot(&normal).abs() > 1.0 - 1e-6
    })
}

struct Position {
    tilt: f64,
    turn: f64,
    cycle: i64,
}

/// The axes that a plan moves: the one under the artefact and the one that tilts.
struct PlanAxes {
    turning: Option<usize>,
    tilting: Option<usize>,
    level: f64,
}

impl PlanAxes {
    fn of(machine: &Machine) -> Self {
        let (turning, tilting) = (machine.turning_axis(), machine.tilting_axis());
        Self { turning, tilting, level: machine.level() }
    }

    /// Refuses angles of an axis that there is not.
    fn check(&self, request: &PlanRequest) -> Result<()> {
        let pairs = !request.pairs.is_empty();
        for (axis, angles, what) in [
            (self.tilting, &request.tilting, "tilting angles"),
            (self.turning, &request.turning, "turning angles"),
        ] {
            if axis.is_none() && (pairs || !angles.is_empty()) {
                return Err(Error::input(what, "some", "none: this machine has no such axis"));
            }
        }
        Ok(())
    }

    fn rotary(&self, position: &Position, resolution: f64) -> [f64; MAX_ROTARY] {
        let mut rotary = [0.0; MAX_ROTARY];
        if let Some(axis) = self.turning {
            rotary[axis] = round(position.turn, resolution);
        }
        if let Some(axis) = self.tilting {
            rotary[axis] = round(position.tilt, resolution);
        }
        rotary
    }
}

/// To a whole number of steps; 0: as it is.
#[must_use]
pub fn round(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// Makes a plan: only touches whose faces can be reached, each with a free way in and out.
///
/// # Errors
/// No angle or no feed given, a value that is not finite, a clearance or an overtravel within the
/// tolerance of the artefact's place, or no face that can be reached.
pub fn plan(
    arrangement: &Arrangement,
    request: &PlanRequest,
    options: &PlanOptions,
) -> Result<Vec<PlannedTouch>> {
    check(request, arrangement.machine.rotary().is_empty())?;
    arrangement.check(options)?;
    let axes = PlanAxes::of(&arrangement.machine);
    axes.check(request)?;
    let positions = positions(request, &axes);
    let approaches = Approaches::new(arrangement, options.stylus, options.above());
    let planner = Planner { arrangement, options, approaches };
    let mut reached: Vec<Vec<PlannedTouch>> = Vec::with_capacity(positions.len());
    for position in &positions {
        reached.push(planner.touches(position, axes.rotary(position, options.rotary_resolution)));
    }
    if reached.iter().all(Vec::is_empty) {
        let offset = arrangement.offset.angle > 0.0;
        return Err(Error::Data(format!(
            "no face of the artefact can be reached at any of these positions: check the \
             clearance, the stylus, the artefact's size and the tolerance of its place{}",
            if offset { ", and control.rotary_offset_deg" } else { "" }
        )));
    }
    let rounds = request.feeds.len().max(if request.both_senses { 2 } else { 1 });
    let mut senses = Senses::new();
    let mut touches = Vec::new();
    for round in 0..rounds * request.repeats {
        let upward = !request.both_senses || round % 2 == 0;
        let order: Vec<usize> = if upward {
            (0..positions.len()).collect()
        } else {
            (0..positions.len()).rev().collect()
        };
        for index in order {
            let Some(first) = reached[index].first() else { continue };
            let sense = sense_of_round(upward);
            senses.turn(&axes, &first.rotary, sense, request.both_senses);
            let feed = request.feeds[(round + index) % request.feeds.len()];
            for touch in &reached[index] {
                let mut touch = touch.clone();
                touch.sense = senses.last;
                touch.feed = feed;
                touches.push(touch);
            }
        }
    }
    Ok(touches)
}

const fn sense_of_round(upward: bool) -> f64 {
    if upward { 1.0 } else { -1.0 }
}

fn check(request: &PlanRequest, stands_still: bool) -> Result<()> {
    let angles = request.turning.iter().chain(&request.tilting);
    let angles = angles.chain(request.pairs.iter().flat_map(|(a, c)| [a, c]));
    for angle in angles {
        if !angle.is_finite() {
            return Err(Error::input("angle of a plan", angle, "a finite number"));
        }
    }
    let is_empty =
        request.turning.is_empty() && request.tilting.is_empty() && request.pairs.is_empty();
    if is_empty && !stands_still {
        return Err(Error::input("angles of a plan", "none", "at least one"));
    }
    if request.feeds.is_empty() {
        return Err(Error::input("feeds of a plan", "none", "at least one"));
    }
    if let Some(feed) = request.feeds.iter().find(|feed| !(feed.is_finite() && **feed > 0.0)) {
        return Err(Error::input("feed of a plan", feed, "a positive number"));
    }
    if request.repeats == 0 {
        return Err(Error::input("repeats of a plan", 0, "at least 1"));
    }
    Ok(())
}

fn positions(request: &PlanRequest, axes: &PlanAxes) -> Vec<Position> {
    let mut positions: Vec<Position> = Vec::new();
    if axes.turning.or(axes.tilting).is_none() {
        positions.push(Position { tilt: 0.0, turn: 0.0, cycle: 1 });
    }
    let turning = request.turning.iter().enumerate();
    positions.extend(turning.map(|(i, &turn)| Position {
        tilt: axes.level,
        turn,
        cycle: if i == 0 { 1 } else { 2 },
    }));
    let tilting = request.tilting.iter().map(|&tilt| Position { tilt, turn: 0.0, cycle: 3 });
    let pairs = request.pairs.iter().map(|&(tilt, turn)| Position { tilt, turn, cycle: 4 });
    for position in tilting.chain(pairs) {
        let twice = positions
            .iter()
            .any(|other| other.tilt == position.tilt && other.turn == position.turn);
        if !twice {
            positions.push(position);
        }
    }
    positions
}

struct Planner<'a> {
    arrangement: &'a Arrangement,
    options: &'a PlanOptions,
    approaches: Approaches<'a>,
}

impl Planner<'_> {
    /// Every touch that can be made at one position of the axes.
    fn touches(&self, position: &Position, rotary: [f64; MAX_ROTARY]) -> Vec<PlannedTouch> {
        let Arrangement { machine, artefact, .. } = self.arrangement;
        let posture = self.arrangement.posture(&rotary[..machine.rotary().len()]);
        let stem = posture.head.rotation * Vector3::z();
        let PlanOptions { layout, all_faces, .. } = *self.options;
        let view = View { artefact: &posture.artefact, stem: &stem, layout, all_faces };
        let touches = artefact.targets(&view).into_iter().filter_map(|target| {
            let mut touch = self.touch(&posture, &stem, &target)?;
            touch.rotary = rotary;
            touch.cycle = position.cycle;
            Some(touch)
        });
        touches.collect()
    }

    /// The touch of one target, if the probe can get there and back.
    fn touch(
        &self,
        posture: &Posture,
        stem: &Vector3<f64>,
        target: &Target,
    ) -> Option<PlannedTouch> {
        let options = self.options;
        let normal = clean(posture.artefact.rotation * target.normal);
        // The stem must not come from below the face.
        if normal.dot(stem) < -UPRIGHT {
            return None;
        }
        let contact = posture.artefact.apply(&target.point) + normal * options.stylus.ball_radius;
        // The errors of a head that are known take the ball off the control's place.
        let command = |point: Vector3<f64>| {
            let linear = point - posture.head_shift - posture.head_nominal;
            linear.map(|value| round(value, options.linear_resolution)) + posture.head_nominal
        };
        let start = command(contact + normal * options.clearance);
        let end = command(contact - normal * options.overtravel);
        let direction = clean((end - start).normalize());
        // The first contact on the way is the one that is meant.
        let reach = options.clearance + options.overtravel;
        let face = self.arrangement.artefact.has_plane_faces().then_some(target.normal);
        let from = start + posture.head_shift;
        let approach = Approach { posture, start: from, direction, reach, face };
        let travel = self.approaches.travel(&approach, None)?;
        let slack = 2.0 * options.linear_resolution + 1e-9;
        if (travel - (contact - from).norm()).abs() > slack {
            return None;
        }
        let way = direction * travel;
        self.approaches.is_free(&approach, &(from + way)).then_some(PlannedTouch {
            rotary: [0.0; MAX_ROTARY],
            sense: [0.0; MAX_ROTARY],
            cycle: 0,
            label: target.label,
            start,
            contact: start + way,
            direction,
            feed: 0.0,
        })
    }
}

/// A stem leans by less than this (rad) over a face that is nominally upright: known errors of the
/// machine tilt faces.
const UPRIGHT: f64 = 5e-3;

/// Removes rounding from a direction that is square to an axis.
fn clean(direction: Vector3<f64>) -> Vector3<f64> {
    direction.map(|value| if value.abs() < 1e-12 { 0.0 } else { value }).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::DEG;

    pub(super) fn options() -> PlanOptions {
        PlanOptions {
            clearance: 5.0,
            overtravel: 5.0,
            linear_resolution: 1e-4,
            rotary_resolution: 0.36 * crate::units::ARCSEC,
            stylus: Stylus { ball_radius: 1.0, stem_radius: 0.5, length: 100.0, body: [0.0; 2] },
            layout: Layout::Side,
            all_faces: false,
        }
    }

    fn degrees(values: &[f64]) -> Vec<f64> {
        values.iter().map(|value| value * DEG).collect()
    }

    fn request(c: &[f64], a: &[f64]) -> PlanRequest {
        PlanRequest {
            turning: degrees(c),
            tilting: degrees(a),
            pairs: Vec::new(),
            feeds: vec![10.0],
            both_senses: false,
            repeats: 1,
        }
    }

    fn cross_on(code: &str) -> Arrangement {
        let machine = Machine::of_code(code, 150.0).unwrap();
        let cross = Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        let places = machine.nominal();
        Arrangement::new(machine, &places, cross, &Fixture::default(), [150.0, 30.0], 0.0).unwrap()
    }

    #[test]
    fn the_papers_plan_has_72_touches() {
        for preset in ["[w C' A' b X Y Z t]", "[w C' B' b X Y Z t]"] {
            let request = request(&[0.0, 90.0, 180.0, 270.0], &[90.0, -90.0]);
            let touches = plan(&cross_on(preset), &request, &options()).unwrap();
            assert_eq!(touches.len(), 72, "{preset}");
            for position in touches[..64].chunks(16) {
                let labels: Vec<i64> = position.iter().map(|touch| touch.label).collect();
                assert_eq!(labels, (1..=16).collect::<Vec<_>>());
            }
            for position in touches[64..].chunks(4) {
                let labels: Vec<i64> = position.iter().map(|touch| touch.label).collect();
                assert_eq!(labels, [17, 18, 19, 20]);
            }
        }
    }

    #[test]
    fn a_rich_plan_reaches_no_face_from_below() {
        let c: Vec<f64> = (0..12).map(|i| 30.0 * f64::from(i)).collect();
        let a: Vec<f64> = (-3..=3).map(|i| 30.0 * f64::from(i)).collect();
        let mut request = request(&c, &a);
        request.feeds = vec![5.0, 15.0];
        request.both_senses = true;
        let touches = plan(&cross_on("[w C' A' b X Y Z t]"), &request, &options()).unwrap();
        assert!((450..560).contains(&touches.len()), "{}", touches.len());
        assert!(touches.iter().all(|touch| touch.direction.z <= 1e-9));
        for sense in [-1.0, 1.0] {
            for feed in [5.0, 15.0] {
                let share = touches.iter().filter(|t| t.sense[1] == sense && t.feed == feed);
                let share = share.count() as f64 / touches.len() as f64;
                assert!((share - 0.25).abs() < 0.1, "{sense} {feed} {share}");
            }
        }
    }
}
