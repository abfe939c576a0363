//! The table-tilting machine as the control loop needs it: closed forms that allocate nothing.
//!
//! The chain of [`crate::machine`] for `trt-ca`, with the two constant poses T_A and T_C taken from
//! there once, so that signs and names of location errors have one home:
//!
//! ```text
//! p_machine = T_A Rx(a) T_C Rz(c) p_part,   axes x, y, z = p_machine
//! O: T_A Rx(a) T_C Rz(c) O = (0, 0, 1)
//! ```
//!
//! Without errors this is P_m = Q p with Q = Rx(a) Rz(c), O = (sin a sin c, sin a cos c, cos a). An
//! offset of the part on the table is a shift of the path. The branch is the paper's: A from 0 up.

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result};
use crate::machine::kinematics::wrap;
use crate::machine::{Machine as Chain, Places};
use crate::pose::{Pose, rotation_xyz};

/// Forward, inverse and Jacobian of a tilting rotary table, in closed form.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// T_A: where the A axis is.
    tilt: Pose,
    /// T_C: where the C axis is on the A axis.
    turn: Pose,
    /// Direction of the spindle in the frame of T_A.
    spindle: Vector3<f64>,
    nominal: bool,
}

/// The rotation of the table and what depends on it, at one pair of rotary positions.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Q: turns directions of the part into directions of the machine.
    pub rotation: Matrix3<f64>,
    /// Translation of the table, mm.
    translation: Vector3<f64>,
    /// Direction of the A axis (constant) and a point of it, machine frame.
    tilt_axis: Vector3<f64>,
    tilt_point: Vector3<f64>,
    /// Direction of the C axis and a point of it, machine frame.
    turn_axis: Vector3<f64>,
    turn_point: Vector3<f64>,
}

/// Distance of a unit tool axis from the C axis, as a number, below which C is not determined.
pub const POLE: f64 = 1e-12;

impl Machine {
    /// The machine without errors.
    #[must_use]
    pub fn nominal() -> Self {
        Self {
            tilt: Pose::identity(),
            turn: Pose::identity(),
            spindle: Vector3::z(),
            nominal: true,
        }
    }

    /// The machine `trt-ca` with the location errors at `places`.
    ///
    /// # Errors
    /// The chain is not A carrying C under the table.
    pub fn new(chain: &Chain, places: &Places) -> Result<Self> {
        let letters: String = chain.rotary().iter().map(crate::machine::Rotary::letter).collect();
        let table = chain.rotary().iter().all(|axis| axis.side == crate::machine::Side::Workpiece);
        if letters != "AC" || !table {
            let got = format!("rotary axes {letters}");
            return Err(Error::input("machine of the contouring loop", got, "trt-ca"));
        }
        let pose = |axis: usize| {
            let f = places.frame(axis);
            Pose {
                rotation: rotation_xyz(f[3], f[4], f[5]),
                translation: Vector3::new(f[0], f[1], f[2]),
            }
        };
        let (tilt, turn) = (pose(0), pose(1));
        let nominal = tilt == Pose::identity() && turn == Pose::identity();
        let spindle = tilt.rotation.tr_mul(&Vector3::z());
        Ok(Self { tilt, turn, spindle, nominal })
    }

