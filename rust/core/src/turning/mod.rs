//! The lathe of Park and Park (1990): the part, the path of the probe along it, the
//! correction of its finishing program, and the diameter that comes out.
//!
//! Coordinates are `[z, x]` in mm with x the radius and z from the chuck face outward; diameter
//! errors are measured minus nominal, in mm on the diameter, negative if the part is too thin.

pub mod clearance;
pub mod correction;
pub mod diameter;
pub mod finishing;
pub mod geometry;
pub mod probe_path;
pub mod probe_program;
pub mod profile;
