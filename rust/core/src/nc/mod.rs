//! Part programs of numerical controls: blocks of words, read and written.
//!
//! A [`Program`] is what stands on the paper: blocks, each a row of words (`X70.01`) and comments,
//! in the order and the spelling in which they were written. [`Program::parse`] is the inverse of
//! [`Program::emit`]: numbers keep their written digits ([`Number`]), so a block that nobody touched
//! comes back as it was, up to blanks. What the words *mean* (modes, moves) is read by [`follow`],
//! one dialect at a time ([`Dialect`]).
//!
//! ```
//! use trunnion_core::nc::{Dialect, Program};
//!
//! let program = Program::parse("N0009 X70.01Z45.714 (ramp)\n", Dialect::FanucLathe)?;
//! assert_eq!(program.blocks[0].number('Z'), Some(45.714));
//! assert_eq!(program.emit(), "N0009 X70.01Z45.714(ramp)\n");
//! # Ok::<(), trunnion_core::Error>(())
//! ```

pub mod contour;
mod dialect;
mod emit;
pub mod follow;
mod modes;
mod number;
mod parse;
pub mod path;

pub use dialect::Dialect;
pub use number::Number;

use crate::{Error, Result};

/// Where a word stands in its file; for a program that was made, the line it will have there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Span {
    /// Line, from 1.
    pub line: u32,
    /// Column of the first character, from 1, counted in characters.
    pub column: u32,
}

impl Span {
    /// An [`Error::Program`] at this place.
    pub fn error(self, message: impl Into<String>) -> Error {
        Error::Program {
            line: self.line as usize,
            column: self.column as usize,
            message: message.into(),
        }
    }
}

/// A letter and its number. Two words are equal if they are spelled alike, wherever they stand.
#[derive(Clone, Copy, Debug)]
pub struct Word {
    /// Address, `A` to `Z`.
    pub letter: char,
    /// The number as written.
    pub number: Number,
    /// Where it was read.
    pub span: Span,
}

impl PartialEq for Word {
    fn eq(&self, other: &Self) -> bool {
        self.letter == other.letter && self.number == other.number
    }
}

impl Word {
    /// A word that was made, not read.
    #[must_use]
    pub fn new(letter: char, number: Number) -> Self {
        Self { letter, number, span: Span::default() }
    }
}

/// What a block is made of.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A word.
    Word(Word),
    /// `(text)`; active comments of LinuxCNC such as `(PROBEOPEN file.txt)` are among these.
    Comment(String),
    /// `;text` up to the end of the line.
    Remark(String),
    /// `%` at the start or the end of a tape.
    Percent,
}

/// One line of a program. Two blocks are equal if they are spelled alike, wherever they stand.
#[derive(Clone, Debug, Default)]
pub struct Block {
    /// `/`: the operator may switch the block off.
    pub skip: bool,
    /// Words and comments in written order.
    pub items: Vec<Item>,
    /// Where the block was read.
    pub span: Span,
}

impl PartialEq for Block {
    fn eq(&self, other: &Self) -> bool {
        self.skip == other.skip && self.items == other.items
    }
}

impl Block {
    /// A block of these words.
    #[must_use]
    pub fn of(words: impl IntoIterator<Item = Word>) -> Self {
        Self { items: words.into_iter().map(Item::Word).collect(), ..Self::default() }
    }

    /// A block that is one `(comment)`.
    ///
    /// # Errors
    /// [`Error::Input`] if the text cannot stand between parentheses on one line.
    pub fn comment(text: &str) -> Result<Self> {
        if text.contains(['(', ')', '\n', '\r']) {
            return Err(Error::input("comment", format!("{text:?}"), "one line, no parentheses"));
        }
        Ok(Self { items: vec![Item::Comment(text.to_owned())], ..Self::default() })
    }

    /// The words in written order.
    pub fn words(&self) -> impl Iterator<Item = &Word> {
        self.items.iter().filter_map(|item| match item {
            Item::Word(word) => Some(word),
            _ => None,
        })
    }

    /// The first word with this letter.
    #[must_use]
    pub fn word(&self, letter: char) -> Option<&Word> {
        self.words().find(|word| word.letter == letter)
    }

    /// The number as written of the first word with this letter (without the dialect's meaning:
    /// `X 43000` gives 43000).
    #[must_use]
    pub fn number(&self, letter: char) -> Option<f64> {
        self.word(letter).map(|word| word.number.value())
    }

    /// Puts a number behind a letter: in place of the one there, or as a new word before the first
    /// word of `before`, or at the end.
    pub fn set(&mut self, letter: char, number: Number, before: &[char]) {
        for item in &mut self.items {
            if let Item::Word(word) = item
                && word.letter == letter
            {
                word.number = number;
                return;
            }
        }
        let behind =
            |item: &Item| matches!(item, Item::Word(word) if before.contains(&word.letter));
        let at = self.items.iter().position(behind).unwrap_or(self.items.len());
        self.items.insert(at, Item::Word(Word::new(letter, number)));
    }

    /// Does the block hold this code, `G` 1 for `G1`, `G01`?
    #[must_use]
    pub fn has(&self, letter: char, code: f64) -> bool {
        #[allow(clippy::float_cmp)] // both are the nearest double of a short decimal
        self.words().any(|word| word.letter == letter && word.number.value() == code)
    }
}

/// A program: blocks in order, and the dialect in which they are spelled.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Spelling and meaning.
    pub dialect: Dialect,
    /// One block a line.
    pub blocks: Vec<Block>,
}

impl Program {
    /// An empty program.
    #[must_use]
    pub fn new(dialect: Dialect) -> Self {
        Self { dialect, blocks: Vec::new() }
    }

    /// Appends a block of codes and addresses with values: `('G', 1.0), ('X', 12.5)`, the lengths in
    /// mm and angles in degrees, each spelled as the dialect spells such a word
    /// ([`Dialect::word`]).
    ///
    /// # Errors
    /// [`Error::Input`] for a letter or a value that the dialect cannot write.
    pub fn push(&mut self, words: &[(char, f64)]) -> Result<()> {
        let words = words
            .iter()
            .map(|&(letter, value)| self.dialect.word(letter, value))
            .collect::<Result<Vec<_>>>()?;
        self.append(Block::of(words));
        Ok(())
    }

    /// Appends a `(comment)`.
    ///
    /// # Errors
    /// As [`Block::comment`].
    pub fn push_comment(&mut self, text: &str) -> Result<()> {
        self.append(Block::comment(text)?);
        Ok(())
    }

    /// Appends a block; its words get the line that they will have in the text.
    pub fn append(&mut self, mut block: Block) {
        let line = u32::try_from(self.blocks.len() + 1).unwrap_or(u32::MAX);
        block.span = Span { line, column: 1 };
        for item in &mut block.items {
            if let Item::Word(word) = item {
                word.span = block.span;
            }
        }
        self.blocks.push(block);
    }
}
