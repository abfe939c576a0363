//! Forward kinematics of many poses with the same errors, several at once in the lanes of a vector
//! register: what does not depend on the axes is made once, and sines are taken four at a time.
//!
//! The same chain as [`Posture`](super::Posture), which gives one pose with everything around it;
//! the tests hold the two against each other.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, SimdComplexField, SimdPartialOrd, SimdValue, Vector3};
use simba::simd::WideF64x4;

use super::kinematics::MAX_AXES;
use super::links::{Link, Links};
use super::posture::linear;
use super::{Machine, Places, Side};
use crate::pose::{Direction, Pose};

type Lanes = WideF64x4;

/// Poses that are taken at once.
const LANES: usize = 4;

/// Numbers of a tool pose: point and direction.
pub const TOOL: usize = 6;

/// One number in every lane.
fn all(value: f64) -> Lanes {
    Lanes::splat(value)
}

/// p ↦ rotation p + offset in every lane.
#[derive(Clone, Copy)]
struct Constant {
    rotation: Matrix3<Lanes>,
    offset: Vector3<Lanes>,
}

impl From<Pose> for Constant {
    fn from(pose: Pose) -> Self {
        Self { rotation: pose.rotation.map(all), offset: pose.translation.map(all) }
    }
}

impl Constant {
    #[inline]
    fn apply(&self, point: &Vector3<Lanes>) -> Vector3<Lanes> {
        self.offset + self.rotation * point
    }

    #[inline]
    fn undo(&self, point: &Vector3<Lanes>) -> Vector3<Lanes> {
        self.rotation.tr_mul(&(point - self.offset))
    }
}

/// A rotary axis with what lies before its turn: p ↦ place Turn(position + turn) p.
struct Axis {
    index: usize,
    about: Direction,
    place: Constant,
    nominal: Option<Constant>,
    /// In quarter turns.
    turn: f64,
}

impl From<&Link> for Axis {
    fn from(link: &Link) -> Self {
        Self {
            index: link.axis,
            about: link.about,
            place: link.place.unwrap_or_else(Pose::identity).into(),
            nominal: link.nominal.map(Constant::from),
            turn: link.turn / FRAC_PI_2,
        }
    }
}

/// Forward kinematics with everything made that the poses have in common.
pub struct ForwardBatch {
    /// Tool point and direction of the spindle in the own frame of the head's last axis.
    tool: Vector3<Lanes>,
    spindle: Vector3<Lanes>,
    tool_at_zero: Vector3<Lanes>,
    /// From the spindle to the bed.
    head: Vec<Axis>,
    /// I + Λ, δ and the directions of the machine, as the first axis of the table has them: its
    /// frame does not depend on the axes.
    gain: Matrix3<Lanes>,
    offset: Vector3<Lanes>,
    directions: Matrix3<Lanes>,
    /// From the bed to the table.
    table: Vec<Axis>,
    /// Behind the table's last turn.
    end: Option<Constant>,
}

impl ForwardBatch {
    /// The machine with errors at `places`.
    #[must_use]
    pub fn new(machine: &Machine, places: &Places) -> Self {
        let [head, table] =
            [Side::Tool, Side::Workpiece].map(|side| Links::new(machine, side, places));
        let at_end = head.end.unwrap_or_else(Pose::identity);
        let axes: Vec<Axis> = table.all.iter().map(Axis::from).collect();
        let gain = (Matrix3::identity() + linear(places)).map(all);
        let offset = Vector3::from_column_slice(places.offset()).map(all);
        let (directions, origin) = axes.first().map_or_else(
            || (Matrix3::identity().map(all), Vector3::zeros().map(all)),
            |first| (first.place.rotation.transpose(), first.place.offset),
        );
        Self {
            tool: at_end.apply(machine.tool()).map(all),
            spindle: at_end.rotation.column(2).map(all),
            tool_at_zero: machine.tool_at_zero().map(all),
            head: head.all.iter().rev().map(Axis::from).collect(),
            gain: directions * gain,
            offset: directions * (offset - origin),
            directions,
            table: axes,
            end: table.end.map(Constant::from),
        }
    }

