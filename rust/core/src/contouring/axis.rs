//! One axis: a servo of first order with gain, and what real axes add to it.
//!
//! ```text
//! w = K_v (r - y - offset) + f_v dr/dt + f_a d²r/dt²          position loop with feed-forward
//! τ dv/dt + v = w(t - delay) - friction,   dy/dt = v          drive (motor position y)
//! q'' + 2 ζ ω q' + ω² q = ω² y                                structure, if it resonates
//! load = play(q) + A sin(2π y / pitch + φ)                    screw or gear, if it is not exact
//! ```
//!
//! friction = sign(v) level(|v|) + drag |v|. A friction level of its own in each direction is a level
//! and an offset; friction in proportion to the speed is another gain and time constant.
//! w is the velocity command, held over a control period (exact zero-order hold, so that a step has
//! no discretisation error), with the loop closed in the motor's or in the load's position.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::error::{Error, Result};

/// Longest delay in control periods.
pub const MAX_DELAY: usize = 64;

/// Which position the loop is closed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feedback {
    /// Motor encoder: backlash, cyclic error and resonance of what follows are not seen by the loop.
    Motor,
    /// Scale at the load: the loop sees them.
    Load,
}

/// Friction as the velocity command it eats up, mm/s or rad/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Level at speed (Coulomb).
    pub coulomb: f64,
    /// Level at rest, at least `coulomb`.
    pub breakaway: f64,
    /// Speed over which one goes into the other (Stribeck), mm/s or rad/s.
    pub stribeck: f64,
    /// Share of the speed by which friction is larger in the positive direction and smaller in the
    /// other.
    pub drag: f64,
}

/// Parameters of one axis, in mm (rad) and s. Zero switches a part off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Loop gain K_v = open-loop gain times axial controller gain, 1/s.
    pub gain: f64,
    /// Time constant τ, s.
    pub time_constant: f64,
    /// Friction.
    pub friction: Friction,
    /// Width b of the play: the load lies b/2 behind.
    pub backlash: f64,
    /// Amplitude A of the cyclic error.
    pub cyclic: f64,
    /// Its pitch.
    pub pitch: f64,
    /// Its phase φ, rad.
    pub phase: f64,
    /// Delay of the velocity command, s; need not be a multiple of the period.
    pub delay: f64,
    /// Natural frequency ω of the structure, rad/s.
    pub resonance: f64,
    /// Its damping ratio ζ, below 1.
    pub damping: f64,
    /// Largest velocity command; infinite for none.
    pub limit: f64,
    /// Position error that a constant force takes to hold.
    pub offset: f64,
    /// Share of the commanded velocity that is fed forward.
    pub velocity_forward: f64,
    /// Time by which the commanded acceleration is fed forward, s.
    pub acceleration_forward: f64,
}

impl Axis {
    /// A linear axis: gain and time constant.
    #[must_use]
    pub const fn linear(gain: f64, time_constant: f64) -> Self {
        Self {
            gain,
            time_constant,
            friction: Friction { coulomb: 0.0, breakaway: 0.0, stribeck: 0.0, drag: 0.0 },
            backlash: 0.0,
            cyclic: 0.0,
            pitch: 0.0,
            phase: 0.0,
            delay: 0.0,
            resonance: 0.0,
            damping: 0.0,
            limit: f64::INFINITY,
            offset: 0.0,
            velocity_forward: 0.0,
            acceleration_forward: 0.0,
        }
    }

