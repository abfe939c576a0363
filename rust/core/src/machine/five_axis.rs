//! A machine with two rotary axes and constant errors, resolved once: closed forms both ways that
//! allocate nothing, for loops that ask for one pose after another.
//!
//! ```text
//! p_part = T⁻¹ [(I + Λ) (x + h) + δ + H],   T = Π T_i Rot_i(q_i) of the table
//! o_part = K₂ Rot₂(q₂) K₁ Rot₁(q₁) k₀        spindle direction, its first axis first
//! ```
//!
//! h is what the nominal head moves the tool point, H what its errors add. The same chain as
//! [`Posture`](super::Posture), which gives one pose with everything around it; the tests hold the two
//! against each other.

use nalgebra::{Matrix3, Vector3};

use super::kinematics::wrap;
use super::links::{Directions, Links, direction, in_plane, turn};
use super::posture::linear;
use super::{Machine, Places, Side};
use crate::pose::Pose;
use crate::{Error, Result};

/// A machine with two rotary axes, resolved. Positions are X, Y, Z (mm) and those of the rotary axes
/// (rad) in the machine's order.
#[derive(Clone, Debug, PartialEq)]
pub struct FiveAxis {
    letters: [char; 5],
    /// From the bed to the table.
    table: Links,
    /// Axis and a point of it in the table's frame, of the axis that carries it, where they are not
    /// those of the frame.
    carrier: Option<[Vector3<f64>; 2]>,
    /// From the bed to the spindle.
    head: Links,
    /// Tool point in the own frame of the head's last axis.
    tool: Vector3<f64>,
    tool_at_zero: Vector3<f64>,
    /// Direction of the spindle there; None: Z.
    spindle: Option<Vector3<f64>>,
    /// I + Λ and its inverse where Λ is not zero.
    gain: Option<[Matrix3<f64>; 2]>,
    offset: Vector3<f64>,
    directions: Directions,
}

/// The machine at one pair of rotary positions.
#[derive(Clone, Copy, Debug)]
pub struct Configuration<'a> {
    machine: &'a FiveAxis,
    /// Machine from part.
    pub table: Pose,
    head: Option<Head>,
}

/// The head at one pair of rotary positions.
#[derive(Clone, Copy, Debug)]
struct Head {
    /// Direction of the spindle, machine frame.
    spindle: Vector3<f64>,
    /// H.
    shift: Vector3<f64>,
    /// h.
    nominal: Vector3<f64>,
    /// What a unit rate of each axis does to the tool point as it is and as the control has it.
    rates: [[Vector3<f64>; 2]; 2],
}

/// Closer than this to the second axis (sine of the angle) a tool leaves that axis undetermined.
pub const POLE: f64 = 1e-12;

impl FiveAxis {
    /// A machine with errors at `places`.
    ///
    /// # Errors
    /// Another number of rotary axes than two, the one nearer to the spindle parallel to it, or I + Λ
    /// singular.
    pub fn new(machine: &Machine, places: &Places) -> Result<Self> {
        let links = |side: Side| Links::new(machine, side, places);
        let (table, head) = (links(Side::Workpiece), links(Side::Tool));
        let directions = Directions::new(machine, &table, &head)?;
        let lambda = linear(places);
        let gain = if lambda == Matrix3::zeros() {
            None
        } else {
            let gain = Matrix3::identity() + lambda;
            let inverse = gain.try_inverse().ok_or_else(|| {
                let message = "errors of the linear axes leave no inverse: I + Λ is singular";
                Error::Kinematics(message.into())
            })?;
            Some([gain, inverse])
        };
        let letter = |axis: usize| machine.rotary()[axis].letter();
        Ok(Self {
            letters: ['X', 'Y', 'Z', letter(0), letter(1)],
            carrier: table.end.zip(table.all.last()).map(|(end, last)| {
                [end.rotation.tr_mul(&last.about.unit()), end.undo(&Vector3::zeros())]
            }),
            table,
            tool: head.end.map_or(*machine.tool(), |end| end.apply(machine.tool())),
            tool_at_zero: *machine.tool_at_zero(),
            spindle: head.end.map(|end| end.rotation.column(2).into()),
            head,
            gain,
            offset: Vector3::from_column_slice(places.offset()),
            directions,
        })
    }

    /// Letters of the five axes, in the order of their positions.
    #[must_use]
    pub const fn letters(&self) -> &[char; 5] {
        &self.letters
    }

    /// Which rotary axis is not determined where the tool lies along it: 0 or 1.
    #[must_use]
    pub const fn free_axis(&self) -> usize {
        self.directions.axes[1]
    }

