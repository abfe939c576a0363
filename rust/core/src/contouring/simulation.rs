//! The loop: reference, axes, errors, controllers, one control period after another.
//!
//! ```text
//! w = K_v [ R_m - y + C(z) (J⁻¹ ε) ]        per axis; ε of five components, part frame
//! ```

use nalgebra::Vector3;

use super::axis::{Axis, Drive, Feedback};
use super::contour_error::{PositionModel, circle_foot, tangent_foot};
use super::foot::Foot;
use super::interpolator::Reference;
use super::orientation_error::{OrientationModel, angle_between, tangent_rotary, turned_tool};
use super::path::Path;
use super::pid::{Gains, Pid};
use crate::error::{Error, Result};
use crate::machine::FiveAxis;
use crate::machine::five_axis::Configuration;
use crate::machine::kinematics::wrap;

/// Order of the coupling controller and the inverse Jacobian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// C(z) (J⁻¹ ε): the error of each axis goes through that axis's controller. Stable.
    ControllerLast,
    /// J⁻¹ (C(z) ε) with every output in the units of the axis it goes to. With ratios C/K_p that are
    /// nearly the same for all axes (Table 1) this is nearly the same controller.
    JacobianLast,
    /// J⁻¹ (C(z) ε) with the numbers of Table 1 as printed, as the paper's text can be read: an output
    /// for a rotary axis is in its drive's unit ([`DRIVE_UNIT`] to the degree) and passes through J⁻¹
    /// (mm per degree) into the linear axes, whose unit is the µm. Diverges with the path far from the
    /// rotary axes.
    AsPrinted,
}

/// Units of a rotary drive to a degree in Table 1, in thousands: 5000 µm of the screw that a degree
/// would be, against 1000 µm to a millimetre.
pub const DRIVE_UNIT: f64 = 5.0;

/// Cross-coupled control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// Foot point model.
    pub position: PositionModel,
    /// Tool axis model.
    pub orientation: OrientationModel,
    /// Controllers of the five axes.
    pub gains: [Gains; 5],
    /// Order of controller and inverse Jacobian.
    pub order: Order,
}

/// What the controller takes as reference for the point the tool should be at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Foot point K, part frame, mm.
    pub point: Vector3<f64>,
    /// Rotary positions K_a, K_c (in the machine's order), rad.
    pub rotary: [f64; 2],
}

/// Finds the nearest reference sample and from it foot point and tool axis.
#[derive(Clone, Debug)]
pub struct Estimator<'a> {
    reference: &'a Reference,
    machine: &'a FiveAxis,
    nearest: usize,
}

impl<'a> Estimator<'a> {
    /// Starts at the first sample. `machine`: the controller's kinematics.
    #[must_use]
    pub fn new(reference: &'a Reference, machine: &'a FiveAxis) -> Self {
        Self { reference, machine, nearest: 1 }
    }

    /// Moves the nearest sample forward to the tool tip `p` at sample k, clamped to 1..k-1 (three
    /// samples up to the present one have to be known).
    pub fn follow(&mut self, k: usize, p: &Vector3<f64>) {
        let points = &self.reference.point;
        let distance = |j: usize| (points[j] - p).norm_squared();
        while self.nearest < k && distance(self.nearest + 1) < distance(self.nearest) {
            self.nearest += 1;
        }
    }

    /// What the models say at sample k >= 2, after [`follow`](Self::follow).
    #[must_use]
    pub fn target(
        &self,
        k: usize,
        p: &Vector3<f64>,
        position: PositionModel,
        orientation: OrientationModel,
    ) -> Target {
        let Reference { point, tool, axes, .. } = self.reference;
        let j = self.nearest.clamp(1, k - 1);
        let circle = || circle_foot(p, &point[j - 1], &point[j], &point[j + 1]);
        let tangent = || tangent_foot(p, &point[k - 1], &point[k]);
        let foot = match position {
            PositionModel::Circle => circle(),
            PositionModel::Tangent => tangent().0,
        };
        let rotary = match orientation {
            OrientationModel::Proposed => {
                let ahead = (foot - point[j]).dot(&(point[j + 1] - point[j - 1])) > 0.0;
                let n = if ahead { j + 1 } else { j - 1 };
                let axis = turned_tool(&foot, (&point[j], &tool[j]), (&point[n], &tool[n]));
                self.machine.rotary(&axis, axes[j][3 + self.machine.free_axis()], true)
            }
            OrientationModel::Tangent => {
                let (_, lag, h) = tangent();
                [3, 4].map(|i| tangent_rotary(axes[k][i], axes[k - 1][i], h, lag))
            }
        };
        Target { point: foot, rotary }
    }
}

