//! How far from instability the loops are.
//!
//! Along the normal of the path the coupled loop of an axis is that of gain K_v (1 + C(z)); along the
//! tangent the coupling sees nothing and it is that of K_v alone. With axes that differ and a table
//! that turns, the coupled loop is one system of all axes: its poles are found at a point of the path
//! with the geometry frozen there.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, DMatrix, DVector, Vector3};

use super::axis::Axis;
use super::path::Path;
use super::pid::Gains;
use crate::error::{Error, Result};
use crate::machine::FiveAxis;
use crate::machine::five_axis::Configuration;

/// Margins of one loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Factor on the loop gain at which it oscillates; below 1 the loop is unstable.
    pub gain: f64,
    /// Further phase lag at which it oscillates, rad, at the highest frequency of unit gain.
    pub phase: f64,
    /// Highest frequency of unit gain, Hz.
    pub crossover_hz: f64,
    /// Further delay at which it oscillates, s.
    pub delay: f64,
}

/// Free and forced response of the linear drive over a period with its delay, as the numbers g and E
/// of y and v and the inputs of the late and the early command.
struct Sampled {
    g: f64,
    e: f64,
    /// Input of the command `periods` ago, to (y, v).
    late: [f64; 2],
    /// Input of the command one period before that.
    early: [f64; 2],
    periods: usize,
}

impl Sampled {
    fn new(axis: &Axis, period: f64) -> Self {
        let tau = axis.time_constant;
        let hold = |dt: f64| {
            if tau == 0.0 { (0.0, 0.0) } else { (-tau * (-dt / tau).exp_m1(), (-dt / tau).exp()) }
        };
        let whole = (axis.delay / period).floor();
        let fraction = axis.delay - whole * period;
        let (g, e) = hold(period);
        let rest = period - fraction;
        let (g_late, e_late) = hold(rest);
        let (g_early, e_early) = hold(fraction);
        // The early command acts first and its motion then runs on through the late stretch.
        let early_v = if fraction > 0.0 { 1.0 - e_early } else { 0.0 };
        let early = [fraction - g_early + g_late * early_v, e_late * early_v];
        Self { g, e, late: [rest - g_late, 1.0 - e_late], early, periods: whole as usize }
    }

    /// Transfer function from the command to y at z.
    fn response(&self, z: Complex<f64>) -> Complex<f64> {
        let input = |i: usize| Complex::from(self.late[i]) + self.early[i] / z;
        let one = Complex::from(1.0);
        let slow = (z - one).inv();
        let fast = (z - self.e).inv();
        (input(0) * slow + input(1) * self.g * slow * fast) * z.powi(-(self.periods as i32))
    }
}

/// C(z) of eq. (6) as a ratio to K_p.
fn controller(gains: &Gains, z: Complex<f64>, period: f64) -> Complex<f64> {
    let one = Complex::from(1.0);
    one * gains.proportional
        + z / (z - one) * (gains.integral * period)
        + (one - z.inv()) * (gains.derivative / period)
}

/// Number of frequencies at which the response is looked at, spread evenly in the logarithm over
/// five decades below half the sampling frequency.
const FREQUENCIES: u32 = 4000;

