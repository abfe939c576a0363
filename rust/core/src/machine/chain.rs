//! The kinematic code of ISO 10791-6: `[w C' A' b X Y Z (C) t]`.
//!
//! From the workpiece `w` over the bed `b` to the tool `t`; an axis on the workpiece side has a
//! prime, a spindle that is no positioned axis stands in parentheses before the tool.

use super::Side;
use crate::{Error, Result};

/// Which axes a machine has, in which order, on which side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Code {
    /// Linear axes, from the workpiece to the tool.
    pub linear: Vec<(char, Side)>,
    /// Rotary axes: those of the head from the bed to the spindle, then those of the table from the
    /// bed to the workpiece. In this order their positions are given everywhere.
    pub rotary: Vec<(char, Side)>,
    /// The code in its usual spelling.
    pub text: String,
}

const WHAT: &str = "machine.chain";
const EXAMPLE: &str = "a kinematic code of ISO 10791-6 such as \"[w C' A' b X Y Z (C) t]\"";
/// A third rotary axis would leave the positions for a tool pose undetermined.
const MAX_POSITIONED: usize = 2;

impl Code {
    /// Reads a code. Spaces and the brackets may be missing.
    ///
    /// # Errors
    /// What is no code; a linear axis that is missing, stands twice or is carried by a rotary axis;
    /// more than two rotary axes.
    pub fn parse(code: &str) -> Result<Self> {
        let refuse = |expected: String| Err(Error::input(WHAT, format!("{code:?}"), expected));
        let tokens = tokens(code).ok_or_else(|| {
            Error::input(WHAT, format!("{code:?}"), format!("{EXAMPLE}: from w over b to t"))
        })?;
        let mut axes: Vec<(char, Side)> = Vec::new();
        let mut side = Side::Workpiece;
        for &(letter, is_primed) in &tokens {
            if letter == 'b' {
                side = Side::Tool;
                continue;
            }
            if axes.iter().any(|&(other, _)| other == letter) {
                return refuse(format!("axis {letter} once"));
            }
            if is_primed != (side == Side::Workpiece) {
                let (between, prime) = match side {
                    Side::Workpiece => ("w and b", "with"),
                    Side::Tool => ("b and t", "without"),
                };
                return refuse(format!(
                    "axis {letter} {prime} a prime: it stands between {between}"
                ));
            }
            axes.push((letter, side));
        }
        let is_linear = |letter: char| "XYZ".contains(letter);
        if let Some(missing) = "XYZ".chars().find(|l| !axes.iter().any(|(other, _)| other == l)) {
            return refuse(format!("axis {missing} as well: X, Y and Z are all needed"));
        }
        let outwards = |side: Side| {
            let mut those: Vec<char> =
                axes.iter().filter(|axis| axis.1 == side).map(|axis| axis.0).collect();
            if side == Side::Workpiece {
                those.reverse();
            }
            those
        };
        let mut rotary = Vec::new();
        for side in [Side::Tool, Side::Workpiece] {
            for letter in outwards(side) {
                if !is_linear(letter) {
                    rotary.push((letter, side));
                } else if let Some((carrier, _)) = rotary.iter().find(|axis| axis.1 == side) {
                    return refuse(format!(
                        "linear axes between the bed and the rotary axes: {letter} is carried by \
                         {carrier} and turns with it, so that X, Y, Z are no coordinates of the \
                         machine frame, which all readings and errors are in"
                    ));
                }
            }
        }
        if rotary.len() > MAX_POSITIONED {
            return refuse(format!(
                "at most {MAX_POSITIONED} rotary axes (a spindle stands in parentheses): with more, \
                 a tool pose does not determine the axis positions"
            ));
        }
        let linear = axes.iter().filter(|axis| is_linear(axis.0)).copied().collect();
        let has_spindle = code.contains('(');
        Ok(Self { linear, rotary, text: spelled(&axes, has_spindle) })
    }
}

/// Letters between w and t with their primes, b among them; None where the text is no code.
fn tokens(code: &str) -> Option<Vec<(char, bool)>> {
    let inner = code.trim();
    let inner =
        inner.strip_prefix('[').map_or(inner, |rest| rest.strip_suffix(']').unwrap_or(inner));
    let squeezed: String = inner.chars().filter(|c| !c.is_whitespace()).collect();
    let body = squeezed.strip_prefix('w')?.strip_suffix('t')?;
    let body = ["(C)", "(C1)"].iter().find_map(|s| body.strip_suffix(s)).unwrap_or(body);
    let mut tokens: Vec<(char, bool)> = Vec::new();
    for c in body.chars() {
        match c {
            'b' | 'X' | 'Y' | 'Z' | 'A' | 'B' | 'C' => tokens.push((c, false)),
            '\'' | '’' | '′' => match tokens.last_mut() {
                Some((letter, prime)) if *letter != 'b' && !*prime => *prime = true,
                _ => return None,
            },
            _ => return None,
        }
    }
    (tokens.iter().filter(|token| token.0 == 'b').count() == 1).then_some(tokens)
}

fn spelled(axes: &[(char, Side)], has_spindle: bool) -> String {
    let side = |expected: Side| axes.iter().filter(move |axis| axis.1 == expected);
    let work = side(Side::Workpiece).map(|axis| format!("{}' ", axis.0));
    let tool = side(Side::Tool).map(|axis| format!("{} ", axis.0));
    let spindle = if has_spindle { "(C) " } else { "" };
    format!("[w {}b {}{spindle}t]", work.collect::<String>(), tool.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_say_order_and_side() {
        let code = Code::parse("wC'A′bXYZ(C)t").unwrap();
        assert_eq!(code.text, "[w C' A' b X Y Z (C) t]");
        assert_eq!(code.rotary, [('A', Side::Workpiece), ('C', Side::Workpiece)]);
        let code = Code::parse("[w C' X' b Z Y B t]").unwrap();
        assert_eq!(code.rotary, [('B', Side::Tool), ('C', Side::Workpiece)]);
        assert_eq!(code.linear, [('X', Side::Workpiece), ('Z', Side::Tool), ('Y', Side::Tool)]);
    }

    #[test]
    fn what_is_no_machine_is_refused_with_the_reason() {
        for (code, reason) in [
            ("", "ISO 10791-6"),
            ("[w C' A' X Y Z t]", "from w over b to t"),
            ("[w C A' b X Y Z t]", "axis C with a prime"),
            ("[w C' b X Y Z B' t]", "axis B without a prime"),
            ("[w C' A' b X Y t]", "axis Z as well"),
            ("[w C' A' b X Y Z X t]", "axis X once"),
            ("[w X' C' b Y Z t]", "X is carried by C"),
            ("[w X' b Y C B Z t]", "Z is carried by C"),
            ("[w C' A' b X Y Z B t]", "at most 2 rotary axes"),
            ("[w C' A' b X Y Z (C t]", "ISO 10791-6"),
        ] {
            let message = Code::parse(code).unwrap_err().to_string();
            assert!(message.contains(reason), "{code}: {message}");
        }
    }
}
