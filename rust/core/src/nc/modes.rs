//! The modes in force, and what words mean under them.

use super::contour::same;
use super::path::{FeedMode, Plane, Side, Spelling, Start};
use super::{Block, Dialect, Word};
use crate::Result;
use crate::units::INCH;

/// Motion codes: what G 0, 1, 2, 3, 38.n set.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Rapid,
    Feed,
    Clockwise,
    CounterClockwise,
    Probe,
}

/// The modes in force.
pub(super) struct Modes<'a> {
    pub dialect: Dialect,
    start: &'a Start,
    pub mode: Option<Mode>,
    pub plane: Plane,
    unit_mm: f64,
    pub diameter: bool,
    pub incremental: bool,
    pub centre_absolute: bool,
    pub feed: Option<f64>,
    pub feed_mode: FeedMode,
    pub side: Side,
}

impl<'a> Modes<'a> {
    /// Those of a control that has just been switched on.
    pub(super) fn new(dialect: Dialect, start: &'a Start) -> Self {
        Self {
            dialect,
            start,
            mode: None,
            plane: if dialect.is_lathe() { Plane::Zx } else { Plane::Xy },
            unit_mm: 1.0,
            diameter: matches!(dialect, Dialect::PaperUm | Dialect::FanucLathe),
            incremental: false,
            centre_absolute: false,
            feed: start.feed,
            feed_mode: match dialect {
                Dialect::PaperUm | Dialect::FanucLathe => FeedMode::PerRevolution,
                _ => FeedMode::PerMinute,
            },
            side: Side::On,
        }
    }

    pub(super) fn is_linuxcnc(&self) -> bool {
        matches!(self.dialect, Dialect::LinuxcncMill | Dialect::LinuxcncLathe)
    }

    pub(super) fn is_machine_code(&self, word: &Word) -> bool {
        let value = word.number.value();
        self.start.machine_codes.iter().any(|&(l, code)| l == word.letter && same(code, value))
    }

    /// Codes that set a mode. True for those that take P, Q, R, S or D words of their own.
    pub(super) fn modal(&mut self, code: u32, word: &Word, block: &Block) -> Result<bool> {
        let linuxcnc = self.is_linuxcnc();
        match code {
            40 => return Ok(true),
            70 if linuxcnc => self.diameter = true,
            80 if linuxcnc => self.diameter = false,
            170 if !self.dialect.is_lathe() => self.plane = Plane::Xy,
            180 => self.plane = Plane::Zx,
            190 if !self.dialect.is_lathe() => self.plane = Plane::Yz,
            200 => self.unit_mm = INCH,
            210 => self.unit_mm = 1.0,
            400 => self.side = Side::On,
            410 => self.side = Side::Left,
            420 => self.side = Side::Right,
            // Tool length and work coordinates shift the origin as a whole: the part's own
            // coordinates, which is what the program holds, stay the same.
            430 | 490 if linuxcnc => {}
            540..=590 => {}
            500 if self.dialect == Dialect::FanucLathe && block.word('S').is_some() => {}
            610 | 611 | 800 => {}
            640 => return Ok(linuxcnc),
            900 if linuxcnc => self.incremental = false,
            910 if linuxcnc => self.incremental = true,
            901 if linuxcnc => self.centre_absolute = true,
            911 if linuxcnc => self.centre_absolute = false,
            930 if linuxcnc => self.set_feed_mode(FeedMode::InverseTime),
            940 if linuxcnc => self.set_feed_mode(FeedMode::PerMinute),
            950 if linuxcnc => self.set_feed_mode(FeedMode::PerRevolution),
            980 if !linuxcnc => self.set_feed_mode(FeedMode::PerMinute),
            990 if !linuxcnc => self.set_feed_mode(FeedMode::PerRevolution),
            960 | 970 => {}
            _ => {
                return Err(word.span.error(format!(
                    "G{} is not known in dialect {}; expected a code that can be followed, or this one \
                     among the machine's codes that move nothing",
                    word.number, self.dialect
                )));
            }
        }
        Ok(false)
    }