    /// The machine `trt-ca` with location errors by ISO name, in µm and arcsec.
    ///
    /// # Errors
    /// An unknown name, a value that is not finite.
    pub fn with_errors<'a>(errors: impl IntoIterator<Item = (&'a str, f64)>) -> Result<Self> {
        // The length of a tool matters to a head only.
        let chain = Chain::preset("trt-ca", 1.0)?;
        let mut places = Places::default();
        for (name, value) in errors {
            let error = chain.location_error(name)?;
            if !value.is_finite() {
                return Err(Error::input(format!("location error {name}"), value, "finite"));
            }
            chain.add_location_error(&mut places, &error, value * error.unit().to_internal());
        }
        Self::new(&chain, &places)
    }

    /// The table at rotary positions a, c (rad).
    #[must_use]
    pub fn table(&self, a: f64, c: f64) -> Table {
        let ((sa, ca), (sc, cc)) = (a.sin_cos(), c.sin_cos());
        if self.nominal {
            let q = Matrix3::new(cc, -sc, 0.0, ca * sc, ca * cc, -sa, sa * sc, sa * cc, ca);
            return Table {
                rotation: q,
                translation: Vector3::zeros(),
                tilt_axis: Vector3::x(),
                tilt_point: Vector3::zeros(),
                turn_axis: Vector3::new(0.0, -sa, ca),
                turn_point: Vector3::zeros(),
            };
        }
        let tilted = self.tilt.rotation * Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca);
        let carrier = tilted * self.turn.rotation;
        let point = tilted * self.turn.translation + self.tilt.translation;
        Table {
            rotation: carrier * Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0),
            translation: point,
            tilt_axis: self.tilt.rotation.column(0).into(),
            tilt_point: self.tilt.translation,
            turn_axis: carrier.column(2).into(),
            turn_point: point,
        }
    }

    /// Rotary positions for a unit tool axis in the part's frame; C within half a turn of `near`.
    ///
    /// Where the tool axis lies along the C axis, C is `near`. With errors, directions within the
    /// cone of the axes' tilts (arcseconds wide) cannot be taken: the nearest one is.
    #[must_use]
    pub fn rotary(&self, tool: &Vector3<f64>, near: f64) -> (f64, f64) {
        // The part of the tool axis along the C axis does not change with C:
        // r · Rx(-a) t = o_z, r = T_C z, t = T_A' z, an equation p cos a + q sin a = o_z - r_x t_x.
        let r: Vector3<f64> = self.turn.rotation.column(2).into();
        let t = self.spindle;
        let (p, q) = (r.y * t.y + r.z * t.z, r.y * t.z - r.z * t.y);
        let along = tool.z - r.x * t.x;
        // p² + q² - along² without cancellation near the pole.
        let rest =
            tool.x * tool.x + tool.y * tool.y - r.x * r.x - t.x * t.x + 2.0 * tool.z * r.x * t.x;
        let a = q.atan2(p) + rest.max(0.0).sqrt().atan2(along);
        if tool.x.hypot(tool.y) < POLE {
            return (a, near);
        }
        let (sa, ca) = a.sin_cos();
        let m =
            self.turn.rotation.tr_mul(&Vector3::new(t.x, ca * t.y + sa * t.z, ca * t.z - sa * t.y));
        let c = (tool.x * m.y - tool.y * m.x).atan2(tool.x * m.x + tool.y * m.y);
        (a, near + wrap(c - near))
    }

    /// Axis positions x, y, z (mm), a, c (rad) for a tool tip and unit tool axis in the part's
    /// frame; C within half a turn of `near`.
    ///
    /// # Errors
    /// A point or axis that is not finite.
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
        let (a, c) = self.rotary(tool, near);
        let p = self.table(a, c).to_machine(point);
        Ok([p.x, p.y, p.z, a, c])
    }

    /// Tool tip and unit tool axis in the part's frame at axis positions x, y, z, a, c.
    #[must_use]
    pub fn forward(&self, axes: &[f64; 5]) -> (Vector3<f64>, Vector3<f64>) {
        let table = self.table(axes[3], axes[4]);
        (table.to_part(&Vector3::new(axes[0], axes[1], axes[2])), table.tool())
    }
}

impl Table {
    /// Part to machine, mm.
    #[must_use]
    pub fn to_machine(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// Machine to part, mm.
    #[must_use]
    pub fn to_part(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&(point - self.translation))
    }

    /// Unit tool axis in the part's frame.
    #[must_use]
    pub fn tool(&self) -> Vector3<f64> {
        self.rotation.row(2).transpose()
    }

    /// Derivatives of the machine position of a part point by a and c, mm/rad, at its machine
    /// position: the two last columns of J⁻¹, eq. (7).
    #[must_use]
    pub fn rates(&self, machine: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        (
            self.tilt_axis.cross(&(machine - self.tilt_point)),
            self.turn_axis.cross(&(machine - self.turn_point)),
        )
    }

