//! Forward solution and sensitivities by implicit differentiation (equations (1) and (2)).

use nalgebra::{SMatrix, SVector, Vector3};

use super::closure::{Closure, EQUATIONS, Equations, Loops, Residual};
use super::geometry::Geometry;
use super::parameter::{ACTIVE, ERRORS, PASSIVE, Parameter};
use super::posture::{Joints, Posture};
use crate::{Error, Result};

type Jacobian = SMatrix<f64, EQUATIONS, PASSIVE>;

/// Q R of the weighted ∂G/∂Y by modified Gram-Schmidt: at 10 × 8 five times as fast as a general QR
/// decomposition, and least squares needs no more orthogonality than it gives.
#[derive(Clone, Debug)]
struct Factors {
    q: Jacobian,
    r: SMatrix<f64, PASSIVE, PASSIVE>,
}

impl Factors {
    fn new(jacobian: &Jacobian) -> Self {
        let mut q = *jacobian;
        let mut r = SMatrix::<f64, PASSIVE, PASSIVE>::zeros();
        for j in 0..PASSIVE {
            let mut unit: Equations = q.column(j).into();
            let length = unit.norm();
            r[(j, j)] = length;
            if length > 0.0 {
                unit /= length;
            }
            q.set_column(j, &unit);
            for k in j + 1..PASSIVE {
                let mut column: Equations = q.column(k).into();
                let along = unit.dot(&column);
                r[(j, k)] = along;
                column -= unit * along;
                q.set_column(k, &column);
            }
        }
        Self { q, r }
    }

    /// Smallest over largest pivot.
    fn pivot_ratio(&self) -> f64 {
        let pivots = self.r.diagonal();
        pivots.min() / pivots.max()
    }

    /// R x = b in place, for one or several columns. No pivot is zero wherever this is called.
    fn back_substitute<const K: usize>(&self, x: &mut SMatrix<f64, PASSIVE, K>) {
        for column in 0..K {
            for j in (0..PASSIVE).rev() {
                let value = x[(j, column)] / self.r[(j, j)];
                x[(j, column)] = value;
                for i in 0..j {
                    x[(i, column)] -= self.r[(i, j)] * value;
                }
            }
        }
    }

    /// J⁺ g, with g taken through Gram-Schmidt like a further column.
    fn solve(&self, equations: &Equations) -> SVector<f64, PASSIVE> {
        let mut rest = *equations;
        let mut x = SVector::<f64, PASSIVE>::zeros();
        for j in 0..PASSIVE {
            let unit: Equations = self.q.column(j).into();
            x[j] = unit.dot(&rest);
            rest -= unit * x[j];
        }
        self.back_substitute(&mut x);
        x
    }

    /// (J⁺)ᵀ x = Q R⁻ᵀ x.
    fn transposed(&self, mut x: SVector<f64, PASSIVE>) -> Equations {
        for j in 0..PASSIVE {
            for i in 0..j {
                x[j] -= self.r[(i, j)] * x[i];
            }
            x[j] /= self.r[(j, j)];
        }
        self.q * x
    }

    /// J⁺.
    fn inverse(&self) -> SMatrix<f64, PASSIVE, EQUATIONS> {
        let mut inverse = self.q.transpose();
        self.back_substitute(&mut inverse);
        inverse
    }
}

/// Newton steps before giving up; from home a pose of the working space takes 5 or 6.
const MAX_STEPS: usize = 20;
/// A step of this size (rad) is the last: the next one would be its square, below rounding.
const TOLERANCE_RAD: f64 = 1e-9;
/// A larger step (rad) may have left the branch: the way there is then followed instead.
const MAX_STEP_RAD: f64 = 0.7;
/// Of the smallest to the largest diagonal element of R: below, the loops do not determine Y.
const MIN_PIVOT_RATIO: f64 = 1e-7;
/// Shortest fraction of the way from home that is still tried.
const MIN_STRIDE: f64 = 1e-4;

/// A posture whose loops are closed.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Passive and active joints, rad and mm.
    pub joints: Joints,
    /// Frames and twists there.
    pub posture: Posture,
    /// Newton steps it took in all.
    pub steps: usize,
    closure: Closure,
    factors: Factors,
    /// See [`side`].
    side: f64,
}

