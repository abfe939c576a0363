//! The part program of a probe path.

use super::geometry::Point;
use super::probe_path::{ProbeMove, ProbePath};
use crate::nc::{Block, Dialect, Program, Word};
use crate::{Error, Result};

/// How the probe program is written.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramOptions {
    /// Dialect.
    pub dialect: Dialect,
    /// Measuring feed, as the dialect counts it; none writes no F (as in Fig. 12).
    pub feed: Option<f64>,
    /// Number of the first block; none writes no numbers.
    pub first_number: Option<u32>,
    /// Comments before everything else.
    pub comments: Vec<String>,
    /// Blocks before: `(letter, value)` words.
    pub head: Vec<Vec<(char, f64)>>,
    /// Blocks behind.
    pub tail: Vec<Vec<(char, f64)>>,
    /// Draw the probe back behind the last interval (Fig. 12 leaves it to what follows).
    pub retract_last: bool,
}

impl ProbePath {
    /// The program of the path: X in diameters, words that do not change left out.
    ///
    /// The first block goes to the place above the first interval by both axes at once, as in
    /// Fig. 12: the probe has to stand free before.
    ///
    /// # Errors
    /// [`Error::Data`] if nothing can be measured; [`Error::Input`] for words the dialect cannot
    /// write.
    pub fn program(&self, options: &ProgramOptions) -> Result<Program> {
        let Some(first) = self.moves.first() else {
            return Err(Error::Data(
                "no line of this profile can be measured; expected one at least".into(),
            ));
        };
        let dialect = options.dialect;
        let mut writer = Writer::numbered(dialect, options.first_number);
        for comment in &options.comments {
            writer.program.push_comment(comment)?;
        }
        for words in &options.head {
            writer.words(words)?;
        }
        let x = |p: Point| dialect.length(2.0 * p[1]);
        let z = |p: Point| dialect.length(p[0]);
        let mut last = (x(first.to)?, z(first.to)?);
        let mut rapid = true;
        writer.block(vec![
            dialect.word('G', 0.0)?,
            Word::new('X', last.0),
            Word::new('Z', last.1),
        ])?;
        let mut feed = options.feed;
        let mut ends: Vec<ProbeMove> = self.moves.iter().skip(1).copied().collect();
        if options.retract_last
            && let (Some(last), Some(up)) =
                (self.moves.last(), self.moves.iter().map(|m| m.from[1]).reduce(f64::max))
        {
            ends.push(ProbeMove {
                from: last.to,
                to: [last.to[0], up],
                feed: false,
                measures: false,
                ..*last
            });
        }
        for m in &ends {
            let mut words = Vec::with_capacity(4);
            if rapid == m.feed {
                words.push(dialect.word('G', if m.feed { 1.0 } else { 0.0 })?);
                rapid = !m.feed;
            }
            let next = (x(m.to)?, z(m.to)?);
            if next.0 != last.0 {
                words.push(Word::new('X', next.0));
            }
            if next.1 != last.1 {
                words.push(Word::new('Z', next.1));
            }
            last = next;
            if m.feed
                && let Some(value) = feed.take()
            {
                words.push(dialect.word('F', value)?);
            }
            writer.block(words)?;
        }
        for words in &options.tail {
            writer.words(words)?;
        }
        Ok(writer.program)
    }
}

/// Appends numbered blocks.
pub(super) struct Writer {
    pub(super) program: Program,
    number: Option<u32>,
}

impl Writer {
    pub(super) fn numbered(dialect: Dialect, first: Option<u32>) -> Self {
        Self { program: Program::new(dialect), number: first }
    }

    pub(super) fn words(&mut self, words: &[(char, f64)]) -> Result<()> {
        let dialect = self.program.dialect;
        let words = words.iter().map(|&(l, v)| dialect.word(l, v)).collect::<Result<Vec<_>>>()?;
        self.block(words)
    }

    pub(super) fn block(&mut self, mut words: Vec<Word>) -> Result<()> {
        if words.is_empty() {
            return Ok(());
        }
        if let Some(number) = self.number {
            words.insert(0, self.program.dialect.word('N', f64::from(number))?);
            self.number = Some(number + 1);
        }
        self.program.append(Block::of(words));
        Ok(())
    }
}
