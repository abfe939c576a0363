//! Positions, moves and modes: what a program's words mean.

use super::Span;
use crate::{Error, Result};

/// The axes, in the order of [`Position::axes`].
pub const AXES: [char; 6] = ['X', 'Y', 'Z', 'A', 'B', 'C'];

/// Commanded position: X (radius on a lathe), Y, Z in mm, A, B, C in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// X, Y, Z, A, B, C.
    pub axes: [f64; 6],
}

/// Plane of an arc, by the axes that go first and second: an arc is counter-clockwise if it turns
/// from the first to the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// G17, X to Y.
    Xy,
    /// G18, Z to X: seen from +Y, that is with Z to the right and X up.
    Zx,
    /// G19, Y to Z.
    Yz,
}

impl Plane {
    /// Numbers of the first and second axis in [`Position::axes`].
    #[must_use]
    pub const fn axes(self) -> (usize, usize) {
        match self {
            Self::Xy => (0, 1),
            Self::Zx => (2, 0),
            Self::Yz => (1, 2),
        }
    }
}

/// How a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// G0: every axis as fast as it can; the control chooses the path between the ends.
    Rapid,
    /// G1: straight, at feed.
    Feed,
    /// G38.2 to G38.5: straight until the probe changes.
    Probe,
    /// G2, G3: arc at feed.
    Arc {
        /// Plane.
        plane: Plane,
        /// Centre, mm, first and second axis of the plane.
        centre: [f64; 2],
        /// G2.
        clockwise: bool,
    },
}

/// What a feed counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedMode {
    /// mm (degrees) a minute.
    PerMinute,
    /// mm a turn of the spindle.
    PerRevolution,
    /// Moves a minute (G93).
    InverseTime,
}

/// Where the tool goes beside the programmed contour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// G40: the program holds the tool's centre path.
    #[default]
    On,
    /// G41.
    Left,
    /// G42.
    Right,
}

/// One move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// How.
    pub motion: Motion,
    /// Where from.
    pub from: Position,
    /// Where to (for a probing move: where it ends if nothing is touched).
    pub to: Position,
    /// Feed in mm/min, mm/rev or 1/min; 0 on a rapid.
    pub feed: f64,
    /// What the feed counts.
    pub feed_mode: FeedMode,
    /// Nose (cutter) compensation in force.
    pub side: Side,
    /// How its block spells positions.
    pub spelling: Spelling,
    /// Index of the block in the program.
    pub block: usize,
    /// Where the block was read.
    pub span: Span,
}

/// How the words of a block spell positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spelling {
    /// X is a diameter.
    pub diameter: bool,
    /// mm per unit of length.
    pub unit_mm: f64,
    /// Positions are increments: G91, or U and W on a Fanuc lathe.
    pub incremental: bool,
    /// I and K are the centre itself, not the way to it.
    pub centre_absolute: bool,
}

impl Spelling {
    /// The number behind X for a radius in mm.
    #[must_use]
    pub fn x(&self, radius_mm: f64) -> f64 {
        if self.diameter { 2.0 * radius_mm / self.unit_mm } else { radius_mm / self.unit_mm }
    }
}

/// What is in force before the first block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    /// Position, if it is known.
    pub position: Option<Position>,
    /// Feed, if one is set outside the program (the listings of the paper have none), counted in
    /// whatever way is then in force.
    pub feed: Option<f64>,
    /// Codes of this machine that move no axis (`G4503`): letter and number.
    pub machine_codes: Vec<(char, f64)>,
}

impl Start {
    pub(super) fn check(&self) -> Result<()> {
        if let Some(feed) = self.feed
            && !(feed.is_finite() && feed > 0.0)
        {
            return Err(Error::input("feed before the program", feed, "more than zero, or none"));
        }
        match self.machine_codes.iter().find(|(letter, _)| !letter.is_ascii_uppercase()) {
            Some((letter, number)) => {
                let got = format!("{letter}{number}");
                Err(Error::input("machine code", got, "a letter A to Z and a number, as G4503"))
            }
            None => Ok(()),
        }
    }
}

/// A program's moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Where the moves begin: [`Start::position`], or the first place at which every axis that the
    /// program names has been commanded. Axes that it never names are 0.
    pub start: Position,
    /// The block that commanded X at [`Path::start`], if it is one of those that were followed.
    pub lead: Option<Lead>,
    /// The moves; moves of no length are left out.
    pub moves: Vec<Move>,
}

/// A block that goes to where the moves begin: it is no move itself, since nothing says from where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lead {
    /// Index of the block in the program.
    pub block: usize,
    /// How it spells positions.
    pub spelling: Spelling,
}
