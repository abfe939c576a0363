//! Closed forms for the paper's 72 touches of the cross on a `trt-ca` machine.
//!
//! [`printed`] is equations (3) to (20) of the paper. [`separating`] is derived here from the same
//! touches and gives the eight location errors and the six placement parameters, whatever the
//! placement.

mod printed;
mod rows;
mod separating;

pub use printed::{Printed, PrintedTilted, PrintedTurned, SLIPS, printed, printed_operator};
pub use rows::PaperRows;
pub use separating::{Scratch, Separated, separate, separating, separating_operator};

/// Number of location errors and placement parameters.
pub const COUNT: usize = 14;

/// Number of location errors, the first of them.
pub const ERRORS: usize = 8;