/// How parameters move the mechanism. Rows of a batch share the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// dY/de, rad per mm or rad.
    pub passive: SVector<f64, PASSIVE>,
    /// dr/de (mm per mm or rad) and angular velocity of the tool (rad per mm or rad): the whole.
    pub tool: SVector<f64, 6>,
    /// The same with the outer legs taken off the platform: (∂r/∂e)_Y, the serial part.
    pub serial: SVector<f64, 6>,
}

enum Failure {
    /// Not there after [`MAX_STEPS`], or a step too long.
    Lost,
    Singular,
}

fn newton(
    geometry: &Geometry,
    closure: &Closure,
    start: &[f64; PASSIVE],
    active: &[f64; ACTIVE],
    steps_left: usize,
) -> std::result::Result<Solution, Failure> {
    let mut joints = Joints { passive: *start, active: *active };
    let mut last = false;
    for step in 0..=steps_left {
        let posture = Posture::new(geometry, &joints);
        let jacobian = closure.jacobian(&posture);
        let factors = Factors::new(&jacobian);
        let ratio = factors.pivot_ratio();
        if ratio.is_nan() || ratio <= MIN_PIVOT_RATIO {
            return Err(Failure::Singular);
        }
        if last {
            let side = side(&jacobian, closure);
            return Ok(Solution { joints, posture, steps: step, closure: *closure, factors, side });
        }
        let change = factors.solve(&closure.equations(&posture));
        let size = change.amax();
        if size.is_nan() || size >= MAX_STEP_RAD {
            return Err(Failure::Lost);
        }
        for (angle, delta) in joints.passive.iter_mut().zip(change.iter()) {
            *angle -= delta;
        }
        last = size < TOLERANCE_RAD;
    }
    Err(Failure::Lost)
}

/// The posture from which the branch of the machine is followed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Home {
    /// Passive joints, rad.
    pub passive: [f64; PASSIVE],
    /// Leg lengths, mm.
    pub legs: [f64; 3],
    /// Sign of the determinant for each choice of eight equations.
    sides: [[f64; 2]; 2],
}

impl Home {
    /// A posture at which the loops of the nominal machine close.
    pub fn new(geometry: &Geometry, passive: [f64; PASSIVE], legs: [f64; 3]) -> Self {
        let [l1, l2, l3] = legs;
        let joints = Joints { passive, active: [l1, l2, l3, 0.0, 0.0] };
        let posture = Posture::new(geometry, &joints);
        let sides = [3, 4].map(|first| {
            [3, 4].map(|second| {
                let weight = |row: usize, kept: usize| if row == kept { 1000.0 } else { 0.0 };
                let closure = Closure {
                    along_mm: [weight(3, first), weight(3, second)],
                    about_mm: [weight(4, first), weight(4, second)],
                };
                side(&closure.jacobian(&posture), &closure)
            })
        });
        Self { passive, legs, sides }
    }

    /// Which side of the singular postures home is on, under this closure.
    fn side(&self, closure: &Closure) -> f64 {
        let [first, second] = closure.kept();
        self.sides[first - 3][second - 3]
    }

    /// See [`super::Mechanism::solve_near`].
    pub fn solve(
        &self,
        geometry: &Geometry,
        active: &[f64; ACTIVE],
        closure: &Closure,
        near: Option<&Joints>,
    ) -> Result<Solution> {
        check_active(active)?;
        let from_home = distance(&self.legs, active);
        if let Some(near) = near.filter(|near| distance(&near.active, active) < from_home)
            && let Ok(solution) = newton(geometry, closure, &near.passive, active, MAX_STEPS)
            && solution.side == self.side(closure)
        {
            return Ok(solution);
        }
        let direct = newton(geometry, closure, &self.passive, active, MAX_STEPS);
        match direct {
            Ok(solution) if solution.side == self.side(closure) => Ok(solution),
            Ok(other) => self.follow(geometry, active, closure, Some(&other)),
            Err(Failure::Singular | Failure::Lost) => self.follow(geometry, active, closure, None),
        }
    }

