//! Sets of causes: what every further candidate explains beside a set, and what that costs.
//!
//! A candidate is one or more *blocks* of orthonormal columns, one block for each value of its
//! nonlinear parameters. Readings never appear: a set is known by the inner products of its own
//! basis, and of what it leaves of the residuals, with all columns. Scores are those of
//! `trunnion.diagnosis.selection`, where the search is.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, SymmetricEigen};

use crate::{Error, Result};

/// Columns of a block above which its eigenvalues are taken, not pivot by pivot.
const WIDE: usize = 12;
/// Of a squared unit column: what other columns leave of one that depends on them, wide blocks.
const DEPENDENT: f64 = 1e-5;
/// Of the series of the penalty, where it does not converge.
const MAX_BEYOND: f64 = 0.9;
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

/// A set of blocks: its basis in the candidates' coordinates, and what it leaves.
#[derive(Clone, Debug, Default)]
pub struct Set {
    /// Its blocks, in the order in which they came.
    pub blocks: Vec<usize>,
    /// Inner products of its orthonormal basis with all columns, one row each; sets that begin alike
    /// have the same rows.
    pub taken: Vec<Arc<Vec<f64>>>,
    /// Inner products of all columns with what it leaves of the residuals.
    pub residual: Vec<f64>,
    /// What it leaves of each squared column.
    free: Vec<f64>,
    /// What it leaves of the products of the columns of each block, those below the diagonal of
    /// their matrix row by row: of all blocks that are not wide, one after the other.
    cross: Vec<f64>,
    /// Sum of squares that it leaves.
    pub rss: f64,
    /// Sum of the penalties.
    pub penalty: f64,
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
        self.taken.len()
    }
}

