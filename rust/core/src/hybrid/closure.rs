//! The ten closure equations of the two loops, and which of them count.
//!
//! Eliminating the outer platform revolutes from the twelve equations of the loops leaves ten for
//! the eight passive joints: at legs 1 and 3 the seat C meets the leg's end T, C − T = 0 (mm), and
//! the seat's revolute axis is square to the leg, y_P·z = 0 and y_P·x = 0 (multiplied by a length).
//! The paper solves eight of them; two are redundant, which is the paper's over-constraint. The 17
//! errors of the paper leave the redundant ones satisfied; other errors do not, and then the answer
//! depends on the weights chosen here: only the stiffness of the joints decides.

use nalgebra::{SMatrix, SVector, Vector3};

use super::parameter::PASSIVE;
use super::posture::{Posture, Reach, Twist};
use crate::{Error, Result};

/// Number of equations.
pub const EQUATIONS: usize = 10;

/// G of the two loops.
pub(super) type Equations = SVector<f64, EQUATIONS>;

/// Lengths (mm) by which the angle equations are multiplied to weigh them against the distance
/// equations in weighted least squares. A zero drops an equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closure {
    /// Of y_P·z, at legs 1 and 3: the revolute axis square to the leg.
    pub along_mm: [f64; 2],
    /// Of y_P·x, at legs 1 and 3: the revolute axis parallel to the v axis, against a turn about
    /// the leg.
    pub about_mm: [f64; 2],
}

impl Default for Closure {
    /// Least squares with 1 mm at a joint worth 1 mrad.
    fn default() -> Self {
        Self { along_mm: [1000.0; 2], about_mm: [1000.0; 2] }
    }
}

impl Closure {
    /// The paper's eight equations: y_P·x is dropped at both legs.
    pub const PAPER: Self = Self { along_mm: [1000.0; 2], about_mm: [0.0; 2] };

    /// Weights from four numbers: along and about of leg 1, along and about of leg 3, mm.
    ///
    /// # Errors
    /// A weight that is negative or not finite, or both of a leg zero (nothing would hold it).
    pub fn new(weights_mm: [f64; 4]) -> Result<Self> {
        let [along1, about1, along3, about3] = weights_mm;
        let good = |w: f64| w.is_finite() && w >= 0.0;
        if weights_mm.into_iter().all(good) && along1 + about1 > 0.0 && along3 + about3 > 0.0 {
            return Ok(Self { along_mm: [along1, along3], about_mm: [about1, about3] });
        }
        Err(Error::input(
            "closure weights of legs 1 and 3",
            format!("{weights_mm:?} mm"),
            "finite lengths, not negative, at least one of each leg above zero",
        ))
    }

    fn weights(&self, side: usize) -> [f64; 5] {
        [1.0, 1.0, 1.0, self.along_mm[side], self.about_mm[side]]
    }

    /// Row, of each loop's five, of the angle equation that a choice of eight would keep.
    pub(super) fn kept(&self) -> [usize; 2] {
        self.along_mm.map(|along| if along > 0.0 { 3 } else { 4 })
    }

    /// Weighted G at a posture.
    pub(super) fn equations(&self, posture: &Posture) -> Equations {
        let mut equations = Equations::zeros();
        for side in 0..2 {
            let weights = self.weights(side);
            for (row, value) in Residual::of(posture, side).rows().into_iter().enumerate() {
                equations[5 * side + row] = weights[row] * value;
            }
        }
        equations
    }

    /// Weighted ∂G/∂Y.
    pub(super) fn jacobian(&self, posture: &Posture) -> SMatrix<f64, EQUATIONS, PASSIVE> {
        let loops = self.loops(posture);
        let mut jacobian = SMatrix::<f64, EQUATIONS, PASSIVE>::zeros();
        for (joint, twist) in posture.passive.iter().enumerate() {
            let mut column = Equations::zeros();
            loops.add_column(twist, Posture::passive_reach(joint), &mut column);
            jacobian.set_column(joint, &column);
        }
        jacobian
    }

    /// What every derivative of the weighted G needs at a posture.
    #[inline]
    pub(super) fn loops(&self, posture: &Posture) -> Loops {
        let sides = [0, 1].map(|side| {
            let (seat, end) = (&posture.seats[side], &posture.ends[side]);
            let y = seat.rotation.column(1);
            Side {
                seat: seat.translation,
                end: end.translation,
                along: y.cross(&end.rotation.column(2)) * self.along_mm[side],
                about: y.cross(&end.rotation.column(0)) * self.about_mm[side],
            }
        });
        Loops { sides }
    }
}

/// Points and directions of both loops.
pub(super) struct Loops {
    sides: [Side; 2],
}

struct Side {
    /// C and T.
    seat: Vector3<f64>,
    end: Vector3<f64>,
    /// Weighted y_P × z and y_P × x: a turn ω of the seat changes y·z by (ω × y)·z = ω·(y × z), the
    /// same turn of the leg by y·(ω × z) = −ω·(y × z).
    along: Vector3<f64>,
    about: Vector3<f64>,
}

impl Loops {
    /// Adds the weighted derivative of G under a twist.
    pub fn add_column(&self, twist: &Twist, reach: Reach, column: &mut Equations) {
        for (at, side) in self.sides.iter().enumerate() {
            let (velocity, sign) = match reach {
                Reach::Central => (twist.at(&side.seat), 1.0),
                Reach::Seat(of) if of == at => (twist.at(&side.seat), 1.0),
                Reach::Leg(of) if of == at => (-twist.at(&side.end), -1.0),
                Reach::Leg(_) | Reach::Seat(_) | Reach::Wrist => continue,
            };
            let row = 5 * at;
            column[row] += velocity.x;
            column[row + 1] += velocity.y;
            column[row + 2] += velocity.z;
            column[row + 3] += sign * twist.turn.dot(&side.along);
            column[row + 4] += sign * twist.turn.dot(&side.about);
        }
    }
}

/// What is left open in one loop: the strain that elastic joints would have to take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// C − T, mm, machine frame.
    pub gap: [f64; 3],
    /// y_P·z, rad.
    pub along: f64,
    /// y_P·x, rad.
    pub about: f64,
}

impl Residual {
    /// Of the loop over leg 1 (`side` 0) or leg 3 (1).
    #[must_use]
    pub fn of(posture: &Posture, side: usize) -> Self {
        let (seat, end) = (&posture.seats[side], &posture.ends[side]);
        let y = seat.rotation.column(1);
        Self {
            gap: (seat.translation - end.translation).into(),
            along: y.dot(&end.rotation.column(2)),
            about: y.dot(&end.rotation.column(0)),
        }
    }

    /// Gap (3), y_P·z, y_P·x.
    pub(super) fn rows(&self) -> [f64; 5] {
        [self.gap[0], self.gap[1], self.gap[2], self.along, self.about]
    }
}
