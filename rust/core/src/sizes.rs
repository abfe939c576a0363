//! Sizes of causes that act together, and how closely readings determine them.
//!
//! A cause is a block of orthonormal columns; only inner products of columns appear. The covariance
//! of the sizes of a set, per unit of noise, is the inverse of the Gram matrix of its columns. What
//! is made of it, the mean likelihood of a set over all sizes, is `trunnion.diagnosis.evidence`.

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, SymmetricEigen};

use crate::{Error, Result};

/// Some blocks of columns: their inner products with each other, and with the residuals.
#[derive(Clone, Copy, Debug)]
pub struct Products<'a> {
    /// Count of the columns of each block.
    pub rank: &'a [usize],
    /// With each other, K × K row-major. Blocks of no set with others may have zeros.
    pub gram: &'a [f64],
    /// With the residuals, K.
    pub residual: &'a [f64],
    /// Of a squared unit column, up to which it depends on the others.
    pub dependent: f64,
}

/// Sizes of sets, and their covariances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sizes {
    /// Drop of the sum of squares by each set.
    pub gain: Vec<f64>,
    /// Logarithm of the determinant of the covariance of each set's sizes, of some blocks.
    pub together: Vec<f64>,
    /// The same of each block of each set by itself, set after set.
    pub each: Vec<f64>,
    /// Length of the sizes of each block, in that order.
    pub length: Vec<f64>,
}

impl Products<'_> {
    /// Sizes of sets of blocks, each as the numbers of its blocks; `counted`: the blocks whose sizes
    /// [`Sizes::together`] is of.
    ///
    /// Of a set with columns that depend on each other none determines the sizes: as if the causes
    /// changed nothing that another does.
    ///
    /// # Errors
    /// Sizes that do not fit, a block that is not there.
    pub fn sizes(&self, sets: &[Vec<usize>], counted: &[bool]) -> Result<Sizes> {
        let columns: usize = self.rank.iter().sum();
        for (what, found, expected) in [
            ("products with each other", self.gram.len(), columns * columns),
            ("products with the residuals", self.residual.len(), columns),
            ("counted blocks", counted.len(), self.rank.len()),
        ] {
            if found != expected {
                return Err(Error::input(what, found, expected.to_string()));
            }
        }
        let blocks = self.rank.len();
        if let Some(block) = sets.iter().flatten().find(|&&block| block >= blocks) {
            return Err(Error::input("block", block, format!("below {blocks}")));
        }
        let starts: Vec<usize> = self
            .rank
            .iter()
            .scan(0, |end, rank| {
                *end += rank;
                Some(*end - rank)
            })
            .collect();
        let mut found = Sizes::default();
        for set in sets {
            self.add(set, &starts, counted, &mut found);
        }
        Ok(found)
    }

    /// Adds the sizes of a set.
    fn add(&self, set: &[usize], starts: &[usize], counted: &[bool], found: &mut Sizes) {
        // The covariance of the last columns together is seen from the diagonal of the factor.
        let mut order: Vec<usize> = (0..set.len()).collect();
        order.sort_by_key(|&i| counted[set[i]]);
        let mut first = vec![0; set.len()];
        let mut at = Vec::new();
        for i in order {
            first[i] = at.len();
            at.extend(starts[set[i]]..starts[set[i]] + self.rank[set[i]]);
        }
        let along = DVector::from_iterator(at.len(), at.iter().map(|&c| self.residual[c]));
        let (sizes, root) = self.determined(set.len(), &at, &along);
        found.gain.push(along.dot(&sizes));
        let mut some = 0;
        for (&block, &first) in set.iter().zip(&first) {
            let k = self.rank[block];
            some += if counted[block] { k } else { 0 };
            let each = root.as_ref().map_or(0.0, |root| log_det(&root.columns(first, k)));
            found.each.push(each);
            found.length.push(sizes.rows(first, k).norm());
        }
        let ends = (at.len() - some..at.len()).filter_map(|i| Some(root.as_ref()?[(i, i)]));
        found.together.push(ends.map(|x| 2.0 * x.ln()).sum());
    }

    /// Sizes of some columns, of so many blocks, and the lower root L of their covariance Lᵀ L; none
    /// where nothing is to be said of that.
    fn determined(
        &self,
        blocks: usize,
        at: &[usize],
        along: &DVector<f64>,
    ) -> (DVector<f64>, Option<DMatrix<f64>>) {
        let (k, columns) = (at.len(), self.residual.len());
        if blocks < 2 {
            return (along.clone(), None); // columns of a block are orthonormal
        }
        let own = DMatrix::from_fn(k, k, |i, j| self.gram[at[i] * columns + at[j]]);
        // No eigenvalue is below one over the sum of those of the inverse: most need no others.
        let root = match Cholesky::new(own.clone()).map(|factor| inverse(&factor.unpack())) {
            Some(root) if root.norm_squared() * self.dependent < 1.0 => {
                return (root.tr_mul(&(&root * along)), Some(root));
            }
            other => other,
        };
        let SymmetricEigen { eigenvectors: ways, eigenvalues } = SymmetricEigen::new(own);
        let seen = eigenvalues.map(|w| w > self.dependent);
        let mut part = ways.tr_mul(along);
        for ((x, w), seen) in part.iter_mut().zip(&eigenvalues).zip(&seen) {
            *x = if *seen { *x / w } else { 0.0 };
        }
        (ways * part, root.filter(|_| seen.iter().all(|seen| *seen)))
    }
}

