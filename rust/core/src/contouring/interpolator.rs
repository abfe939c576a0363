//! The interpolator: from a path and a feed to one reference sample a control period.
//!
//! Motion along the path is a chain of phases of constant acceleration; S(t) is evaluated in closed
//! form and turned into u by the exact arc length, so there is no drift of an approximate
//! interpolation (the paper's interpolator is not described; its samples are those of constant feed).

use nalgebra::Vector3;

use super::path::Path;
use crate::error::{Error, Result};
use crate::machine::FiveAxis;
use crate::machine::five_axis::POLE;

/// How fast the path is travelled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feed {
    /// Programmed feed V along the path in the part's frame, mm/s.
    pub feed: f64,
    /// Time to reach it from rest, s; 0 starts at full feed. The acceleration is V over this time.
    pub acceleration_time: f64,
    /// Slow down to rest at the end with the same acceleration. Without it the samples end at full
    /// feed before the end of the path, as in the paper.
    pub decelerate: bool,
    /// Largest normal acceleration v²κ, mm/s²; infinite for no limit. With a limit the feed also
    /// stops at corners.
    pub normal_acceleration: f64,
    /// Time the reference rests at the end of the path, s (used with `decelerate`).
    pub dwell: f64,
}

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug)]
struct Phase {
    t: f64,
    s: f64,
    v: f64,
    a: f64,
}

/// Number of intervals of arc length on which a curvature-limited feed is planned. Between nodes v²
/// is linear in s; the limit holds at the nodes, and between them to the second order of the interval.
const NODES: usize = 4096;

/// Longest reference, in control periods: more than an hour at 1 ms.
const MAX_SAMPLES: f64 = 5e6;

impl Feed {
    fn check(&self) -> Result<()> {
        let at_least_0 = |what: &str, value: f64| {
            if value.is_finite() && value >= 0.0 {
                Ok(())
            } else {
                Err(Error::input(what, value, "a finite number, 0 or more"))
            }
        };
        if !(self.feed.is_finite() && self.feed > 0.0) {
            return Err(Error::input("feed, mm/s", self.feed, "a finite number above 0"));
        }
        at_least_0("acceleration time, s", self.acceleration_time)?;
        at_least_0("dwell, s", self.dwell)?;
        if self.normal_acceleration.is_nan() || self.normal_acceleration <= 0.0 {
            let expected = "above 0, or infinite for no limit";
            return Err(Error::input(
                "normal acceleration, mm/s^2",
                self.normal_acceleration,
                expected,
            ));
        }
        let limited = self.normal_acceleration.is_finite() || self.decelerate;
        if limited && self.acceleration_time == 0.0 {
            let expected = "above 0 where the feed has to change (deceleration, curvature limit)";
            return Err(Error::input("acceleration time, s", 0.0, expected));
        }
        Ok(())
    }

    /// Phases over the path and the time at which its end is reached.
    fn phases(&self, path: &Path) -> (Vec<Phase>, f64) {
        let length = path.length();
        let v = self.feed;
        if self.normal_acceleration.is_finite() {
            return self.limited_phases(path);
        }
        if self.acceleration_time == 0.0 {
            return (vec![Phase { t: 0.0, s: 0.0, v, a: 0.0 }], length / v);
        }
        let a = v / self.acceleration_time;
        let ramps = if self.decelerate { 2.0 } else { 1.0 };
        // Where the path is too short for the feed, the peak is what two (one) ramps reach.
        let peak = v.min((2.0 * a * length / ramps).sqrt());
        let ramp_time = peak / a;
        let ramp_length = 0.5 * peak * ramp_time;
        let cruise_length = length - ramps * ramp_length;
        let cruise_end = ramp_time + cruise_length / peak;
        let mut phases = vec![
            Phase { t: 0.0, s: 0.0, v: 0.0, a },
            Phase { t: ramp_time, s: ramp_length, v: peak, a: 0.0 },
        ];
        if self.decelerate {
            phases.push(Phase { t: cruise_end, s: ramp_length + cruise_length, v: peak, a: -a });
        }
        (phases, cruise_end + (ramps - 1.0) * ramp_time)
    }

