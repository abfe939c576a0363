//! The hybrid parallel machine of paper 004 (Ko, Kim et al.): 2-UPR + 1-SPR legs, two-axis wrist.
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
//! | `mechanism` | dimensions, places, error parameters, names and units |
//! | `posture` | frames and twists at given joints: the only kinematics there is |
//! | `closure` | the ten equations, their weights, their derivatives |
//! | `solution` | Newton from the home posture, branch and reach, sensitivities |
//! | `inverse` | closed form of the nominal machine; Newton for the machine with errors |
//! | `constraint` | the 12 × 13 Jacobian: rank, self-stress; residual strain |
//! | `ballbar` | length to an unknown centre and its gradient |
//! | `batch` | all of it over many poses, in the units of the face, on many cores |

pub mod ballbar;
pub mod batch;
pub mod closure;
pub mod constraint;
pub mod inverse;
pub mod mechanism;
pub mod posture;
pub mod solution;

pub use closure::{Closure, Residual};
pub use constraint::Constraint;
pub use inverse::{Branch, ToolPose};
pub use mechanism::{ERRORS, Errors, Mechanism, Parameter, Place};
pub use posture::{ACTIVE, Joints, PASSIVE, Posture};
pub use solution::{Sensitivity, Solution};

#[cfg(test)]
mod tests;
