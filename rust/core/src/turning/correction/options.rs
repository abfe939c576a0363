//! How a program is to be corrected.

use crate::nc::path::Start;
use crate::turning::profile::Follows;

/// Where blocks go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// The paper's. On a cylinder a block at the first window of every new k (k before the first is
    /// 0), reached by a ramp from the last point; on a cone a block at every window. The last
    /// window has no block: its k goes to the end of the line.
    Paper,
    /// A block at every window but the last.
    EveryWindow,
    /// A block in the middle of every run of windows of one k, so that ramps cross the error where it
    /// crosses (k - 0.5) CU instead of running half a unit ahead.
    MidRun,
    /// The project's own: the fewest blocks that leave no reading (window mean) more than half a unit
    /// and this bound, mm; among those, the least sum of squares. Ends of blocks that are there
    /// already cost nothing, and the rapid that goes to where a line begins is one of them. On a
    /// line with more than 512 windows blocks are tried at 512 of them and wherever the error is
    /// too rough for those: then the count may be above the fewest, the bound holds as well.
    Bounded {
        /// Allowed beyond half a unit, mm.
        bound_mm: f64,
    },
}

/// The k of the corner at which the first measured line begins (a corner behind a measured line has
/// that line's last k).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartCorner {
    /// That of the line's first block: so Fig. 14.
    LookAhead,
    /// Zero: so Figs. 18 and 20.
    Zero,
}

/// How to correct.
#[derive(Clone, Debug, PartialEq)]
pub struct CorrectionOptions {
    /// Unit CU, mm on the diameter.
    pub unit_mm: f64,
    /// Readings N in a window.
    pub window: usize,
    /// Where blocks go.
    pub rule: Rule,
    /// Start corner, for the paper's rules.
    pub start_corner: StartCorner,
    /// What the program's coordinates follow: with a nose, the block that cuts at z stands beside z
    /// on a cone. (Fig. 14 does not see to this: [`Follows::Contour`].)
    pub follows: Follows,
    /// What is in force before the program.
    pub start: Start,
    /// Leave the numbers of the blocks as they are; inserted blocks have none.
    pub keep_numbers: bool,
}
