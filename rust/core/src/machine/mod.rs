//! A machine: a chain of axes from the bed to the table and from the bed to the spindle.
//!
//! - [`chain`]: the kinematic code that says which axes there are, in which order;
//! - [`location`]: location errors of the rotary axes, with their ISO 230-1 names;
//! - [`places`]: every place where an error can act, and the state of all of them;
//! - [`posture`]: the pose of the table and the spindle for given axis positions and places;
//! - [`kinematics`]: forward, inverse and Jacobian for programs in work coordinates;
//! - [`five_axis`]: closed forms both ways for machines with two rotary axes;
//! - [`batch`]: forward kinematics of many poses at once.

pub mod batch;
pub mod chain;
pub mod five_axis;
pub mod kinematics;
mod links;
pub mod location;
pub mod places;
pub mod posture;
mod rotary;

use nalgebra::{Matrix3, Vector3};

use crate::pose::{Direction, rotation_xyz};
use crate::{Error, Result};

pub use batch::ForwardBatch;
pub use chain::Code;
pub use five_axis::FiveAxis;
pub use location::LocationError;
pub use places::{Component, MAX_ROTARY, Place, Places};
pub use posture::{Frames, Posture};
pub use rotary::Rotary;

/// Which end of the chain an axis carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Between bed and table.
    Workpiece,
    /// Between bed and spindle.
    Tool,
}

/// Where a rotary axis is, as far as it is not where its letter says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Direction of the axis average line at zero of all axes, any length; None: that of its letter.
    pub direction: Option<[f64; 3]>,
    /// A point of it at zero of all axes, mm, machine frame. Which one does not matter. None: the
    /// origin for an axis of the table, the pivot (0, 0, tool length) for one of a head.
    pub point: Option<[f64; 3]>,
}

/// A machine with X, Y, Z and up to two rotary axes. At zero of all axes the tool point is in the
/// origin of the machine frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    code: String,
    rotary: Vec<Rotary>,
    /// Nominal origin of each axis' frame in the frame that carries it, mm; the head's first one has
    /// its origin in the head's frame.
    offsets: [Vector3<f64>; MAX_ROTARY],
    /// Tool point from the origin of the head's last frame, mm.
    tool: Vector3<f64>,
    /// Tool point from the origin of the head's first frame at zero of all axes, mm.
    tool_at_zero: Vector3<f64>,
    /// Origin of the machine frame in the frame of the table's last axis at zero, mm; None: there.
    seat: Option<Vector3<f64>>,
    /// Tilts about X and Y (rad) that turn Z to the normal of the table top.
    top: [f64; 2],
}

/// Rotary axes with a smaller sine between their directions count as parallel.
const PARALLEL: f64 = 1e-2;
/// A table top whose normal has a larger part along X cannot be placed by tilts about X, Y, Z.
const MAX_NORMAL_X: f64 = 0.98;

impl Machine {
    /// A machine from its kinematic code, with the lines of some of its rotary axes. `tool_length`
    /// in mm is the distance from the pivot of a head to the tool point (or the centre of the
    /// probe's ball).
    ///
    /// # Errors
    /// A code that is none, an axis that the machine lacks, a direction or point that is not finite,
    /// parallel rotary axes, a head whose last axis is not at the height of the pivot, or a tool
    /// length that is not positive.
    pub fn new(code: &str, tool_length: f64, lines: &[(char, Line)]) -> Result<Self> {
        let code = Code::parse(code)?;
        if !(tool_length.is_finite() && tool_length > 0.0) {
            return Err(Error::input("tool length in mm", tool_length, "a positive number"));
        }
        if let Some((letter, _)) =
            lines.iter().find(|(l, _)| !code.rotary.iter().any(|r| r.0 == *l))
        {
            let known: Vec<String> = code.rotary.iter().map(|axis| axis.0.to_string()).collect();
            let known = known.iter().map(String::as_str);
            return Err(Error::unknown("rotary axis", &letter.to_string(), known));
        }
        let line = |letter: char| {
            let given = lines.iter().rev().find(|(other, _)| *other == letter);
            given.map_or_else(Line::default, |given| given.1)
        };
        let mut rotary: Vec<Rotary> = Vec::new();
        for &(letter, side) in &code.rotary {
            let axis = Rotary::new(letter, side, line(letter).direction)?;
            if let Some(other) =
                rotary.iter().find(|o| is_parallel(o.direction(), axis.direction()))
            {
                let what = format!("direction of axis {letter}");
                let expected = format!("one that is not parallel to axis {}", other.letter());
                return Err(Error::input(
                    what,
                    format!("{:?}", axis.direction().as_slice()),
                    expected,
                ));
            }
            rotary.push(axis);
        }
        let mut machine = Self {
            code: code.text,
            rotary,
            offsets: [Vector3::zeros(); MAX_ROTARY],
            tool: Vector3::new(0.0, 0.0, -tool_length),
            tool_at_zero: Vector3::new(0.0, 0.0, -tool_length),
            seat: None,
            top: [0.0; 2],
        };
        let points = machine.rotary.iter().map(|axis| (axis.letter(), line(axis.letter()).point));
        let points: Vec<_> = points.collect();
        machine.place(&points, tool_length)?;
        Ok(machine)
    }