    /// Along the way from home, leg lengths in proportion.
    pub fn follow(
        &self,
        geometry: &Geometry,
        active: &[f64; ACTIVE],
        closure: &Closure,
        elsewhere: Option<&Solution>,
    ) -> Result<Solution> {
        let at = |fraction: f64| {
            let mut way = *active;
            for (leg, home) in self.legs.iter().enumerate() {
                way[leg] = home + fraction * (active[leg] - home);
            }
            way
        };
        let mut here =
            newton(geometry, closure, &self.passive, &at(0.0), MAX_STEPS).map_err(|_| {
                Error::Kinematics(
                "the loops do not close even at the home posture with these errors; expected errors \
                 that are small beside the dimensions"
                    .to_owned(),
            )
            })?;
        let mut steps = here.steps;
        let (mut done, mut stride) = (0.0, 0.25);
        let mut ratio = here.pivot_ratio();
        while done < 1.0 {
            let next = f64::min(done + stride, 1.0);
            match newton(geometry, closure, &here.joints.passive, &at(next), 6) {
                Ok(solution) if moved(&solution, &here) < 0.3 => {
                    steps += solution.steps;
                    ratio = solution.pivot_ratio();
                    here = solution;
                    done = next;
                    stride *= 2.0;
                }
                _ => stride *= 0.5,
            }
            if stride < MIN_STRIDE {
                return Err(unreachable_legs(active, done, ratio, elsewhere));
            }
        }
        here.steps = steps;
        Ok(here)
    }
}

/// Sign of the determinant of the square part of the closure: y_P·z at both legs, as in the
/// paper, or y_P·x where the former is dropped. It can only change at a singular posture.
fn side(all: &Jacobian, closure: &Closure) -> f64 {
    let [first, second] = closure.kept();
    let mut square = SMatrix::<f64, PASSIVE, PASSIVE>::zeros();
    for (row, from) in [0, 1, 2, first, 5, 6, 7, 5 + second].into_iter().enumerate() {
        square.set_row(row, &all.row(from));
    }
    square.determinant().signum()
}

/// Largest difference of leg lengths, mm.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).take(3).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn moved(a: &Solution, b: &Solution) -> f64 {
    let pairs = a.joints.passive.iter().zip(&b.joints.passive);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn check_active(active: &[f64; ACTIVE]) -> Result<()> {
    for (k, value) in active.iter().enumerate() {
        let name = ["L1", "L2", "L3", "q4", "q5"][k];
        if !value.is_finite() {
            return Err(Error::input(format!("command {name}"), value, "a finite number"));
        }
        if k < 3 && *value <= 0.0 {
            return Err(Error::input(format!("leg length {name} (mm)"), value, "more than zero"));
        }
    }
    Ok(())
}

fn unreachable_legs(
    active: &[f64; ACTIVE],
    done: f64,
    ratio: f64,
    elsewhere: Option<&Solution>,
) -> Error {
    let legs = format!("({:.3}, {:.3}, {:.3}) mm", active[0], active[1], active[2]);
    Error::Kinematics(match elsewhere {
        Some(other) => {
            let [u1, v1, ..] = other.joints.passive.map(f64::to_degrees);
            format!(
                "leg lengths {legs} close only on another branch (u1 = {u1:.2}°, v1 = {v1:.2}°): \
                 the way from home meets a singular posture after {:.1} % (pivot ratio {ratio:.1e})",
                100.0 * done
            )
        }
        None if done > 1.0 - 10.0 * MIN_STRIDE => format!(
            "leg lengths {legs} are a singular posture: the loops no longer hold the platform \
             (pivot ratio {ratio:.1e})"
        ),
        None => format!(
            "leg lengths {legs} are out of reach: on the way from home the loops can be closed for \
             {:.1} % of it only (pivot ratio there {ratio:.1e})",
            100.0 * done
        ),
    })
}

impl Solution {
    /// What is left open at legs 1 and 3.
    #[must_use]
    pub fn residuals(&self) -> [Residual; 2] {
        [Residual::of(&self.posture, 0), Residual::of(&self.posture, 1)]
    }

    /// Ratio of the smallest to the largest pivot of ∂G/∂Y: 0 at a singular posture.
    #[must_use]
    pub fn pivot_ratio(&self) -> f64 {
        self.factors.pivot_ratio()
    }

