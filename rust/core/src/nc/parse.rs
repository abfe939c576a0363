//! From text to blocks.

use super::{Block, Dialect, Item, Number, Program, Span, Word};
use crate::Result;

impl Program {
    /// Reads a program. Letters may be small, blanks may stand anywhere between words and numbers.
    ///
    /// # Errors
    /// [`crate::Error::Program`] with line and column for anything that is not a word or a comment:
    /// a letter without a number, a number of more than 15 digits, a comment that does not end, an
    /// address written twice in a block (only `G` and `M` may be), variables and expressions.
    pub fn parse(text: &str, dialect: Dialect) -> Result<Self> {
        let blocks = text
            .lines()
            .zip(1_u32..)
            .map(|(line, number)| Reader::new(line, number).block())
            .collect::<Result<Vec<_>>>()?;
        Ok(Self { dialect, blocks })
    }
}

/// Reads one line.
struct Reader<'a> {
    rest: &'a str,
    span: Span,
}

impl<'a> Reader<'a> {
    fn new(line: &'a str, number: u32) -> Self {
        Self { rest: line.trim_end(), span: Span { line: number, column: 1 } }
    }

    /// Takes the first `bytes` bytes.
    fn take(&mut self, bytes: usize) -> &'a str {
        let (head, rest) = self.rest.split_at(bytes);
        let characters = head.chars().count();
        self.span.column += u32::try_from(characters).unwrap_or(u32::MAX);
        self.rest = rest;
        head
    }

    fn skip_blanks(&mut self) {
        let blanks = self.rest.len() - self.rest.trim_start().len();
        self.take(blanks);
    }

    fn block(mut self) -> Result<Block> {
        let mut block = Block { span: self.span, ..Block::default() };
        let mut seen = 0_u32;
        loop {
            self.skip_blanks();
            let Some(character) = self.rest.chars().next() else { return Ok(block) };
            let span = self.span;
            let item = match character {
                '/' if block.items.is_empty() && !block.skip => {
                    self.take(1);
                    block.skip = true;
                    continue;
                }
                '(' => {
                    let Some(end) = self.rest.find(')') else {
                        return Err(span.error("comment without its closing parenthesis"));
                    };
                    let text = &self.take(end + 1)[1..end];
                    if text.contains('(') {
                        return Err(span.error("comment within a comment"));
                    }
                    Item::Comment(text.to_owned())
                }
                ';' => Item::Remark(self.take(self.rest.len())[1..].to_owned()),
                '%' => {
                    self.take(1);
                    Item::Percent
                }
                'A'..='Z' | 'a'..='z' => {
                    let word = self.word(character.to_ascii_uppercase())?;
                    let bit = 1 << (u32::from(word.letter) - u32::from('A'));
                    if seen & bit != 0 && !matches!(word.letter, 'G' | 'M') {
                        let message =
                            format!("a second {} in one block; expected one", word.letter);
                        return Err(span.error(message));
                    }
                    if word.letter == 'N' && seen != 0 {
                        return Err(
                            span.error("block number behind other words; expected it first")
                        );
                    }
                    seen |= bit;
                    Item::Word(word)
                }
                '#' | '[' | ']' | '=' | '<' => {
                    return Err(span.error(format!(
                        "{character:?}: variables and expressions are not read; expected plain numbers"
                    )));
                }
                ',' => {
                    return Err(span.error(
                        "',': corners by C and R behind a comma are not read; expected G1, G2, G3",
                    ));
                }
                _ => {
                    return Err(span.error(format!(
                        "{character:?}; expected a letter with a number, a comment, '%' or '/' in front"
                    )));
                }
            };
            block.items.push(item);
        }
    }

    fn word(&mut self, letter: char) -> Result<Word> {
        let span = self.span;
        self.take(1);
        self.skip_blanks();
        let Some((number, length)) = Number::read(self.rest) else {
            let got = match self.rest.chars().next() {
                None => "the end of the line".to_owned(),
                Some(character) => format!("{character:?}"),
            };
            return Err(span.error(format!(
                "{letter} without a number: got {got}, expected a decimal number of at most 15 digits"
            )));
        };
        self.take(length);
        Ok(Word { letter, number, span })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    fn place(text: &str) -> (usize, usize) {
        match Program::parse(text, Dialect::LinuxcncMill).unwrap_err() {
            Error::Program { line, column, .. } => (line, column),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn faults_have_line_and_column() {
        assert_eq!(place("G1 X1\nG1 X Y2"), (2, 4));
        assert_eq!(place("G1 X1 X2"), (1, 7));
        assert_eq!(place("(ok)\n\n  (not closed"), (3, 3));
        assert_eq!(place("(a (b) c)"), (1, 1));
        assert_eq!(place("G1 X#5"), (1, 4));
        assert_eq!(place("G1 X[1+2]"), (1, 4));
        assert_eq!(place("G1 X1,R2"), (1, 6));
        assert_eq!(place("G1 X1 N5"), (1, 7));
        assert_eq!(place("G1 X12345678901234567"), (1, 4));
        assert_eq!(place("µ"), (1, 1));
        assert_eq!(place("(é) G1 5"), (1, 8));
    }

    #[test]
    fn parse_is_the_inverse_of_emit() {
        let text = "%\nO0001 (shaft)\n/N0010 g1 x-1.50 z.5 f.10 ; end\n\nG38.2 X1 (PROBEOPEN a b.txt)\n%\n";
        for dialect in Dialect::ALL {
            let program = Program::parse(text, dialect).unwrap();
            assert_eq!(Program::parse(&program.emit(), dialect).unwrap(), program);
        }
    }

    #[test]
    fn a_probing_cycle_is_written_as_linuxcnc_wants_it() {
        let mut program = Program::new(Dialect::LinuxcncMill);
        program.push(&[('G', 21.0), ('G', 90.0)]).unwrap();
        program.push_comment("PROBEOPEN touches.txt").unwrap();
        program.push(&[('G', 0.0), ('A', -90.0), ('C', 45.5)]).unwrap();
        program.push(&[('G', 38.2), ('X', 1.0), ('Y', -0.000_04), ('F', 600.0)]).unwrap();
        program.push_comment("PROBECLOSE").unwrap();
        program.push(&[('M', 2.0)]).unwrap();
        assert_eq!(
            program.emit(),
            "G21 G90\n(PROBEOPEN touches.txt)\nG0 A-90. C45.5\nG38.2 X1. Y0. F600\n(PROBECLOSE)\nM2\n"
        );
    }
}
