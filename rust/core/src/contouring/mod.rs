//! Five-axis contouring with cross-coupled control (Byun and Jee 2010).
//!
//! ```text
//! R(u), O(u)  --interpolator-->  R(k), O(k)  --kinematics-->  R_m(k)
//! w = K_v [ R_m - y + C(z) (J⁻¹ ε) ],   τ v' + v = w,  y' = v
//! ε = (K - P, K_θ - P_θ):  contour error and tool-orientation error at the foot point K of P
//! ```
//!
//! One file is one term of the loop:
//!
//! | room | term |
//! |---|---|
//! | [`path`] | R(u), O(u), arc length, eq. (8) |
//! | [`FiveAxis`](crate::machine::FiveAxis) | Q, O and J⁻¹ of the machine, location errors, eq. (7) |
//! | [`interpolator`] | R(k), O(k), R_m(k) at a feed |
//! | [`axis`] | K_v, τ, and what real axes add |
//! | [`contour_error`] | K, eq. (1) |
//! | [`orientation_error`] | K_θ, eq. (2)-(5) |
//! | [`pid`] | C(z), eq. (6) |
//! | [`foot`] | the true foot point |
//! | [`simulation`] | the loop |
//! | [`margins`] | how far from instability the coupled loop is |
//! | [`batch`] | many simulations |
//!
//! # Errors of the paper
//!
//! - Eq. (4) prints the matrix of O(k-d) itself: a turn about it changes nothing. The axis of the
//!   turn is O(k-d) × O(neighbour); see [`orientation_error::turned_tool`].
//! - Table 1 mixes units: open-loop gains of the rotary axes belong to degrees of the motor or
//!   counts, controller gains to µm or counts (5000 µm to a degree). Only the products K·K_p = 81.28,
//!   80.544, 81.184, 81.957, 81.8201 1/s and the ratios C/K_p enter the loop. C_I/K_p is 5.5 1/s for
//!   the linear and 4.9 1/s for the rotary axes; C_D/K_p is 2.5e-4 s for all.
//! - The text passes the controllers' output through the inverse Jacobian, J⁻¹ (C ε). With the numbers
//!   of Table 1 as printed, outputs for rotary axes, in their drives' units, enter the linear axes five
//!   times too large: the loop is worse than C (J⁻¹ ε) with the path on the rotary axes and diverges
//!   with it 100 mm away. C (J⁻¹ ε) is stable. See [`simulation::Order`].
//! - Eq. (8) is marked (0) in the print; the offset of the path from the rotary axes is not published.
//! - The captions of Fig. 7 say contour error model where the text says tool-orientation error model.

pub mod axis;
pub mod batch;
pub mod contour_error;
pub mod foot;
pub mod interpolator;
pub mod margins;
pub mod orientation_error;
pub mod path;
pub mod pid;
pub mod simulation;

pub use axis::{Axis, Feedback, Friction, responses};
pub use batch::{Case, Figures, sweep};
pub use contour_error::PositionModel;
pub use interpolator::{Feed, Reference};
pub use orientation_error::OrientationModel;
pub use path::{Path, Piece};
pub use pid::Gains;
pub use simulation::{Coupling, Order, Sample, Simulation, samples};
