//! Frames and twists of the mechanism at given joints. Every derivative of this room is a twist:
//! the velocity with which a joint or an error moves everything behind it.

use nalgebra::{Matrix3, SVector, Vector3};

use super::geometry::Geometry;
use super::parameter::{ACTIVE, PASSIVE, PLACES, Parameter, Place, Source};
use crate::machine::Component;
use crate::pose::{Direction, Pose};

/// All joints that define a posture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joints {
    /// Y = [u1, v1, u2, v2, φ, w2, u3, v3], rad.
    pub passive: [f64; PASSIVE],
    /// Commanded L1, L2, L3 (mm), q4, q5 (rad); zero offsets are added by the geometry.
    pub active: [f64; ACTIVE],
}

/// Where the tool shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPose {
    /// Tool point, mm.
    pub tip: Vector3<f64>,
    /// Unit vector from the spindle to the tool point; (0, 0, −1) is a vertical tool.
    pub direction: Vector3<f64>,
}

/// Velocity field of a rigid body: v(p) = shift + turn × p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Twist {
    pub turn: Vector3<f64>,
    pub shift: Vector3<f64>,
}

impl Twist {
    fn slide(direction: Vector3<f64>) -> Self {
        Self { turn: Vector3::zeros(), shift: direction }
    }

    fn turn(axis: Vector3<f64>, through: &Vector3<f64>) -> Self {
        Self { turn: axis, shift: through.cross(&axis) }
    }

    pub fn at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.shift + self.turn.cross(point)
    }

    fn scaled(&self, by: f64) -> Self {
        Self { turn: self.turn * by, shift: self.shift * by }
    }
}

/// What a twist moves. Loop 0 closes at leg 1, loop 1 at leg 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// The lower end of leg 1 or 3.
    Leg(usize),
    /// Leg 2's end, and with it platform, wrist and tool.
    Central,
    /// The seat of the revolute of leg 1 or 3 in the platform.
    Seat(usize),
    /// The tool only.
    Wrist,
}

/// The mechanism at given joints: frames where the loops meet, the tool, and all twists.
#[derive(Clone, Debug)]
pub struct Posture {
    /// Lower ends of legs 1 and 3, from the base; y is the axis of the revolute.
    pub(super) ends: [Pose; 2],
    /// Seats of those revolutes, through leg 2 and the platform.
    pub(super) seats: [Pose; 2],
    /// Platform.
    pub platform: Pose,
    /// Tool: origin at the tool point, z from the point to the spindle.
    pub tool: Pose,
    pub(super) passive: [Twist; PASSIVE],
    pub(super) active: [Twist; ACTIVE],
    /// Frame before each place's displacement (`Platform(1)`: the platform's own frame).
    before: [Pose; PLACES],
}

const CENTRAL: usize = 1;
/// Leg of each loop.
pub(super) const LOOP_LEGS: [usize; 2] = [0, 2];

fn shifted(frame: &Pose, by: &Vector3<f64>) -> Pose {
    Pose { rotation: frame.rotation, translation: frame.apply(by) }
}

fn turned(frame: &Pose, direction: Direction, angle: f64) -> Pose {
    // Columns are combined in place: a turn touches only two of the three.
    let (s, c) = angle.sin_cos();
    let mut rotation = frame.rotation;
    let (i, j) = match direction {
        Direction::X => (1, 2),
        Direction::Y => (2, 0),
        Direction::Z => (0, 1),
    };
    let (a, b): (Vector3<f64>, Vector3<f64>) =
        (frame.rotation.column(i).into(), frame.rotation.column(j).into());
    rotation.set_column(i, &(a * c + b * s));
    rotation.set_column(j, &(b * c - a * s));
    Pose { rotation, translation: frame.translation }
}

fn axis(frame: &Pose, direction: Direction) -> Vector3<f64> {
    frame.rotation.column(direction.index()).into()
}

fn turn_twist(frame: &Pose, direction: Direction) -> Twist {
    Twist::turn(axis(frame, direction), &frame.translation)
}

