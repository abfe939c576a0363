//! Location errors of the rotary axes: names by ISO 230-1, values absolute in the machine frame.
//!
//! An axis average line has two offsets, two tilts and the zero position of the axis. Of the six
//! components of the axis' frame, per side of the machine and from the bed outwards, are left out:
//! - the offset along the direction of its letter: a shift along the axis changes nothing;
//! - the tilt about the direction of an axis that carries it: it is that axis' zero position;
//! - on the last axis of the workpiece side the tilt about itself, its zero position: it is a turn of
//!   the workpiece on the table.
//!
//! For `[w C' A' b X Y Z t]` these are the paper's eight (Table 1): EA0A, EB0A, EC0A, EY0A, EZ0A,
//! EX0C, EY0C, EB0C. Values are absolute; in the chain an axis acts relative to the axes that carry
//! it, so that T_C holds EB0C − EB0A and EY0C − EY0A. An oblique axis has the set of its letter; the
//! component that is left out has a part along what makes it redundant.

use super::{Component, Machine, Place, Places, Side};
use crate::pose::Direction;
use crate::units::Unit;
use crate::{Error, Result};

/// One location error of one rotary axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LocationError {
    axis: usize,
    letter: char,
    component: Component,
}

impl LocationError {
    /// ISO 230-1 name with a digit zero: `EX0C` is the offset in X of axis C.
    #[must_use]
    pub fn name(&self) -> String {
        format!("E{}0{}", self.component.letter(), self.letter)
    }

    /// µm for offsets, arcsec for tilts.
    #[must_use]
    pub const fn unit(&self) -> Unit {
        match self.component {
            Component::Offset(_) => Unit::Um,
            Component::Tilt(_) => Unit::Arcsec,
        }
    }
}

impl Machine {
    /// The machine's location errors, axis by axis: tilts about X, Y, Z, then offsets.
    #[must_use]
    pub fn location_errors(&self) -> Vec<LocationError> {
        let mut errors = Vec::new();
        for (axis, rotary) in self.rotary().iter().enumerate() {
            let tilts = Direction::ALL.into_iter().map(Component::Tilt);
            let offsets = Direction::ALL.into_iter().map(Component::Offset);
            for component in tilts.chain(offsets) {
                if self.has_location_error(axis, component) {
                    errors.push(LocationError { axis, letter: rotary.letter(), component });
                }
            }
        }
        errors
    }

    /// The location error with this name (exact spelling).
    ///
    /// # Errors
    /// The machine has no location error of this name.
    pub fn location_error(&self, name: &str) -> Result<LocationError> {
        let errors = self.location_errors();
        errors.iter().find(|error| error.name() == name).copied().ok_or_else(|| {
            let known: Vec<String> = errors.iter().map(LocationError::name).collect();
            Error::unknown("location error", name, known.iter().map(String::as_str))
        })
    }

    /// Where a location error acts and with which factor: at its own axis, and with the opposite
    /// sign at the next axis of the same side whose own error of this component is absolute.
    #[must_use]
    pub fn places_of(&self, error: &LocationError) -> Vec<(Place, f64)> {
        let mut places = vec![(Place::frame(error.axis, error.component), 1.0)];
        let side = self.rotary()[error.axis].side;
        let next = (error.axis + 1..self.rotary().len()).find(|&axis| {
            self.rotary()[axis].side == side && self.has_location_error(axis, error.component)
        });
        if let Some(axis) = next {
            places.push((Place::frame(axis, error.component), -1.0));
        }
        places
    }

    /// Adds a location error (mm or rad) to the places.
    pub fn add_location_error(&self, places: &mut Places, error: &LocationError, amount: f64) {
        for (place, factor) in self.places_of(error) {
            places.add(place, factor * amount);
        }
    }

    /// The components of axes that are no location errors of this machine: name and why not.
    #[must_use]
    pub fn redundant_errors(&self) -> Vec<(String, String)> {
        let mut redundant = Vec::new();
        for (axis, rotary) in self.rotary().iter().enumerate() {
            for component in Component::ALL {
                if let Some(reason) = self.reason(axis, component) {
                    let letter = rotary.letter();
                    let error = LocationError { axis, letter, component };
                    redundant.push((error.name(), self.said(axis, reason)));
                }
            }
        }
        redundant
    }

    fn said(&self, axis: usize, reason: Reason) -> String {
        let letter = self.rotary()[axis].letter();
        match reason {
            Reason::Along => {
                let own = self.location_errors().into_iter().filter(|error| error.axis == axis);
                let offsets = own.filter(|error| matches!(error.component, Component::Offset(_)));
                let names: Vec<String> = offsets.map(|error| error.name()).collect();
                format!(
                    "a shift of axis {letter} along itself changes nothing; {} say where it is",
                    names.join(" and ")
                )
            }
            Reason::Placement => format!(
                "the zero position of axis {letter} is a turn of the workpiece on the table, which \
                 its placement holds"
            ),
            Reason::Carrier(carrier) => {
                let other = self.rotary()[carrier].letter();
                format!(
                    "a tilt of axis {letter} about axis {other}, which carries it, is the zero \
                     position of {other}: E{other}0{other}"
                )
            }
        }
    }

    fn has_location_error(&self, axis: usize, component: Component) -> bool {
        self.reason(axis, component).is_none()
    }

