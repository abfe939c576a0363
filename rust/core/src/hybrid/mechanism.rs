//! The mechanism: dimensions, home, and what can be asked of them.

use nalgebra::Vector3;

use super::closure::Closure;
use super::geometry::Geometry;
use super::inverse::{NominalInverse, inverse, nominal_inverse};
use super::parameter::{ACTIVE, ERRORS, Errors, NO_CLOSED_FORM, PAPER, PASSIVE};
use super::posture::{Joints, ToolPose};
use super::solution::{Home, Solution};
use crate::{Error, Result};

/// A nominal mechanism: dimensions and a posture from which its branch is followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Mechanism {
    dimensions: [f64; ERRORS],
    home: Home,
}

impl Mechanism {
    /// Nominal e1 to e17 of the notes' example, mm and rad.
    #[must_use]
    pub fn example_dimensions() -> [f64; ERRORS] {
        PAPER.map(|(nominal, _)| nominal)
    }

    /// A mechanism from nominal e1 to e17 (mm, rad) and a tool point (mm) in the middle of its
    /// working space, where the tool is vertical: the posture there defines the assembly branch.
    ///
    /// # Errors
    /// A dimension that is not finite, or a home point where the loops do not close.
    pub fn new(dimensions: [f64; ERRORS], home_tip: Vector3<f64>) -> Result<Self> {
        for (i, value) in dimensions.iter().enumerate() {
            if !value.is_finite() {
                return Err(Error::input(
                    format!("dimension e{}", i + 1),
                    value,
                    "a finite length",
                ));
            }
        }
        let pose = ToolPose { tip: home_tip, direction: -Vector3::z() };
        let plain = closed_form(&dimensions);
        let start = nominal_inverse(&plain, &pose, 0.0)?;
        let [l1, l2, l3, ..] = start.active[0];
        let home = Home::new(&Geometry::new(&plain, &[]), start.passive, [l1, l2, l3]);
        if plain == dimensions {
            return Ok(Self { dimensions, home });
        }
        // Offsets that the closed form does not know (e1, e2, e3, e14) are closed by Newton.
        let geometry = Geometry::new(&dimensions, &[]);
        let closure = Closure::default();
        let closed = home.follow(&geometry, &[l1, l2, l3, 0.0, 0.0], &closure, None)?;
        Ok(Self { dimensions, home: Home::new(&geometry, closed.joints.passive, home.legs) })
    }

    /// The same without the offsets e1, e2, e3, e14, which have no closed-form inverse.
    pub(super) fn without_offsets(&self) -> Self {
        Self { dimensions: closed_form(&self.dimensions), home: self.home.clone() }
    }

    /// Nominal e1 to e17, mm and rad.
    #[must_use]
    pub const fn dimensions(&self) -> &[f64; ERRORS] {
        &self.dimensions
    }

    /// Passive joints at home, rad.
    #[must_use]
    pub const fn home(&self) -> &[f64; PASSIVE] {
        &self.home.passive
    }

    /// Leg lengths at home, mm.
    #[must_use]
    pub const fn home_legs(&self) -> &[f64; 3] {
        &self.home.legs
    }

    /// The mechanism with errors.
    #[must_use]
    pub fn with(&self, errors: &Errors) -> Geometry {
        Geometry::new(&self.dimensions, errors)
    }

    /// The posture at commanded legs and wrist with the loops closed in the weighted sense of
    /// `closure`, on the branch of the home posture.
    ///
    /// Newton goes straight from home. Where that does not arrive in short steps, the way from
    /// home (leg lengths in proportion) is followed in steps that are halved as need be.
    ///
    /// # Errors
    /// Commands that are not finite or legs not above zero; leg lengths out of reach; a posture
    /// that belongs to another branch; a singular posture.
    pub fn solve(
        &self,
        geometry: &Geometry,
        active: &[f64; ACTIVE],
        closure: &Closure,
    ) -> Result<Solution> {
        self.home.solve(geometry, active, closure, None)
    }

    /// The same where the joints of another solution may be nearer than home: Newton then starts
    /// there.
    ///
    /// # Errors
    /// As [`Mechanism::solve`].
    pub fn solve_near(
        &self,
        geometry: &Geometry,
        active: &[f64; ACTIVE],
        closure: &Closure,
        near: Option<&Joints>,
    ) -> Result<Solution> {
        self.home.solve(geometry, active, closure, near)
    }

    /// Closed-form inverse: needs e1 = e2 = e3 = e14 = 0 in the dimensions. q4 keeps `reference`
    /// (rad) where the tool lies on its axis.
    ///
    /// # Errors
    /// Dimensions that have no closed form; a direction that is not a unit vector (1e-6); a tool
    /// point above the base or on the singular lines of the legs.
    pub fn nominal_inverse(&self, pose: &ToolPose, reference: f64) -> Result<NominalInverse> {
        nominal_inverse(&self.dimensions, pose, reference)
    }

    /// Commands that bring the tool to `pose` on the machine with errors, from commands nearby (the
    /// nominal inverse): exact compensation by Newton's method on all five axes.
    ///
    /// # Errors
    /// As [`Mechanism::solve`]; a direction that is not a unit vector; a wrist so close to the tool
    /// axis that the direction cannot be reached by small turns.
    pub fn inverse(
        &self,
        geometry: &Geometry,
        pose: &ToolPose,
        start: &[f64; ACTIVE],
        closure: &Closure,
    ) -> Result<Solution> {
        inverse(&self.home, geometry, pose, start, closure)
    }
}

/// Dimensions without the offsets that have no closed-form inverse.
fn closed_form(dimensions: &[f64; ERRORS]) -> [f64; ERRORS] {
    let mut plain = *dimensions;
    for i in NO_CLOSED_FORM {
        plain[i] = 0.0;
    }
    plain
}