    /// Tool points and directions of poses.
    ///
    /// `poses` has a row of X, Y, Z in mm and a rotary position in degrees for each axis of the
    /// machine, `tools` gets as many rows of point in mm and direction. Rows that are missing on
    /// either side are left out. Degrees, since multiples of 90° are exact in them.
    pub fn tools(&self, poses: &[f64], tools: &mut [f64]) {
        match self.head.len() + self.table.len() {
            0 => self.rows::<3>(poses, tools),
            1 => self.rows::<4>(poses, tools),
            2 => self.rows::<5>(poses, tools),
            _ => self.rows::<MAX_AXES>(poses, tools),
        }
    }

    fn rows<const AXES: usize>(&self, poses: &[f64], tools: &mut [f64]) {
        let (poses, _) = poses.as_chunks::<AXES>();
        let (tools, _) = tools.as_chunks_mut::<TOOL>();
        let (lots, last) = poses.as_chunks::<LANES>();
        let (slots, rest) = tools.as_chunks_mut::<LANES>();
        for (lot, slot) in lots.iter().zip(slots) {
            self.lot(lot, slot);
        }
        // The last poses may not fill the lanes.
        let (mut lot, mut slot) = ([[0.0; AXES]; LANES], [[0.0; TOOL]; LANES]);
        lot.iter_mut().zip(last).for_each(|(row, pose)| *row = *pose);
        self.lot(&lot, &mut slot);
        rest.iter_mut().zip(slot).for_each(|(tool, value)| *tool = value);
    }

    /// Points less tool points of poses, along X, Y and Z of the machine as its errors have them.
    ///
    /// `poses` as of [`tools`](Self::tools), `points` in mm and in the frame of the table, `apart`
    /// gets as many rows in mm.
    pub fn apart(&self, poses: &[f64], points: &[f64], apart: &mut [f64]) {
        match self.head.len() + self.table.len() {
            0 => self.apart_rows::<3>(poses, points, apart),
            1 => self.apart_rows::<4>(poses, points, apart),
            2 => self.apart_rows::<5>(poses, points, apart),
            _ => self.apart_rows::<MAX_AXES>(poses, points, apart),
        }
    }

    fn apart_rows<const AXES: usize>(&self, poses: &[f64], points: &[f64], apart: &mut [f64]) {
        let (poses, _) = poses.as_chunks::<AXES>();
        let (points, _) = points.as_chunks::<3>();
        let (apart, _) = apart.as_chunks_mut::<3>();
        let lots = poses.chunks(LANES).zip(points.chunks(LANES));
        for ((some, places), slots) in lots.zip(apart.chunks_mut(LANES)) {
            // The last poses may not fill the lanes.
            let (mut lot, mut there) = ([[0.0; AXES]; LANES], [[0.0; 3]; LANES]);
            lot.iter_mut().zip(some).for_each(|(row, pose)| *row = *pose);
            there.iter_mut().zip(places).for_each(|(row, place)| *row = *place);
            let (mut tool, _) = self.before_table(&lot);
            let mut along = [0, 1, 2].map(|k| self.gain.column(k).into_owned());
            self.through_table(&lot, &mut tool, &mut along);
            let there = Vector3::from_fn(|k, _| Lanes::from(there.map(|row| row[k])));
            for (k, way) in along.iter().enumerate() {
                let value: [f64; LANES] = way.dot(&(there - tool)).into();
                slots.iter_mut().zip(value).for_each(|(slot, value)| slot[k] = value);
            }
        }
    }

    /// As many poses as there are lanes.
    #[inline]
    fn lot<const AXES: usize>(
        &self,
        poses: &[[f64; AXES]; LANES],
        tools: &mut [[f64; TOOL]; LANES],
    ) {
        let (mut point, direction) = self.before_table(poses);
        let mut directions = [direction];
        self.through_table(poses, &mut point, &mut directions);
        for (k, value) in point.iter().chain(&directions[0]).enumerate() {
            let value: [f64; LANES] = (*value).into();
            tools.iter_mut().zip(value).for_each(|(tool, value)| tool[k] = value);
        }
    }