    /// Length of the part of a direction, part's frame, that is square to that axis.
    #[must_use]
    pub fn off_pole(&self, direction: &Vector3<f64>) -> f64 {
        let d = self.directions.before_second(direction);
        let (_, [x, y]) = in_plane(self.directions.second, &d);
        x.hypot(y)
    }

    /// The machine at rotary positions (rad).
    #[must_use]
    #[inline]
    pub fn at(&self, rotary: &[f64; 2]) -> Configuration<'_> {
        let mut links = self.table.all.iter();
        let mut table = links.next().map_or_else(Pose::identity, |first| first.start(rotary));
        for link in links {
            link.extend(&mut table, rotary);
        }
        if let Some(end) = &self.table.end {
            table = table.then(end);
        }
        let head = if self.head.all.is_empty() { None } else { Some(self.head_at(rotary)) };
        Configuration { machine: self, table, head }
    }

    fn head_at(&self, rotary: &[f64; 2]) -> Head {
        let (mut real, mut nominal) = (Pose::identity(), Pose::identity());
        let mut axes = [[(Vector3::zeros(), Vector3::zeros()); 2]; 2];
        for link in &self.head.all {
            link.extend(&mut real, rotary);
            if let Some(nominal_place) = &link.nominal {
                nominal = nominal.then(nominal_place);
            }
            turn(&mut nominal.rotation, link.about, rotary[link.axis]);
            // A turn leaves its own axis where it is.
            axes[link.axis] =
                [&real, &nominal].map(|p| (direction(&p.rotation, link.about), p.translation));
        }
        let tools = [real.apply(&self.tool), nominal.apply(&self.tool)];
        let rate = |axis: usize, which: usize| -> Vector3<f64> {
            let (along, through) = axes[axis][which];
            along.cross(&(tools[which] - through))
        };
        Head {
            spindle: match &self.spindle {
                None => real.rotation.column(2).into(),
                Some(spindle) => real.rotation * spindle,
            },
            shift: tools[0] - tools[1],
            nominal: tools[1] - self.tool_at_zero,
            rates: [0, 1].map(|axis| [rate(axis, 0), rate(axis, 1)]),
        }
    }

    /// Rotary positions for a unit tool direction in the part's frame, on the branch with the axis
    /// nearer to the spindle from its base up (`positive`; A ≥ 0 on a `trt-ca`) or down; the other one
    /// within half a turn of `near`.
    ///
    /// Where the tool lies along the second axis, that is `near`. With errors, directions within the
    /// cone of the axes' tilts (arcseconds wide) cannot be taken: the nearest one is.
    #[must_use]
    #[inline]
    pub fn rotary(&self, tool: &Vector3<f64>, near: f64, positive: bool) -> [f64; 2] {
        let ends = &self.directions;
        let d = ends.before_second(tool);
        let (along, [x, y]) = in_plane(ends.second, &d);
        let square = x * x + y * y;
        let opening = ends.opening(along, square);
        let first = ends.base + if positive { opening } else { -opening };
        let mut out = [0.0; 2];
        let [i, j] = ends.axes;
        out[i] = first - ends.turns[0];
        out[j] = near;
        if square >= POLE * POLE {
            let (sin, cos) = first.sin_cos();
            let (_, [mx, my]) =
                in_plane(ends.second, &(ends.still + ends.even * cos + ends.odd * sin));
            let second = ends.sign * (mx * y - my * x).atan2(mx * x + my * y) - ends.turns[1];
            out[j] = near + wrap(second - near);
        }
        out
    }

    /// Positions for a tool point and unit direction in the part's frame, on the positive branch, the
    /// free axis within half a turn of `near`.
    ///
    /// # Errors
    /// A point or direction that is not finite.
    pub fn inverse(
        &self,
        point: &Vector3<f64>,
        tool: &Vector3<f64>,
        near: f64,
    ) -> Result<[f64; 5]> {
        if !(point.iter().chain(tool.iter()).all(|v| v.is_finite())) {
            return Err(Error::Kinematics(format!(
                "inverse kinematics: point {point:?} and tool axis {tool:?} are not finite"
            )));
        }
        let rotary = self.rotary(tool, near, true);
        let p = self.at(&rotary).to_linear(point);
        Ok([p.x, p.y, p.z, rotary[0], rotary[1]])
    }

    /// Tool point and unit direction in the part's frame.
    #[must_use]
    pub fn forward(&self, positions: &[f64; 5]) -> (Vector3<f64>, Vector3<f64>) {
        let [x, y, z, first, second] = *positions;
        let at = self.at(&[first, second]);
        (at.to_part(&Vector3::new(x, y, z)), at.tool())
    }
}

