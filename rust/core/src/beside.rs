//! Blocks of columns beside a basis: what each gains alone, by inner products.

use crate::{Error, Result};

/// Blocks of k columns: what a basis leaves of their inner products, and of those with residuals.
#[derive(Clone, Copy, Debug)]
pub struct Beside<'a> {
    /// Count of the columns of a block.
    pub width: usize,
    /// Inner products of the columns of each block with each other, k × k row-major.
    pub gram: &'a [f64],
    /// With q columns of an orthonormal basis, k × q of each block.
    pub basis: &'a [f64],
    /// With s columns of residuals that are orthogonal to it, k × s of each block.
    pub residuals: &'a [f64],
    /// Of a squared unit column, up to which it depends on the basis and the others of its block.
    pub dependent: f64,
}

impl Beside<'_> {
    /// Drop of the sum of squares of each residual by each block (b × s), and how many columns each
    /// block adds. Pivots that depend on earlier ones are left out.
    ///
    /// # Errors
    /// Sizes that do not fit.
    pub fn gains(&self, q: usize, s: usize) -> Result<(Vec<f64>, Vec<usize>)> {
        let k = self.width;
        let blocks = self.gram.len() / (k * k).max(1);
        for (what, found, expected) in [
            ("products with each other", self.gram.len(), blocks * k * k),
            ("products with the basis", self.basis.len(), blocks * k * q),
            ("products with residuals", self.residuals.len(), blocks * k * s),
        ] {
            if found != expected {
                return Err(Error::input(what, found, expected.to_string()));
            }
        }
        let mut gains = vec![0.0; blocks * s];
        let mut ranks = vec![0; blocks];
        let (mut a, mut z) = (vec![0.0; k * k], vec![0.0; k * s]);
        for (block, rank) in ranks.iter_mut().enumerate() {
            let t = &self.basis[block * k * q..][..k * q];
            a.copy_from_slice(&self.gram[block * k * k..][..k * k]);
            z.copy_from_slice(&self.residuals[block * k * s..][..k * s]);
            for i in 0..k {
                for j in 0..k {
                    let shared = t[i * q..][..q].iter().zip(&t[j * q..][..q]);
                    a[i * k + j] -= shared.map(|(x, y)| x * y).sum::<f64>();
                }
            }
            let own = &mut gains[block * s..][..s];
            *rank = eliminate(k, &mut a, &mut z, self.dependent, own);
        }
        Ok((gains, ranks))
    }
}

/// Adds to gains (s) what the pivots of a matrix (k × k) take of its right sides (k × s), and counts
/// them.
fn eliminate(k: usize, a: &mut [f64], z: &mut [f64], dependent: f64, gains: &mut [f64]) -> usize {
    let (s, mut rank) = (gains.len(), 0);
    for i in 0..k {
        let pivot = a[i * k + i];
        if pivot <= dependent || pivot.is_nan() {
            continue;
        }
        rank += 1;
        let (head, below) = z.split_at_mut((i + 1) * s);
        let own = &head[i * s..];
        gains.iter_mut().zip(own).for_each(|(gain, x)| *gain += x * x / pivot);
        for (j, rest) in (i + 1..k).zip(below.chunks_exact_mut(s.max(1))) {
            let factor = a[j * k + i] / pivot;
            rest.iter_mut().zip(own).for_each(|(x, above)| *x -= factor * above);
            for l in i + 1..k {
                a[j * k + l] -= factor * a[i * k + l];
            }
        }
    }
    rank
}

#[cfg(test)]
mod tests {
    use super::*;

    type Tested = std::result::Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn blocks_gain_what_the_basis_leaves_of_them_and_dependent_columns_nothing() -> Tested {
        // Two columns of which a basis has a part; and two that are the basis.
        let gram = [1.0, 0.5, 0.5, 0.41, 1.0, 0.0, 0.0, 1.0];
        let basis = [0.6, 0.0, 0.3, 0.3, 1.0, 0.0, 0.0, 1.0];
        let residuals = [0.8, 1.6, 0.4, 0.8, 0.0, 0.0, 0.0, 0.0];
        let blocks =
            Beside { width: 2, gram: &gram, basis: &basis, residuals: &residuals, dependent: 1e-4 };
        let (gains, ranks) = blocks.gains(2, 2)?;
        // The basis leaves 0.64 of the first and half of that beside it, and so of the residuals.
        assert_eq!(ranks, [2, 0]);
        for (gain, truth) in gains.iter().zip([1.0, 4.0, 0.0, 0.0]) {
            assert!((gain - truth).abs() < 1e-12, "{gains:?}");
        }
        assert!(blocks.gains(3, 2).is_err());
        let without = Beside { residuals: &[], ..blocks };
        assert_eq!(without.gains(2, 0)?.1, ranks);
        Ok(())
    }
}
