//! Which rows of a measurement are which touches of the paper.

use crate::artefact::{Artefact, Cross};
use crate::machine::{Machine, Rotary, Side};
use crate::moves::Moves;
use crate::touch::TouchModel;
use crate::units::DEG;
use crate::{Error, Result};

/// Angles closer than this are the same position, rad.
const SAME_ANGLE: f64 = 0.01 * DEG;

/// One position of C with A = 0: the rows of the labels 1 to 16.
#[derive(Clone, Debug)]
pub(super) struct Turned {
    pub(super) angle: f64,
    pub(super) rows: [Vec<usize>; 17],
}

/// One position of A with C = 0: the rows of the labels 17 to 20.
#[derive(Clone, Debug)]
pub(super) struct Tilted {
    pub(super) angle: f64,
    pub(super) rows: [Vec<usize>; 4],
}

/// Which rows of a measurement are which touches of the paper.
#[derive(Clone, Debug)]
pub struct PaperRows {
    pub(super) turned: Vec<Turned>,
    pub(super) tilted: Vec<Tilted>,
    /// (L − h)/2, how far out along the arms tops and sides are touched.
    pub(super) out: f64,
    pub(super) height: f64,
    /// A point of the A axis: its Y and Z, mm.
    pub(super) axis: [f64; 2],
}

impl PaperRows {
    /// Finds the paper's touches by the positions of A and C and by label; repeated touches are
    /// averaged, others ignored.
    ///
    /// # Errors
    /// Another artefact than the cross or one off the middle of the table, another machine than
    /// `trt-ca`, or a position at which some of the labels are missing.
    pub fn find(model: &TouchModel, moves: &Moves, labels: &[i64]) -> Result<Self> {
        let Artefact::Cross(Cross { length, height, .. }) = *model.artefact() else {
            return Err(Error::Data(
                "closed forms: got an artefact of another kind, expected a cross; identify takes any"
                    .into(),
            ));
        };
        if !is_a_carries_c(model.machine()) {
            let got = model.machine().code();
            let expected = "[w C' A' b X Y Z t] (trt-ca) with A along X and C along Z: the formulas \
                 of Kang, Kim and Jee (2022) are for this chain; identify takes any machine";
            return Err(Error::input("closed forms: machine", got, expected));
        }
        if labels.len() != moves.len() {
            return Err(Error::input("labels", labels.len(), format!("{} of them", moves.len())));
        }
        let nominal = model.nominal();
        if nominal.placement().iter().any(|&value| value != 0.0) {
            return Err(Error::Data(
                "closed forms: got an artefact off the middle of the table or turned \
                 (artefact.place_mm, artefact.turn_deg), expected one in the middle, its bars along X \
                 and Y: the forms hold only there; least squares (identify) takes any place"
                    .into(),
            ));
        }
        let frame = nominal.frame(0);
        let mut found = Self {
            turned: Vec::new(),
            tilted: Vec::new(),
            out: 0.5 * (length - height),
            height,
            axis: [frame[1], frame[2]],
        };
        for (row, (&label, angles)) in labels.iter().zip(moves.rotary.chunks_exact(2)).enumerate() {
            let (a, c) = (angles[0], angles[1]);
            if a.abs() < SAME_ANGLE && (1..=16).contains(&label) {
                found.turned_at(c).rows[label as usize].push(row);
            } else if same(c, 0.0) && (17..=20).contains(&label) {
                found.tilted_at(a).rows[label as usize - 17].push(row);
            }
        }
        found.check()?;
        Ok(found)
    }

    /// How the nominal table stands off its place on a machine whose A axis goes through the origin,
    /// with A at `angle`: Y and Z, mm.
    pub(super) fn shift(&self, angle: f64) -> [f64; 2] {
        let [y, z] = self.axis;
        let (sin, cos) = crate::pose::sin_cos(angle);
        [y - (cos * y - sin * z), z - (sin * y + cos * z)]
    }

    /// Rows of each touch that is used, its repeats together: the forms take their mean.
    pub(super) fn repeats(&self) -> impl Iterator<Item = &[usize]> {
        let turned = self.turned.iter().flat_map(|position| position.rows.iter());
        let tilted = self.tilted.iter().flat_map(|position| position.rows.iter());
        turned.chain(tilted).map(Vec::as_slice).filter(|rows| !rows.is_empty())
    }