/// Everything a simulation needs.
#[derive(Clone, Debug)]
pub struct Simulation<'a> {
    /// Reference samples.
    pub reference: &'a Reference,
    /// The five axes: X, Y, Z and the rotary ones in the machine's order.
    pub axes: [Axis; 5],
    /// Where the loops are closed.
    pub feedback: Feedback,
    /// Cross-coupling, or None for independent axes.
    pub coupling: Option<Coupling>,
    /// Kinematics that the controller assumes.
    pub machine: &'a FiveAxis,
}

/// Tool tip further from the reference than this counts as divergence, mm.
pub const DIVERGED_MM: f64 = 1e3;

/// The five axes and their controllers in motion.
#[derive(Clone, Debug)]
pub struct Loop<'a> {
    simulation: &'a Simulation<'a>,
    estimator: Estimator<'a>,
    drives: [Drive; 5],
    pids: [Pid; 5],
    commanded: [f64; 5],
    k: usize,
}

impl<'a> Loop<'a> {
    /// All axes at rest at the first sample.
    ///
    /// # Errors
    /// Fewer than three samples; axis parameters out of range.
    pub fn new(simulation: &'a Simulation<'a>) -> Result<Self> {
        let reference = simulation.reference;
        if reference.len() < 3 {
            return Err(Error::input("reference samples", reference.len(), "at least 3"));
        }
        let drive = |i: usize| {
            let start = reference.axes[0][i];
            let (axis, name) = (&simulation.axes[i], simulation.machine.letters()[i]);
            Drive::new(axis, name, reference.period, simulation.feedback, start)
        };
        Ok(Self {
            simulation,
            estimator: Estimator::new(reference, simulation.machine),
            drives: [drive(0)?, drive(1)?, drive(2)?, drive(3)?, drive(4)?],
            pids: [Pid::default(); 5],
            commanded: reference.axes[0],
            k: 0,
        })
    }

    /// Where the loads are, at the present sample.
    #[must_use]
    pub fn loads(&self) -> [f64; 5] {
        [0, 1, 2, 3, 4].map(|i| self.drives[i].load())
    }

    /// Position that each loop was last commanded to: the reference and what the coupling adds.
    #[must_use]
    pub fn commanded(&self) -> [f64; 5] {
        self.commanded
    }

    /// Command for sample k and motion to sample k + 1; allocates nothing.
    pub fn step(&mut self) {
        let reference = self.simulation.reference;
        let k = self.k;
        let y = [0, 1, 2, 3, 4].map(|i| self.drives[i].measured());
        let mut command = [0, 1, 2, 3, 4].map(|i| reference.axes[k][i] - y[i]);
        // The first two samples have no three points to lay a circle through: no coupling.
        match &self.simulation.coupling {
            Some(coupling) if k >= 2 => self.couple(coupling, &y, &mut command),
            _ => {}
        }
        self.commanded = [0, 1, 2, 3, 4].map(|i| y[i] + command[i]);
        for ((drive, error), target) in self.drives.iter_mut().zip(command).zip(self.commanded) {
            drive.follow(error, target);
        }
        self.k += 1;
    }

    fn couple(&mut self, coupling: &Coupling, y: &[f64; 5], command: &mut [f64; 5]) {
        let period = self.simulation.reference.period;
        let here = self.simulation.machine.at(&[y[3], y[4]]);
        let linear = Vector3::new(y[0], y[1], y[2]);
        let p = here.to_part(&linear);
        self.estimator.follow(self.k, &p);
        let target = self.estimator.target(self.k, &p, coupling.position, coupling.orientation);
        let e = target.point - p;
        let mut error = [e.x, e.y, e.z, target.rotary[0] - y[3], target.rotary[1] - y[4]];
        let free = 3 + self.simulation.machine.free_axis();
        error[free] = wrap(error[free]);
        let (fed, added) = self.coupled(coupling, &here, &linear, &error, period);
        for (command, added) in command.iter_mut().zip(added) {
            *command += added;
        }
        // Anti-windup: while an axis is at its limit and driven further into it, no sum grows. All are
        // held, not only its own: a sum of some axes alone would point along the path, where the
        // coupling sees no error and never takes it back.
        let beyond = |i: usize| {
            let drive = &self.drives[i];
            (drive.gain() * command[i]).abs() > drive.limit() && command[i] * fed[i] > 0.0
        };
        if (0..5).any(beyond) {
            for (pid, error) in self.pids.iter_mut().zip(fed) {
                pid.hold(error, period);
            }
        }
    }

