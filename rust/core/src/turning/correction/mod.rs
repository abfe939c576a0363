//! Correction of a finishing program for a measured diameter error (section 3).
//!
//! Readings of the error e(z), on the diameter, are averaged over windows of N and expressed in whole
//! units CU of the correction: k = trunc(mean/CU ± 0.5). The program's X is then changed by -k CU.
//! The rule decides where between the windows the change happens ([`Rule`]). The result says
//! what it leaves of the error, replayed from the written program.
//!
//! | file | what it knows |
//! |---|---|
//! | `options` | rules and settings |
//! | `windows` | readings to windows to units; the rules that work window by window |
//! | `bounded` | the rule with a bound |
//! | `write` | the corrected program |
//! | `replay` | the diameter a program cuts |

mod bounded;
mod options;
mod replay;
mod windows;
mod write;

pub use options::{CorrectionOptions, Rule, StartCorner};
pub use replay::{Diameters, change, contour_path};
pub use windows::{Reading, Window, units_of};

use bounded::bounded;
use windows::{Plan, by_windows, sorted};
use write::{plunges, write};

use crate::nc::Program;
use crate::{Error, Result};

/// A corrected program.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// The program.
    pub program: Program,
    /// Indices, in the new program, of the blocks that were put in.
    pub inserted: Vec<usize>,
    /// Windows used, by line.
    pub windows: Vec<Window>,
    /// For each reading, in the order given: change of the diameter there, mm, replayed from the new
    /// program; 0 where `covered` is false.
    pub change: Vec<f64>,
    /// Is the reading on a feed move of the program?
    pub covered: Vec<bool>,
    /// No window mean (with windows of one: no reading) is left with more, mm; only for
    /// [`Rule::Bounded`].
    pub bound: Option<f64>,
}

/// Corrects a program.
///
/// # Errors
/// [`Error::Input`] for readings or options that are not usable, [`Error::Program`] for a program
/// that cannot be followed, for corrected moves written in increments, and [`Error::Data`] if no
/// reading lies on a feed move.
pub fn correct(
    program: &Program,
    readings: &[Reading],
    options: &CorrectionOptions,
) -> Result<Corrected> {
    check(readings, options)?;
    let path = contour_path(program, &options.start)?;
    let order = sorted(readings);
    let mut plan = Plan::new(&path, &order, options);
    match options.rule {
        Rule::Bounded { bound_mm } => bounded(&mut plan, bound_mm),
        _ => by_windows(&mut plan),
    }
    if plan.windows.is_empty() {
        return Err(Error::Data(
            "none of the readings lies on a feed move of the program; expected z of the part"
                .into(),
        ));
    }
    plunges(&mut plan, program);
    let (corrected, inserted) = write(program, &plan)?;
    let after = contour_path(&corrected, &options.start)?;
    let (was, is) =
        (Diameters::new(&path, options.follows), Diameters::new(&after, options.follows));
    let (mut change, mut covered) = (Vec::new(), Vec::new());
    for reading in readings {
        let both = was.at(reading.z).zip(is.at(reading.z));
        change.push(both.map_or(0.0, |(was, is)| is - was));
        covered.push(both.is_some());
    }
    let bound = match options.rule {
        // The least increment of a diameter that is written anew adds half of it. What the replay
        // shows goes before what was promised.
        Rule::Bounded { bound_mm } => {
            let left = |w: &Window| Some((w.mean + is.at(w.z)? - was.at(w.z)?).abs());
            let promised = 0.5 * options.unit_mm + bound_mm + 0.5 * MIN_INCREMENT_MM;
            let worst = plan.windows.iter().filter_map(left).fold(0.0, f64::max);
            Some(if worst > promised + 1e-9 { worst } else { promised })
        }
        _ => None,
    };
    Ok(Corrected { program: corrected, inserted, windows: plan.windows, change, covered, bound })
}

/// An error of a diameter above this is an error of input, mm: a diameter itself, or another unit.
const MAX_ERROR_MM: f64 = 5.0;

/// Smallest unit of a correction, mm: far below the increment of any control.
const MIN_UNIT_MM: f64 = 1e-6;