/// Margins of an axis's own loop (`gains` None), or of the coupled loop of matched axes along the
/// normal of the path. Resonance, friction and play are left out.
///
/// # Errors
/// Parameters of the axis or a control period out of range.
pub fn axis_margins(
    axis: &Axis,
    name: char,
    gains: Option<&Gains>,
    period: f64,
) -> Result<Margins> {
    axis.check(name, period)?;
    let sampled = Sampled::new(axis, period);
    let open = |omega: f64| {
        let z = Complex::from_polar(1.0, omega * period);
        let coupled = gains.map_or(Complex::from(0.0), |g| controller(g, z, period));
        sampled.response(z) * (coupled + 1.0) * axis.gain
    };
    let top = PI / period;
    let omega = |i: u32| top * 10_f64.powf(-5.0 + 5.0 * f64::from(i) / f64::from(FREQUENCIES));
    let mut margins = Margins {
        gain: f64::INFINITY,
        phase: f64::INFINITY,
        crossover_hz: 0.0,
        delay: f64::INFINITY,
    };
    let mut before = open(omega(0));
    for i in 1..=FREQUENCIES {
        let now = open(omega(i));
        // Crossing of the negative real axis. At half the sampling frequency the response is real.
        let ends_there = i == FREQUENCIES && now.re < 0.0;
        if (before.im < 0.0) != (now.im < 0.0) && now.re < 0.0 || ends_there {
            let at = bisect(omega(i - 1), omega(i), |w| open(w).im < 0.0);
            let at = if ends_there { top } else { at };
            margins.gain = margins.gain.min(1.0 / open(at).norm());
        }
        if (before.norm() > 1.0) != (now.norm() > 1.0) {
            let at = bisect(omega(i - 1), omega(i), |w| open(w).norm() > 1.0);
            let phase = PI + open(at).arg();
            let phase = if phase > PI { phase - TAU } else { phase };
            margins.phase = phase;
            margins.crossover_hz = at / TAU;
            margins.delay = phase / at;
        }
        before = now;
    }
    Ok(margins)
}

/// Where a yes-or-no property changes between a and b.
fn bisect(mut a: f64, mut b: f64, property: impl Fn(f64) -> bool) -> f64 {
    let at_a = property(a);
    for _ in 0..60 {
        let middle = 0.5 * (a + b);
        if property(middle) == at_a {
            a = middle;
        } else {
            b = middle;
        }
    }
    0.5 * (a + b)
}

/// The path's geometry at one point, as the coupled loop sees it for small deviations.
struct Frozen<'a> {
    machine: Configuration<'a>,
    /// How X, Y, Z follow the rotary axes, mm/rad.
    rates: [Vector3<f64>; 2],
    tangent: Vector3<f64>,
    /// Rotary reference positions by arc length, rad/mm.
    turn: [f64; 2],
}

impl<'a> Frozen<'a> {
    fn new(path: &Path, u: f64, machine: &'a FiveAxis) -> Result<Self> {
        let frame = path.frame(u);
        let tool = frame.tool();
        let q = machine.inverse(&frame.r, &tool, 0.0)?;
        let here = machine.at(&[q[3], q[4]]);
        let rates = here.rates(&Vector3::new(q[0], q[1], q[2]));
        let near = q[3 + machine.free_axis()];
        // The rotary axes by arc length from the tool axis, by the turns that the table's rotation needs: small
        // steps of the tool axis along the path, exact to the second order of the step.
        let speed = frame.r1.norm();
        let step = 1e-5;
        let at = |sign: f64| {
            let moved = (tool + frame.tool_derivative() * (sign * step / speed)).normalize();
            machine.rotary(&moved, near, true)
        };
        let (plus, minus) = (at(1.0), at(-1.0));
        let turn = [0, 1].map(|i| (plus[i] - minus[i]) / (2.0 * step));
        // Along the pole the free axis is not determined: it is held there.
        let at_pole = machine.off_pole(&tool) < 1e-4;
        Ok(Self {
            machine: here,
            rates,
            tangent: frame.r1 / speed,
            turn: if at_pole { [0.0, 0.0] } else { turn },
        })
    }

    /// J⁻¹ ε for a deviation of the axes from the reference.
    fn axis_error(&self, y: &[f64]) -> [f64; 5] {
        let [first, second] = self.rates;
        let linear = Vector3::new(y[0], y[1], y[2]) - first * y[3] - second * y[4];
        let p = self.machine.part_displacement(&linear);
        let along = self.tangent.dot(&p);
        let e = self.tangent * along - p;
        let (a, c) = (self.turn[0] * along - y[3], self.turn[1] * along - y[4]);
        let m = self.machine.linear_displacement(&e) + first * a + second * c;
        [m.x, m.y, m.z, a, c]
    }
}

/// Longest delay of an axis in the coupled loop, control periods: each adds five states to its matrix.
const MAX_PERIODS: f64 = 20.0;

