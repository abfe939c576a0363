//! The pose of the table and of the spindle for given axis positions and places.

use nalgebra::{Matrix3, Vector3};

use super::{MAX_ROTARY, Machine, Places, Side};
use crate::pose::{Pose, rotation_xyz, sin_cos};

/// A joint of the chain at a posture: where it is, and about what each of its turns goes.
#[derive(Clone, Copy, Debug)]
pub struct Joint {
    /// Rotation of the frame that carries the joint: its columns are the directions of the offsets.
    pub carrier: Matrix3<f64>,
    /// Point that all turns of the joint go through, mm, machine frame.
    pub origin: Vector3<f64>,
    /// Axes of the tilts about X, Y, Z, unit vectors in the machine frame, as columns.
    pub tilts: Matrix3<f64>,
    /// Axis of the joint's own turn, machine frame.
    pub turn: Vector3<f64>,
}

impl Joint {
    const NONE: Self = Self {
        carrier: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        origin: Vector3::new(0.0, 0.0, 0.0),
        tilts: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        turn: Vector3::new(0.0, 0.0, 0.0),
    };

    /// n · velocity of `point` for a unit rate of each of the joint's three offsets, three tilts and
    /// its own turn: the geometric Jacobian, exact at any posture.
    #[must_use]
    pub fn rates(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> [f64; 7] {
        let offsets = self.carrier.tr_mul(normal);
        let moment = (point - self.origin).cross(normal);
        let tilts = self.tilts.tr_mul(&moment);
        let turn = self.turn.dot(&moment);
        [offsets.x, offsets.y, offsets.z, tilts.x, tilts.y, tilts.z, turn]
    }
}

/// A joint's frame with its errors, translate(offsets) R(tilts), in the frame that carries it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    offset: Vector3<f64>,
    rotation: Matrix3<f64>,
    /// Axes of the three tilts: x; then y after the turn about x; then z after both, which is the
    /// third column of Rx Ry Rz.
    tilts: Matrix3<f64>,
}

impl Frame {
    fn new(components: &[f64]) -> Self {
        let offset = Vector3::new(components[0], components[1], components[2]);
        let (alpha, beta, gamma) = (components[3], components[4], components[5]);
        if alpha == 0.0 && beta == 0.0 && gamma == 0.0 {
            return Self { offset, rotation: Matrix3::identity(), tilts: Matrix3::identity() };
        }
        let rotation = rotation_xyz(alpha, beta, gamma);
        let (sin, cos) = sin_cos(alpha);
        let after_x = Vector3::new(0.0, cos, sin);
        let tilts = Matrix3::from_columns(&[Vector3::x(), after_x, rotation.column(2).into()]);
        Self { offset, rotation, tilts }
    }

    /// Builds the frame onto `pose`, then a turn if there is one.
    fn extend(&self, pose: &mut Pose, turn: Option<(Vector3<f64>, Matrix3<f64>)>) -> Joint {
        let carrier = pose.rotation;
        let origin = pose.apply(&self.offset);
        let rotation = carrier * self.rotation;
        let (axis, rotation) = match turn {
            Some((unit, turned)) => (rotation * unit, rotation * turned),
            None => (Vector3::zeros(), rotation),
        };
        *pose = Pose { rotation, translation: origin };
        Joint { carrier, origin, tilts: carrier * self.tilts, turn: axis }
    }
}

/// The frames of all joints at some places: what postures with these places have in common.
#[derive(Clone, Copy, Debug)]
pub struct Frames {
    axes: [Frame; MAX_ROTARY],
    turns: [f64; MAX_ROTARY],
    placement: Frame,
}

impl Frames {
    /// The frames with the amounts at these places.
    #[must_use]
    pub fn new(places: &Places) -> Self {
        Self {
            axes: std::array::from_fn(|axis| Frame::new(places.frame(axis))),
            turns: std::array::from_fn(|axis| places.at(super::Place::turn(axis))),
            placement: Frame::new(places.placement()),
        }
    }
}

/// Poses of table, artefact and head at one set of axis positions.
#[derive(Clone, Debug)]
pub struct Posture {
    /// machine_from_table: T_A Rx(a) T_C Rz(c) for `trt-ca`.
    pub table: Pose,
    /// machine_from_artefact: the table's pose times the placement T_S.
    pub artefact: Pose,
    /// The head: machine directions from spindle directions; its points are counted from the
    /// nominal origin of its first axis' frame (the pivot).
    pub head: Pose,
    /// The tool point from there, with the head as it is.
    pub tool: Vector3<f64>,
    /// How far the tool point is from where the control with its nominal head has it, mm.
    pub head_shift: Vector3<f64>,
    /// How far the nominal head moves the tool point away from its place at zero, mm.
    pub head_nominal: Vector3<f64>,
    /// The joints of the rotary axes, in the machine's order.
    pub joints: [Joint; MAX_ROTARY],
    /// The joint of the placement.
    pub placement: Joint,
}

impl Posture {
    /// The posture of `machine` at `positions` (rad, one a rotary axis) with errors at `places`.
    #[must_use]
    pub fn new(machine: &Machine, positions: &[f64], places: &Places) -> Self {
        Self::with_frames(machine, positions, &Frames::new(places))
    }

    /// The posture of `machine` at `positions` (rad, one a rotary axis) with frames made before.
    #[must_use]
    pub fn with_frames(machine: &Machine, positions: &[f64], frames: &Frames) -> Self {
        let mut joints = [Joint::NONE; MAX_ROTARY];
        let mut table = Pose::identity();
        // Counted from the first frame of the head.
        let mut head = Pose::identity();
        let mut nominal_head = Pose::identity();
        for (axis, (rotary, position)) in machine.rotary().iter().zip(positions).enumerate() {
            let chain = match rotary.side {
                Side::Workpiece => &mut table,
                Side::Tool => &mut head,
            };
            let turn = rotary.rotation(position + frames.turns[axis]);
            joints[axis] = frames.axes[axis].extend(chain, Some((*rotary.direction(), turn)));
            if rotary.side == Side::Tool {
                let (rotation, translation) = (rotary.rotation(*position), *machine.offset(axis));
                nominal_head = nominal_head.then(&Pose { rotation, translation });
            }
        }
        if let Some(seat) = machine.seat() {
            table.translation += table.rotation * seat;
        }
        let mut artefact = table;
        let placement = frames.placement.extend(&mut artefact, None);
        let (tool, nominal) = (head.apply(machine.tool()), nominal_head.apply(machine.tool()));
        Self {
            table,
            artefact,
            head,
            tool,
            head_shift: tool - nominal,
            head_nominal: nominal - machine.tool_at_zero(),
            joints,
            placement,
        }
    }

    /// Where the ball (or tool point) really is, for the position the control records:
    /// (I + Λ) p + δ, and what the head's errors add.
    #[must_use]
    pub fn actual(&self, recorded: &Vector3<f64>, places: &Places) -> Vector3<f64> {
        let offset = places.offset();
        recorded
            + linear(places) * recorded
            + Vector3::new(offset[0], offset[1], offset[2])
            + self.head_shift
    }
}

/// Λ of the recorded position.
#[must_use]
pub fn linear(places: &Places) -> Matrix3<f64> {
    Matrix3::from_row_slice(places.linear())
}
