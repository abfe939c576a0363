//! Decimal numbers as they are written: `43000`, `70.`, `.10`, `-0.5`.

use std::fmt;

use crate::{Error, Result};

/// A decimal number that keeps its spelling: `F.1`, `F0.1` and `F.10` have one value and three
/// spellings, and `70` and `70.` differ by a factor of a thousand on some controls.
///
/// At most 15 digits, so that [`Number::value`] is the double nearest to what is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Number {
    digits: u64,
    sign: Sign,
    whole: u8,
    decimals: u8,
    point: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Sign {
    None,
    Plus,
    Minus,
}

/// How many digits a number may have.
const MAX_DIGITS: u8 = 15;

impl Number {
    /// Reads the number at the head of `text`; returns it with the count of bytes it took.
    /// `None` if no number starts there or if it has more than 15 digits.
    #[must_use]
    pub fn read(text: &str) -> Option<(Self, usize)> {
        let bytes = text.as_bytes();
        let (sign, mut at) = match bytes.first() {
            Some(b'+') => (Sign::Plus, 1),
            Some(b'-') => (Sign::Minus, 1),
            _ => (Sign::None, 0),
        };
        let (mut digits, mut whole, mut decimals, mut point) = (0_u64, 0_u8, 0_u8, false);
        while let Some(&byte) = bytes.get(at) {
            match byte {
                b'0'..=b'9' => {
                    if whole + decimals == MAX_DIGITS {
                        return None;
                    }
                    digits = digits * 10 + u64::from(byte - b'0');
                    if point { decimals += 1 } else { whole += 1 }
                }
                b'.' if !point => point = true,
                _ => break,
            }
            at += 1;
        }
        (whole + decimals > 0).then_some((Self { digits, sign, whole, decimals, point }, at))
    }

    /// A whole number with at least `width` digits: `(1, 2)` is `01`. No point.
    ///
    /// # Errors
    /// [`Error::Input`] if it is not a whole number of at most 15 digits.
    pub fn whole(value: f64, width: u8) -> Result<Self> {
        if value.fract() != 0.0 {
            return Err(Error::input("number", value, "a whole number"));
        }
        Self::rounded(value, 0).map(|number| Self { whole: number.whole.max(width), ..number })
    }

    /// The decimal nearest to `value` with at most `decimals` places; trailing zeros and the point
    /// of whole numbers are left out. Halves go away from zero; zero has no sign.
    ///
    /// # Errors
    /// [`Error::Input`] if `value` is not finite or needs more than 15 digits.
    pub fn rounded(value: f64, decimals: u8) -> Result<Self> {
        let scaled = (value.abs() * 10_f64.powi(i32::from(decimals))).round();
        if decimals > 9 || !scaled.is_finite() || scaled >= 1e15 {
            let expected = "a finite number of at most 15 digits, at most 9 of them decimals";
            return Err(Error::input("number", value, expected));
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked just above
        let (mut digits, mut decimals) = (scaled as u64, decimals);
        while decimals > 0 && digits.is_multiple_of(10) {
            digits /= 10;
            decimals -= 1;
        }
        let mut whole = 1;
        let mut rest = digits / 10_u64.pow(u32::from(decimals)) / 10;
        while rest > 0 {
            whole += 1;
            rest /= 10;
        }
        let sign = if value < 0.0 && digits > 0 { Sign::Minus } else { Sign::None };
        Ok(Self { digits, sign, whole, decimals, point: decimals > 0 })
    }

    /// The same number with a decimal point: `70.` for `70`.
    #[must_use]
    pub fn with_point(self) -> Self {
        Self { point: true, ..self }
    }

    /// The same number without a lone zero before the point: `.1` for `0.1`.
    #[must_use]
    pub fn without_leading_zero(self) -> Self {
        let below_one = self.digits < 10_u64.pow(u32::from(self.decimals));
        if below_one && self.decimals > 0 { Self { whole: 0, ..self } } else { self }
    }

    /// The double nearest to what is written.
    #[must_use]
    pub fn value(self) -> f64 {
        #[allow(clippy::cast_precision_loss)] // at most 15 digits
        let magnitude = self.digits as f64 / 10_f64.powi(i32::from(self.decimals));
        if self.sign == Sign::Minus { -magnitude } else { magnitude }
    }

    /// Is there a decimal point?
    #[must_use]
    pub fn has_point(self) -> bool {
        self.point
    }

    /// How many digits stand before the point.
    #[must_use]
    pub fn digits_before(self) -> u8 {
        self.whole
    }

    /// How many digits stand after the point.
    #[must_use]
    pub fn decimals(self) -> u8 {
        self.decimals
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sign {
            Sign::None => {}
            Sign::Plus => f.write_str("+")?,
            Sign::Minus => f.write_str("-")?,
        }
        let scale = 10_u64.pow(u32::from(self.decimals));
        if self.whole > 0 {
            write!(f, "{:0width$}", self.digits / scale, width = usize::from(self.whole))?;
        }
        if self.point {
            f.write_str(".")?;
        }
        if self.decimals > 0 {
            write!(f, "{:0width$}", self.digits % scale, width = usize::from(self.decimals))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spelling_survives() {
        for text in ["0", "-0", "70.", ".1", ".10", "0.10", "007", "-12.345", "+3", "00.500"] {
            let (number, length) = Number::read(text).unwrap();
            assert_eq!(length, text.len());
            assert_eq!(number.to_string(), text);
            let value: f64 = text.trim_end_matches('.').parse().unwrap();
            assert_eq!(number.value().to_bits(), value.to_bits(), "{text}");
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in ["", ".", "-", "X1", "1234567890123456", "-.", "+.X"] {
            assert!(Number::read(text).is_none(), "{text}");
        }
        assert_eq!(Number::read("1.2.3").unwrap().1, 3);
    }

    #[test]
    fn rounding_goes_to_the_nearest_decimal() {
        let text = |value, decimals| Number::rounded(value, decimals).unwrap().to_string();
        assert_eq!(text(70.01, 3), "70.01");
        assert_eq!(text(-0.0004, 3), "0");
        assert_eq!(text(-0.0005, 3), "-0.001");
        assert_eq!(text(123_456.0, 3), "123456");
        assert_eq!(Number::rounded(0.1, 3).unwrap().without_leading_zero().to_string(), ".1");
        assert_eq!(Number::rounded(72.0, 3).unwrap().with_point().to_string(), "72.");
        assert_eq!(Number::whole(1.0, 2).unwrap().to_string(), "01");
        assert!(Number::whole(1.5, 2).is_err());
        assert!(Number::rounded(f64::NAN, 3).is_err());
        assert!(Number::rounded(1e13, 3).is_err());
    }
}
