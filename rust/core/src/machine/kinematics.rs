//! Forward kinematics, inverse kinematics and the exact Jacobian, for programs in work coordinates.
//!
//! A program gives the tool point and the direction of the tool (from its point to the spindle) in
//! the workpiece's frame; the machine takes positions of X, Y, Z in mm and of its rotary axes in
//! rad. At zero of all axes the tool point is in the origin of the machine frame.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::posture::linear;
use super::{FiveAxis, MAX_ROTARY, Machine, Places, Posture, Side};
use crate::pose::nearest;
use crate::units::DEG;
use crate::{Error, Result};

/// Most axes: three linear ones and the rotary ones.
pub const MAX_AXES: usize = 3 + MAX_ROTARY;

/// Tool point and direction in the workpiece's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tool {
    /// Tool point in mm.
    pub point: Vector3<f64>,
    /// Unit vector from the tool point towards the spindle.
    pub direction: Vector3<f64>,
}

/// Axis positions that reach a tool pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisPositions {
    /// X, Y, Z in mm.
    pub linear: Vector3<f64>,
    /// Rotary positions in rad, in the machine's order.
    pub rotary: [f64; MAX_ROTARY],
}

impl AxisPositions {
    const fn rotary_pair(&self) -> [f64; 2] {
        [self.rotary[0], self.rotary[1]]
    }
}

/// Both branches of the inverse kinematics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branches {
    /// First with the tilt on the positive side, then with it on the negative side.
    pub positions: [AxisPositions; 2],
    /// Whether the tool is parallel to the second rotary axis: that axis is then free, and has been
    /// left where the caller's reference has it.
    pub singular: bool,
}

/// Tools closer than this to the singular direction count as singular, rad: below it the position
/// of the free axis is rounding noise.
pub const SINGULAR_RAD: f64 = 1e-9;

impl Machine {
    /// Tool point and direction for axis positions, with errors at `places`.
    #[must_use]
    pub fn forward(&self, positions: &AxisPositions, places: &Places) -> Tool {
        let posture = Posture::new(self, &positions.rotary[..self.rotary().len()], places);
        Self::tool_at(&posture, &positions.linear, places)
    }

    fn tool_at(posture: &Posture, linear_axes: &Vector3<f64>, places: &Places) -> Tool {
        let recorded = linear_axes + posture.head_nominal;
        let spindle = posture.head.rotation * Vector3::z();
        Tool {
            point: posture.table.undo(&posture.actual(&recorded, places)),
            direction: posture.table.rotation.tr_mul(&spindle),
        }
    }

