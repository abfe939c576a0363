//! A machine: a chain of axes from the bed to the table and from the bed to the spindle.
//!
//! - [`location`]: location errors of the rotary axes, with their ISO 230-1 names;
//! - [`places`]: every place where an error can act, and the state of all of them;
//! - [`posture`]: the pose of the table and the spindle for given axis positions and places;
//! - [`kinematics`]: forward, inverse and Jacobian for programs in work coordinates;
//! - [`five_axis`]: closed forms both ways for machines with two rotary axes;
//! - [`batch`]: forward kinematics of many poses at once.

pub mod batch;
pub mod five_axis;
pub mod kinematics;
mod links;
pub mod location;
pub mod places;
pub mod posture;

use nalgebra::Vector3;

use crate::pose::Direction;
use crate::{Error, Result};

pub use batch::ForwardBatch;
pub use five_axis::FiveAxis;
pub use location::LocationError;
pub use places::{Component, MAX_ROTARY, Place, Places};
pub use posture::{Frames, Posture};

/// Which end of the chain an axis carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Between bed and table.
    Workpiece,
    /// Between bed and spindle.
    Tool,
}

/// A rotary axis. A positive position turns the part it carries right-handed about +`direction`,
/// on the workpiece side as on the tool side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rotary {
    /// Nominal direction of the axis average line at zero of all axes.
    pub direction: Direction,
    /// Table or head.
    pub side: Side,
}

impl Rotary {
    /// A, B or C.
    #[must_use]
    pub const fn letter(&self) -> char {
        self.direction.turn_letter()
    }
}

/// A machine with X, Y, Z and up to [`MAX_ROTARY`] rotary axes. The nominal axis average line of the
/// axis next to the work goes through the origin; those of the others do where [`Machine::through`]
/// says nothing else. Those of a head meet in the pivot, `tool_length` above the tool point.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    rotary: Vec<Rotary>,
    /// Nominal origin of each axis' frame in the frame that carries it, mm.
    offsets: [Vector3<f64>; MAX_ROTARY],
    /// Tool point from the pivot at zero of all axes, mm.
    tool: Vector3<f64>,
}

/// A machine that comes with the project.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name, as in the set-up file.
    pub name: &'static str,
    /// Its rotary axes, in the order of [`Machine::new`].
    pub rotary: &'static [Rotary],
}

/// The machines that come with the project.
pub const PRESETS: [Preset; 3] = {
    use Direction::{X, Y, Z};
    const fn table(direction: Direction) -> Rotary {
        Rotary { direction, side: Side::Workpiece }
    }
    const fn head(direction: Direction) -> Rotary {
        Rotary { direction, side: Side::Tool }
    }
    [
        // A carries C, both under the table.
        Preset { name: "trt-ca", rotary: &[table(X), table(Z)] },
        // B carries C.
        Preset { name: "trt-bc", rotary: &[table(Y), table(Z)] },
        // C under the table, B in the head.
        Preset { name: "table-c-head-b", rotary: &[head(Y), table(Z)] },
    ]
};

impl Machine {
    /// A machine from its rotary axes: those of the workpiece side in order from the bed to the
    /// table, those of the tool side in order from the bed to the spindle. `tool_length` in mm is
    /// the distance from the pivot of a head to the tool point (or the centre of the probe's ball).
    ///
    /// # Errors
    /// More than [`MAX_ROTARY`] rotary axes, two about one direction (they could not be told
    /// apart by name), or a tool length that is not positive.
    pub fn new(rotary: Vec<Rotary>, tool_length: f64) -> Result<Self> {
        if rotary.len() > MAX_ROTARY {
            let expected = format!("at most {MAX_ROTARY}");
            return Err(Error::input("number of rotary axes", rotary.len(), expected));
        }
        for (i, axis) in rotary.iter().enumerate() {
            if rotary[..i].iter().any(|other| other.direction == axis.direction) {
                let what = "rotary axes";
                return Err(Error::input(what, format!("two {}", axis.letter()), "one each"));
            }
        }
        if !(tool_length.is_finite() && tool_length > 0.0) {
            return Err(Error::input("tool length in mm", tool_length, "a positive number"));
        }
        let tool = Vector3::new(0.0, 0.0, -tool_length);
        Ok(Self { rotary, offsets: [Vector3::zeros(); MAX_ROTARY], tool })
    }

