//! True errors: the foot point on the path itself, solved, not sampled.

use nalgebra::Vector3;

use super::path::Path;

/// Follows the foot point of a moving tool tip along a path: Newton on (R(u) - P)·R'(u) = 0 from the
/// foot before, so that another stretch of a path near itself is not mistaken for this one.
///
/// Clamped at both ends of the path; at a corner the foot may rest on the corner itself.
#[derive(Clone, Debug)]
pub struct Foot<'a> {
    path: &'a Path,
    piece: usize,
    u: f64,
}

impl<'a> Foot<'a> {
    /// Starts at parameter u.
    #[must_use]
    pub fn new(path: &'a Path, u: f64) -> Self {
        Self { path, piece: path.piece_at(u), u }
    }

    /// Parameter of the foot of `p`.
    pub fn find(&mut self, p: &Vector3<f64>) -> f64 {
        let pieces = self.path.pieces();
        let mut from = None;
        // Crosses at most every joint once.
        for _ in 0..=pieces.len() {
            let (u, side) = self.within(p);
            self.u = u;
            let next = match side {
                0 => break,
                1 if self.piece + 1 < pieces.len() => self.piece + 1,
                -1 if self.piece > 0 => self.piece - 1,
                _ => break,
            };
            // Sent back to the piece it came from: the corner is nearest.
            if from == Some(next) {
                break;
            }
            from = Some(self.piece);
            self.piece = next;
            self.u = if side > 0 { pieces[next].start } else { pieces[next].end };
        }
        self.u
    }

    /// Foot within the present piece, and the end (-1, 1) at which it would leave it, or 0.
    fn within(&self, p: &Vector3<f64>) -> (f64, i8) {
        let piece = &self.path.pieces()[self.piece];
        let mut u = self.u.clamp(piece.start, piece.end);
        for _ in 0..50 {
            let frame = piece.frame(u);
            let out = frame.r - p;
            let slope = out.dot(&frame.r1);
            let square = frame.r1.norm_squared();
            let curvature = square + out.dot(&frame.r2);
            // Where the distance is not convex, the Gauss-Newton step still goes downhill.
            let newton = curvature > 0.1 * square;
            let second = if newton { curvature } else { square };
            let next = (u - slope / second).clamp(piece.start, piece.end);
            let step = next - u;
            u = next;
            if step == 0.0 {
                let side = if slope == 0.0 {
                    0
                } else if u >= piece.end && slope < 0.0 {
                    1
                } else if u <= piece.start && slope > 0.0 {
                    -1
                } else {
                    0
                };
                return (u, side);
            }
            // Newton: a step this small leaves an error of its square.
            let enough = if newton { 1e-9 } else { 1e-15 };
            if step.abs() <= enough * (piece.end - piece.start) {
                break;
            }
        }
        (u, 0)
    }
}