impl Configuration<'_> {
    /// Where the tool point really is, machine frame, with the linear axes at these positions.
    #[inline]
    fn actual(&self, linear: &Vector3<f64>) -> Vector3<f64> {
        let recorded = self.head.map_or(*linear, |head| linear + head.nominal);
        let moved = self.machine.gain.map_or(recorded, |[gain, _]| gain * recorded);
        let shift = self.machine.offset + moved;
        self.head.map_or(shift, |head| shift + head.shift)
    }

    #[inline]
    fn commanded(&self, displacement: Vector3<f64>) -> Vector3<f64> {
        self.machine.gain.map_or(displacement, |[_, inverse]| inverse * displacement)
    }

    /// X, Y, Z that bring the tool point to a point of the part, mm.
    #[must_use]
    #[inline]
    pub fn to_linear(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let actual = self.table.apply(point) - self.machine.offset;
        match &self.head {
            None => self.commanded(actual),
            Some(head) => self.commanded(actual - head.shift) - head.nominal,
        }
    }

    /// The tool point on the part for X, Y, Z, mm.
    #[must_use]
    #[inline]
    pub fn to_part(&self, linear: &Vector3<f64>) -> Vector3<f64> {
        self.table.undo(&self.actual(linear))
    }

    /// Unit tool direction in the part's frame.
    #[must_use]
    #[inline]
    pub fn tool(&self) -> Vector3<f64> {
        match &self.head {
            None => self.table.rotation.row(2).transpose(),
            Some(head) => self.table.rotation.tr_mul(&head.spindle),
        }
    }

    /// Displacement of the tool point on the part by one of X, Y, Z.
    #[must_use]
    pub fn part_displacement(&self, linear: &Vector3<f64>) -> Vector3<f64> {
        let moved = self.machine.gain.map_or(*linear, |[gain, _]| gain * linear);
        self.table.rotation.tr_mul(&moved)
    }

    /// Displacement of X, Y, Z that takes the tool point along a displacement on the part.
    #[must_use]
    #[inline]
    pub fn linear_displacement(&self, part: &Vector3<f64>) -> Vector3<f64> {
        self.commanded(self.table.rotation * part)
    }

    /// How X, Y, Z have to follow a unit rate of each rotary axis so that the tool point, now at
    /// these X, Y, Z, stays where it is on the part, mm/rad: the two last columns of J⁻¹.
    #[must_use]
    #[inline]
    pub fn rates(&self, linear: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let mut rates = [Vector3::zeros(); 2];
        if let Some(head) = &self.head {
            for (rate, [real, nominal]) in rates.iter_mut().zip(head.rates) {
                *rate = self.commanded(nominal - real) - nominal;
            }
        }
        let actual = self.actual(linear);
        for (number, link) in self.machine.table.all.iter().enumerate() {
            // The first axis of the table stands still; the last one goes with the table, and its own
            // turn leaves it where it is.
            let (axis, point) = match (number, &self.machine.carrier) {
                (0, _) => (link.bed_axis, link.bed_point),
                (_, None) => (direction(&self.table.rotation, link.about), self.table.translation),
                (_, Some([axis, point])) => (self.table.rotation * axis, self.table.apply(point)),
            };
            rates[link.axis] = self.commanded(axis.cross(&(actual - point)));
        }
        rates
    }

    /// J⁻¹ v: displacement on the part (mm) and of the rotary axes (rad) to displacement of all axes,
    /// at these X, Y, Z.
    #[must_use]
    #[inline]
    pub fn inverse_jacobian(&self, linear: &Vector3<f64>, v: &[f64; 5]) -> [f64; 5] {
        let [first, second] = self.rates(linear);
        let part = Vector3::new(v[0], v[1], v[2]);
        let p = self.linear_displacement(&part) + first * v[3] + second * v[4];
        [p.x, p.y, p.z, v[3], v[4]]
    }
}

#[cfg(test)]
mod tests {
    use super::super::examples;
    use super::super::kinematics::{AxisPositions, Tool};
    use super::*;
    use crate::machine::Place;
    use crate::pose::Direction;

    const POSES: [[f64; 2]; 5] = [[0.3, 0.4], [1.1, -2.0], [1e-5, 3.0], [0.9, -3.1], [1.5, 1.0]];