    /// Tool point and direction as the first axis of the table has them.
    #[inline]
    fn before_table<const AXES: usize>(
        &self,
        poses: &[[f64; AXES]; LANES],
    ) -> (Vector3<Lanes>, Vector3<Lanes>) {
        let column = |k: usize| Lanes::from(poses.map(|pose| pose[k]));
        let quarters = |axis: &Axis| column(3 + axis.index) * all(1.0 / 90.0);
        let linear = Vector3::new(column(0), column(1), column(2));
        if self.head.is_empty() {
            let point = self.gain * linear + self.offset;
            return (point, self.directions.column(2).into_owned());
        }
        let (mut real, mut nominal) = (self.tool, self.tool);
        let mut spindle = self.spindle;
        for axis in &self.head {
            nominal = turned(axis.about, sin_cos(quarters(axis)), &nominal);
            if let Some(place) = &axis.nominal {
                nominal = place.apply(&nominal);
            }
            let turn = sin_cos(quarters(axis) + all(axis.turn));
            real = axis.place.apply(&turned(axis.about, turn, &real));
            spindle = axis.place.rotation * turned(axis.about, turn, &spindle);
        }
        let point = self.gain * (linear + nominal - self.tool_at_zero)
            + self.offset
            + self.directions * (real - nominal);
        (point, self.directions * spindle)
    }

    /// Takes a point and directions from the first axis of the table to the table.
    #[inline]
    fn through_table<const AXES: usize, const N: usize>(
        &self,
        poses: &[[f64; AXES]; LANES],
        point: &mut Vector3<Lanes>,
        directions: &mut [Vector3<Lanes>; N],
    ) {
        for (i, axis) in self.table.iter().enumerate() {
            if i > 0 {
                *point = axis.place.undo(point);
                for direction in &mut *directions {
                    *direction = axis.place.rotation.tr_mul(direction);
                }
            }
            let quarters = Lanes::from(poses.map(|pose| pose[3 + axis.index])) * all(1.0 / 90.0);
            let (sin, cos) = sin_cos(quarters + all(axis.turn));
            *point = turned(axis.about, (-sin, cos), point);
            for direction in &mut *directions {
                *direction = turned(axis.about, (-sin, cos), direction);
            }
        }
        if let Some(end) = &self.end {
            *point = end.undo(point);
            for direction in directions {
                *direction = end.rotation.tr_mul(direction);
            }
        }
    }
}

/// A right-handed turn about one of the machine's directions.
#[inline]
fn turned(about: Direction, turn: (Lanes, Lanes), vector: &Vector3<Lanes>) -> Vector3<Lanes> {
    match about {
        Direction::X => in_plane::<1, 2>(turn, vector),
        Direction::Y => in_plane::<2, 0>(turn, vector),
        Direction::Z => in_plane::<0, 1>(turn, vector),
    }
}

#[inline]
fn in_plane<const I: usize, const J: usize>(
    (sin, cos): (Lanes, Lanes),
    vector: &Vector3<Lanes>,
) -> Vector3<Lanes> {
    let mut turned = *vector;
    turned[I] = cos * vector[I] - sin * vector[J];
    turned[J] = sin * vector[I] + cos * vector[J];
    turned
}

/// Sine and cosine of quarter turns, exact at whole ones as [`crate::pose::sin_cos`] is.
#[inline]
fn sin_cos(quarters: Lanes) -> (Lanes, Lanes) {
    let whole = nearest(quarters);
    let (sin, cos) = sin_cos_small((quarters - whole) * all(FRAC_PI_2));
    // Quarter turns modulo four: −2 or 2, −1, 0, 1.
    let quarter = whole - all(4.0) * nearest(whole * all(0.25));
    let odd = quarter.simd_abs().simd_eq(all(1.0));
    let (s, c) = (cos.select(odd, sin), sin.select(odd, cos));
    let sin_sign = quarter.simd_lt(all(0.0)) | quarter.simd_gt(all(1.5));
    let cos_sign = quarter.simd_gt(all(0.0)) | quarter.simd_lt(all(-1.5));
    ((-s).select(sin_sign, s), (-c).select(cos_sign, c))
}

/// The nearest whole number: adding 1.5 · 2⁵² leaves no room for a fraction.
#[inline]
fn nearest(value: Lanes) -> Lanes {
    let shift = all(6_755_399_441_055_744.0);
    (value + shift) - shift
}