impl Posture {
    /// Frames at `joints`; the loops need not be closed.
    #[must_use]
    pub fn new(geometry: &Geometry, joints: &Joints) -> Self {
        let still = Twist::slide(Vector3::zeros());
        let base = Pose::identity();
        let mut posture = Self {
            ends: [base; 2],
            seats: [base; 2],
            platform: base,
            tool: base,
            passive: [still; PASSIVE],
            active: [still; ACTIVE],
            before: [base; PLACES],
        };
        let y = &joints.passive;
        let q: [f64; ACTIVE] = std::array::from_fn(|k| joints.active[k] + geometry.offsets[k]);
        for (side, leg) in LOOP_LEGS.into_iter().enumerate() {
            let angle = 6 * side;
            let frame = posture.universal(geometry, leg, [angle, angle + 1], y);
            let frame = posture.slide(leg, &frame, q[leg]);
            posture.ends[side] = posture.displace(geometry, Place::End(leg), &frame);
        }
        let frame = posture.universal(geometry, CENTRAL, [2, 3], y);
        posture.passive[4] = turn_twist(&frame, Direction::Z);
        let frame = turned(&frame, Direction::Z, y[4]);
        let frame = posture.slide(CENTRAL, &frame, q[CENTRAL]);
        let frame = posture.displace(geometry, Place::End(CENTRAL), &frame);
        posture.passive[5] = turn_twist(&frame, Direction::X);
        let seat = turned(&frame, Direction::X, y[5]);
        // The platform from the seat of its central revolute: the displacement undone.
        let seat_in_platform = &geometry.places[Place::Platform(CENTRAL).index()];
        let rotation = match &seat_in_platform.rotation {
            Some(tilt) => seat.rotation * tilt.transpose(),
            None => seat.rotation,
        };
        posture.platform =
            Pose { rotation, translation: seat.translation - rotation * seat_in_platform.shift };
        let platform = posture.platform;
        posture.before[Place::Platform(CENTRAL).index()] = platform;
        for (side, leg) in LOOP_LEGS.into_iter().enumerate() {
            posture.seats[side] = posture.displace(geometry, Place::Platform(leg), &platform);
        }
        let frame = posture.displace(geometry, Place::Wrist4, &platform);
        posture.active[3] = turn_twist(&frame, Direction::Z);
        let frame = turned(&frame, Direction::Z, q[3]);
        let frame = posture.displace(geometry, Place::Wrist5, &frame);
        posture.active[4] = turn_twist(&frame, Direction::X);
        let frame = turned(&frame, Direction::X, q[4]);
        posture.tool = posture.displace(geometry, Place::Tool, &frame);
        posture
    }

    #[inline(always)] // 18 times a posture; as a call it costs a tenth of a solution
    fn displace(&mut self, geometry: &Geometry, place: Place, frame: &Pose) -> Pose {
        let index = place.index();
        self.before[index] = *frame;
        let displacement = &geometry.places[index];
        let moved = shifted(frame, &displacement.shift);
        match &displacement.rotation {
            Some(tilt) => Pose { rotation: moved.rotation * tilt, ..moved },
            None => moved,
        }
    }

    /// Base, u, cross, v, leg.
    fn universal(
        &mut self,
        geometry: &Geometry,
        leg: usize,
        [u, v]: [usize; 2],
        y: &[f64; PASSIVE],
    ) -> Pose {
        let frame = self.displace(geometry, Place::Base(leg), &Pose::identity());
        self.passive[u] = turn_twist(&frame, Direction::X);
        let frame = turned(&frame, Direction::X, y[u]);
        let frame = self.displace(geometry, Place::Cross(leg), &frame);
        self.passive[v] = turn_twist(&frame, Direction::Y);
        let frame = turned(&frame, Direction::Y, y[v]);
        self.displace(geometry, Place::Leg(leg), &frame)
    }

    fn slide(&mut self, leg: usize, frame: &Pose, length: f64) -> Pose {
        let along = -axis(frame, Direction::Z);
        self.active[leg] = Twist::slide(along);
        Pose { rotation: frame.rotation, translation: frame.translation + along * length }
    }

    /// Turn of the revolute at the end of leg 1 or 3.
    pub(super) fn revolute(&self, side: usize) -> Twist {
        turn_twist(&self.ends[side], Direction::Y)
    }