    /// Errors fed to the five controllers, and what the coupling adds to the command of each axis.
    fn coupled(
        &mut self,
        coupling: &Coupling,
        here: &Configuration<'_>,
        at: &Vector3<f64>,
        error: &[f64; 5],
        period: f64,
    ) -> ([f64; 5], [f64; 5]) {
        let mut control = |e: &[f64; 5]| {
            let mut out = [0.0; 5];
            for i in 0..5 {
                out[i] = self.pids[i].step(&coupling.gains[i], e[i], period);
            }
            out
        };
        match coupling.order {
            Order::ControllerLast => {
                let axis_error = here.inverse_jacobian(at, error);
                (axis_error, control(&axis_error))
            }
            Order::JacobianLast => (*error, here.inverse_jacobian(at, &control(error))),
            Order::AsPrinted => {
                let [x, y, z, a, c] = control(error);
                let mixed = [x, y, z, a * DRIVE_UNIT, c * DRIVE_UNIT];
                let [x, y, z, ..] = here.inverse_jacobian(at, &mixed);
                (*error, [x, y, z, a, c])
            }
        }
    }
}

/// Axis positions of a whole run, and where it broke off.
#[derive(Clone, Debug)]
pub struct Run {
    /// Load positions x, y, z (mm) and rotary (rad) at each sample.
    pub axes: Vec<[f64; 5]>,
    /// Positions that the five loops were commanded to: reference and coupling.
    pub commands: Vec<[f64; 5]>,
    /// Whether the run broke off because the axes left the reference by [`DIVERGED_MM`] mm or rad.
    pub diverged: bool,
}

impl Simulation<'_> {
    /// Runs over all samples of the reference.
    ///
    /// # Errors
    /// As [`Loop::new`].
    pub fn run(&self) -> Result<Run> {
        let mut state = Loop::new(self)?;
        let count = self.reference.len();
        let mut axes = Vec::with_capacity(count);
        let mut commands = Vec::with_capacity(count);
        for k in 0..count {
            let now = state.loads();
            let near = |i: usize| (now[i] - self.reference.axes[k][i]).abs() < DIVERGED_MM;
            if !(0..5).all(near) {
                return Ok(Run { axes, commands, diverged: true });
            }
            axes.push(now);
            state.step();
            commands.push(state.commanded());
        }
        Ok(Run { axes, commands, diverged: false })
    }
}

/// True errors of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueError {
    /// Parameter of the foot point on the path.
    pub u: f64,
    /// From the tool tip to the foot point, part frame, mm.
    pub contour: Vector3<f64>,
    /// Angle between the tool axis and that of the path at the foot point, rad.
    pub orientation: f64,
    /// Distance from the tool tip to the reference sample, mm.
    pub following: f64,
}

/// True errors of axis positions on the real machine, sample by sample.
pub fn true_errors<'a>(
    path: &'a Path,
    reference: &'a Reference,
    machine: &'a FiveAxis,
    axes: &'a [[f64; 5]],
) -> impl Iterator<Item = TrueError> + 'a {
    let start = reference.u.first().copied().unwrap_or(path.span().0);
    let mut foot = Foot::new(path, start);
    axes.iter().zip(&reference.point).map(move |(q, r)| {
        let (p, o) = machine.forward(q);
        let u = foot.find(&p);
        let frame = path.frame(u);
        TrueError {
            u,
            contour: frame.r - p,
            orientation: angle_between(&o, &frame.tool()),
            following: (r - p).norm(),
        }
    })
}

/// What the error models say along given axis positions (no feedback of it), sample by sample; the
/// true state itself at the first two samples, where there is no model yet.
pub fn estimates<'a>(
    reference: &'a Reference,
    machine: &'a FiveAxis,
    axes: &'a [[f64; 5]],
    position: PositionModel,
    orientation: OrientationModel,
) -> impl Iterator<Item = Target> + 'a {
    let mut estimator = Estimator::new(reference, machine);
    axes.iter().take(reference.len()).enumerate().map(move |(k, q)| {
        let (p, _) = machine.forward(q);
        if k < 2 {
            return Target { point: p, rotary: [q[3], q[4]] };
        }
        estimator.follow(k, &p);
        estimator.target(k, &p, position, orientation)
    })
}