/// Sine and cosine of at most 45°: Taylor's series, whose rest is below 5e-17 there.
#[inline]
fn sin_cos_small(x: Lanes) -> (Lanes, Lanes) {
    let square = x * x;
    // ± 1/n! from the last term on.
    let series = |terms: [f64; 7]| {
        terms.into_iter().fold(all(0.0), |sum, factorial| sum * square + all(1.0 / factorial))
    };
    let sin = series([
        -1_307_674_368_000.0, // 15!
        6_227_020_800.0,
        -39_916_800.0,
        362_880.0,
        -5_040.0,
        120.0,
        -6.0,
    ]);
    let cos = series([
        20_922_789_888_000.0, // 16!
        -87_178_291_200.0,
        479_001_600.0,
        -3_628_800.0,
        40_320.0,
        -720.0,
        24.0,
    ]);
    let cos = square * square * cos + (all(1.0) - all(0.5) * square);
    (x + x * square * sin, cos)
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::AxisPositions;
    use super::super::{Place, examples};
    use super::*;
    use crate::units::DEG;

    #[test]
    fn many_poses_are_the_same_as_one() {
        for machine in examples(120.0) {
            let mut places = machine.nominal();
            for (i, error) in machine.location_errors().iter().enumerate() {
                machine.add_location_error(&mut places, error, 1e-4 * (1.0 + i as f64));
            }
            places.add(Place::linear(Direction::X, Direction::Y), 1e-5);
            places.add(Place::offset(Direction::Z), 1e-3);
            places.add(Place::turn(1), 1e-4);
            let many = ForwardBatch::new(&machine, &places);
            for base in [0.0, 0.7, -1.5, 2.9, -40.0] {
                let poses: [AxisPositions; 2 * LANES + 3] =
                    std::array::from_fn(|i| AxisPositions {
                        linear: Vector3::new(10.0, -20.0, 30.0) * (1.0 + i as f64),
                        rotary: [base + 0.9 * i as f64, 1.0 - 1.7 * i as f64, 0.0],
                    });
                let row = |p: &AxisPositions| {
                    [p.linear.x, p.linear.y, p.linear.z, p.rotary[0] / DEG, p.rotary[1] / DEG]
                };
                let rows: Vec<f64> = poses.iter().flat_map(row).collect();
                let mut tools = vec![0.0; TOOL * poses.len()];
                many.tools(&rows, &mut tools);
                for (pose, other) in poses.iter().zip(tools.chunks(TOOL)) {
                    let one = machine.forward(pose, &places);
                    let (point, direction) = other.split_at(3);
                    assert!((one.point - Vector3::from_row_slice(point)).norm() < 1e-11);
                    assert!((one.direction - Vector3::from_row_slice(direction)).norm() < 1e-13);
                }
                let points: Vec<f64> = (0..3 * poses.len()).map(|i| 7.0 - i as f64).collect();
                let mut apart = vec![0.0; points.len()];
                many.apart(&rows, &points, &mut apart);
                for (i, found) in apart.chunks(3).enumerate() {
                    let at = |pose: &AxisPositions| machine.forward(pose, &places).point;
                    let away = Vector3::from_row_slice(&points[3 * i..3 * i + 3]) - at(&poses[i]);
                    for (k, component) in found.iter().enumerate() {
                        let mut ahead = poses[i];
                        ahead.linear[k] += 1.0;
                        let along = at(&ahead) - at(&poses[i]);
                        assert!((along.dot(&away) - component).abs() < 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn sines_are_those_of_one_angle_and_quarter_turns_exact() {
        for step in -2000..2000 {
            let angles: [f64; LANES] =
                std::array::from_fn(|lane| f64::from(step) * 0.75 + 90.0 * lane as f64);
            let (sin, cos) = sin_cos(Lanes::from(angles) * all(1.0 / 90.0));
            for (lane, angle) in angles.into_iter().map(|deg| deg * DEG).enumerate() {
                let (s, c) = crate::pose::sin_cos(angle);
                let (sin, cos) = (sin.extract(lane), cos.extract(lane));
                // One rounding of the angle and two of the polynomial.
                let close = 4e-16 + angle.abs() * f64::EPSILON;
                assert!((sin - s).abs() < close && (cos - c).abs() < close, "{angle}: {sin} {s}");
                if s == 0.0 || c == 0.0 {
                    assert!(sin == s && cos == c, "{angle}");
                }
            }
        }
    }
}
