//! The path: where the tool tip should be and where the tool axis should point, in the part's frame.
//!
//! A path is a chain of pieces over one parameter u. In each piece, with s = u - start,
//!
//! ```text
//! (x, y, z, ox, oy, oz)(s) = Σ_i coefficients[i] s^i + cosine cos(ω s) + sine sin(ω s)
//! ```
//!
//! which holds the paper's polynomial, B-splines (as piecewise polynomials), straight lines, arcs
//! and helices, all with exact derivatives. The tool direction need not be of unit length; its
//! direction is what counts.

use nalgebra::Vector3;

use crate::error::{Error, Result};

/// Six numbers: tool tip x, y, z in mm, then tool direction.
pub type Six = [f64; 6];

/// One piece of a path; see the [module](self) for the formula.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Parameter u at which the piece begins.
    pub start: f64,
    /// Parameter u at which it ends.
    pub end: f64,
    /// Polynomial coefficients, ascending powers of s = u - start.
    pub coefficients: Vec<Six>,
    /// Angular frequency ω of the harmonic part, rad per unit of u; 0 for none.
    pub omega: f64,
    /// Cosine amplitudes.
    pub cosine: Six,
    /// Sine amplitudes.
    pub sine: Six,
}

/// Position, tool direction and their derivatives by u.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Tool tip R, mm.
    pub r: Vector3<f64>,
    /// R' = dR/du.
    pub r1: Vector3<f64>,
    /// R'' = d²R/du².
    pub r2: Vector3<f64>,
    /// Tool direction, not normalised.
    pub w: Vector3<f64>,
    /// Its derivative by u.
    pub w1: Vector3<f64>,
}

impl Frame {
    /// Unit tool axis O.
    #[must_use]
    pub fn tool(&self) -> Vector3<f64> {
        self.w / self.w.norm()
    }

    /// Derivative of the unit tool axis by u.
    #[must_use]
    pub fn tool_derivative(&self) -> Vector3<f64> {
        let n = self.w.norm();
        let o = self.w / n;
        (self.w1 - o * o.dot(&self.w1)) / n
    }

    /// Curvature of the path, 1/mm.
    #[must_use]
    pub fn curvature(&self) -> f64 {
        let speed = self.r1.norm();
        self.r1.cross(&self.r2).norm() / (speed * speed * speed)
    }
}

impl Piece {
    /// Position, tool direction and derivatives at u (inside the piece or extended beyond it).
    #[must_use]
    pub fn frame(&self, u: f64) -> Frame {
        let s = u - self.start;
        let (mut f0, mut f1, mut f2) = ([0.0; 6], [0.0; 6], [0.0; 6]);
        for c in self.coefficients.iter().rev() {
            for i in 0..6 {
                f2[i] = f2[i] * s + 2.0 * f1[i];
                f1[i] = f1[i] * s + f0[i];
                f0[i] = f0[i] * s + c[i];
            }
        }
        if self.omega != 0.0 {
            let (sin, cos) = (self.omega * s).sin_cos();
            for i in 0..6 {
                let (p, q) = (self.cosine[i], self.sine[i]);
                f0[i] += p * cos + q * sin;
                f1[i] += self.omega * (q * cos - p * sin);
                f2[i] -= self.omega * self.omega * (p * cos + q * sin);
            }
        }
        Frame {
            r: Vector3::new(f0[0], f0[1], f0[2]),
            r1: Vector3::new(f1[0], f1[1], f1[2]),
            r2: Vector3::new(f2[0], f2[1], f2[2]),
            w: Vector3::new(f0[3], f0[4], f0[5]),
            w1: Vector3::new(f1[3], f1[4], f1[5]),
        }
    }

    fn speed(&self, u: f64) -> f64 {
        self.frame(u).r1.norm()
    }
}

/// Nodes and weights of the 8-point Gauss-Legendre rule on [-1, 1] (positive half).
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_27),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// A stretch of one piece over which the 8-point rule gives the arc length to rounding.
#[derive(Clone, Copy, Debug)]
struct Panel {
    piece: usize,
    start: f64,
    end: f64,
    /// Arc length from the start of the path to the start of the panel, mm.
    s: f64,
}

/// A path with its arc length.
#[derive(Clone, Debug)]
pub struct Path {
    pieces: Vec<Piece>,
    panels: Vec<Panel>,
    length: f64,
}

impl Path {
    /// A path from its pieces.
    ///
    /// # Errors
    /// No piece; a piece that is empty, not finite or does not begin where the one before ends
    /// (in u and, to 1e-6 mm, in space); a point where the path or its tool direction vanishes.
    pub fn new(pieces: Vec<Piece>) -> Result<Self> {
        if pieces.is_empty() {
            return Err(Error::input("path", "no piece", "at least one"));
        }
        for (i, piece) in pieces.iter().enumerate() {
            check_piece(i, piece, i.checked_sub(1).map(|before| &pieces[before]))?;
        }
        let mut path = Self { pieces, panels: Vec::new(), length: 0.0 };
        for i in 0..path.pieces.len() {
            let (a, b) = (path.pieces[i].start, path.pieces[i].end);
            path.measure(i, a, b, 12);
        }
        if path.length > 0.0 && path.length.is_finite() {
            Ok(path)
        } else {
            Err(Error::input("path length, mm", path.length, "a finite length above 0"))
        }
    }

