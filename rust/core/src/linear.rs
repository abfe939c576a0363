//! Linear least squares with one rule for what the data do not identify.
//!
//! ```text
//! values = columns · parameters + noise
//! ```
//!
//! Columns are scaled to unit length, so that units do not matter. A combination of parameters is
//! **not identifiable** if its singular value is at most [`RANK_TOLERANCE`] of the largest. Such a
//! combination is put on one of its parameters, the last one that has a fair share in it, which is
//! held: its step is zero. All others are then determined. Time and memory are linear in rows:
//! everything is decided on the triangular factor of the columns.
//!
//! Holding a parameter changes no value of an exact combination. A combination that the data show
//! weakly is better left alone as a whole: [`LinearFit::directions`] are those in which a fit may
//! move then.

use nalgebra::{DMatrix, DVector};

use crate::{Error, Result};

/// Singular values of columns of unit length, below this share of the largest, count as zero. What
/// touches do not identify to first order shows to second order through the tilts of errors and
/// placement, with 1e-4 to 3e-4 of the largest at 60 µm, 60″ and placements of 100 µm, 100″; the
/// weakest combination that a usual plan identifies has 0.03. Where the design is exact (a model
/// that is linear in its parameters) a tolerance of rounding can be given instead.
pub const RANK_TOLERANCE: f64 = 1e-3;
/// A parameter whose share of a unit vector lies in the null space by more than this is not
/// identifiable. Below it stand second-order shares: a height that cannot be distinguished from the
/// placement's dz drags dx along by the tilt of the placement, 1e-5.
pub(crate) const MIN_SHARE: f64 = 1e-3;
/// A parameter is held for a combination only if its share is at least this much of the largest:
/// without one that hardly takes part, the others would depend on each other as before.
const MIN_HELD_SHARE: f64 = 0.25;
/// A column shorter than this share of the longest is rounding (sin 180°) and counts as empty.
const EMPTY_COLUMN: f64 = 1e-10;
/// A combination below this singular value, as a share of the largest, is exact: rounding.
const EXACT: f64 = 1e-9;
/// Below this singular value the basis is orthogonalised twice.
const WELL_CONDITIONED: f64 = 1e-3;
/// Rows that are factored at once, at least: they stay in the cache.
const CHUNK_ROWS: usize = 512;

/// Options of [`linear_fit`].
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Parameters that are held beforehand: their columns are left out. Empty, or one a column.
    pub hold: Vec<bool>,
    /// Share of the largest singular value up to which one counts as zero.
    pub tolerance: f64,
    /// Whether [`LinearFit::basis`] is expected.
    pub basis: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { hold: Vec::new(), tolerance: RANK_TOLERANCE, basis: false }
    }
}

/// Result of [`linear_fit`]; p parameters, n rows.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearFit {
    /// Parameters; 0 for those that are held.
    pub solution: Vec<f64>,
    /// Covariance per unit of noise, p × p row-major; 0 for those that are held.
    pub cofactor: Vec<f64>,
    /// How many parameters are determined.
    pub rank: usize,
    /// Singular values of the scaled columns that were not held beforehand, largest first.
    pub singular_values: Vec<f64>,
    /// Parameters that are held, one for each combination that is not identifiable, and those that
    /// were held beforehand.
    pub held: Vec<bool>,
    /// Whether each parameter takes part in a combination that is not identifiable.
    pub not_identifiable: Vec<bool>,
    /// These combinations, one row of p each in the parameters' own units, largest component 1,
    /// in reduced form: each names one held parameter and what it cannot be distinguished from.
    pub combinations: Vec<f64>,
    /// Directions in which the parameters are identifiable, one row of p each in their own units: a
    /// unit vector for each parameter that is not held where all combinations are exact; otherwise
    /// the singular directions, which leave a weak combination alone.
    pub directions: Vec<f64>,
    /// Orthonormal basis of the columns that are not held, n × rank row-major; empty unless expected.
    pub basis: Vec<f64>,
}

