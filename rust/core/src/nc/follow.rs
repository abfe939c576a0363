//! Follows a program move by move.
//!
//! [`moves`] follows a program as its control would: distances absolute or incremental, mm or inch,
//! radius or diameter, arcs by centre or radius, feed and nose compensation. A block whose meaning
//! is not known for certain is an error with its line and column, never skipped.

use std::ops::Range;

use super::contour::{code, is_contour_cycle};
use super::modes::{Mode, Modes, axis_of};
use super::path::{AXES, Lead, Motion, Move, Path, Position, Start};
use super::{Block, Dialect, Program, Span, Word};
use crate::Result;

/// Radii at both ends of an arc may differ by this much, mm: what rounding to 0.001 mm, or to
/// 0.0001 inch, can do to the centre and the ends of a flat arc, and no more.
pub const ARC_TOLERANCE_MM: f64 = 0.01;

/// The moves of a whole program, up to M2 or M30.
///
/// # Errors
/// [`Error::Input`] for a start that cannot be, [`Error::Program`] for what cannot be followed: unknown codes and addresses, a feed move
/// without a feed or from a place that is not known, arcs without radius, too small a radius or a
/// centre that does not fit, canned cycles, subprograms, shifts of the origin.
pub fn moves(program: &Program, start: &Start) -> Result<Path> {
    moves_of(program, 0..program.blocks.len(), start)
}

/// The moves of a part of a program, modes taken from the blocks before it.
///
/// With it the finishing contour of a roughing cycle is read ([`contour_blocks`]); cycles before
/// the part are passed over, since they come back to where they started.
///
/// # Errors
/// As [`moves`].
pub fn moves_of(program: &Program, blocks: Range<usize>, start: &Start) -> Result<Path> {
    start.check()?;
    let mut follower = Follower::new(program, start);
    for (index, block) in program.blocks.iter().enumerate().take(blocks.end) {
        follower.inside = blocks.contains(&index);
        follower.block(index, block)?;
        if block.has('M', 2.0) || block.has('M', 30.0) {
            break;
        }
    }
    let start = follower.begin.unwrap_or(follower.position);
    Ok(Path { start, lead: follower.lead, moves: follower.moves })
}

struct Follower<'a> {
    modes: Modes<'a>,
    position: Position,
    known: [bool; 6],
    begin: Option<Position>,
    lead: Option<Lead>,
    inside: bool,
    moves: Vec<Move>,
}

impl<'a> Follower<'a> {
    fn new(program: &Program, start: &'a Start) -> Self {
        let dialect = program.dialect;
        let mut known = [start.position.is_some(); 6];
        if start.position.is_none() {
            let mut named = [false; 6];
            for word in program.blocks.iter().flat_map(Block::words) {
                if let Some((axis, _)) = axis_of(dialect, word.letter) {
                    named[axis] = true;
                }
            }
            known = named.map(|named| !named);
        }
        Self {
            modes: Modes::new(dialect, start),
            position: start.position.unwrap_or_default(),
            known,
            begin: start.position,
            lead: None,
            inside: true,
            moves: Vec::new(),
        }
    }

    fn block(&mut self, index: usize, block: &Block) -> Result<()> {
        if block.skip {
            return Err(block
                .span
                .error("'/': whether this block is cut is the operator's choice"));
        }
        let mut motion: Option<&Word> = None;
        let mut takes_parameters = false;
        for word in block.words().filter(|word| word.letter == 'G') {
            if self.modes.is_machine_code(word) {
                continue;
            }
            let code = code(word);
            if is_contour_cycle(code) && self.modes.dialect == Dialect::FanucLathe {
                return if self.inside && self.moves.is_empty() && block.has('G', 70.0) {
                    Err(word
                        .span
                        .error("G70 repeats a contour; expected that contour to be read itself"))
                } else if self.inside {
                    Err(word
                        .span
                        .error("cycles are not followed; expected the finishing contour alone"))
                } else {
                    Ok(())
                };
            }
            let set = match code {
                0 => Some(Mode::Rapid),
                10 => Some(Mode::Feed),
                20 => Some(Mode::Clockwise),
                30 => Some(Mode::CounterClockwise),
                382..=385 if self.modes.is_linuxcnc() => Some(Mode::Probe),
                _ => None,
            };
            if let Some(set) = set {
                if let Some(other) = motion {
                    return Err(word.span.error(format!(
                        "G{} after G{} in one block; expected one motion",
                        word.number, other.number
                    )));
                }
                motion = Some(word);
                self.modes.mode = Some(set);
            } else {
                takes_parameters |= self.modes.modal(code, word, block)?;
            }
        }
        self.modes.other_words(block, takes_parameters)?;
        if takes_parameters
            && block.words().any(|w| axis_of(self.modes.dialect, w.letter).is_some())
        {
            return Err(block
                .span
                .error("axis words beside a dwell or a setting; expected a block of their own"));
        }
        self.travel(index, block)
    }

