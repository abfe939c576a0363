//! The diameter that a program cuts, by z of contact.

use super::windows::programmed_shift;
use crate::Result;
use crate::nc::Program;
use crate::nc::contour::contour_blocks;
use crate::nc::follow::{moves, moves_of};
use crate::nc::path::{Motion, Path, Start};
use crate::turning::geometry::{Element, MIN_LENGTH_MM};
use crate::turning::profile::{Follows, element_of};

/// The feed moves: of the finishing contour where the program has one between P and Q.
///
/// # Errors
/// As [`moves`].
pub fn contour_path(program: &Program, start: &Start) -> Result<Path> {
    match contour_blocks(program)? {
        Some(blocks) => moves_of(program, blocks, start),
        None => moves(program, start),
    }
}

/// The diameter that a path cuts, by z of contact.
pub struct Diameters {
    /// Runs of pieces that follow each other: each with falling or rising z.
    runs: Vec<Vec<Piece>>,
}

struct Piece {
    from: [f64; 2],
    to: [f64; 2],
    element: Element,
}

impl Diameters {
    /// Feed moves of a path along which z changes; X is as programmed, the nose taken into account
    /// for z only.
    #[must_use]
    pub fn new(path: &Path, follows: Follows) -> Self {
        let mut runs: Vec<Vec<Piece>> = Vec::new();
        let mut joined = false;
        for m in &path.moves {
            let element = element_of(m).ok().filter(|_| m.motion != Motion::Rapid);
            let dz = m.to.axes[2] - m.from.axes[2];
            let Some(element) = element else {
                joined = false;
                continue;
            };
            if dz.abs() < MIN_LENGTH_MM {
                continue;
            }
            let slopes = [element.from(), element.to()].map(|p| {
                let d = element.direction(p);
                if d[0].abs() > 1e-9 { d[1] / d[0] } else { 0.0 }
            });
            let [from, to] = [(element.from(), slopes[0]), (element.to(), slopes[1])]
                .map(|(p, slope)| [p[0] - programmed_shift(follows, slope), p[1]]);
            let piece = Piece { from, to, element };
            match runs.last_mut() {
                Some(run)
                    if joined
                        && run
                            .last()
                            .is_some_and(|l| (l.to[0] - l.from[0]) * (to[0] - from[0]) > 0.0) =>
                {
                    run.push(piece);
                }
                _ => runs.push(vec![piece]),
            }
            joined = true;
        }
        Self { runs }
    }

    /// Diameter at `z`, mm, of the first run that passes there; `None` if none does.
    #[must_use]
    pub fn at(&self, z: f64) -> Option<f64> {
        self.runs.iter().find_map(|run| {
            let falling = run.first().is_some_and(|p| p.to[0] < p.from[0]);
            let index = run
                .partition_point(|p| if falling { p.to[0] > z + 1e-9 } else { p.to[0] < z - 1e-9 });
            let piece = run.get(index)?;
            let (high, low) = (piece.from[0].max(piece.to[0]), piece.from[0].min(piece.to[0]));
            if z > high + MIN_LENGTH_MM || z < low - MIN_LENGTH_MM {
                return None;
            }
            let shift = piece.element.from()[0] - piece.from[0];
            let shift_to = piece.element.to()[0] - piece.to[0];
            let share = ((z - piece.from[0]) / (piece.to[0] - piece.from[0])).clamp(0.0, 1.0);
            piece.element.x_at(z + shift + share * (shift_to - shift)).map(|x| 2.0 * x)
        })
    }
}

/// Change of the diameter from one program to another at each z, mm; `None` where either does not
/// cut.
///
/// # Errors
/// As [`contour_path`].
pub fn change(
    before: &Program,
    after: &Program,
    z: &[f64],
    follows: Follows,
    start: &Start,
) -> Result<Vec<Option<f64>>> {
    let was = Diameters::new(&contour_path(before, start)?, follows);
    let is = Diameters::new(&contour_path(after, start)?, follows);
    Ok(z.iter().map(|&z| is.at(z).zip(was.at(z)).map(|(is, was)| is - was)).collect())
}