/// Largest pole (absolute value) of the coupled five-axis loop at u of the path, with all loop gains
/// times `factor`: stable below 1.
///
/// # Errors
/// The machine cannot take the pose, parameters out of range, or no convergence of the eigenvalues.
pub fn pole_radius(
    path: &Path,
    u: f64,
    machine: &FiveAxis,
    axes: &[Axis; 5],
    gains: &[Gains; 5],
    period: f64,
    factor: f64,
) -> Result<f64> {
    for (axis, name) in axes.iter().zip("XYZAC".chars()) {
        axis.check(name, period)?;
        if axis.delay > MAX_PERIODS * period {
            let expected = format!("at most {MAX_PERIODS} control periods in the coupled loop");
            return Err(Error::input(format!("axis {name}: delay, s"), axis.delay, expected));
        }
    }
    let frozen = Frozen::new(path, u, machine)?;
    let sampled: Vec<Sampled> = axes.iter().map(|axis| Sampled::new(axis, period)).collect();
    let depth = sampled.iter().map(|s| s.periods).max().unwrap_or(0) + 1;
    // State of each axis: y, v, sum, last error, then the last commands, newest first.
    let each = 4 + depth;
    let n = 5 * each;
    let mut matrix = DMatrix::zeros(n, n);
    for column in 0..n {
        let mut x = vec![0.0; n];
        x[column] = 1.0;
        let y: Vec<f64> = (0..5).map(|i| x[i * each]).collect();
        let e = frozen.axis_error(&y);
        let mut next = DVector::zeros(n);
        for i in 0..5 {
            let s = &x[i * each..(i + 1) * each];
            let sum = s[2] + period * e[i];
            let added = gains[i].proportional * e[i]
                + gains[i].integral * sum
                + gains[i].derivative * (e[i] - s[3]) / period;
            let w = factor * axes[i].gain * (added - s[0]);
            let past = |back: usize| if back == 0 { w } else { s[4 + back - 1] };
            let (late, early) = (past(sampled[i].periods), past(sampled[i].periods + 1));
            let plant = &sampled[i];
            let base = i * each;
            next[base] = s[0] + plant.g * s[1] + plant.late[0] * late + plant.early[0] * early;
            next[base + 1] = plant.e * s[1] + plant.late[1] * late + plant.early[1] * early;
            next[base + 2] = sum;
            next[base + 3] = e[i];
            next[base + 4] = w;
            for back in 1..depth {
                next[base + 4 + back] = s[4 + back - 1];
            }
        }
        matrix.set_column(column, &next);
    }
    if matrix.iter().any(|entry| !entry.is_finite()) {
        let expected = "gains that a double holds once multiplied";
        return Err(Error::input("gains of the coupled loop", "products beyond 1e308", expected));
    }
    let schur = matrix.try_schur(1e-13, 10_000).ok_or_else(|| {
        Error::Kinematics(format!("poles of the coupled loop at u = {u}: no convergence"))
    })?;
    // The sum of errors along the tangent, which the coupling never feeds, stays where it is: a pole
    // at 1 that no deviation excites.
    let poles = schur.complex_eigenvalues();
    let excited = poles.iter().filter(|pole| (*pole - Complex::from(1.0)).norm() > 1e-7);
    Ok(excited.map(|pole| pole.norm()).fold(0.0, f64::max))
}

/// Factor on all loop gains at which the coupled loop at u becomes unstable, searched upwards from
/// stability: below 1 if it is unstable as it is.
///
/// # Errors
/// As [`pole_radius`].
pub fn coupled_gain_margin(
    path: &Path,
    u: f64,
    machine: &FiveAxis,
    axes: &[Axis; 5],
    gains: &[Gains; 5],
    period: f64,
) -> Result<f64> {
    let stable = |factor: f64| -> Result<bool> {
        Ok(pole_radius(path, u, machine, axes, gains, period, factor)? < 1.0)
    };
    let (mut low, mut high) = (1e-3, 1e3);
    if !stable(low)? {
        return Ok(0.0);
    }
    for _ in 0..40 {
        let middle = f64::sqrt(low * high);
        if stable(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}
