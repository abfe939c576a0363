//! From a tool pose to commands: closed form for the nominal machine, Newton for the one with
//! errors.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::closure::Closure;
use super::geometry::Geometry;
use super::parameter::{ACTIVE, ERRORS, NO_CLOSED_FORM, PASSIVE, Parameter};
use super::posture::ToolPose;
use super::solution::{Home, Solution};
use crate::pose::rotation_xyz;
use crate::{Error, Result};

/// Below this sine of the wrist's tilt q5 the tool is on the q4 axis and q4 keeps its reference.
const WRIST_SINGULAR: f64 = 1e-9;
/// Lever (mm) that weighs directions against points.
const LEVER_MM: f64 = 250.0;
/// Newton has arrived, mm.
const TOLERANCE_MM: f64 = 1e-10;

/// Sign of q5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Branch {
    /// q5 ≥ 0.
    Positive,
    /// q5 ≤ 0, q4 half a turn away.
    Negative,
}

/// Joints of the nominal machine for a tool pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NominalInverse {
    /// Commands with q5 ≥ 0 and with q5 ≤ 0: L1, L2, L3 (mm), q4, q5 (rad).
    pub active: [[f64; ACTIVE]; 2],
    /// Passive joints, the same for both, rad.
    pub passive: [f64; PASSIVE],
    /// The tool lies on the q4 axis: q4 is free and keeps the reference.
    pub singular: bool,
}

impl NominalInverse {
    /// The commands of one branch.
    #[must_use]
    pub const fn branch(&self, branch: Branch) -> &[f64; ACTIVE] {
        match branch {
            Branch::Positive => &self.active[0],
            Branch::Negative => &self.active[1],
        }
    }
}

fn unit(direction: &Vector3<f64>) -> Result<Vector3<f64>> {
    let norm = direction.norm();
    if (norm - 1.0).abs() <= 1e-6 {
        return Ok(direction / norm);
    }
    Err(Error::input("length of the tool direction", norm, "1 within 1e-6"))
}

/// See [`super::Mechanism::nominal_inverse`].
pub(super) fn nominal_inverse(
    e: &[f64; ERRORS],
    pose: &ToolPose,
    reference: f64,
) -> Result<NominalInverse> {
    if let Some(i) = NO_CLOSED_FORM.into_iter().find(|&i| e[i] != 0.0) {
        return Err(Error::input(
            format!("dimension e{} (mm) of the closed-form inverse", i + 1),
            e[i],
            "0; use the inverse by Newton's method",
        ));
    }
    let t = unit(&pose.direction)?;
    if !pose.tip.iter().all(|v| v.is_finite()) {
        let [x, y, z]: [f64; 3] = pose.tip.into();
        return Err(Error::input("tool point (mm)", format!("({x}, {y}, {z})"), "finite"));
    }
    let (a2, wrist) = (Vector3::new(0.0, e[3], 0.0), pose.tip - t * e[14]);
    if wrist.z.is_nan() || wrist.z >= 0.0 {
        return Err(Error::Kinematics(format!(
            "tool point at z = {:.3} mm puts the wrist at z = {:.3} mm; expected below the base \
             (z < 0), where the legs reach",
            pose.tip.z, wrist.z
        )));
    }
    // Legs 1 and 3 and the wrist lie in one plane through the line A1 A3: turned by u.
    let u = wrist.y.atan2(-wrist.z);
    let frame_u = rotation_xyz(u, 0.0, 0.0);
    // x_P is square to leg 2.
    let depth = frame_u.column(2).dot(&(wrist - a2));
    if depth.is_nan() || depth >= 0.0 {
        return Err(Error::Kinematics(format!(
            "leg 2 would have to point upwards ({depth:.3} mm along the plane of legs 1 and 3); \
             expected a tool point farther below the base"
        )));
    }
    let psi = (wrist.x / depth).atan();
    let platform = frame_u * rotation_xyz(0.0, psi, 0.0);
    let centre = wrist + platform.column(2) * e[12];
    let seats = [
        centre - platform.column(0) * e[8],
        centre + platform * Vector3::new(0.0, e[9], e[11]),
        centre + platform.column(0) * e[10],
    ];
    let bases = [Vector3::new(-e[7], 0.0, 0.0), a2, Vector3::new(e[7], 0.0, 0.0)];
    let mut passive = [0.0; PASSIVE];
    let mut legs = [0.0; 3];
    for leg in 0..3 {
        let along: Vector3<f64> = bases[leg] - seats[leg];
        legs[leg] = along.norm();
        let z = along / legs[leg];
        // z = Rx(u) Ry(v) ẑ = (sin v, −sin u cos v, cos u cos v)
        let at = [0, 2, 6][leg];
        passive[at] = (-z.y).atan2(z.z);
        passive[at + 1] = z.x.asin();
    }
    // R2ᵀ R_P = Rz(φ) Rx(w2)
    let leg2: Matrix3<f64> =
        rotation_xyz(passive[2], 0.0, 0.0) * rotation_xyz(0.0, passive[3], 0.0);
    let turn = leg2.tr_mul(&platform);
    passive[4] = turn[(1, 0)].atan2(turn[(0, 0)]);
    passive[5] = turn[(2, 1)].atan2(turn[(2, 2)]);
    let tool = platform.tr_mul(&t);
    let across = tool.x.hypot(tool.y);
    let singular = across < WRIST_SINGULAR;
    let q5 = across.atan2(-tool.z);
    let q4 = |sign: f64| match singular {
        true => reference,
        false => (-sign * tool.x).atan2(sign * tool.y),
    };
    let active = [1.0, -1.0].map(|sign| {
        [legs[0] - e[4], legs[1] - e[5], legs[2] - e[6], q4(sign) - e[15], sign * q5 - e[16]]
    });
    Ok(NominalInverse { active, passive, singular })
}