/// Solves `columns · x = values` by least squares, `columns` n × p row-major.
///
/// # Errors
/// Sizes that do not fit, numbers that are not finite.
pub fn linear_fit(
    columns: &[f64],
    values: &[f64],
    p: usize,
    options: &Options,
) -> Result<LinearFit> {
    check(columns, values, p, options)?;
    let mut held = if options.hold.is_empty() { vec![false; p] } else { options.hold.clone() };
    let factor = triangular_factor(columns, values, p);
    let r = factor.view((0, 0), (p, p)).into_owned();
    let right = factor.view((0, p), (p, 1)).into_owned();
    let judged = judge(&r, &held, options.tolerance);
    for &pivot in &judged.pivots {
        held[pivot] = true;
    }

    let free: Vec<usize> = (0..p).filter(|&k| !held[k]).collect();
    let mut fit = LinearFit {
        solution: vec![0.0; p],
        cofactor: vec![0.0; p * p],
        rank: free.len(),
        singular_values: judged.singular_values,
        not_identifiable: judged.not_identifiable,
        combinations: judged.combinations,
        directions: judged.directions.unwrap_or_else(|| unit_vectors(p, &free)),
        held,
        basis: Vec::new(),
    };
    if free.is_empty() {
        return Ok(fit);
    }
    let scales: Vec<f64> = free.iter().map(|&k| judged.scales[k]).collect();
    let qr = scaled(&r, &free, &scales).qr();
    let mut right = DVector::from_column_slice(right.as_slice());
    qr.q_tr_mul(&mut right);
    let r = qr.r();
    let inverse = inverse_of(&r);
    let solution = &inverse * right.rows(0, free.len());
    let cofactor = &inverse * inverse.transpose();
    for (i, &k) in free.iter().enumerate() {
        fit.solution[k] = solution[i] / scales[i];
        for (j, &l) in free.iter().enumerate() {
            fit.cofactor[k * p + l] = cofactor[(i, j)] / (scales[i] * scales[j]);
        }
    }
    if options.basis {
        let weakest = fit.singular_values.iter().rev().nth(judged.pivots.len()).copied();
        let twice = weakest.is_some_and(|value| value < WELL_CONDITIONED);
        fit.basis = basis(columns, p, &free, &scales, &r, twice);
    }
    Ok(fit)
}

/// Beyond this, squares overflow and a decomposition does not end.
const MAX_VALUE: f64 = 1e140;

fn check(columns: &[f64], values: &[f64], p: usize, options: &Options) -> Result<()> {
    if columns.len() != values.len() * p {
        let expected = format!("{} x {p} of them", values.len());
        return Err(Error::input("columns", columns.len(), expected));
    }
    if !options.hold.is_empty() && options.hold.len() != p {
        return Err(Error::input("held parameters", options.hold.len(), format!("{p} flags")));
    }
    if let Some(bad) =
        columns.iter().chain(values).find(|value| value.is_nan() || value.abs() > MAX_VALUE)
    {
        let expected = format!("numbers within ±{MAX_VALUE:e}");
        return Err(Error::input("columns and values", bad, expected));
    }
    Ok(())
}

/// Triangular factor of the columns with the values as a last column, (p + 1) x (p + 1): chunk by
/// chunk of the rows, each beside the factor of those before it.
fn triangular_factor(columns: &[f64], values: &[f64], p: usize) -> DMatrix<f64> {
    let rows = CHUNK_ROWS.max(4 * p);
    let mut factor = DMatrix::<f64>::zeros(p + 1, p + 1);
    for (first, some) in values.chunks(rows).enumerate() {
        let first = first * rows;
        let mut stacked = DMatrix::<f64>::zeros(p + 1 + some.len(), p + 1);
        stacked.view_mut((0, 0), (p + 1, p + 1)).copy_from(&factor);
        for (i, value) in some.iter().enumerate() {
            let row = &columns[(first + i) * p..(first + i + 1) * p];
            for (k, entry) in row.iter().chain(std::iter::once(value)).enumerate() {
                stacked[(p + 1 + i, k)] = *entry;
            }
        }
        factor = stacked.qr().r();
    }
    factor
}