/// Largest bound, in units: the search tries every whole unit within it at every reading.
const MAX_BOUND: f64 = 100.0;

/// Diameters are written to this, mm.
const MIN_INCREMENT_MM: f64 = 1e-3;

fn check(readings: &[Reading], options: &CorrectionOptions) -> Result<()> {
    if !(options.unit_mm.is_finite() && options.unit_mm >= MIN_UNIT_MM) {
        let expected = format!("finite and at least {MIN_UNIT_MM}");
        return Err(Error::input("unit, mm", options.unit_mm, expected));
    }
    if options.window == 0 {
        return Err(Error::input("window", 0, "one reading at least"));
    }
    if let Rule::Bounded { bound_mm } = options.rule
        && !(bound_mm.is_finite() && (0.0..=MAX_BOUND * options.unit_mm).contains(&bound_mm))
    {
        let expected = format!("0 to {MAX_BOUND} units, not negative");
        return Err(Error::input("bound, mm", bound_mm, expected));
    }
    for (row, reading) in readings.iter().enumerate() {
        if !(reading.z.is_finite() && reading.error.is_finite()) {
            let got = format!("z {}, error {}", reading.z, reading.error);
            return Err(Error::input(format!("reading {row}"), got, "finite numbers"));
        }
        if reading.error.abs() > MAX_ERROR_MM {
            let expected = format!("at most {MAX_ERROR_MM} mm: measured minus nominal diameter");
            return Err(Error::input(format!("reading {row}, mm"), reading.error, expected));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nc::Dialect;
    use crate::nc::path::Start;
    use crate::turning::profile::Follows;
    use crate::units::UM;

    fn options(rule: Rule, start_corner: StartCorner) -> CorrectionOptions {
        CorrectionOptions {
            unit_mm: 10.0 * UM,
            window: 5,
            rule,
            start_corner,
            follows: Follows::Contour,
            start: Start { machine_codes: vec![('G', 4503.0)], ..Start::default() },
            keep_numbers: false,
        }
    }

    #[test]
    fn means_become_units_as_the_paper_counts() {
        let means = [-28.0, -25.0, -24.999, -15.0, -5.0, -4.999, 4.999, 5.0];
        let k: Vec<i64> = means.iter().map(|m| units_of(m * UM, 10.0 * UM)).collect();
        assert_eq!(k, [-3, -3, -2, -2, -1, 0, 0, 1]);
    }

    fn experiment(diameter: &str, end: &str, runs: &[(usize, f64)], n: usize) -> String {
        let original = format!(
            ";CSS_T/T\nN0001 G99\nN0002 G97M41\nN0003 G4503\nN0004 T0101\nN0005 G96S200.M3\n\
             N0006 G42\nN0007 G0X{diameter}Z75.\nN0008 G1Z65.F.1\nN0009 {end}\nN0010 X82.\nN0011 G40\n\
             N0012 G0X100.Z150.\nN0013 M30\n"
        );
        let k = runs.iter().flat_map(|&(count, k)| std::iter::repeat_n(k, 5 * count));
        #[allow(clippy::cast_precision_loss)]
        let readings: Vec<Reading> = k
            .take(n)
            .enumerate()
            .map(|(i, k)| Reading {
                z: 65.0 - 60.0 * (i + 1) as f64 / n as f64,
                error: k * 10.0 * UM,
            })
            .collect();
        assert_eq!(readings.len(), n);
        let program = Program::parse(&original, Dialect::FanucLathe).unwrap();
        correct(&program, &readings, &options(Rule::Paper, StartCorner::Zero))
            .unwrap()
            .program
            .emit()
    }

    #[test]
    fn fig_18_comes_out() {
        let ours = experiment("70.", "Z0F.10", &[(12, 0.0), (28, -1.0)], 196);
        assert_eq!(ours, include_str!("../../../../../tests/data/turning/fig18.nc"));
    }

    #[test]
    fn fig_20_comes_out() {
        let runs = [(5, 0.0), (12, -1.0), (19, -2.0), (1, -3.0), (1, -2.0)];
        let ours = experiment("52.", "Z0", &runs, 190);
        assert_eq!(ours, include_str!("../../../../../tests/data/turning/fig20.nc"));
    }
}