    /// Tool pose and its exact derivative: rows are the point (mm) and the direction, columns X, Y,
    /// Z and the rotary axes (per mm, per rad).
    #[must_use]
    pub fn forward_jacobian(
        &self,
        positions: &AxisPositions,
        places: &Places,
    ) -> (Tool, SMatrix<f64, 6, MAX_AXES>) {
        let rotary = &positions.rotary[..self.rotary().len()];
        let posture = Posture::new(self, rotary, places);
        let tool = Self::tool_at(&posture, &positions.linear, places);
        let to_work = posture.table.rotation.transpose();
        let gain = Matrix3::identity() + linear(places);
        let mut jacobian = SMatrix::<f64, 6, MAX_AXES>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(to_work * gain));
        let actual = posture.table.apply(&tool.point);
        let spindle = posture.head.rotation * Vector3::z();
        let nominal = Posture::new(self, rotary, &self.nominal());
        for (axis, rotary) in self.rotary().iter().enumerate() {
            let joint = &posture.joints[axis];
            let (point, direction) = match rotary.side {
                Side::Workpiece => {
                    let arm = actual - joint.origin;
                    (-joint.turn.cross(&arm), -joint.turn.cross(&spindle))
                }
                Side::Tool => {
                    let nominal_joint = &nominal.joints[axis];
                    let assumed = nominal_joint.turn.cross(&(nominal.tool - nominal_joint.origin));
                    let real = joint.turn.cross(&(posture.tool - joint.origin));
                    (real + linear(places) * assumed, joint.turn.cross(&spindle))
                }
            };
            jacobian.fixed_view_mut::<3, 1>(0, 3 + axis).copy_from(&(to_work * point));
            jacobian.fixed_view_mut::<3, 1>(3, 3 + axis).copy_from(&(to_work * direction));
        }
        (tool, jacobian)
    }

    /// X, Y, Z that bring the tool point to `point` (workpiece frame) at these rotary positions, on
    /// the machine with errors at `places`: compensation by the linear axes alone, exact.
    ///
    /// # Errors
    /// I + Λ is singular.
    pub fn linear_axes_for(
        &self,
        point: &Vector3<f64>,
        rotary: &[f64],
        places: &Places,
    ) -> Result<Vector3<f64>> {
        let posture = Posture::new(self, rotary, places);
        let offset = places.offset();
        let target = posture.table.apply(point)
            - posture.head_shift
            - Vector3::new(offset[0], offset[1], offset[2]);
        let gain = Matrix3::identity() + linear(places);
        let recorded = gain.try_inverse().map(|inverse| inverse * target).ok_or_else(|| {
            Error::Kinematics(
                "errors of the linear axes leave no inverse: I + Λ is singular".into(),
            )
        })?;
        Ok(recorded - posture.head_nominal)
    }

    /// Axis positions of the nominal machine for a tool pose: both branches, rotary positions in
    /// (−π, π]. Where the tool is parallel to the second rotary axis (A = 0 on a `trt-ca`), that
    /// axis keeps its position in `reference` and `singular` is set.
    ///
    /// # Errors
    /// Another number of rotary axes than two, a direction that the machine cannot take, or one
    /// that is not a unit vector (1e-6).
    pub fn inverse(&self, tool: &Tool, reference: &[f64]) -> Result<Branches> {
        let resolved = FiveAxis::new(self, &self.nominal())?;
        let norm = tool.direction.norm();
        if norm.is_nan() || (norm - 1.0).abs() > 1e-6 {
            return Err(Error::input("length of the tool direction", norm, "1 within 1e-6"));
        }
        let direction = tool.direction / norm;
        let free = resolved.free_axis();
        let singular = resolved.off_pole(&direction) < SINGULAR_RAD;
        let mut positions = [true, false].map(|positive| {
            let mut rotary = resolved.rotary(&direction, 0.0, positive).map(wrap);
            if singular {
                rotary[free] = reference.get(free).copied().unwrap_or(0.0);
            }
            let linear = resolved.at(&rotary).to_linear(&tool.point);
            AxisPositions { linear, rotary: [rotary[0], rotary[1], 0.0] }
        });
        let missed = resolved.at(&positions[0].rotary_pair()).tool() - direction;
        if missed.norm() > REACHED_RAD {
            return Err(Error::Kinematics(format!(
                "no positions of axes {} and {} give the tool direction {:?}: the nearest that this \
                 machine can take is {:.3}° off",
                self.rotary()[0].letter(),
                self.rotary()[1].letter(),
                direction.as_slice(),
                missed.norm() / DEG
            )));
        }
        // The branch with the axis nearer to the spindle on its positive side comes first.
        let tilt = 1 - free;
        if positions[0].rotary[tilt] < positions[1].rotary[tilt] {
            positions.swap(0, 1);
        }
        Ok(Branches { positions, singular })
    }

    /// Axis positions that reach a tool pose on the machine with errors at `places`, from a start
    /// nearby (the nominal branch): exact inverse compensation by Newton's method on all axes.
    ///
    /// # Errors
    /// No convergence: the pose is singular (the direction of the second rotary axis) or out of
    /// reach of this machine.
    pub fn inverse_with_errors(
        &self,
        tool: &Tool,
        start: &AxisPositions,
        places: &Places,
    ) -> Result<AxisPositions> {
        let mut positions = *start;
        let axes = 3 + self.rotary().len();
        let mut last = f64::INFINITY;
        for _ in 0..50 {
            let (now, jacobian) = self.forward_jacobian(&positions, places);
            let mut miss = SVector::<f64, 6>::zeros();
            miss.fixed_rows_mut::<3>(0).copy_from(&(tool.point - now.point));
            miss.fixed_rows_mut::<3>(3).copy_from(&(tool.direction - now.direction));
            // Weight directions by 100 mm, so that both parts are lengths at the work.
            miss.fixed_rows_mut::<3>(3).scale_mut(LEVER_MM);
            let size = miss.norm();
            if !size.is_finite() {
                break; // a pose, or a place on the way to it, beyond what a double holds
            }
            if size < TOLERANCE_MM {
                return Ok(positions);
            }
            // Newton has come to rest above rounding: no pose of this machine does better.
            if size > 0.5 * last && last < 1e-6 {
                break;
            }
            last = size;
            let mut weighted = jacobian;
            weighted.fixed_rows_mut::<3>(3).scale_mut(LEVER_MM);
            let columns = weighted.columns(0, axes).clone_owned();
            let step = columns
                .svd(true, true)
                .solve(&miss, 1e-12 * LEVER_MM)
                .map_err(|error| Error::Kinematics(error.to_owned()))?;
            for k in 0..3 {
                positions.linear[k] += step[k];
            }
            for k in 3..axes {
                // A turn beyond a radian says that the start is on the wrong side of a singularity.
                positions.rotary[k - 3] += step[k].clamp(-1.0, 1.0);
            }
        }
        if last < REST_MM {
            return Ok(positions);
        }
        let [x, y, z]: [f64; 3] = tool.direction.into();
        Err(Error::Kinematics(format!(
            "no axis positions reach the tool direction ({x:.6}, {y:.6}, {z:.6}) on the machine \
             with its errors: {last:.3e} mm left at {LEVER_MM} mm; the direction lies in the cone \
             that the tilted rotary axes cannot take, or the start is too far away"
        )))
    }
}