/// Inverse of a lower triangle.
fn inverse(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let k = lower.nrows();
    let mut out = DMatrix::identity(k, k);
    for i in 0..k {
        let below = lower.view((i, i), (k - i, k - i));
        // Where the diagonal has a zero, nothing is left to be said: infinite, and so dependent.
        if !below.solve_lower_triangular_mut(&mut out.view_mut((i, i), (k - i, 1))) {
            out.fill(f64::INFINITY);
        }
    }
    out
}

/// Logarithm of the determinant of a covariance, by columns of its root.
fn log_det(root: &DMatrixView<'_, f64>) -> f64 {
    match root.ncols() {
        0 => 0.0,
        1 => root.norm_squared().max(f64::MIN_POSITIVE).ln(),
        _ => root.tr_mul(root).lu().lu_internal().diagonal().iter().map(|d| d.abs().ln()).sum(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Tested = std::result::Result<(), Box<dyn std::error::Error>>;

    /// Blocks of two columns and of one, which has 0.6 of the first; and the same one again.
    const GRAM: [f64; 16] =
        [1.0, 0.0, 0.6, 0.6, 0.0, 1.0, 0.0, 0.0, 0.6, 0.0, 1.0, 1.0, 0.6, 0.0, 1.0, 1.0];
    const OF: Products<'_> = Products {
        rank: &[2, 1, 1],
        gram: &GRAM,
        residual: &[3.0, 4.0, 1.0, 1.0],
        dependent: 1e-4,
    };

    #[test]
    fn sizes_solve_the_normal_equations_and_a_block_alone_has_its_products() -> Tested {
        let found = OF.sizes(&[vec![0], vec![0, 1], vec![]], &[true; 3])?;
        // x + 0.6 z = 3, y = 4, 0.6 x + z = 1
        let (z, x) = (-0.8 / 0.64, 3.0 + 0.6 * 0.8 / 0.64);
        let gain = 3.0 * x + 16.0 + z;
        let expected = [
            (&found.gain, vec![25.0, gain, 0.0]),
            (&found.length, vec![5.0, f64::hypot(x, 4.0), -z]),
            (&found.each, vec![0.0, -0.64_f64.ln(), -0.64_f64.ln()]),
            (&found.together, vec![0.0, -0.64_f64.ln(), 0.0]),
        ];
        for (values, truth) in expected {
            assert_eq!(values.len(), truth.len());
            for (value, truth) in values.iter().zip(truth) {
                assert!((value - truth).abs() < 1e-12, "{values:?}");
            }
        }
        Ok(())
    }

    #[test]
    fn columns_that_depend_on_each_other_determine_no_size() -> Tested {
        let found = OF.sizes(&[vec![1, 2]], &[true; 3])?;
        assert!((found.gain[0] - 1.0).abs() < 1e-12);
        assert_eq!((found.together[0], found.each), (0.0, vec![0.0, 0.0]));
        assert!((found.length[0] - 0.5).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn columns_that_hardly_differ_determine_sizes_up_to_the_limit() -> Tested {
        // Two pairs of columns; the inverse of the smallest eigenvalue is half of all of them.
        let near = 1.0 - 1.5e-4;
        let gram = [
            [1.0, near, 0.0, 0.0],
            [near, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, near],
            [0.0, 0.0, near, 1.0],
        ]
        .concat();
        let residual = [1.0, near, 0.0, 0.0];
        let of =
            |dependent| Products { rank: &[1; 4], gram: &gram, residual: &residual, dependent };
        let each = -(1.0 - near * near).ln();
        for dependent in [1e-5, 1e-4] {
            let found = of(dependent).sizes(&[vec![0, 1, 2, 3]], &[true, true, false, true])?;
            assert!((found.gain[0] - 1.0).abs() < 1e-9, "{found:?}");
            assert!((found.together[0] - 2.0 * each).abs() < 1e-9, "{found:?}");
            assert!(found.each.iter().all(|x| (x - each).abs() < 1e-9), "{found:?}");
            for (length, truth) in found.length.iter().zip([1.0, 0.0, 0.0, 0.0]) {
                assert!((length - truth).abs() < 1e-9, "{found:?}");
            }
        }
        let found = of(2e-4).sizes(&[vec![0, 1, 2, 3]], &[true; 4])?;
        assert_eq!((found.together[0], found.each), (0.0, vec![0.0; 4]));
        Ok(())
    }

    #[test]
    fn only_counted_blocks_are_in_the_covariance_together() -> Tested {
        let found = OF.sizes(&[vec![0, 1]], &[false, true, true])?;
        assert!((found.together[0] + 0.64_f64.ln()).abs() < 1e-12);
        assert!(OF.sizes(&[vec![3]], &[true; 3]).is_err());
        assert!(OF.sizes(&[], &[true; 2]).is_err());
        Ok(())
    }
}
