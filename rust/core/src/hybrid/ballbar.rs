//! What a ball-bar reads: the distance of the tool point from a ball that rests on the table.

use nalgebra::Vector3;

use super::geometry::Geometry;
use super::parameter::Parameter;
use super::solution::Solution;
use crate::{Error, Result};

/// A reading and its gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// |r − centre|, mm.
    pub length: f64,
    /// From the ball to the tool point, unit vector: the gradient by r, and minus that by the
    /// centre.
    pub direction: Vector3<f64>,
}

/// Length from the ball at `centre` (mm) to the tool point of `solution`.
///
/// # Errors
/// The tool point is on the centre.
pub fn reading(solution: &Solution, centre: &Vector3<f64>) -> Result<Reading> {
    let bar = solution.posture.tip() - centre;
    let length = bar.norm();
    if length.is_nan() || length <= 1e-6 {
        return Err(Error::input("length of the ball-bar (mm)", length, "more than 1e-6"));
    }
    Ok(Reading { length, direction: bar / length })
}

/// Derivative of the reading by each parameter, mm per mm or rad: n · dr/de.
pub fn gradient<'a>(
    geometry: &'a Geometry,
    solution: &'a Solution,
    reading: &'a Reading,
    parameters: &'a [Parameter],
) -> impl Iterator<Item = f64> + 'a {
    let along = solution.along(geometry, &reading.direction);
    parameters.iter().map(move |&parameter| along.of(parameter))
}