/// Directions that are closer (rad) are the same.
const REACHED_RAD: f64 = 1e-7;
const LEVER_MM: f64 = 100.0;
const TOLERANCE_MM: f64 = 1e-12;
const REST_MM: f64 = 1e-9;

/// Into (−π, π].
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle - turn * nearest(angle / turn);
    if wrapped <= -std::f64::consts::PI { wrapped + turn } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::super::examples;
    use super::*;

    fn places(machine: &Machine, size: f64) -> Places {
        let mut places = machine.nominal();
        for (i, error) in machine.location_errors().iter().enumerate() {
            machine.add_location_error(&mut places, error, size * (1.0 + i as f64));
        }
        places
    }

    fn positions(x: f64, y: f64, z: f64, q: [f64; 2]) -> AxisPositions {
        AxisPositions { linear: Vector3::new(x, y, z), rotary: [q[0], q[1], 0.0] }
    }

    #[test]
    fn inverse_undoes_forward_on_one_of_both_branches() {
        for machine in examples(120.0) {
            let preset = machine.code();
            for q in [[0.7, 2.0], [-0.4, -2.9], [1.5, 0.2], [-1.2, 1.0], [1e-6, 0.3]] {
                let there = positions(10.0, -20.0, 30.0, q);
                let tool = machine.forward(&there, &machine.nominal());
                let branches = machine.inverse(&tool, &[0.0, 0.0]).unwrap();
                assert!(!branches.singular);
                let best = branches
                    .positions
                    .iter()
                    .map(|b| {
                        let turn: f64 = (0..2).map(|k| wrap(b.rotary[k] - q[k]).abs()).sum();
                        (b.linear - there.linear).norm() + turn
                    })
                    .fold(f64::INFINITY, f64::min);
                // The angle about the spindle is worth 1/sin(tilt).
                assert!(best < 1e-9, "{preset} {q:?}: {best}");
                for branch in &branches.positions {
                    let again = machine.forward(branch, &machine.nominal());
                    assert!((again.point - tool.point).norm() < 1e-11, "{preset} {q:?}");
                    assert!((again.direction - tool.direction).norm() < 1e-12, "{preset}");
                }
            }
        }
    }

    #[test]
    fn a_vertical_tool_is_singular_and_keeps_the_reference() {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 120.0).unwrap();
        let tool = Tool { point: Vector3::new(1.0, 2.0, 3.0), direction: Vector3::z() };
        let branches = machine.inverse(&tool, &[0.0, 0.8]).unwrap();
        assert!(branches.singular);
        assert_eq!(branches.positions[0].rotary[..2], [0.0, 0.8]);
        let again = machine.forward(&branches.positions[1], &machine.nominal());
        assert!((again.point - tool.point).norm() < 1e-12);
    }

    #[test]
    fn the_jacobian_agrees_with_central_differences() {
        for machine in examples(120.0) {
            let preset = machine.code();
            let places = places(&machine, 1e-3);
            let here = positions(10.0, -20.0, 30.0, [0.7, 2.0]);
            let (_, jacobian) = machine.forward_jacobian(&here, &places);
            for k in 0..5 {
                let step = 1e-5;
                let mut sides = [here, here];
                for (side, sign) in sides.iter_mut().zip([1.0, -1.0]) {
                    if k < 3 {
                        side.linear[k] += sign * step;
                    } else {
                        side.rotary[k - 3] += sign * step;
                    }
                }
                let [plus, minus] = sides.map(|side| machine.forward(&side, &places));
                let point = (plus.point - minus.point) / (2.0 * step);
                let direction = (plus.direction - minus.direction) / (2.0 * step);
                let column = jacobian.column(k);
                assert!((point - column.fixed_rows::<3>(0)).norm() < 1e-7, "{preset} {k}");
                assert!((direction - column.fixed_rows::<3>(3)).norm() < 1e-9, "{preset} {k}");
            }
        }
    }

    #[test]
    fn the_inverse_of_the_erroneous_machine_reaches_the_pose() {
        for machine in examples(120.0) {
            let preset = machine.code();
            let places = places(&machine, 1e-4);
            let direction = Vector3::new(0.3, -0.2, 0.9).normalize();
            let tool = Tool { point: Vector3::new(30.0, -10.0, 20.0), direction };
            for start in machine.inverse(&tool, &[0.0, 0.0]).unwrap().positions {
                let reached = machine.inverse_with_errors(&tool, &start, &places).unwrap();
                let again = machine.forward(&reached, &places);
                assert!((again.point - tool.point).norm() < 1e-9, "{preset}");
                assert!((again.direction - tool.direction).norm() < 1e-11, "{preset}");
                let linear =
                    machine.linear_axes_for(&tool.point, &start.rotary[..2], &places).unwrap();
                let moved = AxisPositions { linear, ..start };
                let again = machine.forward(&moved, &places);
                assert!((again.point - tool.point).norm() < 1e-11, "{preset}");
            }
        }
    }
}
