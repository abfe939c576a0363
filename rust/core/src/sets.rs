//! Sets of causes: what every further candidate explains beside a set, and what that costs.
//!
//! A candidate is one or more *blocks* of orthonormal columns, one block for each value of its
//! nonlinear parameters. Readings never appear: a set is known by the inner products of its own
//! basis, and of what it leaves of the residuals, with all columns. Scores are those of
//! `trunnion.diagnosis.selection`, where the search is.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, SymmetricEigen};

use crate::pieces::Pieces;
use crate::{Error, Result};

/// Columns of a block above which its eigenvalues are taken, not pivot by pivot.
const WIDE: usize = 12;
/// Of a squared unit column: what other columns leave of one that depends on them, wide blocks.
const DEPENDENT: f64 = 1e-5;
/// Of the series of the penalty, where it does not converge.
const MAX_BEYOND: f64 = 0.9;
/// Neighbouring columns that are looked at together for whether a direction has any part in them.
const TOGETHER: usize = 32;
/// Of a score, below which sets explain the same.
const DIGITS: f64 = 1e6;
const TINY: f64 = 1e-300;

/// The blocks of all candidates.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    /// Count of all columns.
    pub width: usize,
    /// First column of each block.
    pub start: Vec<usize>,
    /// Count of the columns of each block.
    pub rank: Vec<usize>,
    /// Number of each block's candidate; blocks of one candidate are neighbours.
    pub candidate: Vec<usize>,
    /// What each block costs, of -2 ln L; infinite for one that no set may have.
    pub penalty: Vec<f64>,
    /// Whether a block of one column is nothing if negative.
    pub positive: Vec<bool>,
    /// Of a squared unit column, below which it counts as dependent.
    pub dependent: f64,
    /// Where the numbers of each block in [`Left::cross`] start, and their count.
    at: Vec<usize>,
    /// Blocks that have columns among each [`TOGETHER`] of all.
    within: Vec<Vec<usize>>,
}

/// -2 ln L of a set, penalised for its size.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    /// Degrees of freedom that the nuisance leaves.
    pub degrees_of_freedom: usize,
    /// Least variance of a reading.
    pub floor: f64,
    /// Least sum of squares: rounding.
    pub least: f64,
}

/// Inner products of a direction with all columns.
#[derive(Clone, Debug, Default)]
pub struct Direction {
    /// Of each column.
    pub products: Vec<f64>,
    /// Whether it has a part in any of each `TOGETHER` columns: in none of other measurements.
    seen: Vec<bool>,
    /// Those columns.
    some: Vec<Range<usize>>,
}

/// What some blocks leave: their basis in the candidates' coordinates.
#[derive(Clone, Debug, Default)]
struct Left {
    /// An orthonormal basis; sets that begin alike have the same directions.
    taken: Vec<Arc<Direction>>,
    /// Inner products of all columns with what is left of the residuals.
    residual: Pieces<f64>,
    /// What is left of each squared column.
    free: Pieces<f64>,
    /// What is left of the products of the columns of each block, those below the diagonal of their
    /// matrix row by row: of all blocks that are not wide, one after the other.
    cross: Pieces<f64>,
    /// Sum of squares that is left.
    rss: f64,
}

/// A set of blocks.
#[derive(Clone, Debug, Default)]
pub struct Set {
    /// Its blocks, in the order in which they came.
    pub blocks: Vec<usize>,
    /// Sum of the penalties.
    pub penalty: f64,
    left: Left,
    /// Drop of the sum of squares by each further block, and count of the columns that it adds.
    gains: Pieces<(f64, usize)>,
}

/// A set with one more block.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    /// Score.
    pub score: f64,
    /// Number of the set.
    pub set: usize,
    /// The block.
    pub block: usize,
    /// Sum of squares that both leave.
    pub rss: f64,
    /// Columns of both.
    pub columns: usize,
}

