//! What the words mean: modes and moves.
//!
//! [`moves`] follows a program as its control would: distances absolute or incremental, mm or inch,
//! radius or diameter, arcs by centre or radius, feed and nose compensation. A block whose meaning
//! is not known for certain is an error with its line and column, never skipped.

use std::ops::Range;

use super::{Block, Dialect, Program, Span, Word};
use crate::units::INCH;
use crate::{Error, Result};

/// The axes, in the order of [`Position::axes`].
pub const AXES: [char; 6] = ['X', 'Y', 'Z', 'A', 'B', 'C'];

/// Commanded position: X (radius on a lathe), Y, Z in mm, A, B, C in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// X, Y, Z, A, B, C.
    pub axes: [f64; 6],
}

/// Plane of an arc, by the axes that go first and second: an arc is counter-clockwise if it turns
/// from the first to the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// G17, X to Y.
    Xy,
    /// G18, Z to X: seen from +Y, that is with Z to the right and X up.
    Zx,
    /// G19, Y to Z.
    Yz,
}

impl Plane {
    /// Numbers of the first and second axis in [`Position::axes`].
    #[must_use]
    pub const fn axes(self) -> (usize, usize) {
        match self {
            Self::Xy => (0, 1),
            Self::Zx => (2, 0),
            Self::Yz => (1, 2),
        }
    }
}

/// How a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// G0: every axis as fast as it can; the path between the ends is the control's affair.
    Rapid,
    /// G1: straight, at feed.
    Feed,
    /// G38.2 to G38.5: straight until the probe changes.
    Probe,
    /// G2, G3: arc at feed.
    Arc {
        /// Plane.
        plane: Plane,
        /// Centre, mm, first and second axis of the plane.
        centre: [f64; 2],
        /// G2.
        clockwise: bool,
    },
}

/// What a feed counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedMode {
    /// mm (degrees) a minute.
    PerMinute,
    /// mm a turn of the spindle.
    PerRevolution,
    /// Moves a minute (G93).
    InverseTime,
}

/// Where the tool goes beside the programmed contour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// G40: the program holds the tool's centre path.
    #[default]
    On,
    /// G41.
    Left,
    /// G42.
    Right,
}

/// One move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// How.
    pub motion: Motion,
    /// Where from.
    pub from: Position,
    /// Where to (for a probing move: where it ends if nothing is touched).
    pub to: Position,
    /// Feed in mm/min, mm/rev or 1/min; 0 on a rapid.
    pub feed: f64,
    /// What the feed counts.
    pub feed_mode: FeedMode,
    /// Nose (cutter) compensation in force.
    pub side: Side,
    /// How its block spells positions.
    pub spelling: Spelling,
    /// Index of the block in the program.
    pub block: usize,
    /// Where the block was read.
    pub span: Span,
}

/// How the words of a block spell positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spelling {
    /// X is a diameter.
    pub diameter: bool,
    /// mm per unit of length.
    pub unit_mm: f64,
    /// Positions are increments: G91, or U and W on a Fanuc lathe.
    pub incremental: bool,
    /// I and K are the centre itself, not the way to it.
    pub centre_absolute: bool,
}

impl Spelling {
    /// The number behind X for a radius in mm.
    #[must_use]
    pub fn x(&self, radius_mm: f64) -> f64 {
        if self.diameter { 2.0 * radius_mm / self.unit_mm } else { radius_mm / self.unit_mm }
    }
}

/// What is in force before the first block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    /// Position, if it is known.
    pub position: Option<Position>,
    /// Feed, if one is set outside the program (the listings of the paper have none), counted in
    /// whatever way is then in force.
    pub feed: Option<f64>,
    /// Codes of this machine that move no axis (`G4503`): letter and number.
    pub machine_codes: Vec<(char, f64)>,
}

impl Start {
    fn check(&self) -> Result<()> {
        if let Some(feed) = self.feed
            && !(feed.is_finite() && feed > 0.0)
        {
            return Err(Error::input("feed before the program", feed, "more than zero, or none"));
        }
        match self.machine_codes.iter().find(|(letter, _)| !letter.is_ascii_uppercase()) {
            Some((letter, number)) => {
                let got = format!("{letter}{number}");
                Err(Error::input("machine code", got, "a letter A to Z and a number, as G4503"))
            }
            None => Ok(()),
        }
    }
}

/// A program's moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Where the moves begin: [`Start::position`], or the first place at which every axis that the
    /// program names has been commanded. Axes that it never names are 0.
    pub start: Position,
    /// The block that commanded X at [`Path::start`], if it is one of those that were followed.
    pub lead: Option<Lead>,
    /// The moves; moves of no length are left out.
    pub moves: Vec<Move>,
}