    fn travel(&mut self, index: usize, block: &Block) -> Result<()> {
        let mut to = self.position;
        let mut known = self.known;
        let mut named = false;
        for word in block.words() {
            let Some((axis, by_increment)) = axis_of(self.modes.dialect, word.letter) else {
                continue;
            };
            named = true;
            let mut value = if axis < 3 { self.modes.length(word) } else { word.number.value() };
            if axis == 0 && self.modes.diameter {
                value *= 0.5;
            }
            if by_increment || self.modes.incremental {
                if !known[axis] {
                    return Err(word.span.error(format!(
                        "increment {}{} from a place that is not known; expected an absolute move first",
                        word.letter, word.number
                    )));
                }
                value += self.position.axes[axis];
            }
            to.axes[axis] = value;
            known[axis] = true;
        }
        let arc = matches!(self.modes.mode, Some(Mode::Clockwise | Mode::CounterClockwise));
        let centre_words = block.words().find(|w| matches!(w.letter, 'I' | 'J' | 'K' | 'R'));
        if !(named || arc && centre_words.is_some()) {
            return Ok(());
        }
        let place = block.words().find(|w| axis_of(self.modes.dialect, w.letter).is_some());
        let span = place.or(centre_words).map_or(block.span, |word| word.span);
        let Some(mode) = self.modes.mode else {
            return Err(
                span.error("axis words before any of G0, G1, G2, G3; expected a motion first")
            );
        };
        let from = self.position;
        let from_known = self.known.iter().all(|&known| known);
        self.position = to;
        self.known = known;
        let all_known = known.iter().all(|&known| known);
        if mode == Mode::Rapid {
            if !from_known {
                if self.inside && block.word('X').is_some() {
                    self.lead = Some(Lead { block: index, spelling: self.modes.spelling(block) });
                }
                if all_known && self.inside {
                    self.begin = Some(to);
                }
                return Ok(());
            }
        } else if !from_known {
            let axes: String =
                AXES.iter().zip(self.known).filter(|(_, k)| !k).map(|(a, _)| a).collect();
            let which = if axes.is_empty() { String::new() } else { format!(" ({axes})") };
            return Err(span.error(format!(
                "a feed move from a place that is not known{which}; expected G0 to it before, or a start \
                 position"
            )));
        }
        if self.begin.is_none() && self.inside {
            self.begin = Some(from);
        }
        if !self.inside {
            return Ok(());
        }
        let feed = match (mode, self.modes.feed) {
            (Mode::Rapid, _) => 0.0,
            (_, Some(feed)) => feed,
            (_, None) => return Err(span.error("a feed move but no feed; expected F")),
        };
        let motion = match mode {
            Mode::Rapid => Motion::Rapid,
            Mode::Feed => Motion::Feed,
            Mode::Probe => Motion::Probe,
            Mode::Clockwise => self.arc(block, span, &from, &to, true)?,
            Mode::CounterClockwise => self.arc(block, span, &from, &to, false)?,
        };
        if from == to && !arc {
            return Ok(());
        }
        let (feed_mode, side) = (self.modes.feed_mode, self.modes.side);
        let spelling = self.modes.spelling(block);
        self.moves.push(Move {
            motion,
            from,
            to,
            feed,
            feed_mode,
            side,
            spelling,
            block: index,
            span,
        });
        Ok(())
    }

