//! Correction of a finishing program for a measured diameter error (section 3).
//!
//! Readings of the error e(z), on the diameter, are averaged over windows of N and expressed in whole
//! units CU of the correction: k = trunc(mean/CU ± 0.5). The program's X is then changed by -k CU.
//! Where between the windows the change happens is the rule's affair ([`Rule`]). The result says
//! what it leaves of the error, replayed from the written program.

use std::collections::HashMap;

use super::geometry::NOTHING_MM;
use super::probe_path::contact_shift;
use super::profile::Follows;
use crate::nc::path::{Lead, Motion, Move, Path, Spelling, Start, contour_blocks, moves, moves_of};
use crate::nc::{Block, Item, Number, Program, Word};
use crate::{Error, Result};

/// Where blocks go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// The paper's. On a cylinder a block at the first window of every new k (k before the first is
    /// 0), reached by a ramp from the last point; on a cone a block at every window. The last
    /// window has no block: its k goes to the end of the line.
    Paper,
    /// A block at every window but the last.
    EveryWindow,
    /// A block in the middle of every run of windows of one k, so that ramps cross the error where it
    /// crosses (k - 0.5) CU instead of running half a unit ahead.
    MidRun,
    /// The project's own: the fewest blocks that leave no reading (window mean) more than half a unit
    /// and this bound, mm; among those, the least sum of squares. Ends of blocks that are there
    /// already cost nothing, and the rapid that goes to where a line begins is one of them. On a
    /// line with more than 512 windows blocks are tried at 512 of them and wherever the error is
    /// too rough for those: then the count may be above the fewest, the bound holds as well.
    Bounded {
        /// Allowed beyond half a unit, mm.
        bound_mm: f64,
    },
}

/// The k of the corner at which the first measured line begins (a corner behind a measured line has
/// that line's last k).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartCorner {
    /// That of the line's first block: so Fig. 14.
    LookAhead,
    /// Zero: so Figs. 18 and 20.
    Zero,
}

/// How to correct.
#[derive(Clone, Debug, PartialEq)]
pub struct CorrectionOptions {
    /// Unit CU, mm on the diameter.
    pub unit_mm: f64,
    /// Readings N in a window.
    pub window: usize,
    /// Where blocks go.
    pub rule: Rule,
    /// Start corner, for the paper's rules.
    pub start_corner: StartCorner,
    /// What the program's coordinates follow: with a nose, the block that cuts at z stands beside z
    /// on a cone. (Fig. 14 does not see to this: [`Follows::Contour`].)
    pub follows: Follows,
    /// What is in force before the program.
    pub start: Start,
    /// Leave the numbers of the blocks as they are; inserted blocks have none.
    pub keep_numbers: bool,
}

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

/// A corrected program.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// The program.
    pub program: Program,
    /// Indices, in the new program, of the blocks that were put in.
    pub inserted: Vec<usize>,
    /// Windows used, by line.
    pub windows: Vec<Window>,
    /// For each reading, in the order given: change of the diameter there, mm, replayed from the new
    /// program; 0 where `covered` is false.
    pub change: Vec<f64>,
    /// Is the reading on a feed move of the program?
    pub covered: Vec<bool>,
    /// No window mean (with windows of one: no reading) is left with more, mm; only for
    /// [`Rule::Bounded`].
    pub bound: Option<f64>,
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

/// Corrects a program.
///
/// # Errors
/// [`Error::Input`] for readings or options that are not usable, [`Error::Program`] for a program
/// that cannot be followed, for corrected moves written in increments, and [`Error::Data`] if no
/// reading lies on a feed move.
pub fn correct(
    program: &Program,
    readings: &[Reading],
    options: &CorrectionOptions,
) -> Result<Corrected> {
    check(readings, options)?;
    let path = contour_path(program, &options.start)?;
    let order = sorted(readings);
    let mut plan = Plan::new(&path, &order, options);
    match options.rule {
        Rule::Bounded { bound_mm } => bounded(&mut plan, bound_mm),
        _ => by_windows(&mut plan),
    }
    if plan.windows.is_empty() {
        return Err(Error::Data(
            "none of the readings lies on a feed move of the program; wanted z of the part".into(),
        ));
    }
    plunges(&mut plan, program);
    let (corrected, inserted) = write(program, &plan)?;
    let after = contour_path(&corrected, &options.start)?;
    let (was, is) =
        (Diameters::new(&path, options.follows), Diameters::new(&after, options.follows));
    let (mut change, mut covered) = (Vec::new(), Vec::new());
    for reading in readings {
        let both = was.at(reading.z).zip(is.at(reading.z));
        change.push(both.map_or(0.0, |(was, is)| is - was));
        covered.push(both.is_some());
    }
    let bound = match options.rule {
        // The least increment of a diameter that is written anew adds half of it. What the replay
        // shows goes before what was promised.
        Rule::Bounded { bound_mm } => {
            let left = |w: &Window| Some((w.mean + is.at(w.z)? - was.at(w.z)?).abs());
            let promised = 0.5 * options.unit_mm + bound_mm + 0.5 * LEAST_INCREMENT_MM;
            let worst = plan.windows.iter().filter_map(left).fold(0.0, f64::max);
            Some(if worst > promised + 1e-9 { worst } else { promised })
        }
        _ => None,
    };
    Ok(Corrected { program: corrected, inserted, windows: plan.windows, change, covered, bound })
}

