//! The rule with a bound ([`super::Rule::Bounded`]): fewest blocks by dynamic programming.

use super::windows::Plan;
use crate::nc::path::{Motion, Move};
use crate::turning::geometry::MIN_LENGTH_MM;

/// A place on a section of the contour at which the correction may have a corner.
#[derive(Clone, Copy)]
struct Station {
    /// Way along Z from the start of the section, mm.
    s: f64,
    /// Programmed z.
    z: f64,
    /// Error to be taken off, in units.
    target: f64,
    /// The move it lies on.
    index: usize,
    /// The end of a block that is there already: costs nothing, cannot be left out.
    end: bool,
    /// Must the error be met here? Not on arcs between their ends.
    free: bool,
}

/// Fewest blocks within half a unit and a bound.
pub(super) fn bounded(plan: &mut Plan<'_>, bound_mm: f64) {
    let unit = plan.options.unit_mm;
    let tolerance = 0.5 + bound_mm / unit;
    let mut first = 0;
    while first < plan.moves.len() {
        // A section: feed moves that follow each other, z changing all along.
        let runs = |m: &Move| {
            m.motion != Motion::Rapid && (m.to.axes[2] - m.from.axes[2]).abs() > MIN_LENGTH_MM
        };
        if !plan.moves.get(first).is_some_and(runs) {
            first += 1;
            continue;
        }
        let mut last = first + 1;
        while plan.joined(last) && plan.moves.get(last).is_some_and(runs) {
            last += 1;
        }
        if plan.lines[first..last].iter().any(|line| !line.is_empty()) {
            section(plan, first, last, tolerance);
        }
        first = last;
    }
}

fn section(plan: &mut Plan<'_>, first: usize, last: usize, tolerance: f64) {
    let stations = stations(plan, first, last);
    let levels = fewest_knots(&stations, tolerance);
    // A rapid written in increments is left alone; the line then begins with a block of its own.
    let by_increments = first
        .checked_sub(1)
        .and_then(|previous| plan.moves.get(previous))
        .is_some_and(|m| m.motion == Motion::Rapid && m.spelling.incremental);
    for (station, level) in stations.iter().zip(levels) {
        let Some(level) = level else { continue };
        if !station.end {
            plan.knots[station.index].push((station.z, level));
        } else if station.s > 0.0 {
            plan.end[station.index] = level;
        } else if first > 0 && !by_increments {
            plan.end[first - 1] = level;
            plan.pinned[first - 1] = true;
        } else if first == 0 && plan.lead.is_some() {
            plan.begin = level;
        } else if level != 0 {
            plan.knots[first].push((station.z, level));
        }
    }
}

/// Ends of moves and window means along a section, in the order of travel. Between means the error
/// runs straight; before the first and behind the last it holds.
fn stations(plan: &Plan<'_>, first: usize, last: usize) -> Vec<Station> {
    let unit = plan.options.unit_mm;
    let mut known: Vec<(f64, f64)> = Vec::new();
    let mut places = Vec::new();
    let mut s = 0.0;
    for index in first..last {
        let Some(m) = plan.moves.get(index) else { continue };
        let (from, to) = (m.from.axes[2], m.to.axes[2]);
        if index == first {
            places.push((s, from, index, true));
        }
        for window in &plan.lines[index] {
            let at = s + (window.z - from).abs();
            known.push((at, window.mean / unit));
            let inside = (window.z - from).abs() > 1e-3 && (window.z - to).abs() > 1e-3;
            if inside {
                places.push((at, window.z, index, false));
            }
        }
        s += (to - from).abs();
        places.push((s, to, index, true));
    }
    let mut at = 0;
    places
        .iter()
        .map(|&(s, z, index, end)| {
            while at + 1 < known.len() && known[at + 1].0 <= s {
                at += 1;
            }
            let target = match (known.get(at), known.get(at + 1)) {
                (Some(a), Some(b)) if a.0 <= s => a.1 + (b.1 - a.1) * (s - a.0) / (b.0 - a.0),
                (Some(a), _) => a.1,
                _ => 0.0,
            };
            let free = plan.moves.get(index).is_some_and(|m| m.motion == Motion::Feed);
            Station { s, z, target, index, end, free }
        })
        .collect()
}

/// No more than this many places in one move are tried for a corner, and those between which the
/// error is too rough for a straight line; the error is watched at all.
const MAX_PLACES: usize = 512;

/// Rounding allowed where a target is half a unit away.
const SLACK: f64 = 1e-9;

/// Whole units within `tolerance` of a target.
fn levels(target: f64, tolerance: f64) -> std::ops::RangeInclusive<i64> {
    #[allow(clippy::cast_possible_truncation)] // errors are small
    let range = ((target - tolerance - SLACK).ceil() as i64)
        ..=((target + tolerance + SLACK).floor() as i64);
    range
}

