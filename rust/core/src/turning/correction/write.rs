//! Writes the corrected program: blocks put in, X written anew, arcs, block numbers.

use std::collections::HashMap;

use super::windows::{Plan, measurable};
use crate::Result;
use crate::nc::path::{Motion, Move, Spelling};
use crate::nc::{Block, Item, Number, Program, Word};
use crate::turning::geometry::MIN_LENGTH_MM;

/// A rapid that ends above a plunge goes with it, and one that only moves Z keeps the X it has.
pub(super) fn plunges(plan: &mut Plan<'_>, program: &Program) {
    for index in 0..plan.moves.len() {
        let Some(m) = plan.moves.get(index) else { continue };
        if m.motion != Motion::Rapid {
            continue;
        }
        if let Some(next) = plan.moves.get(index + 1)
            && next.motion == Motion::Feed
            && (next.to.axes[2] - m.to.axes[2]).abs() < MIN_LENGTH_MM
            && next.to.axes[0] < m.to.axes[0]
        {
            plan.end[index] = plan.end[index + 1];
        } else if !plan.pinned[index]
            && index > 0
            && program.blocks.get(m.block).is_some_and(|b| b.word('X').is_none())
        {
            plan.end[index] = plan.end[index - 1];
        }
    }
}

/// Writes the corrected program; also the indices of the blocks put in.
pub(super) fn write(program: &Program, plan: &Plan<'_>) -> Result<(Program, Vec<usize>)> {
    let by_block: HashMap<usize, usize> =
        plan.moves.iter().enumerate().map(|(index, m)| (m.block, index)).collect();
    let mut out = Program::new(program.dialect);
    out.blocks.reserve(program.blocks.len() + plan.windows.len());
    let mut inserted = Vec::new();
    // X and Z as last written (what the control holds), as numbers.
    let mut held: [Option<Number>; 2] = [None, None];
    let mut feed: Option<Number> = None;
    for (number, block) in program.blocks.iter().enumerate() {
        let mut block = block.clone();
        let index = by_block.get(&number).copied();
        if let Some(lead) = plan.lead.filter(|lead| lead.block == number && plan.begin != 0)
            && let Some(first) = plan.moves.first()
        {
            let (radius, written) = (first.from.axes[0], block.word('X').map(|word| word.number));
            let unit = plan.options.unit_mm;
            let x = x_number(program, lead.spelling, radius, plan.begin, unit, written)?;
            block.set('X', x, &[]);
        }
        if let Some((index, m)) = index.and_then(|i| Some((i, plan.moves.get(i)?))) {
            let before = plan.before(index);
            let touched = plan.end[index] != 0 || before != 0 || !plan.knots[index].is_empty();
            if touched {
                if m.spelling.incremental {
                    return Err(m.span.error(
                        "a move in increments is to be corrected; expected absolute positions (X, Z)",
                    ));
                }
                let knots = std::mem::take(&mut Vec::clone(&plan.knots[index]));
                for (count, &(z, k)) in knots.iter().enumerate() {
                    let slope = measurable(m).unwrap_or(0.0);
                    let z =
                        program.dialect.spelled(z / m.spelling.unit_mm, decimals(m.spelling))?;
                    // X for z as written: on a cone the rounding of z would be seen in the diameter.
                    let written_z = program.dialect.length_mm(z) * m.spelling.unit_mm;
                    let nominal = m.from.axes[0] + slope * (written_z - m.from.axes[2]);
                    let unit = plan.options.unit_mm;
                    let x = x_number(program, m.spelling, nominal, k, unit, None)?;
                    let mut new = Block::default();
                    if count == 0 {
                        hand_over(&mut block, &mut new, feed);
                    }
                    for (slot, (letter, value)) in [('X', x), ('Z', z)].into_iter().enumerate() {
                        let same = held[slot].is_some_and(|h| same_value(h, value));
                        if !same {
                            new.items.push(Item::Word(Word::new(letter, value)));
                            held[slot] = Some(value);
                        }
                    }
                    if new.words().any(|word| matches!(word.letter, 'X' | 'Z')) {
                        inserted.push(out.blocks.len());
                        // F stands last, as in the dialects' own hand.
                        new.items
                            .sort_by_key(|item| matches!(item, Item::Word(w) if w.letter == 'F'));
                        out.blocks.push(new);
                    }
                }
                let written = block.word('X').map(|word| word.number);
                let x = x_number(
                    program,
                    m.spelling,
                    m.to.axes[0],
                    plan.end[index],
                    plan.options.unit_mm,
                    written,
                )?;
                let holds = held[0].is_some_and(|h| same_value(h, x));
                if written.is_some_and(|w| !same_value(w, x)) || written.is_none() && !holds {
                    block.set('X', x, &['Z', 'R', 'I', 'K', 'F', 'S', 'T', 'M']);
                }
                if let Motion::Arc { .. } = m.motion {
                    let before = plan.before(index);
                    rebend(program, &mut block, m, before, plan.end[index], plan.options.unit_mm)?;
                }
            }
        }
        for (slot, letter) in ['X', 'Z'].into_iter().enumerate() {
            if let Some(word) = block.word(letter) {
                held[slot] = Some(word.number);
            }
        }
        if let Some(word) = block.word('F') {
            feed = Some(word.number);
        }
        out.blocks.push(block);
    }
    if !plan.options.keep_numbers {
        renumber(program, &mut out)?;
    }
    Ok((out, inserted))
}