    /// The tool point, mm.
    #[must_use]
    pub const fn tip(&self) -> &Vector3<f64> {
        &self.tool.translation
    }

    /// Unit vector from the spindle to the tool point.
    #[must_use]
    pub fn direction(&self) -> Vector3<f64> {
        -axis(&self.tool, Direction::Z)
    }

    pub(super) const fn passive_reach(joint: usize) -> Reach {
        match joint {
            0 | 1 => Reach::Leg(0),
            6 | 7 => Reach::Leg(1),
            _ => Reach::Central,
        }
    }

    pub(super) const fn active_reach(joint: usize) -> Reach {
        match joint {
            0 => Reach::Leg(0),
            1 => Reach::Central,
            2 => Reach::Leg(1),
            _ => Reach::Wrist,
        }
    }

    const fn place_reach(place: Place) -> Reach {
        match place {
            Place::Base(1) | Place::Cross(1) | Place::Leg(1) | Place::End(1) => Reach::Central,
            Place::Base(leg) | Place::Cross(leg) | Place::Leg(leg) | Place::End(leg) => {
                Reach::Leg(leg / 2)
            }
            Place::Platform(1) => Reach::Central,
            Place::Platform(leg) => Reach::Seat(leg / 2),
            Place::Wrist4 | Place::Wrist5 | Place::Tool => Reach::Wrist,
        }
    }

    fn place_twist(&self, geometry: &Geometry, place: Place, component: Component) -> Twist {
        let frame = &self.before[place.index()];
        let displacement = &geometry.places[place.index()];
        // Moving the central seat in the platform by δ moves the platform by −δ.
        let sign = if place == Place::Platform(CENTRAL) { -1.0 } else { 1.0 };
        match component {
            Component::Offset(direction) => Twist::slide(axis(frame, direction) * sign),
            Component::Tilt(direction) => {
                // R(a, b, c) = Rx(a) Ry(b) Rz(c): b turns about y after a, c about z after both.
                let [a, b] = [displacement.tilt.x, displacement.tilt.y];
                let axis = match direction {
                    Direction::X => Vector3::x(),
                    Direction::Y => Direction::X.rotation(a) * Vector3::y(),
                    Direction::Z => {
                        let after: Matrix3<f64> =
                            Direction::X.rotation(a) * Direction::Y.rotation(b);
                        after * Vector3::z()
                    }
                };
                Twist::turn(frame.rotation * axis * sign, &frame.apply(&displacement.shift))
            }
        }
    }

    /// Calls `visit` with each twist of a parameter and what it moves.
    pub(super) fn parameter_twists(
        &self,
        geometry: &Geometry,
        parameter: Parameter,
        mut visit: impl FnMut(&Twist, Reach),
    ) {
        match (parameter, parameter.source()) {
            (_, Some(Source::Joint(joint))) => {
                visit(&self.active[joint], Self::active_reach(joint));
            }
            (_, Some(Source::Places(terms))) => {
                for (place, component, sign) in terms {
                    let twist = self.place_twist(geometry, *place, *component).scaled(*sign);
                    visit(&twist, Self::place_reach(*place));
                }
            }
            (Parameter::Outside(place, component), None) => {
                visit(&self.place_twist(geometry, place, component), Self::place_reach(place));
            }
            (Parameter::Paper(_), None) => {}
        }
    }

    /// Velocity of the tool point along a direction under a twist.
    pub(super) fn tip_velocity(
        &self,
        twist: &Twist,
        reach: Reach,
        direction: &Vector3<f64>,
    ) -> f64 {
        match reach {
            Reach::Central | Reach::Wrist => twist.at(self.tip()).dot(direction),
            Reach::Leg(_) | Reach::Seat(_) => 0.0,
        }
    }

    /// Velocity of the tool point and angular velocity of the tool under a twist.
    pub(super) fn tool_velocity(&self, twist: &Twist, reach: Reach) -> SVector<f64, 6> {
        let mut velocity = SVector::<f64, 6>::zeros();
        if matches!(reach, Reach::Central | Reach::Wrist) {
            velocity.fixed_rows_mut::<3>(0).copy_from(&twist.at(self.tip()));
            velocity.fixed_rows_mut::<3>(3).copy_from(&twist.turn);
        }
        velocity
    }
}
