//! The links of a chain with constant errors, and the equations of the spindle's direction.

use nalgebra::{Matrix3, Vector3};

use super::{Machine, Place, Places, Side, is_parallel};
use crate::pose::{Direction, Pose, rotation_xyz, sin_cos};
use crate::{Error, Result};

/// A rotary axis in its chain. What lies between the turns of two axes is constant: the errors of
/// the outer one, and the rotations from the inner axis' own frame and to the outer one's.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Link {
    pub(super) axis: usize,
    pub(super) about: Direction,
    /// What lies before its turn; None: nothing.
    pub(super) place: Option<Pose>,
    /// The same without errors, of an axis of the head.
    pub(super) nominal: Option<Pose>,
    /// Its axis and a point of it where it is carried by the bed.
    pub(super) bed_axis: Vector3<f64>,
    pub(super) bed_point: Vector3<f64>,
    /// Added to its position, rad.
    pub(super) turn: f64,
}

/// The links of one side of a machine from the bed outwards, and what lies behind the last turn.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Links {
    pub(super) all: Vec<Link>,
    pub(super) end: Option<Pose>,
}

impl Links {
    pub(super) fn new(machine: &Machine, side: Side, places: &Places) -> Self {
        let mut all = Vec::new();
        // Undoes the rotation from the own frame of the axis before.
        let mut undone = Matrix3::identity();
        for (axis, rotary) in machine.rotary().iter().enumerate() {
            if rotary.side != side {
                continue;
            }
            let own = rotary.own().copied().unwrap_or_else(Matrix3::identity);
            let constant = |rotation: Matrix3<f64>, translation: Vector3<f64>| Pose {
                rotation: undone * rotation * own,
                translation: undone * translation,
            };
            let f = places.frame(axis);
            let tilts = rotation_xyz(f[3], f[4], f[5]);
            let errors = constant(tilts, Vector3::new(f[0], f[1], f[2]));
            let nominal = constant(Matrix3::identity(), *machine.offset(axis));
            let about = rotary.about();
            all.push(Link {
                axis,
                about,
                place: some(errors),
                nominal: some(nominal),
                bed_axis: direction(&errors.rotation, about),
                bed_point: errors.translation,
                turn: places.at(Place::turn(axis)),
            });
            undone = own.transpose();
        }
        let seat = match side {
            Side::Workpiece => machine.seat().copied().unwrap_or_default(),
            Side::Tool => Vector3::zeros(),
        };
        Self { all, end: some(Pose { rotation: undone, translation: undone * seat }) }
    }
}

fn some(pose: Pose) -> Option<Pose> {
    (pose != Pose::identity()).then_some(pose)
}

impl Link {
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

/// Cosines between the axes above which half angles are needed: errors stay far below.
const OBLIQUE: f64 = 0.1;

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
    /// Angles of the spindle and of the second axis to the first (rad), where one of them is far
    /// from a right angle.
    pub(super) oblique: Option<[f64; 2]>,
    /// q₁ at which the tool lies nearest to the second axis.
    pub(super) base: f64,
}

impl Directions {
    pub(super) fn new(machine: &Machine, table: &Links, head: &Links) -> Result<Self> {
        // From the spindle outwards: the spindle's direction meets the head's last axis first, and on
        // the table's side the axis next to the bed.
        let behind = |links: &Links| links.end.map_or_else(Matrix3::identity, |end| end.rotation);
        let mut constant = behind(head);
        let mut met: Vec<(&Link, f64, Matrix3<f64>)> = Vec::new();
        for link in head.all.iter().rev() {
            met.push((link, 1.0, constant));
            constant = link.tilt();
        }
        for link in &table.all {
            met.push((link, -1.0, link.tilt().transpose() * constant));
            constant = Matrix3::identity();
        }
        constant = behind(table).transpose() * constant;
        let [(first, first_sign, spindle), (second, sign, between)] = met[..] else {
            return Err(Self::refused(machine));
        };
        if is_parallel(machine.rotary()[first.axis].direction(), &Vector3::z()) {
            return Err(Self::refused(machine));
        }
        let k0: Vector3<f64> = spindle.column(2).into();
        let axis = first.about.unit() * first_sign;
        let r = between.tr_mul(&second.about.unit());
        let (k, r_along) = (axis.dot(&k0), axis.dot(&r));
        let even = k0 - axis * k;
        let odd = axis.cross(&k0);
        let r_off = (r - axis * r_along).norm();
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
            oblique: (k.abs().max(r_along.abs()) > OBLIQUE)
                .then(|| [even.norm().atan2(k), r_off.atan2(r_along)]),
            base: r.dot(&odd).atan2(r.dot(&even)),
        })
    }

    /// How far the first axis turns from its base so that the tool has this part along the second
    /// axis and the square of this part square to it.
    #[inline]
    pub(super) fn opening(&self, along: f64, square: f64) -> f64 {
        let Some([kappa, rho]) = self.oblique else {
            // p cos q₁ + q sin q₁ = along - k r. p² + q² - (along - k r)² without cancellation near
            // the pole:
            let [k, r] = self.along;
            let rest = square - r * r - k * k + 2.0 * along * k * r;
            return rest.max(0.0).sqrt().atan2(along - k * r);
        };
        // cos κ cos ρ + sin κ sin ρ cos φ = cos θ in half angles, which cancel nowhere.
        let theta = square.sqrt().atan2(along);
        let half = |angle: f64| (0.5 * angle).sin();
        let sin = half(theta + kappa - rho) * half(theta - kappa + rho);
        let cos = half(kappa + rho + theta) * half(kappa + rho - theta);
        2.0 * sin.max(0.0).sqrt().atan2(cos.max(0.0).sqrt())
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
