//! Spelling and meaning of words, one control at a time.

use std::fmt;
use std::str::FromStr;

use super::{Number, Word};
use crate::units::UM;
use crate::{Error, Result};

/// A way to write and read programs.
///
/// | | lengths | X | spelling |
/// |---|---|---|---|
/// | `paper-um` | whole numbers, 0.001 mm | diameter | `N0003 G00 X 43000 Z 230000` |
/// | `linuxcnc` | mm | as it is | `G1 X12.5 Y3.0 F600.0` |
/// | `linuxcnc-lathe` | mm | diameter under G7, radius under G8 | `G1 X70.01 Z45.714` |
/// | `fanuc-lathe` | mm with a point, 0.001 mm without | diameter | `N0009 X70.01Z45.714` |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dialect {
    /// Integers in µm, the format of Figs. 12 and 14 of Park and Park (1990).
    PaperUm,
    /// LinuxCNC, milling machine.
    LinuxcncMill,
    /// LinuxCNC, lathe.
    LinuxcncLathe,
    /// Fanuc lathe, G-code system A.
    FanucLathe,
}

/// What the number behind a letter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Codes, labels, counts: no unit.
    Code,
    /// mm.
    Length,
    /// degrees.
    Angle,
    /// Feeds, speeds, times.
    Rate,
}

impl Dialect {
    /// Every dialect.
    pub const ALL: [Self; 4] =
        [Self::PaperUm, Self::LinuxcncMill, Self::LinuxcncLathe, Self::FanucLathe];

    /// The name used in files and calls.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PaperUm => "paper-um",
            Self::LinuxcncMill => "linuxcnc",
            Self::LinuxcncLathe => "linuxcnc-lathe",
            Self::FanucLathe => "fanuc-lathe",
        }
    }

    /// Does it speak of a lathe: moves in the ZX plane?
    #[must_use]
    pub const fn is_lathe(self) -> bool {
        !matches!(self, Self::LinuxcncMill)
    }

    /// Decimals of a length or an angle that is written anew: 0.1 µm and 0.36" on a mill, 1 µm on a
    /// lathe.
    #[must_use]
    pub const fn decimals(self) -> u8 {
        if matches!(self, Self::LinuxcncMill) { 4 } else { 3 }
    }

    const fn kind(self, letter: char) -> Kind {
        match letter {
            'A' | 'B' | 'C' if matches!(self, Self::LinuxcncMill) => Kind::Angle,
            'X' | 'Y' | 'Z' | 'U' | 'V' | 'W' | 'I' | 'J' | 'K' | 'R' => Kind::Length,
            'F' | 'S' => Kind::Rate,
            _ => Kind::Code,
        }
    }

    /// The length that a number stands for, mm (before inches and diameters are seen to).
    #[must_use]
    pub fn length_mm(self, number: Number) -> f64 {
        match self {
            Self::PaperUm => number.value() * UM,
            Self::FanucLathe if !number.has_point() => number.value() * UM,
            _ => number.value(),
        }
    }

    /// A length in mm, rounded to the least unit and spelled as in this dialect.
    ///
    /// # Errors
    /// [`Error::Input`] if the number cannot be written.
    pub fn length(self, mm: f64) -> Result<Number> {
        self.spelled(mm, self.decimals())
    }

    /// The number that the control reads as `value` of its own length units, to `decimals` places
    /// (whole µm where lengths are whole numbers).
    ///
    /// # Errors
    /// [`Error::Input`] if the number cannot be written.
    pub fn spelled(self, value: f64, decimals: u8) -> Result<Number> {
        match self {
            Self::PaperUm => Number::whole((value / UM).round(), 1),
            _ => Number::rounded(value, decimals).map(Number::with_point),
        }
    }

    /// A word spelled as in this dialect. Lengths are in mm, angles in degrees, feeds and speeds as
    /// the control counts them; `G`, `M`, `N`, `T` and the rest are codes.
    ///
    /// # Errors
    /// [`Error::Input`] for a letter outside A to Z or a value that cannot be written.
    pub fn word(self, letter: char, value: f64) -> Result<Word> {
        if !letter.is_ascii_uppercase() {
            return Err(Error::input("address", format!("{letter:?}"), "a letter from A to Z"));
        }
        let number = match self.kind(letter) {
            Kind::Length => self.length(value)?,
            Kind::Angle => Number::rounded(value, self.decimals())?.with_point(),
            Kind::Rate => Number::rounded(value, 4)?,
            Kind::Code if value.fract() != 0.0 => Number::rounded(value, 4)?,
            Kind::Code => Number::whole(value, self.code_digits(letter))?,
        };
        Ok(Word::new(letter, number))
    }

    const fn code_digits(self, letter: char) -> u8 {
        match (self, letter) {
            (Self::PaperUm | Self::FanucLathe, 'N') => 4,
            (Self::FanucLathe, 'T' | 'O') => 4,
            (Self::PaperUm, 'G') => 2,
            _ => 1,
        }
    }

    /// What stands before a word: nothing, or a blank. `first` is the first item of the block.
    pub(super) const fn blank_before(self, previous: Option<char>) -> bool {
        match (self, previous) {
            (_, None) => false,
            (Self::FanucLathe, Some(letter)) => letter == 'N',
            _ => true,
        }
    }

    /// Does a blank stand between a letter and its number, as in `X 43000`?
    pub(super) fn blank_within(self, letter: char) -> bool {
        self == Self::PaperUm && self.kind(letter) == Kind::Length
    }
}

impl fmt::Display for Dialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Dialect {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|dialect| dialect.name() == name)
            .ok_or_else(|| Error::unknown("dialect", name, Self::ALL.map(Self::name)))
    }
}
