//! Touches and planned moves as arrays, one row each.

use nalgebra::Vector3;

use crate::{Error, Result};

/// Owned rows in mm, rad, s.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MoveTable {
    axes: usize,
    rotary: Vec<f64>,
    point: Vec<f64>,
    direction: Vec<f64>,
    feed: Option<Vec<f64>>,
    time: Option<Vec<f64>>,
    sense: Option<Vec<f64>>,
}

impl MoveTable {
    /// Rows in rad, mm, mm/s and s; row-major, `axes` rotary positions a row.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, directions that are not unit vectors (1e-6).
    pub fn new(
        axes: usize,
        rotary: Vec<f64>,
        point: Vec<f64>,
        direction: Vec<f64>,
        feed: Option<Vec<f64>>,
        time: Option<Vec<f64>>,
        sense: Option<Vec<f64>>,
    ) -> Result<Self> {
        let table = Self { axes, rotary, point, direction, feed, time, sense };
        table.view().check(axes)?;
        Ok(table)
    }

    /// The same rows with one rotary axis further by an angle, rad.
    #[must_use]
    pub fn turned(&self, axis: usize, by: f64) -> Self {
        let mut table = self.clone();
        table.rotary.iter_mut().skip(axis).step_by(self.axes.max(1)).for_each(|at| *at += by);
        table
    }

    /// Rotary positions in a row.
    #[must_use]
    pub const fn axes(&self) -> usize {
        self.axes
    }

    /// The rows, borrowed.
    #[must_use]
    pub fn view(&self) -> Moves<'_> {
        Moves {
            rotary: &self.rotary,
            point: &self.point,
            direction: &self.direction,
            feed: self.feed.as_deref(),
            time: self.time.as_deref(),
            sense: self.sense.as_deref(),
        }
    }
}

/// Touches or planned moves, one row each, in mm, rad, s. Borrowed row-major arrays.
#[derive(Clone, Copy, Debug)]
pub struct Moves<'a> {
    /// Commanded positions of the machine's rotary axes, n × number of axes.
    pub rotary: &'a [f64],
    /// A point of the line: the recorded ball centre, or the start of a planned move; n × 3.
    pub point: &'a [f64],
    /// Approach direction, unit vectors, n × 3.
    pub direction: &'a [f64],
    /// Feed of the approach, or nothing.
    pub feed: Option<&'a [f64]>,
    /// Time of each touch by any clock, or nothing.
    pub time: Option<&'a [f64]>,
    /// Sense of the last turn of each axis, n × number of axes, or nothing.
    pub sense: Option<&'a [f64]>,
}

impl Moves<'_> {
    /// Feed of a row's approach, 0 where it is not known.
    #[must_use]
    pub fn feed_at(&self, row: usize) -> f64 {
        self.feed.map_or(0.0, |feed| feed[row])
    }

    /// Time of the first touch, 0 where times are not known.
    #[must_use]
    pub fn first_time(&self) -> f64 {
        self.time.and_then(|time| time.iter().copied().reduce(f64::min)).unwrap_or(0.0)
    }

    /// Time from the first touch to the last, 0 where times are not known.
    #[must_use]
    pub fn span(&self) -> f64 {
        let last = self.time.and_then(|time| time.iter().copied().reduce(f64::max));
        last.map_or(0.0, |last| last - self.first_time())
    }

    /// Number of rows.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.point.len() / 3
    }

    /// Whether there is no row.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.point.is_empty()
    }

    /// Checks lengths, finiteness and unit directions.
    ///
    /// # Errors
    /// The first row that is not as it should be.
    pub fn check(&self, axes: usize) -> Result<()> {
        let n = self.len();
        let lengths = [
            ("rotary positions", Some(self.rotary), axes),
            ("points", Some(self.point), 3),
            ("approach directions", Some(self.direction), 3),
            ("feeds", self.feed, 1),
            ("times", self.time, 1),
            ("senses of turning", self.sense, axes),
        ];
        for (what, values, width) in lengths {
            let Some(values) = values else { continue };
            if values.len() != n * width {
                return Err(Error::input(what, values.len(), format!("{n} rows of {width}")));
            }
            if let Some(i) = values.iter().position(|value| !value.is_finite()) {
                let what = format!("{what}, row {}", i / width);
                return Err(Error::input(what, values[i], "a finite number"));
            }
        }
        for (row, d) in self.direction.chunks_exact(3).enumerate() {
            let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            if (square.sqrt() - 1.0).abs() > 1e-6 {
                let norm = d[0].hypot(d[1]).hypot(d[2]);
                let what = format!("length of the approach direction, row {row}");
                return Err(Error::input(what, norm, "1 within 1e-6"));
            }
        }
        Ok(())
    }

    /// Row of an n × 3 array.
    #[must_use]
    pub fn vector(values: &[f64], row: usize) -> Vector3<f64> {
        Vector3::new(values[3 * row], values[3 * row + 1], values[3 * row + 2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_counts_from_the_first_touch() {
        let table = |time: Option<Vec<f64>>| {
            let direction = vec![0.0, 0.0, -1.0, 0.0, 0.0, -1.0];
            MoveTable::new(0, vec![], vec![0.0; 6], direction, None, time, None).unwrap()
        };
        let later = table(Some(vec![1.7e9 + 40.0, 1.7e9]));
        assert_eq!((later.view().first_time(), later.view().span()), (1.7e9, 40.0));
        assert_eq!((table(None).view().first_time(), table(None).view().span()), (0.0, 0.0));
    }
}