    /// Puts the rotary axes on lines through these points.
    fn place(&mut self, points: &[(char, Option<[f64; 3]>)], tool_length: f64) -> Result<()> {
        let pivot = Vector3::new(0.0, 0.0, tool_length);
        let (mut head, mut table) = (None, Vector3::zeros());
        for (axis, &(letter, point)) in points.iter().enumerate() {
            let what = format!("axes.{letter}.point_mm");
            if point.is_some_and(|point| !point.iter().all(|value| value.is_finite())) {
                return Err(Error::input(what, format!("{point:?}"), "three finite numbers"));
            }
            let Rotary { side, .. } = self.rotary[axis];
            let direction = *self.rotary[axis].direction();
            // The foot of the origin (of a head: of the pivot) on the line is the frame's origin.
            let near = if side == Side::Tool { pivot } else { Vector3::zeros() };
            let off = point.map_or_else(Vector3::zeros, |point| Vector3::from(point) - near);
            let origin = near + off - direction * off.dot(&direction);
            if side == Side::Workpiece {
                self.offsets[axis] = origin - table;
                table = origin;
                continue;
            }
            match head {
                Some(carrier) => self.offsets[axis] = origin - carrier,
                None => self.tool_at_zero = -origin,
            }
            head = Some(origin);
            self.tool = -origin;
            let is_last = self.rotary[axis + 1..].iter().all(|other| other.side != side);
            if is_last && direction.z == 0.0 && (origin.z - tool_length).abs() > 1e-9 {
                let expected = format!(
                    "{tool_length}, the distance from the pivot to the ball's centre \
                     (probe.length_mm): at zero of all axes the ball's centre is in the origin of the \
                     machine frame"
                );
                return Err(Error::input(format!("{what}: z"), origin.z, expected));
            }
        }
        self.seat = (table != Vector3::zeros()).then_some(-table);
        Ok(())
    }

    /// A machine whose rotary axes are where their letters say.
    ///
    /// # Errors
    /// As [`Machine::new`].
    pub fn of_code(code: &str, tool_length: f64) -> Result<Self> {
        Self::new(code, tool_length, &[])
    }

    /// The machine with a table top whose normal at zero of all axes is this, of any length.
    ///
    /// # Errors
    /// A table that turns about its normal and misses the origin; a normal that is zero, not finite,
    /// or within 11° of X: placements are tilts about X, Y and Z in
    /// turn, and there the first and the last of them are the same.
    pub fn topped(mut self, normal: [f64; 3]) -> Result<Self> {
        let unit = Vector3::from(normal).normalize();
        if !unit.iter().all(|v| v.is_finite()) || unit.x.abs() > MAX_NORMAL_X {
            let expected = "a direction that is more than 11° off X: along X, tilts of the \
                 artefact about X and Z are the same; call that axis Y and turn the machine frame";
            return Err(Error::input("machine.table_normal", format!("{normal:?}"), expected));
        }
        self.check_seat(&unit)?;
        self.top = [(-unit.y).atan2(unit.z), unit.x.asin()];
        Ok(self)
    }

    /// A table that turns about its normal has its origin on the axis.
    fn check_seat(&self, normal: &Vector3<f64>) -> Result<()> {
        let last = self.carrier_of_work().map(|axis| &self.rotary[axis]);
        let Some((axis, seat)) = last.zip(self.seat) else { return Ok(()) };
        if !is_parallel(axis.direction(), normal) {
            return Ok(());
        }
        let letter = axis.letter();
        let got = format!("an axis that misses the origin by {:?}", (-seat).as_slice());
        let expected = format!(
            "a point straight along {letter}: the origin of the machine frame is the centre of the \
             table top, on this axis, and the points of the other axes are counted from there"
        );
        Err(Error::input(format!("axes.{letter}.point_mm"), got, expected))
    }

    /// The kinematic code.
    #[must_use]
    pub fn code(&self) -> &str {
        &self.code
    }

    /// The rotary axes, in the order in which their positions are given everywhere.
    #[must_use]
    pub fn rotary(&self) -> &[Rotary] {
        &self.rotary
    }

    /// The rotary axis that carries the workpiece: the last one of the table.
    #[must_use]
    pub fn carrier_of_work(&self) -> Option<usize> {
        self.rotary.iter().rposition(|axis| axis.side == Side::Workpiece)
    }

    /// The axis that turns the workpiece against the tool: the one that carries the workpiece, or the
    /// C axis of a head.
    #[must_use]
    pub fn turning_axis(&self) -> Option<usize> {
        let about_z = || self.rotary.iter().position(|axis| axis.about() == Direction::Z);
        self.carrier_of_work().or_else(about_z)
    }

