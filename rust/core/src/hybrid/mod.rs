//! The hybrid parallel machine of Ko, Kim, Kim and Na: 2-UPR + 1-SPR legs, two-axis wrist.
//!
//! ```text
//! G(Y, E) = 0                               closure of the loops            (closure, solution)
//! dY/dE = −[∂G/∂Y]⁺ ∂G/∂E                   equation (1)                    (solution)
//! dr/dE = (∂r/∂E)_Y + [∂r/∂Y] dY/dE         equation (2)                    (solution)
//! length = |r − centre|                     what a ball-bar reads           (ballbar)
//! ```
//!
//! Y = [u1, v1, u2, v2, φ, w2, u3, v3] are the passive joints (rad), E the 17 geometric errors of
//! the paper (mm, rad). Every error, of the 17 or not, is a component of a small rigid displacement
//! at one of the 18 [`Place`]s of the mechanism, so that all are treated alike and exactly.
//!
//! | file | what it knows |
//! |---|---|
//! | `parameter` | places, error parameters, names and units |
//! | `geometry` | the errors as displacements at the places |
//! | `posture` | frames and twists at given joints: the only kinematics there is |
//! | `closure` | the ten equations, their weights, their derivatives |
//! | `solution` | Newton from the home posture, branch and reach, sensitivities |
//! | `inverse` | closed form of the nominal machine; Newton for the machine with errors |
//! | `constraint` | the 12 × 13 Jacobian: rank, self-stress; residual strain |
//! | `mechanism` | dimensions and home: the three above for one machine |
//! | `ballbar` | length to an unknown centre and its gradient |
//! | `batch` | all of it over many poses, on many cores |

pub mod ballbar;
pub mod batch;
pub mod closure;
pub mod constraint;
pub mod geometry;
pub mod inverse;
pub mod mechanism;
pub mod parameter;
pub mod posture;
pub mod solution;

pub use closure::{Closure, Residual};
pub use constraint::Constraint;
pub use geometry::Geometry;
pub use inverse::Branch;
pub use mechanism::Mechanism;
pub use parameter::{ACTIVE, ERRORS, Errors, PASSIVE, Parameter, Place};
pub use posture::{Joints, Posture, ToolPose};
pub use solution::{Sensitivity, Solution};

#[cfg(test)]
mod tests;
