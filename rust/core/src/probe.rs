//! The touch probe: its ball and its trigger.

use crate::{Error, Result};

/// Part of a tick by which a contact may come after a look and still be seen by it: rounding.
const AT_ONCE: f64 = 1e-6;

/// A touch-trigger probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Radius of the ball in mm.
    pub ball_radius: f64,
    /// Travel between two looks at the probe in mm; 0: the contact itself is recorded.
    pub tick: f64,
    /// Time between two looks at the probe in s, for a control that looks every servo period: the
    /// tick is then the feed times it. 0: `tick` holds at every feed.
    pub period: f64,
}

impl Probe {
    /// A probe that is looked at every `tick` mm of travel, checked.
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
        Ok(Self { ball_radius, tick, period: 0.0 })
    }

    /// The same probe, looked at every `period` seconds.
    ///
    /// # Errors
    /// A period that is negative.
    pub fn looked_at_every(self, period: f64) -> Result<Self> {
        if !(period.is_finite() && period >= 0.0) {
            let what = "time between two looks at the probe in s";
            return Err(Error::input(what, period, "0 or a positive number"));
        }
        Ok(Self { period, ..self })
    }

    /// Travel between two looks at a feed in mm/s.
    #[must_use]
    pub fn tick_at(&self, feed: f64) -> f64 {
        if self.period > 0.0 { self.period * feed } else { self.tick }
    }

    /// Travel recorded for a contact after `travel` mm at a feed in mm/s: the first look at or after
    /// it, counted from the start of the move.
    #[must_use]
    pub fn trigger(&self, travel: f64, feed: f64) -> f64 {
        let tick = self.tick_at(feed);
        if tick == 0.0 { travel } else { (travel / tick - AT_ONCE).ceil() * tick }
    }

    /// How late the trigger comes on average, mm: half a tick. Every estimate takes it off.
    #[must_use]
    pub fn mean_delay(&self, feed: f64) -> f64 {
        0.5 * self.tick_at(feed)
    }
}