/// Chosen columns of a factor, divided by their scales.
fn scaled(r: &DMatrix<f64>, free: &[usize], scales: &[f64]) -> DMatrix<f64> {
    let mut out = r.select_columns(free);
    for (mut column, scale) in out.column_iter_mut().zip(scales) {
        column /= *scale;
    }
    out
}

/// Unit vectors of chosen parameters, one row of p each.
fn unit_vectors(p: usize, chosen: &[usize]) -> Vec<f64> {
    let mut out = vec![0.0; p * chosen.len()];
    for (row, &k) in out.chunks_exact_mut(p.max(1)).zip(chosen) {
        row[k] = 1.0;
    }
    out
}

/// Inverse of an upper triangular matrix.
fn inverse_of(r: &DMatrix<f64>) -> DMatrix<f64> {
    let mut inverse = DMatrix::identity(r.nrows(), r.nrows());
    r.solve_upper_triangular_mut(&mut inverse);
    inverse
}

/// What the columns identify.
struct Judged {
    scales: Vec<f64>,
    singular_values: Vec<f64>,
    pivots: Vec<usize>,
    not_identifiable: Vec<bool>,
    combinations: Vec<f64>,
    /// Singular directions above the tolerance, if one below it is not exact.
    directions: Option<Vec<f64>>,
}

fn judge(r: &DMatrix<f64>, hold: &[bool], tolerance: f64) -> Judged {
    let p = r.ncols();
    let tried: Vec<usize> = (0..p).filter(|&k| !hold[k]).collect();
    let lengths: Vec<f64> = r.column_iter().map(|column| column.norm()).collect();
    let longest = tried.iter().fold(0.0_f64, |most, &k| most.max(lengths[k]));
    let empty: Vec<bool> = lengths.iter().map(|l| *l <= EMPTY_COLUMN * longest).collect();
    // An empty column has no scale of its own; dividing by infinity leaves zeros.
    let divisors: Vec<f64> =
        tried.iter().map(|&k| if empty[k] { f64::INFINITY } else { lengths[k] }).collect();
    let scales: Vec<f64> =
        lengths.iter().zip(&empty).map(|(l, e)| if *e { 1.0 } else { *l }).collect();
    let mut judged = Judged {
        scales: scales.clone(),
        singular_values: Vec::new(),
        pivots: Vec::new(),
        not_identifiable: vec![false; p],
        combinations: Vec::new(),
        directions: None,
    };
    if tried.is_empty() {
        return judged;
    }
    let svd = scaled(r, &tried, &divisors).svd(false, true);
    let Some(directions) = svd.v_t else { return judged };
    let largest = svd.singular_values.max();
    let own_units = |row: &[f64]| -> Vec<f64> {
        let mut own = vec![0.0; p];
        for (component, &k) in row.iter().zip(&tried) {
            own[k] = component / scales[k];
        }
        own
    };
    let (mut null_space, mut kept, mut exact) = (Vec::new(), Vec::new(), true);
    for (value, direction) in svd.singular_values.iter().zip(directions.row_iter()) {
        let direction: Vec<f64> = direction.iter().copied().collect();
        judged.singular_values.push(*value);
        if *value <= tolerance * largest {
            exact &= *value <= EXACT * largest;
            null_space.push(direction);
        } else {
            kept.extend(own_units(&direction));
        }
    }
    judged.directions = (!exact).then_some(kept);
    judged.singular_values.sort_by(|a, b| b.total_cmp(a));
    for (i, &k) in tried.iter().enumerate() {
        let share: f64 = null_space.iter().map(|row| row[i] * row[i]).sum();
        judged.not_identifiable[k] = share.sqrt() > MIN_SHARE;
    }
    let (pivots, rows) = reduced(null_space);
    judged.pivots = pivots.iter().map(|&i| tried[i]).collect();
    for row in rows {
        let own = own_units(&row);
        let largest =
            own.iter().fold(0.0_f64, |most, v| if v.abs() > most.abs() { *v } else { most });
        judged.combinations.extend(own.iter().map(|v| v / largest));
    }
    judged
}