fn same_value(a: Number, b: Number) -> bool {
    a.value().to_bits() == b.value().to_bits() && a.has_point() == b.has_point()
        || a.value() == 0.0 && b.value() == 0.0
}

/// Decimals of a length written anew: 1 µm, 0.0001 inch.
fn decimals(spelling: Spelling) -> u8 {
    if spelling.unit_mm > 1.0 { 4 } else { 3 }
}

/// X for a nominal radius and a correction of -k units on the diameter. What is not corrected stays
/// as written.
fn x_number(
    program: &Program,
    spelling: Spelling,
    nominal: f64,
    k: i64,
    unit: f64,
    written: Option<Number>,
) -> Result<Number> {
    if let (0, Some(number)) = (k, written) {
        return Ok(number);
    }
    #[allow(clippy::cast_precision_loss)] // errors are small
    let radius = nominal - 0.5 * k as f64 * unit;
    // A radius needs one more place for the same diameter.
    let places = decimals(spelling) + u8::from(!spelling.diameter);
    let places = places.max(written.map_or(0, Number::decimals)).min(9);
    program.dialect.spelled(spelling.x(radius), places)
}

/// Words that have to be in force from the beginning of the line go to its first block: motion and
/// modes, spindle, tool, coolant on, and a feed that is not in force yet.
fn hand_over(block: &mut Block, new: &mut Block, feed: Option<Number>) {
    let changes_feed =
        |word: &Word| feed.is_none_or(|f| f.value().to_bits() != word.number.value().to_bits());
    let goes = |item: &Item| match item {
        Item::Word(word) => match word.letter {
            'G' | 'S' | 'T' | 'D' | 'H' => true,
            'F' => changes_feed(word),
            'M' => ![0.0, 1.0, 2.0, 5.0, 9.0, 30.0, 60.0]
                .iter()
                .any(|stays: &f64| stays.to_bits() == word.number.value().to_bits()),
            _ => false,
        },
        _ => false,
    };
    let (taken, kept): (Vec<_>, Vec<_>) =
        std::mem::take(&mut block.items).into_iter().partition(goes);
    block.items = kept;
    new.items = taken;
}