impl Score {
    /// Of a sum of squares, so many columns and the sum of their penalties.
    #[must_use]
    pub fn of(&self, rss: f64, columns: usize, penalty: f64) -> f64 {
        let most = self.degrees_of_freedom.saturating_sub(2);
        if columns > most {
            return f64::INFINITY;
        }
        let (m, k) = (self.degrees_of_freedom as f64, columns as f64);
        let (rss, least) = (rss.max(self.least), m * self.floor);
        let mut deviance = m * rss.max(least).max(TINY).ln();
        if self.floor > 0.0 {
            deviance += (rss - least).min(0.0) / self.floor;
        }
        let size = m - k / 2.0 - 1.0;
        let beyond = (k - 2.0) * (penalty + k + 2.0) / (24.0 * size * size);
        let score = deviance + penalty * m / size / (1.0 - beyond.min(MAX_BEYOND));
        // Sets that explain the same are ordered by the catalogue, not by rounding.
        (score * DIGITS).round_ties_even() / DIGITS
    }
}

impl Set {
    /// Count of the columns.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.left.taken.len()
    }

    /// Its basis: inner products of its directions with all columns.
    #[must_use]
    pub fn taken(&self) -> &[Arc<Direction>] {
        &self.left.taken
    }

    /// Inner products of all columns with what it leaves of the residuals.
    #[must_use]
    pub fn residual(&self) -> Vec<f64> {
        self.left.residual.iter().copied().collect()
    }

    /// Sum of squares that it leaves.
    #[must_use]
    pub const fn rss(&self) -> f64 {
        self.left.rss
    }
}

impl Direction {
    fn of(products: Vec<f64>) -> Self {
        let chunks = products.chunks(TOGETHER);
        let seen: Vec<bool> = chunks.map(|own| own.iter().any(|x| *x != 0.0)).collect();
        let mut some: Vec<Range<usize>> = Vec::new();
        for (i, _) in seen.iter().enumerate().filter(|(_, seen)| **seen) {
            let (first, end) = (i * TOGETHER, products.len().min((i + 1) * TOGETHER));
            match some.last_mut().filter(|last| last.end == first) {
                Some(last) => last.end = end,
                None => some.push(first..end),
            }
        }
        Self { products, seen, some }
    }

    /// Adds a share of it to numbers of all columns.
    fn add_to(&self, numbers: &mut [f64], share: f64) {
        for some in &self.some {
            let own = numbers[some.clone()].iter_mut().zip(&self.products[some.clone()]);
            own.for_each(|(number, x)| *number += share * x);
        }
    }

    /// Changes what is left of all columns by what it has of each.
    fn change(&self, left: &mut Pieces<f64>, change: impl Fn(&mut f64, f64)) {
        for some in &self.some {
            left.change(some.clone(), |first, own| {
                let row = &self.products[first..first + own.len()];
                own.iter_mut().zip(row).for_each(|(number, x)| change(number, *x));
            });
        }
    }
}

