//! When each touch of a plan happens, and from which sense its axes come.

use nalgebra::Vector3;

use super::{PlanAxes, PlanOptions, PlannedTouch};
use crate::machine::MAX_ROTARY;

/// How far an axis backs off to come from the expected sense, rad.
pub const BACK_OFF: f64 = 5.0 * crate::units::DEG;

/// Keeps time, and where the axes came from.
pub(super) struct Clock<'a> {
    options: &'a PlanOptions,
    swing: f64,
    time: f64,
    at: Option<Vector3<f64>>,
    rotary: Option<[f64; MAX_ROTARY]>,
    /// Sense of the last turn of each axis.
    pub(super) sense: [f64; MAX_ROTARY],
}

impl<'a> Clock<'a> {
    pub(super) const fn new(options: &'a PlanOptions, swing: f64) -> Self {
        Self { options, swing, time: 0.0, at: None, rotary: None, sense: [0.0; MAX_ROTARY] }
    }

    /// Turns the axes. C always comes from the round's sense (it has no ends); a tilting axis does
    /// where both senses are expected, and otherwise goes straight there.
    pub(super) fn turn(
        &mut self,
        axes: &PlanAxes,
        to: &[f64; MAX_ROTARY],
        sense: f64,
        both_senses: bool,
    ) {
        let from = self.rotary.unwrap_or([0.0; MAX_ROTARY]);
        let first = self.rotary.is_none();
        let mut longest: f64 = 0.0;
        for axis in [axes.turning, axes.tilting].into_iter().flatten() {
            let way = to[axis] - from[axis];
            let is_turning = axes.turning == Some(axis);
            let moves = way != 0.0 || (is_turning && first) || (both_senses && !first);
            if !moves {
                continue;
            }
            let expected = if is_turning || both_senses { sense } else { way.signum() };
            let back = if way * expected > 0.0 { 0.0 } else { 2.0 * BACK_OFF };
            longest = longest.max(way.abs() + back);
            self.sense[axis] = expected;
        }
        self.rotary = Some(*to);
        if longest > 0.0 {
            let lift = self.at.take().map_or(0.0, |at| (self.swing - at.z).abs());
            self.time += longest / self.options.rotary_speed + lift / self.options.rapid;
        }
    }

    /// The time of the trigger; afterwards the probe stands at the start of its approach.
    pub(super) fn touch(&mut self, touch: &PlannedTouch) -> f64 {
        let way = match self.at {
            Some(at) => (touch.start - at).norm() + 4.0 * self.options.clearance,
            None => (self.swing - touch.start.z).abs(),
        };
        let approach = (touch.contact - touch.start).norm() / touch.feed;
        self.time += way / self.options.rapid + approach;
        let triggered = self.time;
        self.time += approach.min((touch.contact - touch.start).norm() / self.options.rapid);
        self.at = Some(touch.start);
        triggered
    }
}