    pub(super) fn check(&self, name: char, period: f64) -> Result<()> {
        if !(period.is_finite() && period > 0.0) {
            return Err(Error::input("control period, s", period, "a finite number above 0"));
        }
        let fail = |what: &str, got: f64, expected: &str| {
            Err(Error::input(format!("axis {name}: {what}"), got, expected))
        };
        if !(self.gain.is_finite() && self.gain > 0.0) {
            return fail("gain, 1/s", self.gain, "a finite number above 0");
        }
        let levels = [
            ("time constant, s", self.time_constant),
            ("coulomb friction", self.friction.coulomb),
            ("breakaway friction", self.friction.breakaway),
            ("stribeck speed", self.friction.stribeck),
            ("backlash", self.backlash),
            ("pitch", self.pitch),
            ("delay, s", self.delay),
            ("resonance, rad/s", self.resonance),
        ];
        for (what, value) in levels {
            if !(value.is_finite() && value >= 0.0) {
                return fail(what, value, "a finite number, 0 or more");
            }
        }
        if !(self.cyclic.is_finite() && self.phase.is_finite()) {
            return fail("cyclic error", self.cyclic, "finite numbers");
        }
        let signed = [
            ("offset", self.offset),
            ("velocity feed-forward", self.velocity_forward),
            ("acceleration feed-forward, s", self.acceleration_forward),
        ];
        for (what, value) in signed {
            if !value.is_finite() {
                return fail(what, value, "a finite number");
            }
        }
        // Above 1 the axis would speed up by itself.
        if self.friction.drag.is_nan() || self.friction.drag.abs() >= 1.0 {
            return fail("friction by direction", self.friction.drag, "above -1 and below 1");
        }
        if self.friction.breakaway < self.friction.coulomb {
            return fail("breakaway friction", self.friction.breakaway, "at least coulomb");
        }
        if self.cyclic != 0.0 && self.pitch == 0.0 {
            return fail("pitch of the cyclic error", self.pitch, "above 0");
        }
        if self.resonance > 0.0 && !(0.0..1.0).contains(&self.damping) {
            return fail("damping ratio", self.damping, "0 to below 1");
        }
        if self.delay >= period * (MAX_DELAY - 1) as f64 {
            let expected = format!("below {} control periods", MAX_DELAY - 1);
            return fail("delay, s", self.delay, &expected);
        }
        if self.limit.is_nan() || self.limit <= 0.0 {
            return fail("limit of the velocity command", self.limit, "above 0, or infinite");
        }
        Ok(())
    }
}

/// Free and forced response of the drive over a stretch dt of constant command:
/// y += g v + h w, v ← E v + (1-E) w.
#[derive(Clone, Copy, Debug)]
struct Hold {
    dt: f64,
    e: f64,
    g: f64,
    h: f64,
}

impl Hold {
    fn new(tau: f64, dt: f64) -> Self {
        let e = (-dt / tau).exp();
        // g = τ (1 - E); h = dt - g. exp_m1 keeps both exact for dt « τ.
        let g = if tau == 0.0 { 0.0 } else { -tau * (-dt / tau).exp_m1() };
        Self { dt, e: if tau == 0.0 { 0.0 } else { e }, g, h: dt - g }
    }
}

/// Response of the structure q'' + 2ζω q' + ω² q = ω² y over a period in which y is the cubic
/// through both ends' position and velocity. Exact for a cubic; between samples the drive differs
/// from it by less than T⁴ y''''/384.
#[derive(Clone, Copy, Debug)]
struct Structure {
    period: f64,
    alpha: f64,
    beta: f64,
    /// Free response [q, q'] ← [[f11, f12], [f21, f22]] [q, q'].
    free: [[f64; 2]; 2],
}

impl Structure {
    fn new(omega: f64, zeta: f64, period: f64) -> Self {
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        let decay = (-zeta * omega * period).exp();
        let (sin, cos) = (damped * period).sin_cos();
        let ratio = zeta * omega / damped;
        let free = [
            [decay * (cos + ratio * sin), decay * sin / damped],
            [-decay * omega * omega / damped * sin, decay * (cos - ratio * sin)],
        ];
        Self { period, alpha: 2.0 * zeta / omega, beta: 1.0 / (omega * omega), free }
    }

    /// New [q, q'] from the old ones and the motor's position and velocity at both ends.
    fn step(&self, q: [f64; 2], y0: f64, v0: f64, y1: f64, v1: f64) -> [f64; 2] {
        let t = self.period;
        let (alpha, beta) = (self.alpha, self.beta);
        // y = y0 + v0 s + c2 s² + c3 s³
        let slope = (y1 - y0) / t;
        let c2 = (3.0 * slope - 2.0 * v0 - v1) / t;
        let c3 = (v0 + v1 - 2.0 * slope) / (t * t);
        // Particular solution (1 + α D + β D²)⁻¹ y, exact for a cubic.
        let (k1, k2, k3) =
            (-alpha, alpha * alpha - beta, 2.0 * alpha * beta - alpha * alpha * alpha);
        let particular = |y: f64, d1: f64, d2: f64, d3: f64| {
            [y + k1 * d1 + k2 * d2 + k3 * d3, d1 + k1 * d2 + k2 * d3]
        };
        let p0 = particular(y0, v0, 2.0 * c2, 6.0 * c3);
        let p1 = particular(y1, v1, 2.0 * c2 + 6.0 * c3 * t, 6.0 * c3);
        let z = [q[0] - p0[0], q[1] - p0[1]];
        let f = &self.free;
        [p1[0] + f[0][0] * z[0] + f[0][1] * z[1], p1[1] + f[1][0] * z[0] + f[1][1] * z[1]]
    }
}

