//! Units of length, angle and time in mm, rad and s, in which the core calculates.
//!
//! The Python API and files have µm for position errors, arcsec for angular errors, degrees for axis
//! positions, ppm for scale and hours for slow drift. Their values are converted by the binding.

use std::f64::consts::PI;

/// mm per µm.
pub const UM: f64 = 1e-3;
/// mm per inch.
pub const INCH: f64 = 25.4;
/// rad per arcsec.
pub const ARCSEC: f64 = PI / 648_000.0;
/// rad per degree.
pub const DEG: f64 = PI / 180.0;
/// Pure number per ppm.
pub const PPM: f64 = 1e-6;
/// s per ms.
pub const MS: f64 = 1e-3;
/// s per minute.
pub const MINUTE: f64 = 60.0;
/// s per hour.
pub const HOUR: f64 = 3600.0;
/// mm/s per mm/min.
pub const MM_PER_MIN: f64 = 1.0 / 60.0;

/// The unit that a parameter's name counts in (`_um`, `_arcsec`). The core has the value times
/// [`Unit::to_internal`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unit {
    /// Micrometre.
    Um,
    /// Second of arc.
    Arcsec,
    /// Part per million.
    Ppm,
    /// Micrometre per hour.
    UmPerHour,
    /// Millisecond.
    Ms,
    /// Second.
    S,
    /// Minute.
    Min,
    /// Degree.
    Deg,
    /// Millimetre.
    Mm,
}

impl Unit {
    /// Factor to mm, rad, s.
    #[must_use]
    pub const fn to_internal(self) -> f64 {
        match self {
            Self::Um => UM,
            Self::Arcsec => ARCSEC,
            Self::Ppm => PPM,
            Self::UmPerHour => UM / HOUR,
            Self::Ms => MS,
            Self::S | Self::Mm => 1.0,
            Self::Min => MINUTE,
            Self::Deg => DEG,
        }
    }

    /// How the unit is written in names and tables.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Um => "um",
            Self::Arcsec => "arcsec",
            Self::Ppm => "ppm",
            Self::UmPerHour => "um/h",
            Self::Ms => "ms",
            Self::S => "s",
            Self::Min => "min",
            Self::Deg => "deg",
            Self::Mm => "mm",
        }
    }
}
