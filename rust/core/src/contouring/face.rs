//! The loop in the units of files and plots: mm/min, ms, µm, arcsec, degrees, Hz.

use std::str::FromStr;

use super::axis::{AXIS_FIELDS, Axis, Feedback, Friction};
use super::batch::Figures;
use super::contour_error::PositionModel;
use super::interpolator::{Feed, Reference};
use super::kinematics::Machine;
use super::orientation_error::OrientationModel;
use super::path::Path;
use super::simulation::{Order, Run, estimates, model_error, true_errors};
use crate::error::{Error, Result};
use crate::units::{ARCSEC, DEG, MM_PER_MIN, MS, UM};

macro_rules! names {
    ($type:ty, $kind:literal, $($name:literal => $value:expr),+) => {
        impl FromStr for $type {
            type Err = Error;

            fn from_str(name: &str) -> Result<Self> {
                match name {
                    $($name => Ok($value),)+
                    _ => Err(Error::unknown($kind, name, [$($name),+])),
                }
            }
        }
    };
}

names!(PositionModel, "contour-error model",
    "circle" => Self::Circle, "tangent" => Self::Tangent);
names!(OrientationModel, "orientation-error model",
    "proposed" => Self::Proposed, "tangent" => Self::Tangent);
names!(Feedback, "feedback", "motor" => Self::Motor, "load" => Self::Load);
names!(Order, "order of controller and inverse Jacobian",
    "controller_last" => Self::ControllerLast, "jacobian_last" => Self::JacobianLast,
    "as_printed" => Self::AsPrinted);

impl Axis {
    /// An axis from a row in the face's units, in the order of the fields: gain (1/s), time constant
    /// (ms), Coulomb and breakaway friction as the position error they take (µm | arcsec), Stribeck
    /// speed (mm/min | deg/min), backlash (µm | arcsec), amplitude of the cyclic error (µm |
    /// arcsec), its pitch (mm | deg) and phase (deg), delay (ms), resonance (Hz), damping ratio,
    /// limit of the velocity command (mm/min | deg/min); the second unit for a rotary axis.
    #[must_use]
    pub fn from_face(row: &[f64; AXIS_FIELDS], rotary: bool) -> Self {
        let (small, large) = if rotary { (ARCSEC, DEG) } else { (UM, 1.0) };
        let speed = large * MM_PER_MIN;
        Self {
            gain: row[0],
            time_constant: row[1] * MS,
            friction: Friction {
                coulomb: row[2] * small * row[0],
                breakaway: row[3] * small * row[0],
                stribeck: row[4] * speed,
            },
            backlash: row[5] * small,
            cyclic: row[6] * small,
            pitch: row[7] * large,
            phase: row[8] * DEG,
            delay: row[9] * MS,
            resonance: row[10] * std::f64::consts::TAU,
            damping: row[11],
            limit: row[12] * speed,
        }
    }
}

impl Feed {
    /// A feed in mm/min, acceleration time in s, deceleration at the end, largest normal
    /// acceleration in mm/s² (infinite for none), dwell in s.
    #[must_use]
    pub fn from_face(
        feed_mm_min: f64,
        acceleration_time_s: f64,
        decelerate: bool,
        normal_acceleration_mm_s2: f64,
        dwell_s: f64,
    ) -> Self {
        Self {
            feed: feed_mm_min * MM_PER_MIN,
            acceleration_time: acceleration_time_s,
            decelerate,
            normal_acceleration: normal_acceleration_mm_s2,
            dwell: dwell_s,
        }
    }
}

