//! From which sense each axis comes.

use super::PlanAxes;
use crate::machine::MAX_ROTARY;

/// Keeps where the axes are, and the sense of the last turn of each.
pub(super) struct Senses {
    rotary: Option<[f64; MAX_ROTARY]>,
    /// Sense of the last turn of each axis; 0: not turned.
    pub(super) last: [f64; MAX_ROTARY],
}

impl Senses {
    pub(super) const fn new() -> Self {
        Self { rotary: None, last: [0.0; MAX_ROTARY] }
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
        for axis in [axes.turning, axes.tilting].into_iter().flatten() {
            let way = to[axis] - from[axis];
            let is_turning = axes.turning == Some(axis);
            if way != 0.0 || (is_turning && first) || (both_senses && !first) {
                self.last[axis] = if is_turning || both_senses { sense } else { way.signum() };
            }
        }
        self.rotary = Some(*to);
    }
}