    /// The operator that turns closure rates into sensitivities, for any number of parameters of the
    /// geometry that was solved.
    #[must_use]
    pub fn differential<'a>(&'a self, geometry: &'a Geometry) -> Differential<'a> {
        let inverse = self.factors.inverse();
        let mut tool = SMatrix::<f64, 6, PASSIVE>::zeros();
        for (joint, twist) in self.posture.passive.iter().enumerate() {
            let reach = Posture::passive_reach(joint);
            tool.set_column(joint, &self.posture.tool_velocity(twist, reach));
        }
        let loops = self.closure.loops(&self.posture);
        Differential { solution: self, geometry, loops, inverse, tool }
    }

    /// The same for the way of the tool point along a unit vector alone.
    #[must_use]
    pub fn along<'a>(&'a self, geometry: &'a Geometry, direction: &'a Vector3<f64>) -> Along<'a> {
        let posture = &self.posture;
        let mut joints = SVector::<f64, PASSIVE>::zeros();
        for (joint, twist) in posture.passive.iter().enumerate() {
            joints[joint] = posture.tip_velocity(twist, Posture::passive_reach(joint), direction);
        }
        let pull = self.factors.transposed(joints);
        Along { solution: self, geometry, direction, loops: self.closure.loops(posture), pull }
    }

    /// Sensitivities to the 17 parameters of the paper, at the geometry that was solved.
    #[must_use]
    pub fn paper_sensitivities(&self, geometry: &Geometry) -> [Sensitivity; ERRORS] {
        let differential = self.differential(geometry);
        Parameter::paper().map(|parameter| differential.of(parameter))
    }
}

/// [∂G/∂Y]⁺ and ∂r/∂Y at a solution.
///
/// Exact where the loops close, thus for the 17 and for every first-order question. Where errors
/// strain the loops by ρ, weighted least squares also has a curvature term, of relative size
/// ρ over the leg length: 1e-5 for 10 µm, left out here.
pub struct Differential<'a> {
    solution: &'a Solution,
    geometry: &'a Geometry,
    loops: Loops,
    inverse: SMatrix<f64, PASSIVE, EQUATIONS>,
    tool: SMatrix<f64, 6, PASSIVE>,
}

impl Differential<'_> {
    /// Sensitivity to one parameter.
    #[must_use]
    pub fn of(&self, parameter: Parameter) -> Sensitivity {
        let posture = &self.solution.posture;
        let mut rate = Equations::zeros();
        let mut serial = SVector::<f64, 6>::zeros();
        posture.parameter_twists(self.geometry, parameter, |twist, reach| {
            self.loops.add_column(twist, reach, &mut rate);
            serial += posture.tool_velocity(twist, reach);
        });
        let passive = -(self.inverse * rate);
        Sensitivity { passive, tool: serial + self.tool * passive, serial }
    }

    /// First-order misfit that a parameter leaves in the loops under this closure, per mm or rad:
    /// for each loop the gap (3, mm), y_P·z and y_P·x (rad). Zero for the 17.
    #[must_use]
    pub fn strain(&self, parameter: Parameter) -> [Residual; 2] {
        let posture = &self.solution.posture;
        let plain = Closure { along_mm: [1.0; 2], about_mm: [1.0; 2] };
        let mut rate = Equations::zeros();
        let loops = plain.loops(posture);
        posture.parameter_twists(self.geometry, parameter, |twist, reach| {
            loops.add_column(twist, reach, &mut rate);
        });
        let left = rate + plain.jacobian(posture) * self.of(parameter).passive;
        [0, 5].map(|at| Residual {
            gap: [left[at], left[at + 1], left[at + 2]],
            along: left[at + 3],
            about: left[at + 4],
        })
    }
}

/// n · ∂r/∂Y [∂G/∂Y]⁺ at a solution: n · dr/de of equation (2) takes one inner product of each
/// parameter, where [`Differential`] takes products with both matrices.
pub struct Along<'a> {
    solution: &'a Solution,
    geometry: &'a Geometry,
    direction: &'a Vector3<f64>,
    loops: Loops,
    pull: Equations,
}

impl Along<'_> {
    /// n · dr/de, mm per mm or rad.
    #[must_use]
    pub fn of(&self, parameter: Parameter) -> f64 {
        let posture = &self.solution.posture;
        let mut rate = Equations::zeros();
        let mut serial = 0.0;
        posture.parameter_twists(self.geometry, parameter, |twist, reach| {
            self.loops.add_column(twist, reach, &mut rate);
            serial += posture.tip_velocity(twist, reach, self.direction);
        });
        serial - self.pull.dot(&rate)
    }
}
