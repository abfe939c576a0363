//! Values of a recorded quantity: sums over the readings that have the same, and where local errors
//! have several of them.

use crate::{Error, Result};

/// Which of its values each reading has, of some quantities: n numbers of each, one after the other.
///
/// The values of all quantities are numbered together; a negative number is no value.
#[derive(Clone, Copy, Debug)]
pub struct ByValue<'a> {
    /// Number of the value of each reading, quantity after quantity.
    pub values: &'a [i64],
    /// Count of readings.
    pub readings: usize,
    /// Count of all values.
    pub count: usize,
}

impl ByValue<'_> {
    /// Sums of each of c weights times each of s columns over the readings of each value,
    /// `count` × c s. `weights`: n of each, one after the other; `columns`: n × s row-major.
    ///
    /// # Errors
    /// Sizes that do not fit, numbers beyond the values.
    pub fn sums(&self, weights: &[f64], columns: &[f64]) -> Result<Vec<f64>> {
        let n = self.readings.max(1);
        for (what, found) in [
            ("values of readings", self.values.len()),
            ("weights of readings", weights.len()),
            ("columns of readings", columns.len()),
        ] {
            if found % n != 0 || (found > 0 && self.readings == 0) {
                return Err(Error::input(what, found, format!("{n} of each")));
            }
        }
        let most = i64::try_from(self.count).unwrap_or(i64::MAX);
        if let Some(bad) = self.values.iter().find(|value| **value >= most) {
            return Err(Error::input("value of a reading", bad, format!("below {most}")));
        }
        let (c, s) = (weights.len() / n, columns.len() / n);
        let mut sums = vec![0.0; self.count * c * s];
        let mut products = vec![0.0; c * s];
        for (i, row) in columns.chunks_exact(s.max(1)).enumerate() {
            let each = weights.iter().skip(i).step_by(n);
            for (own, weight) in products.chunks_exact_mut(s.max(1)).zip(each) {
                own.iter_mut().zip(row).for_each(|(product, x)| *product = weight * x);
            }
            for &value in self.values.iter().skip(i).step_by(n) {
                if let Ok(value) = usize::try_from(value) {
                    let sum = &mut sums[value * c * s..][..c * s];
                    sum.iter_mut().zip(&products).for_each(|(sum, product)| *sum += product);
                }
            }
        }
        Ok(sums)
    }
}

/// Least count of values within the width of a local error.
const WITHIN: usize = 3;

/// Which local errors, by their places and widths, have several values of a quantity in them, and
/// some on each side: what ends where the readings end is a jump, or slow.
///
/// `values`: those that are distinct; `period`: of an angle.
#[must_use]
pub fn inside(values: &[f64], errors: &[(f64, f64)], period: Option<f64>) -> Vec<bool> {
    errors
        .iter()
        .map(|&(place, width)| {
            let (mut within, mut before, mut behind) = (0, false, false);
            for value in values {
                let off = value - place;
                // the short way round
                let off = period.map_or(off, |turn| off - turn * (off / turn).round_ties_even());
                let widths = off / width;
                within += usize::from(widths.abs() <= 0.5);
                before |= widths > -1.5 && widths < -0.5;
                behind |= widths > 0.5 && widths < 1.5;
            }
            within >= WITHIN && before && behind
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_of_a_value_are_summed_and_those_without_one_left_out() -> Result<()> {
        // Two quantities of three readings: values 0 and 1, and value 2 of the first reading only.
        let by = ByValue { values: &[0, 1, 0, 2, -1, -1], readings: 3, count: 3 };
        let sums = by.sums(&[1.0, 1.0, 1.0, 2.0, 3.0, 4.0], &[1.0, 10.0, 2.0, 20.0, 3.0, 30.0])?;
        assert_eq!(sums[..4], [4.0, 40.0, 14.0, 140.0]);
        assert_eq!(sums[4..8], [2.0, 20.0, 6.0, 60.0]);
        assert_eq!(sums[8..], [1.0, 10.0, 2.0, 20.0]);
        assert!(by.sums(&[1.0], &[1.0; 3]).is_err());
        assert!(ByValue { count: 2, ..by }.sums(&[1.0; 3], &[1.0; 3]).is_err());
        assert_eq!(by.sums(&[1.0; 3], &[])?, [0.0; 0]);
        Ok(())
    }

    #[test]
    fn local_errors_have_several_values_and_some_beside_them() {
        let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let errors = [(2.0, 2.0), (0.0, 2.0), (2.0, 1.0)];
        assert_eq!(inside(&values, &errors, None), [true, false, false]);
        // Round the circle of six there are values on each side of 0, too.
        assert_eq!(inside(&values, &errors, Some(6.0)), [true, true, false]);
    }
}