/// An axis in motion.
#[derive(Clone, Debug)]
pub struct Drive {
    axis: Axis,
    /// First stretch (with the older command) and second stretch of a period.
    early: Hold,
    late: Hold,
    /// Whole periods of delay before the late command.
    periods: usize,
    commands: [f64; MAX_DELAY],
    next: usize,
    structure: Option<Structure>,
    has_friction: bool,
    feedback: Feedback,
    period: f64,
    targets: [f64; 2],
    y: f64,
    v: f64,
    q: [f64; 2],
    play: f64,
    load: f64,
}

impl Drive {
    /// An axis at rest at `position` under a control period.
    ///
    /// # Errors
    /// Parameters out of range; the message names the axis by `name`.
    pub fn new(
        axis: &Axis,
        name: char,
        period: f64,
        feedback: Feedback,
        position: f64,
    ) -> Result<Self> {
        axis.check(name, period)?;
        let whole = (axis.delay / period).floor();
        let fraction = axis.delay - whole * period;
        let mut drive = Self {
            axis: *axis,
            early: Hold::new(axis.time_constant, fraction),
            late: Hold::new(axis.time_constant, period - fraction),
            periods: whole as usize,
            commands: [0.0; MAX_DELAY],
            next: 0,
            structure: (axis.resonance > 0.0)
                .then(|| Structure::new(axis.resonance, axis.damping, period)),
            has_friction: axis.friction.breakaway > 0.0 || axis.friction.drag != 0.0,
            feedback,
            period,
            targets: [position; 2],
            y: position,
            v: 0.0,
            q: [position, 0.0],
            play: position,
            load: position,
        };
        drive.load = drive.load_position();
        Ok(drive)
    }

    /// Let the load be `ahead` of where it stands and move at a speed, as it does when a log begins.
    ///
    /// `gone`: how far it has gone this way since it stood; so far is its play taken up, and the
    /// motor before it. Where the load is in the play of an axis that stands is not known: in the
    /// middle.
    pub fn start(&mut self, ahead: f64, speed: f64, gone: f64) {
        let half = 0.5 * self.axis.backlash;
        let motor = ahead + gone.max(-half).min(half);
        self.y += motor;
        self.v = speed;
        self.q = [self.q[0] + motor, speed];
        self.play += ahead;
        self.commands = [speed; MAX_DELAY];
        self.load = self.load_position();
    }

    /// Position the loop is closed on.
    #[must_use]
    pub fn measured(&self) -> f64 {
        match self.feedback {
            Feedback::Motor => self.y,
            Feedback::Load => self.load,
        }
    }

    /// Position of the load: where the axis really is.
    #[must_use]
    pub fn load(&self) -> f64 {
        self.load
    }

    /// Largest velocity command.
    #[must_use]
    pub fn limit(&self) -> f64 {
        self.axis.limit
    }