    /// One of [`PRESETS`].
    ///
    /// # Errors
    /// An unknown name.
    pub fn preset(name: &str, tool_length: f64) -> Result<Self> {
        let found = PRESETS.iter().find(|preset| preset.name == name);
        let preset = found.ok_or_else(|| {
            Error::unknown("machine preset", name, PRESETS.iter().map(|preset| preset.name))
        })?;
        Self::new(preset.rotary.to_vec(), tool_length)
    }

    /// The rotary axes, in the order in which their positions are given everywhere.
    #[must_use]
    pub fn rotary(&self) -> &[Rotary] {
        &self.rotary
    }

    /// The machine with nominal axis average lines through these points: letter, and a point of the
    /// line at zero of all axes, mm, machine frame. Which point of its line is given does not matter.
    ///
    /// # Errors
    /// An axis that the machine lacks, a point that is not finite, an axis next to the work that
    /// misses the origin of the machine frame, a head's axis that is not at the height of the pivot.
    pub fn through(mut self, points: &[(char, [f64; 3])]) -> Result<Self> {
        let mut origins = [Vector3::zeros(); MAX_ROTARY];
        for &(letter, point) in points {
            let axis = self.axis(letter)?;
            let what = format!("axes.{letter}.point_mm");
            if !point.iter().all(|value| value.is_finite()) {
                return Err(Error::input(what, format!("{point:?}"), "three finite numbers"));
            }
            let mut origin = Vector3::from(point);
            origin[self.rotary[axis].direction.index()] = 0.0;
            match self.rotary[axis].side {
                Side::Workpiece => origins[axis] = origin,
                Side::Tool => self.shift_pivot(&what, &origin)?,
            }
        }
        let mut carrier = Vector3::zeros();
        for (axis, rotary) in self.rotary.iter().enumerate() {
            if rotary.side == Side::Workpiece {
                self.offsets[axis] = origins[axis] - carrier;
                carrier = origins[axis];
            }
        }
        if carrier != Vector3::zeros() {
            let last = self.rotary.iter().rev().find(|axis| axis.side == Side::Workpiece);
            let letter = last.map_or(' ', Rotary::letter);
            let got = format!("an axis that misses the origin by {:?}", carrier.as_slice());
            let expected = format!(
                "a point straight along {letter}: the origin of the machine frame lies on this axis, \
                 and the points of the other axes are counted from there"
            );
            return Err(Error::input(format!("axes.{letter}.point_mm"), got, expected));
        }
        Ok(self)
    }

    /// Puts the pivot of a head with one axis on a line.
    fn shift_pivot(&mut self, what: &str, origin: &Vector3<f64>) -> Result<()> {
        if self.rotary.iter().filter(|axis| axis.side == Side::Tool).count() > 1 {
            let got = format!("{:?}", origin.as_slice());
            let expected = "none: the axes of a head with two meet in its pivot";
            return Err(Error::input(what, got, expected));
        }
        let height = -self.tool.z;
        if (origin.z - height).abs() > 1e-9 {
            let expected = format!(
                "{height}, the distance from the pivot to the ball's centre (probe.length_mm): at zero \
                 of all axes the ball's centre is in the origin of the machine frame"
            );
            return Err(Error::input(format!("{what}: z"), origin.z, expected));
        }
        self.tool = -origin;
        Ok(())
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

    /// Tool point from a head's pivot at zero of all axes, mm.
    #[must_use]
    pub const fn tool(&self) -> &Vector3<f64> {
        &self.tool
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