impl Blocks {
    /// Checks that all is there and within the columns.
    ///
    /// # Errors
    /// Lengths that differ, columns beyond the last, candidates that are not in order.
    pub fn check(&self) -> Result<()> {
        let n = self.start.len();
        for found in
            [self.rank.len(), self.candidate.len(), self.penalty.len(), self.positive.len()]
        {
            if found != n {
                return Err(Error::input("blocks", found, format!("{n} of each")));
            }
        }
        let ends =
            self.start.iter().zip(&self.rank).map(|(start, rank)| start.saturating_add(*rank));
        if let Some(end) = ends.max().filter(|end| *end > self.width) {
            return Err(Error::input("columns of a block", end, format!("at most {}", self.width)));
        }
        if self.candidate.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(Error::input("candidates of blocks", "others", "in ascending order"));
        }
        Ok(())
    }

    /// The empty set: `residual`: inner products of all columns with the residuals.
    ///
    /// # Errors
    /// Another count of them than of columns.
    pub fn empty(&self, residual: Vec<f64>, rss: f64) -> Result<Set> {
        if residual.len() != self.width {
            return Err(Error::input("residuals", residual.len(), self.width.to_string()));
        }
        let free = vec![1.0; self.width];
        let cross = vec![0.0; self.pairs().sum()];
        Ok(Set { residual, free, cross, rss, ..Set::default() })
    }

    /// Count of the numbers that [`Set::cross`] has of each block.
    fn pairs(&self) -> impl Iterator<Item = usize> {
        self.rank.iter().map(|&k| if k > WIDE { 0 } else { k * k.saturating_sub(1) / 2 })
    }

    /// A set and one more block, `products`: inner products of its columns with all (k, width).
    ///
    /// # Errors
    /// A block that is not there, products of another size.
    pub fn extended(&self, set: &Set, block: usize, products: &[f64]) -> Result<Set> {
        let (m, start, k) = self.of_block(set, block)?;
        if products.len() != k * m {
            return Err(Error::input("products", products.len(), format!("{k} x {m}")));
        }
        let mut left = products.to_vec();
        for (i, row) in left.chunks_exact_mut(m.max(1)).enumerate() {
            // Columns of other measurements have nothing in common with it.
            for taken in set.taken.iter().filter(|taken| taken[start + i] != 0.0) {
                let share = taken[start + i];
                row.iter_mut().zip(taken.iter()).for_each(|(x, t)| *x -= share * t);
            }
        }
        let mut new = set.clone();
        if k == 1 {
            let (w, along) = (left[start], set.residual[start]);
            if w > self.dependent {
                let weight = 1.0 / w.sqrt();
                left.iter_mut().for_each(|x| *x *= weight);
                self.take(&mut new, left, weight * along);
            }
        } else {
            let own = DMatrix::from_fn(k, k, |i, j| left[i * m + start + j]);
            let found = SymmetricEigen::new(own);
            let ways = found.eigenvalues.iter().zip(found.eigenvectors.column_iter());
            for (w, u) in ways.filter(|(w, _)| **w > self.dependent) {
                let mut row = vec![0.0; m];
                let mut along = 0.0;
                for (i, part) in u.iter().enumerate() {
                    let weight = part / w.sqrt();
                    let some = left[i * m..(i + 1) * m].iter();
                    row.iter_mut().zip(some).for_each(|(x, g)| *x += weight * g);
                    along += weight * set.residual[start + i];
                }
                self.take(&mut new, row, along);
            }
        }
        new.blocks.push(block);
        new.penalty += self.penalty[block];
        Ok(new)
    }

    /// Takes a direction out of what a set leaves: its products with all columns, and how far the
    /// residuals go along it.
    fn take(&self, set: &mut Set, row: Vec<f64>, along: f64) {
        for (left, x) in set.residual.iter_mut().zip(&row) {
            *left -= along * x;
        }
        for (free, x) in set.free.iter_mut().zip(&row) {
            *free -= x * x;
        }
        let mut rest = set.cross.iter_mut();
        let narrow = self.start.iter().zip(&self.rank).filter(|(_, k)| **k > 1 && **k <= WIDE);
        for (&start, &k) in narrow {
            let own = &row[start..start + k];
            for (i, x) in own.iter().enumerate().skip(1) {
                own[..i].iter().zip(rest.by_ref()).for_each(|(y, left)| *left -= y * x);
            }
        }
        set.rss -= along * along;
        set.taken.push(Arc::new(row));
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
        let at = self.places();
        for (number, set) in sets.iter().enumerate() {
            self.check_set(set, &at)?;
            let inside: Vec<usize> = set.blocks.iter().map(|&b| self.candidate[b]).collect();
            let mut first = 0;
            while first < self.start.len() {
                let candidate = self.candidate[first];
                let end = first + self.candidate[first..].partition_point(|c| *c == candidate);
                if !inside.contains(&candidate) {
                    found.extend(self.best_of(set, number, first..end, (score, &at)));
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

    /// Drop of the sum of squares by each block beside a set.
    ///
    /// # Errors
    /// A set that does not belong to these blocks.
    pub fn gains(&self, set: &Set) -> Result<Vec<f64>> {
        let at = self.places();
        self.check_set(set, &at)?;
        Ok((0..self.start.len()).map(|block| self.gain(set, block, at[block]).0).collect())
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
        let mut few: Vec<usize> = rows.iter().map(|row| row.0).chain(further.clone()).collect();
        few.sort_unstable();
        few.dedup();
        let mut small = Self { dependent: self.dependent, ..Self::default() };
        let mut columns = Vec::new();
        for &block in &few {
            let (_, start, rank) = self.of_block(empty, block)?;
            small.start.push(columns.len());
            small.rank.push(rank);
            small.candidate.push(self.candidate[block]);
            small.penalty.push(self.penalty[block]);
            small.positive.push(self.positive[block]);
            columns.extend(start..start + rank);
        }
        small.width = columns.len();
        let residual = columns.iter().map(|&c| empty.residual[c]).collect();
        let mut set = small.empty(residual, empty.rss)?;
        let place = |block: usize| few.partition_point(|&b| b < block);
        for &(block, products) in rows {
            let expected = self.rank[block] * self.width;
            if products.len() != expected {
                return Err(Error::input("products", products.len(), expected.to_string()));
            }
            let own: Vec<f64> = products
                .chunks_exact(self.width.max(1))
                .flat_map(|row| columns.iter().map(|&c| row[c]))
                .collect();
            if let Some(number) = own.iter().find(|x| !x.is_finite()) {
                return Err(Error::input("products", number, "finite numbers"));
            }
            set = small.extended(&set, place(block), &own)?;
        }
        let first = place(further.start);
        let gains = small.gains(&set)?.into_iter().skip(first).take(further.len()).collect();
        Ok((set.rss, gains))
    }

    /// Where the numbers of each block in [`Set::cross`] start, and their count.
    fn places(&self) -> Vec<usize> {
        let ends = self.pairs().scan(0, |end, pairs| {
            *end += pairs;
            Some(*end)
        });
        std::iter::once(0).chain(ends).collect()
    }

    /// Checks that a set is one of these blocks.
    fn check_set(&self, set: &Set, at: &[usize]) -> Result<()> {
        self.of_block(set, 0)?;
        if set.cross.len() != at.last().copied().unwrap_or(0) {
            return Err(Error::input("set of blocks", "another", "one of these blocks"));
        }
        Ok(())
    }

    fn best_of(
        &self,
        set: &Set,
        number: usize,
        blocks: Range<usize>,
        (score, at): (&Score, &[usize]),
    ) -> Option<Tried> {
        let size = set.columns();
        let mut best: Option<Tried> = None;
        for block in blocks {
            let (gain, new) = self.gain(set, block, at[block]);
            if new == 0 {
                continue;
            }
            let (rss, columns) = (set.rss - gain, size + new);
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

    /// Width, first column and count of columns of a block, for a set of these blocks.
    fn of_block(&self, set: &Set, block: usize) -> Result<(usize, usize, usize)> {
        let known = set.blocks.iter().chain(std::iter::once(&block)).max();
        if set.residual.len() != self.width || known.is_some_and(|b| *b >= self.start.len()) {
            let expected = format!("one of {} blocks, {} columns", self.start.len(), self.width);
            return Err(Error::input("set of blocks", format!("{:?}", set.blocks), expected));
        }
        Ok((self.width, self.start[block], self.rank[block]))
    }

    /// Drop of the sum of squares by a block beside a set, and count of its new columns; `at`: where
    /// its numbers in [`Set::cross`] start.
    fn gain(&self, set: &Set, block: usize, at: usize) -> (f64, usize) {
        match self.rank[block] {
            0 => (0.0, 0),
            1 => self.narrow_gain::<1>(set, block, at),
            2 => self.narrow_gain::<2>(set, block, at),
            3 => self.narrow_gain::<3>(set, block, at),
            4 => self.narrow_gain::<4>(set, block, at),
            5..=WIDE => self.narrow_gain::<WIDE>(set, block, at),
            _ => self.wide_gain(set, block),
        }
    }

    /// The same of a block of `N` columns, of at most so many where `N` is [`WIDE`]: Cholesky of its
    /// Gram matrix, dependent pivots left out.
    #[inline]
    fn narrow_gain<const N: usize>(&self, set: &Set, block: usize, at: usize) -> (f64, usize) {
        let (start, k) = (self.start[block], if N == WIDE { self.rank[block].min(N) } else { N });
        let mut z = [0.0; N];
        let mut a = [[0.0; N]; N];
        z[..k].copy_from_slice(&set.residual[start..start + k]);
        let mut rest = set.cross[at..].iter();
        for (i, row) in a.iter_mut().enumerate().take(k).skip(1) {
            row[..i].iter_mut().zip(rest.by_ref()).for_each(|(x, left)| *x = *left);
        }
        for (i, (row, free)) in a.iter_mut().zip(&set.free[start..start + k]).enumerate() {
            row[i] = *free;
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
    fn wide_gain(&self, set: &Set, block: usize) -> (f64, usize) {
        let (start, k) = (self.start[block], self.rank[block]);
        let taken = DMatrix::from_fn(set.columns(), k, |i, j| set.taken[i][start + j]);
        let left = DMatrix::identity(k, k) - taken.tr_mul(&taken);
        let found = SymmetricEigen::new(left);
        let (mut total, mut count) = (0.0, 0);
        for (w, u) in found.eigenvalues.iter().zip(found.eigenvectors.column_iter()) {
            if *w > DEPENDENT {
                let own = &set.residual[start..start + k];
                let z: f64 = u.iter().zip(own).map(|(x, r)| x * r).sum();
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

    fn blocks() -> Blocks {
        Blocks {
            width: 4,
            start: vec![0, 1, 2],
            rank: vec![1, 1, 2],
            candidate: vec![0, 1, 2],
            penalty: vec![1.0, 1.0, 2.0],
            positive: vec![false; 3],
            dependent: 1e-5,
        }
    }

    #[test]
    fn a_set_leaves_what_least_squares_leaves() -> Tested {
        let (blocks, x, r) = (blocks(), columns(), [3.0, -1.0, 2.0, 0.5, 1.0]);
        blocks.check()?;
        let residual = x.iter().map(|c| product(c, &r)).collect();
        let empty = blocks.empty(residual, product(&r, &r))?;
        let rows = |some: std::ops::Range<usize>| -> Vec<f64> {
            some.flat_map(|i| x.map(|c| product(&x[i], &c))).collect()
        };
        let two = blocks.extended(&blocks.extended(&empty, 1, &rows(1..2))?, 0, &rows(0..1))?;
        // Both columns together span the first two readings.
        assert!((two.rss - (4.0 + 0.25 + 1.0)).abs() < 1e-12, "{}", two.rss);
        let score = Score { degrees_of_freedom: 100, ..Score::default() };
        let tried = blocks.tried(&[&two], &score, (f64::INFINITY, 30.0, 1))?;
        // The third adds what is left of readings 3 and 4, and only it is not in the set yet.
        assert_eq!(tried.len(), 1);
        assert_eq!((tried[0].block, tried[0].columns), (2, 4));
        assert!((tried[0].rss - 1.0).abs() < 1e-12, "{}", tried[0].rss);
        let all = blocks.extended(&two, 2, &rows(2..4))?;
        assert!((all.rss - 1.0).abs() < 1e-12, "{}", all.rss);
        let (left, gains) =
            blocks.gains_beside(&empty, &[(1, &rows(1..2)), (0, &rows(0..1))], 2..3)?;
        assert!((left - two.rss).abs() < 1e-12, "{left}");
        assert!((left - gains[0] - all.rss).abs() < 1e-12, "{gains:?}");
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
        let blocks = Blocks {
            width: 5,
            start: vec![0, 1, 3],
            rank: vec![1, 2, 2],
            candidate: vec![0, 1, 2],
            penalty: vec![1.0, 2.0, 2.0],
            positive: vec![false; 3],
            dependent: 1e-5,
        };
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
            assert!((found.rss - set.rss).abs() < 1e-12, "{} {}", found.rss, set.rss);
        }
        Ok(())
    }

    #[test]
    fn wide_blocks_gain_what_pivots_say() -> Tested {
        let width = WIDE + 1;
        let mut blocks = Blocks {
            width,
            start: vec![0, 0],
            rank: vec![width, WIDE],
            candidate: vec![0, 1],
            penalty: vec![1.0; 2],
            positive: vec![false; 2],
            dependent: DEPENDENT,
        };
        let empty = blocks.empty((0..width).map(|i| i as f64).collect(), 1e3)?;
        let squares = |n: usize| (0..n).map(|i| (i * i) as f64).sum::<f64>();
        assert_eq!(blocks.gain(&empty, 0, 0), (squares(width), width));
        assert_eq!(blocks.gain(&empty, 1, 0), (squares(WIDE), WIDE));
        blocks.start[1] = 2;
        assert!(blocks.check().is_err());
        Ok(())
    }
}