/// An error of a diameter above this is a slip: a diameter itself, or another unit, mm.
const MOST_ERROR_MM: f64 = 5.0;

/// Diameters are written to this, mm.
const LEAST_INCREMENT_MM: f64 = 1e-3;

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

fn check(readings: &[Reading], options: &CorrectionOptions) -> Result<()> {
    if !(options.unit_mm.is_finite() && options.unit_mm > 0.0) {
        return Err(Error::input("unit, mm", options.unit_mm, "finite and more than zero"));
    }
    if options.window == 0 {
        return Err(Error::input("window", 0, "one reading at least"));
    }
    if let Rule::Bounded { bound_mm } = options.rule
        && !(bound_mm.is_finite() && bound_mm >= 0.0)
    {
        return Err(Error::input("bound, mm", bound_mm, "finite and not negative"));
    }
    for (row, reading) in readings.iter().enumerate() {
        if !(reading.z.is_finite() && reading.error.is_finite()) {
            let got = format!("z {}, error {}", reading.z, reading.error);
            return Err(Error::input(format!("reading {row}"), got, "finite numbers"));
        }
        if reading.error.abs() > MOST_ERROR_MM {
            let wanted = format!("at most {MOST_ERROR_MM} mm: measured minus nominal diameter");
            return Err(Error::input(format!("reading {row}, mm"), reading.error, wanted));
        }
    }
    Ok(())
}

/// Readings by falling z; several at one z become their mean.
fn sorted(readings: &[Reading]) -> Vec<Reading> {
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
struct Plan<'a> {
    moves: &'a [Move],
    /// Change of the diameter where the moves begin, in units; wanted only where `path` has a block
    /// that goes there.
    begin: i64,
    lead: Option<Lead>,
    options: &'a CorrectionOptions,
    /// Windows of each move, in the order of travel, with z as programmed.
    lines: Vec<Vec<Window>>,
    /// Change of the diameter at the end of each move, in units.
    end: Vec<i64>,
    /// Rapids that have to end at their own change, not at that of the move before.
    pinned: Vec<bool>,
    /// Points put into each move: programmed z, units.
    knots: Vec<Vec<(f64, i64)>>,
    windows: Vec<Window>,
}

/// A straight feed move along which z changes.
fn measurable(m: &Move) -> Option<f64> {
    let (dz, dx) = (m.to.axes[2] - m.from.axes[2], m.to.axes[0] - m.from.axes[0]);
    (m.motion == Motion::Feed && dz.abs() > NOTHING_MM).then(|| dx / dz)
}

/// z as programmed minus z of contact.
fn programmed_shift(follows: Follows, slope: f64) -> f64 {
    match follows {
        Follows::Contour => 0.0,
        Follows::NoseCentre(radius) => -contact_shift(slope, radius),
        Follows::Tip(radius) => -contact_shift(slope, radius) - radius,
    }
}

