//! Location errors of the rotary axes: names by ISO 230-1, values absolute in the machine frame.
//!
//! An axis average line has two offsets, two tilts and the zero position of the axis. Of these,
//! per side of the machine and from the bed outwards,
//! - the zero position of the last axis of the workpiece side is left out: it is a turn of the
//!   workpiece on the table;
//! - a tilt about the direction of an axis that carries this one is left out: it is that axis's
//!   zero position.
//!
//! For `trt-ca` these are the paper's eight (Table 1): EA0A, EB0A, EC0A, EY0A, EZ0A, EX0C, EY0C,
//! EB0C. Values are absolute; in the chain an axis acts relative to the axes that carry it, so
//! that T_C holds EB0C − EB0A and EY0C − EY0A.

use super::{Component, Machine, Place, Places, Rotary, Side};
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

    fn has_location_error(&self, axis: usize, component: Component) -> bool {
        let Rotary { direction, side } = self.rotary()[axis];
        let on_this_side = |other: &&Rotary| other.side == side;
        match component {
            Component::Offset(along) => along != direction,
            Component::Tilt(about) if about == direction => {
                let is_last = self.rotary()[axis + 1..].iter().all(|other| other.side != side);
                side == Side::Tool || !is_last
            }
            Component::Tilt(about) => !self.rotary()[..axis]
                .iter()
                .filter(on_this_side)
                .any(|other| other.direction == about),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(preset: &str) -> Vec<String> {
        let machine = Machine::preset(preset, 150.0).unwrap();
        machine.location_errors().iter().map(LocationError::name).collect()
    }

    #[test]
    fn presets_have_the_sets_of_iso_230_1() {
        assert_eq!(
            names("trt-ca"),
            ["EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C"]
        );
        assert_eq!(
            names("trt-bc"),
            ["EA0B", "EB0B", "EC0B", "EX0B", "EZ0B", "EA0C", "EX0C", "EY0C"]
        );
        assert_eq!(
            names("table-c-head-b"),
            ["EA0B", "EB0B", "EC0B", "EX0B", "EZ0B", "EA0C", "EB0C", "EX0C", "EY0C"]
        );
    }

    #[test]
    fn the_table_axis_acts_relative_to_the_tilting_axis() {
        let machine = Machine::preset("trt-ca", 150.0).unwrap();
        let mut places = Places::default();
        let error = machine.location_error("EY0A").unwrap();
        machine.add_location_error(&mut places, &error, 0.017);
        let along_y = Component::Offset(Direction::Y);
        assert_eq!(places.at(Place::frame(0, along_y)), 0.017);
        assert_eq!(places.at(Place::frame(1, along_y)), -0.017);
        let unknown = machine.location_error("EX0A").unwrap_err().to_string();
        assert!(unknown.contains("EX0A") && unknown.contains("EX0C"), "{unknown}");
    }
}