    fn arc(
        &self,
        block: &Block,
        span: Span,
        from: &Position,
        to: &Position,
        clockwise: bool,
    ) -> Result<Motion> {
        let (first, second) = self.modes.plane.axes();
        let start = [from.axes[first], from.axes[second]];
        let end = [to.axes[first], to.axes[second]];
        let letters = ['I', 'J', 'K'];
        let centre_word = |axis: usize| block.word(letters[axis]);
        let strange = (0..3).find(|&a| a != first && a != second && centre_word(a).is_some());
        if let Some(word) = strange.and_then(centre_word) {
            return Err(word.span.error(format!("{} is not in the plane of the arc", word.letter)));
        }
        let words = [centre_word(first), centre_word(second)];
        let centre = match (block.word('R'), words) {
            (Some(word), [None, None]) => {
                radius_centre(start, end, self.modes.length(word), clockwise)
                    .map_err(|m| word.span.error(m))?
            }
            (Some(word), _) => {
                return Err(word
                    .span
                    .error("an arc with R and with its centre; expected one of them"));
            }
            (None, [None, None]) => {
                return Err(
                    span.error("an arc without radius; expected R, or its centre by I, J, K")
                );
            }
            (None, words) => {
                let mut centre = start;
                for (value, word) in centre.iter_mut().zip(words) {
                    if self.modes.centre_absolute {
                        let Some(word) = word else {
                            return Err(span.error("G90.1 wants both coordinates of the centre"));
                        };
                        *value = self.modes.length(word);
                    } else {
                        *value += word.map_or(0.0, |word| self.modes.length(word));
                    }
                }
                let [at_start, at_end] =
                    [start, end].map(|p| (p[0] - centre[0]).hypot(p[1] - centre[1]));
                if at_start == 0.0 || (at_start - at_end).abs() > ARC_TOLERANCE_MM {
                    return Err(span.error(format!(
                        "the arc does not close: radius {at_start:.4} mm at its start, {at_end:.4} mm at \
                         its end; expected the same within {ARC_TOLERANCE_MM} mm"
                    )));
                }
                centre
            }
        };
        Ok(Motion::Arc { plane: self.modes.plane, centre, clockwise })
    }
}