impl<'a> Plan<'a> {
    fn new(path: &'a Path, order: &[Reading], options: &'a CorrectionOptions) -> Self {
        let moves = path.moves.as_slice();
        let mut lines = vec![Vec::new(); moves.len()];
        let mut windows = Vec::new();
        let mut taken: Option<f64> = None;
        for (index, (m, line)) in moves.iter().zip(&mut lines).enumerate() {
            let Some(slope) = measurable(m) else { continue };
            let shift = programmed_shift(options.follows, slope);
            let (a, b) = (m.from.axes[2] - shift, m.to.axes[2] - shift);
            let (high, low) = (a.max(b), a.min(b));
            let first = order.partition_point(|r| r.z > high + NOTHING_MM);
            let last = order.partition_point(|r| r.z >= low - NOTHING_MM);
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
    fn before(&self, index: usize) -> i64 {
        index.checked_sub(1).map_or(self.begin, |previous| self.end[previous])
    }

    /// Is move `index` the straight continuation of the contour behind `index - 1`, both at feed?
    fn joined(&self, index: usize) -> bool {
        let (Some(a), Some(b)) =
            (index.checked_sub(1).and_then(|i| self.moves.get(i)), self.moves.get(index))
        else {
            return false;
        };
        a.motion != Motion::Rapid && b.motion != Motion::Rapid && a.to == b.from
    }
}

/// The paper's rule, every window, and middles of runs.
fn by_windows(plan: &mut Plan<'_>) {
    for index in 0..plan.moves.len() {
        let line = &plan.lines[index];
        let (Some(m), Some(last)) = (plan.moves.get(index), line.last()) else { continue };
        let behind_measured = plan.joined(index)
            && index > 0
            && plan.lines.get(index - 1).is_some_and(|l| !l.is_empty());
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
        let first = knots.first().map_or(last.k, |knot| knot.1);
        let ahead = plan.options.start_corner == StartCorner::LookAhead
            || plan.options.rule == Rule::MidRun;
        if ahead && !behind_measured && plan.joined(index) {
            plan.end[index - 1] = first;
        }
        plan.end[index] = last.k;
        plan.knots[index] = knots;
    }
}

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
fn bounded(plan: &mut Plan<'_>, bound_mm: f64) {
    let unit = plan.options.unit_mm;
    let tolerance = 0.5 + bound_mm / unit;
    let mut first = 0;
    while first < plan.moves.len() {
        // A section: feed moves that follow each other, z changing all along.
        let runs = |m: &Move| {
            m.motion != Motion::Rapid && (m.to.axes[2] - m.from.axes[2]).abs() > NOTHING_MM
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
const MOST_PLACES: usize = 512;

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
    let stride = (stop - begin).div_ceil(MOST_PLACES).max(1);
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

/// Prefix sums that give the squares left by a line in no time.
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

/// A rapid that ends above a plunge goes with it, and one that only moves Z keeps the X it has.
fn plunges(plan: &mut Plan<'_>, program: &Program) {
    for index in 0..plan.moves.len() {
        let Some(m) = plan.moves.get(index) else { continue };
        if m.motion != Motion::Rapid {
            continue;
        }
        if let Some(next) = plan.moves.get(index + 1)
            && next.motion == Motion::Feed
            && (next.to.axes[2] - m.to.axes[2]).abs() < NOTHING_MM
            && next.to.axes[0] < m.to.axes[0]
        {
            plan.end[index] = plan.end[index + 1];
        } else if !plan.pinned[index]
            && index > 0
            && program.blocks.get(m.block).is_some_and(|b| b.word('X').is_none())
        {
            plan.end[index] = plan.end[index - 1];
        }
    }
}

/// Writes the corrected program; also the indices of the blocks put in.
fn write(program: &Program, plan: &Plan<'_>) -> Result<(Program, Vec<usize>)> {
    let by_block: HashMap<usize, usize> =
        plan.moves.iter().enumerate().map(|(index, m)| (m.block, index)).collect();
    let mut out = Program::new(program.dialect);
    out.blocks.reserve(program.blocks.len() + plan.windows.len());
    let mut inserted = Vec::new();
    // X and Z as last written (what the control holds), as numbers.
    let mut held: [Option<Number>; 2] = [None, None];
    let mut feed: Option<Number> = None;
    for (number, block) in program.blocks.iter().enumerate() {
        let mut block = block.clone();
        let index = by_block.get(&number).copied();
        if let Some(lead) = plan.lead.filter(|lead| lead.block == number && plan.begin != 0)
            && let Some(first) = plan.moves.first()
        {
            let (radius, written) = (first.from.axes[0], block.word('X').map(|word| word.number));
            let unit = plan.options.unit_mm;
            let x = x_number(program, lead.spelling, radius, plan.begin, unit, written)?;
            block.set('X', x, &[]);
        }
        if let Some((index, m)) = index.and_then(|i| Some((i, plan.moves.get(i)?))) {
            let before = plan.before(index);
            let touched = plan.end[index] != 0 || before != 0 || !plan.knots[index].is_empty();
            if touched {
                if m.spelling.incremental {
                    return Err(m.span.error(
                        "a move in increments is to be corrected; wanted absolute positions (X, Z)",
                    ));
                }
                let knots = std::mem::take(&mut Vec::clone(&plan.knots[index]));
                for (count, &(z, k)) in knots.iter().enumerate() {
                    let slope = measurable(m).unwrap_or(0.0);
                    let z =
                        program.dialect.spelled(z / m.spelling.unit_mm, decimals(m.spelling))?;
                    // X for z as written: on a cone the rounding of z would be seen in the diameter.
                    let written_z = program.dialect.length_mm(z) * m.spelling.unit_mm;
                    let nominal = m.from.axes[0] + slope * (written_z - m.from.axes[2]);
                    let unit = plan.options.unit_mm;
                    let x = x_number(program, m.spelling, nominal, k, unit, None)?;
                    let mut new = Block::default();
                    if count == 0 {
                        hand_over(&mut block, &mut new, feed);
                    }
                    for (slot, (letter, value)) in [('X', x), ('Z', z)].into_iter().enumerate() {
                        let same = held[slot].is_some_and(|h| same_value(h, value));
                        if !same {
                            new.items.push(Item::Word(Word::new(letter, value)));
                            held[slot] = Some(value);
                        }
                    }
                    if new.words().any(|word| matches!(word.letter, 'X' | 'Z')) {
                        inserted.push(out.blocks.len());
                        // F stands last, as in the dialects' own hand.
                        new.items
                            .sort_by_key(|item| matches!(item, Item::Word(w) if w.letter == 'F'));
                        out.blocks.push(new);
                    }
                }
                let written = block.word('X').map(|word| word.number);
                let x = x_number(
                    program,
                    m.spelling,
                    m.to.axes[0],
                    plan.end[index],
                    plan.options.unit_mm,
                    written,
                )?;
                let holds = held[0].is_some_and(|h| same_value(h, x));
                if written.is_some_and(|w| !same_value(w, x)) || written.is_none() && !holds {
                    block.set('X', x, &['Z', 'R', 'I', 'K', 'F', 'S', 'T', 'M']);
                }
                if let Motion::Arc { .. } = m.motion {
                    let before = plan.before(index);
                    rebend(program, &mut block, m, before, plan.end[index], plan.options.unit_mm)?;
                }
            }
        }
        for (slot, letter) in ['X', 'Z'].into_iter().enumerate() {
            if let Some(word) = block.word(letter) {
                held[slot] = Some(word.number);
            }
        }
        if let Some(word) = block.word('F') {
            feed = Some(word.number);
        }
        out.blocks.push(block);
    }
    if !plan.options.keep_numbers {
        renumber(program, &mut out)?;
    }
    Ok((out, inserted))
}

fn same_value(a: Number, b: Number) -> bool {
    a.value().to_bits() == b.value().to_bits() && a.has_point() == b.has_point()
        || a.value() == 0.0 && b.value() == 0.0
}

/// Decimals of a length written anew: 1 µm, 0.0001 inch.
fn decimals(spelling: Spelling) -> u8 {
    if spelling.unit_mm > 1.0 { 4 } else { 3 }
}

/// X for a nominal radius and a correction of -k units on the diameter. What is not corrected stays
/// as written.
fn x_number(
    program: &Program,
    spelling: Spelling,
    nominal: f64,
    k: i64,
    unit: f64,
    written: Option<Number>,
) -> Result<Number> {
    if let (0, Some(number)) = (k, written) {
        return Ok(number);
    }
    #[allow(clippy::cast_precision_loss)] // errors are small
    let radius = nominal - 0.5 * k as f64 * unit;
    // A radius needs one more place for the same diameter.
    let places = decimals(spelling) + u8::from(!spelling.diameter);
    let places = places.max(written.map_or(0, Number::decimals)).min(9);
    program.dialect.spelled(spelling.x(radius), places)
}

/// Words that have to be in force from the beginning of the line go to its first block: motion and
/// modes, spindle, tool, coolant on, and a feed that is not in force yet.
fn hand_over(block: &mut Block, new: &mut Block, feed: Option<Number>) {
    let changes_feed =
        |word: &Word| feed.is_none_or(|f| f.value().to_bits() != word.number.value().to_bits());
    let goes = |item: &Item| match item {
        Item::Word(word) => match word.letter {
            'G' | 'S' | 'T' | 'D' | 'H' => true,
            'F' => changes_feed(word),
            'M' => ![0.0, 1.0, 2.0, 5.0, 9.0, 30.0, 60.0]
                .iter()
                .any(|stays: &f64| stays.to_bits() == word.number.value().to_bits()),
            _ => false,
        },
        _ => false,
    };
    let (taken, kept): (Vec<_>, Vec<_>) =
        std::mem::take(&mut block.items).into_iter().partition(goes);
    block.items = kept;
    new.items = taken;
}

/// An arc whose ends have moved gets a centre or radius that fits.
fn rebend(
    program: &Program,
    block: &mut Block,
    m: &Move,
    before: i64,
    after: i64,
    unit: f64,
) -> Result<()> {
    if before == 0 && after == 0 {
        return Ok(());
    }
    let Motion::Arc { centre, .. } = m.motion else { return Ok(()) };
    #[allow(clippy::cast_precision_loss)]
    let moved = |x: f64, k: i64| x - 0.5 * k as f64 * unit;
    let from = [m.from.axes[2], moved(m.from.axes[0], before)];
    let to = [m.to.axes[2], moved(m.to.axes[0], after)];
    let radius = (m.from.axes[2] - centre[0]).hypot(m.from.axes[0] - centre[1]);
    let chord = [to[0] - from[0], to[1] - from[1]];
    let length = chord[0].hypot(chord[1]);
    let half = 0.5 * length;
    let needed = radius.max(half);
    if let Some(word) = block.word('R') {
        if needed > radius {
            let places = decimals(m.spelling);
            let scale = 10_f64.powi(i32::from(places));
            let up = (needed / m.spelling.unit_mm * scale).ceil() / scale;
            let sign = if word.number.value() < 0.0 { -1.0 } else { 1.0 };
            let number = program.dialect.spelled(sign * up, places)?;
            block.set('R', number, &[]);
        }
        return Ok(());
    }
    // The centre stays on its side of the chord.
    let height = (needed * needed - half * half).max(0.0).sqrt();
    let old = [m.to.axes[2] - m.from.axes[2], m.to.axes[0] - m.from.axes[0]];
    let to_centre = [centre[0] - m.from.axes[2], centre[1] - m.from.axes[0]];
    let side = (old[0] * to_centre[1] - old[1] * to_centre[0]).signum();
    let new = [
        from[0] + 0.5 * chord[0] - side * height * chord[1] / length,
        from[1] + 0.5 * chord[1] + side * height * chord[0] / length,
    ];
    let base = if m.spelling.centre_absolute { [0.0, 0.0] } else { from };
    for (letter, value) in [('I', new[1] - base[1]), ('K', new[0] - base[0])] {
        let places = decimals(m.spelling);
        let number = program.dialect.spelled(value / m.spelling.unit_mm, places)?;
        if block.word(letter).is_some() || number.value() != 0.0 {
            block.set(letter, number, &['F', 'S', 'T', 'M']);
        }
    }
    Ok(())
}

/// Numbers the blocks anew if every block with words had a number and the numbers went up evenly; P
/// and Q of contour cycles follow.
fn renumber(original: &Program, out: &mut Program) -> Result<()> {
    let wordy = |b: &&Block| b.words().any(|w| w.letter != 'O');
    let mut numbers = Vec::new();
    for block in original.blocks.iter().filter(wordy) {
        let Some(word) = block.word('N') else { return Ok(()) };
        numbers.push(word.number);
    }
    let (Some(first), Some(second)) = (numbers.first(), numbers.get(1)) else { return Ok(()) };
    let step = second.value() - first.value();
    let even = numbers
        .windows(2)
        .all(|pair| matches!(pair, [a, b] if (b.value() - a.value()).to_bits() == step.to_bits()));
    if !even || step <= 0.0 {
        return Ok(());
    }
    let width = first.digits_before();
    let mut names = HashMap::new();
    let mut next = first.value();
    for block in out.blocks.iter_mut().filter(|b| wordy(&&**b)) {
        let number = Number::whole(next, width)?;
        if let Some(word) = block.word('N') {
            names.insert(word.number.value().to_bits(), number);
            block.set('N', number, &[]);
        } else {
            block.items.insert(0, Item::Word(Word::new('N', number)));
        }
        next += step;
    }
    for block in &mut out.blocks {
        let cycle = block.words().any(|w| {
            w.letter == 'G'
                && [70.0, 71.0, 72.0, 73.0]
                    .iter()
                    .any(|c: &f64| c.to_bits() == w.number.value().to_bits())
        });
        if cycle {
            for letter in ['P', 'Q'] {
                let Some(written) = block.word(letter).map(|word| word.number) else { continue };
                if let Some(number) = names.get(&written.value().to_bits()) {
                    block.set(letter, Number::whole(number.value(), written.digits_before())?, &[]);
                }
            }
        }
    }
    Ok(())
}

/// The diameter that a path cuts, by z of contact.
pub struct Diameters {
    /// Runs of pieces that follow each other: each with falling or rising z.
    runs: Vec<Vec<Piece>>,
}

struct Piece {
    from: [f64; 2],
    to: [f64; 2],
    element: super::geometry::Element,
}

impl Diameters {
    /// Feed moves of a path along which z changes; X is as programmed, the nose taken into account
    /// for z only.
    #[must_use]
    pub fn new(path: &Path, follows: Follows) -> Self {
        let mut runs: Vec<Vec<Piece>> = Vec::new();
        let mut joined = false;
        for m in &path.moves {
            let element = super::profile::element_of(m).ok().filter(|_| m.motion != Motion::Rapid);
            let dz = m.to.axes[2] - m.from.axes[2];
            let Some(element) = element else {
                joined = false;
                continue;
            };
            if dz.abs() < NOTHING_MM {
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
            if z > high + NOTHING_MM || z < low - NOTHING_MM {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nc::Dialect;
    use crate::units::UM;

    fn options(rule: Rule, start_corner: StartCorner) -> CorrectionOptions {
        CorrectionOptions {
            unit_mm: 10.0 * UM,
            window: 5,
            rule,
            start_corner,
            follows: Follows::Contour,
            start: Start { machine_codes: vec![('G', 4503.0)], ..Start::default() },
            keep_numbers: false,
        }
    }

    #[test]
    fn means_become_units_as_the_paper_counts() {
        let means = [-28.0, -25.0, -24.999, -15.0, -5.0, -4.999, 4.999, 5.0];
        let k: Vec<i64> = means.iter().map(|m| units_of(m * UM, 10.0 * UM)).collect();
        assert_eq!(k, [-3, -3, -2, -2, -1, 0, 0, 1]);
    }

    fn experiment(diameter: &str, end: &str, runs: &[(usize, f64)], n: usize) -> String {
        let original = format!(
            ";CSS_T/T\nN0001 G99\nN0002 G97M41\nN0003 G4503\nN0004 T0101\nN0005 G96S200.M3\n\
             N0006 G42\nN0007 G0X{diameter}Z75.\nN0008 G1Z65.F.1\nN0009 {end}\nN0010 X82.\nN0011 G40\n\
             N0012 G0X100.Z150.\nN0013 M30\n"
        );
        let k = runs.iter().flat_map(|&(count, k)| std::iter::repeat_n(k, 5 * count));
        #[allow(clippy::cast_precision_loss)]
        let readings: Vec<Reading> = k
            .take(n)
            .enumerate()
            .map(|(i, k)| Reading {
                z: 65.0 - 60.0 * (i + 1) as f64 / n as f64,
                error: k * 10.0 * UM,
            })
            .collect();
        assert_eq!(readings.len(), n);
        let program = Program::parse(&original, Dialect::FanucLathe).unwrap();
        correct(&program, &readings, &options(Rule::Paper, StartCorner::Zero))
            .unwrap()
            .program
            .emit()
    }

    #[test]
    fn fig_18_comes_out() {
        let ours = experiment("70.", "Z0F.10", &[(12, 0.0), (28, -1.0)], 196);
        assert_eq!(ours, include_str!("../../../../tests/data/turning/fig18.nc"));
    }

    #[test]
    fn fig_20_comes_out() {
        let runs = [(5, 0.0), (12, -1.0), (19, -2.0), (1, -3.0), (1, -2.0)];
        let ours = experiment("52.", "Z0", &runs, 190);
        assert_eq!(ours, include_str!("../../../../tests/data/turning/fig20.nc"));
    }
}