    /// Adds panels for [a, b] of a piece, halving until the 8-point rule agrees with its halves.
    fn measure(&mut self, piece: usize, a: f64, b: f64, depth: u32) {
        let p = &self.pieces[piece];
        let middle = 0.5 * (a + b);
        let whole = gauss(p, a, b);
        let halves = gauss(p, a, middle) + gauss(p, middle, b);
        if depth == 0 || (whole - halves).abs() <= 1e-14 * halves {
            self.panels.push(Panel { piece, start: a, end: b, s: self.length });
            self.length += halves;
        } else {
            self.measure(piece, a, middle, depth - 1);
            self.measure(piece, middle, b, depth - 1);
        }
    }

    /// The pieces.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Arc length, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// First and last parameter u.
    #[must_use]
    pub fn span(&self) -> (f64, f64) {
        (self.pieces[0].start, self.pieces[self.pieces.len() - 1].end)
    }

    /// Number of the piece that holds u; the first or last one beyond the ends.
    #[must_use]
    pub fn piece_at(&self, u: f64) -> usize {
        let after = self.pieces.partition_point(|p| p.start <= u);
        after.saturating_sub(1)
    }

    /// Position, tool direction and derivatives at u.
    #[must_use]
    pub fn frame(&self, u: f64) -> Frame {
        self.pieces[self.piece_at(u)].frame(u)
    }

    /// Parameter u at arc length s from the start, by Newton on the integral of |R'|.
    #[must_use]
    pub fn at_length(&self, s: f64) -> f64 {
        let s = s.clamp(0.0, self.length);
        let index = self.panels.partition_point(|p| p.s <= s).saturating_sub(1);
        let panel = self.panels[index];
        let piece = &self.pieces[panel.piece];
        let expected = s - panel.s;
        let span = panel.end - panel.start;
        let length = self.panels.get(index + 1).map_or(self.length, |next| next.s) - panel.s;
        let mut u = panel.start + span * (expected / length);
        for _ in 0..30 {
            let missing = expected - gauss(piece, panel.start, u);
            let next = (u + missing / piece.speed(u)).clamp(panel.start, panel.end);
            let step = next - u;
            u = next;
            // Newton: a step this small leaves an error of its square.
            if step.abs() <= 1e-9 * span {
                break;
            }
        }
        u
    }

    /// Arc length from the start to u, mm.
    #[must_use]
    pub fn length_at(&self, u: f64) -> f64 {
        let index = self.panels.partition_point(|p| p.start <= u).saturating_sub(1);
        let panel = self.panels[index];
        panel.s + gauss(&self.pieces[panel.piece], panel.start, u.min(panel.end))
    }

    /// Arc lengths of the corners: joints of two pieces where the direction turns by more than 1e-6.
    #[must_use]
    pub fn corners(&self) -> Vec<f64> {
        let mut found = Vec::new();
        for i in 1..self.pieces.len() {
            let u = self.pieces[i].start;
            let before = self.pieces[i - 1].frame(u).r1.normalize();
            let after = self.pieces[i].frame(u).r1.normalize();
            if (after - before).norm() > 1e-6 {
                let panel = self.panels.partition_point(|p| p.piece < i);
                found.push(self.panels[panel].s);
            }
        }
        found
    }
}

/// Arc length of a piece between a and b by the 8-point rule, mm.
fn gauss(piece: &Piece, a: f64, b: f64) -> f64 {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let sum: f64 = GAUSS
        .iter()
        .map(|(x, w)| w * (piece.speed(middle - half * x) + piece.speed(middle + half * x)))
        .sum();
    sum * half
}

fn check_piece(i: usize, piece: &Piece, before: Option<&Piece>) -> Result<()> {
    let what = |quantity: &str| format!("path piece {i}, {quantity}");
    if piece.coefficients.is_empty() {
        return Err(Error::input(what("coefficients"), "none", "at least one row of six"));
    }
    let numbers = piece.coefficients.iter().flatten().chain(&piece.cosine).chain(&piece.sine);
    if !numbers.copied().chain([piece.start, piece.end, piece.omega]).all(f64::is_finite) {
        return Err(Error::input(what("numbers"), "not finite", "finite numbers"));
    }
    if piece.end <= piece.start {
        let got = format!("{} to {}", piece.start, piece.end);
        return Err(Error::input(what("parameter"), got, "end above start"));
    }
    for k in 0..=8 {
        let u = piece.start + (piece.end - piece.start) * f64::from(k) / 8.0;
        let frame = piece.frame(u);
        if frame.r1.norm() < 1e-12 {
            return Err(Error::input(what("velocity dR/du"), format!("0 at u = {u}"), "above 0"));
        }
        if frame.w.norm() < 1e-9 {
            return Err(Error::input(what("tool direction"), format!("0 at u = {u}"), "not 0"));
        }
    }
    if let Some(before) = before {
        if (before.end - piece.start).abs() > 1e-12 * (1.0 + piece.start.abs()) {
            return Err(Error::input(what("start"), piece.start, format!("{}", before.end)));
        }
        let gap = (before.frame(before.end).r - piece.frame(piece.start).r).norm();
        if gap > 1e-6 {
            return Err(Error::input(what("gap to the piece before, mm"), gap, "at most 1e-6"));
        }
    }
    Ok(())
}
