//! The touch probe: its ball and its trigger.

use crate::{Error, Result};

/// A touch-trigger probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Radius of the ball in mm.
    pub ball_radius: f64,
    /// Travel between two looks at the probe in mm; 0: the contact itself is recorded.
    pub tick: f64,
}

impl Probe {
    /// A probe, checked.
    ///
    /// # Errors
    /// A radius that is not positive, a tick that is negative.
    pub fn new(ball_radius: f64, tick: f64) -> Result<Self> {
        if !(ball_radius.is_finite() && ball_radius > 0.0) {
            let what = "radius of the probe's ball in mm";
            return Err(Error::input(what, ball_radius, "a positive number"));
        }
        if !(tick.is_finite() && tick >= 0.0) {
            return Err(Error::input("tick of the probe in mm", tick, "0 or a positive number"));
        }
        Ok(Self { ball_radius, tick })
    }

    /// Travel recorded for a contact after `travel` mm: the first tick at or after it, counted from
    /// the start of the move.
    #[must_use]
    pub fn trigger(&self, travel: f64) -> f64 {
        if self.tick == 0.0 { travel } else { (travel / self.tick).ceil() * self.tick }
    }

    /// How late the trigger comes on average, mm: half a tick. Every estimate takes it off.
    #[must_use]
    pub const fn mean_delay(&self) -> f64 {
        0.5 * self.tick
    }
}
