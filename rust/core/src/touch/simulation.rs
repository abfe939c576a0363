//! Virtual measurements.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::TouchModel;
use crate::artefact::Search;
use crate::moves::Moves;
use crate::{Error, Result};

/// How a plan is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Simulation {
    /// What the rows' points are: starts of moves, or touches recorded before.
    pub search: Search,
    /// Longest travel of a move, mm.
    pub reach: f64,
    /// Standard deviation of the probe's repeatability, mm.
    pub noise: f64,
    /// Seed; the noise of sample number `sample` does not depend on any other sample.
    pub seed: u64,
}

impl TouchModel {
    /// Travel at the trigger for every row: contact plus noise, then the next tick.
    ///
    /// `values` are the true parameters; `sample` numbers independent measurements of one seed.
    ///
    /// # Errors
    /// A move that does not touch the artefact within its reach, or starts inside it.
    pub fn simulate(
        &self,
        moves: &Moves,
        values: &[f64],
        simulation: &Simulation,
        sample: u64,
        travel: &mut [f64],
    ) -> Result<()> {
        let mut evaluator = self.evaluator(moves, values);
        let mut random = Pcg64::new(u128::from(simulation.seed), u128::from(sample));
        for (row, slot) in travel.iter_mut().enumerate() {
            let contact = evaluator.contact(row, simulation.search);
            let reached = contact.filter(|contact| contact.travel.abs() <= simulation.reach);
            let contact = reached.ok_or_else(|| {
                let problem = match contact {
                    Some(contact) => format!("touches only after {:.3} mm", contact.travel),
                    None => "does not touch the artefact, or starts inside it".to_owned(),
                };
                let expected = format!("a touch within {} mm", simulation.reach);
                Error::Data(format!("move in row {row} {problem}; expected {expected}"))
            })?;
            let noise: f64 =
                if simulation.noise > 0.0 { StandardNormal.sample(&mut random) } else { 0.0 };
            *slot =
                self.probe.trigger(contact.travel + simulation.noise * noise, moves.feed_at(row));
        }
        Ok(())
    }
}