/// See [`super::Mechanism::inverse`].
pub(super) fn inverse(
    home: &Home,
    geometry: &Geometry,
    pose: &ToolPose,
    start: &[f64; ACTIVE],
    closure: &Closure,
) -> Result<Solution> {
    let target = unit(&pose.direction)?;
    let mut active = *start;
    let mut last = f64::INFINITY;
    for _ in 0..30 {
        let solution = home.solve(geometry, &active, closure, None)?;
        let miss = miss(&solution, &pose.tip, &target);
        let size = miss.norm();
        // Converged, or resting on rounding.
        if size < TOLERANCE_MM || (size < 1e-8 && size > 0.5 * last) {
            return Ok(solution);
        }
        if !size.is_finite() {
            break;
        }
        last = size;
        let jacobian = tool_jacobian(geometry, &solution);
        let step = jacobian
            .svd(true, true)
            .solve(&miss, 1e-9 * LEVER_MM)
            .map_err(|error| Error::Kinematics(error.to_owned()))?;
        for k in 0..ACTIVE {
            let most = if k < 3 { 200.0 } else { 0.5 };
            active[k] += step[k].clamp(-most, most);
        }
    }
    let [x, y, z]: [f64; 3] = pose.tip.into();
    Err(Error::Kinematics(format!(
        "no commands bring the tool to ({x:.3}, {y:.3}, {z:.3}) mm in the given direction: \
         {last:.1e} mm left; the tool lies on the q4 axis, or the start is too far away"
    )))
}

fn miss(solution: &Solution, tip: &Vector3<f64>, target: &Vector3<f64>) -> SVector<f64, 6> {
    let mut miss = SVector::<f64, 6>::zeros();
    miss.fixed_rows_mut::<3>(0).copy_from(&(tip - solution.posture.tip()));
    let turn = (target - solution.posture.direction()) * LEVER_MM;
    miss.fixed_rows_mut::<3>(3).copy_from(&turn);
    miss
}

/// d(tip, lever × direction) / d(L1, L2, L3, q4, q5).
fn tool_jacobian(geometry: &Geometry, solution: &Solution) -> SMatrix<f64, 6, ACTIVE> {
    let differential = solution.differential(geometry);
    let direction = solution.posture.direction();
    let mut jacobian = SMatrix::<f64, 6, ACTIVE>::zeros();
    for (column, parameter) in [4, 5, 6, 15, 16].into_iter().enumerate() {
        let rate = differential.of(Parameter::Paper(parameter)).tool;
        let turn: Vector3<f64> = rate.fixed_rows::<3>(3).into();
        jacobian.fixed_view_mut::<3, 1>(0, column).copy_from(&rate.fixed_rows::<3>(0));
        let swing = turn.cross(&direction) * LEVER_MM;
        jacobian.fixed_view_mut::<3, 1>(3, column).copy_from(&swing);
    }
    jacobian
}