/// A null space in reduced form: one parameter for each direction (the last that have a fair share),
/// and the rows in which each of these parameters stands alone. What is left of the others below
/// [`MIN_SHARE`] of the largest is set to zero.
fn reduced(mut rows: Vec<Vec<f64>>) -> (Vec<usize>, Vec<Vec<f64>>) {
    let size = |row: &[f64]| row.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
    let p = rows.first().map_or(0, Vec::len);
    let mut pivots = Vec::with_capacity(rows.len());
    while pivots.len() < rows.len() {
        let done = pivots.len();
        // The last parameter with a fair share in a row that has none yet.
        let share = |row: &[f64], k: usize| row[k].abs() / size(row);
        let fair = (0..p).rev().find_map(|k| {
            let best = (done..rows.len())
                .max_by(|&a, &b| share(&rows[a], k).total_cmp(&share(&rows[b], k)))?;
            (share(&rows[best], k) >= MIN_HELD_SHARE).then_some((best, k))
        });
        let Some((best, column)) = fair else { break };
        rows.swap(done, best);
        let pivot = rows[done].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(index, _)| *index != done) {
            let factor = row[column] / pivot[column];
            for (value, used) in row.iter_mut().zip(&pivot) {
                *value -= factor * used;
            }
            row[column] = 0.0;
        }
        pivots.push(column);
    }
    rows.truncate(pivots.len());
    for row in &mut rows {
        let least = MIN_SHARE * size(row);
        row.iter_mut().filter(|value| value.abs() <= least).for_each(|value| *value = 0.0);
    }
    (pivots, rows)
}

/// Orthonormal basis of the free columns: each row solved against the triangular factor, once more
/// against the factor of the result where the columns nearly depend on each other.
fn basis(
    columns: &[f64],
    p: usize,
    free: &[usize],
    scales: &[f64],
    r: &DMatrix<f64>,
    twice: bool,
) -> Vec<f64> {
    let rank = free.len();
    let mut out = Vec::with_capacity(columns.len() / p * rank);
    for row in columns.chunks_exact(p) {
        out.extend(free.iter().zip(scales).map(|(&k, scale)| row[k] / scale));
    }
    divide_rows(&mut out, r);
    if twice {
        let nothing = vec![0.0; out.len() / rank];
        let again = triangular_factor(&out, &nothing, rank);
        divide_rows(&mut out, &again.view((0, 0), (rank, rank)).into_owned());
    }
    out
}