    /// J⁻¹ v: part displacement (mm) and rotary displacement (rad) to axis displacement, at the
    /// machine position.
    #[must_use]
    pub fn inverse_jacobian(&self, machine: &Vector3<f64>, v: &[f64; 5]) -> [f64; 5] {
        let (by_a, by_c) = self.rates(machine);
        let p = self.rotation * Vector3::new(v[0], v[1], v[2]) + by_a * v[3] + by_c * v[4];
        [p.x, p.y, p.z, v[3], v[4]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::kinematics::{AxisPositions, Tool};

    const POSES: [[f64; 2]; 5] = [[0.3, 0.4], [1.1, -2.0], [1e-5, 3.0], [0.9, -3.1], [1.5, 1.0]];

    fn erroneous() -> Vec<(&'static str, f64)> {
        vec![
            ("EA0A", 40.0),
            ("EB0A", -30.0),
            ("EC0A", 25.0),
            ("EY0A", 30.0),
            ("EZ0A", -20.0),
            ("EB0C", 35.0),
            ("EX0C", 15.0),
            ("EY0C", -45.0),
        ]
    }

    #[test]
    fn forward_undoes_inverse() {
        for machine in [Machine::nominal(), Machine::with_errors(erroneous()).unwrap()] {
            for [a, c] in POSES {
                let axes = [10.0, -20.0, 30.0, a, c];
                let (p, o) = machine.forward(&axes);
                let again = machine.inverse(&p, &o, c).unwrap();
                let (p2, o2) = machine.forward(&again);
                assert!((p - p2).norm() < 1e-12 && (o - o2).norm() < 1e-12, "{axes:?}");
            }
        }
    }

    #[test]
    fn it_is_the_general_machine_in_closed_form() {
        let chain = Chain::preset("trt-ca", 120.0).unwrap();
        let mut places = Places::default();
        for (name, value) in erroneous() {
            let error = chain.location_error(name).unwrap();
            chain.add_location_error(&mut places, &error, value * error.unit().to_internal());
        }
        let machine = Machine::with_errors(erroneous()).unwrap();
        for [a, c] in POSES {
            let axes = [10.0, -20.0, 30.0, a, c];
            let at = AxisPositions { linear: Vector3::new(10.0, -20.0, 30.0), rotary: [a, c, 0.0] };
            let general = chain.forward(&at, &places);
            let (p, o) = machine.forward(&axes);
            assert!((general.point - p).norm() < 1e-12, "{axes:?}");
            assert!((general.direction - o).norm() < 1e-13, "{axes:?}");
        }
        let tool = Tool {
            point: Vector3::new(30.0, -10.0, 20.0),
            direction: Vector3::new(0.3, -0.2, 0.9).normalize(),
        };
        let start = chain.inverse(&tool, &[0.0, 0.0]).unwrap().positions[0];
        let general = chain.inverse_with_errors(&tool, &start, &places).unwrap();
        let ours = machine.inverse(&tool.point, &tool.direction, general.rotary[1]).unwrap();
        assert!((ours[3] - general.rotary[0]).abs() < 1e-12);
        assert!((ours[4] - general.rotary[1]).abs() < 1e-12);
        assert!((Vector3::new(ours[0], ours[1], ours[2]) - general.linear).norm() < 1e-10);
    }

    #[test]
    fn inverse_jacobian_agrees_with_central_differences() {
        for machine in [Machine::nominal(), Machine::with_errors(erroneous()).unwrap()] {
            for [a, c] in POSES {
                let axes = [10.0, -20.0, 30.0, a, c];
                let table = machine.table(a, c);
                let here = Vector3::new(10.0, -20.0, 30.0);
                let p = table.to_part(&here);
                for i in 0..5 {
                    let mut unit = [0.0; 5];
                    unit[i] = 1.0;
                    let exact = table.inverse_jacobian(&here, &unit);
                    let step = 1e-5;
                    let at = |sign: f64| {
                        let mut part = p;
                        let (mut a, mut c) = (axes[3], axes[4]);
                        match i {
                            3 => a += sign * step,
                            4 => c += sign * step,
                            _ => part[i] += sign * step,
                        }
                        let machine_point = machine.table(a, c).to_machine(&part);
                        [machine_point.x, machine_point.y, machine_point.z, a, c]
                    };
                    let (plus, minus) = (at(1.0), at(-1.0));
                    for k in 0..5 {
                        let differenced = (plus[k] - minus[k]) / (2.0 * step);
                        assert!((exact[k] - differenced).abs() < 1e-7, "{axes:?} {i} {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_vertical_tool_holds_c_and_c_does_not_jump_by_a_turn() {
        let machine = Machine::nominal();
        let up = machine.inverse(&Vector3::new(1.0, 2.0, 3.0), &Vector3::z(), 0.8).unwrap();
        assert_eq!([up[3], up[4]], [0.0, 0.8]);
        let tilted = Vector3::new(-1e-3, -1.0, 1.0).normalize();
        let (_, c) = machine.rotary(&tilted, 3.2);
        assert!((c - (std::f64::consts::PI + 1e-3)).abs() < 1e-9, "{c}");
    }
}
