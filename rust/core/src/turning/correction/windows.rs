//! Windows of readings, and the rules that put one block or none at each: the paper's, every window,
//! middles of runs.

use super::options::{CorrectionOptions, Rule, StartCorner};
use crate::nc::path::{Lead, Motion, Move, Path};
use crate::turning::geometry::MIN_LENGTH_MM;
use crate::turning::probe_path::contact_shift;
use crate::turning::profile::Follows;

/// An error of the diameter at a place of the contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Point of contact, mm from the chuck face.
    pub z: f64,
    /// Measured minus nominal diameter, mm.
    pub error: f64,
}

/// A window of readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Its middle reading, mm.
    pub z: f64,
    /// Mean error, mm.
    pub mean: f64,
    /// The mean in units.
    pub k: i64,
}

/// Mean in units: halves away from zero, as printed (`INT(mean/CU ± 0.5)`, truncated towards zero).
#[must_use]
pub fn units_of(mean: f64, unit: f64) -> i64 {
    let rounding = if mean >= 0.0 { 0.5 } else { -0.5 };
    // Means are sums of decimal readings: what is half a unit but for the last bit is half a unit.
    let units = mean / unit + rounding;
    let nearest = units.round();
    let settled = if (units - nearest).abs() < 1e-9 { nearest } else { units.trunc() };
    #[allow(clippy::cast_possible_truncation)] // errors are small
    {
        settled as i64
    }
}

/// Readings by falling z; several at one z become their mean.
pub(super) fn sorted(readings: &[Reading]) -> Vec<Reading> {
    let mut order: Vec<(Reading, f64)> = readings.iter().map(|r| (*r, 1.0)).collect();
    order.sort_by(|a, b| b.0.z.total_cmp(&a.0.z));
    order.dedup_by(|next, kept| {
        let same = (next.0.z - kept.0.z).abs() < 1e-9;
        if same {
            kept.0.error += next.0.error;
            kept.1 += 1.0;
        }
        same
    });
    order.into_iter().map(|(r, n)| Reading { z: r.z, error: r.error / n }).collect()
}

/// What is to be done to each move.
pub(super) struct Plan<'a> {
    pub(super) moves: &'a [Move],
    /// Change of the diameter where the moves begin, in units; expected only where `path` has a block
    /// that goes there.
    pub(super) begin: i64,
    pub(super) lead: Option<Lead>,
    pub(super) options: &'a CorrectionOptions,
    /// Windows of each move, in the order of travel, with z as programmed.
    pub(super) lines: Vec<Vec<Window>>,
    /// Change of the diameter at the end of each move, in units.
    pub(super) end: Vec<i64>,
    /// Rapids that have to end at their own change, not at that of the move before.
    pub(super) pinned: Vec<bool>,
    /// Points put into each move: programmed z, units.
    pub(super) knots: Vec<Vec<(f64, i64)>>,
    pub(super) windows: Vec<Window>,
}

/// A straight feed move along which z changes.
pub(super) fn measurable(m: &Move) -> Option<f64> {
    let (dz, dx) = (m.to.axes[2] - m.from.axes[2], m.to.axes[0] - m.from.axes[0]);
    (m.motion == Motion::Feed && dz.abs() > MIN_LENGTH_MM).then(|| dx / dz)
}

/// Chord of a move in Z and X, mm.
fn way(m: &Move) -> f64 {
    (m.to.axes[2] - m.from.axes[2]).hypot(m.to.axes[0] - m.from.axes[0])
}

/// z as programmed minus z of contact.
pub(super) fn programmed_shift(follows: Follows, slope: f64) -> f64 {
    match follows {
        Follows::Contour => 0.0,
        Follows::NoseCentre(radius) => -contact_shift(slope, radius),
        Follows::Tip(radius) => -contact_shift(slope, radius) - radius,
    }
}

impl<'a> Plan<'a> {
    pub(super) fn new(path: &'a Path, order: &[Reading], options: &'a CorrectionOptions) -> Self {
        let moves = path.moves.as_slice();
        let mut lines = vec![Vec::new(); moves.len()];
        let mut windows = Vec::new();
        let mut taken: Option<f64> = None;
        for (index, (m, line)) in moves.iter().zip(&mut lines).enumerate() {
            let Some(slope) = measurable(m) else { continue };
            let shift = programmed_shift(options.follows, slope);
            let (a, b) = (m.from.axes[2] - shift, m.to.axes[2] - shift);
            let (high, low) = (a.max(b), a.min(b));
            let first = order.partition_point(|r| r.z > high + MIN_LENGTH_MM);
            let last = order.partition_point(|r| r.z >= low - MIN_LENGTH_MM);
            let mut on: Vec<Reading> = order.get(first..last).unwrap_or_default().to_vec();
            if b > a {
                on.reverse();
            }
            // A reading at a corner belongs to the line before it.
            let joins = index > 0 && moves.get(index - 1).is_some_and(|p| p.to == m.from);
            if joins && on.first().is_some_and(|r| taken.is_some_and(|z| (r.z - z).abs() < 1e-9)) {
                on.remove(0);
            }
            if let Some(last) = on.last() {
                taken = Some(last.z);
            }
            for chunk in on.chunks(options.window) {
                let count = chunk.len();
                #[allow(clippy::cast_precision_loss)]
                let mean = chunk.iter().map(|r| r.error).sum::<f64>() / count as f64;
                let Some(middle) = chunk.get((count - 1) / 2) else { continue };
                let k = units_of(mean, options.unit_mm);
                line.push(Window { z: middle.z + shift, mean, k });
                windows.push(Window { z: middle.z, mean, k });
            }
        }
        let count = moves.len();
        Self {
            moves,
            begin: 0,
            lead: path.lead.filter(|lead| !lead.spelling.incremental),
            options,
            lines,
            end: vec![0; count],
            pinned: vec![false; count],
            knots: vec![Vec::new(); count],
            windows,
        }
    }