    /// Loop gain, 1/s.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.axis.gain
    }

    /// One control period to a target that the axis is `error` away from.
    pub fn follow(&mut self, error: f64, target: f64) {
        let axis = &self.axis;
        let mut w = axis.gain * error;
        if axis.velocity_forward != 0.0 || axis.acceleration_forward != 0.0 {
            let rate = (target - self.targets[0]) / self.period;
            let change = (rate - (self.targets[0] - self.targets[1]) / self.period) / self.period;
            w += axis.velocity_forward * rate + axis.acceleration_forward * change;
            self.targets = [target, self.targets[0]];
        }
        self.step(w);
    }

    /// One control period under velocity command `w` (mm/s, rad/s).
    pub fn step(&mut self, w: f64) {
        let (y0, v0) = (self.y, self.v);
        let w = w.clamp(-self.axis.limit, self.axis.limit);
        if self.axis.delay == 0.0 {
            self.drive(w, self.late);
        } else {
            self.commands[self.next] = w;
            let back = |n: usize| (self.next + MAX_DELAY - n) % MAX_DELAY;
            let (late, early) =
                (self.commands[back(self.periods)], self.commands[back(self.periods + 1)]);
            self.next = (self.next + 1) % MAX_DELAY;
            if self.early.dt > 0.0 {
                self.drive(early, self.early);
            }
            self.drive(late, self.late);
        }
        if let Some(structure) = &self.structure {
            self.q = structure.step(self.q, y0, v0, self.y, self.v);
        } else {
            self.q[0] = self.y;
        }
        self.load = self.load_position();
    }

    fn load_position(&mut self) -> f64 {
        let half = 0.5 * self.axis.backlash;
        // max and min, as clamp refuses the limits of a drive that has diverged.
        self.play = self.play.max(self.q[0] - half).min(self.q[0] + half);
        if self.axis.cyclic == 0.0 {
            return self.play;
        }
        self.play + self.axis.cyclic * (TAU * self.y / self.axis.pitch + self.axis.phase).sin()
    }

    fn drive(&mut self, w: f64, hold: Hold) {
        let w = w - self.axis.gain * self.axis.offset;
        if self.has_friction {
            self.drive_with_friction(w, hold);
        } else {
            self.y += hold.g * self.v + hold.h * w;
            self.v = hold.e * self.v + (1.0 - hold.e) * w;
        }
    }

    /// Motion with friction: the level (and what goes with the speed by direction) is that of the speed at the beginning of the stretch (the
    /// Stribeck curve moves within a period by less than dt·|dv/dt|/stribeck of its drop); the
    /// instant at which the axis stops is exact, and there it stays unless the command exceeds the
    /// level at rest.
    fn drive_with_friction(&mut self, w: f64, hold: Hold) {
        let f = self.axis.friction;
        let tau = self.axis.time_constant;
        let mut hold = hold;
        // At most: run until the stop, then start the other way.
        for _ in 0..3 {
            let direction = if self.v != 0.0 {
                self.v.signum()
            } else if w.abs() > f.breakaway {
                w.signum()
            } else {
                return;
            };
            let drop = if f.stribeck > 0.0 { (-(self.v / f.stribeck).powi(2)).exp() } else { 0.0 };
            let level = f.coulomb + (f.breakaway - f.coulomb) * drop;
            let target = w - direction * level - f.drag * self.v.abs();
            let end = hold.e * self.v + (1.0 - hold.e) * target;
            if end * direction >= 0.0 {
                self.y += hold.g * self.v + hold.h * target;
                self.v = end;
                return;
            }
            let stop = tau * ((self.v - target) / -target).ln();
            // max and min, as clamp refuses the time that is left to a drive that has diverged.
            let until = Hold::new(tau, stop.max(0.0).min(hold.dt));
            self.y += until.g * self.v + until.h * target;
            self.v = 0.0;
            hold = Hold::new(tau, hold.dt - until.dt);
        }
    }
}

/// How far an axis has gone the way it goes at the first of its commands: from where it stood, at
/// the acceleration that it has there; without end if it does not come from there.
fn gone_before(commands: &[f64]) -> f64 {
    let [first, second, third, ..] = *commands else {
        return 0.0;
    };
    let more = third - 2.0 * second + first; // of the step, a period later
    let step = second - first - 0.5 * more; // at the first command
    if step * (second - first) <= 0.0 {
        0.0 // it turns or begins there
    } else if step * more > 0.0 {
        0.5 * step * step / more
    } else {
        step * f64::INFINITY
    }
}