/// An arc whose ends have moved gets a centre or radius that fits.
fn rebend(
    program: &Program,
    block: &mut Block,
    m: &Move,
    before: i64,
    after: i64,
    unit: f64,
) -> Result<()> {
    if before == 0 && after == 0 {
        return Ok(());
    }
    let Motion::Arc { centre, .. } = m.motion else { return Ok(()) };
    #[allow(clippy::cast_precision_loss)]
    let moved = |x: f64, k: i64| x - 0.5 * k as f64 * unit;
    let from = [m.from.axes[2], moved(m.from.axes[0], before)];
    let to = [m.to.axes[2], moved(m.to.axes[0], after)];
    let radius = (m.from.axes[2] - centre[0]).hypot(m.from.axes[0] - centre[1]);
    let chord = [to[0] - from[0], to[1] - from[1]];
    let length = chord[0].hypot(chord[1]);
    let half = 0.5 * length;
    let needed = radius.max(half);
    if let Some(word) = block.word('R') {
        if needed > radius {
            let places = decimals(m.spelling);
            let scale = 10_f64.powi(i32::from(places));
            let up = (needed / m.spelling.unit_mm * scale).ceil() / scale;
            let sign = if word.number.value() < 0.0 { -1.0 } else { 1.0 };
            let number = program.dialect.spelled(sign * up, places)?;
            block.set('R', number, &[]);
        }
        return Ok(());
    }
    // The centre stays on its side of the chord.
    let height = (needed * needed - half * half).max(0.0).sqrt();
    let old = [m.to.axes[2] - m.from.axes[2], m.to.axes[0] - m.from.axes[0]];
    let to_centre = [centre[0] - m.from.axes[2], centre[1] - m.from.axes[0]];
    let side = (old[0] * to_centre[1] - old[1] * to_centre[0]).signum();
    let new = [
        from[0] + 0.5 * chord[0] - side * height * chord[1] / length,
        from[1] + 0.5 * chord[1] + side * height * chord[0] / length,
    ];
    let base = if m.spelling.centre_absolute { [0.0, 0.0] } else { from };
    for (letter, value) in [('I', new[1] - base[1]), ('K', new[0] - base[0])] {
        let places = decimals(m.spelling);
        let number = program.dialect.spelled(value / m.spelling.unit_mm, places)?;
        if block.word(letter).is_some() || number.value() != 0.0 {
            block.set(letter, number, &['F', 'S', 'T', 'M']);
        }
    }
    Ok(())
}

/// Numbers the blocks anew if every block with words had a number and the numbers went up evenly; P
/// and Q of contour cycles follow.
fn renumber(original: &Program, out: &mut Program) -> Result<()> {
    let wordy = |b: &&Block| b.words().any(|w| w.letter != 'O');
    let mut numbers = Vec::new();
    for block in original.blocks.iter().filter(wordy) {
        let Some(word) = block.word('N') else { return Ok(()) };
        numbers.push(word.number);
    }
    let (Some(first), Some(second)) = (numbers.first(), numbers.get(1)) else { return Ok(()) };
    let step = second.value() - first.value();
    let even = numbers
        .windows(2)
        .all(|pair| matches!(pair, [a, b] if (b.value() - a.value()).to_bits() == step.to_bits()));
    if !even || step <= 0.0 {
        return Ok(());
    }
    let width = first.digits_before();
    let mut names = HashMap::new();
    let mut next = first.value();
    for block in out.blocks.iter_mut().filter(|b| wordy(&&**b)) {
        let number = Number::whole(next, width)?;
        if let Some(word) = block.word('N') {
            names.insert(word.number.value().to_bits(), number);
            block.set('N', number, &[]);
        } else {
            block.items.insert(0, Item::Word(Word::new('N', number)));
        }
        next += step;
    }
    for block in &mut out.blocks {
        let cycle = block.words().any(|w| {
            w.letter == 'G'
                && [70.0, 71.0, 72.0, 73.0]
                    .iter()
                    .any(|c: &f64| c.to_bits() == w.number.value().to_bits())
        });
        if cycle {
            for letter in ['P', 'Q'] {
                let Some(written) = block.word(letter).map(|word| word.number) else { continue };
                if let Some(number) = names.get(&written.value().to_bits()) {
                    block.set(letter, Number::whole(number.value(), written.digits_before())?, &[]);
                }
            }
        }
    }
    Ok(())
}
