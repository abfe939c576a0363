//! Whether the probe can make an approach, wherever within its tolerance the artefact stands.

use nalgebra::Vector3;

use super::Arrangement;
use super::collision::{Stand, Stylus, Way};
use crate::artefact::{Line, Search};
use crate::machine::{Places, Posture};
use crate::moves::Moves;

/// A move towards the artefact.
pub(super) struct Approach<'a> {
    /// The machine at the touch.
    pub posture: &'a Posture,
    /// Where the ball's centre really starts, machine frame: with what errors of a head do to it.
    pub start: Vector3<f64>,
    /// Unit direction.
    pub direction: Vector3<f64>,
    /// Longest travel, mm.
    pub reach: f64,
    /// Outward normal of the face that has to be met, artefact frame; none: any.
    pub face: Option<Vector3<f64>>,
}

/// What approaches of one stylus have in common.
pub(super) struct Approaches<'a> {
    arrangement: &'a Arrangement,
    stylus: Stylus,
    above: f64,
    stands: Vec<Stand>,
}

/// The way in is checked up to this distance from the contact.
const NEARLY_MM: f64 = 0.01;

impl<'a> Approaches<'a> {
    /// Approaches that come down from a level `above` mm over everything.
    pub(super) fn new(arrangement: &'a Arrangement, stylus: Stylus, above: f64) -> Self {
        Self { arrangement, stylus, above, stands: arrangement.around.stands() }
    }

    /// Travel to the first contact with the artefact standing like this (or where it should), if it
    /// is on the face that is meant.
    pub(super) fn travel(&self, approach: &Approach, stand: Option<&Stand>) -> Option<f64> {
        let posture = approach.posture;
        let (mut origin, mut direction) = (approach.start, approach.direction);
        if let Some(stand) = stand {
            let table = self.arrangement.table(posture);
            origin = table.apply(&stand.point(&table.undo(&origin)));
            direction = table.rotation * stand.direction(&table.rotation.tr_mul(&direction));
        }
        let line = Line {
            origin: posture.artefact.undo(&origin),
            direction: posture.artefact.rotation.tr_mul(&direction),
        };
        let solid = self.arrangement.artefact.solid(&Places::default());
        let met = solid.first_contact(&line, self.stylus.ball_radius, Search::Ahead)?;
        let is_meant = approach.face.is_none_or(|face| met.normal.dot(&face) > 1.0 - 1e-6);
        is_meant.then_some(met.travel)
    }

    /// Whether the probe gets to the start and to the contact, wherever within its tolerance the
    /// artefact stands, and then touches the face that is meant.
    pub(super) fn is_free(&self, approach: &Approach, contact: &Vector3<f64>) -> bool {
        let Approach { posture, start, direction, .. } = approach;
        let (around, stylus) = (&self.arrangement.around, &self.stylus);
        let stem = posture.head.rotation * Vector3::z();
        let table = self.arrangement.table(posture);
        let stem_on_table = table.rotation.tr_mul(&stem);
        let way = |from: &Vector3<f64>, to: &Vector3<f64>| Way {
            from: table.undo(from),
            to: table.undo(to),
            stem: stem_on_table,
        };
        let level = around.highest(&table, &stem) + self.above;
        let up = start + stem * (level - start.dot(&stem)).max(0.0);
        if !around.is_free(&way(&up, start), stylus) {
            return false;
        }
        let mut ends = Vec::with_capacity(self.stands.len());
        let mut deepest: f64 = 0.0;
        for stand in &self.stands {
            let Some(travel) = self.travel(approach, Some(stand)) else { return false };
            if travel > approach.reach {
                return false;
            }
            deepest = deepest.max(travel);
            let short = start + direction * (travel - NEARLY_MM);
            ends.push((*stand, table.undo(&short)));
        }
        let way = way(start, &(start + direction * (deepest - NEARLY_MM)));
        around.is_approach_free(&way, &table.undo(contact), &ends, stylus)
    }
}

/// Rows of moves from their starts that the probe cannot make with the artefact anywhere within its
/// tolerance: ball or stem meet something else, or the approach finds nothing within its reach (mm,
/// one a row). Moves begin and end `above` mm over everything.
#[must_use]
pub fn blocked(
    arrangement: &Arrangement,
    moves: &Moves,
    reach: &[f64],
    stylus: Stylus,
    above: f64,
) -> Vec<usize> {
    let approaches = Approaches::new(arrangement, stylus, above);
    let axes = arrangement.machine.rotary().len();
    let is_blocked = |row: usize, reach: f64| {
        let posture = arrangement.posture(&moves.rotary[axes * row..axes * (row + 1)]);
        let start = Moves::vector(moves.point, row) + posture.head_shift;
        let direction = Moves::vector(moves.direction, row);
        let approach = Approach { posture: &posture, start, direction, reach, face: None };
        let travel = approaches.travel(&approach, None);
        !travel.is_some_and(|travel| approaches.is_free(&approach, &(start + direction * travel)))
    };
    let rows = reach.iter().enumerate().take(moves.len());
    rows.filter(|&(row, &reach)| is_blocked(row, reach)).map(|(row, _)| row).collect()
}
