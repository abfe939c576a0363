//! Long arrays in pieces that copies have in common until one of them changes.

use std::ops::Range;
use std::sync::Arc;

/// Numbers of a piece.
const PIECE: usize = 256;

/// An array in pieces.
#[derive(Clone, Debug)]
pub struct Pieces<T> {
    of: Vec<Arc<Vec<T>>>,
    len: usize,
}

impl<T> Default for Pieces<T> {
    fn default() -> Self {
        Self { of: Vec::new(), len: 0 }
    }
}

impl<T: Copy> From<&[T]> for Pieces<T> {
    fn from(values: &[T]) -> Self {
        let of = values.chunks(PIECE).map(|some| Arc::new(some.to_vec())).collect();
        Self { of, len: values.len() }
    }
}

impl<T: Copy> Pieces<T> {
    /// Count of the numbers.
    pub const fn len(&self) -> usize {
        self.len
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.of.iter().flat_map(|piece| piece.iter())
    }

    /// One of them.
    pub fn at(&self, i: usize) -> T {
        self.of[i / PIECE][i % PIECE]
    }

    /// Copies those from `first` on.
    pub fn copy_to(&self, mut first: usize, mut out: &mut [T]) {
        while !out.is_empty() {
            let own = &self.of[first / PIECE][first % PIECE..];
            let count = own.len().min(out.len());
            let (now, rest) = out.split_at_mut(count);
            now.copy_from_slice(&own[..count]);
            (first, out) = (first + count, rest);
        }
    }

    /// Changes some: those of one piece after the other, each with the number of its first.
    pub fn change(&mut self, some: Range<usize>, mut change: impl FnMut(usize, &mut [T])) {
        let mut first = some.start;
        while first < some.end {
            let (piece, skipped) = (first / PIECE, first % PIECE);
            let end = some.end.min((piece + 1) * PIECE);
            let own = Arc::make_mut(&mut self.of[piece]);
            change(first, &mut own[skipped..skipped + end - first]);
            first = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_that_changes_leaves_the_others_as_they_are() {
        let values: Vec<usize> = (0..2 * PIECE + 3).collect();
        let before = Pieces::from(&values[..]);
        let mut after = before.clone();
        after.change(PIECE - 2..PIECE + 2, |first, own| {
            own.iter_mut().enumerate().for_each(|(i, x)| *x = 10 * (first + i));
        });
        assert!(before.iter().copied().eq(0..before.len()));
        let mut some = [0; 6];
        after.copy_to(PIECE - 3, &mut some);
        let n = PIECE;
        assert_eq!(some, [n - 3, 10 * (n - 2), 10 * (n - 1), 10 * n, 10 * (n + 1), n + 2]);
        assert_eq!((after.at(n), after.len()), (10 * n, 2 * n + 3));
        // What did not change is not copied.
        assert!(Arc::ptr_eq(&before.of[2], &after.of[2]));
    }
}
