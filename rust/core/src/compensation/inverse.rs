//! Exact inverse compensation: axis commands that put the tool point, and as far as the machine can
//! the tool direction, where the program means them on the machine with its errors.

use nalgebra::Vector3;

use super::Model;
use crate::Result;
use crate::machine::kinematics::{AxisPositions, Tool};
use crate::machine::{MAX_ROTARY, Places, Posture};
use crate::pose::Pose;

/// Commands for one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Commands {
    /// What the axes are sent to.
    pub positions: AxisPositions,
    /// Angle between the tool direction reached and the one meant, rad.
    pub direction_left: f64,
    /// Whether the rotary axes were held back: the direction cannot be had, or only by a turn
    /// larger than allowed.
    pub singular: bool,
}

impl Model {
    /// The pose of the work on the table.
    fn table_from_work(&self, places: &Places) -> Pose {
        let p = places.placement();
        Pose {
            rotation: crate::pose::rotation_xyz(p[3], p[4], p[5]),
            translation: Vector3::new(p[0], p[1], p[2]),
        }
    }

    /// What the program means: the tool point and direction that the nominal machine has at p with
    /// the rotary axes as commanded.
    fn meant(&self, point: &Vector3<f64>, commanded: &[f64]) -> Tool {
        let nominal = Posture::new(&self.machine, commanded, &self.machine.nominal());
        let spindle = nominal.head.rotation * Vector3::z();
        Tool { point: *point, direction: nominal.table.rotation.tr_mul(&spindle) }
    }

    /// Tool point and direction in the frame of the work for axis positions.
    #[must_use]
    pub fn reached(&self, positions: &AxisPositions) -> Tool {
        let rotary = &positions.rotary[..self.machine.rotary().len()];
        let places = self.places(rotary);
        let on_table = self.machine.forward(positions, &places);
        let work = self.table_from_work(&places);
        Tool {
            point: work.undo(&on_table.point),
            direction: work.rotation.tr_mul(&on_table.direction),
        }
    }

    /// X, Y, Z that bring the tool point to p of the work with the rotary axes sent to `rotary`.
    ///
    /// # Errors
    /// I + Λ is singular.
    pub fn linear_commands(&self, point: &Vector3<f64>, rotary: &[f64]) -> Result<Vector3<f64>> {
        let places = self.places(rotary);
        let on_table = self.table_from_work(&places).apply(point);
        self.machine.linear_axes_for(&on_table, rotary, &places)
    }

    /// Commands for all axes that reach p with the direction that `commanded` means. Where no
    /// rotary positions within `largest_turn` (rad) of the commanded ones give it, only the axis
    /// that moves the direction most is corrected, the direction comes as close as that allows,
    /// and the linear axes still put the point right.
    ///
    /// Around the direction of the table's last axis (A = 0 on a `trt-ca`) lies a cone of the size
    /// of the tilt errors that a tilted chain cannot reach at all, and beside it one where an
    /// arcsec of tilt costs degrees of turn.
    ///
    /// # Errors
    /// I + Λ is singular.
    pub fn commands(
        &self,
        point: &Vector3<f64>,
        commanded: &[f64],
        largest_turn: f64,
    ) -> Result<Commands> {
        let meant = self.meant(point, commanded);
        let (rotary, singular) = match self.rotary_for(&meant, commanded, largest_turn) {
            Some(rotary) => (rotary, false),
            None => (self.nearest_rotary(&meant, commanded), true),
        };
        let used = &rotary[..commanded.len()];
        let positions = AxisPositions { linear: self.linear_commands(point, used)?, rotary };
        let is = self.reached(&positions).direction;
        let direction_left = is.cross(&meant.direction).norm().atan2(is.dot(&meant.direction));
        Ok(Commands { positions, direction_left, singular })
    }

    /// Rotary positions that give the direction exactly, if there are any near enough.
    fn rotary_for(
        &self,
        meant: &Tool,
        commanded: &[f64],
        largest_turn: f64,
    ) -> Option<[f64; MAX_ROTARY]> {
        let mut rotary = [0.0; MAX_ROTARY];
        rotary[..commanded.len()].copy_from_slice(commanded);
        for _ in 0..ROUNDS {
            let before = rotary;
            let places = self.places(&rotary[..commanded.len()]);
            let work = self.table_from_work(&places);
            let on_table = Tool {
                point: work.apply(&meant.point),
                direction: work.rotation * meant.direction,
            };
            let linear = self
                .machine
                .linear_axes_for(&on_table.point, &rotary[..commanded.len()], &places)
                .ok()?;
            let start = AxisPositions { linear, rotary };
            let reached = self.machine.inverse_with_errors(&on_table, &start, &places).ok()?;
            rotary = reached.rotary;
            let change = distance(&rotary[..commanded.len()], &before[..commanded.len()]);
            let turned = distance(&rotary[..commanded.len()], commanded);
            if turned > largest_turn {
                return None;
            }
            if change < SETTLED_RAD || self.effects.is_empty() {
                return Some(rotary);
            }
        }
        None
    }

    /// Rotary positions with only the axis corrected that moves the direction most.
    fn nearest_rotary(&self, meant: &Tool, commanded: &[f64]) -> [f64; MAX_ROTARY] {
        let mut rotary = [0.0; MAX_ROTARY];
        rotary[..commanded.len()].copy_from_slice(commanded);
        for _ in 0..ROUNDS {
            let places = self.places(&rotary[..commanded.len()]);
            let work = self.table_from_work(&places);
            let positions = AxisPositions { linear: Vector3::zeros(), rotary };
            let (now, jacobian) = self.machine.forward_jacobian(&positions, &places);
            let miss = work.rotation * meant.direction - now.direction;
            let column = |axis: usize| jacobian.fixed_view::<3, 1>(3, 3 + axis).into_owned();
            let most = (0..commanded.len())
                .max_by(|&i, &j| column(i).norm().total_cmp(&column(j).norm()))
                .unwrap_or(0);
            let rate = column(most);
            let square = rate.norm_squared();
            if square == 0.0 {
                break;
            }
            let step = rate.dot(&miss) / square;
            rotary[most] += step;
            if step.abs() < SETTLED_RAD {
                break;
            }
        }
        rotary
    }
}

/// Largest difference of two sets of rotary positions, rad.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Rounds of Newton and of the effects' dependence on the positions they change; each gains four
/// digits.
const ROUNDS: usize = 20;
const SETTLED_RAD: f64 = 1e-13;