/// Columns of a run; arrays of several columns are row by row.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Path parameter of each reference sample.
    pub u: Vec<f64>,
    /// Reference tool tip, part frame, mm, three columns.
    pub point_mm: Vec<f64>,
    /// Reference axis positions, five columns, mm and degrees.
    pub reference: Vec<f64>,
    /// Positions that the loops were told to go to, five columns, mm and degrees.
    pub commanded: Vec<f64>,
    /// Actual axis positions, five columns, mm and degrees.
    pub actual: Vec<f64>,
    /// Actual tool tip, part frame, mm, three columns.
    pub tip_mm: Vec<f64>,
    /// Path parameter of the true foot point.
    pub foot_u: Vec<f64>,
    /// From the tool tip to the true foot point, three columns.
    pub contour_vector_um: Vec<f64>,
    /// True contour error.
    pub contour_um: Vec<f64>,
    /// True tool-orientation error.
    pub orientation_arcsec: Vec<f64>,
    /// Distance from the tool tip to the reference sample.
    pub following_um: Vec<f64>,
    /// Distance of the circle's foot point from the true one; 0 at the first two samples.
    pub circle_um: Vec<f64>,
    /// Likewise of the tangent line's.
    pub tangent_um: Vec<f64>,
    /// Angle of the proposed model's tool axis to the true one at the foot point.
    pub proposed_arcsec: Vec<f64>,
    /// Likewise of the tangent line's.
    pub tangent_arcsec: Vec<f64>,
}

/// Axis positions with the rotary ones in degrees.
fn degrees(axes: &[f64; 5]) -> [f64; 5] {
    [axes[0], axes[1], axes[2], axes[3] / DEG, axes[4] / DEG]
}

impl Trace {
    /// Columns of a run: `machine` is the controller's, `real` the machine as it is.
    #[must_use]
    pub fn new(
        path: &Path,
        reference: &Reference,
        machine: &Machine,
        real: &Machine,
        run: &Run,
    ) -> Self {
        let axes = &run.axes;
        let mut out = Self::default();
        let new =
            estimates(reference, machine, axes, PositionModel::Circle, OrientationModel::Proposed);
        let old =
            estimates(reference, machine, axes, PositionModel::Tangent, OrientationModel::Tangent);
        let truths = true_errors(path, reference, real, axes);
        for (k, ((truth, new), old)) in truths.zip(new).zip(old).enumerate() {
            let tip = path.frame(truth.u).r - truth.contour;
            out.u.push(reference.u[k]);
            out.point_mm.extend(reference.point[k].iter());
            out.reference.extend(degrees(&reference.axes[k]));
            out.commanded.extend(degrees(&run.commands[k]));
            out.actual.extend(degrees(&axes[k]));
            out.tip_mm.extend(tip.iter());
            out.foot_u.push(truth.u);
            out.contour_vector_um.extend(truth.contour.iter().map(|v| v / UM));
            out.contour_um.push(truth.contour.norm() / UM);
            out.orientation_arcsec.push(truth.orientation / ARCSEC);
            out.following_um.push(truth.following / UM);
            let known = if k < 2 { 0.0 } else { 1.0 };
            let [circle, proposed] = model_error(path, machine, &new, &truth);
            let [tangent, tangent_axis] = model_error(path, machine, &old, &truth);
            out.circle_um.push(known * circle / UM);
            out.tangent_um.push(known * tangent / UM);
            out.proposed_arcsec.push(known * proposed / ARCSEC);
            out.tangent_arcsec.push(known * tangent_axis / ARCSEC);
        }
        out
    }
}

/// Names of the numbers of [`Figures::row`], with units.
pub const FIGURES: [&str; 11] = [
    "steps",
    "diverged",
    "contour_max_um",
    "contour_rms_um",
    "orientation_max_arcsec",
    "orientation_rms_arcsec",
    "following_max_um",
    "circle_max_um",
    "tangent_max_um",
    "proposed_max_arcsec",
    "tangent_max_arcsec",
];

impl Figures {
    /// The figures in the order of [`FIGURES`].
    #[must_use]
    pub fn row(&self) -> [f64; 11] {
        [
            self.steps as f64,
            f64::from(u8::from(self.diverged)),
            self.contour_max / UM,
            self.contour_rms / UM,
            self.orientation_max / ARCSEC,
            self.orientation_rms / ARCSEC,
            self.following_max / UM,
            self.circle_max / UM,
            self.tangent_max / UM,
            self.proposed_max / ARCSEC,
            self.tangent_axis_max / ARCSEC,
        ]
    }
}
