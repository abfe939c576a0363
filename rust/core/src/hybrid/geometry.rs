//! The mechanism with its errors as displacements at places: what the kinematics needs and no more.

use nalgebra::{Matrix3, Vector3};

use super::parameter::{ACTIVE, ERRORS, Errors, PLACES, Parameter, Place, Source};
use crate::machine::Component;
use crate::pose::rotation_xyz;

/// The displacement at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Displacement {
    pub shift: Vector3<f64>,
    pub tilt: Vector3<f64>,
    /// R(tilt); `None` where nothing is tilted.
    pub rotation: Option<Matrix3<f64>>,
}

/// A mechanism with its errors: what the kinematics needs and no more.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    pub(super) places: [Displacement; PLACES],
    /// Added to L1, L2, L3 (mm), q4, q5 (rad).
    pub(super) offsets: [f64; ACTIVE],
}

impl Geometry {
    /// The mechanism of nominal e1 to e17 (mm, rad) with errors.
    #[must_use]
    pub(super) fn new(dimensions: &[f64; ERRORS], errors: &Errors) -> Self {
        let zero = Displacement { shift: Vector3::zeros(), tilt: Vector3::zeros(), rotation: None };
        let mut geometry = Geometry { places: [zero; PLACES], offsets: [0.0; ACTIVE] };
        for (i, value) in dimensions.iter().enumerate() {
            geometry.add(Parameter::Paper(i), *value);
        }
        for (parameter, value) in errors {
            geometry.add(*parameter, *value);
        }
        for place in &mut geometry.places {
            if place.tilt != Vector3::zeros() {
                place.rotation = Some(rotation_xyz(place.tilt.x, place.tilt.y, place.tilt.z));
            }
        }
        geometry
    }

    fn add(&mut self, parameter: Parameter, value: f64) {
        match (parameter, parameter.source()) {
            (_, Some(Source::Joint(joint))) => self.offsets[joint] += value,
            (_, Some(Source::Places(terms))) => {
                for (place, component, sign) in terms {
                    self.displace(*place, *component, sign * value);
                }
            }
            (Parameter::Outside(place, component), None) => {
                self.displace(place, component, value);
            }
            (Parameter::Paper(_), None) => {}
        }
    }

    fn displace(&mut self, place: Place, component: Component, value: f64) {
        let displacement = &mut self.places[place.index()];
        match component {
            Component::Offset(direction) => displacement.shift[direction.index()] += value,
            Component::Tilt(direction) => displacement.tilt[direction.index()] += value,
        }
    }
}