    /// v² by a forward and a backward pass over nodes of arc length, then one phase an interval.
    fn limited_phases(&self, path: &Path) -> (Vec<Phase>, f64) {
        let a = self.feed / self.acceleration_time;
        let mut nodes: Vec<f64> =
            (0..=NODES).map(|i| path.length() * i as f64 / NODES as f64).collect();
        let corners = path.corners();
        nodes.extend(&corners);
        nodes.sort_by(f64::total_cmp);
        nodes.dedup_by(|b, a| (*b - *a).abs() < 1e-9 * path.length());
        let mut square: Vec<f64> = nodes
            .iter()
            .map(|&s| {
                let curvature = path.frame(path.at_length(s)).curvature();
                let allowed = self.normal_acceleration / curvature.max(f64::MIN_POSITIVE);
                (self.feed * self.feed).min(allowed)
            })
            .collect();
        for corner in corners {
            let nearest = nodes.partition_point(|&s| s < corner - 1e-9 * path.length());
            square[nearest.min(nodes.len() - 1)] = 0.0;
        }
        let last = square.len() - 1;
        square[0] = 0.0;
        if self.decelerate {
            square[last] = 0.0;
        }
        for i in 1..=last {
            square[i] = square[i].min(square[i - 1] + 2.0 * a * (nodes[i] - nodes[i - 1]));
        }
        for i in (0..last).rev() {
            square[i] = square[i].min(square[i + 1] + 2.0 * a * (nodes[i + 1] - nodes[i]));
        }
        let mut phases = Vec::with_capacity(last);
        let mut t = 0.0;
        for i in 0..last {
            let (v0, v1) = (square[i].sqrt(), square[i + 1].sqrt());
            let ds = nodes[i + 1] - nodes[i];
            phases.push(Phase {
                t,
                s: nodes[i],
                v: v0,
                a: (square[i + 1] - square[i]) / (2.0 * ds),
            });
            t += 2.0 * ds / (v0 + v1);
        }
        (phases, t)
    }
}

/// Reference samples: everything the controller may know of the path.
#[derive(Clone, Debug, Default)]
pub struct Reference {
    /// Control period, s.
    pub period: f64,
    /// Path parameter of each sample.
    pub u: Vec<f64>,
    /// Tool tip R(k), part frame, mm.
    pub point: Vec<Vector3<f64>>,
    /// Unit tool axis O(k), part frame.
    pub tool: Vec<Vector3<f64>>,
    /// Axis positions x, y, z (mm) and rotary (rad) by the controller's inverse kinematics.
    pub axes: Vec<[f64; 5]>,
}

impl Reference {
    /// Samples of a path at a feed, with the inverse kinematics of `machine`.
    ///
    /// Sample k is at S(kT); samples end before the end of the path is reached, unless the feed
    /// slows down to rest there: then the end is the last sample, repeated over the dwell.
    ///
    /// Where the tool axis lies along the second rotary axis (C of a `trt-ca`), that is not determined:
    /// at the start it takes the direction in which the tool axis leaves, later it is held.
    ///
    /// # Errors
    /// Feed or period that are not usable; fewer than 4 samples; a tool axis the machine cannot take.
    pub fn new(path: &Path, feed: Feed, period: f64, machine: &FiveAxis) -> Result<Self> {
        feed.check()?;
        if !(period.is_finite() && period > 0.0) {
            return Err(Error::input("control period, s", period, "a finite number above 0"));
        }
        let (phases, end) = feed.phases(path);
        let moving = (end / period).ceil();
        let dwell = if feed.decelerate { (feed.dwell / period).ceil() + 1.0 } else { 0.0 };
        if !(4.0..=MAX_SAMPLES).contains(&(moving + dwell)) {
            let expected = format!("4 to {MAX_SAMPLES:e}: change feed, period or path");
            return Err(Error::input("reference samples", moving + dwell, expected));
        }
        let count = (moving + dwell) as usize;
        let mut out = Self {
            period,
            u: Vec::with_capacity(count),
            point: Vec::with_capacity(count),
            tool: Vec::with_capacity(count),
            axes: Vec::with_capacity(count),
        };
        let mut phase = 0;
        let (_, u_end) = path.span();
        let free = 3 + machine.free_axis();
        let mut near = start(path, machine);
        for k in 0..count {
            let t = k as f64 * period;
            while phase + 1 < phases.len() && phases[phase + 1].t <= t {
                phase += 1;
            }
            let p = phases[phase];
            let dt = t - p.t;
            let u = if t < end { path.at_length(p.s + dt * (p.v + 0.5 * p.a * dt)) } else { u_end };
            if u >= u_end && !feed.decelerate {
                break;
            }
            let frame = path.frame(u);
            let tool = frame.tool();
            let axes = machine.inverse(&frame.r, &tool, near)?;
            near = axes[free];
            out.u.push(u);
            out.point.push(frame.r);
            out.tool.push(tool);
            out.axes.push(axes);
        }
        Ok(out)
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.u.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.u.is_empty()
    }
}

/// The free axis at the start: of the tool axis, or of the direction in which it leaves that axis.
fn start(path: &Path, machine: &FiveAxis) -> f64 {
    let free = machine.free_axis();
    let frame = path.frame(path.span().0);
    let (o, o1) = (frame.tool(), frame.tool_derivative());
    if machine.off_pole(&o) >= POLE || machine.off_pole(&o1) < POLE {
        return machine.rotary(&o, 0.0, true)[free];
    }
    // A little way off: for the nominal machine the direction is that of the derivative.
    let leaving = o + o1 * (1e-7 / o1.norm());
    machine.rotary(&leaving.normalize(), 0.0, true)[free]
}
