//! # trunnion-core
//!
//! A model says what an instrument would read; an effect is a named group of parameters that
//! changes it; identification estimates parameters; diagnosis decides which effects the data
//! demand; compensation turns parameters into corrected commands.
//!
//! ```text
//! reading = model(plan; location errors, placement, artefact, probe, effects) + noise
//! ```
//!
//! A table whose C axis lies 15 µm off in X, probed on one arm of the cross:
//!
//! ```
//! use trunnion_core::artefact::Artefact;
//! use trunnion_core::machine::Machine;
//! use trunnion_core::moves::MoveTable;
//! use trunnion_core::probe::Probe;
//! use trunnion_core::touch::TouchModel;
//!
//! # fn main() -> trunnion_core::Result<()> {
//! let machine = Machine::of_code("[w C' A' b X Y Z t]", 150.0)?;
//! let cross = Artefact::of("cross", &[100.0, 25.0, 25.0])?;
//! let model = TouchModel::new(machine, cross, Probe::new(1.0, 0.0)?, vec![]);
//! // The end of the +X arm, recorded where the nominal artefact is: x = 50 mm + ball radius.
//! let touches = MoveTable::new(
//!     2, vec![0.0, 0.0], vec![51.0, 0.0, 12.5], vec![-1.0, 0.0, 0.0], None, None, None)?;
//! let mut values = vec![0.0; model.parameter_count()];
//! values[6] = 0.015; // EX0C
//! let mut deviation = [None];
//! model.deviations(&touches.view(), &values, &mut deviation);
//! // The arm is 15 µm nearer, so the touch comes 15 µm earlier along −X.
//! assert!((deviation[0].unwrap_or(0.0) + 0.015).abs() < 1e-12);
//! # Ok(())
//! # }
//! ```
//!
//! Each room may use only the ones above it:
//!
//! | room | what it knows |
//! |---|---|
//! | [`units`] | µm, arcsec, ppm in mm, rad |
//! | [`pose`] | rigid poses, rotations, signs |
//! | [`machine`] | chain of axes, location errors, where errors act, kinematics |
//! | [`artefact`], [`probe`] | what is touched, and with what |
//! | [`moves`] | touches and planned moves as arrays |
//! | [`effects`] | the catalogue: id → parameters → places |
//! | [`plan`] | which touches, in which order; clearance |
//! | [`touch`] | the reading of a touch, its derivative, simulation |
//! | [`linear`] | linear least squares, what data do not identify |
//! | [`beside`] | what blocks of columns gain beside a basis |
//! | [`by_value`] | sums over readings of the same value of a quantity |
//! | [`sets`] | sets of causes: what each gains beside the others |
//! | [`sizes`] | sizes of causes that act together |
//! | [`identification`] | closed forms, least squares |
//! | [`compensation`] | volumetric error, corrected commands |
//! | [`studies`] | many virtual calibrations and compensations at once |
//! | [`nc`] | part programs: read, written, followed |
//! | [`turning`] | the lathe: probe path, correction, diameter errors |
//! | [`hybrid`] | the hybrid parallel machine: closed loops, sensitivities, ball-bar |
//! | [`contouring`] | five-axis cross-coupled control: path, servos, true errors |

pub mod artefact;
pub mod beside;
pub mod by_value;
pub mod compensation;
pub mod effects;
pub mod error;
pub mod hybrid;
pub mod identification;
pub mod linear;
pub mod machine;
pub mod moves;
mod pieces;
pub mod plan;
pub mod pose;
pub mod probe;
pub mod sets;
pub mod sizes;
pub mod studies;
pub mod touch;
pub mod units;

// --- programs
pub mod nc;

// --- turning
pub mod turning;

// --- contouring
pub mod contouring;

pub use error::{Error, Result};