    /// The axis that tilts the tool against the workpiece: the other one.
    #[must_use]
    pub fn tilting_axis(&self) -> Option<usize> {
        let turning = self.turning_axis();
        (0..self.rotary.len()).find(|&axis| Some(axis) != turning)
    }

    /// Position of the tilting axis, rad, at which the top of the table looks to the spindle: 0 where
    /// it does so at zero of all axes, or where that axis cannot bring it about.
    #[must_use]
    pub fn level(&self) -> f64 {
        let tilting = self.tilting_axis().map(|axis| &self.rotary[axis]);
        let normal: Vector3<f64> = self.top_rotation().column(2).into();
        let Some(axis) = tilting.filter(|axis| axis.side == Side::Workpiece) else { return 0.0 };
        let (direction, up) = (axis.direction(), Vector3::z());
        if (direction.dot(&normal) - direction.dot(&up)).abs() > PARALLEL {
            return 0.0;
        }
        let part = direction * direction.dot(&up);
        direction.dot(&normal.cross(&up)).atan2((normal - part).dot(&(up - part)))
    }

    /// The places of the machine without errors: where its axes nominally are.
    #[must_use]
    pub fn nominal(&self) -> Places {
        let mut places = Places::default();
        for (axis, offset) in self.offsets.iter().enumerate() {
            for along in Direction::ALL {
                places.add(Place::frame(axis, Component::Offset(along)), offset[along.index()]);
            }
        }
        places
    }

    /// Nominal origin of an axis' frame in the frame that carries it, mm.
    #[must_use]
    pub const fn offset(&self, axis: usize) -> &Vector3<f64> {
        &self.offsets[axis]
    }

    /// Tilts about X and Y (rad) that take the Z of the table top, its normal, to the table's frame.
    #[must_use]
    pub const fn top(&self) -> &[f64; 2] {
        &self.top
    }

    /// The rotation that these tilts are.
    #[must_use]
    pub fn top_rotation(&self) -> Matrix3<f64> {
        rotation_xyz(self.top[0], self.top[1], 0.0)
    }

    /// Origin of the table's frame in the frame of the table's last axis, mm; None: the same.
    #[must_use]
    pub const fn seat(&self) -> Option<&Vector3<f64>> {
        self.seat.as_ref()
    }

    /// Tool point from the origin of the head's last frame, mm.
    #[must_use]
    pub const fn tool(&self) -> &Vector3<f64> {
        &self.tool
    }

    /// Tool point from the origin of the head's first frame at zero of all axes, mm.
    #[must_use]
    pub const fn tool_at_zero(&self) -> &Vector3<f64> {
        &self.tool_at_zero
    }

    /// Index of the rotary axis with this letter.
    ///
    /// # Errors
    /// The machine has no such axis.
    pub fn axis(&self, letter: char) -> Result<usize> {
        let position = self.rotary.iter().position(|axis| axis.letter() == letter);
        position.ok_or_else(|| {
            let known: Vec<String> = self.rotary.iter().map(|a| a.letter().to_string()).collect();
            Error::unknown("rotary axis", &letter.to_string(), known.iter().map(String::as_str))
        })
    }
}

fn is_parallel(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    a.cross(b).norm() < PARALLEL
}

/// Machines of many kinds for tests: nominal, off their origins, at odd angles.
#[cfg(test)]
pub(crate) fn examples(tool_length: f64) -> Vec<Machine> {
    let line = |direction, point| Line { direction, point };
    let codes = [
        "[w C' A' b X Y Z (C) t]",
        "[w C' B' b X Y Z t]",
        "[w C' b X Y Z B t]",
        "[w B' A' b X Y Z t]",
        "[w X' b Y Z C B t]",
        "[w X' Y' b Z C A t]",
    ];
    let mut all: Vec<Machine> =
        codes.iter().map(|code| Machine::of_code(code, tool_length).unwrap()).collect();
    let oblique = line(Some([0.0, 1.0, 1.0]), Some([5.0, 0.0, tool_length]));
    all.push(Machine::new("[w C' b X Y Z B t]", tool_length, &[('B', oblique)]).unwrap());
    let nutating = line(Some([0.0, -1.0, 1.0]), Some([5.0, 3.0, -40.0]));
    let off = line(Some([0.02, 0.03, 1.0]), Some([4.0, -7.0, 1.0]));
    let lines = [('B', nutating), ('C', off)];
    all.push(Machine::new("[w C' B' b X Y Z t]", tool_length, &lines).unwrap());
    let tilted = line(Some([-1.0, 0.1, 0.2]), Some([5.0, 30.0, tool_length]));
    let lines = [('A', tilted), ('C', line(Some([0.1, -0.2, -1.0]), Some([11.0, 12.0, 5.0])))];
    all.push(Machine::new("[w Y' b X Z C A t]", tool_length, &lines).unwrap());
    all
}