    /// Change of the diameter where move `index` begins, in units.
    pub(super) fn before(&self, index: usize) -> i64 {
        index.checked_sub(1).map_or(self.begin, |previous| self.end[previous])
    }

    /// The last measured line before move `index`, with no wall between: a wall begins anew, as
    /// N15 of Fig. 14 does.
    fn measured_before(&self, index: usize) -> Option<usize> {
        (1..=index)
            .rev()
            .take_while(|&i| self.joined(i))
            .map(|i| i - 1)
            .take_while(|&i| self.runs(i))
            .find(|&i| !self.lines[i].is_empty())
    }

    /// The first measured line behind move `index`, with no wall between.
    fn measured_behind(&self, index: usize) -> Option<usize> {
        (index + 1..self.moves.len())
            .take_while(|&i| self.joined(i) && self.runs(i))
            .find(|&i| !self.lines[i].is_empty())
    }

    /// Does z change along move `index`?
    fn runs(&self, index: usize) -> bool {
        self.moves.get(index).is_some_and(|m| (m.to.axes[2] - m.from.axes[2]).abs() > MIN_LENGTH_MM)
    }

    /// Let the correction run linearly along what is not measured, from the end of line `from` to
    /// `k` where line `to` begins: the curves of section 2.3(1), and lines that are too steep.
    fn bridge(&mut self, from: usize, to: usize, k: i64) {
        let moves = self.moves.get(from + 1..to).unwrap_or_default();
        let total: f64 = moves.iter().map(way).sum();
        let start = self.end[from];
        let mut run = 0.0;
        for (index, m) in (from + 1..to).zip(moves) {
            run += way(m);
            let share = if index + 1 == to || total <= 0.0 { 1.0 } else { run / total };
            #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation)] // few units
            {
                self.end[index] = start + ((k - start) as f64 * share).round() as i64;
            }
        }
    }

    /// Is move `index` the straight continuation of the contour behind `index - 1`, both at feed?
    pub(super) fn joined(&self, index: usize) -> bool {
        let (Some(a), Some(b)) =
            (index.checked_sub(1).and_then(|i| self.moves.get(i)), self.moves.get(index))
        else {
            return false;
        };
        a.motion != Motion::Rapid && b.motion != Motion::Rapid && a.to == b.from
    }
}

/// The paper's rule, every window, and middles of runs.
pub(super) fn by_windows(plan: &mut Plan<'_>) {
    for index in 0..plan.moves.len() {
        let line = &plan.lines[index];
        let (Some(m), Some(last)) = (plan.moves.get(index), line.last()) else { continue };
        let measured = plan.measured_before(index);
        let behind_measured = measured.is_some_and(|at| at + 1 == index);
        // What the path carries where the line begins.
        let carried = if behind_measured { plan.end[index - 1] } else { 0 };
        let cone = measurable(m).is_some_and(|slope| slope.abs() > 1e-9);
        let inner = &line[..line.len() - 1];
        let mut knots: Vec<(f64, i64)> = Vec::new();
        match plan.options.rule {
            Rule::MidRun => {
                let mut runs: Vec<(f64, f64, i64)> = Vec::new();
                for window in line {
                    match runs.last_mut() {
                        Some(run) if run.2 == window.k => run.1 = window.z,
                        _ => runs.push((window.z, window.z, window.k)),
                    }
                }
                knots.extend(runs.iter().map(|(a, b, k)| (0.5 * (a + b), *k)));
                if knots.len() == 1 && (!behind_measured || carried == last.k) {
                    knots.clear();
                }
            }
            rule => {
                let mut before = carried;
                for window in inner {
                    if rule == Rule::EveryWindow || cone || window.k != before {
                        knots.push((window.z, window.k));
                    }
                    before = window.k;
                }
            }
        }
        let (first, last) = (knots.first().map_or(last.k, |knot| knot.1), last.k);
        let ahead = plan.options.start_corner == StartCorner::LookAhead
            || plan.options.rule == Rule::MidRun;
        match measured {
            Some(at) if at + 1 < index => plan.bridge(at, index, first),
            None if ahead && plan.joined(index) => plan.end[index - 1] = first,
            _ => {}
        }
        plan.end[index] = last;
        plan.knots[index] = knots;
    }
    for index in 0..plan.moves.len() {
        let curve = plan.moves.get(index).is_some_and(|m| matches!(m.motion, Motion::Arc { .. }));
        if curve && plan.measured_behind(index).is_none() {
            // No measured line behind it: the error of the line before holds to the end of the curve.
            if let Some(at) = plan.measured_before(index).filter(|at| at + 1 == index) {
                plan.end[index] = plan.end[at];
            }
        }
    }
}