    /// Why a component is redundant; None: it is a location error.
    fn reason(&self, axis: usize, component: Component) -> Option<Reason> {
        let rotary = &self.rotary()[axis];
        let own = rotary.about();
        let about = match component {
            Component::Offset(along) => return (along == own).then_some(Reason::Along),
            Component::Tilt(about) => about,
        };
        let is_here = |other: usize| self.rotary()[other].side == rotary.side;
        let is_last = !(axis + 1..self.rotary().len()).any(is_here);
        let is_own_left_out = rotary.side == Side::Workpiece && is_last;
        if is_own_left_out && about == own {
            return Some(Reason::Placement);
        }
        let carrier = (0..axis).rfind(|&other| is_here(other))?;
        let mut along = *self.rotary()[carrier].direction();
        if is_own_left_out {
            // What is left of the carrier's direction beside the component that is gone.
            let direction = rotary.direction();
            along -= direction * (along[own.index()] / direction[own.index()]);
            along[own.index()] = 0.0;
        }
        let largest = along.amax();
        let nominal = self.rotary()[carrier].about();
        let is_clear = along[nominal.index()].abs() > CLEAR * largest;
        let gone = if is_clear { nominal.index() } else { along.iamax() };
        (about.index() == gone).then_some(Reason::Carrier(carrier))
    }
}

/// Why a component of an axis' frame is no location error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reason {
    /// It moves the axis along itself.
    Along,
    /// It moves the workpiece as its placement does.
    Placement,
    /// It is the zero position of this axis.
    Carrier(usize),
}

/// The tilt with the letter of the carrying axis is left out where its part is not smaller than this
/// beside the largest.
const CLEAR: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    fn names(code: &str) -> Vec<String> {
        let machine = Machine::of_code(code, 150.0).unwrap();
        machine.location_errors().iter().map(LocationError::name).collect()
    }

    #[test]
    fn machines_have_the_sets_of_iso_230_1() {
        assert_eq!(
            names("[w C' A' b X Y Z t]"),
            ["EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C"]
        );
        assert_eq!(
            names("[w C' B' b X Y Z t]"),
            ["EA0B", "EB0B", "EC0B", "EX0B", "EZ0B", "EA0C", "EX0C", "EY0C"]
        );
        assert_eq!(
            names("[w C' b X Y Z B t]"),
            ["EA0B", "EB0B", "EC0B", "EX0B", "EZ0B", "EA0C", "EB0C", "EX0C", "EY0C"]
        );
    }

    #[test]
    fn the_table_axis_acts_relative_to_the_tilting_axis() {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 150.0).unwrap();
        let mut places = Places::default();
        let error = machine.location_error("EY0A").unwrap();
        machine.add_location_error(&mut places, &error, 0.017);
        let along_y = Component::Offset(Direction::Y);
        assert_eq!(places.at(Place::frame(0, along_y)), 0.017);
        assert_eq!(places.at(Place::frame(1, along_y)), -0.017);
        let unknown = machine.location_error("EX0A").unwrap_err().to_string();
        assert!(unknown.contains("EX0A") && unknown.contains("EX0C"), "{unknown}");
    }

    /// Moves of the workpiece relative to the tool by every component of every axis: what the set
    /// leaves out is a combination of what it holds and the placement, and nothing in it is.
    #[test]
    fn the_set_is_minimal_and_complete() {
        for machine in crate::machine::examples(150.0) {
            let is_head = |axis: &crate::machine::Rotary| axis.side == Side::Tool;
            if machine.rotary().iter().any(is_head) {
                continue; // a constant shift of the head is in the set, by its definition
            }
            let poses: Vec<[f64; 2]> =
                (0..7).map(|i| [0.9 * f64::from(i) - 3.0, 2.1 - 1.3 * f64::from(i)]).collect();
            let column = |place: Place| {
                let mut rows = Vec::new();
                for pose in &poses {
                    let posture = crate::machine::Posture::new(&machine, pose, &machine.nominal());
                    for joint in posture.joints.iter().chain([&posture.placement]).enumerate() {
                        for (component, at) in Component::ALL.into_iter().enumerate() {
                            let here = match joint.0 {
                                0..3 => Place::frame(joint.0, Component::ALL[component]),
                                _ => Place::placement(at),
                            };
                            if here == place {
                                for probe in [[90.0, 0., 0.], [0., 80.0, 0.], [0., 0., 70.0]] {
                                    let point = posture.artefact.apply(&probe.into());
                                    for along in Direction::ALL {
                                        let n = posture.artefact.rotation * along.unit();
                                        rows.push(joint.1.rates(&point, &n)[component]);
                                    }
                                }
                            }
                        }
                    }
                }
                rows
            };
            let rank = |places: &[Place]| {
                let columns: Vec<f64> = places.iter().flat_map(|place| column(*place)).collect();
                let rows = columns.len() / places.len();
                let mut matrix = nalgebra::DMatrix::from_vec(rows, places.len(), columns);
                for mut column in matrix.column_iter_mut() {
                    column.normalize_mut();
                }
                matrix.svd(false, false).rank(1e-6)
            };
            let placement = Component::ALL.map(Place::placement);
            let kept = machine.location_errors();
            let kept = kept.iter().map(|e| Place::frame(e.axis, e.component)).chain(placement);
            let kept: Vec<Place> = kept.collect();
            let axes = 0..machine.rotary().len();
            let every = axes.flat_map(|axis| Component::ALL.map(|c| Place::frame(axis, c)));
            let every: Vec<Place> = every.chain(placement).collect();
            assert_eq!(rank(&kept), kept.len(), "{}", machine.code());
            assert_eq!(rank(&every), kept.len(), "{}", machine.code());
            let said = machine.redundant_errors();
            assert_eq!(said.len() + kept.len() - 6, 6 * machine.rotary().len());
        }
    }
}