/// Solves q R = row for every row, in place: column by column of some rows at a time, as columns of
/// many rows are longer than a row.
fn divide_rows(rows: &mut [f64], r: &DMatrix<f64>) {
    let rank = r.nrows();
    for some in rows.chunks_mut(CHUNK_ROWS * rank) {
        let mut columns = DMatrix::from_row_slice(some.len() / rank, rank, some);
        for k in 0..rank {
            let (done, mut rest) = columns.columns_range_pair_mut(0..k, k..);
            let mut own = rest.column_mut(0);
            for (j, before) in done.column_iter().enumerate() {
                own.axpy(-r[(j, k)], &before, 1.0);
            }
            own /= r[(k, k)];
        }
        for (row, found) in some.chunks_exact_mut(rank).zip(columns.row_iter()) {
            row.iter_mut().zip(found.iter()).for_each(|(out, value)| *out = *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Tested = std::result::Result<(), Box<dyn std::error::Error>>;

    /// Rows of 1, t in small units, t², and three times the second column less a part of the first.
    fn design(n: usize) -> Vec<f64> {
        let row = |i: usize| {
            let t = i as f64 / n as f64;
            [1.0, 1e-6 * t, t * t, 3e-6 * t - 1e-6]
        };
        (0..n).flat_map(row).collect()
    }

    #[test]
    fn exact_values_are_found_and_the_dependent_parameter_is_held() -> Tested {
        for n in [40, 5000] {
            let columns = design(n);
            let values: Vec<f64> =
                columns.chunks_exact(4).map(|row| 2.0 * row[0] + 5.0 * row[1] - row[2]).collect();
            let fit = linear_fit(&columns, &values, 4, &Options::default())?;
            assert_eq!(fit.rank, 3);
            assert_eq!(fit.held, [false, false, false, true]);
            assert_eq!(fit.not_identifiable, [true, true, false, true]);
            for (found, truth) in fit.solution.iter().zip([2.0, 5.0, -1.0, 0.0]) {
                assert!((found - truth).abs() < 1e-7, "{found} {truth}");
            }
            // one more of the last, three less of the second, a millionth more of the first
            for (found, truth) in fit.combinations.iter().zip([-1e-6, 3.0, 0.0, -1.0]) {
                assert!((found - truth / 3.0).abs() < 1e-9, "{:?}", fit.combinations);
            }
        }
        Ok(())
    }

    #[test]
    fn the_basis_is_orthonormal_and_the_cofactor_the_inverse() -> Tested {
        let columns: Vec<f64> =
            design(3000).chunks_exact(4).flat_map(|r| [r[0], r[1], r[2]]).collect();
        let values = vec![1.0; 3000];
        let options = Options { basis: true, ..Options::default() };
        let fit = linear_fit(&columns, &values, 3, &options)?;
        let q = DMatrix::from_row_slice(3000, 3, &fit.basis);
        assert!((q.transpose() * &q - DMatrix::identity(3, 3)).amax() < 1e-13);
        let a = DMatrix::from_row_slice(3000, 3, &columns);
        let cofactor = DMatrix::from_row_slice(3, 3, &fit.cofactor);
        assert!((a.transpose() * a * cofactor - DMatrix::identity(3, 3)).amax() < 1e-6);
        Ok(())
    }

    #[test]
    fn nearly_dependent_columns_count_only_where_the_tolerance_says_so() -> Tested {
        let columns: Vec<f64> =
            (0..100).flat_map(|i| [1.0, 1.0 + 1e-5 * f64::from(i % 7)]).collect();
        let values = vec![1.0; 100];
        let fit = linear_fit(&columns, &values, 2, &Options::default())?;
        assert_eq!((fit.rank, fit.held[1]), (1, true));
        let options = Options { tolerance: 1e-9, basis: true, ..Options::default() };
        let fit = linear_fit(&columns, &values, 2, &options)?;
        assert_eq!(fit.rank, 2);
        let q = DMatrix::from_row_slice(100, 2, &fit.basis);
        assert!((q.transpose() * &q - DMatrix::identity(2, 2)).amax() < 1e-14);
        Ok(())
    }

    #[test]
    fn empty_held_and_too_many_columns_are_no_trouble() -> Tested {
        let options = Options { hold: vec![false, true, false], ..Options::default() };
        let fit = linear_fit(&[2.0, 1.0, 0.0], &[4.0], 3, &options)?;
        assert!((fit.solution[0] - 2.0).abs() < 1e-14);
        assert_eq!(fit.solution[1..], [0.0, 0.0]);
        assert_eq!(fit.held, [false, true, true]);
        assert_eq!(fit.not_identifiable, [false, false, true]);
        let none = linear_fit(&[], &[1.0, 2.0], 0, &Options::default())?;
        assert_eq!(none.rank, 0);
        assert!(linear_fit(&[1.0, f64::NAN], &[1.0], 2, &Options::default()).is_err());
        Ok(())
    }
}
