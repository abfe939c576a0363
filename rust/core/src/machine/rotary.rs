//! A rotary axis: where its line is, and how it turns.

use nalgebra::{Matrix3, Vector3};

use super::Side;
use crate::pose::Direction;
use crate::{Error, Result};

/// A rotary axis. A positive position turns the part it carries right-handed about its direction,
/// on the workpiece side as on the tool side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotary {
    about: Direction,
    /// Table or head.
    pub side: Side,
    direction: Vector3<f64>,
    own: Option<Matrix3<f64>>,
}

/// Components of a direction below this are rounding.
const SAME_DIRECTION: f64 = 1e-14;
/// Part of a direction along the one that its letter says, at least.
const MIN_ALONG_LETTER: f64 = 0.5;

impl Rotary {
    /// An axis with this letter (A, B, C: nominally about X, Y, Z), along its letter's direction or
    /// the one given, of any length.
    ///
    /// # Errors
    /// Another letter; a direction that is not finite or zero, or more than 60° off the letter's.
    pub fn new(letter: char, side: Side, direction: Option<[f64; 3]>) -> Result<Self> {
        let about = Direction::ALL.into_iter().find(|about| about.turn_letter() == letter);
        let Some(about) = about else {
            return Err(Error::input("rotary axis", letter, "A, B or C"));
        };
        let unit = about.unit();
        let Some(given) = direction else {
            return Ok(Self { about, side, direction: unit, own: None });
        };
        let refuse = |expected: String| {
            Error::input(format!("axes.{letter}.direction"), format!("{given:?}"), expected)
        };
        let direction = Vector3::from(given).normalize();
        if !direction.iter().all(|value| value.is_finite()) {
            return Err(refuse("three finite numbers, not all zero".into()));
        }
        if direction.dot(&unit).abs() < MIN_ALONG_LETTER {
            return Err(refuse(format!(
                "a direction within 60° of {} or against it: ISO 841 calls an axis about {0} {letter}",
                about.travel_letter()
            )));
        }
        if (direction - unit).norm() < SAME_DIRECTION {
            return Ok(Self { about, side, direction: unit, own: None });
        }
        Ok(Self { about, side, direction, own: Some(shortest(&unit, &direction)) })
    }

    /// A, B or C.
    #[must_use]
    pub const fn letter(&self) -> char {
        self.about.turn_letter()
    }

    /// The direction that its letter says: about this its own frame turns.
    #[must_use]
    pub const fn about(&self) -> Direction {
        self.about
    }

    /// Unit vector of the nominal axis average line at zero of all axes, machine frame.
    #[must_use]
    pub const fn direction(&self) -> &Vector3<f64> {
        &self.direction
    }

    /// Constant rotation from the axis' own frame to the machine's; None: they are parallel.
    #[must_use]
    pub const fn own(&self) -> Option<&Matrix3<f64>> {
        self.own.as_ref()
    }

    /// The turn by an angle (rad), machine frame at zero.
    #[must_use]
    #[inline]
    pub fn rotation(&self, angle: f64) -> Matrix3<f64> {
        let turn = self.about.rotation(angle);
        self.own.map_or(turn, |own| own * turn * own.transpose())
    }
}

/// The shortest rotation from one unit vector to another.
fn shortest(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let (axis, cos) = (from.cross(to), from.dot(to));
    if cos < 0.0 {
        // Half a turn about a direction square to `from` comes first, so that 1 + cos stays large.
        let across = Vector3::from_fn(|i, _| from[(i + 1) % 3]);
        let half_turn = 2.0 * across * across.transpose() - Matrix3::identity();
        return shortest(&-from, to) * half_turn;
    }
    let skew = axis.cross_matrix();
    Matrix3::identity() + skew + skew * skew / (1.0 + cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_own_frame_has_its_direction_along_the_axis() {
        for letter in ['A', 'B', 'C'] {
            let unit = Rotary::new(letter, Side::Tool, None).unwrap();
            for off in [[0.3, 0.5, -0.4], [1e-9, 1e-9, 1e-9], [0.7, 0.7, 0.7]] {
                for sign in [1.0, -1.0] {
                    let given = (unit.direction() + Vector3::from(off)) * sign * 3.0;
                    let axis = Rotary::new(letter, Side::Tool, Some(given.into())).unwrap();
                    let own = axis.own().unwrap();
                    assert!((own * unit.direction() - given.normalize()).norm() < 1e-15);
                    assert!((own.transpose() * own - Matrix3::identity()).norm() < 1e-15);
                    assert!((own.determinant() - 1.0).abs() < 1e-14);
                    let turned = axis.rotation(0.7) * axis.direction();
                    assert!((turned - axis.direction()).norm() < 1e-15);
                }
            }
        }
        let message = Rotary::new('A', Side::Tool, Some([0.0, 0.0, 1.0])).unwrap_err().to_string();
        assert!(message.contains("axes.A.direction") && message.contains("about X"), "{message}");
        assert!(Rotary::new('A', Side::Tool, Some([0.0; 3])).is_err());
    }
}
