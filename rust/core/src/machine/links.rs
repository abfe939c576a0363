//! The links of a chain with constant errors, and the equations of the spindle's direction.

use nalgebra::{Matrix3, Vector3};

use super::{Machine, Place, Places};
use crate::pose::{Direction, Pose, rotation_xyz, sin_cos};
use crate::{Error, Result};

/// A rotary axis in its chain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Link {
    pub(super) axis: usize,
    pub(super) about: Direction,
    /// Its errors; nothing where it has none.
    pub(super) place: Option<Pose>,
    /// Its axis and a point of it where it is carried by the bed.
    pub(super) bed_axis: Vector3<f64>,
    pub(super) bed_point: Vector3<f64>,
    /// Added to its position, rad.
    pub(super) turn: f64,
}

impl Link {
    pub(super) fn new(axis: usize, about: Direction, places: &Places) -> Self {
        let f = places.frame(axis);
        let errors = Pose {
            rotation: rotation_xyz(f[3], f[4], f[5]),
            translation: Vector3::new(f[0], f[1], f[2]),
        };
        let place = (errors != Pose::identity()).then_some(errors);
        let bed_axis = direction(&errors.rotation, about);
        let turn = places.at(Place::turn(axis));
        Self { axis, about, place, bed_axis, bed_point: errors.translation, turn }
    }

    /// The pose of what a first link carries.
    #[inline]
    pub(super) fn start(&self, rotary: &[f64; 2]) -> Pose {
        let angle = rotary[self.axis] + self.turn;
        match self.place {
            None => Pose { rotation: self.about.rotation(angle), ..Pose::identity() },
            Some(mut pose) => {
                turn(&mut pose.rotation, self.about, angle);
                pose
            }
        }
    }

    /// Builds the link onto the pose that carries it.
    #[inline]
    pub(super) fn extend(&self, pose: &mut Pose, rotary: &[f64; 2]) {
        if let Some(place) = &self.place {
            *pose = pose.then(place);
        }
        turn(&mut pose.rotation, self.about, rotary[self.axis] + self.turn);
    }

    fn tilt(&self) -> Matrix3<f64> {
        self.place.map_or_else(Matrix3::identity, |place| place.rotation)
    }
}

/// Equations of the spindle's direction: what they have in common for all directions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Directions {
    /// Number of the axis nearer to the spindle and of the other one.
    pub(super) axes: [usize; 2],
    /// What the positions leave out: turns of the axes as errors, rad.
    pub(super) turns: [f64; 2],
    /// K₂ where it is not the identity.
    pub(super) after: Option<Matrix3<f64>>,
    /// Direction of the second axis, and the sign with which it turns the tool in the part's frame.
    pub(super) second: Direction,
    pub(super) sign: f64,
    /// m(q₁) = K₁ Rot₁(q₁) k₀ = still + even cos q₁ + odd sin q₁.
    pub(super) still: Vector3<f64>,
    pub(super) even: Vector3<f64>,
    pub(super) odd: Vector3<f64>,
    /// Parts of the spindle and of the second axis along the first.
    pub(super) along: [f64; 2],
    /// q₁ at which the tool lies nearest to the second axis.
    pub(super) base: f64,
}

impl Directions {
    pub(super) fn new(machine: &Machine, table: &[Link], head: &[Link]) -> Result<Self> {
        // From the spindle outwards: the spindle's direction meets the head's last axis first, and on
        // the table's side the axis next to the bed.
        let mut constant = Matrix3::identity();
        let mut met: Vec<(&Link, f64, Matrix3<f64>)> = Vec::new();
        for link in head.iter().rev() {
            met.push((link, 1.0, constant));
            constant = link.tilt();
        }
        for link in table {
            met.push((link, -1.0, link.tilt().transpose() * constant));
            constant = Matrix3::identity();
        }
        let [(first, first_sign, spindle), (second, sign, between)] = met[..] else {
            return Err(Self::refused(machine));
        };
        if first.about == Direction::Z {
            return Err(Self::refused(machine));
        }
        let k0: Vector3<f64> = spindle.column(2).into();
        let axis = first.about.unit() * first_sign;
        let r = between.tr_mul(&second.about.unit());
        let (k, r_along) = (axis.dot(&k0), axis.dot(&r));
        let even = k0 - axis * k;
        let odd = axis.cross(&k0);
        Ok(Self {
            axes: [first.axis, second.axis],
            turns: [first.turn, second.turn],
            after: (constant != Matrix3::identity()).then_some(constant),
            second: second.about,
            sign,
            still: between * (axis * k),
            even: between * even,
            odd: between * odd,
            along: [k, r_along],
            base: r.dot(&odd).atan2(r.dot(&even)),
        })
    }

    fn refused(machine: &Machine) -> Error {
        let letters: Vec<String> =
            machine.rotary().iter().map(|axis| axis.letter().to_string()).collect();
        Error::Kinematics(format!(
            "inverse kinematics: got rotary axes {}, expected two, the one nearer to the spindle not \
             parallel to it",
            letters.join(", ")
        ))
    }

    #[inline]
    pub(super) fn before_second(&self, tool: &Vector3<f64>) -> Vector3<f64> {
        self.after.map_or(*tool, |after| after.tr_mul(tool))
    }
}

/// R Rot(about, angle).
#[inline]
pub(super) fn turn(rotation: &mut Matrix3<f64>, about: Direction, angle: f64) {
    let turn = sin_cos(angle);
    match about {
        Direction::X => combine::<1, 2>(rotation, turn),
        Direction::Y => combine::<2, 0>(rotation, turn),
        Direction::Z => combine::<0, 1>(rotation, turn),
    }
}

/// A turn combines two columns.
#[inline]
fn combine<const I: usize, const J: usize>(rotation: &mut Matrix3<f64>, (sin, cos): (f64, f64)) {
    for row in 0..3 {
        let (a, b) = (rotation[(row, I)], rotation[(row, J)]);
        rotation[(row, I)] = a * cos + b * sin;
        rotation[(row, J)] = b * cos - a * sin;
    }
}

/// A direction of a rotated frame.
#[inline]
pub(super) fn direction(rotation: &Matrix3<f64>, about: Direction) -> Vector3<f64> {
    match about {
        Direction::X => rotation.column(0).into(),
        Direction::Y => rotation.column(1).into(),
        Direction::Z => rotation.column(2).into(),
    }
}

/// Part of a vector along a direction, and in the plane square to it.
#[inline]
pub(super) fn in_plane(about: Direction, v: &Vector3<f64>) -> (f64, [f64; 2]) {
    match about {
        Direction::X => (v.x, [v.y, v.z]),
        Direction::Y => (v.y, [v.z, v.x]),
        Direction::Z => (v.z, [v.x, v.y]),
    }
}