    /// Every preset without errors, with location errors, and with errors of the linear axes as well.
    fn machines() -> Vec<(Machine, Places, FiveAxis)> {
        let mut all = Vec::new();
        for machine in examples(120.0) {
            let mut places = machine.nominal();
            for stage in 0..3 {
                for (i, error) in machine.location_errors().iter().enumerate() {
                    let amount = if stage == 1 { 1e-4 * (i as f64 - 3.5) } else { 0.0 };
                    machine.add_location_error(&mut places, error, amount);
                }
                if stage == 2 {
                    places.add(Place::linear(Direction::X, Direction::Y), 1e-5);
                    places.add(Place::linear(Direction::Z, Direction::Z), -2e-5);
                    places.add(Place::offset(Direction::Z), 1e-3);
                    places.add(Place::turn(1), 1e-4);
                }
                let five = FiveAxis::new(&machine, &places).unwrap();
                all.push((machine.clone(), places, five));
            }
        }
        all
    }

    #[test]
    fn it_is_the_general_machine_in_closed_form() {
        for (machine, places, five) in machines() {
            for [a, c] in POSES {
                let linear = Vector3::new(10.0, -20.0, 30.0);
                let general =
                    machine.forward(&AxisPositions { linear, rotary: [a, c, 0.0] }, &places);
                let (p, o) = five.forward(&[10.0, -20.0, 30.0, a, c]);
                assert!((general.point - p).norm() < 1e-12, "{:?} {a} {c}", five.letters);
                assert!((general.direction - o).norm() < 1e-13, "{:?} {a} {c}", five.letters);
            }
        }
    }

    #[test]
    fn forward_undoes_inverse_and_newton_agrees() {
        for (machine, places, five) in machines() {
            let direction = Vector3::new(0.3, -0.2, 0.9).normalize();
            let tool = Tool { point: Vector3::new(30.0, -10.0, 20.0), direction };
            let ours = five.inverse(&tool.point, &direction, 0.0).unwrap();
            let (p, o) = five.forward(&ours);
            assert!((p - tool.point).norm() < 1e-12 && (o - direction).norm() < 1e-14);
            let start = AxisPositions {
                linear: Vector3::new(ours[0] + 0.1, ours[1], ours[2]),
                rotary: [ours[3] + 1e-3, ours[4] - 1e-3, 0.0],
            };
            let newton = machine.inverse_with_errors(&tool, &start, &places).unwrap();
            assert!((newton.rotary[0] - ours[3]).abs() < 1e-12, "{:?}", five.letters);
            assert!((newton.rotary[1] - ours[4]).abs() < 1e-12, "{:?}", five.letters);
            for [a, c] in POSES {
                let axes = [10.0, -20.0, 30.0, a, c];
                let (p, o) = five.forward(&axes);
                let again = five.inverse(&p, &o, axes[3 + five.free_axis()]).unwrap();
                let (p2, o2) = five.forward(&again);
                assert!((p - p2).norm() < 1e-12 && (o - o2).norm() < 1e-12, "{axes:?}");
            }
        }
    }

    #[test]
    fn the_inverse_jacobian_agrees_with_central_differences() {
        for (_, _, five) in machines() {
            for rotary in POSES {
                let here = Vector3::new(10.0, -20.0, 30.0);
                let at = five.at(&rotary);
                let p = at.to_part(&here);
                for i in 0..5 {
                    let mut unit = [0.0; 5];
                    unit[i] = 1.0;
                    let exact = at.inverse_jacobian(&here, &unit);
                    let step = 1e-5;
                    let moved = |sign: f64| {
                        let (mut part, mut rotary) = (p, rotary);
                        if i < 3 {
                            part[i] += sign * step;
                        } else {
                            rotary[i - 3] += sign * step;
                        }
                        five.at(&rotary).to_linear(&part)
                    };
                    let differenced = (moved(1.0) - moved(-1.0)) / (2.0 * step);
                    let exact = Vector3::new(exact[0], exact[1], exact[2]);
                    assert!(
                        (exact - differenced).norm() < 1e-7,
                        "{:?} {rotary:?} {i}",
                        five.letters
                    );
                    let back = at.part_displacement(&at.linear_displacement(&p));
                    assert!((back - p).norm() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn a_vertical_tool_holds_c_and_c_does_not_jump_by_a_turn() {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 120.0).unwrap();
        let five = FiveAxis::new(&machine, &Places::default()).unwrap();
        let up = five.inverse(&Vector3::new(1.0, 2.0, 3.0), &Vector3::z(), 0.8).unwrap();
        assert_eq!([up[3], up[4]], [0.0, 0.8]);
        let tilted = Vector3::new(-1e-3, -1.0, 1.0).normalize();
        let [_, c] = five.rotary(&tilted, 3.2, true);
        assert!((c - (std::f64::consts::PI + 1e-3)).abs() < 1e-9, "{c}");
    }
}