    /// A feed counted in one way is none in another.
    fn set_feed_mode(&mut self, mode: FeedMode) {
        if mode != self.feed_mode {
            self.feed = self.start.feed;
        }
        self.feed_mode = mode;
    }

    /// F, and every letter that has no business here.
    pub(super) fn other_words(&mut self, block: &Block, takes_parameters: bool) -> Result<()> {
        let arc = matches!(self.mode, Some(Mode::Clockwise | Mode::CounterClockwise));
        for word in block.words() {
            let allowed = match word.letter {
                'G' | 'N' | 'S' | 'T' => true,
                'M' => self.no_call(word)?,
                'F' => {
                    self.feed = Some(self.feed_of(word)?);
                    true
                }
                'O' => self.dialect == Dialect::FanucLathe,
                'P' | 'Q' => takes_parameters,
                'D' => self.is_linuxcnc() && (block.has('G', 96.0) || self.side != Side::On),
                'H' => self.dialect == Dialect::LinuxcncMill && block.has('G', 43.0),
                'I' | 'J' | 'K' | 'R' => arc && !(word.letter == 'J' && self.dialect.is_lathe()),
                letter => {
                    axis_of(self.dialect, letter).is_some()
                        || (matches!(letter, 'X' | 'U') && takes_parameters)
                }
            };
            if !allowed && !self.is_machine_code(word) {
                return Err(word.span.error(format!(
                    "{}{} has no meaning here in dialect {}; expected an axis, a feed or a known code",
                    word.letter, word.number, self.dialect
                )));
            }
        }
        Ok(())
    }

    /// M98, M99 and the like leave the program: they cannot be followed.
    fn no_call(&self, word: &Word) -> Result<bool> {
        let calls = [96.0, 97.0, 98.0, 99.0].iter().any(|&call| same(call, word.number.value()));
        if calls {
            return Err(word
                .span
                .error("subprograms are not followed; expected the blocks themselves"));
        }
        Ok(true)
    }

    fn feed_of(&self, word: &Word) -> Result<f64> {
        let value = word.number.value();
        let bare = !word.number.has_point() && self.dialect == Dialect::FanucLathe;
        if bare && self.feed_mode == FeedMode::PerRevolution {
            return Err(word.span.error(
                "feed per revolution without a decimal point: how it counts is a parameter of the \
                 control; expected a point",
            ));
        }
        if value <= 0.0 {
            return Err(word.span.error(format!("feed {}; expected more than zero", word.number)));
        }
        Ok(if self.feed_mode == FeedMode::InverseTime { value } else { value * self.unit_mm })
    }

    /// A length word in mm; diameters not yet halved.
    pub(super) fn length(&self, word: &Word) -> f64 {
        let mm = self.dialect.length_mm(word.number);
        // Without a point, an inch program of a Fanuc control counts 0.0001 inch.
        let bare = self.dialect == Dialect::FanucLathe && !word.number.has_point();
        if bare && self.unit_mm > 1.0 { mm * self.unit_mm * 0.1 } else { mm * self.unit_mm }
    }

    pub(super) fn spelling(&self, block: &Block) -> Spelling {
        let increments = block.words().any(|word| {
            axis_of(self.dialect, word.letter).is_some_and(|(_, by_increment)| by_increment)
        });
        Spelling {
            diameter: self.diameter,
            unit_mm: self.unit_mm,
            incremental: self.incremental || increments,
            centre_absolute: self.centre_absolute,
        }
    }
}

/// The axis that a letter moves, and whether the letter itself means an increment.
pub(super) fn axis_of(dialect: Dialect, letter: char) -> Option<(usize, bool)> {
    match (dialect, letter) {
        (_, 'X') => Some((0, false)),
        (_, 'Z') => Some((2, false)),
        (Dialect::LinuxcncMill, 'Y') => Some((1, false)),
        (Dialect::LinuxcncMill, 'A') => Some((3, false)),
        (Dialect::LinuxcncMill, 'B') => Some((4, false)),
        (Dialect::LinuxcncMill, 'C') => Some((5, false)),
        (Dialect::FanucLathe, 'U') => Some((0, true)),
        (Dialect::FanucLathe, 'W') => Some((2, true)),
        _ => None,
    }
}
