//! From blocks to text.

use std::fmt::Write;

use super::{Block, Dialect, Item, Program};

impl Program {
    /// The program as text, one line a block, in the spelling of its dialect.
    #[must_use]
    pub fn emit(&self) -> String {
        let mut text = String::with_capacity(self.blocks.len() * 24);
        for block in &self.blocks {
            emit_block(block, self.dialect, &mut text);
            text.push('\n');
        }
        text
    }
}

impl Block {
    /// The block as one line of text, without its end.
    #[must_use]
    pub fn emit(&self, dialect: Dialect) -> String {
        let mut text = String::new();
        emit_block(self, dialect, &mut text);
        text
    }
}

fn emit_block(block: &Block, dialect: Dialect, text: &mut String) {
    if block.skip {
        text.push('/');
    }
    let mut previous = None;
    for item in &block.items {
        let letter = match item {
            Item::Word(word) => word.letter,
            _ => ' ',
        };
        if dialect.blank_before(previous) {
            text.push(' ');
        }
        previous = Some(letter);
        match item {
            Item::Word(word) => {
                text.push(word.letter);
                if dialect.blank_within(word.letter) {
                    text.push(' ');
                }
                // Writing to a String does not fail.
                let _ = write!(text, "{}", word.number);
            }
            Item::Comment(comment) => {
                let _ = write!(text, "({comment})");
            }
            Item::Remark(remark) => {
                let _ = write!(text, ";{remark}");
            }
            Item::Percent => text.push('%'),
        }
    }
}