/// Load positions of drives with each of many parameters that follow the same commands, one a control
/// period; every `stride`-th of them, one drive after the other. On all cores. `starts`: of each drive,
/// how far its load begins ahead of the first command, and its speed then.
///
/// # Errors
/// Parameters out of range, a stride of 0, fewer starts than axes.
pub fn responses(
    axes: &[Axis],
    starts: &[[f64; 2]],
    name: char,
    period: f64,
    feedback: Feedback,
    commands: &[f64],
    stride: usize,
) -> Result<Vec<f64>> {
    if stride == 0 {
        return Err(Error::input("stride", stride, "1 or more"));
    }
    if starts.len() != axes.len() {
        return Err(Error::input("starts", starts.len(), format!("{} of them", axes.len())));
    }
    let first = commands.first().copied().unwrap_or(0.0);
    let gone = gone_before(commands);
    let follow = |(axis, start): (&Axis, &[f64; 2])| {
        let mut drive = Drive::new(axis, name, period, feedback, first)?;
        drive.start(start[0], start[1], gone);
        let mut out = Vec::with_capacity(commands.len().div_ceil(stride));
        for (i, command) in commands.iter().enumerate() {
            if i.is_multiple_of(stride) {
                out.push(drive.load());
            }
            drive.follow(command - drive.measured(), *command);
        }
        Ok(out)
    };
    if let ([axis], [start]) = (axes, starts) {
        return follow((axis, start)); // no need to wake other threads
    }
    let each: Vec<Vec<f64>> = axes.par_iter().zip(starts).map(follow).collect::<Result<_>>()?;
    Ok(each.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAY: f64 = 0.02;
    const GAIN: f64 = 80.0;

    /// Load positions of an axis with play whose motor begins `ahead` of its commands at a speed,
    /// its load `taken` behind the motor.
    fn loads(commands: &[f64], ahead: f64, taken: f64, speed: f64) -> Vec<f64> {
        let axis = Axis { backlash: PLAY, ..Axis::linear(GAIN, 0.005) };
        let start = [ahead - taken, speed];
        responses(&[axis], &[start], 'X', 1e-3, Feedback::Motor, commands, 1).unwrap()
    }

    #[test]
    fn play_is_taken_up_where_a_log_begins_in_motion() {
        let half = 0.5 * PLAY;
        for sense in [1.0, -1.0] {
            let steady: Vec<f64> = (0..9).map(|i| sense * (5.0 + 0.1 * f64::from(i))).collect();
            let lag = sense * 100.0 / GAIN;
            let found = loads(&steady, -lag, sense * half, sense * 100.0);
            for (load, command) in found.iter().zip(&steady) {
                assert!((load - (command - lag - sense * half)).abs() < 1e-12);
            }
        }
        let slowing = [5.0, 5.1, 5.19, 5.27];
        let found = loads(&slowing, 0.0, half, 100.0);
        assert!((found[0] - 4.99).abs() < 1e-12 && found[1] > found[0] + 0.05);
    }

    #[test]
    fn play_is_not_taken_up_where_an_axis_starts() {
        // The load stands until the motor has gone half the play.
        let from_rest: Vec<f64> = (0..150).map(|i| 5.0 + 1e-6 * f64::from(i * i)).collect();
        let found = loads(&from_rest, 0.0, 0.0, 0.0);
        assert!(found[..60].iter().all(|load| (load - 5.0).abs() < 1e-12));
        assert!(found[149] > 5.005);
        assert!((loads(&[5.0; 4], 0.0, 0.0, 0.0)[3] - 5.0).abs() < 1e-12);
        // It has gone 0.0025² / (2 · 0.001): less than half the play, the rest is still to go.
        let gone = 0.003_125;
        let drive = |more: f64| loads(&[5.0, 5.003, 5.007, 5.012], 0.0, gone, more);
        assert!((drive(0.0)[0] - 4.996_875).abs() < 1e-9);
        assert!((drive(6.0)[1] - 4.996_875).abs() < 1e-9 && drive(8.0)[1] > 4.996_876);
    }

    #[test]
    fn a_drive_that_diverges_ends_in_no_panic() {
        let mut axis = Axis::linear(2355.0, 7e-13);
        axis.friction.drag = 0.99;
        let commands: Vec<f64> = (0..3000).map(|i| 0.095 * f64::from(i)).collect();
        let start = [-19.2, -3.6e9];
        let found = responses(&[axis], &[start], 'X', 1e-3, Feedback::Motor, &commands, 1).unwrap();
        assert_eq!(found.len(), commands.len());
    }
}
