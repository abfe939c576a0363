//! From readings to parameters: [`closed_form`] for the paper's 72 touches, [`least_squares`] for any.

mod candidates;
pub mod closed_form;
pub mod least_squares;
mod options;
mod system;
mod workspace;