/// The places of a move, `begin` to `stop`, at which corners are tried. From every level at one of
/// them some level at the next can be reached, so that a polyline always exists.
fn places(stations: &[Station], begin: usize, stop: usize, tolerance: f64) -> Vec<usize> {
    let stride = (stop - begin).div_ceil(MAX_PLACES).max(1);
    let mut out = vec![begin];
    for from in (begin..stop).step_by(stride) {
        let to = (from + stride).min(stop);
        let (a, b) = (stations[from], stations[to]);
        #[allow(clippy::cast_precision_loss)] // errors are small
        let reaches = |level: i64| {
            let level = level as f64;
            let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
            for between in stations[from + 1..to].iter().filter(|s| s.free) {
                let run = between.s - a.s;
                low = low.max((between.target - tolerance - level) / run);
                high = high.min((between.target + tolerance - level) / run);
            }
            let slope = |end: i64| (end as f64 - level) / (b.s - a.s);
            levels(b.target, tolerance)
                .any(|end| slope(end) >= low - SLACK && slope(end) <= high + SLACK)
        };
        if !levels(a.target, tolerance).all(reaches) {
            out.extend(from + 1..to);
        }
        out.push(to);
    }
    out
}

/// Levels (whole units) of the corners of the polyline that stays within `tolerance` of every target,
/// with the fewest corners that are not ends, then the least sum of squares; `None` where there is
/// no corner. Dynamic programming between ends; within a move, from every reached corner the cone of
/// slopes that pass all places so far.
fn fewest_knots(stations: &[Station], tolerance: f64) -> Vec<Option<i64>> {
    #[derive(Clone, Copy)]
    struct State {
        level: i64,
        cost: (usize, f64),
        back: (usize, usize),
    }
    let better = |a: (usize, f64), b: (usize, f64)| a.0 < b.0 || a.0 == b.0 && a.1 < b.1;
    let sums = Sums::new(stations);
    let unreached = (usize::MAX, f64::INFINITY);
    let mut states: Vec<Vec<State>> = stations
        .iter()
        .map(|s| {
            levels(s.target, tolerance)
                .map(|level| State { level, cost: unreached, back: (0, 0) })
                .collect()
        })
        .collect();
    let square = |a: f64| a * a;
    #[allow(clippy::cast_precision_loss)]
    for state in states.first_mut().into_iter().flatten() {
        state.cost = (0, square(state.level as f64 - stations[0].target));
    }
    let mut begin = 0;
    while begin + 1 < stations.len() {
        let stop = stations
            .iter()
            .skip(begin + 1)
            .position(|s| s.end)
            .map_or(stations.len() - 1, |n| begin + 1 + n);
        let corners = places(stations, begin, stop, tolerance);
        let tried: Vec<bool> = {
            let mut tried = vec![false; stop - begin + 1];
            corners.iter().for_each(|&i| tried[i - begin] = true);
            tried
        };
        for &i in corners.iter().take(corners.len() - 1) {
            for v in 0..states[i].len() {
                let state = states[i][v];
                let best_end = states[stop].iter().map(|s| s.cost.0).min().unwrap_or(usize::MAX);
                if state.cost == unreached || state.cost.0 > best_end {
                    continue;
                }
                #[allow(clippy::cast_precision_loss)]
                let level = state.level as f64;
                let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
                for j in i + 1..=stop {
                    let station = stations[j];
                    let run = station.s - stations[i].s;
                    if tried[j - begin] {
                        for target in &mut states[j] {
                            #[allow(clippy::cast_precision_loss)]
                            let slope = (target.level as f64 - level) / run;
                            if slope < low - SLACK || slope > high + SLACK {
                                continue;
                            }
                            let squares = sums.squares(i, j, stations[i].s, level, slope);
                            let cost =
                                (state.cost.0 + usize::from(j < stop), state.cost.1 + squares);
                            if better(cost, target.cost) {
                                target.cost = cost;
                                target.back = (i, v);
                            }
                        }
                    }
                    if station.free || j == stop {
                        low = low.max((station.target - tolerance - level) / run);
                        high = high.min((station.target + tolerance - level) / run);
                    }
                    if low > high + SLACK {
                        break;
                    }
                }
            }
        }
        begin = stop;
    }
    let mut chosen = vec![None; stations.len()];
    let mut i = stations.len().saturating_sub(1);
    let Some(mut v) = states.get(i).and_then(|all| {
        (0..all.len()).min_by(|&a, &b| {
            let (a, b) = (all[a].cost, all[b].cost);
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
    }) else {
        return chosen;
    };
    loop {
        let state = states[i][v];
        chosen[i] = Some(state.level);
        if i == 0 {
            return chosen;
        }
        (i, v) = state.back;
    }
}

/// Prefix sums that give the squares left by a line in constant time.
struct Sums {
    sums: Vec<[f64; 6]>,
}

impl Sums {
    fn new(stations: &[Station]) -> Self {
        let mut sums = vec![[0.0; 6]];
        let mut last = [0.0; 6];
        for station in stations {
            let (s, e) = (station.s, station.target);
            for (sum, term) in last.iter_mut().zip([1.0, s, s * s, e, e * s, e * e]) {
                *sum += term;
            }
            sums.push(last);
        }
        Self { sums }
    }

    /// Sum over stations behind `i` up to `j` of (level + slope (s - s_i) - e)².
    fn squares(&self, i: usize, j: usize, s: f64, level: f64, slope: f64) -> f64 {
        let mut d = self.sums[j + 1];
        for (sum, before) in d.iter_mut().zip(self.sums[i + 1]) {
            *sum -= before;
        }
        let [n, s1, s2, e1, es, e2] = d;
        let at = level - slope * s;
        (at * at * n + slope * slope * s2 + e2 + 2.0 * at * slope * s1
            - 2.0 * at * e1
            - 2.0 * slope * es)
            .max(0.0)
    }
}
