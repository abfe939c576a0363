//! The finishing contour that a roughing or finishing cycle names.

use std::ops::Range;

use super::{Program, Word};
use crate::Result;

/// The blocks of the finishing contour named by the first `G70`, `G71`, `G72` or `G73 P.. Q..`, both
/// ends included; `None` if the program has no such cycle.
///
/// # Errors
/// [`crate::Error::Program`] if P or Q is missing or no block has that number.
pub fn contour_blocks(program: &Program) -> Result<Option<Range<usize>>> {
    for block in &program.blocks {
        let cycle = block.words().find(|w| w.letter == 'G' && is_contour_cycle(code(w)));
        let (Some(cycle), true) = (cycle, block.word('P').is_some() || block.word('Q').is_some())
        else {
            continue;
        };
        let find = |letter: char| {
            let word = block.word(letter).ok_or_else(|| {
                cycle.span.error(format!("contour cycle without {letter}; expected P and Q"))
            })?;
            program
                .blocks
                .iter()
                .position(|b| {
                    b.word('N').is_some_and(|n| same(n.number.value(), word.number.value()))
                })
                .ok_or_else(|| {
                    let message =
                        format!("no block N{}; expected an end of the contour", word.number);
                    word.span.error(message)
                })
        };
        let (first, last) = (find('P')?, find('Q')?);
        if last < first {
            return Err(cycle
                .span
                .error("the contour ends before it begins; expected N of P first"));
        }
        return Ok(Some(first..last + 1));
    }
    Ok(None)
}

pub(super) fn same(left: f64, right: f64) -> bool {
    left.to_bits() == right.to_bits()
}

/// A G code times ten: 382 for G38.2; `u32::MAX` for anything that is no such number.
pub(super) fn code(word: &Word) -> u32 {
    let tenths = (word.number.value() * 10.0).round();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // bounded here
    if (0.0..1e6).contains(&tenths) && word.number.decimals() <= 1 {
        tenths as u32
    } else {
        u32::MAX
    }
}

pub(super) const fn is_contour_cycle(code: u32) -> bool {
    matches!(code, 700 | 710 | 720 | 730)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nc::Dialect;
    use crate::nc::follow::{moves, moves_of};
    use crate::nc::path::{Position, Start};

    #[test]
    fn the_finishing_contour_of_a_cycle_is_found() {
        let text = "G0X60.Z2.\nG71U1.5R.5\nG71P10Q20U.4W.1F.3\nN10G0X20.\nG1Z-10.F.1\nN20X50.Z-20.\nG70P10Q20\n";
        let program = Program::parse(text, Dialect::FanucLathe).unwrap();
        let blocks = contour_blocks(&program).unwrap().unwrap();
        assert_eq!(blocks, 3..6);
        let path = moves_of(&program, blocks, &Start::default()).unwrap();
        let xz = |p: &Position| [p.axes[0], p.axes[2]];
        assert_eq!(xz(&path.start), [30.0, 2.0]);
        assert_eq!(path.moves.len(), 3);
        assert_eq!(xz(&path.moves[2].to), [25.0, -20.0]);
        assert!(moves(&program, &Start::default()).is_err());
    }
}