/// Error of the models: distance of the foot point from the true one (mm) and angle between the
/// tool axis and the true one (rad).
#[must_use]
pub fn model_error(
    path: &Path,
    machine: &FiveAxis,
    target: &Target,
    truth: &TrueError,
) -> [f64; 2] {
    let frame = path.frame(truth.u);
    let axis = machine.at(&target.rotary).tool();
    [(target.point - frame.r).norm(), angle_between(&axis, &frame.tool())]
}

/// True errors of one sample and what the error models miss of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// True errors.
    pub truth: TrueError,
    /// [`model_error`] of circle and proposed orientation model; zero at the first two samples.
    pub proposed: [f64; 2],
    /// Likewise of the tangent line.
    pub tangent: [f64; 2],
}

/// The samples of a run: `machine` is the controller's, `real` the machine as it is.
pub fn samples<'a>(
    path: &'a Path,
    reference: &'a Reference,
    machine: &'a FiveAxis,
    real: &'a FiveAxis,
    axes: &'a [[f64; 5]],
) -> impl Iterator<Item = Sample> + 'a {
    let models = |position, orientation| estimates(reference, machine, axes, position, orientation);
    let new = models(PositionModel::Circle, OrientationModel::Proposed);
    let old = models(PositionModel::Tangent, OrientationModel::Tangent);
    let truths = true_errors(path, reference, real, axes);
    truths.zip(new).zip(old).enumerate().map(move |(k, ((truth, new), old))| {
        let error = |target| match k {
            0 | 1 => [0.0; 2],
            _ => model_error(path, machine, target, &truth),
        };
        Sample { truth, proposed: error(&new), tangent: error(&old) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contouring::path::Piece;

    /// Eq. (8) of the paper with the tool along the normal of its surface.
    fn paper() -> Path {
        let mut c = vec![[0.0; 6]; 7];
        c[0] = [0.0, 0.0, 15.0, 0.0, 0.0, 1.0];
        c[1] = [15.0, -80.0, 0.0, 2.0, -0.16, 0.0];
        c[2][2] = -21.4;
        c[3] = [0.0, 80.0, 0.0, 0.0, 0.16, 0.0];
        c[4][2] = 12.8;
        c[6][2] = -6.4;
        let (start, end, omega) = (0.0, 1.0, 0.0);
        let (cosine, sine) = ([0.0; 6], [0.0; 6]);
        let piece = Piece { start, end, coefficients: c, omega, cosine, sine };
        Path::new(vec![piece]).unwrap()
    }

    #[test]
    fn models_converge_with_their_order() {
        // Tool tips 2 µm beside the path and all over the distance between two samples.
        let path = paper();
        let errors = |spacing: f64| {
            let (mut position, mut orientation) = (0.0_f64, 0.0_f64);
            for place in 1..40 {
                let middle = path.length() * f64::from(place) / 40.0;
                let sample = [-1.0, 0.0, 1.0].map(|i| {
                    let frame = path.frame(path.at_length(middle + i * spacing));
                    (frame.r, frame.tool())
                });
                let [a, b, c] = sample;
                for share in 0..=10 {
                    let shift = spacing * (f64::from(share) / 10.0 - 0.5);
                    let frame = path.frame(path.at_length(middle + shift));
                    let beside = frame.r1.cross(&frame.w).normalize() * 2e-3;
                    let foot = circle_foot(&(frame.r + beside), &a.0, &b.0, &c.0);
                    position = position.max((foot - frame.r).norm());
                    let other = if shift > 0.0 { c } else { a };
                    let tool = turned_tool(&foot, (&b.0, &b.1), (&other.0, &other.1));
                    orientation = orientation.max(angle_between(&tool, &frame.tool()));
                }
            }
            [position, orientation]
        };
        // Control periods of 4 ms to 0.25 ms at 3 m/min.
        let coarse = errors(0.2);
        let fine = errors(0.0125);
        let order = |i: usize| (coarse[i] / fine[i]).ln() / 16.0_f64.ln();
        assert!((order(0) - 3.0).abs() < 0.15, "position: order {}", order(0));
        assert!((order(1) - 2.0).abs() < 0.15, "orientation: order {}", order(1));
    }

    #[test]
    fn the_length_of_the_papers_path_is_that_of_the_notes() {
        assert!((paper().length() - 67.2014).abs() < 5e-5);
        let tightest = (0..=10_000)
            .map(|i| 1.0 / paper().frame(f64::from(i) / 1e4).curvature())
            .fold(f64::INFINITY, f64::min);
        assert!((tightest - 1.893).abs() < 5e-4, "{tightest}");
    }
}