/// A block that goes to where the moves begin: it is no move itself, since nothing says from where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lead {
    /// Index of the block in the program.
    pub block: usize,
    /// How it spells positions.
    pub spelling: Spelling,
}

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
                cycle.span.error(format!("contour cycle without {letter}; wanted P and Q"))
            })?;
            program
                .blocks
                .iter()
                .position(|b| {
                    b.word('N').is_some_and(|n| same(n.number.value(), word.number.value()))
                })
                .ok_or_else(|| {
                    let message =
                        format!("no block N{}; wanted an end of the contour", word.number);
                    word.span.error(message)
                })
        };
        let (first, last) = (find('P')?, find('Q')?);
        if last < first {
            return Err(cycle.span.error("the contour ends before it begins; wanted N of P first"));
        }
        return Ok(Some(first..last + 1));
    }
    Ok(None)
}

fn same(left: f64, right: f64) -> bool {
    left.to_bits() == right.to_bits()
}

/// A G code times ten: 382 for G38.2; `u32::MAX` for anything that is no such number.
fn code(word: &Word) -> u32 {
    let tenths = (word.number.value() * 10.0).round();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // bounded here
    if (0.0..1e6).contains(&tenths) && word.number.decimals() <= 1 {
        tenths as u32
    } else {
        u32::MAX
    }
}

const fn is_contour_cycle(code: u32) -> bool {
    matches!(code, 700 | 710 | 720 | 730)
}

/// Motion codes: what G 0, 1, 2, 3, 38.n set.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mode {
    Rapid,
    Feed,
    Clockwise,
    CounterClockwise,
    Probe,
}

