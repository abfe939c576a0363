//! The forward model of the diameter error: what each cause adds to the diameter, and its derivative.
//!
//! Errors are measured minus nominal diameter. With s the length cut since the tool set in, t the
//! cutting time since then, z the distance from the chuck face and L the overhang:
//!
//! | cause | error of the diameter | parameters |
//! |---|---|---|
//! | [`Cause::ToolHeating`] | -E (1 - exp(-t/τ)): the tool grows into the part | E, τ |
//! | [`Cause::ToolWear`] | +q t: the edge recedes by q/2 | q |
//! | [`Cause::Taper`] | +2 α z: the slide is not parallel to the spindle | α |
//! | [`Cause::Bending`] | +B (z/L)³ f d⁻⁴: the part gives way like a cantilever, 2 F z³ / 3 E I | B |
//! | [`Cause::ChuckTilt`] | +B (z/L)² f: chuck and spindle tilt under the moment F z | B |
//! | [`Cause::Barrel`] | +4 M (z/L)(1 - z/L): the slide is bent | M |
//! | [`Cause::WorkpieceHeating`] | -E d (1 - exp(-t/τ)): the part is cut warm and shrinks as it cools | E, τ |
//! | [`Cause::BlockAcceleration`] | -a (1 - √(u/w)), u < w: the feed falls to zero at the start of a block and with it the force that bends the part away | a, w |
//! | [`Cause::Chatter`] | a cos(2π s/p) + b sin(2π s/p) | a, b, p |
//!
//! f is the cutting force over that of the first cut (as the depth of cut), d the diameter over that
//! of the first cut. u is the distance to the nearest start of a block and w the way in which the
//! axis reaches its feed: v²/(2 · acceleration); uniform acceleration gives v ∝ √u.

use std::f64::consts::TAU;

use crate::{Error, Result};

/// Where and how a diameter was cut; mm and s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Distance from the chuck face, mm.
    pub z_mm: f64,
    /// Length cut since the tool set in, mm.
    pub length_mm: f64,
    /// Cutting time since the tool set in cold, s.
    pub time_s: f64,
    /// Cutting force over that of the reference cut.
    pub force: f64,
    /// Diameter over that of the reference cut.
    pub diameter: f64,
    /// Distance along z to the nearest start of a block, mm; infinite without any.
    pub to_block_mm: f64,
}

/// A cause of a diameter error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Amplitude E, mm; time constant τ, s.
    ToolHeating,
    /// Growth q of the diameter, mm/s.
    ToolWear,
    /// Angle α, rad.
    Taper,
    /// Error B at the free end, mm.
    Bending,
    /// Error B at the free end, mm.
    ChuckTilt,
    /// Error M in the middle of the overhang, mm.
    Barrel,
    /// Amplitude E at the reference diameter, mm; time constant τ, s.
    WorkpieceHeating,
    /// What the diameter loses where the axis stands, a, mm; way of acceleration w, mm.
    BlockAcceleration,
    /// a, b, mm; pitch p, mm.
    Chatter,
}

impl Cause {
    /// Every cause.
    pub const ALL: [Self; 9] = [
        Self::ToolHeating,
        Self::ToolWear,
        Self::Taper,
        Self::Bending,
        Self::ChuckTilt,
        Self::Barrel,
        Self::WorkpieceHeating,
        Self::BlockAcceleration,
        Self::Chatter,
    ];

    /// Its id in files and results.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::ToolHeating => "tool_heating",
            Self::ToolWear => "tool_wear",
            Self::Taper => "taper",
            Self::Bending => "bending",
            Self::ChuckTilt => "chuck_tilt",
            Self::Barrel => "barrel",
            Self::WorkpieceHeating => "workpiece_heating",
            Self::BlockAcceleration => "block_acceleration",
            Self::Chatter => "chatter",
        }
    }

    /// The cause of this id.
    ///
    /// # Errors
    /// [`Error::Unknown`].
    pub fn of(id: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|cause| cause.id() == id)
            .ok_or_else(|| Error::unknown("cause", id, Self::ALL.map(Self::id)))
    }

    /// How many parameters it has.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::ToolHeating | Self::WorkpieceHeating | Self::BlockAcceleration => 2,
            Self::Chatter => 3,
            _ => 1,
        }
    }

    /// Error of the diameter, mm, and its derivatives by the parameters (the first
    /// [`Cause::count`]).
    #[must_use]
    pub fn error(self, parameters: [f64; 3], cut: &Cut, overhang_mm: f64) -> (f64, [f64; 3]) {
        let [p, q, r] = parameters;
        let share = cut.z_mm / overhang_mm;
        let linear = |shape: f64| (p * shape, [shape, 0.0, 0.0]);
        match self {
            Self::ToolHeating => heating(p, q, cut.time_s, 1.0),
            Self::WorkpieceHeating => heating(p, q, cut.time_s, cut.diameter),
            Self::BlockAcceleration if cut.to_block_mm >= q => (0.0, [0.0; 3]),
            Self::BlockAcceleration => {
                let share = (cut.to_block_mm / q).sqrt();
                (-p * (1.0 - share), [share - 1.0, -0.5 * p * share / q, 0.0])
            }
            Self::ToolWear => linear(cut.time_s),
            Self::Taper => linear(2.0 * cut.z_mm),
            Self::Bending => linear(share.powi(3) * cut.force / cut.diameter.powi(4)),
            Self::ChuckTilt => linear(share * share * cut.force),
            Self::Barrel => linear(4.0 * share * (1.0 - share)),
            Self::Chatter => {
                let angle = TAU * cut.length_mm / r;
                let (sine, cosine) = angle.sin_cos();
                let by_pitch = (p * sine - q * cosine) * angle / r;
                (p * cosine + q * sine, [cosine, sine, by_pitch])
            }
        }
    }
}

/// -E d (1 - exp(-t/τ)) and its derivatives.
fn heating(amplitude: f64, tau: f64, time: f64, diameter: f64) -> (f64, [f64; 3]) {
    let decay = (-time / tau).exp();
    let rise = diameter * (1.0 - decay);
    let by_tau = amplitude * diameter * decay * time / (tau * tau);
    (-amplitude * rise, [-rise, by_tau, 0.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_errors() {
        let cut = Cut {
            z_mm: 40.0,
            length_mm: 25.0,
            time_s: 12.0,
            force: 1.3,
            diameter: 0.9,
            to_block_mm: 11.0,
        };
        for cause in Cause::ALL {
            let at = [0.02, if cause == Cause::Chatter { 0.01 } else { 30.0 }, 7.0];
            let (_, exact) = cause.error(at, &cut, 65.0);
            for i in 0..cause.count() {
                let step = 1e-5 * at[i];
                let moved = |by: f64| {
                    let mut there = at;
                    there[i] += by;
                    cause.error(there, &cut, 65.0).0
                };
                let slope = (moved(step) - moved(-step)) / (2.0 * step);
                assert!((slope - exact[i]).abs() < 1e-7 * (1.0 + exact[i].abs()), "{cause:?} {i}");
            }
        }
    }

    #[test]
    fn the_law_of_the_dry_run() {
        let cut = Cut {
            z_mm: 0.0,
            length_mm: 0.0,
            time_s: 34.0,
            force: 1.0,
            diameter: 1.0,
            to_block_mm: f64::INFINITY,
        };
        let (error, _) = Cause::ToolHeating.error([0.043, 34.0, 0.0], &cut, 65.0);
        assert!((error + 0.043 * (1.0 - (-1.0_f64).exp())).abs() < 1e-15);
    }
}