impl Blocks {
    /// Blocks of which all is there and within the columns; what each is, as of the fields.
    ///
    /// # Errors
    /// Lengths that differ, columns beyond the last, candidates that are not in order.
    pub fn new(
        width: usize,
        start: Vec<usize>,
        rank: Vec<usize>,
        candidate: Vec<usize>,
        penalty: Vec<f64>,
        positive: Vec<bool>,
        dependent: f64,
    ) -> Result<Self> {
        let n = start.len();
        for found in [rank.len(), candidate.len(), penalty.len(), positive.len()] {
            if found != n {
                return Err(Error::input("blocks", found, format!("{n} of each")));
            }
        }
        let ends = start.iter().zip(&rank).map(|(start, rank)| start.saturating_add(*rank));
        if let Some(end) = ends.max().filter(|end| *end > width) {
            return Err(Error::input("columns of a block", end, format!("at most {width}")));
        }
        if candidate.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(Error::input("candidates of blocks", "others", "in ascending order"));
        }
        let pairs = rank.iter().map(|&k| if k > WIDE { 0 } else { k * k.saturating_sub(1) / 2 });
        let ends = pairs.scan(0, |end, pairs| {
            *end += pairs;
            Some(*end)
        });
        let at = std::iter::once(0).chain(ends).collect();
        let mut within = vec![Vec::new(); width.div_ceil(TOGETHER)];
        for (block, (&first, &k)) in start.iter().zip(&rank).enumerate().filter(|own| *own.1.1 > 0)
        {
            (first / TOGETHER..(first + k).div_ceil(TOGETHER)).for_each(|i| within[i].push(block));
        }
        Ok(Self { width, start, rank, candidate, penalty, positive, dependent, at, within })
    }

    /// The empty set: `residual`: inner products of all columns with the residuals.
    ///
    /// # Errors
    /// Another count of them than of columns.
    pub fn empty(&self, residual: Vec<f64>, rss: f64) -> Result<Set> {
        let left = self.nothing_taken(residual, rss)?;
        let gains: Vec<_> = (0..self.start.len()).map(|block| self.gain(&left, block)).collect();
        Ok(Set { left, gains: gains[..].into(), ..Set::default() })
    }

    fn nothing_taken(&self, residual: Vec<f64>, rss: f64) -> Result<Left> {
        if residual.len() != self.width {
            return Err(Error::input("residuals", residual.len(), self.width.to_string()));
        }
        let (residual, free) = (residual[..].into(), vec![1.0; self.width][..].into());
        let cross = vec![0.0; self.at.last().copied().unwrap_or(0)][..].into();
        Ok(Left { residual, free, cross, rss, ..Left::default() })
    }

    /// A set and one more block, `products`: inner products of its columns with all (k, width).
    ///
    /// # Errors
    /// A block that is not there, products of another size.
    pub fn extended(&self, set: &Set, block: usize, products: &[f64]) -> Result<Set> {
        self.check_set(set)?;
        self.check_products(block, products)?;
        let mut new = set.clone();
        self.take(&mut new.left, block, products.to_vec());
        for blocks in self.touched(&new.left.taken[set.columns()..]) {
            new.gains.change(blocks, |first, own| {
                own.iter_mut().zip(first..).for_each(|(one, i)| *one = self.gain(&new.left, i));
            });
        }
        new.blocks.push(block);
        new.penalty += self.penalty[block];
        Ok(new)
    }

    /// Columns of a block.
    fn columns(&self, block: usize) -> Range<usize> {
        self.start[block]..self.start[block] + self.rank[block]
    }

    /// Takes a block out of what others leave, `products`: of its columns with all (k, width).
    fn take(&self, left: &mut Left, block: usize, mut products: Vec<f64>) {
        let (m, columns) = (self.width, self.columns(block));
        for (row, column) in products.chunks_exact_mut(m.max(1)).zip(columns.clone()) {
            // Columns of other measurements have nothing in common with it.
            for taken in left.taken.iter().filter(|taken| taken.products[column] != 0.0) {
                taken.add_to(row, -taken.products[column]);
            }
        }
        if columns.len() == 1 {
            let (w, along) = (products[columns.start], left.residual.at(columns.start));
            if w > self.dependent {
                let weight = 1.0 / w.sqrt();
                products.iter_mut().for_each(|x| *x *= weight);
                self.take_direction(left, Direction::of(products), weight * along);
            }
            return;
        }
        let k = columns.len();
        let own = DMatrix::from_fn(k, k, |i, j| products[i * m + columns.start + j]);
        let found = SymmetricEigen::new(own);
        let mut along = vec![0.0; k];
        left.residual.copy_to(columns.start, &mut along);
        let ways = found.eigenvalues.iter().zip(found.eigenvectors.column_iter());
        for (w, u) in ways.filter(|(w, _)| **w > self.dependent) {
            let (mut row, mut total) = (vec![0.0; m], 0.0);
            for ((part, some), r) in u.iter().zip(products.chunks_exact(m)).zip(&along) {
                let weight = part / w.sqrt();
                row.iter_mut().zip(some).for_each(|(x, g)| *x += weight * g);
                total += weight * r;
            }
            self.take_direction(left, Direction::of(row), total);
        }
    }

    /// Takes a direction out of what is left; `along`: how far the residuals go along it.
    fn take_direction(&self, left: &mut Left, direction: Direction, along: f64) {
        direction.change(&mut left.residual, |residual, x| *residual -= along * x);
        direction.change(&mut left.free, |free, x| *free -= x * x);
        let direction = Arc::new(direction);
        let mut pairs = Vec::new();
        for blocks in self.touched(std::slice::from_ref(&direction)) {
            let at = self.at[blocks.start]..self.at[blocks.end];
            pairs.clear();
            for block in blocks.filter(|&block| self.at[block] < self.at[block + 1]) {
                let own = &direction.products[self.columns(block)];
                for (i, x) in own.iter().enumerate().skip(1) {
                    pairs.extend(own[..i].iter().map(|y| y * x));
                }
            }
            left.cross.change(at.clone(), |first, some| {
                let own = &pairs[first - at.start..];
                some.iter_mut().zip(own).for_each(|(left, pair)| *left -= pair);
            });
        }
        left.rss -= along * along;
        left.taken.push(direction);
    }

    /// Blocks in any of whose neighbouring columns some directions have a part, in order.
    fn touched(&self, directions: &[Arc<Direction>]) -> Vec<Range<usize>> {
        let mut seen = vec![false; self.start.len()];
        for (chunk, blocks) in self.within.iter().enumerate() {
            if directions.iter().any(|direction| direction.seen[chunk]) {
                blocks.iter().for_each(|&block| seen[block] = true);
            }
        }
        let mut found: Vec<Range<usize>> = Vec::new();
        for (block, _) in seen.iter().enumerate().filter(|(_, seen)| **seen) {
            match found.last_mut().filter(|last| last.end == block) {
                Some(last) => last.end = block + 1,
                None => found.push(block..block + 1),
            }
        }
        found
    }

    /// Every candidate beside every set, each at its best block, best first: as far as `reach`
    /// above the best of all and of `best`, and at least so `many`.
    ///
    /// # Errors
    /// Sets that do not belong to these blocks.
    pub fn tried(
        &self,
        sets: &[&Set],
        score: &Score,
        (best, reach, many): (f64, f64, usize),
    ) -> Result<Vec<Tried>> {
        let mut found = Vec::new();
        for (number, set) in sets.iter().enumerate() {
            self.check_set(set)?;
            let inside: Vec<usize> = set.blocks.iter().map(|&b| self.candidate[b]).collect();
            let mut first = 0;
            while first < self.start.len() {
                let candidate = self.candidate[first];
                let end = first + self.candidate[first..].partition_point(|c| *c == candidate);
                if !inside.contains(&candidate) {
                    found.extend(self.best_of(set, number, first..end, score));
                }
                first = end;
            }
        }
        let least = found.iter().fold(best, |least, one: &Tried| least.min(one.score));
        // Only what may be asked for is put in order; equals stay in the order of the catalogue.
        let near = found.iter().filter(|one| one.score <= least + reach).count();
        if near >= many {
            found.retain(|one| one.score <= least + reach);
        }
        found.sort_by(|a, b| a.score.total_cmp(&b.score));
        found.truncate(near.max(many));
        Ok(found)
    }

    /// What some blocks leave beside the empty set, and the drop of it by each of `further` blocks.
    ///
    /// `rows`: the blocks, each with the inner products of its columns with all (k, width). No
    /// columns of others have a part in it.
    ///
    /// # Errors
    /// Blocks that are not there, products of another size or not finite.
    pub fn gains_beside(
        &self,
        empty: &Set,
        rows: &[(usize, &[f64])],
        further: Range<usize>,
    ) -> Result<(f64, Vec<f64>)> {
        self.check_set(empty)?;
        let mut few: Vec<usize> = rows.iter().map(|row| row.0).chain(further.clone()).collect();
        few.sort_unstable();
        few.dedup();
        if few.last().is_some_and(|last| *last >= self.start.len()) {
            return Err(self.no_such(&few));
        }
        let columns: Vec<usize> = few.iter().flat_map(|&block| self.columns(block)).collect();
        let ends = few.iter().scan(0, |end, &block| {
            *end += self.rank[block];
            Some(*end - self.rank[block])
        });
        let small = Self::new(
            columns.len(),
            ends.collect(),
            few.iter().map(|&block| self.rank[block]).collect(),
            few.iter().map(|&block| self.candidate[block]).collect(),
            few.iter().map(|&block| self.penalty[block]).collect(),
            few.iter().map(|&block| self.positive[block]).collect(),
            self.dependent,
        )?;
        let residual = columns.iter().map(|&c| empty.left.residual.at(c)).collect();
        let mut left = small.nothing_taken(residual, empty.left.rss)?;
        let place = |block: usize| few.partition_point(|&b| b < block);
        for &(block, products) in rows {
            self.check_products(block, products)?;
            let own: Vec<f64> = products
                .chunks_exact(self.width.max(1))
                .flat_map(|row| columns.iter().map(|&c| row[c]))
                .collect();
            if let Some(number) = own.iter().find(|x| !x.is_finite()) {
                return Err(Error::input("products", number, "finite numbers"));
            }
            small.take(&mut left, place(block), own);
        }
        let first = place(further.start);
        let gains = (first..first + further.len()).map(|block| small.gain(&left, block).0);
        Ok((left.rss, gains.collect()))
    }

    /// Checks that a set is one of these blocks.
    fn check_set(&self, set: &Set) -> Result<()> {
        let cross = self.at.last().copied().unwrap_or(0);
        let own = set.left.residual.len() == self.width && set.left.cross.len() == cross;
        if own && set.gains.len() == self.start.len() {
            return Ok(());
        }
        Err(self.no_such(&set.blocks))
    }

    fn no_such(&self, blocks: &[usize]) -> Error {
        let expected = format!("one of {} blocks, {} columns", self.start.len(), self.width);
        Error::input("set of blocks", format!("{blocks:?}"), expected)
    }

    /// Checks that there is a block, and products of its columns with all.
    fn check_products(&self, block: usize, products: &[f64]) -> Result<()> {
        let Some(k) = self.rank.get(block) else {
            return Err(self.no_such(&[block]));
        };
        if products.len() != k * self.width {
            let expected = format!("{k} x {}", self.width);
            return Err(Error::input("products", products.len(), expected));
        }
        Ok(())
    }

    fn best_of(
        &self,
        set: &Set,
        number: usize,
        blocks: Range<usize>,
        score: &Score,
    ) -> Option<Tried> {
        let size = set.columns();
        let mut best: Option<Tried> = None;
        for block in blocks {
            let (gain, new) = set.gains.at(block);
            if new == 0 {
                continue;
            }
            let (rss, columns) = (set.rss() - gain, size + new);
            // At another place of the same cost a smaller gain is worth no more.
            let as_dear = |known: &Tried| {
                rss >= known.rss
                    && columns == known.columns
                    && self.penalty[block] >= self.penalty[known.block]
            };
            if best.as_ref().is_some_and(as_dear) {
                continue;
            }
            let value = score.of(rss, columns, set.penalty + self.penalty[block]);
            if value.is_finite() && best.is_none_or(|known| value < known.score) {
                best = Some(Tried { score: value, set: number, block, rss, columns });
            }
        }
        best
    }

    /// Drop of what is left of the sum of squares by a block, and count of its new columns.
    fn gain(&self, set: &Left, block: usize) -> (f64, usize) {
        match self.rank[block] {
            0 => (0.0, 0),
            1 => self.narrow_gain::<1>(set, block),
            2 => self.narrow_gain::<2>(set, block),
            3 => self.narrow_gain::<3>(set, block),
            4 => self.narrow_gain::<4>(set, block),
            5..=WIDE => self.narrow_gain::<WIDE>(set, block),
            _ => self.wide_gain(set, block),
        }
    }

    /// The same of a block of `N` columns, of at most so many where `N` is [`WIDE`]: Cholesky of its
    /// Gram matrix, dependent pivots left out.
    #[inline]
    fn narrow_gain<const N: usize>(&self, set: &Left, block: usize) -> (f64, usize) {
        let (start, k) = (self.start[block], if N == WIDE { self.rank[block].min(N) } else { N });
        let mut z = [0.0; N];
        let mut a = [[0.0; N]; N];
        set.residual.copy_to(start, &mut z[..k]);
        let mut first = self.at[block];
        for (i, row) in a.iter_mut().enumerate().take(k) {
            set.cross.copy_to(first, &mut row[..i]);
            row[i] = set.free.at(start + i);
            first += i;
        }
        let (mut total, mut count) = (0.0, 0);
        let negative = k == 1 && self.positive[block] && z[0] < 0.0;
        for i in 0..k {
            let seen = a[i][i] > self.dependent && !negative;
            if !seen {
                continue;
            }
            let inverse = 1.0 / a[i][i];
            total += z[i] * z[i] * inverse;
            count += 1;
            if i + 1 == k {
                break;
            }
            let below = a.map(|row| row[i]);
            for row in i + 1..k {
                let factor = below[row] * inverse;
                z[row] -= factor * z[i];
                let own = a[row][i + 1..=row].iter_mut();
                own.zip(&below[i + 1..=row]).for_each(|(x, other)| *x -= factor * other);
            }
        }
        (total, count)
    }

    /// The same of a block of many columns.
    fn wide_gain(&self, set: &Left, block: usize) -> (f64, usize) {
        let (start, k) = (self.start[block], self.rank[block]);
        let taken = DMatrix::from_fn(set.taken.len(), k, |i, j| set.taken[i].products[start + j]);
        let left = DMatrix::identity(k, k) - taken.tr_mul(&taken);
        let found = SymmetricEigen::new(left);
        let mut own = vec![0.0; k];
        set.residual.copy_to(start, &mut own);
        let (mut total, mut count) = (0.0, 0);
        for (w, u) in found.eigenvalues.iter().zip(found.eigenvectors.column_iter()) {
            if *w > DEPENDENT {
                let z: f64 = u.iter().enumerate().map(|(i, x)| x * own[i]).sum();
                total += z * z / w;
                count += 1;
            }
        }
        (total, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Tested = std::result::Result<(), Box<dyn std::error::Error>>;

    /// Three candidates of five readings: two single columns that overlap, and one of two columns.
    fn columns() -> [[f64; 5]; 4] {
        [
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [0.6, 0.8, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.6, 0.0, 0.8, 0.0],
        ]
    }

    fn product(a: &[f64; 5], b: &[f64; 5]) -> f64 {
        a.iter().zip(b).map(|(x, y)| x * y).sum()
    }

    /// Blocks of a candidate each, of so many columns one after the other.
    fn of_ranks(width: usize, rank: Vec<usize>) -> Result<Blocks> {
        let start = rank.iter().scan(0, |end, k| {
            *end += k;
            Some(*end - k)
        });
        let (start, count) = (start.collect(), rank.len());
        let penalty = rank.iter().map(|&k| k as f64).collect();
        Blocks::new(
            width,
            start,
            rank,
            (0..count).collect(),
            penalty,
            vec![false; count],
            DEPENDENT,
        )
    }

    #[test]
    fn a_set_leaves_what_least_squares_leaves() -> Tested {
        let (blocks, x, r) = (of_ranks(4, vec![1, 1, 2])?, columns(), [3.0, -1.0, 2.0, 0.5, 1.0]);
        let residual = x.iter().map(|c| product(c, &r)).collect();
        let empty = blocks.empty(residual, product(&r, &r))?;
        let rows = |some: std::ops::Range<usize>| -> Vec<f64> {
            some.flat_map(|i| x.map(|c| product(&x[i], &c))).collect()
        };
        let two = blocks.extended(&blocks.extended(&empty, 1, &rows(1..2))?, 0, &rows(0..1))?;
        // Both columns together span the first two readings.
        assert!((two.rss() - (4.0 + 0.25 + 1.0)).abs() < 1e-12, "{}", two.rss());
        let score = Score { degrees_of_freedom: 100, ..Score::default() };
        let tried = blocks.tried(&[&two], &score, (f64::INFINITY, 30.0, 1))?;
        // The third adds what is left of readings 3 and 4, and only it is not in the set yet.
        assert_eq!(tried.len(), 1);
        assert_eq!((tried[0].block, tried[0].columns), (2, 4));
        assert!((tried[0].rss - 1.0).abs() < 1e-12, "{}", tried[0].rss);
        let all = blocks.extended(&two, 2, &rows(2..4))?;
        assert!((all.rss() - 1.0).abs() < 1e-12, "{}", all.rss());
        let (left, gains) =
            blocks.gains_beside(&empty, &[(1, &rows(1..2)), (0, &rows(0..1))], 2..3)?;
        assert!((left - two.rss()).abs() < 1e-12, "{left}");
        assert!((left - gains[0] - all.rss()).abs() < 1e-12, "{gains:?}");
        assert!(blocks.gains_beside(&empty, &[(3, &rows(0..1))], 2..3).is_err());
        Ok(())
    }

    #[test]
    fn every_block_of_several_columns_keeps_its_own_products() -> Tested {
        // Two blocks of two columns that share a reading with the first.
        let x = [
            [0.6, 0.8, 0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.6, 0.8, 0.0, 0.0],
            [0.8, 0.0, 0.0, 0.6, 0.0],
            [0.0, 0.8, 0.0, 0.0, 0.6],
        ];
        let r = [3.0, -1.0, 2.0, 0.5, 1.0];
        let blocks = of_ranks(5, vec![1, 2, 2])?;
        let products = |i: usize| x.map(|c| product(&x[i], &c)).to_vec();
        let empty = blocks.empty(x.iter().map(|c| product(c, &r)).collect(), product(&r, &r))?;
        let one = blocks.extended(&empty, 0, &products(0))?;
        let score = Score { degrees_of_freedom: 100, ..Score::default() };
        let mut tried = blocks.tried(&[&one], &score, (f64::INFINITY, 1e3, 2))?;
        tried.sort_by_key(|found| found.block);
        for (found, block) in tried.iter().zip([1, 2]) {
            let both: Vec<f64> = (2 * block - 1..=2 * block).flat_map(products).collect();
            let set = blocks.extended(&one, block, &both)?;
            assert_eq!((found.block, found.columns), (block, 3));
            assert!((found.rss - set.rss()).abs() < 1e-12, "{} {}", found.rss, set.rss());
        }
        Ok(())
    }

    #[test]
    fn wide_blocks_gain_what_pivots_say() -> Tested {
        let width = WIDE + 1;
        let start = vec![0, 0];
        let (rank, candidate) = (vec![width, WIDE], vec![0, 1]);
        let of = |start| {
            Blocks::new(
                width,
                start,
                rank.clone(),
                candidate.clone(),
                vec![1.0; 2],
                vec![false; 2],
                DEPENDENT,
            )
        };
        let blocks = of(start)?;
        let empty = blocks.empty((0..width).map(|i| i as f64).collect(), 1e3)?;
        let squares = |n: usize| (0..n).map(|i| (i * i) as f64).sum::<f64>();
        let gains: Vec<_> = empty.gains.iter().copied().collect();
        assert_eq!(gains, [(squares(width), width), (squares(WIDE), WIDE)]);
        assert!(of(vec![0, 2]).is_err());
        Ok(())
    }
}