/// Centre of the arc of radius `radius` (negative: the arc of more than half a turn).
fn radius_centre(
    start: [f64; 2],
    end: [f64; 2],
    radius: f64,
    clockwise: bool,
) -> std::result::Result<[f64; 2], String> {
    let chord = [end[0] - start[0], end[1] - start[1]];
    let length = chord[0].hypot(chord[1]);
    if length == 0.0 || radius == 0.0 {
        return Err(
            "an arc by radius needs two places and a radius; a full turn needs I, J, K".into()
        );
    }
    let half = 0.5 * length;
    if half - radius.abs() > ARC_TOLERANCE_MM {
        let radius = radius.abs();
        return Err(format!("radius {radius} mm cannot reach the end, {length:.4} mm away"));
    }
    let height = (radius * radius - half * half).max(0.0).sqrt();
    // The centre lies to the left of a counter-clockwise arc of less than half a turn.
    let side = if clockwise == (radius < 0.0) { 1.0 } else { -1.0 } * height / length;
    Ok([0.5 * (start[0] + end[0]) - chord[1] * side, 0.5 * (start[1] + end[1]) + chord[0] * side])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    fn path(text: &str, dialect: Dialect) -> Result<Path> {
        moves(&Program::parse(text, dialect)?, &Start::default())
    }

    fn fault(text: &str, dialect: Dialect) -> (usize, usize, String) {
        match path(text, dialect).unwrap_err() {
            Error::Program { line, column, message } => (line, column, message),
            other => panic!("{other}"),
        }
    }

    fn xz(position: &Position) -> [f64; 2] {
        [position.axes[0], position.axes[2]]
    }

    #[test]
    fn diameters_are_halved_and_integers_are_micrometres() {
        let program =
            Program::parse("G00 X 43000 Z 230000\nG01 X 41000\n", Dialect::PaperUm).unwrap();
        let start = Start { feed: Some(0.1), ..Start::default() };
        let path = moves(&program, &start).unwrap();
        assert_eq!(xz(&path.start), [21.5, 230.0]);
        assert_eq!(xz(&path.moves[0].to), [20.5, 230.0]);

        let fanuc = path_of("G0 X40. Z10000\nG1 U-2. W-1. F.1\n", Dialect::FanucLathe);
        assert_eq!(xz(&fanuc.start), [20.0, 10.0]);
        assert_eq!(xz(&fanuc.moves[0].to), [19.0, 9.0]);

        let inch = path_of("G20 G8 G0 X1 Z0\nG7 G1 X1 Z0 F1\n", Dialect::LinuxcncLathe);
        assert_eq!(xz(&inch.start), [25.4, 0.0]);
        assert_eq!(xz(&inch.moves[0].to), [12.7, 0.0]);
        assert_eq!(inch.moves[0].feed, 25.4);
    }

    fn path_of(text: &str, dialect: Dialect) -> Path {
        path(text, dialect).unwrap()
    }

    #[test]
    fn arcs_by_radius_and_by_centre_agree() {
        // A rounded end of radius 5: from the axis outward, seen with Z right and X up.
        for text in ["G0 X0 Z0\nG3 X5 Z-5 R5 F1", "G0 X0 Z0\nG3 X5 Z-5 K-5 F1"] {
            let path = path_of(text, Dialect::LinuxcncLathe);
            let Motion::Arc { centre, clockwise, .. } = path.moves[0].motion else { panic!() };
            assert!(!clockwise);
            assert!((centre[0] + 5.0).abs() < 1e-12 && centre[1].abs() < 1e-12, "{centre:?}");
        }
        let long = path_of("G0 X0 Y0\nG2 X1 Y1 R-1 F1", Dialect::LinuxcncMill);
        let Motion::Arc { centre, .. } = long.moves[0].motion else { panic!() };
        assert!(centre[0].abs() < 1e-12 && (centre[1] - 1.0).abs() < 1e-12, "{centre:?}");
    }

    #[test]
    fn what_cannot_be_followed_is_told_with_its_place() {
        use Dialect::{FanucLathe as F, LinuxcncLathe as L, LinuxcncMill as M};
        let at = |text, dialect| {
            let (line, column, _) = fault(text, dialect);
            (line, column)
        };
        assert_eq!(at("G0 X0 Z0\nG3 X5 Z-5 F1", L), (2, 4));
        assert_eq!(at("G0 X0 Z0\nG3 X50 Z-5 R5 F1", L), (2, 12));
        assert_eq!(at("G0 X0 Z0\nG3 X5 Z-5 K-4 F1", L), (2, 4));
        assert_eq!(at("G0 X0 Z0\nG3 X5 Z-5 J-4 F1", L), (2, 11));
        assert_eq!(at("G0 X0 Z0\nG1 X5", L), (2, 4));
        assert_eq!(at("G1 X5 Z0 F1", L), (1, 4));
        assert_eq!(at("X5 Z0", L), (1, 1));
        assert_eq!(at("G0 G1 X5 Z0", L), (1, 4));
        assert_eq!(at("G0 X5 Z0\nG4503", F), (2, 1));
        assert_eq!(at("G0 X5. Z0\nG1 X6. F1", F), (2, 8));
        assert_eq!(at("G0 X5. Z0\nM98 P1000", F), (2, 1));
        assert_eq!(at("G0 X5. Z0\nY3.", F), (2, 1));
        assert_eq!(at("G0 X5 Y0 E3", M), (1, 10));
        assert_eq!(at("G0 X5 Y0 I3", M), (1, 10));
        assert_eq!(at("G91 G0 X5 Y0", M), (1, 8));
        assert_eq!(at("/G0 X5 Y0", M), (1, 1));
        assert_eq!(at("G0 X5. Z0\nG71 U1. R1.\n", F), (2, 1));
    }
}
