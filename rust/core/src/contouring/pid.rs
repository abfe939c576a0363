//! The coupling controller C(z) of eq. (6), one for each of the five axes.

/// Gains of C(z) = P + I T z/(z-1) + D (z-1)/(T z), as ratios to the axial gain K_p.
///
/// Table 1 gives C_P, C_I, C_D and K_p in the drives' own units (µm, degrees, counts; 5000 µm to
/// the degree of the motor); only the ratios and the product K·K_p enter the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// C_P / K_p, a number.
    pub proportional: f64,
    /// C_I / K_p, 1/s.
    pub integral: f64,
    /// C_D / K_p, s.
    pub derivative: f64,
}

/// State of C(z).
#[derive(Clone, Copy, Debug, Default)]
pub struct Pid {
    sum: f64,
    last: f64,
}

impl Pid {
    /// Output for this error. The sum is kept in `self`; take it back by [`Pid::hold`] where the
    /// axis saturates.
    pub fn step(&mut self, gains: &Gains, error: f64, period: f64) -> f64 {
        self.sum += period * error;
        let slope = (error - self.last) / period;
        self.last = error;
        gains.proportional * error + gains.integral * self.sum + gains.derivative * slope
    }

    /// Undoes the last integration (anti-windup: the sum is clamped while the command saturates).
    pub fn hold(&mut self, error: f64, period: f64) {
        self.sum -= period * error;
    }

    /// The sum of errors, error times s.
    #[must_use]
    pub fn sum(&self) -> f64 {
        self.sum
    }
}
