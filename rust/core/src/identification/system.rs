//! The linear systems of Gauss-Newton on touches: normal equations, QR, singular values.
//!
//! [`crate::linear`] solves one design that is given whole. Here a system is summed up touch by touch
//! in a workspace that thousands of fits reuse, by normal equations as long as they are safe, and its
//! covariance is that of what is identifiable, with no parameter held. What is not identifiable is
//! decided by the same rule: [`RANK_TOLERANCE`] and [`MIN_SHARE`] are those of [`crate::linear`].

use crate::linear::{MIN_SHARE, RANK_TOLERANCE};
use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Dyn};

/// Steps are taken by the normal equations, or by QR, where no scaled column lies nearer than this to
/// the others' span.
pub(super) const MIN_SEPARATION: f64 = 10.0 * RANK_TOLERANCE;

/// Normal equations with columns scaled to unit length.
pub(super) struct Normal {
    pub(super) factor: Cholesky<f64, Dyn>,
    pub(super) right: DVector<f64>,
    pub(super) scales: Vec<f64>,
    pub(super) free: Vec<bool>,
}

impl Normal {
    pub(super) fn solve(self) -> Solved {
        let solution = self.factor.solve(&self.right);
        Solved {
            step: solution.iter().zip(&self.scales).map(|(value, scale)| value / scale).collect(),
            largest: solution.amax(),
        }
    }

    /// Diagonal of (JᵀWJ)⁻¹: the squared lengths of the columns of L⁻¹; `None` unless the matrix
    /// certainly has full rank. L⁻¹ is at least as long as 1/σ of the least singular value, and the
    /// largest of p unit columns is at most √p. Parameters that are held have variance 0.
    pub(super) fn variances(&self) -> Option<Vec<f64>> {
        let p = self.scales.len();
        let mut inverse = DMatrix::identity(p, p);
        self.factor.l_dirty().solve_lower_triangular_mut(&mut inverse);
        let lengths: Vec<f64> = inverse.column_iter().map(|column| column.norm_squared()).collect();
        let length = lengths.iter().sum::<f64>().sqrt();
        (length * RANK_TOLERANCE * (p as f64).sqrt() < 1.0).then(|| {
            let squares = lengths.iter().zip(&self.scales).zip(&self.free);
            squares.map(|((l, s), free)| if *free { l / (s * s) } else { 0.0 }).collect()
        })
    }
}

pub(super) struct System {
    pub(super) matrix: DMatrix<f64>,
    pub(super) right: DVector<f64>,
}

pub(super) struct Solved {
    pub(super) step: Vec<f64>,
    /// Largest movement of the readings by one parameter's step, mm.
    pub(super) largest: f64,
}

pub(super) struct Decomposed {
    pub(super) cofactor: Vec<f64>,
    pub(super) not_identifiable: Vec<bool>,
    pub(super) null_space: Vec<f64>,
    pub(super) singular_values: Vec<f64>,
    pub(super) rank: usize,
}

impl System {
    /// Lengths of the columns; 1 where a column is empty.
    fn scales(&self) -> Vec<f64> {
        let lengths = self.matrix.column_iter().map(|column| column.norm());
        lengths.map(|length| if length > 0.0 { length } else { 1.0 }).collect()
    }

    fn scaled(&self, scales: &[f64]) -> DMatrix<f64> {
        let mut scaled = self.matrix.clone();
        for (mut column, scale) in scaled.column_iter_mut().zip(scales) {
            column /= *scale;
        }
        scaled
    }

    /// Least-squares step by QR; by a truncated singular value decomposition where columns depend on
    /// each other, which leaves what is not identifiable where it is.
    pub(super) fn solve(&self) -> Solved {
        let scales = self.scales();
        let p = scales.len();
        let qr = self.scaled(&scales).qr();
        let mut right = self.right.clone();
        qr.q_tr_mul(&mut right);
        let right = right.rows(0, p).clone_owned();
        let r = qr.r();
        let smallest = r.diagonal().iter().fold(f64::INFINITY, |least, d| least.min(d.abs()));
        let solution =
            if smallest > MIN_SEPARATION { r.solve_upper_triangular(&right) } else { None };
        let solution = solution.unwrap_or_else(|| {
            let svd = r.svd(true, true);
            let largest = svd.singular_values.max();
            svd.solve(&right, RANK_TOLERANCE * largest).unwrap_or_else(|_| DVector::zeros(p))
        });
        Solved {
            step: solution.iter().zip(&scales).map(|(value, scale)| value / scale).collect(),
            largest: solution.amax(),
        }
    }

    pub(super) fn decompose(&self) -> Decomposed {
        let scales = self.scales();
        let p = scales.len();
        let r = self.scaled(&scales).qr().r();
        let svd = r.svd(false, true);
        let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
        order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
        let largest = order.first().map_or(0.0, |&first| svd.singular_values[first]);
        let directions = svd.v_t.unwrap_or_else(|| DMatrix::identity(p, p));
        let mut cofactor = vec![0.0; p * p];
        let mut null_space = Vec::new();
        let mut excluded = vec![0.0; p];
        let mut rank = 0;
        for &index in &order {
            let value = svd.singular_values[index];
            let direction = directions.row(index);
            if value > RANK_TOLERANCE * largest && value > 0.0 {
                rank += 1;
                for i in 0..p {
                    for j in 0..p {
                        cofactor[i * p + j] +=
                            direction[i] * direction[j] / (value * value * scales[i] * scales[j]);
                    }
                }
            } else {
                null_space.extend(direction.iter().zip(&scales).map(|(v, scale)| v / scale));
                for (share, component) in excluded.iter_mut().zip(direction.iter()) {
                    *share += component * component;
                }
            }
        }
        Decomposed {
            cofactor,
            not_identifiable: excluded.iter().map(|share| share.sqrt() > MIN_SHARE).collect(),
            null_space,
            singular_values: order.iter().map(|&index| svd.singular_values[index]).collect(),
            rank,
        }
    }
}

/// A null space in reduced form: one parameter for each direction (the last ones that can serve),
/// and the rows in which each of these parameters stands alone. Held at their start the parameters
/// decide what the readings leave open; the rows name what cannot be distinguished, few at a time.
pub(super) fn reduced(null_space: &[f64], p: usize) -> (Vec<usize>, Vec<f64>) {
    let mut rows: Vec<Vec<f64>> = null_space.chunks_exact(p).map(<[f64]>::to_vec).collect();
    let size = |row: &[f64]| row.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
    let mut pivots = Vec::with_capacity(rows.len());
    for column in (0..p).rev() {
        let done = pivots.len();
        let share = |row: &[f64]| row[column].abs() / size(row);
        let best = (done..rows.len()).max_by(|&a, &b| share(&rows[a]).total_cmp(&share(&rows[b])));
        let Some(best) = best else { break };
        if share(&rows[best]) <= MIN_SHARE {
            continue;
        }
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
    (pivots, rows.concat())
}