    fn turned_at(&mut self, angle: f64) -> &mut Turned {
        let place = self.turned.iter().position(|p| same(p.angle, angle));
        let place = place.unwrap_or_else(|| {
            self.turned.push(Turned { angle, rows: std::array::from_fn(|_| Vec::new()) });
            self.turned.len() - 1
        });
        &mut self.turned[place]
    }

    fn tilted_at(&mut self, angle: f64) -> &mut Tilted {
        let place = self.tilted.iter().position(|p| (p.angle - angle).abs() < SAME_ANGLE);
        let place = place.unwrap_or_else(|| {
            self.tilted.push(Tilted { angle, rows: std::array::from_fn(|_| Vec::new()) });
            self.tilted.len() - 1
        });
        &mut self.tilted[place]
    }

    fn check(&self) -> Result<()> {
        let expected = "expected labels 1 to 16 at every C with A = 0, among them C = 0, and labels 17 \
                      to 20 at every A with C = 0";
        if self.turned.is_empty() || self.tilted.is_empty() {
            let (c, a) = (self.turned.len(), self.tilted.len());
            return Err(Error::Data(format!(
                "closed forms: got labelled touches at {c} positions of C and {a} of A; {expected}"
            )));
        }
        for position in &self.turned {
            if let Some(label) = (1..=16).find(|&label: &usize| position.rows[label].is_empty()) {
                let c = position.angle / DEG;
                return Err(Error::Data(format!(
                    "closed forms: no touch {label} at C = {c:.3}°, A = 0; {expected}"
                )));
            }
        }
        for position in &self.tilted {
            if let Some(index) = position.rows.iter().position(Vec::is_empty) {
                let (label, a) = (index + 17, position.angle / DEG);
                return Err(Error::Data(format!(
                    "closed forms: no touch {label} at A = {a:.3}°, C = 0; {expected}"
                )));
            }
        }
        if !self.turned.iter().any(|position| same(position.angle, 0.0)) {
            return Err(Error::Data(format!("closed forms: no touches at A = C = 0; {expected}")));
        }
        Ok(())
    }

    /// Checks that touches 17 to 20 were taken where equations (9) and (10) hold.
    ///
    /// # Errors
    /// A tilt other than ±90°: distances from the A axis do not give EB0A and EY0A there.
    pub fn upright(&self) -> Result<()> {
        let off = |position: &&Tilted| (position.angle.abs() - 90.0 * DEG).abs() > SAME_ANGLE;
        let Some(position) = self.tilted.iter().find(off) else { return Ok(()) };
        Err(Error::Data(format!(
            "printed forms: got touches 17 to 20 at A = {:.3}°, expected A = ±90° only: equations (9) \
             and (10) hold only there. Leave these touches out, or use least squares (identify), \
             which takes any position of A",
            position.angle / DEG
        )))
    }

    /// Positions 0°, 90°, 180°, 270° of C and ±90° of A, in this order; others are no part of the
    /// separating forms.
    pub(super) fn quarters(&self) -> Option<([&Turned; 4], [&Tilted; 2])> {
        let turned = |quarter: f64| {
            self.turned.iter().find(|position| same(position.angle, quarter * 90.0 * DEG))
        };
        let tilted = |angle: f64| {
            self.tilted.iter().find(|position| (position.angle - angle * DEG).abs() < SAME_ANGLE)
        };
        Some((
            [turned(0.0)?, turned(1.0)?, turned(2.0)?, turned(3.0)?],
            [tilted(90.0)?, tilted(-90.0)?],
        ))
    }

    /// Positions of C in the order measured, rad.
    #[must_use]
    pub fn turned_angles(&self) -> Vec<f64> {
        self.turned.iter().map(|position| position.angle).collect()
    }

    /// Positions of A in the order measured, rad.
    #[must_use]
    pub fn tilted_angles(&self) -> Vec<f64> {
        self.tilted.iter().map(|position| position.angle).collect()
    }
}

/// Whether two positions of C are the same but for whole turns.
pub(super) fn same(a: f64, b: f64) -> bool {
    crate::machine::kinematics::wrap(a - b).abs() < SAME_ANGLE
}

/// Mean of some values.
pub(super) fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count();
    values.sum::<f64>() / count as f64
}

/// Whether an A axis along X carries a C axis along Z through the origin, both below the work.
fn is_a_carries_c(machine: &Machine) -> bool {
    let plain = |axis: &Rotary| axis.side == Side::Workpiece && axis.own().is_none();
    let letters: String = machine.rotary().iter().map(Rotary::letter).collect();
    letters == "AC" && machine.rotary().iter().all(plain) && machine.seat().is_none()
}