struct Follower<'a> {
    dialect: Dialect,
    start: &'a Start,
    mode: Option<Mode>,
    plane: Plane,
    unit_mm: f64,
    diameter: bool,
    incremental: bool,
    centre_absolute: bool,
    feed: Option<f64>,
    feed_mode: FeedMode,
    side: Side,
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
            if self.is_machine_code(word) {
                continue;
            }
            let code = code(word);
            if is_contour_cycle(code) && self.dialect == Dialect::FanucLathe {
                return if self.inside && self.moves.is_empty() && block.has('G', 70.0) {
                    Err(word
                        .span
                        .error("G70 repeats a contour; wanted that contour to be read itself"))
                } else if self.inside {
                    Err(word
                        .span
                        .error("cycles are not followed; wanted the finishing contour alone"))
                } else {
                    Ok(())
                };
            }
            let set = match code {
                0 => Some(Mode::Rapid),
                10 => Some(Mode::Feed),
                20 => Some(Mode::Clockwise),
                30 => Some(Mode::CounterClockwise),
                382..=385 if self.is_linuxcnc() => Some(Mode::Probe),
                _ => None,
            };
            if let Some(set) = set {
                if let Some(other) = motion {
                    return Err(word.span.error(format!(
                        "G{} after G{} in one block; wanted one motion",
                        word.number, other.number
                    )));
                }
                motion = Some(word);
                self.mode = Some(set);
            } else {
                takes_parameters |= self.modal(code, word, block)?;
            }
        }
        self.other_words(block, takes_parameters)?;
        if takes_parameters && block.words().any(|w| axis_of(self.dialect, w.letter).is_some()) {
            return Err(block
                .span
                .error("axis words beside a dwell or a setting; wanted a block of their own"));
        }
        self.travel(index, block)
    }

    fn is_linuxcnc(&self) -> bool {
        matches!(self.dialect, Dialect::LinuxcncMill | Dialect::LinuxcncLathe)
    }

    fn is_machine_code(&self, word: &Word) -> bool {
        let value = word.number.value();
        self.start.machine_codes.iter().any(|&(l, code)| l == word.letter && same(code, value))
    }

    /// Codes that set a mode. True for those that take P, Q, R, S or D words of their own.
    fn modal(&mut self, code: u32, word: &Word, block: &Block) -> Result<bool> {
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
                    "G{} is not known in dialect {}; wanted a code that can be followed, or this one \
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
    fn other_words(&mut self, block: &Block, takes_parameters: bool) -> Result<()> {
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
                    "{}{} has no meaning here in dialect {}; wanted an axis, a feed or a known code",
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
                .error("subprograms are not followed; wanted the blocks themselves"));
        }
        Ok(true)
    }

    fn feed_of(&self, word: &Word) -> Result<f64> {
        let value = word.number.value();
        let bare = !word.number.has_point() && self.dialect == Dialect::FanucLathe;
        if bare && self.feed_mode == FeedMode::PerRevolution {
            return Err(word.span.error(
                "feed per revolution without a decimal point: how it counts is a parameter of the \
                 control; wanted a point",
            ));
        }
        if value <= 0.0 {
            return Err(word.span.error(format!("feed {}; wanted more than zero", word.number)));
        }
        Ok(if self.feed_mode == FeedMode::InverseTime { value } else { value * self.unit_mm })
    }

    /// A length word in mm; diameters not yet halved.
    fn length(&self, word: &Word) -> f64 {
        let mm = self.dialect.length_mm(word.number);
        // Without a point, an inch program of a Fanuc control counts 0.0001 inch.
        let bare = self.dialect == Dialect::FanucLathe && !word.number.has_point();
        if bare && self.unit_mm > 1.0 { mm * self.unit_mm * 0.1 } else { mm * self.unit_mm }
    }

    fn travel(&mut self, index: usize, block: &Block) -> Result<()> {
        let mut to = self.position;
        let mut known = self.known;
        let mut named = false;
        for word in block.words() {
            let Some((axis, by_increment)) = axis_of(self.dialect, word.letter) else { continue };
            named = true;
            let mut value = if axis < 3 { self.length(word) } else { word.number.value() };
            if axis == 0 && self.diameter {
                value *= 0.5;
            }
            if by_increment || self.incremental {
                if !known[axis] {
                    return Err(word.span.error(format!(
                        "increment {}{} from a place that is not known; wanted an absolute move first",
                        word.letter, word.number
                    )));
                }
                value += self.position.axes[axis];
            }
            to.axes[axis] = value;
            known[axis] = true;
        }
        let arc = matches!(self.mode, Some(Mode::Clockwise | Mode::CounterClockwise));
        let centre_words = block.words().find(|w| matches!(w.letter, 'I' | 'J' | 'K' | 'R'));
        if !(named || arc && centre_words.is_some()) {
            return Ok(());
        }
        let place = block.words().find(|w| axis_of(self.dialect, w.letter).is_some());
        let span = place.or(centre_words).map_or(block.span, |word| word.span);
        let Some(mode) = self.mode else {
            return Err(
                span.error("axis words before any of G0, G1, G2, G3; wanted a motion first")
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
                    self.lead = Some(Lead { block: index, spelling: self.spelling(block) });
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
                "a feed move from a place that is not known{which}; wanted G0 to it before, or a start \
                 position"
            )));
        }
        if self.begin.is_none() && self.inside {
            self.begin = Some(from);
        }
        if !self.inside {
            return Ok(());
        }
        let feed = match (mode, self.feed) {
            (Mode::Rapid, _) => 0.0,
            (_, Some(feed)) => feed,
            (_, None) => return Err(span.error("a feed move but no feed; wanted F")),
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
        let (feed_mode, side) = (self.feed_mode, self.side);
        let spelling = self.spelling(block);
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

    fn spelling(&self, block: &Block) -> Spelling {
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

    fn arc(
        &self,
        block: &Block,
        span: Span,
        from: &Position,
        to: &Position,
        clockwise: bool,
    ) -> Result<Motion> {
        let (first, second) = self.plane.axes();
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
            (Some(word), [None, None]) => radius_centre(start, end, self.length(word), clockwise)
                .map_err(|m| word.span.error(m))?,
            (Some(word), _) => {
                return Err(word
                    .span
                    .error("an arc with R and with its centre; wanted one of them"));
            }
            (None, [None, None]) => {
                return Err(span.error("an arc without radius; wanted R, or its centre by I, J, K"));
            }
            (None, words) => {
                let mut centre = start;
                for (value, word) in centre.iter_mut().zip(words) {
                    if self.centre_absolute {
                        let Some(word) = word else {
                            return Err(span.error("G90.1 wants both coordinates of the centre"));
                        };
                        *value = self.length(word);
                    } else {
                        *value += word.map_or(0.0, |word| self.length(word));
                    }
                }
                let [at_start, at_end] =
                    [start, end].map(|p| (p[0] - centre[0]).hypot(p[1] - centre[1]));
                if at_start == 0.0 || (at_start - at_end).abs() > ARC_TOLERANCE_MM {
                    return Err(span.error(format!(
                        "the arc does not close: radius {at_start:.4} mm at its start, {at_end:.4} mm at \
                         its end; wanted the same within {ARC_TOLERANCE_MM} mm"
                    )));
                }
                centre
            }
        };
        Ok(Motion::Arc { plane: self.plane, centre, clockwise })
    }
}

/// The axis that a letter moves, and whether the letter itself means an increment.
fn axis_of(dialect: Dialect, letter: char) -> Option<(usize, bool)> {
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

    #[test]
    fn the_finishing_contour_of_a_cycle_is_found() {
        let text = "G0X60.Z2.\nG71U1.5R.5\nG71P10Q20U.4W.1F.3\nN10G0X20.\nG1Z-10.F.1\nN20X50.Z-20.\nG70P10Q20\n";
        let program = Program::parse(text, Dialect::FanucLathe).unwrap();
        let blocks = contour_blocks(&program).unwrap().unwrap();
        assert_eq!(blocks, 3..6);
        let path = moves_of(&program, blocks, &Start::default()).unwrap();
        assert_eq!(xz(&path.start), [30.0, 2.0]);
        assert_eq!(path.moves.len(), 3);
        assert_eq!(xz(&path.moves[2].to), [25.0, -20.0]);
        assert!(moves(&program, &Start::default()).is_err());
    }
}
