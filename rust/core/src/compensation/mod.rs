//! Compensation: from errors to corrected commands, and the volumetric error before and after.
//!
//! The machine as it is, [`Model`], meets the machine as the control assumes it to be,
//! [`volumetric::Control`]. All compensation by the control's model is a choice of what it assumes: the
//! nominal machine (nothing compensated), axis centres and axis zeros (CNC parameters), or the
//! whole identified machine (an exact error map, linear axes alone). [`inverse`] moves the rotary
//! axes as well.
//!
//! - [`volumetric`]: where the tool point is on the work minus where the program wants it;
//! - [`inverse`]: axis commands that put point and direction right on the erroneous machine.

pub mod inverse;
pub mod volumetric;

use nalgebra::Vector3;

use crate::effects::{Circumstances, Effect, Owner, Rate};
use crate::machine::{Component, LocationError, MAX_ROTARY, Machine, Place, Places};
use crate::units::Unit;
use crate::{Error, Result};

/// A machine with its errors: location errors, placement of the work, effects of the machine.
#[derive(Clone, Debug)]
pub struct Model {
    machine: Machine,
    errors: Vec<LocationError>,
    constant: Places,
    effects: Vec<Effect>,
    values: Vec<f64>,
    direction: Vector3<f64>,
    sense: [f64; MAX_ROTARY],
}

impl Model {
    /// A machine without errors.
    #[must_use]
    pub fn nominal(machine: Machine) -> Self {
        Self {
            errors: machine.location_errors(),
            constant: machine.nominal(),
            machine,
            effects: Vec::new(),
            values: Vec::new(),
            direction: Vector3::zeros(),
            sense: [0.0; MAX_ROTARY],
        }
    }

    /// Adds a location error of this machine, mm or rad.
    ///
    /// # Errors
    /// A value that is not finite.
    pub fn add_error(&mut self, error: &LocationError, amount: f64) -> Result<()> {
        let amount = finite(&error.name(), amount)?;
        self.machine.add_location_error(&mut self.constant, error, amount);
        Ok(())
    }

    /// Sets all location errors at once, in the order of the machine's, mm or rad. What was set
    /// before, the placement of the work with it, is forgotten.
    ///
    /// # Errors
    /// Another number of values than the machine has location errors, a value that is not finite.
    pub fn set_errors(&mut self, amounts: &[f64]) -> Result<()> {
        if amounts.len() != self.errors.len() {
            let expected = self.errors.len().to_string();
            return Err(Error::input("location errors", amounts.len(), expected));
        }
        self.constant = self.machine.nominal();
        for (error, amount) in self.errors.iter().zip(amounts) {
            if !amount.is_finite() {
                return Err(Error::input(error.name(), amount, "a finite number"));
            }
            self.machine.add_location_error(&mut self.constant, error, *amount);
        }
        Ok(())
    }

    /// Sets the placement of the work on the table: T_S = translate(dx, dy, dz) R(ra, rb, rc) in mm
    /// and rad.
    ///
    /// # Errors
    /// A value that is not finite.
    pub fn set_placement(&mut self, placement: &[f64; 6]) -> Result<()> {
        for (component, value) in Component::ALL.into_iter().zip(placement) {
            self.constant.add(Place::placement(component), finite("placement", *value)?);
        }
        Ok(())
    }

    /// Adds an effect with its parameters, mm, rad, s.
    ///
    /// # Errors
    /// An effect that does not belong to the machine, another number of values than parameters, a
    /// value that is not finite.
    pub fn add_effect(&mut self, effect: Effect, values: &[f64]) -> Result<()> {
        if effect.owner != Owner::Machine {
            let got = format!("{}, which belongs to the {}", effect.id, effect.owner.word());
            return Err(Error::input("effect", got, "one that moves the machine"));
        }
        if values.len() != effect.parameters.len() {
            let what = format!("values of effect {}", effect.id);
            return Err(Error::input(what, values.len(), effect.parameters.len().to_string()));
        }
        for (parameter, value) in effect.parameters.iter().zip(values) {
            self.values.push(finite(parameter.name, *value)?);
        }
        self.effects.push(effect);
        Ok(())
    }

    /// Sets the circumstances that reversal errors depend on: direction of travel (unit vector,
    /// machine frame) and sense of the last turn of each rotary axis. Zero, the default: none of
    /// them acts, the middle of the lost motion.
    pub fn approach(&mut self, direction: Vector3<f64>, sense: &[f64]) {
        self.direction = direction;
        for (slot, value) in self.sense.iter_mut().zip(sense) {
            *slot = *value;
        }
    }

    /// The chain of axes.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Amounts at all places with the rotary axes at these positions (rad).
    #[must_use]
    pub fn places(&self, rotary: &[f64]) -> Places {
        self.places_and_rates(rotary, None)
    }

    fn places_and_rates(&self, rotary: &[f64], mut rates: Option<&mut Vec<Rate>>) -> Places {
        let mut places = self.constant;
        let circumstances = Circumstances {
            rotary,
            sense: &self.sense[..rotary.len()],
            direction: self.direction,
            feed: 0.0,
            time: 0.0,
            elapsed: 0.0,
        };
        let mut first = 0;
        for effect in &self.effects {
            let own = &self.values[first..first + effect.parameters.len()];
            effect.act(&circumstances, own, first, &mut places, rates.as_deref_mut());
            first += own.len();
        }
        places
    }

    /// Names of the parameters of this model, location errors first, then those of its effects as
    /// "id.parameter", with their units.
    #[must_use]
    pub fn parameters(&self) -> Vec<(String, Unit)> {
        let errors = self.errors.iter().map(|error| (error.name(), error.unit()));
        let effects = self.effects.iter().flat_map(|effect| {
            let parameters = effect.parameters.iter();
            parameters.map(|p| (format!("{}.{}", effect.id, p.name), p.unit))
        });
        errors.chain(effects).collect()
    }
}

fn finite(what: &str, value: f64) -> Result<f64> {
    if value.is_finite() { Ok(value) } else { Err(Error::input(what, value, "a finite number")) }
}
